"""Each defect put on a known decay is named, with its channel and time, and mended."""

import numpy as np
import pytest
from oracles import falling_decay, viscous_decay

from romsindy.record.decay import Decay
from romsindy.record.defects import clean
from romsindy.record.faults import dropouts, restored, spikes
from romsindy.record.recording import Recording, lost_samples
from romsindy.record.spectrum import NoiseLevel

T = np.arange(8000) * 0.004  # 32 s at 250 Hz
F, ZETA, NOISE = 3.1, 0.006, 0.005
PURE = viscous_decay(T, 2 * np.pi * F, ZETA)
X = PURE + NOISE * np.random.default_rng(0).standard_normal(len(T))


def cleaned(x, t=T, **others):
    recording, found = clean(Recording(t, x, source="test.csv", **others))
    return recording, {defect.kind: defect for defect in found}


def test_nothing_is_found_where_nothing_is_wrong():
    recording, found = cleaned(X)
    assert not found
    np.testing.assert_array_equal(recording.x[:, 0], X)
    np.testing.assert_array_equal(cleaned(PURE)[0].x[:, 0], PURE)


def test_a_channel_and_its_time_are_named():
    x = X.copy()
    x[2000:2250] = 0.0
    recording, found = cleaned(np.stack([X, x], 1), names=("tip", "root"), unit="m")
    defect = found["dropout"]
    assert (defect.channel, defect.start, defect.end) == ("root", T[2000], T[2249])
    assert defect.message == (
        "test.csv, channel root, from 8 to 8.996 s: the sensor stands still at 0 m while the"
        " motion goes on: left out; start after it at 9 s"
    )
    assert defect.argument == "start=9"
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(recording.x[:, 1])), np.arange(2000, 2250)
    )
    assert np.all(np.isfinite(recording.x[:, 0]))


@pytest.mark.parametrize("size", [-3.0, 10.0])
@pytest.mark.parametrize("width", [1, 3])
def test_spikes_are_bridged(size, width):
    """What replaces them is as far from the truth as noise would be."""
    x = X.copy()
    places = [700, 2105, 5200]
    for place in places:
        x[place : place + width] += size
    recording, found = cleaned(x)
    assert [*found] == ["spikes"]
    assert spikes(x).sum() == width * len(places)
    assert np.abs(recording.x[:, 0] - PURE).max() < 5 * NOISE
    unchanged = ~spikes(x)
    np.testing.assert_array_equal(recording.x[unchanged, 0], X[unchanged])


def test_a_blow_is_no_spike():
    """Before it nothing moves, and the motion after it is there to stay."""
    blow = 30 * np.exp(-(((T - 4) / 0.004) ** 2))
    ringing = np.where(T > 4, viscous_decay(T - 4, 2 * np.pi * F, ZETA), 0.0)
    x = blow + ringing + NOISE * np.random.default_rng(1).standard_normal(len(T))
    assert not spikes(x).any()


@pytest.mark.parametrize(("limit", "error"), [(0.99, 0.02), (0.8, 0.03), (0.6, 0.1)])
def test_clipped_peaks(limit, error):
    """Up to a quarter of a cycle is restored; the truth is known, and the noise is 0.005."""
    recording, found = cleaned(np.clip(X, -limit, limit))
    assert [*found] == ["clipping"] and abs(found["clipping"].size) == limit
    x = recording.x[:, 0]
    known = np.isfinite(x)
    assert not known[0]  # it is released beyond the limit
    np.testing.assert_allclose(x[known], PURE[known], atol=error)
    beyond = known & (np.abs(PURE) > limit + 3 * NOISE)
    assert not beyond.any() or np.abs(x[beyond]).max() > limit


def test_flat_tops_that_are_none():
    """A hold before the release, and the steps of an encoder."""
    held = np.where(T < 3, 1.0, viscous_decay(T - 3, 2 * np.pi * F, ZETA))
    assert not cleaned(held)[1]
    _, found = cleaned(0.01 * np.round(PURE / 0.01))
    assert [*found] == ["quantisation"] and found["quantisation"].size == pytest.approx(0.01)


def test_zeros_before_and_rest_after_are_no_dropout():
    x = np.where(T < 5, 0.0, np.sin(2 * np.pi * F * (T - 5)) * np.exp(-0.5 * (T - 5)))
    assert not dropouts(x, 1 / (F * 0.004)).any()
    stuck = np.where(T < 20, X, X[5000])
    assert dropouts(stuck, 1 / (F * 0.004))[5000:].sum() in (0, 3000)


@pytest.mark.parametrize("size", [0.1, 1.0])
@pytest.mark.parametrize(
    "shape", [np.sin(0.3 * T + 1), T / T[-1], np.exp(-T / 10)], ids=["sine", "ramp", "exponential"]
)
def test_drift(size, shape):
    """What is left is small beside the vibration, wherever this is above three times the noise."""
    recording, found = cleaned(X + size * shape)
    assert {"drift"} <= {*found} <= {"drift", "offset"}
    envelope = np.exp(-ZETA * 2 * np.pi * F * T)
    left = (np.abs(recording.x[:, 0] - X) / envelope)[envelope > 3 * NOISE]
    assert left.max() < 0.2 and np.median(left) < 0.05


def test_a_drift_that_fades_with_the_vibration_is_its_own():
    """What goes as amplitude^2 is taken for the midline of the vibration, up to a quarter of it."""
    own = np.exp(-2 * ZETA * 2 * np.pi * F * T)
    assert not cleaned(X + 0.2 * own)[1]
    assert "drift" in cleaned(X + 0.6 * own)[1]


@pytest.mark.parametrize("size", [0.1, -1.0])
def test_steps_of_the_level(size):
    """The noise of 24 samples is left of the size, and the level before or after it is removed."""
    x = X.copy()
    x[3333:] += size
    recording, found = cleaned(x)
    assert {"step"} <= {*found} <= {"step", "offset", "drift"}
    assert found["step"].start == T[3333]
    assert found["step"].size == pytest.approx(size, abs=0.02)
    assert np.abs(recording.x[:, 0] - X).max() < 0.03


def test_offset_of_a_thousand():
    recording, found = cleaned(X + 1000.0)
    assert [*found] == ["offset"] and found["offset"].size == pytest.approx(1000, abs=0.01)
    np.testing.assert_allclose(recording.x[:, 0], X, atol=0.01)


def test_the_midline_of_an_asymmetric_vibration_stays():
    """It moves by a fifth of the amplitude, but fades with its square."""
    x, _, _ = falling_decay(T, 3.0, 0.2)
    x = x + 0.002 * np.random.default_rng(2).standard_normal(len(T))
    recording, found = cleaned(x)
    assert not found
    np.testing.assert_array_equal(recording.x[:, 0], x)


@pytest.mark.parametrize("size", [0.01, 0.3])
@pytest.mark.parametrize("mains", [50.03, 59.98])
def test_hum_and_its_harmonics(mains, size):
    hum = size * np.cos(2 * np.pi * mains * T + 1) + size / 3 * np.cos(4 * np.pi * mains * T)
    recording, found = cleaned(X + hum)
    assert [*found] == ["mains"]
    # 8000 samples tell an amplitude to noise * sqrt(2 / 8000); the tail alone to a few times that.
    assert np.std(recording.x[:, 0] - X) < 0.1 * NOISE


@pytest.mark.parametrize("frequency", [50.0, 51.0])
def test_a_mode_near_the_mains_is_no_hum(frequency):
    mode = 0.3 * viscous_decay(T, 2 * np.pi * frequency, 0.0005)
    recording, found = cleaned(X + mode)
    assert not found
    np.testing.assert_array_equal(recording.x[:, 0], X + mode)


def ring(t):
    return viscous_decay(t, 2 * np.pi * F, ZETA)


@pytest.mark.parametrize("size", [0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("shape", ["standard_normal", "uniform"])
def test_jitter_is_no_gap(size, shape):
    """Times about an even grid, in their order; samples are those of the times, in closed form."""
    rng, k = np.random.default_rng(2), np.arange(3000)
    t = 0.01 * np.sort(k + size * getattr(rng, shape)(size=len(k)))
    whole, found = clean(Recording(t, ring(t)))
    assert {defect.kind for defect in found} == {"jitter"}
    assert len(whole.pieces) == 1 and whole.dt == pytest.approx(0.01, rel=1e-3)
    assert np.std(whole.x[:, 0] - ring(whole.t)) < 1e-3
    # Where samples are missing as well, they are counted and found to a few.
    k = k + (k >= 1000) + 5 * (k >= 2000)
    t = 0.01 * (k + size * rng.uniform(-0.9, 0.9, len(k)))
    lost = lost_samples(t)
    assert lost.sum() == 6 and np.abs(np.flatnonzero(lost) - [999, 1999]).max() < 4


@pytest.mark.parametrize(("rate", "digits"), [(300, 3), (640, 3), (700, 3), (999, 3), (2048, 4)])
def test_times_of_few_digits_are_an_even_grid(rate, digits):
    """The rate was that of the commonest step: 333 Hz of 300, 500 Hz of 640; 999 Hz had gaps."""
    t = np.arange(6000) / rate
    recording = Recording(np.round(t, digits), ring(t))
    assert recording.dt == pytest.approx(1 / rate, rel=2e-4)
    whole, found = clean(recording)
    assert not {defect.kind for defect in found} & {"jitter", "missing", "gap"}
    assert len(whole.pieces) == 1 and whole.dt == pytest.approx(1 / rate, rel=2e-4)
    assert len(Decay(np.round(t, digits), ring(t)).notes) == 0
    # One sample that is missing is seen, but beside steps that rounding made twice as long.
    lost = lost_samples(np.round(np.delete(t, 2500), digits))
    assert rate == 999 or list(np.flatnonzero(lost)) == [2499]


def test_gaps_and_jitter():
    """Samples that are left out are interpolated, or split the record; shaken ones move back."""
    rng = np.random.default_rng(3)
    kept = np.ones(len(T), bool)
    kept[[100, 101, 3000]] = False
    kept[4000:4500] = False
    t = T + 0.1 * 0.004 * rng.uniform(-1, 1, len(T))
    x = viscous_decay(t, 2 * np.pi * F, ZETA)
    recording, found = clean(Recording(t[kept], x[kept]))
    kinds = [defect.kind for defect in found]
    assert kinds.count("gap") == 1 and kinds.count("jitter") == 2 and kinds.count("missing") == 2
    gap = next(defect for defect in found if defect.kind == "gap")
    assert gap.size == pytest.approx(501 * 0.004, abs=0.001)
    assert len(recording.pieces) == 2
    for piece in recording.pieces:
        own = recording.t[piece]
        np.testing.assert_allclose(np.diff(own), own[1] - own[0], rtol=1e-6)
    exact = viscous_decay(recording.t, 2 * np.pi * F, ZETA)
    # A cubic spline through 80 samples a cycle is good to (2 pi / 80)^4 / 100, bridges to more.
    np.testing.assert_allclose(recording.x[:, 0], exact, atol=1e-4)


def test_missing_samples_to_a_quarter_of_a_cycle():
    """80 samples a cycle: 16 are interpolated, 30 are not."""
    x = X.copy()
    x[1000:1016] = x[3000:3030] = np.nan
    x[5000] = np.inf
    recording, found = clean(Recording(T, x))
    assert [defect.kind for defect in found] == ["missing"] * 3
    assert [defect.argument for defect in found] == ["", "start=12.12", ""]
    np.testing.assert_allclose(recording.x[1000:1016, 0], PURE[1000:1016], atol=5 * NOISE)
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(recording.x[:, 0])), np.arange(3000, 3030)
    )


def test_interpolation_of_two_modes_without_noise():
    """A sum of decaying tones obeys a linear recurrence, which bridges it exactly."""
    x = PURE + 0.4 * viscous_decay(T, 2 * np.pi * 20.3, 0.001)
    holed = x.copy()
    holed[[500, 501, 502, 900, 2500]] = np.nan
    np.testing.assert_allclose(restored(holed, 1 / (20.3 * 0.004)), x, atol=1e-6)


@pytest.mark.parametrize("colour", [0, 1])
def test_noise_and_its_colour(colour):
    """Of power 1/f^colour, beside a decay; rms within a quarter, slope within 0.3."""
    spectrum = np.fft.rfft(np.random.default_rng(4).standard_normal(len(T)))
    noise = np.fft.irfft(spectrum / np.maximum(np.arange(len(spectrum)), 1) ** (colour / 2))
    noise *= 0.03 / noise.std()
    level = NoiseLevel.of(PURE + noise, 0.004)
    assert level.slope == pytest.approx(-colour, abs=0.3)
    # The slowest of pink noise counts as drift.
    assert level.rms == pytest.approx(0.03, rel=0.1 if colour == 0 else 0.4)
    assert level.coloured == (colour == 1)
    assert ("coloured noise" in cleaned(PURE + noise)[1]) == (colour == 1)


def test_hum_that_the_vibration_hides_is_told():
    """A third of a hertz from it for six seconds: its harmonics are subtracted, itself it stays."""
    t = np.arange(6000) * 0.001
    x = viscous_decay(t, 2 * np.pi * 50.3, 0.003)
    x += 0.002 * np.random.default_rng(5).standard_normal(len(t))
    hum = sum(0.02 * np.cos(2 * np.pi * 50 * order * t + order) for order in (1, 2, 3))
    _, found = clean(Recording(t, x + hum))
    assert sorted(round(d.size, 3) for d in found) == [0.0, 0.02, 0.02]
    assert {d.kind for d in found} == {"mains"}
    assert any("hum at 50 Hz itself is too near to the vibration" in str(d) for d in found)


def test_several_defects_at_once():
    x = X + 50 + 0.3 * np.sin(0.3 * T) + 0.1 * np.cos(2 * np.pi * 50 * T + 2)
    x[3333] -= 4
    recording, found = cleaned(x)
    assert {*found} == {"offset", "drift", "mains", "spikes"}
    loud = slice(100, 4500)  # where the vibration stands out
    assert np.std(recording.x[loud, 0] - X[loud]) < 0.02


def test_channels_that_do_not_vibrate_are_told():
    x = np.stack([X, np.full(len(T), 2.0), np.full(len(T), np.nan)], 1)
    recording, found = clean(Recording(T, x, names=("a", "b", "c")))
    assert [(d.kind, d.channel) for d in found] == [("nothing vibrates", "b"), ("missing", "c")]
    np.testing.assert_array_equal(recording.x[:, 0], X)


@pytest.mark.parametrize("first", range(0, 200, 50))
def test_damaged_records_end_in_words(first):
    """Whatever is in a recording, it is cleaned without a warning, and all numbers are finite."""
    for seed in range(first, first + 50):
        rng = np.random.default_rng(seed)
        n = int(10 ** rng.uniform(1, 3.2))
        wave = np.cos(10 ** rng.uniform(-2, 0.4) * np.arange(n))
        x = wave * np.exp(-np.arange(n) / n * rng.uniform(0, 8)) * 10.0 ** rng.integers(-9, 9)
        for _ in range(rng.integers(1, 4)):
            a, b = np.sort(rng.integers(0, n, 2))
            x = DAMAGES[rng.integers(len(DAMAGES))](x.copy(), a, b, rng)
        recording, found = clean(Recording(np.arange(n) * 10 ** rng.uniform(-6, 2), x))
        assert not np.isinf(recording.x).any()
        assert all(np.isfinite([d.start, d.end, d.size]).all() for d in found), seed


def put(x, where, value):
    x[where] = value
    return x


DAMAGES = [
    lambda x, a, b, rng: put(x, slice(a, b), 0.0),
    lambda x, a, b, rng: put(x, slice(a, b), np.nan),
    lambda x, a, b, rng: put(x, a, np.inf),
    lambda x, a, b, rng: put(x, slice(None), x[0]),
    lambda x, a, b, rng: put(x, a, 100 * x[a]),
    lambda x, a, b, rng: np.clip(x, -0.5 * np.abs(x[a]), None),
    lambda x, a, b, rng: x + 1000 * x[a],
    lambda x, a, b, rng: np.cumsum(x),
    lambda x, a, b, rng: x + x[a] * rng.standard_normal(len(x)),
]


def test_measured_records_raise_no_false_alarm(measured):
    """What is left is true: jittering stamps, encoder steps, an offset, hum and a slow sensor."""
    expected = {"jitter", "quantisation", "offset", "drift", "mains"}
    seen = {}
    for name, t, x in measured_channels(measured):
        recording, found = clean(Recording(t, x, source=name))
        assert np.all(np.isfinite(recording.x)), name
        seen[name] = {d.kind for d in found} & {*expected}
        assert {d.kind for d in found} <= expected, [str(d) for d in found]
    assert seen["mode1b"] == seen["acc1"] == set()
    assert seen["release_45deg_theta"] == {"quantisation"}
    assert seen["test_21338_0kn"] == {"jitter"}
    assert seen["acc[0]"] == {"offset"}


def measured_channels(folder):
    with np.load(folder / "cc_beam_bristol.npz") as data:
        for name in ("mode1a", "mode1b", "mode2", "mode3"):
            yield name, data[f"{name}_t"], data[f"{name}_v"]
    with np.load(folder / "kvlcc2_roll_decay.npz") as data:
        for name in ("test_21337_0kn", "test_21338_0kn"):
            yield name, data[f"{name}_t"], data[f"{name}_phi"]
    with np.load(folder / "pendulum_free_swing.npz") as data:
        for angle in (45, 90, 135):
            x = data[f"release_{angle}deg_theta_deg"]
            yield f"release_{angle}deg_theta", np.arange(len(x)) / data["fs"], x
    with np.load(folder / "double_beam_train.npz") as data:
        for run, x in zip(data["run"], data["v"].T, strict=True):
            yield f"run {run}", data["t"], x
    with np.load(folder / "brake_reuss_hammer.npz") as data:
        for name in ("acc1", "acc2", "acc3"):
            yield name, data["t"], data[name]
    with np.load(folder / "cantilever_steel_accelerometers.npz") as data:
        for i, x in enumerate(data["acc"].T):
            yield f"acc[{i}]", data["t"], x


def test_rail_with_noise_behind_it():
    """Two samples above the rail of a converter do not hide that it clips there."""
    t = np.arange(0, 10, 0.002)
    x = np.clip(1.5 * np.exp(-0.2 * t) * np.cos(2 * np.pi * 4 * t), -1, 1)
    top = np.flatnonzero(x == 1)
    x[top[[3, 40]]] += 0.002
    _, defects = clean(Recording(t, x))
    (clipping,) = [d for d in defects if d.kind == "clipping"]
    assert clipping.start < 0.02 and f"({np.sum(np.abs(x) >= 1)} samples)" in clipping.message


def test_structure_that_is_held_anew_is_no_drift():
    """Let go from 12, and 28 s later pulled to 7 within a second, held, and let go again."""
    t = np.arange(0, 56, 0.005)

    def swing(start, size):
        s = np.clip(t - start, 0, None)
        return size * np.exp(-0.1 * s) * np.cos(2 * np.pi * 1.6 * s)

    pull = 7 * np.clip(t - 28.5, 0, 1)
    x = np.where(t < 28.5, swing(0, 12), np.where(t < 31, pull, swing(31, 7)))
    x += 0.01 * np.random.default_rng(1).standard_normal(len(t))
    cleaned, defects = clean(Recording(t, x))
    assert not {d.kind for d in defects} & {"drift", "step"}
    assert np.abs(cleaned.x[:, 0] - x).max() < 0.1


@pytest.mark.parametrize("reach", [0.011, 0.023])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_rest_where_friction_holds_it_is_no_level(reach, seed):
    """Half cycles about +-reach in turn, in closed form, until friction holds it off the middle."""
    period = 1.0
    t = np.arange(0, 30, 0.02)
    half = np.floor(2 * t / period)
    start = 1.0 + 0.37 * reach * seed
    swings = np.arange(half[-1] + 1)
    at = np.maximum(start - 2 * reach * swings, 0)  # |x| where each swing begins
    held = int(np.argmax(at <= reach))
    k = np.minimum(half, held).astype(int)
    sign = (-1.0) ** k
    x = sign * np.where(
        half < held, reach + (at[k] - reach) * np.cos(np.pi * (2 * t / period - half)), at[held]
    )
    noise = 0.004 * np.random.default_rng(seed).standard_normal(len(t))
    assert not {d.kind for d in clean(Recording(t, x + noise))[1]} & {"drift", "offset", "step"}
