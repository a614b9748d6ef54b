import numpy as np
import pytest
from oracles import falling_decay, viscous_decay
from scipy.signal import lfilter

from romsindy.record.decay import Decay
from romsindy.record.defects import level_and_drift
from romsindy.record.prediction import autoregression, predictor
from romsindy.record.signals import (
    crossings,
    fundamental_frequency,
    lowpass,
    rest_level,
    upsample,
    vertex,
)
from romsindy.record.smoothing import integrate
from romsindy.record.spectrum import noise_std, steady_wave

DT = 0.01
T = np.arange(4000) * DT


def free_part(x, dt):
    """Samples [start, end) of the free decay, and the offset that was removed from it."""
    free = Decay(np.arange(len(x)) * dt, x).free()
    start, end = round(free.t[0] / dt), round(free.t[-1] / dt) + 1
    return start, end, float(np.mean(x[start:end] - free.q))


def test_fundamental_of_a_decay():
    q = viscous_decay(T, 2 * np.pi * 1.3, 0.01)
    assert fundamental_frequency(q, DT) == pytest.approx(1.3, abs=1 / T[-1])  # one line


@pytest.mark.parametrize("sigma", [0.0, 1e-3])
@pytest.mark.parametrize("rate", [0.3, 1.0, 3.0])
def test_fundamental_of_a_falling_frequency(rate, sigma):
    """Over its broad line the few lines of the shifting centre stand out; a long tail is quiet."""
    q, _, _ = falling_decay(T, rate=rate)
    noise = np.random.default_rng(6).normal(0, sigma, len(T)) if sigma else 0.0
    # quiet cycles, all of nearly one frequency, make the highest line; 0.1 Hz apart in 10 s
    assert fundamental_frequency(q + noise, DT) == pytest.approx(5.0, abs=0.15)


@pytest.mark.parametrize("sigma", [0.0, 1.0])
def test_drift_above_the_vibration_is_refused(sigma):
    """Of rms 0.7, five times that of the vibration; noise of rms 1 is no vibration either."""
    q, _, _ = falling_decay(T)
    drift = 1 - np.cos(2 * np.pi * T / T[-1])
    noise = np.random.default_rng(7).normal(0, sigma, len(T)) if sigma else 0.0
    with pytest.raises(
        ValueError, match=r"record of 4000 samples .* drifts by more than it vibrates"
    ):
        fundamental_frequency(q + drift + noise, DT)


@pytest.mark.parametrize("sigma", [1e-3, 0.05])
def test_noise_is_found_under_a_decay(sigma):
    q = viscous_decay(T, 2 * np.pi * 1.3, 0.01)
    noise = np.random.default_rng(1).normal(0, sigma, len(T))
    # The median of a chi-square spectrum of a few segments is a few per cent off.
    assert noise_std(q + noise) == pytest.approx(sigma, rel=0.15)
    assert noise_std(q) < 1e-4


@pytest.mark.parametrize("n", [300, 1250, 1600, 5001])
def test_noise_is_not_underestimated_in_short_records(n):
    """Mean over 300 records: its own error is below 0.6 %."""
    rng = np.random.default_rng(0)
    found = np.mean([noise_std(rng.standard_normal(n)) for _ in range(300)])
    assert found == pytest.approx(1.0, abs=0.015)


def test_lowpass_has_no_phase_and_the_butterworth_gain():
    """Forward and backward: gain 1 / (1 + (f/fc)^8), no shift."""
    f, cutoff, t = 2.0, 4.0, np.arange(20000) * 1e-3
    x = np.sin(2 * np.pi * f * t)
    inside = slice(5000, 15000)
    gain = 1 / (1 + (f / cutoff) ** 8)
    # The bilinear transform moves frequencies by (pi f dt)^2/3.
    np.testing.assert_allclose(lowpass(x, 1e-3, cutoff)[inside], gain * x[inside], atol=1e-5)


def test_crossings_come_once_a_cycle_in_noise():
    clean = viscous_decay(T, 2 * np.pi * 1.3, 0.005)
    noisy = clean + np.random.default_rng(2).normal(0, 0.05, len(T))
    up, down = crossings(noisy, DT)
    assert len(up) == np.count_nonzero((clean[:-1] < 0) & (clean[1:] >= 0))
    assert len(down) >= len(up) - 1
    assert np.all(down[: len(up) - 1] > up[:-1]) and np.all(down[: len(up) - 1] < up[1:])
    exact = (np.arange(len(up)) + 0.75) / (1.3 * np.sqrt(1 - 0.005**2))
    assert np.abs(T[up] - exact).max() < 0.05 / 1.3  # a twentieth of a cycle


@pytest.mark.parametrize("cycles", [3.0, 3.3, 3.6, 4.5])
@pytest.mark.parametrize("phase", [0.0, 1.3])
@pytest.mark.parametrize("level", [0.0, 0.2])
def test_a_few_cycles_rest_where_they_do(cycles, phase, level):
    """A release from 1 at 0.1 Hz: a moving mean of such a record is 10 % off."""
    t = np.arange(0, 10 * cycles, 0.25)
    noise = 0.003 * np.random.default_rng(7).standard_normal(len(t))
    x = np.exp(-0.02 * t) * np.cos(0.2 * np.pi * t + phase) + noise
    both = rest_level(x + level, 0.25), level_and_drift(x + level, 40)[0]
    # Three standard errors of a mean are 0.001; of the turning points, ten in a cycle, 0.01.
    np.testing.assert_allclose(both, level, atol=0.012)
    up, down = crossings(x, 0.25)
    assert len(up) >= 3 and np.all(np.diff(np.sort(np.concatenate([up, down]))) > 10)


def test_integral_of_a_noisy_biased_velocity_has_no_drift():
    """Exact velocity of a linear oscillator, clean and with offset and noise."""
    rng = np.random.default_rng(3)
    omega, zeta = 2 * np.pi * 2, 0.01
    q = viscous_decay(T, omega, zeta)
    damped = omega * np.sqrt(1 - zeta**2)
    v = -(omega**2) / damped * np.exp(-zeta * omega * T) * np.sin(damped * T)
    # Three turning points leave (decrement/2)^2/4 of the amplitude, 2.5e-4.
    np.testing.assert_allclose(integrate(v, DT, 2.0)[100:-100], q[100:-100], atol=5e-4)
    noisy = integrate(v + 0.3 + rng.normal(0, 0.05, len(T)), DT, 2.0)
    # A random walk of 0.05 sqrt(dt) over a couple of cycles is about 0.005.
    assert np.sqrt(np.mean((noisy - q)[100:-100] ** 2)) < 0.01


def test_upsampling_is_exact_for_a_band_limited_signal():
    x = np.cos(2 * np.pi * 0.36 * np.arange(400) + 0.3)  # 2.8 samples a cycle
    fine = upsample(x, 8)
    exact = np.cos(2 * np.pi * 0.36 * np.arange(len(fine)) / 8 + 0.3)
    assert len(fine) == 8 * 399 + 1
    # The window of the interpolation reaches -60 dB; ends are continued by reflection.
    np.testing.assert_allclose(fine[200:-200], exact[200:-200], atol=5e-3)


def test_free_part_leaves_out_hold_and_noise():
    rng = np.random.default_rng(4)
    hold = np.ones(1500)
    swing = viscous_decay(np.arange(8000) * DT, 2 * np.pi, 0.03)
    x = np.concatenate([hold, swing]) + rng.normal(0, 0.01, 9500)
    start, end, rest = free_part(x, DT)
    assert rest == 0.0
    assert 1400 < start < 1525
    # exp(-zeta omega t) = 3 noise at t = 18.6 s
    assert 1500 + 1700 < end < 1500 + 2100


def test_free_part_of_a_free_record_is_all_of_it():
    x = viscous_decay(T, 2 * np.pi, 0.005)
    assert free_part(x, DT) == (0, len(x), 0.0)
    steady = np.sin(2 * np.pi * T + 0.4)  # an undamped motion is free, too
    assert free_part(steady, DT) == (0, len(steady), 0.0)


@pytest.mark.parametrize("sigma", [0.0, 0.01])
@pytest.mark.parametrize("offset", [0.3, -2.0])
def test_rest_level_of_an_offset_record(offset, sigma):
    q = viscous_decay(T, 2 * np.pi, 0.005)
    noise = np.random.default_rng(5).normal(0, sigma, len(T)) if sigma else 0.0
    # Three turning points leave (decrement/2)^2/4 of the amplitude; noise averages over 40.
    assert rest_level(q + offset + noise, DT) == pytest.approx(offset, abs=1e-3 + sigma / 3)


def test_asymmetric_vibration_rests_at_zero():
    """Its mean lies beside 0, by an amount that goes with amplitude^2: that is no offset."""
    q = viscous_decay(T, 2 * np.pi, 0.005)
    assert rest_level(q - 0.15 * np.exp(-0.01 * 2 * np.pi * T), DT) == 0.0


def test_a_hum_that_goes_on_is_told_and_removed():
    """Of the decay some per cent of the hum are left where its last half begins: so near is it."""
    rng = np.random.default_rng(4)
    decay, hum = viscous_decay(T, 2 * np.pi * 5, 0.01), 0.02 * np.cos(2 * np.pi * 5.1 * T + 0.4)
    noise = rng.normal(0, 0.003, len(T))
    wave = steady_wave(decay + hum + noise, DT)
    assert wave.frequency == pytest.approx(5.1, abs=1e-3)
    assert wave.size == pytest.approx(0.02 * np.exp(0.4j), rel=0.1)
    free = Decay(T, decay + hum + noise, unit="m").free()
    expected = (decay + noise)[: len(free.q)]
    np.testing.assert_allclose(free.q, expected, atol=3e-3)  # of 20e-3
    assert any("removed" in note for note in free.notes)


@pytest.mark.parametrize("seed", range(8))
def test_a_hum_that_goes_on_is_told_in_noise_that_is_nearly_as_loud(seed):
    """By chance its quarters differ then by some per cent of it."""
    noise = np.random.default_rng(seed).normal(0, 0.004, len(T))
    decay, hum = viscous_decay(T, 2 * np.pi * 5, 0.01), 0.01 * np.cos(2 * np.pi * 13 * T)
    wave = steady_wave(decay + hum + noise, DT)
    assert wave is not None and wave.frequency == pytest.approx(13, abs=2e-3)


def test_what_decays_or_is_moved_by_noise_is_no_hum():
    rng = np.random.default_rng(5)
    decay = viscous_decay(T, 2 * np.pi * 5, 0.01)
    assert steady_wave(viscous_decay(T, 2 * np.pi * 5, 0.002), DT) is None
    assert steady_wave(decay + rng.normal(0, 0.01, 4000), DT) is None
    for _ in range(20):  # an oscillator that white noise moves, in its damping time of 6 s
        pole = np.exp((-0.16 + 10j * np.pi) * DT)
        moved = lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], rng.standard_normal(4000))
        moved *= 0.03 / np.std(moved)
        assert steady_wave(decay + moved, DT) is None


def test_records_that_cannot_be_used_are_refused():
    with pytest.raises(ValueError, match="constant"):
        fundamental_frequency(np.ones(100), DT)
    with pytest.raises(ValueError, match="fewer than three cycles"):
        fundamental_frequency(np.sin(2 * np.pi * np.linspace(0, 2, 400)), DT)
    growing = viscous_decay(T, 2 * np.pi, 0.01)[::-1]
    with pytest.raises(ValueError, match="grows, so it is forced"):
        free_part(growing, DT)
    slowly = (1 + 0.002 * T) * np.sin(2 * np.pi * T)
    with pytest.raises(ValueError, match="amplitude grows by 8%"):
        free_part(slowly, DT)


@pytest.mark.parametrize("top", [-0.5, -0.2, 0.0, 0.45])
def test_vertex_of_a_parabola(top):
    """Exact for a parabola; 0 where there is no top."""
    three = [7.0 - 3.0 * (k - top) ** 2 for k in (-1, 0, 1)]
    assert vertex(*three) == pytest.approx(top, abs=1e-14)
    assert vertex(0.0, -1.0, 0.0) == vertex(0.0, 1.0, 2.0) == 0.0


def test_two_autoregressions():
    """Least squares goes on with a tone as it is, 2 cos(w) x - y; Yule-Walker equations damp it."""
    w, x = 0.3, np.cos(0.3 * np.arange(200))
    exact = np.array([1.0, -2 * np.cos(w), 1.0])
    np.testing.assert_allclose(predictor(x, 2), exact, atol=1e-12)
    apart = np.array([1.0, -2 * np.cos(3 * w), 1.0])
    np.testing.assert_allclose(predictor(x, 2, stride=3), apart, atol=1e-12)
    assert np.all(np.abs(np.roots(autoregression(x, 2))) < 1 - 1e-3)
    # The order of a process is found: x_t = 0.9 x_(t-1) - 0.5 x_(t-2) + noise.
    driven = lfilter([1.0], [1.0, -0.9, 0.5], np.random.default_rng(1).standard_normal(20_000))
    np.testing.assert_allclose(autoregression(driven), [1.0, -0.9, 0.5], atol=0.02)
