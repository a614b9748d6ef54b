"""Output error against known coefficients, closed forms and its own statistics."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.signal import lfilter

import romsindy as rs
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.refine import refine
from romsindy.physics.example import EXAMPLE_MODEL

AMPLITUDES = np.linspace(0.2, 1.7, 40)


def noisy(seed: int, snr_db: float = 35.0) -> rs.Decay:
    return rs.example_decay(snr_db=snr_db, seed=seed)


def regressed(decay: rs.Decay) -> rs.ReducedModel:
    library = rs.ROMLibrary(inertia=(3, 4, 5), stiffness=(1, 2, 3, 4, 5), damping=("linear",))
    return rs.HarmonicSINDy(library).fit(decay).model_


@pytest.fixture(scope="module")
def fit() -> rs.Fit:
    decay = noisy(0)
    return refine(regressed(decay), decay)


@pytest.mark.slow
def test_backbone_is_ten_times_better_than_regression(fit: rs.Fit) -> None:
    error = np.abs(fit.model.backbone(AMPLITUDES) / EXAMPLE_MODEL.backbone(AMPLITUDES) - 1)
    assert np.median(error) < 2e-5


@pytest.mark.slow
def test_adequacy_is_one_for_the_right_structure_and_not_for_another(fit: rs.Fit) -> None:
    assert 0.97 < fit.adequacy < 1.03
    decay = fit.decays[0]
    library = rs.ROMLibrary(inertia=(), stiffness=(1, 2, 3, 4, 5), damping=("linear",))
    assert refine(rs.HarmonicSINDy(library).fit(decay).model_, decay).adequacy > 2


@pytest.mark.slow
def test_errors_are_of_the_size_that_is_stated(fit: rs.Fit) -> None:
    truth = EXAMPLE_MODEL.coefficients
    for name, error in fit.standard_errors.items():
        assert abs(fit.model.coefficients[name] - truth.get(name, 0.0)) < 4 * error


def test_covariance_of_white_noise_is_that_of_least_squares() -> None:
    """A linear oscillator: Fisher's information from the closed form of its motion."""
    omega, c, sigma, q0 = 6.0, 0.1, 0.02, 1.0
    t = np.linspace(0, 30, 3001)

    def motion(squared: float, damping: float, a: float, b: float) -> np.ndarray:
        rate = np.sqrt(squared - damping**2 / 4)
        decay = np.exp(-damping * t / 2)
        return decay * (a * np.cos(rate * t) + (b + damping * a / 2) / rate * np.sin(rate * t))

    point = np.array([omega**2, c, q0, 0.0])
    steps = 1e-5 * np.eye(4)
    jacobian = np.array([(motion(*(point + s)) - motion(*(point - s))) / 2e-5 for s in steps]).T
    expected = sigma * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    signal = motion(*point) + sigma * np.random.default_rng(3).standard_normal(len(t))
    start = rs.ReducedModel.from_coefficients({"omega^2": 35.9, "c_linear": 0.11})
    fit = refine(start, rs.Decay(t, signal))
    # 3000 samples give the noise to 1/sqrt(6000); the free part may end a little earlier.
    np.testing.assert_allclose(list(fit.standard_errors.values()), expected[:2], rtol=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("measured", ["velocity", "acceleration"])
def test_other_quantities_are_fitted_as_measured(measured: str) -> None:
    clean = rs.example_decay()
    rng = np.random.default_rng(1)
    signal = np.asarray(clean.q_dot if measured == "velocity" else clean.q_ddot)
    signal = signal + 0.01 * signal.std() * rng.standard_normal(len(signal))
    make = rs.Decay.from_velocity if measured == "velocity" else rs.Decay.from_acceleration
    decay = make(clean.t, signal, unit="m")
    fit = refine(EXAMPLE_MODEL, decay)
    assert 0.97 < fit.adequacy < 1.03
    error = np.abs(fit.model.backbone(AMPLITUDES) / EXAMPLE_MODEL.backbone(AMPLITUDES) - 1)
    assert np.median(error) < 5e-5


@pytest.mark.slow
def test_two_decays_share_coefficients_and_fixed_ones_stay() -> None:
    decays = [noisy(seed) for seed in (1, 2)]
    one = refine(EXAMPLE_MODEL, decays[0], fixed=("omega^2",))
    two = refine(EXAMPLE_MODEL, decays, fixed=("omega^2",))
    assert two.model.coefficients["omega^2"] == EXAMPLE_MODEL.coefficients["omega^2"]
    assert "omega^2" not in two.free
    assert two.states.shape == (2, 2)
    # Twice the data of the same kind: standard errors fall by the square root of two.
    ratio = np.array(list(one.standard_errors.values())) / list(two.standard_errors.values())
    np.testing.assert_allclose(ratio, np.sqrt(2), rtol=0.05)


def test_any_coefficient_of_the_model_can_stay() -> None:
    """A force law with a number in its name, too."""
    model = rs.ReducedModel.from_coefficients(
        {"omega^2": 36.0, "gamma_3": 3.0, "c_|q_dot|^1.7": 0.05}, unit="m"
    )
    clean = model.simulate(1.0, 0.0, np.arange(0, 30, 0.02))
    decay = rs.add_noise(rs.Decay(clean.t, clean.q, unit="m"), 40, seed=0)
    fit = refine(model, decay, fixed=("c_|q_dot|^1.7",))
    assert fit.free == ("omega^2", "gamma_3") and fit.verdict.explained
    assert fit.model.coefficients["c_|q_dot|^1.7"] == 0.05


@pytest.mark.slow
def test_a_wrong_structure_is_fitted_as_well_as_it_can_be() -> None:
    """Where Gauss-Newton's method does not settle: no worse than from the best start there is."""
    decay = noisy(0)
    library = rs.ROMLibrary(inertia=(3,), stiffness=(1, 2, 3), damping=("linear",))
    start = rs.HarmonicSINDy(library).fit(decay).model_
    found = refine(start, decay)
    again = refine(found.model, decay)
    assert found.solution.converged
    assert found.chi_squared == pytest.approx(again.chi_squared, rel=1e-3)


@pytest.mark.slow
def test_offset_of_the_sensor_is_found() -> None:
    decay = noisy(4)
    shifted = rs.Decay(decay.t, decay.q + 0.01, unit=decay.unit)
    fit = refine(EXAMPLE_MODEL, shifted, offset=True)
    assert fit.offsets[0] == pytest.approx(0.01, abs=0.002)
    assert 0.97 < fit.adequacy < 1.03


@pytest.mark.slow
def test_bad_input_is_named() -> None:
    decay = noisy(0)
    with pytest.raises(ValueError, match=r"fixed names \['gamma_9'\]"):
        refine(EXAMPLE_MODEL, decay, fixed=("gamma_9",))
    with pytest.raises(ValueError, match="fixed names every coefficient"):
        refine(EXAMPLE_MODEL, decay, fixed=tuple(EXAMPLE_MODEL.coefficients))
    with pytest.raises(ValueError, match="decay 1 is the same record"):
        refine(EXAMPLE_MODEL, [decay, decay])
    with pytest.raises(ValueError, match="decays is empty"):
        refine(EXAMPLE_MODEL, [])
    with pytest.raises(ValueError, match="loss = 'huber' must be one of"):
        refine(EXAMPLE_MODEL, decay, loss="huber")
    millimetres = rs.Decay(decay.t, 1e3 * decay.q, unit="mm")
    with pytest.raises(ValueError, match="decay 0 is in mm, the model in m"):
        refine(EXAMPLE_MODEL, millimetres)


def within(fit: rs.Fit, sigmas: float = 4.5) -> bool:
    truth = EXAMPLE_MODEL.coefficients
    pairs = fit.standard_errors.items()
    return all(abs(fit.model.coefficients[k] - truth[k]) < sigmas * s for k, s in pairs)


@pytest.mark.slow
def test_a_clipped_sensor_is_noticed_and_left_out() -> None:
    decay = noisy(5, 45)
    clipped = rs.Decay(decay.t, np.clip(decay.q, -1.5, 1.5), unit="m")
    fit = refine(EXAMPLE_MODEL, clipped)
    assert any("stick to the end of the sensor's range" in note for note in fit.notes)
    assert within(fit)
    assert not any("stick" in note for note in refine(EXAMPLE_MODEL, decay).notes)


@pytest.mark.slow
def test_a_second_vibration_is_named() -> None:
    decay = noisy(6, 45)
    hum = 0.02 * np.sin(2 * np.pi * 17.7 * decay.t)
    fit = refine(EXAMPLE_MODEL, rs.Decay(decay.t, decay.q + hum, unit="m"))
    notes = [note for note in fit.notes if "another vibration" in note]
    assert len(notes) == 1
    frequency, rms = (float(x) for x in re.findall(r"at (\S+) Hz, rms ([\d.]+),", notes[0])[0])
    assert frequency == pytest.approx(17.7, abs=0.1)
    assert rms == pytest.approx(0.02 / np.sqrt(2), rel=0.1)
    assert within(fit)
    assert not refine(EXAMPLE_MODEL, decay).notes


@pytest.mark.slow
def test_ten_decibels_of_noise_give_large_but_true_errors() -> None:
    fit = refine(EXAMPLE_MODEL, noisy(7, 10))
    assert within(fit)
    assert fit.verdict.explained


@pytest.mark.slow
def test_three_cycles_give_an_answer_with_its_uncertainty() -> None:
    decay = noisy(8).between(0.0, 4.8)
    model = rs.ReducedModel.from_coefficients(
        {k: v for k, v in EXAMPLE_MODEL.coefficients.items() if k != "c_linear"}, unit="m"
    )
    fit = refine(EXAMPLE_MODEL, decay, fixed=("Upsilon_4", "Upsilon_5", "gamma_2"))
    assert within(fit)
    assert fit.standard_errors["omega^2"] > 0.01  # 150 cycles know it to 0.0005
    assert refine(model, decay).verdict.ratio > 1


@pytest.mark.slow
def test_a_model_that_becomes_singular_on_the_way_is_refused_with_a_remedy() -> None:
    singular = {**EXAMPLE_MODEL.coefficients, "Upsilon_3": -0.4, "Upsilon_5": 0.0}
    model = rs.ReducedModel.from_coefficients(singular, unit="m")
    with pytest.raises(TrajectoryError, match=r"no motion.*use fewer terms"):
        refine(model, noisy(0), fixed=("Upsilon_3", "Upsilon_5"))


@pytest.mark.slow
def test_an_interrupt_keeps_what_was_fitted() -> None:
    lines: list[str] = []

    def stop(line: str) -> None:
        lines.append(line)
        if len(lines) == 2:
            raise KeyboardInterrupt

    fit = refine(regressed(noisy(9)), noisy(9), progress=stop)
    assert any("interrupted before the simulations" in note for note in fit.notes)
    assert fit.model.coefficients["omega^2"] == pytest.approx(36, rel=1e-3)


@pytest.mark.slow
def test_robust_loss_forgives_outliers() -> None:
    decay = noisy(10, 40)
    q = decay.q.copy()
    rng = np.random.default_rng(0)
    q[rng.choice(len(q), 100, replace=False)] += 0.5 * rng.choice([-1, 1], 100)
    record = rs.Decay(decay.t, q, unit="m")
    plain, robust = (refine(EXAMPLE_MODEL, record, loss=loss) for loss in ("linear", "soft_l1"))
    exact = EXAMPLE_MODEL.backbone(AMPLITUDES)
    errors = [np.abs(f.model.backbone(AMPLITUDES) / exact - 1).max() for f in (plain, robust)]
    assert errors[1] < errors[0]


@pytest.mark.slow
def test_bootstrap_confirms_the_covariance() -> None:
    t = np.arange(0, 30, 0.02)
    model = rs.ReducedModel.from_coefficients({"omega^2": 36.0, "gamma_3": 3.0, "c_linear": 0.1})
    clean = model.simulate(1.0, 0.0, t)
    rng = np.random.default_rng(2)
    white = 0.02 * rng.standard_normal(len(t) + 50)
    coloured = lfilter([1.0], [1.0, -0.9], white)[50:]  # errors of low frequency: OLS is wrong
    fit = refine(model, rs.Decay(t, clean.q + coloured))
    repeats = rs.bootstrap(fit, 60, seed=1)
    assert repeats.failed == 0
    ratio = np.array(list(repeats.standard_errors.values())) / list(fit.standard_errors.values())
    # 60 repetitions know a standard deviation to 9 %; three of these.
    np.testing.assert_allclose(ratio, 1, atol=0.28)
    again = rs.bootstrap(fit, 4, seed=1, n_jobs=2)
    np.testing.assert_array_equal(again.values, rs.bootstrap(fit, 4, seed=1).values)
    with pytest.raises(ValueError, match="repetitions = 1 must be at least 2"):
        rs.bootstrap(fit, 1)


@pytest.mark.slow
def test_band_is_the_spread_of_refits() -> None:
    """Backbones of bootstrap repetitions scatter as the band says."""
    fit = refine(EXAMPLE_MODEL, noisy(11))
    amplitudes = np.array([0.3, 1.0, 1.6])
    band = fit.band(amplitudes)
    repeats = rs.bootstrap(fit, 30, seed=0)
    curves = [
        rs.ReducedModel(fit.model.terms, tuple(v), "m").backbone(amplitudes) for v in repeats.values
    ]
    # 30 repetitions know a standard deviation to 13 %; three of these.
    np.testing.assert_allclose(np.std(curves, axis=0, ddof=1), band.frequency_std, rtol=0.4)
    assert np.abs(band.frequency / EXAMPLE_MODEL.backbone(amplitudes) - 1).max() < 1e-4
