"""Forced vibrations, made by a simulator that shares nothing with the package."""

import warnings
from dataclasses import replace

import numpy as np
import oracles
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import StateSpace, cont2discrete, dlsim

import romsindy as rs
from romsindy import ForcedVibration, identify, refine
from romsindy.fit.adequacy.independence import examine_forced
from romsindy.fit.adequacy.verdicts import ForcedAdequacy
from romsindy.fit.records.driven import ForcedRecord
from romsindy.fit.records.smooth import rated
from romsindy.fit.results.estimate import stand_ins
from romsindy.fit.results.fitted import _undetermined
from romsindy.fit.results.predict import Sensors, predicted
from romsindy.physics.input import Input
from romsindy.show.plots import plot_forced_response

OMEGA, DAMPING, CUBIC, GAIN = 2 * np.pi * 5.0, 0.8, 5e3, 3.0
DT = 0.01
N = 2500
T = DT * np.arange(N)


def multisine(seed, n=N, dt=DT, low=1.0, high=12.0, lines=60):
    """Samples (n,) of a force, and the function."""
    force = oracles.multisine(seed, low, high, lines)
    return force(dt * np.arange(n)), force


def duffing(force, t, start=(0.0, 0.0), sign=1.0, cubic=CUBIC):
    """The displacement under a force that is known at all times."""

    def rates(time, y):
        push = sign * GAIN * float(force(time))
        return [y[1], push - DAMPING * y[1] - OMEGA**2 * y[0] - cubic * y[0] ** 3]

    options = {"t_eval": t, "method": "DOP853", "rtol": 1e-10, "atol": 1e-13}
    return solve_ivp(rates, (t[0], t[-1]), start, **options).y


@pytest.fixture(scope="module")
def smooth():
    """Displacement, velocity and samples of a band-limited force."""
    u, force = multisine(1)
    return u, *duffing(force, T)


def noisy(x, seed, level=0.01):
    return x + level * x.std() * np.random.default_rng(seed).standard_normal(len(x))


def model():
    names = {"omega^2": 0.95 * OMEGA**2, "c_linear": 1.0, "gamma_3": 0.0}
    return rs.ReducedModel.from_coefficients(names, unit="m")


def misses(fit, cubic=CUBIC):
    """Errors over standard errors."""
    truth = {"omega^2": OMEGA**2, "c_linear": DAMPING, "gamma_3": cubic, "gain [force]": GAIN}
    found, error = fit.model.coefficients, fit.standard_errors
    return np.array([(found[k] - v) / error[k] for k, v in truth.items()])


def test_a_forced_vibration_gives_back_its_equation(smooth):
    u, q, _ = smooth
    record = ForcedVibration(T, 0.02 + noisy(q, 2), u, unit="m", input_unit="N")
    fit = refine(model(), record)
    # Four values, each normal: the largest of 4 exceeds 3.5 once in 500.
    assert np.abs(misses(fit)).max() < 3.5
    errors = {k: e / abs(fit.model.coefficients[k]) for k, e in fit.standard_errors.items()}
    assert max(errors.values()) < 0.02
    assert fit.offsets[0] == pytest.approx(0.02, abs=1e-4)
    assert fit.verdict.explained and "explains the record" in str(fit)
    assert any("band-limited" in note for note in fit.notes)
    delay, error = fit.delays["force"]
    assert abs(delay) < 4 * error < 1e-3 * DT * 40
    assert "gain [force]" in str(fit) and "m/(s^2 N)" in str(fit)


@pytest.mark.parametrize(
    ("left", "said"),
    [
        (lambda x, e: 0.01 * e, "as large where the response is quiet"),
        (lambda x, e: 0.02 * x * e, "grows with the response"),
        (lambda x, e: 1e-4 / x * e, "falls with the response"),
    ],
)
def test_what_is_left_is_told_where_the_response_is_quiet_and_loud(left, said):
    """Noise that is the same, a part of the response, or less where it is loud: rms in closed form.

    Stretches of eight cycles of 0.1 to 1 m, each with white noise of a known size.
    """
    cycles, most = 8, np.geomspace(0.1, 1.0, 64)
    size = np.repeat(np.random.default_rng(0).permutation(most), cycles * 20)
    t = 0.05 * np.arange(len(size))
    y = size * np.sin(2 * np.pi * t)
    residual = left(size, np.random.default_rng(1).standard_normal(len(size)))
    record = ForcedRecord.of(ForcedVibration(t, y, np.cos(t), unit="m"), 1e-6)
    verdict = examine_forced([record], [residual], 4)
    assert said in str(verdict) and verdict.levels.shape == (8, 2)
    levels = np.array_split(most, 8)
    response = [np.sqrt(np.mean(x**2) / 2) for x in levels]
    # Of 1,280 values in a level: the rms of noise is known to 2 %, within four standard errors.
    expected = [np.sqrt(np.mean(left(x, 1.0) ** 2 * np.ones(len(x)))) for x in levels]
    np.testing.assert_allclose(verdict.levels[:, 0], response, rtol=0.01)
    np.testing.assert_allclose(verdict.levels[:, 1], expected, rtol=0.08)


def test_a_record_of_few_cycles_has_no_levels():
    t = 0.05 * np.arange(120)
    record = ForcedRecord.of(ForcedVibration(t, np.sin(2 * np.pi * t), np.cos(t), unit="m"), 1e-6)
    verdict = examine_forced([record], [0.1 * np.cos(t)], 2)
    assert verdict.levels.shape == (0, 2) and np.isnan(verdict.growth[0])


@pytest.mark.parametrize("derivative", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_velocity_and_acceleration_do_as_well(smooth, derivative):
    u, q, v = smooth
    _, force = multisine(1)
    a = GAIN * force(T) - DAMPING * v - OMEGA**2 * q - CUBIC * q**3
    y = noisy((q, v, a)[derivative], 3)
    measured = ("displacement", "velocity", "acceleration")[derivative]
    fit = refine(model(), ForcedVibration(T, y, u, unit="m", measured=measured))
    assert np.abs(misses(fit)).max() < 3.5


def held(u, dt=DT):
    """Exact response of the linear oscillator to an input that is held between its samples."""
    a = np.array([[0.0, 1.0], [-(OMEGA**2), -DAMPING]])
    system = StateSpace(a, np.array([[0.0], [GAIN]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    discrete = cont2discrete((system.A, system.B, system.C, system.D), dt, "zoh")
    return dlsim((*discrete[:4], dt), u)[1][:, 0]


@pytest.mark.slow
def test_an_input_that_is_held_is_named():
    u = multisine(4)[0]
    fit = refine(model(), ForcedVibration(T, noisy(held(u), 5, 0.003), u, unit="m"))
    assert fit.notes[0].startswith("between its samples the input is held")
    assert abs(fit.delays["force"][0]) < 4 * fit.delays["force"][1]
    assert fit.model.coefficients["omega^2"] == pytest.approx(OMEGA**2, rel=1e-3)


def test_an_input_that_is_held_is_integrated_exactly():
    """Without noise, what is left is rounding and the error of the steps, of order six."""
    u = multisine(4)[0]
    record = ForcedVibration(T, held(u), u, unit="m", interpolation="hold")
    linear = rs.ReducedModel.from_coefficients({"omega^2": OMEGA**2, "c_linear": DAMPING}, "m")
    fit = refine(linear, record)
    assert np.std(fit.residuals[0]) < 1e-6 * np.std(record.y)
    assert fit.model.coefficients["omega^2"] == pytest.approx(OMEGA**2, rel=1e-6)


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.parametrize("held_between", [False, True])
def test_slow_input_cannot_tell(held_between):
    """Sampled 80 times a cycle and noisy, held and straight inputs differ by a delay alone."""
    t = 0.0025 * np.arange(4000)
    u, force = multisine(6, 4000, 0.0025, 3.0, 7.0, lines=20)
    acts = (lambda s: u[int(s / 0.0025 + 1e-9)]) if held_between else force
    q = duffing(acts, t)[0]
    fit = refine(model(), ForcedVibration(t, noisy(q, 7, 0.1), u, unit="m"))
    assert "cannot tell these apart" in fit.notes[0]
    delay, error = fit.delays["force"]  # half a sample more or less, and there is none
    assert abs(delay) < 2 * error < 0.0025


@pytest.mark.slow
def test_a_base_that_moves():
    """q'' + ... = - Gamma a: the factor of a mass on a spring is 1, without a unit."""
    u, force = multisine(9)
    q = duffing(force, T, sign=-1.0)[0]
    record = ForcedVibration(T, noisy(q, 10), u, unit="m", inputs="base", input_unit="m/s^2")
    fit = refine(model(), record)
    assert fit.model.coefficients["Gamma [base]"] == pytest.approx(GAIN, rel=0.01)
    assert "= - 3" in fit.model.equation().replace("-3", "- 3") and "Gamma [base]" in str(fit)


def test_a_displacement_of_the_base_is_refused():
    _, force = multisine(9)
    q = duffing(force, T, sign=-1.0)[0]
    rng = np.random.default_rng(9)
    frequency, phase = rng.uniform(1.0, 12.0, 60), rng.uniform(0, 2 * np.pi, 60)
    omega = 2 * np.pi * frequency
    moved = -np.sum(np.cos(np.multiply.outer(T, omega) + phase) / omega**2, axis=1)
    with pytest.raises(ValueError, match="displacement of the base"):
        refine(model(), ForcedVibration(T, q, moved, unit="m", inputs="base"))


@pytest.mark.slow
def test_a_decay_and_a_forced_record_together(smooth):
    u, q, _ = smooth
    free = duffing(lambda t: 0.0, T[:1500], start=(0.2, 0.0))[0]
    decay = rs.Decay(T[:1500], noisy(free, 11), unit="m")
    record = ForcedVibration(T, noisy(q, 12), u, unit="m")
    both, alone = refine(model(), [record, decay]), refine(model(), record)
    assert np.abs(misses(both)).max() < 3.5
    better = both.standard_errors["gamma_3"] / alone.standard_errors["gamma_3"]
    assert better < 0.9 and len(both.decays) == 1


@pytest.mark.slow
def test_terms_are_chosen(smooth):
    """The cubic stiffness and nothing else; also where a linear model has a phase of its own."""
    u, q, _ = smooth
    fit = identify(ForcedVibration(T, noisy(q, 13), u, unit="m"))
    assert set(fit.model.coefficients) == {"omega^2", "c_linear", "gamma_3", "gain [force]"}
    linear = identify(ForcedVibration(T, noisy(held(u), 14), u, unit="m"))
    assert set(linear.model.coefficients) == {"omega^2", "c_linear", "gain [force]"}


@pytest.mark.slow
def test_a_free_run_predicts_the_rest(smooth):
    u, q, _ = smooth
    y = 0.02 + noisy(q, 15, 1e-3)
    first = ForcedVibration(T[:1800], y[:1800], u[:1800], unit="m")
    rest = ForcedVibration(T[1800:], y[1800:], u[1800:], unit="m")
    missed = rest.y - refine(model(), first).predict(rest, 50)
    assert np.std(missed[50:]) < 1.5e-3 * np.std(q)  # 1e-3 is noise; the state has an error too
    with pytest.raises(ValueError, match="driven by"):
        refine(model(), first).predict(ForcedVibration(T, q, u, "m", inputs="base"), 50)


def test_a_model_without_an_input_foretells_no_driven_record(smooth):
    u, q, _ = smooth
    with pytest.raises(ValueError, match=r"driven by \['force'\], and the model has no input"):
        predicted(model(), Sensors(), ForcedVibration(T, q, u, unit="m"), 50)


def test_a_linear_oscillator_under_a_multisine_has_its_transfer_function():
    """Identified without noise; H at the lines against the closed form."""
    rng = np.random.default_rng(16)
    lines, n = np.arange(10, 120), 1000
    phase = rng.uniform(0, 2 * np.pi, len(lines))
    omega = 2 * np.pi * lines / (n * DT)
    h = GAIN / (OMEGA**2 - omega**2 + 1j * DAMPING * omega)
    waves = np.exp(1j * (np.multiply.outer(DT * np.arange(2 * n), omega) + phase))
    record = ForcedVibration(T[: 2 * n], (waves @ h).real, waves.sum(axis=1).real, unit="m")
    fit = refine(
        rs.ReducedModel.from_coefficients({"omega^2": 900.0, "c_linear": 1.0}, "m"), record
    )
    c, delay = fit.model.coefficients, fit.delays["force"][0]
    found = c["gain [force]"] / (c["omega^2"] - omega**2 + 1j * c["c_linear"] * omega)
    off = np.abs(found * np.exp(-1j * omega * delay) - h).max() / np.abs(h).max()
    assert off < 1e-4


def test_what_cannot_be_a_record_is_refused(smooth):
    u, q, _ = smooth
    with pytest.raises(ValueError, match=rf"u has {N - 1} samples, and t {N}: .* one clock"):
        ForcedVibration(T, q, u[1:])
    with pytest.raises(ValueError, match="the input 'force' is zero"):
        ForcedVibration(T, q, 0 * u)
    with pytest.raises(ValueError, match="y is constant"):
        ForcedVibration(T, 0 * q, u)
    with pytest.raises(ValueError, match="input 'shaker' is not known"):
        ForcedVibration(T, q, u, inputs="shaker")
    with pytest.raises(ValueError, match="name each of the 1 columns"):
        ForcedVibration(T, q, u, inputs=("force", "base"))
    with pytest.raises(ValueError, match="interpolation = 'cubic'"):
        ForcedVibration(T, q, u, interpolation="cubic")
    with pytest.raises(ValueError, match="gains of inputs are always fitted"):
        own = rs.ReducedModel.from_coefficients({"omega^2": 900.0, "gain [force]": 3.0}, "m")
        refine(own, ForcedVibration(T, q, u, "m"), fixed=["gain [force]"])


def test_an_input_rests_between_two_hits():
    """At its value at rest it is not saturated, and a piece without a hit is one of the record."""
    t = 0.01 * np.arange(1000)
    hits = np.where((t % 3 < 0.2), np.sin(np.pi * (t % 3) / 0.2) * (1 + t), 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        record = rs.ForcedVibration(t, np.cos(6 * t), hits)
        quiet = record.between(1.0, 2.0)
    assert not np.any(quiet.u) and quiet.t[[0, -1]].tolist() == pytest.approx([1.0, 2.0])
    assert record.notes == quiet.notes == () and len(record.t) == 1000


def test_a_saturated_force_is_told(smooth):
    u, q, _ = smooth
    with pytest.warns(UserWarning, match="saturated"):
        record = ForcedVibration(T, q, np.clip(u, -8, 8))
    assert "saturated" in repr(record)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ForcedVibration(T, q, np.sign(u))  # a square wave is not


def test_a_model_with_an_input_is_kept(smooth, tmp_path):
    u, q, _ = smooth
    fit = refine(model(), ForcedVibration(T, noisy(q, 17), u, unit="m", input_unit="N"))
    assert rs.ReducedModel.from_json(fit.model.to_json()) == fit.model
    fit.save(tmp_path / "fit.json")
    kept = rs.Estimate.load(tmp_path / "fit.json")
    assert kept.standard_errors == fit.standard_errors and str(kept) == str(fit)
    # The free motion is that of the model without its input.
    np.testing.assert_array_equal(
        fit.model.simulate(0.01, 0.0, T[:200]).q,
        rs.ReducedModel(fit.model.terms[:3], fit.model.values[:3], "m")
        .simulate(0.01, 0, T[:200])
        .q,
    )
    assert "= " in fit.model.latex() and r"force(t" in fit.model.latex()


def test_the_response_to_a_harmonic_force_is_told_before_the_test(smooth):
    """In the unit of the input; the band holds the truth, of Duffing's equation with its folds."""
    u, q, _ = smooth
    fit = refine(model(), ForcedVibration(T, noisy(q, 18), u, unit="m", input_unit="N"))
    band = rs.forced_response(fit, 0.5, (0.9 * OMEGA, 1.2 * OMEGA))
    names = {"omega^2": OMEGA**2, "c_linear": DAMPING, "gamma_3": CUBIC}
    truth = rs.ReducedModel.from_coefficients(names, unit="m")
    exact = rs.forced_response(truth, 0.5 * GAIN, (0.9 * OMEGA, 1.2 * OMEGA))
    peak = exact.amplitude.max()
    assert band.peak[1] == pytest.approx(peak, rel=0.01)
    assert band.frequency[0] <= band.peak[0] <= band.frequency[-1]
    below = slice(5, int(np.argmax(exact.amplitude)), 8)  # of the first fold
    found, wanted = band.at(exact.frequency[below]), np.abs(exact.coefficients[below, 1])
    inside = (found.low < wanted) & (wanted < found.high)
    assert np.mean(inside) > 0.8  # of values that all hang on the same coefficients
    by_model = rs.forced_response(fit.model, 0.5, (0.9 * OMEGA, 1.2 * OMEGA))
    assert by_model.amplitude.max() == pytest.approx(peak, rel=0.01)


@pytest.mark.slow
def test_a_sensitive_motion_is_fitted_in_pieces():
    """Four times the cubic force: whole records have many minima, one of them 62 errors off."""
    t = DT * np.arange(4000)
    u, force = multisine(3, 4000)
    q = duffing(force, t, cubic=2e4)[0]
    record = ForcedVibration(t, noisy(q, 3), u, unit="m", interpolation="band-limited")
    fit = refine(model(), record)
    assert np.abs(misses(fit, cubic=2e4)).max() < 3.5
    assert len(fit.records) > 1 and any("small errors grow" in note for note in fit.notes)
    # The figure is that of pieces, and the record's own is one simulation of all of it.
    text, verdict = str(fit.verdict), fit.verdict
    assert f"pieces of {verdict.piece:.0f} cycles, each from a state of its own" in text
    assert "One simulation of the whole record" in text and not verdict.whole < verdict.part
    again = rs.Estimate.from_json(fit.to_json()).verdict
    assert str(again) == text


@pytest.mark.slow
def test_where_the_response_leaves_the_data_it_is_told(smooth):
    """A resonance that goes far beyond any motion of the record."""
    u, q, _ = smooth
    fit = refine(model(), ForcedVibration(T, noisy(q, 18), u, unit="m", input_unit="N"))
    span = (0.5 * OMEGA, 1.3 * OMEGA)
    most = fit.model.amplitude_range[1]
    with pytest.warns(UserWarning, match="beyond the amplitudes of the data, .* there is no band"):
        band = rs.forced_response(fit, 2.0, span)
    assert np.any(band.beyond) and not np.all(band.beyond)
    assert np.array_equal(np.isnan(band.low), band.beyond) and np.all(np.isfinite(band.amplitude))
    assert (
        np.array_equal(band.beyond, band.amplitude > 1.02 * most)
        or np.mean(band.beyond != (band.amplitude > 1.02 * most)) < 0.05
    )  # that of the first harmonic, and half of peak to peak
    assert "Note: beyond the amplitudes of the data" in str(band)
    # Drawn: the curve of the orbits passes through the band, as far as there is one.
    ax = plot_forced_response(band)
    curve = np.concatenate([line.get_xydata() for line in ax.lines[:1]])
    drawn = np.interp(band.frequency[:5] / (2 * np.pi), *curve.T)
    np.testing.assert_allclose(drawn, band.amplitude[:5], rtol=3e-3)  # straight between orbits
    assert len(ax.collections) == 2  # bands of the larger and of the smaller response
    assert ax.get_ylabel() == "amplitude of the first harmonic (m)"
    assert "Beyond the amplitudes of the data" in str(rs.forced_response(fit.model, 2.0, span))


def test_parameters_that_are_not_told_from_zero_are_no_model():
    """A residual of pieces as white as can be, and a stiffness of 410 +- 690000."""
    names = ("omega^2", "c_linear", "gain [force]")
    terms = (*model().terms[:2], Input("force", "linear", 0.0, "N"))
    some = rs.ReducedModel(terms, (410.0, 0.1, 2.0), "m")
    unknown = _undetermined(some, names, np.diag([6.9e5, 5.0, 0.1]) ** 2)
    assert unknown == "omega^2 is 410 +- 6.9e+05"  # that of damping may be 0
    # Noise beside noise has a delay at which its gain is two and a half errors.
    doubtful = _undetermined(some, names, np.diag([1.0, 5.0, 0.8]) ** 2)
    assert doubtful == "gain [force] is 2 +- 0.8"
    white = {"ratio": 1.0, "p_value": 1.0, "structure": 1.0, "below_floor": False, "limit": 1.0}
    none = {"amplitude": [], "misfit": [], "unit": "m", "measured_unit": "m"}
    found = ForcedAdequacy(**white, **none, left=1e-6, part=0.0015, piece=21.0, whole=np.nan)
    assert found.explained and "pieces of 21 cycles" in str(found) and "astray" in str(found)
    found = replace(found, undetermined=unknown, whole=0.96)
    assert not found.explained and "0.15 %" not in str(found)
    assert str(found) == (
        "The record does not determine the model: omega^2 is 410 +- 6.9e+05. One simulation of the"
        " whole record leaves 96 % of the response."
    )


@pytest.mark.parametrize(("value", "told"), [(-0.5, True), (-0.05, False), (0.5, False)])
def test_damping_that_came_out_negative_is_said_to_stand_for_something_else(value, told):
    drag = {"omega^2": 9.0, "c_linear": 0.3, "c_quadratic": value}
    found = rs.Estimate(
        rs.ReducedModel.from_coefficients(drag, unit="m"),
        ("c_linear", "c_quadratic"),
        np.diag([0.01, 0.05]) ** 2,
        None,
        (),
    )
    assert ["c_quadratic came out negative, by 10 standard" in s for s in stand_ins(found)] == (
        [True] if told else []
    )


@pytest.mark.parametrize(
    ("inputs", "unit", "remedy"),
    [("base", "N", "inputs='force'"), ("force", "m/s^2", "inputs='base'")],
)
def test_an_input_in_the_unit_of_the_other_kind_is_refused(inputs, unit, remedy):
    t = np.arange(200) / 100
    with pytest.raises(ValueError, match=f"input_unit = '.*' of the input '{inputs}'.*{remedy}"):
        ForcedVibration(t, np.sin(9 * t), np.cos(9 * t), inputs=inputs, unit="m", input_unit=unit)


def test_an_input_is_no_term_that_is_asked_for():
    """A gain of a force that no record holds is any number."""
    t = np.arange(600) / 100
    decay = rs.Decay(t, np.exp(-0.2 * t) * np.cos(20 * t), unit="m")
    with pytest.raises(ValueError, match=r"terms hold \['gain \[force\]'\].*ForcedVibration"):
        identify(decay, terms=["gain [force]"])


def test_where_the_form_of_a_model_leaves_more_it_may_stand_for_what_inputs_do():
    """15,000 samples, whose power is 0.8 % less one way: 120 of deviance, of which 2 % make 297."""
    e = np.random.default_rng(0).standard_normal(15_000)
    left = {"linear": [e], "band-limited": [1.004 * e]}
    assert rated(left).weights == {"linear": 1.0}
    unsure = rated(left, form=1.02).weights
    # Deviances count by 7 / 297, as odds.
    odds = np.exp(0.5 * 7 / (15_000 * np.log(1.02)) * 15_000 * 2 * np.log(1.004))
    assert unsure["linear"] / unsure["band-limited"] == pytest.approx(odds, rel=1e-3)
