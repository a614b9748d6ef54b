import numpy as np
import pytest
from oracles import duffing_frequency, falling_decay, viscous_decay

from romsindy import Decay, ReducedModel, example_decay, extract_backbone, inspect
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.record.recording import Recording


def bare(decay):
    return Decay(decay.t, decay.q, unit=decay.unit)


def test_linear_oscillator_exactly():
    """Damped frequency and damping ratio of a viscous oscillator are known at every cycle."""
    t = np.arange(6000) * 0.005
    b = extract_backbone(Decay(t, viscous_decay(t, 2 * np.pi * 2, 0.01, 0.3), unit="m"))
    np.testing.assert_allclose(b.frequency, 2 * np.pi * 2 * np.sqrt(1 - 1e-4), rtol=1e-6)
    np.testing.assert_allclose(b.damping_ratio, 0.01, rtol=1e-4)
    # The envelope at mid-cycle; peaks lie on it but for the phase of the damping, 5e-5.
    envelope = 0.3 * np.exp(-0.01 * 2 * np.pi * 2 * b.t)
    np.testing.assert_allclose(b.amplitude, envelope, rtol=1e-3)
    np.testing.assert_allclose(-b.negative_peak, b.positive_peak, rtol=1e-3)


def test_nonlinear_decay_follows_the_exact_backbone(clean):
    """Clean: 2e-4 asked; the damped frequency is lower than the undamped one by zeta^2/2."""
    b = extract_backbone(bare(clean))
    exact = EXAMPLE_MODEL.backbone(b.amplitude)
    np.testing.assert_allclose(b.frequency, exact, rtol=5e-5)
    zeta = EXAMPLE_MODEL.damping_ratio(b.amplitude)
    np.testing.assert_allclose(b.damping_ratio, zeta, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_noise_of_35_db(seed):
    b = extract_backbone(example_decay(35.0, seed))
    inside = (b.amplitude > 0.05) & (b.amplitude < 1.7)
    error = (b.frequency / EXAMPLE_MODEL.backbone(b.amplitude) - 1)[inside]
    assert np.median(np.abs(error)) < 1e-3
    # Standard errors hold: the pull is about one (local polynomials are slightly biased).
    pull = error / (b.frequency_std / b.frequency)[inside]
    assert 0.7 < np.sqrt(np.median(pull**2) / 0.455) < 1.6
    truth = extract_backbone(bare(example_decay()))
    for name in ("amplitude", "damping_ratio"):
        exact = np.interp(b.t, truth.t, getattr(truth, name))
        pull = ((getattr(b, name) - exact) / getattr(b, f"{name}_std"))[inside]
        assert 0.6 < np.sqrt(np.median(pull**2) / 0.455) < 1.7, name


@pytest.mark.parametrize(
    "colour", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)]
)
def test_standard_errors_hold_in_coloured_noise(colour):
    """Of power 1/f^colour at 30 dB, on a linear decay, whose frequency and damping are known.

    About 95 % of the cycles should lie within two standard errors. Cycles are correlated, so that
    a few records are worth some dozens of cycles: 0.85 is four standard errors less.
    """
    rng, omega, zeta = np.random.default_rng(6), 2 * np.pi * 5, 0.004
    t = np.arange(6000) * 0.003
    pure = viscous_decay(t, omega, zeta)
    inside, wider = [], []
    for _ in range(6):
        spectrum = np.fft.rfft(rng.standard_normal(len(t)))
        noise = np.fft.irfft(spectrum / np.maximum(np.arange(len(spectrum)), 1) ** (colour / 2))
        noise *= 10 ** (-30 / 20) * pure.std() / noise.std()
        b = extract_backbone(Decay(t, pure + noise, unit="m"))
        inside.append(
            [
                np.abs(b.frequency - omega * np.sqrt(1 - zeta**2)) < 2 * b.frequency_std,
                np.abs(b.damping_ratio - zeta) < 2 * b.damping_ratio_std,
            ]
        )
        wider.append(np.median(b.damping_ratio_std))
    share = np.concatenate(inside, axis=1).mean(axis=1)
    assert np.all(share > 0.85), share
    if colour == 0:  # those of the local fits alone, which know white noise
        assert np.median(wider) < 1.1 * 1.56e-4


@pytest.mark.parametrize(
    "derivative", [pytest.param(1, marks=pytest.mark.slow), 2], ids=["velocity", "acceleration"]
)
def test_standard_errors_hold_of_what_a_recording_shows(derivative):
    """White noise of a sensor at 30 dB, which is filtered and integrated with the vibration.

    A pole p: the k-th derivative of exp(p t) is p^k exp(p t). Of twelve records, as above.
    """
    rng, omega, zeta = np.random.default_rng(11), 2 * np.pi * 20, 0.004
    t, rate = np.arange(0, 5, 1 / 600), omega * np.sqrt(1 - zeta**2)
    pole = complex(-zeta * omega, rate)
    pure, inside = np.real(pole**derivative * np.exp(pole * t + 1j)), []
    for _ in range(12):
        noisy = pure + 10 ** (-30 / 20) * pure.std() * rng.standard_normal(len(t))
        quantity = ("displacement", "velocity", "acceleration")[derivative]
        (decay,) = inspect(Recording(t, noisy, quantity=quantity, unit="m")).decays()
        b = extract_backbone(decay)
        loud = np.exp(-zeta * omega * b.t) > 3 * 10 ** (-30 / 20) * pure.std() / omega**derivative
        off = (b.frequency - rate) / b.frequency_std, (b.damping_ratio - zeta) / b.damping_ratio_std
        inside.append(np.abs(np.array(off)[:, loud]) < 2)
    share = np.concatenate(inside, axis=1).mean(axis=1)
    assert np.all(share > 0.88), share  # four standard errors less than 95 %


def test_asymmetric_peaks():
    """A quadratic term shifts the motion: the peaks are the turning points of equal potential."""
    model = ReducedModel.from_coefficients({"omega^2": 4.0, "gamma_2": 2.0, "c_linear": 0.01})
    b = extract_backbone(bare(model.simulate(0.6, 0.0, np.arange(8000) * 0.02)))
    high, low = b.positive_peak, b.negative_peak
    assert np.all(high < -low)
    potential = [2 * x**2 + 2 / 3 * x**3 for x in (high, low)]
    np.testing.assert_allclose(potential[0], potential[1], rtol=2e-4)
    np.testing.assert_allclose(b.amplitude, (high - low) / 2)


def test_few_samples_a_cycle():
    """2.8 samples a cycle, as in a measured record: frequency still to 1e-4."""
    t = np.arange(1000) / 1024
    b = extract_backbone(Decay(t, viscous_decay(t, 2 * np.pi * 367, 0.0015)))
    inside = slice(10, -10)
    np.testing.assert_allclose(b.frequency[inside], 2 * np.pi * 367, rtol=1e-4)
    np.testing.assert_allclose(b.damping_ratio[inside], 0.0015, atol=1e-4)


def test_linear_frequency_of_a_hardening_decay():
    model = ReducedModel.from_coefficients({"omega^2": 36.0, "gamma_3": 20.0, "c_linear": 0.05})
    b = extract_backbone(bare(model.simulate(1.0, 0.0, np.arange(12000) * 0.01)))
    assert b.linear_frequency() == pytest.approx(6.0, rel=5e-5)
    np.testing.assert_allclose(b.frequency, duffing_frequency(36.0, 20.0, b.amplitude), rtol=1e-4)


def test_linear_frequency_where_nothing_decays():
    """One amplitude: nothing is extrapolated from the scatter of it."""
    t = np.arange(2000) / 200
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    b = extract_backbone(Decay(t, np.sin(2 * np.pi * 8 * t) + noise))
    assert b.linear_frequency() == pytest.approx(2 * np.pi * 8, rel=1e-4)


@pytest.mark.parametrize("rate", [0.3, pytest.param(0.6, marks=pytest.mark.slow)])
def test_falling_frequency_of_an_asymmetric_decay(rate):
    """As of a clamped beam under its weight: 1.8 f to f, and the centre moves with amplitude^2."""
    t = np.arange(8000) * 0.005
    q, _, frequency = falling_decay(t, rate=rate)
    b = extract_backbone(Decay(t, q, unit="m"))
    exact = np.interp(b.t, t, frequency)
    # at first it falls by 3 % (6 %) a cycle, which shifts the crossings of a moving centre
    np.testing.assert_allclose(b.frequency / (2 * np.pi), exact, rtol=0.01 * rate)
    noise = np.random.default_rng(8).normal(0, 1e-2 * q.std(), len(t))  # 40 dB
    noisy = extract_backbone(Decay(t, q + noise, unit="m"))
    exact = np.interp(noisy.t, t, frequency)
    assert np.median(np.abs(noisy.frequency / (2 * np.pi) / exact - 1)) < 1e-3


def test_heavy_damping():
    """10 % of critical: each cycle is half the one before."""
    t = np.arange(2000) * 0.0025
    b = extract_backbone(Decay(t, viscous_decay(t, 2 * np.pi * 2, 0.1)))
    np.testing.assert_allclose(b.damping_ratio, 0.1, rtol=1e-3)
    np.testing.assert_allclose(b.frequency, 2 * np.pi * 2 * np.sqrt(1 - 0.01), rtol=1e-4)
    assert np.all(b.amplitude > 0)


def test_short_records_get_shorter_fits():
    t = np.arange(400) * 0.01
    b = extract_backbone(Decay(t, viscous_decay(t, 2 * np.pi * 1.5, 0.02)))
    assert len(b) == 5
    np.testing.assert_allclose(b.frequency, 2 * np.pi * 1.5, rtol=1e-3)


def test_measured_clamped_beam(measured):
    """What the field's own look at these data found: f0 46 to 47 Hz, f^2 straight in a^2."""
    with np.load(measured / "cc_beam_bristol.npz") as data:
        decay = Decay.from_velocity(data["mode1b_t"], data["mode1b_v"], "m")
        third = Decay.from_velocity(data["mode3_t"], data["mode3_v"], "m")
    b = extract_backbone(decay)
    hz = b.frequency / (2 * np.pi)
    assert hz[0] == pytest.approx(100, abs=1.5) and hz[-1] == pytest.approx(46.8, abs=0.2)
    assert 46.0 < b.linear_frequency() / (2 * np.pi) < 47.0
    assert np.corrcoef(b.amplitude**2, hz**2)[0, 1] ** 2 > 0.999
    last = extract_backbone(third).frequency[-50:] / (2 * np.pi)
    assert np.std(last) < 2  # 2.8 samples a cycle, interpolated


@pytest.mark.slow
def test_more_cycles_average_more_noise():
    """A number of cycles that is asked for: the bars of the middle fall with it, all but steadily.

    A slope over m cycles has an error that falls with m^1.5: from 2 to 40 by far more than three.
    """
    decay = example_decay(35.0, 0).free()
    std = [extract_backbone(decay, cycles=m).damping_ratio_std[70] for m in (2, 12, 40)]
    assert std[0] > std[1] > std[2] and std[0] > 3 * std[2]


def test_arguments_are_checked(clean):
    with pytest.raises(ValueError, match="cycles = 1 must be at least 2"):
        extract_backbone(clean, cycles=1)
    with pytest.raises(ValueError, match="2 channels"):
        extract_backbone(Decay(clean.t, np.stack([clean.q, clean.q], 1)))
