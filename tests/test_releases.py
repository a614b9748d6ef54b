"""Releases of signals made here and of measured ones: how many, from where to where."""

import itertools
import re

import numpy as np
import pytest
from oracles import falling_decay, viscous_decay
from scipy.signal import butter, lfilter, sosfiltfilt

from romsindy import Decay
from romsindy.record.recording import Recording
from romsindy.record.releases import background_of, split_releases
from romsindy.record.smoothing import displacement

DT = 0.004
OMEGA = 2 * np.pi


def ring(t, blows, modes=((1.0, 0.004),), derivative=0):
    """Response of modes (Hz, damping ratio) to half-sine blows (time, size, duration): exact sums.

    Impulse responses convolved with the force: the trapezoidal rule, error (omega dt)^2 / 12.
    """
    force = np.zeros(len(t))
    for at, size, width in blows:
        on = (t >= at) & (t < at + width)
        force[on] += size * np.sin(np.pi * (t[on] - at) / width) * np.pi / (2 * width)
    x = np.zeros(len(t))
    for f, zeta in modes:
        w = 2 * np.pi * f
        pole = w * (-zeta + 1j * np.sqrt(1 - zeta**2))
        # d/dt of the convolution with exp(pole t) multiplies by the pole, plus the force itself.
        z = lfilter([0, 1.0], [1.0, -np.exp(pole * DT)], force * DT)
        x += np.imag(z * pole**derivative) / pole.imag + (force if derivative == 2 else 0.0)
    return x


def spans(releases):
    return [(r.start, r.end) for r in releases]


def find_releases(recording):
    return split_releases(recording)[0]


@pytest.mark.parametrize("snr_db", [60, 10])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_blows_on_top_of_an_older_decay(derivative, snr_db):
    t = np.arange(0, 70, DT)
    at = [4.0, 25.0, 47.0]
    blows = [(a, size, 0.05) for a, size in zip(at, (1.0, -1.2, 1.1), strict=True)]
    x = ring(t, blows, ((1.0, 0.004), (2.7, 0.006)), derivative)
    noise = np.random.default_rng(1).standard_normal(len(t))
    x = x + 10 ** (-snr_db / 20) * x.std() * noise
    quantity = ("displacement", "velocity", "acceleration")[derivative]
    releases = find_releases(Recording(t, x, quantity=quantity))
    # A blow is known to the half cycle that is predicted; the first large swing may come later.
    assert len(releases) == 3
    for release, blow in zip(releases, at, strict=True):
        assert blow < release.start < blow + 1.5
    began = re.search(r"(at rest until|after the blow at) (\S+) s", releases[0].why_start)
    assert float(began[2]) == pytest.approx(at[0], abs=0.15)
    if snr_db == 60:  # at 10 dB the noise takes over before
        for release, following in itertools.pairwise(releases):
            assert following.start - 1.5 < release.end < following.start
            assert "next release at" in release.why_end


@pytest.mark.parametrize(
    "x",
    [
        viscous_decay(np.arange(8000) * DT, OMEGA, 0.004),
        np.sin(OMEGA * np.arange(8000) * DT),
        falling_decay(np.arange(8000) * DT, rate=0.3)[0],
        ring(np.arange(0, 60, DT), [(0.0, 1.0, 0.02)], ((1.0, 0.003), (1.07, 0.003))),
        ring(np.arange(0, 60, DT), [(0.0, 1.0, 0.02)], ((1.0, 0.003), (1.35, 0.003), (4.1, 0.01))),
    ],
    ids=["one mode", "steady", "falling frequency", "slow beats", "fast beats"],
)
@pytest.mark.parametrize("snr_db", [80, 20])
def test_what_is_free_is_one_release(x, snr_db):
    noise = np.random.default_rng(2).standard_normal(len(x))
    x = x + 10 ** (-snr_db / 20) * x.std() * noise
    assert len(find_releases(Recording(np.arange(len(x)) * DT, x))) == 1


@pytest.mark.parametrize("order", list(itertools.permutations((45, 90, 135))))
@pytest.mark.parametrize("joint", ["nothing", "a gap", "zeros", "NaN"])
def test_joined_pendulums_come_apart(measured, order, joint):
    """Each as if it were by itself, within a cycle."""
    with np.load(measured / "pendulum_free_swing.npz") as content:
        x = [content[f"release_{k}deg_theta_deg"] for k in order]
    n, dt, fill = 5000, 1e-3, {"zeros": 0.0, "NaN": np.nan}.get(joint)
    alone = [find_releases(Recording(np.arange(n) * dt, part))[0] for part in x]
    gaps = (0, 0) if joint == "nothing" else (3000, 2000)
    begins = np.array([0, n + gaps[0], 2 * n + sum(gaps)]) * dt
    if fill is None:
        t = np.concatenate([begin + np.arange(n) * dt for begin in begins])
        joined = Recording(t, np.concatenate(x))
    else:
        between = [np.full(gap, fill) for gap in gaps]
        samples = np.concatenate([x[0], between[0], x[1], between[1], x[2]])
        joined = Recording(np.arange(len(samples)) * dt, samples)
    found = find_releases(joined)
    assert len(found) == 3
    for release, single, begin in zip(found, alone, begins, strict=True):
        assert release.start - begin == pytest.approx(single.start, abs=0.35)
        assert release.end - begin == pytest.approx(single.end, abs=0.7)


@pytest.mark.slow
def test_measured_records_are_one_release_each(measured):
    with np.load(measured / "double_beam_train.npz") as content:
        for v in content["v"].T:
            assert len(find_releases(Recording(content["t"], v, quantity="velocity"))) == 1
    with np.load(measured / "cc_beam_bristol.npz") as content:
        for run in ("mode1a", "mode1b", "mode2", "mode3"):
            record = Recording(content[f"{run}_t"], content[f"{run}_v"], quantity="velocity")
            assert len(find_releases(record)) == 1
    with np.load(measured / "kvlcc2_roll_decay.npz") as content:
        for run, still, free in (("21337", 24.0, 24.9), ("21338", 7.1, 8.1)):
            record = Recording(content[f"test_{run}_0kn_t"], content[f"test_{run}_0kn_phi"])
            (release,) = find_releases(record)
            began = re.fullmatch(r"at rest until (\S+) s", release.why_start)
            assert float(began[1]) == pytest.approx(still, abs=0.3)
            assert release.start == pytest.approx(free, abs=0.1)
    with np.load(measured / "brake_reuss_hammer.npz") as content:
        x = np.stack([content[f"acc{i}"] for i in (1, 2, 3)], axis=1)
        (release,) = find_releases(Recording(content["t"], x, quantity="acceleration"))
        assert 0 < release.start < 0.0125  # within a cycle of the hit
        assert "after the blow" in release.why_start


def test_sensors_at_other_places_tell_the_same():
    t = np.arange(0, 50, DT)
    x = ring(t, [(3.0, 1.0, 0.05), (27.0, -1.0, 0.05)])
    y = ring(t, [(3.0, 1.0, 0.05), (27.0, -1.0, 0.05)], ((2.3, 0.005),))
    one = spans(find_releases(Recording(t, x)))
    assert len(one) == 2
    assert spans(find_releases(Recording(t, -x))) == one
    both = find_releases(Recording(t, np.stack([x, 1e-3 * (y - x)], axis=1)))
    np.testing.assert_allclose(spans(both), one, atol=1.0)


def test_every_sample_is_used_or_discarded_with_a_reason():
    t = np.arange(0, 60, DT)
    x = ring(t, [(5.0, 1.0, 0.05), (40.0, -1.0, 0.05)])
    x += np.random.default_rng(3).normal(0, 0.02, len(t))
    releases, discarded = split_releases(Recording(t, x))
    covered = np.zeros(len(t), int)
    for part in (*releases, *discarded):
        covered += (t >= part.start - DT / 2) & (t <= part.end + DT / 2)
    assert np.count_nonzero(covered != 1) <= 3 * len(releases)  # a jump is known to 3 samples
    assert all(part.reason for part in discarded)


def test_a_hand_that_pushes_again_ends_the_release():
    """Over eight cycles, after a decay of fifty: no beating rises that fast."""
    t, zeta = np.arange(0, 110, DT), 0.006
    pole = OMEGA * (-zeta + 1j)
    push = np.where((t > 50) & (t < 58), -0.01 * OMEGA**2 * np.sin(OMEGA * t), 0.0)
    added = np.imag(lfilter([0, DT], [1, -np.exp(pole * DT)], push.astype(complex))) / OMEGA
    releases = find_releases(Recording(t, viscous_decay(t, OMEGA, zeta) + added))
    assert len(releases) == 2
    assert releases[0].end == pytest.approx(50, abs=8)
    assert "pushed again" in releases[0].why_end


def test_free_says_which_release_it_takes():
    t = np.arange(0, 60, DT)
    x = ring(t, [(5.0, 0.6, 0.05), (40.0, -1.0, 0.05)])
    with pytest.warns(
        UserWarning, match=r"holds 2 releases; that from 40.* others with start= and"
    ):
        decay = Decay(t, x).free()
    assert 40 < decay.t[0] < 41.5
    first = Decay(t, x).free(end=38.0)
    assert first.t[0] < 6.5 and first.t[-1] == pytest.approx(38.0)
    with pytest.raises(
        ValueError, match=r"between 0 and 4 s: fewer than three cycles .* filter it"
    ):
        Decay(t[:1001], 1e-9 * np.random.default_rng(0).standard_normal(1001)).free()


def test_what_is_too_short_is_told_not_the_noise_behind_it():
    """Dry friction that stops the motion in two cycles, as an accelerometer shows it: exact."""
    t = np.arange(0, 5, DT)
    band = butter(3, (2 * DT, 12 * DT), "band", output="sos")
    noise = sosfiltfilt(band, np.random.default_rng(0).standard_normal(len(t)))
    for fall in (0.1, 0.15, 0.2):
        half = np.floor(2 * OMEGA * t / np.pi)
        a = np.cos(2 * OMEGA * t) * np.maximum(1 - fall * (2 * half + 1), 0.0)
        with pytest.raises(ValueError, match=r"no free decay .*: only [\d.]+ cycles"):
            Decay.from_acceleration(t, a + 0.003 * noise / noise.std(), unit="m")


def pink(n, rng):
    """Noise of power 1/f, rms 1."""
    lines = np.fft.rfft(rng.standard_normal(n))
    lines[1:] /= np.sqrt(np.arange(1, len(lines)))
    lines[0] = 0.0
    x = np.fft.irfft(lines, n)
    return x / x.std()


@pytest.mark.parametrize(("times", "amplitude"), [(1, 0.002), (2, 0.001)])
def test_integral_with_offset_drift_and_pink_noise(times, amplitude):
    """Where samples are kept the error is near what the noise itself integrates to."""
    rng, t = np.random.default_rng(4), np.arange(10_000) * DT
    pole = OMEGA * (-0.005 + 1j)
    z = np.exp(pole * t + 0.4j)
    rate = np.imag(pole**times * z)
    size = np.abs(rate).max()
    dirty = rate + size * (0.5 + 0.1 * t / t[-1] + amplitude * pink(len(t), rng))
    q, sound = displacement(dirty, DT, 1.0, times)
    error = np.abs(q - np.imag(z))[sound] / np.abs(z)[sound]
    early = slice(0, len(error) // 3)  # later the noise is a larger part
    assert sound.start <= 125 and len(q) - sound.stop <= 125  # half a cycle
    assert error[early].max() < 0.02


def test_hit_in_an_accelerometer_record_leaves_no_drift():
    """The sensor clips during the hit; integrated from the start it drifts away by far."""
    t = np.arange(0, 40, DT)
    blow = [(0.5, 0.06, 0.03)]
    modes = ((1.0, 0.006), (6.3, 0.02))
    a, q = ring(t, blow, modes, 2), ring(t, blow, modes)
    noisy = np.clip(a, -2.8, 2.8) + 0.45 + np.random.default_rng(5).normal(0, 0.003, len(t))
    decay = Decay.from_acceleration(t, noisy, "m")
    assert 0.5 < decay.t[0] < 2.5  # the hit, and half a cycle
    true = np.interp(decay.t, t, q)
    cycle = round(1 / DT)
    for part in (slice(0, 2 * cycle), slice(-2 * cycle, None)):
        assert np.abs(decay.q - true)[part].max() < 0.05 * np.abs(true[part]).max()


def test_cantilever_as_recorded(measured):
    """Accelerometers with the hit in the record, which clips, and an offset of 0.45."""
    with np.load(measured / "cantilever_steel_accelerometers.npz") as content:
        t, x = content["t"], content["acc"]
    for acceleration in x.T:
        decay = Decay.from_acceleration(t, acceleration, "m")
        assert decay.t[0] < 0.2 and "after the blow at 0.02" in decay.notes[0]
        size = [np.abs(part).max() for part in np.array_split(decay.q, 40)]
        assert size[0] < 1e-3 and size[-1] < 1.05 * size[-2] < 1.1 * size[-3]


def coloured(kind, n, rng):
    """Noise of rms 1: an autoregression of the first order, a power of frequency, or low-passed."""
    white = rng.standard_normal(n + 2000)
    if kind.startswith("ar"):
        x = lfilter([1.0], [1.0, -float(kind[2:])], white)[2000:]
    elif kind == "low-passed":
        x = sosfiltfilt(butter(4, 0.1, output="sos"), white)[2000:]
    else:
        lines = np.fft.rfft(white)
        lines[1:] /= np.arange(1, len(lines)) ** (float(kind[1:]) / 2)
        x = np.fft.irfft(lines * (np.arange(len(lines)) > 0))[:n]
    return (x - x.mean()) / x.std()


@pytest.mark.parametrize("kind", ["ar0", "ar0.9", "ar0.99", "f1", "f2", "low-passed"])
def test_noise_behind_a_decay_is_no_release(kind):
    """A decay of 60 cycles to the noise, and 240 cycles of that: one release, over before it."""
    for seed in range(3):
        t = np.arange(0, 300, DT * 10)
        x = viscous_decay(t, OMEGA, 0.012) + 0.01 * coloured(
            kind, len(t), np.random.default_rng(seed)
        )
        (release,) = find_releases(Recording(t, x))
        # 1 % of the amplitude is reached after 61 cycles; a third of slow noise is no vibration.
        assert release.start < 1 and 30 < release.end < 120, (kind, seed, release)


def test_background_is_told_of_what_decays():
    """Its rms where there is one; none in a decay, a beat, or a tone that stays."""
    t = np.arange(0, 200, 0.04)
    noise = coloured("ar0.5", len(t), np.random.default_rng(7))
    decay = viscous_decay(t, OMEGA, 0.012)
    # The mean of a cycle is no background: of 25 samples, the lag of 0.5 leaves 94 %.
    assert background_of(decay + 0.01 * noise, 25) == pytest.approx(0.01, rel=0.1)
    beats = viscous_decay(t, OMEGA, 0.003) + viscous_decay(t, 1.07 * OMEGA, 0.003)
    for x in (viscous_decay(t, OMEGA, 0.002), beats, np.cos(OMEGA * t)):
        assert background_of(x, 25) == 0


@pytest.mark.parametrize("hum", [0.0, 0.03, 0.1])
def test_hum_alone_is_no_release(hum):
    """Held, let go, and stopped by dry friction: half cycles about +-mu, as the law has them.

    The hold hums before it, and what has come to rest after it: each was a release.
    """
    f, mu, dt = 12.0, 0.03, 0.002
    t = np.arange(0, 3.5, dt)
    half = np.floor(2 * f * np.maximum(t - 1.5, 0))
    size = np.maximum(1 - mu * (2 * half + 1), 0.0)
    x = np.where(size > 0, size * np.cos(2 * np.pi * f * (t - 1.5)) + mu * (-1) ** half, 0.0)
    x = np.where(t < 1.5, 1.0, x)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    releases = find_releases(Recording(t, x + hum * np.sin(2 * np.pi * 49.95 * t) + noise))
    assert [round(r.start, 1) for r in releases] == [1.5]
