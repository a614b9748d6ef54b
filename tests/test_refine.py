"""Output error against known coefficients, closed forms and its own statistics."""

from __future__ import annotations

import numpy as np
import pytest

import romsindy as rs
from romsindy.refine import refine
from romsindy.synthetic import EXAMPLE_MODEL

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


def test_backbone_is_ten_times_better_than_regression(fit: rs.Fit) -> None:
    error = np.abs(fit.model.backbone(AMPLITUDES) / EXAMPLE_MODEL.backbone(AMPLITUDES) - 1)
    assert np.median(error) < 2e-5


def test_adequacy_is_one_for_the_right_structure_and_not_for_another(fit: rs.Fit) -> None:
    assert 0.97 < fit.adequacy < 1.03
    decay = fit.decays[0]
    library = rs.ROMLibrary(inertia=(), stiffness=(1, 2, 3, 4, 5), damping=("linear",))
    assert refine(rs.HarmonicSINDy(library).fit(decay).model_, decay).adequacy > 2


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


def test_offset_of_the_sensor_is_found() -> None:
    decay = noisy(4)
    shifted = rs.Decay(decay.t, decay.q + 0.01, unit=decay.unit)
    fit = refine(EXAMPLE_MODEL, shifted, offset=True)
    assert fit.offsets[0] == pytest.approx(0.01, abs=0.002)
    assert 0.97 < fit.adequacy < 1.03


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
    millimetres = rs.Decay(decay.t, 1e3 * decay.q, unit="mm")
    with pytest.raises(ValueError, match="decay 0 is in mm, the model in m"):
        refine(EXAMPLE_MODEL, millimetres)
