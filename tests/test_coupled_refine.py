"""Fits of several coordinates, to decays of a simulator that shares nothing with the package."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from romsindy import (
    CoupledModel,
    Decay,
    Estimate,
    bootstrap,
    identify,
    refine,
)
from romsindy.show import plots

SHAPES = np.array([[1.0, 0.7], [0.5, 1.0]])
TRUTH = {
    "omega^2 [q1]": (2 * np.pi * 10.0) ** 2,
    "omega^2 [q2]": (2 * np.pi * 20.7) ** 2,
    "c_linear [q1]": 0.6,
    "c_linear [q2]": 1.0,
    "gamma_3 [q1]": 900.0,
    "V q1^2 q2": 500.0,
    "g(q1^2)^2": 0.05,
}
# Frequencies 1 % off, the rest unknown.
START = {k: 1.02 * v if "omega" in k else v if "c_" in k else 0.0 for k, v in TRUTH.items()}


# Two frequencies that are close, and beat; strongly nonlinear.
CLOSE = {
    "omega^2 [q1]": 8025.0,
    "omega^2 [q2]": 9401.0,
    "c_linear [q1]": 0.86,
    "c_linear [q2]": 0.91,
    "gamma_3 [q1]": -357.0,
    "V q1^2 q2": 751.0,
    "g(q1^2)^2": 0.011,
    "gamma_3 [q2]": -612.0,
    "V q1^2 q2^2": 637.0,
}


def rates(_, y, values):
    """The equations of TRUTH, written down by hand; and of CLOSE, where there are more values."""
    q1, q2, v1, v2 = y
    k1, k2, c1, c2, gamma, v, g, *more = values
    gamma_2, w = more or (0.0, 0.0)
    force_1 = k1 * q1 + c1 * v1 + gamma * q1**3 + 2 * v * q1 * q2 + 4 * g * q1 * v1**2
    force_1 += 2 * w * q1 * q2**2
    force_2 = k2 * q2 + c2 * v2 + v * q1**2 + gamma_2 * q2**3 + 2 * w * q1**2 * q2
    return [v1, v2, -force_1 / (1 + 4 * g * q1**2), -force_2]


def decays(seed, shapes, starts=((0.8, 0.4), (0.4, 0.6)), duration=5.0, truth=TRUTH):
    rng, t, found = np.random.default_rng(seed), np.arange(0, duration, 1 / 300), []
    for start in starts:
        options = {"t_eval": t, "method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
        options["args"] = (tuple(truth.values()),)
        q = solve_ivp(rates, (0, duration), [*start, 0.0, 0.0], **options).y[:2].T
        y = q @ np.atleast_2d(shapes).T
        y += 0.01 * y.std(axis=0) * rng.standard_normal(y.shape)  # 40 dB
        y = y if y.shape[1] > 1 else y[:, 0]
        found.append(Decay(t, y, unit="m", stage="free"))  # beats could be taken for releases
    return found


@pytest.fixture(scope="module")
def two_sensors():
    return refine(CoupledModel.from_coefficients(START, unit="m"), decays(11, SHAPES))


def misses(fit):
    """Errors over standard errors."""
    found, error = fit.model.coefficients, fit.standard_errors
    return np.array([(found[k] - v) / error[k] for k, v in TRUTH.items()])


def test_coefficients_and_mode_shapes_from_two_sensors(two_sensors):
    fit = two_sensors
    # Seven values: one in 2000 such fits has one beyond four standard errors.
    assert np.abs(misses(fit)).max() < 4
    assert fit.standard_errors["V q1^2 q2"] < 0.01 * TRUTH["V q1^2 q2"]
    # Noise of 1 % in 3000 samples of two records: shapes to some 1e-3.
    np.testing.assert_allclose(fit.mode_shapes, SHAPES, atol=5e-3)
    # The level of the noise is known to about 3 %, from medians of a spectrum.
    assert fit.adequacy == pytest.approx(1.0, abs=0.1)
    assert fit.verdict.explained and fit.solution.converged
    assert fit.states.shape == (2, 4)
    np.testing.assert_allclose(fit.states[:, :2], [[0.8, 0.4], [0.4, 0.6]], atol=0.01)


def test_coefficients_from_one_sensor():
    fit = refine(CoupledModel.from_coefficients(START, unit="m"), decays(12, [1.0, 1.0]))
    assert np.abs(misses(fit)).max() < 4
    np.testing.assert_array_equal(fit.mode_shapes, [[1.0, 1.0]])
    assert fit.adequacy == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_what_is_missing_shows_at_the_harmonics(two_sensors):
    lacking = {k: v for k, v in START.items() if k != "V q1^2 q2"}
    fit = refine(CoupledModel.from_coefficients(lacking, unit="m"), two_sensors.decays)
    assert fit.adequacy > 2 and fit.verdict.structured


def test_a_fit_can_be_kept_and_repeated(two_sensors, tmp_path):
    two_sensors.save(tmp_path / "fit.json")
    again = Estimate.load(tmp_path / "fit.json")
    assert again.model == two_sensors.model
    np.testing.assert_array_equal(again.covariance, two_sensors.covariance)
    assert str(again) == str(two_sensors) and "q2_ddot" in str(again)
    drawn = bootstrap(two_sensors, repetitions=3, seed=1)
    # Three repetitions give a standard error to some 50 %.
    spread = drawn.values.std(axis=0, ddof=1) / np.sqrt(np.diag(two_sensors.covariance))
    assert np.all((spread > 0.05) & (spread < 4))


@pytest.mark.slow
@pytest.mark.parametrize("mode", [1, 2])
def test_a_mode_is_drawn_with_its_band(two_sensors, mode):
    """What rings is the tone of the coordinate; the curve is the band of the mode."""
    try:
        ax = plots.plot_backbone(two_sensors, mode=mode)
        damping = plots.plot_damping(two_sensors, mode=mode)
        names = [text.get_text() for text in ax.get_legend().get_texts()]
        assert names == [f"fitted model, mode {mode} alone", f"mode {mode} while others ring"]
        hz, amplitude = ax.lines[-1].get_data()
        band = two_sensors.band(amplitude, mode)
        np.testing.assert_allclose(2 * np.pi * hz, band.frequency)
        np.testing.assert_allclose(damping.lines[-1].get_ydata(), 100 * band.damping_ratio)
        own = np.concatenate([r.tones[mode - 1].amplitude for r in two_sensors.records])
        sizes = np.concatenate([c.lines[0].get_ydata() for c in ax.containers])
        np.testing.assert_array_equal(sizes, own)
    finally:
        plt.close("all")
    with pytest.raises(ValueError, match="mode = 3 is none of the modes 1 to 2"):
        plots.plot_damping(two_sensors, mode=3)


def test_what_cannot_be_fitted(two_sensors):
    decay = two_sensors.decays[0]
    far = CoupledModel.from_coefficients({**START, "omega^2 [q2]": 1e5}, unit="m")
    with pytest.raises(ValueError, match=r"a mode of 50.33 Hz, but nothing near it rings .*10.*Hz"):
        refine(far, decay)
    model = CoupledModel.from_coefficients(START, unit="m")
    noise = np.random.default_rng(1).standard_normal(decay.signal.shape)
    quiet = Decay(decay.t, noise, unit="m", stage="free")
    with pytest.raises(ValueError, match="nothing rings in a decay: leave it out"):
        refine(model, [decay, quiet])
    with pytest.raises(ValueError, match="offset = True is for models of one coordinate"):
        refine(model, decay, offset=True)
    with pytest.raises(ValueError, match="decay 1 is the same record"):
        refine(model, [decay, decay])
    with pytest.raises(ValueError, match=r"has 2 coordinates, and one is needed.*backbone_curve"):
        two_sensors.single_model  # noqa: B018


@pytest.fixture(scope="module")
def identified():
    several = decays(21, SHAPES, starts=((0.8, 0.4), (0.4, 0.6), (0.6, 0.5)))
    return identify(several[:2], "auto"), several[2]


def test_coordinates_and_terms_come_from_the_data(identified):
    fit, _ = identified
    assert fit.model.n_coordinates == 2
    # The sensors show 1 of q1 and 1 of q2 at most: the same masses, so none is named.
    assert {*fit.model.coefficients} == {*TRUTH}
    assert np.abs(misses(fit)).max() < 4
    np.testing.assert_allclose(fit.mode_shapes, SHAPES, atol=5e-3)
    assert fit.verdict.explained


def test_a_decay_that_took_no_part_is_predicted_from_its_first_samples(identified):
    fit, decay = identified
    # Twelve cycles of the slow coordinate; the noise is 1 % of the rms of each channel.
    predicted = fit.predict(decay, samples=360)
    assert predicted.shape == decay.signal.shape
    missed = np.sqrt(np.mean((predicted - decay.signal) ** 2, axis=0))
    # The state is known to some 1 % / sqrt(360): noise and little more.
    assert np.all(missed < 1.3 * 0.01 * decay.signal.std(axis=0))


@pytest.mark.slow
@pytest.mark.parametrize("samples", [90, 120, 300])
def test_the_state_of_vibrations_that_beat(samples):
    """From 4, 6 and 15 cycles: from the state that the beating sensor suggests, one is lost."""
    starts = ((0.65, 0.82), (0.56, 0.66))
    one, other = decays(32, [1.0, 1.0], starts, duration=8.4, truth=CLOSE)
    fit = refine(CoupledModel.from_coefficients(CLOSE, unit="m"), one)
    missed = fit.predict(other, samples) - other.signal
    # Noise is 1 % of the rms; the state is known to that over sqrt(90).
    assert np.sqrt(np.mean(missed**2)) < 1.3 * 0.01 * other.signal.std()


@pytest.mark.slow
def test_one_sensor_of_masses_that_differ():
    """What the sensor shows is scaled: an added mass restores what two equations share."""
    fit = identify(decays(22, [1.0, 0.6]), coordinates=2)
    # In the unit of the sensor q2 is 0.6 of itself, and its mass 1 / 0.36.
    found, error = fit.model.coefficients, fit.standard_errors
    assert found["mu [q2]"] == pytest.approx(1 / 0.36 - 1, abs=4 * error["mu [q2]"])
    assert found["V q1^2 q2"] == pytest.approx(500 / 0.6, abs=4 * error["V q1^2 q2"])
    omega = fit.model.linear_modes[0] / (2 * np.pi)
    np.testing.assert_allclose(omega, [10.0, 20.7], rtol=1e-4)


@pytest.mark.slow
def test_a_decay_in_which_one_mode_is_silent():
    """The second was released in its second mode: nothing rings near 10 Hz."""
    fit = identify(decays(23, SHAPES, starts=((0.8, 0.4), (0.0, 0.6))), coordinates=2)
    assert np.abs(misses(fit)).max() < 4
    np.testing.assert_allclose(fit.states[1, :2], [0.0, 0.6], atol=0.01)
    assert fit.verdict.explained


def linear_decay(frequencies, zeta, shapes, duration=6.0, seed=3):
    """Free vibrations of uncoupled modes, written down: sums of cosines that die away."""
    t, rng = np.arange(0, duration, 1 / 300), np.random.default_rng(seed)
    omega = 2 * np.pi * np.array(frequencies)
    q = np.exp(-zeta * np.outer(t, omega)) * np.cos(np.outer(t, omega))
    seen = q @ np.atleast_2d(shapes).T
    return Decay(t, seen + 0.01 * rng.standard_normal(seen.shape), unit="m", stage="free")


def test_modes_closer_than_their_bandwidth_ring_as_one():
    decay = linear_decay([10.0, 10.02], 0.005, [[1.0, 0.8], [0.6, 1.0]])
    with pytest.raises(
        ValueError, match=r"rings in the record is 10.* Hz: .*bandwidth ring as one"
    ):
        identify(decay, 2)
    assert identify(decay, "auto").model.n_coordinates == 1


def test_a_sensor_on_a_node_and_a_ratio_that_only_looks_rational():
    fit = identify(linear_decay([10.0, 20.03], 0.004, [[1.0, 0.5], [0.7, 0.0]]), "auto")
    # Noise of 1 % in 1800 samples.
    np.testing.assert_allclose(fit.mode_shapes, [[1.0, 1.0], [0.7, 0.0]], atol=5e-3)
    assert fit.verdict.explained
    (note,) = [note for note in fit.notes if "ring at" in note]
    assert "1:2" in note and note.endswith("no term of the model couples them")


def test_what_cannot_be_identified(identified):
    fit, decay = identified
    # Strongest first, by the share in the decay in which it has least: 0.65 and 0.50.
    rings = r"coordinates = 7, but what rings .* is 20\.7 Hz, (9\.99|10).* Hz: ask"
    with pytest.raises(ValueError, match=rings):
        identify(decay, coordinates=7)
    with pytest.raises(ValueError, match="coordinates = 'two': give 'auto' or a whole number"):
        identify(decay, coordinates="two")
    with pytest.raises(ValueError, match="samples = 3 must be a whole number from 8"):
        fit.predict(decay, samples=3)
    with pytest.raises(ValueError, match="the record has 1 channels, the fit 2"):
        fit.predict(decay.channel(0), samples=100)


def test_small_vibrations_that_would_grow_are_told():
    """Damping that a mode has by its amplitude alone: the record ends before it would grow."""
    truth = {
        "omega^2 [q1]": (2 * np.pi * 10.0) ** 2,
        "omega^2 [q2]": (2 * np.pi * 23.7) ** 2,
        "c_linear [q1]": 0.6,
        "c_linear [q2]": -0.5,
        "c_cubic [q2]": 1e-3,
    }

    def rates(_, y):
        k1, k2, c1, c2, cubic = truth.values()
        return [y[2], y[3], -k1 * y[0] - c1 * y[2], -k2 * y[1] - c2 * y[3] - cubic * y[3] ** 3]

    t = np.arange(0, 3.0, 1 / 300)
    q = solve_ivp(rates, (0, 3), [0.8, 0.6, 0, 0], t_eval=t, rtol=1e-10, atol=1e-12).y[:2].T
    y = q @ SHAPES.T + 0.004 * np.random.default_rng(5).standard_normal(q.shape)
    fit = refine(CoupledModel.from_coefficients(truth, unit="m"), Decay(t, y, unit="m"))
    assert fit.model.coefficients["c_linear [q2]"] == pytest.approx(-0.5, abs=0.1)
    told = [note for note in fit.notes if "would grow" in note]
    assert len(told) == 1 and "q2" in told[0]
