"""The noise of a record is known as it is, whatever its colour, and however its offset drifts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct, idct
from scipy.integrate import solve_ivp
from scipy.signal import butter, freqz, lfilter, lfilter_zi, sosfilt

import romsindy as rs
from romsindy.diagnosis.search import combs, tuned
from romsindy.fit.adequacy.verdicts import examine
from romsindy.fit.records.record import Record, sharing_drift
from romsindy.fit.verdict import EXPLAINED
from romsindy.record.noise import drift
from romsindy.record.spectrum import Line, Spectrum, distortion

RATE, F0 = 200.0, 5.0
T = np.arange(0, 16, 1 / RATE)
OMEGA = 2 * np.pi * F0


def _rates(t, y, damping=0.3):
    # Asymmetric: the mean of the motion follows its amplitude, as a drift might.
    return [y[1], -(OMEGA**2) * y[0] * (1 + 0.1 * y[0] + 0.2 * y[0] ** 2) - damping * y[1]]


CLEAN = solve_ivp(_rates, (0, T[-1]), [1.0, 0.0], t_eval=T, rtol=1e-9, atol=1e-10).y[0]
STD = 0.01


def white(rng):
    return rng.standard_normal(len(T))


def filtered(rng, edges, kind):
    sos = butter(4, np.array(edges) * 2 / RATE, kind, output="sos")
    x = sosfilt(sos, rng.standard_normal(len(T) + 2000))[2000:]
    return x / np.std(x)


def low_passed(rng):
    return filtered(rng, 3 * F0, "low")


def band_passed(rng):
    return filtered(rng, [1.5 * F0, 5 * F0], "band")


def walk(rng):
    steps = np.cumsum(rng.standard_normal(len(T)))
    return white(rng) + 3 * steps / np.std(steps)


def swing(rng):
    return white(rng) + 4 * np.sin(2 * np.pi * (rng.uniform(0.3, 8) * T / T[-1] + rng.random()))


NOISES = (white, low_passed, band_passed, walk, swing)
STEADY = NOISES[:3]


def recorded(noise: np.ndarray, floor: float = 1e-6) -> Record:
    return Record.of(rs.Decay(T, CLEAN + noise), floor)


@pytest.mark.parametrize("kind", NOISES)
def test_the_residual_of_the_true_motion_is_white_with_rms_1(kind):
    """Level within what EXPLAINED allows, and as flat as 80 cycles show it.

    The offset and a mean that follows the amplitude are hardly larger than by chance: chi-square
    of one value is 10.8 once in a thousand. Without the drift it would be hundreds.
    """
    for seed in range(5):
        noise = STD * kind(np.random.default_rng(seed))
        record = recorded(noise)
        left = record.whitened(noise)
        # What a filter may have made of the harmonics takes some of the noise with it.
        assert 0.85 < np.sqrt(left @ left / record.count) < EXPLAINED
        # Every fifth of a fundamental holds 32 cosines; no part is louder than noise may be.
        power = dct(left, norm="ortho") ** 2
        bands = [np.mean(p) for p in np.array_split(power, round(5 * RATE / 2 / F0))]
        assert max(bands) < 3
        assert examine([record], [noise], 0).explained
        envelope = np.abs(record.spline.amplitudes(T)[:, 1])
        for mean in (np.ones(len(T)), envelope**2):
            x = record.whitened(mean)
            assert (x @ left) ** 2 / (x @ x) < 15


@pytest.mark.parametrize("kind", NOISES)
def test_whitening_is_linear_and_symmetric(kind):
    rng = np.random.default_rng(6)
    record = replace(recorded(STD * kind(rng)), doubts=None, first=0)
    x, y = rng.standard_normal((2, len(T)))
    both = record.whitened(np.stack([x, y], axis=1))
    # To rounding of sums of 3200 terms.
    np.testing.assert_allclose(both[:, 0], record.whitened(x), atol=1e-9 * np.abs(both).max())
    np.testing.assert_allclose(
        record.whitened(x - 2 * y), both @ [1, -2], atol=1e-9 * np.abs(both).max()
    )
    assert x @ record.whitened(y) == pytest.approx(y @ record.whitened(x), rel=1e-9)


def test_what_lies_beyond_a_filter_decides_nothing():
    """A wave 46 dB below the noise, at five times the edge of the filter.

    The noise is 56 dB lower there than where it is loud: weighed by it, the wave would be all that
    counts.
    """
    noise = STD * low_passed(np.random.default_rng(0))
    record = recorded(noise)
    wave = 0.005 * STD * np.sqrt(2) * np.cos(2 * np.pi * 15 * F0 * T)
    assert np.sum(record.whitened(wave) ** 2) < 0.2 * np.sum(record.whitened(noise) ** 2)
    assert record.count < 0.6 * len(T)


def test_a_jump_that_a_filter_took_away_decides_nothing():
    """Steps of 0.7 of the noise, twice in a cycle, that came through the filter with the noise.

    A model shows them as they were. By noise that is 30 dB lower there they count for fifty times
    as much as all noise; by that before the filter for the power of the steps there, 2 %.
    """
    sos = butter(6, 8 * F0 * 2 / RATE, output="sos")
    steps = 0.7 * STD * np.sign(np.sin(OMEGA * T + 0.3))
    before = STD * white(np.random.default_rng(0))
    record = recorded(sosfilt(sos, before))
    missed = steps - sosfilt(sos, steps)
    beyond = dct(missed, norm="ortho")
    beyond[: round(2 * T[-1] * 12 * F0)] = 0.0
    left = record.noise(idct(beyond, norm="ortho"))
    assert left @ left < 0.04 * record.count


@pytest.mark.parametrize("kind", STEADY)
def test_a_mean_that_follows_the_amplitude_is_no_drift(kind):
    for seed in range(3):
        assert recorded(STD * kind(np.random.default_rng(seed))).noise.drift is None


@pytest.mark.parametrize("cycles", [12, 15])
def test_a_drift_is_known_in_a_dozen_cycles(cycles):
    """An offset that walks, beside a mean that follows the amplitude.

    Unknown, it leaves up to three times the noise. Without it none is found.
    """
    t = T[: round(cycles * RATE / F0)]
    options = {"t_eval": t, "args": (2.0,), "rtol": 1e-9, "atol": 1e-10}
    clean = solve_ivp(_rates, (0, t[-1]), [1.0, 0.0], **options).y[0]
    for seed in range(5):
        rng = np.random.default_rng(seed)
        steps, steady = np.cumsum(rng.standard_normal(len(t))), STD * white(rng)[: len(t)]
        walked = 3 * STD * (steps - steps.mean()) / np.std(steps) + steady
        drifting, still = (Record.of(rs.Decay(t, clean + x), 1e-6) for x in (walked, steady))
        left = drifting.whitened(walked)
        assert 0.85 < np.sqrt(left @ left / drifting.count) < EXPLAINED
        assert still.noise.drift is None


def test_a_drift_holds_no_more_than_there_is():
    """What swings slowly and fades where a record begins is no drift that a mean hides.

    Beside that of a vibration that fades it was taken for a drift a thousand times as large.
    """
    dt, cycle = 1 / 5120, 1 / 122
    t = np.arange(15677) * dt
    swinging = 0.03 * np.exp(-t / 0.02) * np.cos(2 * np.pi * 20 * t)
    quiet = Spectrum(np.array([0.0, 2560.0]), np.array([2.5e-7, 2.5e-7]))
    found = drift(swinging, np.exp(-1.5 * t), quiet, cycle, dt)
    assert found is not None
    slow = np.arange(1, 50)
    held = found(slow / (2 * len(t) * dt))
    assert np.all(held <= 10.1 * np.max(dct(swinging, norm="ortho")[1:60] ** 2))


def test_an_offset_that_stays_is_seen_in_full():
    """Chi-square of a constant c in n white samples is n (c / std)^2."""
    noise = STD * white(np.random.default_rng(1)) + 0.5 * STD
    record = recorded(noise)
    seen = np.sum(record.whitened(np.full(len(T), 0.5 * STD)) ** 2)
    assert seen == pytest.approx(0.25 * len(T), rel=0.1)  # the level of the noise: 4 %


def test_cycles_are_counted_right_in_loud_noise_as_slow_as_the_vibration():
    """At 15 dB at the end: crossings of the noise are no cycles."""
    for seed in range(4):
        record = recorded(0.05 * filtered(np.random.default_rng(seed), 4 * F0, "low"))
        # The frequency rises by 7 % with the amplitude: 80 cycles and a few.
        assert 80 <= len(record.cycles) <= 84


@pytest.mark.parametrize("edge", [0.3, 0.5, 0.8])
def test_the_noise_tells_what_its_filter_does_to_harmonics(edge):
    """Gain and phase of a Butterworth filter of order 6, at edges over the Nyquist frequency.

    The harmonics' own delay counts, beyond one of them all; the stop band is seen down to 34 dB.
    """
    b, a = butter(6, edge)
    at = np.linspace(0, 0.5 * RATE, 400)
    seen = Spectrum(at, np.maximum(np.abs(freqz(b, a, at, fs=RATE)[1]) ** 2, 4e-4))
    number = np.arange(1, 7)
    h = freqz(b, a, number * F0, fs=RATE)[1]
    true = np.abs(h[1:] / np.abs(h[0]) * np.exp(-1j * number[1:] * np.angle(h[0])) - 1)
    said = distortion(seen, 1 / RATE, F0, 6)
    assert np.all(said > true) and np.all(said < 4 * true)


def test_noise_that_is_merely_red_tells_of_no_filter():
    at = np.linspace(0, 0.5 * RATE, 400)
    red = 1 / np.abs(1 - 0.9 * np.exp(-2j * np.pi * at / RATE)) ** 2
    assert not np.any(distortion(Spectrum(at, red), 1 / RATE, F0, 6))
    for seed in range(4):
        x = lfilter([1.0], [1.0, -0.9], white(np.random.default_rng(seed)))
        assert recorded(STD * x, 2e-4).doubts is None


def test_what_a_filter_makes_of_harmonics_is_no_misfit():
    """The true motion, delayed as its fundamental is, beside what came through a filter.

    What is left is the fundamental alone, whose frequency and so whose delay change on the way.
    """
    b, a = butter(6, 3 * F0 * 2 / RATE)
    noise = 0.03 * STD * np.random.default_rng(3).standard_normal(len(T))
    seen = lfilter(b, a, CLEAN + noise, zi=lfilter_zi(b, a) * CLEAN[0])[0]
    delay = -np.angle(freqz(b, a, [1.03 * F0], fs=RATE)[1][0]) / (1.03 * OMEGA)
    late = solve_ivp(_rates, (0, T[-1]), [1.0, 0.0], t_eval=T[40:] - delay, rtol=1e-9, atol=1e-10)
    record = Record.of(rs.Decay(T[40:], seen[40:]), 1e-6)
    misfit = seen[40:] - late.y[0]
    naive = replace(record, doubts=None).whitened(misfit)
    left = record.whitened(misfit)
    assert naive @ naive > 5 * (left @ left)


def test_a_filter_may_have_changed_the_ninth_harmonic_as_well():
    """It lies at the edge of the filter, and is turned by a radian beside the others.

    It is 13 times the noise at first, and fades with the ninth power of the amplitude.
    """
    plain = Record.of(rs.Decay(T, CLEAN), 1e-6)
    a = np.abs(plain.spline.amplitudes(T)[:, 1])
    wave = 0.1 * (a / a.max()) ** 9 * np.exp(9j * plain.spline.phase(T))
    noise = STD * filtered(np.random.default_rng(4), 9 * F0, "low")
    record = Record.of(rs.Decay(T, CLEAN + wave.real + noise), 1e-6)
    misfit = wave.real - (wave * np.exp(1j)).real
    naive = replace(record, doubts=None).whitened(misfit)
    left = record.whitened(misfit)
    assert naive @ naive > 5 * (left @ left)


def test_what_takes_no_part_says_nothing_of_a_filter():
    """Beyond what takes part nothing is misfit: what a filter may have done adds none."""
    record = recorded(STD * low_passed(np.random.default_rng(5)))
    misfit, judges = np.zeros(len(T)), np.ones(len(T), bool)
    misfit[: record.first // 2] = 1.0
    alone = replace(record, doubts=None).whitened(misfit)
    assert record.doubts is not None
    assert np.sum(record.whitened(misfit) ** 2) <= alone @ alone
    misfit[1000:2000], judges[900:2100] = 1.0, False
    tested = replace(record, part=judges)
    alone = replace(tested, doubts=None).whitened(misfit)
    assert np.sum(tested.whitened(misfit) ** 2) <= alone @ alone


def test_lines_that_are_harmonics_of_one_frequency_are_one_comb():
    t = np.arange(0, 10, 0.001)
    mains = [Line(150.02, 3.0), Line(50.0, 2.0), Line(99.97, 1.0)]
    mode = Line(71.3, 2.5)
    found = combs([mains[0], mode, *mains[1:]], t)
    assert [first / (2 * np.pi) for first, _ in found] == pytest.approx([50.0] * 2, abs=0.05)
    assert [highest for _, highest in found] == [3, 6]  # others may be too weak to be seen
    assert combs([], t) == ()


def test_a_line_alone_may_be_the_second_harmonic():
    """The first may lie beside a harmonic of the vibration; at 200 Hz there are two of 100 Hz."""
    t = np.arange(0, 10, 1 / 450)
    found = combs([Line(100.0, 1.0), Line(71.3, 0.5)], t)
    assert [(round(w / (2 * np.pi)), n) for w, n in found] == [(100, 2), (50, 4)]


def test_comb_keeps_step_with_long_records():
    """The third harmonic of 50.02 Hz, read as 50 Hz, slips by two turns in 37 s."""
    first, rng = 50.019, np.random.default_rng(0)
    signals = []
    for n, sizes in ((13739, (1.0, 0.2, 0.6)), (9001, (0.3, 0.8, 0.1))):
        t = np.arange(n) / 376.0
        hum = sum(a * np.cos(2 * np.pi * k * first * t + k) for k, a in enumerate(sizes, 1))
        signals.append((t, hum + 0.3 * rng.standard_normal(n)))
    found, highest = tuned((2 * np.pi * 50.0, 3), signals)
    assert highest == 3
    # A twentieth of a turn of the third harmonic over the longer record.
    assert found / (2 * np.pi) == pytest.approx(first, abs=1 / (20 * 3 * 36.5))


def test_a_drift_that_is_hidden_in_one_record_is_known_from_another():
    """A slow swing looks like the mean of a vibration; one sensor measured both records."""
    rng = np.random.default_rng(0)
    drifting, quiet = recorded(STD * walk(rng)), recorded(STD * white(rng))
    assert quiet.noise.drift is None
    first, second = sharing_drift([drifting, quiet])
    assert first is drifting
    np.testing.assert_allclose(second.noise.drift.power, drifting.noise.drift.power)
    assert sharing_drift([quiet]) == [quiet]


@pytest.mark.parametrize("kind", [white, low_passed])
def test_noise_of_few_cycles_is_read_off_what_follows_them(kind):
    """Dry friction stops five swings; a smooth motion through so few takes slow noise with it."""
    stopped = np.maximum(1 - F0 * T / 5, 0.0) * np.cos(OMEGA * T)
    noise = 2 * STD * kind(np.random.default_rng(0))
    record = Record.loud(rs.Decay(T, stopped + noise), 1e-6)
    assert record.t[-1] * F0 < 6
    # The level of coloured noise is known to 10 %.
    assert record.noise.std == pytest.approx(np.std(noise), rel=0.1)


def test_a_vibration_that_goes_on_fading_is_no_noise():
    """Below a hundredth of its amplitude it is not looked at, but 40 dB above this noise."""
    fading = np.exp(-3 * T) * np.cos(OMEGA * T)
    record = Record.loud(rs.Decay(T, fading + 1e-4 * STD * white(np.random.default_rng(0))), 1e-9)
    alone = Record.of(record.decay, 1e-9)
    assert record.noise.std == alone.noise.std


# A hum of 5 % that lasts three times as long is the loudest line: it is taken for the vibration.
@pytest.mark.parametrize(
    ("length", "rate", "hum"), [(10.0, 400.0, 0.02), (10.0, 400.0, 0.05), (20.0, 1000.0, 0.02)]
)
def test_a_record_that_a_hum_outlasts_ends_where_its_vibration_does(length, rate, hum):
    """Dry friction stops it after 6 s; a hum goes on, louder than the end of the vibration."""
    t = np.arange(0, length, 1 / rate)
    q = np.maximum(1 - t / 6, 0) * np.cos(2 * np.pi * 4.73 * t)
    q += 3e-3 * np.random.default_rng(0).standard_normal(len(t))
    ends = []
    for x in (q, q + hum * np.sin(2 * np.pi * 50.0 * t)):
        ends.append(Record.loud(rs.Decay(t, x), 1e-3).decay.t[-1])
    assert ends[0] == pytest.approx(6, abs=0.2)  # a cycle: over one the amplitude is taken
    assert ends[1] == pytest.approx(ends[0], abs=0.2)


@pytest.mark.parametrize("lasts", [1.3, 6.0])
@pytest.mark.parametrize("hum", [1.0, 1.4, 2.0, 2.6])
def test_a_hum_about_as_loud_as_the_noise_is_no_vibration(lasts, hum):
    """Dry friction stops 14 Hz in 25 swings; six times as long, most of the power may be hum."""
    t = np.arange(0, 25 / 14 * lasts, 1 / 630)
    q = np.maximum(1 - t * 14 / 25, 0) * np.cos(2 * np.pi * 14 * t)
    for seed in range(5):
        q_noisy = q + 0.008 * np.random.default_rng(seed).standard_normal(len(t))
        q_noisy += 0.008 * hum * np.sqrt(2) * np.sin(2 * np.pi * 50 * t + seed)
        record = Record.loud(rs.Decay(t, q_noisy), 0.0)
        assert record.rate == pytest.approx(2 * np.pi * 14, rel=0.02)  # half a cycle of the end


@pytest.mark.parametrize(("hum", "hertz"), [(0.1, 50.0), (0.1, 5.3), (0.1, 11.0)])
def test_a_hum_that_outlasts_the_vibration_is_not_followed(hum, hertz):
    """11 Hz that fade in seven cycles, and a hum for 30: over all of it the hum is in most cycles.

    One of its own frequency is told by its size alone, and stays in.
    """
    t = np.arange(0, 3, 1 / 900)
    vibration = np.exp(-2 * np.pi * 11 * 0.03 * t) * np.cos(2 * np.pi * 11 * t)
    noise = 0.002 * np.random.default_rng(3).standard_normal(len(t))
    x = vibration + hum * np.sin(2 * np.pi * hertz * t + 1) + noise
    record = Record.loud(rs.Decay(t, x), 0.0)
    rate = np.diff(record.spline.phase([0.0, record.t[-1]]))[0] / record.t[-1]
    assert rate == pytest.approx(2 * np.pi * 11, rel=0.03)
    assert (record.t[-1] < 1.3) == (hertz != 11)
