"""Models from steady states, and the next test predicted, against what the package has no part in.

Duffing oscillators come from shooting (`steady_oracle`), with both folds and the unstable orbits.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
import steady_oracle as oracle
from scipy.optimize import brentq

import romsindy as rs
from romsindy.fit.steady.balance import Chain, SteadyPoints, linearised
from romsindy.orbits.harmonic_balance import HarmonicBalance

DUFFING = {"k": 1.0, "g": 0.5, "c": 0.04}
TRUE = {"omega^2": 1.0, "gamma_3": 0.5, "c_linear": 0.04}
START = rs.ReducedModel.from_coefficients({"omega^2": 1.3, "gamma_3": 0.1, "c_linear": 0.1})
GAIN, PHASE = 2.0, 0.1
LEVELS = (0.03, 0.06, 0.1)


def swept(force, count=14):
    """Frequency, force and response of points all along a curve, and whether they are stable."""
    top = force / DUFFING["c"]
    sizes = np.linspace(0.135 * top, 0.88 * top, count)
    w, q, stable = oracle.curve(sizes, force, **DUFFING, within=(0.6, 1.9))
    return w, np.full(len(w), force), q, stable


@pytest.fixture(scope="module")
def duffing():
    """The same for three levels, as an excitation of another unit and phase, and stable."""
    w, f, q, stable = map(np.concatenate, zip(*(swept(f) for f in LEVELS), strict=True))
    return w, f / GAIN, q * np.exp(1j * PHASE), stable


@pytest.fixture(scope="module")
def linear():
    """A linear oscillator in closed form, with phase and gain of a chain."""
    w = np.linspace(0.8, 1.2, 24)
    return w, np.full(24, 0.3), 2.0 * 0.3 * np.exp(0.2j) / (1 - w**2 + 0.05j * w)


def noise_of(std, n, seed):
    rng = np.random.default_rng(seed)
    return std * (rng.standard_normal(n) + 1j * rng.standard_normal(n))


@pytest.mark.parametrize(
    "measured, rate", [("displacement", 0), ("velocity", 1), ("acceleration", 2)]
)
@pytest.mark.parametrize("phased", [True, False])
def test_a_linear_oscillator_to_rounding(linear, measured, rate, phased):
    w, force, q = linear
    x = q * (1j * w) ** rate
    model = rs.ReducedModel.from_coefficients({"omega^2": 2.0, "c_linear": 1.0})
    fit = rs.fit_steady(model, w, force, x if phased else np.abs(x), measured=measured)
    assert fit.model.coefficients == pytest.approx({"omega^2": 1.0, "c_linear": 0.05}, rel=1e-9)
    assert fit.gain == pytest.approx(2.0, rel=1e-9)
    assert fit.chain.phase == pytest.approx(0.2 if phased else 0.0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("phased", [True, False])
def test_a_duffing_oscillator_with_folds_and_unstable_orbits(duffing, phased):
    w, f, q, stable = duffing
    assert np.sum(~stable) > 10
    fit = rs.fit_steady(START, w, f, q if phased else np.abs(q))
    assert fit.model.coefficients == pytest.approx(TRUE, rel=1e-6)
    assert fit.gain == pytest.approx(GAIN, rel=1e-6)


def test_what_is_known_is_kept(duffing):
    w, f, q, _ = duffing
    start = rs.ReducedModel.from_coefficients(TRUE | {"omega^2": 1.2})
    known = {"gain": GAIN, "phase": PHASE, "fixed": ("gamma_3", "c_linear")}
    fit = rs.fit_steady(start, w, f, q, **known)
    assert fit.free == ("omega^2",) and fit.chain == Chain(GAIN, 0.0, PHASE)
    assert fit.model.coefficients == pytest.approx(TRUE, rel=1e-6)


def test_higher_harmonics_count_where_they_are_measured(duffing):
    """From one long balance, whose other harmonics are put to the noise of the first."""
    model = rs.ReducedModel.from_coefficients(TRUE)
    orbits = rs.forced_response(model, 0.1, (0.7, 1.6), n_harmonics=15, n_points=40)
    q = orbits.coefficients[:, 1:4]
    fit = rs.fit_steady(START, orbits.frequency, np.full(len(q), 0.1), q)
    assert fit.model.coefficients == pytest.approx(TRUE, rel=1e-6)


def test_phase_resonance_gives_the_coefficients_where_the_gain_is_known():
    damped = DUFFING | {"c": 0.2}

    def harmonic(w, f):
        return oracle.steady(w, f, guess=complex(0, -f / (damped["c"] * w)), **damped)[0]

    points = []
    for f in (0.03, 0.06, 0.09, 0.12):
        w = brentq(lambda w, f=f: harmonic(w, f).real, 1.0, 1.2, xtol=1e-12)
        points.append((w, f, harmonic(w, f)))
    w, f, q = map(np.array, zip(*points, strict=True))
    assert np.max(np.abs(q.real)) < 1e-9
    fit = rs.fit_steady(START, w, f, q, gain=1.0, phase=0.0)
    assert fit.model.coefficients == pytest.approx(TRUE | {"c_linear": 0.2}, rel=1e-5)
    with pytest.raises(ValueError, match="give gain="):
        rs.fit_steady(START, w, f, q, phase=0.0)


def test_a_gain_that_grows(duffing):
    w, f, q, _ = duffing
    bent = 2 * f / (1 + np.sqrt(1 + 4 * 0.5 * f))  # f = (1 + 0.5 bent) bent
    fit = rs.fit_steady(START, w, bent, q, slope=None)
    assert fit.model.coefficients == pytest.approx(TRUE, rel=1e-6)
    assert fit.chain.slope == pytest.approx(0.5 * GAIN, rel=1e-4)


def test_derivatives_against_finite_differences():
    """Of the response by every parameter, -J^-1 dR/dp, whose other harmonics follow along."""
    keys = ("omega^2", "gamma_2", "gamma_3", "Upsilon_3", "c_linear", "c_quadratic")
    values = np.array([1.0, 0.2, 0.5, 0.1, 0.05, 0.02])
    omega, chain = 1.1, Chain(0.3, 0.02, 0.4)
    points = SteadyPoints.of(
        np.full(4, omega), np.full(4, 0.7), np.full(4, 1j), None, "displacement"
    )

    def response(p):
        model = rs.ReducedModel.from_coefficients(dict(zip(keys, p[:6], strict=True)))
        balance, c = HarmonicBalance(model, 9), np.zeros((19, 1))
        force = Chain(*p[6:]).force(np.array([0.7 + 0j]))[0]
        for _ in range(40):
            left, by_c, _ = balance.linearise(c, omega)
            left[1:3] -= force.real, -force.imag
            c = c - np.linalg.solve(by_c, left)[:, None]
        return model, c[:, 0]

    p = np.array([*values, *vars(chain).values()])
    model, c = response(p)
    rows = linearised(points, model, keys, chain, np.tile(c, (4, 1)))
    exact = -np.linalg.solve(rows.by_q[0], rows.by_parameter[0])
    for i, h in enumerate(1e-5 * np.maximum(np.abs(p), 0.1)):
        step = h * np.eye(len(p))[i]
        slope = (response(p + step)[1] - response(p - step)[1])[1:3] / (2 * h)
        assert exact[:, i] == pytest.approx(slope, rel=1e-6, abs=1e-8)


@pytest.mark.slow
def test_errors_hold_the_truth(duffing):
    w, f, q, _ = duffing
    truth = np.array([*TRUE.values(), GAIN, PHASE])
    scores, ratios = [], []
    for seed in range(48):
        fit = rs.fit_steady(START, w, f, q + noise_of(5e-3, len(w), seed), std=5e-3)
        found = np.array([*fit.model.coefficients.values(), fit.gain, fit.chain.phase])
        scores.append((found - truth) / np.sqrt(np.diag(fit.joint)))
        ratios.append(fit.adequacy)
    assert 0.92 <= np.mean(np.abs(scores) < 2) <= 0.98
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.03)


@pytest.mark.slow
def test_the_band_holds_a_level_that_took_no_part(duffing):
    """Its stable points beside the folds, each measured anew; the larger response of two."""
    w, f, q, _ = duffing
    wt, _, qt, stable = swept(0.08)
    order = np.argsort(wt)
    upper = [
        i
        for i in order
        if stable[i] and not np.any(np.abs(qt[(abs(wt - wt[i]) < 0.03)]) > abs(qt[i]) * 1.3)
    ]
    wt, qt = wt[upper], qt[upper]
    held = []
    for seed in range(12):
        fit = rs.fit_steady(START, w, f, q + noise_of(0.01, len(w), seed), std=0.01)
        band = rs.forced_response(fit, 0.08 / GAIN, (wt.min(), wt.max()), n_points=20)
        _, low, high = band.at(wt)
        seen = np.abs(qt + noise_of(0.01, len(wt), seed + 100))
        held.append((low <= seen) & (seen <= high))
    assert 0.9 <= np.mean(held) <= 0.99


def test_the_band_of_a_linear_oscillator_in_closed_form():
    model = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "c_linear": 0.1})
    fit = rs.fit_steady(model, *_noisy_linear(), std=1e-2, phase=0.0)
    w = np.array([0.8, 0.93, 1.0, 1.07, 1.2])
    band = rs.Estimate(fit.model, fit.free, fit.covariance, fit.verdict, ()).forced_response(
        0.2, (0.7, 1.3)
    )
    value, low, high = band.at(w)
    k, c = fit.model.coefficients.values()
    size = 0.2 / np.hypot(k - w**2, c * w)
    assert value == pytest.approx(size, rel=2e-3)
    slopes = -(size**3) / 0.04 * np.array([k - w**2, c * w**2])
    std = np.sqrt(np.einsum("pn,pq,qn->n", slopes, fit.covariance, slopes))
    assert high - low == pytest.approx(2 * 1.96 * std, rel=0.15)
    with pytest.raises(ValueError, match="lies outside"):
        band.at(1.4)
    with pytest.raises(ValueError, match="branch = 'outer'"):
        band.at(1.0, branch="outer")
    assert "largest" in repr(band)


def _noisy_linear():
    w = np.linspace(0.8, 1.2, 30)
    q = 0.2 / (1 - w**2 + 0.1j * w)
    return w, np.full(30, 0.2), q + noise_of(1e-2, 30, 1)


def test_both_branches_between_folds(duffing):
    w, f, q, _ = duffing
    fit = rs.fit_steady(START, w, f, q, std=1e-3)
    band = rs.forced_response(fit, 0.1 / GAIN, (0.8, 1.7))
    assert len(band.response.folds) == 2
    between = np.mean(band.response.frequency[band.response.folds])
    upper, lower = band.at(between), band.at(between, branch="lower")
    assert upper.low[0] > 2 * lower.high[0]


def test_terms_are_chosen_by_levels_that_take_no_part(duffing):
    w, f, q, _ = duffing
    noisy = q + noise_of(2e-3, len(w), 3)
    fit = rs.fit_steady(None, w, f, noisy, std=2e-3, slope=None, unit="m")
    assert set(fit.model.coefficients) == set(TRUE) and fit.chain.slope == 0
    assert fit.model.unit == "m" and fit.verdict.explained


@pytest.mark.slow
def test_drag_is_chosen_without_a_noise_level():
    """28 points of four levels: what noise leaves was a force in the choice, and hid a fifth of
    the damping, ten standard errors of it."""
    own = dict(c=0.0102, k=1.0, g=0.05, d=0.00082)
    points = []
    for f in np.geomspace(0.012, 0.03, 4):
        per_square = 8 / (3 * np.pi) * own["d"]  # f = c a + this a^2 in resonance
        top = (np.sqrt(own["c"] ** 2 + 4 * per_square * f) - own["c"]) / (2 * per_square)
        w, q, _ = oracle.curve(np.linspace(0.25, 0.95, 4) * top, f, **own, within=(0.3, 2.5))
        points.append(np.array([w, 0 * w + f, q])[:, np.argsort(w)])
    w, f, q = np.concatenate(points, axis=1)
    w, f = w.real, f.real
    assert len(w) == 28
    fits = [rs.fit_steady(None, w, f, q + noise_of(0.0127, len(w), seed)) for seed in range(4)]
    assert all(fit.verdict.explained for fit in fits)
    found = ["c_quadratic" in fit.model.coefficients for fit in fits]
    assert sum(found) >= 3  # one may have the cube of the speed, and say that it hardly tells


@pytest.mark.study
@pytest.mark.slow
def test_errors_count_terms_that_the_points_hardly_tell():
    """A weak drag and a weak spring beside noise: other powers do nearly the same."""
    truth = {"omega^2": 1.0, "gamma_3": 0.006, "c_linear": 0.02, "c_quadratic": 0.006, "gain": 2.0}
    own = dict(c=0.02, k=1.0, g=0.006, d=0.006)
    sizes = [(f, np.linspace(0.2, 0.8, 12) * f / 0.02) for f in (0.006, 0.013, 0.02)]
    points = [(f, *oracle.curve(a, f, **own, within=(0.9, 1.1))[:2]) for f, a in sizes]
    w, f, q = map(np.concatenate, zip(*((w, 0 * w + f, q) for f, w, q in points), strict=True))
    held, told = [], []
    for seed in range(12):
        fit = rs.fit_steady(None, w, f / 2, q + noise_of(5e-3, len(w), seed), std=5e-3)
        values = fit.model.coefficients | vars(fit.chain)
        errors = fit.standard_errors | fit.chain_errors
        held += [abs(values[n] - truth.get(n, 0.0)) < 1.96 * e for n, e in errors.items()]
        told += [any("the data hardly tell" in note for note in fit.notes)]
    assert 0.9 <= np.mean(held) <= 0.99
    assert np.mean(told) > 0.5


def test_a_model_that_lacks_a_term_says_so_and_widens_its_errors(duffing):
    w, f, q, _ = duffing
    model = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_5": 0.1, "c_linear": 0.04})
    fit = rs.fit_steady(model, w, f, q + noise_of(1e-3, len(w), 0), std=1e-3)
    assert not fit.verdict.explained and fit.unexplained > 0.01
    text = str(fit)
    assert "of the force goes with the motion" in text and "gain" in text and "not explain" in text
    assert fit.standard_errors["omega^2"] > 5e-3
    assert "steady states" in repr(fit)


def test_an_estimate_is_saved_without_its_points(linear):
    fit = rs.fit_steady(
        rs.ReducedModel.from_coefficients({"omega^2": 1.0, "c_linear": 0.1}), *linear
    )
    again = rs.Estimate.from_json(fit.to_json())
    assert again.model == fit.model and again.notes == fit.notes
    assert np.max(np.abs(fit.residuals)) < 1e-9


def test_a_point_that_is_no_steady_state_is_told(duffing):
    w, f, q, _ = duffing
    order = np.lexsort((np.abs(q), np.angle(q), f))
    w, f, q = w[order], f[order], q[order] + noise_of(1e-3, len(w), 0)
    q[30] *= 1.2
    std = np.full(len(w), 1e-3)
    std[12] = 0.05
    notes = " ".join(rs.fit_steady(START, w, f, q, std=std).notes)
    assert f"off their neighbours: {w[30] / (2 * np.pi):.6g} Hz" in notes
    assert f"far noisier than others: {w[12] / (2 * np.pi):.6g} Hz" in notes


def test_a_wrong_sense_of_phase_or_quantity(linear):
    w, force, q = linear
    model = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "c_linear": 0.1})
    with pytest.raises(ValueError, match=r"give response.conj\(\)"):
        rs.fit_steady(model, w, force, q.conj())
    with pytest.raises(ValueError, match="give -force"):
        rs.fit_steady(model, w, force, -q * np.exp(-0.2j), phase=0.0)
    assert "turns the phase by" in " ".join(rs.fit_steady(model, w, force, 1j * w * q).notes)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"frequency": np.ones((2, 2))}, "frequency has the shape"),
        ({"force": np.ones(3)}, r"force has the shape \(3,\), but frequency has 24 values"),
        ({"response": np.ones(5)}, "response has the shape"),
        ({"force": np.zeros(24)}, "force is 0 in 24 of 24 steady states"),
        ({"force": np.full(24, np.nan)}, "force is not finite"),
        ({"response": np.full(24, np.inf)}, "response is not finite"),
        ({"response": np.full(24, -1.0)}, "response is real and negative"),
        ({"response": np.ones((24, 2))}, "several harmonics and no phases"),
        ({"response": np.zeros(24)}, "first harmonic of 0"),
        ({"frequency": np.linspace(-1, 1, 24)}, "frequency = -1 is not positive"),
        ({"frequency": 1j * np.ones(24)}, "frequency must be real"),
        ({"std": np.zeros(24)}, "std must be positive"),
        ({"std": np.ones(3)}, "std has the shape"),
        ({"measured": "strain"}, "measured = 'strain' must be one of"),
        ({"gain": np.inf}, "gain = inf must be finite"),
        ({"slope": None}, "force has one amplitude"),
        ({"fixed": ("gamma_9",)}, r"fixed names \['gamma_9'\]"),
        ({"model": 3}, "model is int"),
        ({"model": None, "fixed": ("omega^2",)}, "needs a model"),
        (
            {
                "model": rs.ReducedModel.from_coefficients({"omega^2": 1.0, "c_linear": 0.1}),
                "some": 3,
            },
            "at least 4",
        ),
    ],
)
def test_what_is_refused(linear, change, words):
    model = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "c_linear": 0.1})
    change = dict(change)
    some = slice(change.pop("some", None))
    names = ("frequency", "force", "response")
    given = {"model": model, **{n: x[some] for n, x in zip(names, linear, strict=True)}, **change}
    with pytest.raises(ValueError, match=words):
        rs.fit_steady(**given)


def test_more_coefficients_than_points_tell(linear):
    names = ("omega^2", "gamma_3", "gamma_5", "gamma_7", "c_linear", "c_cubic")
    model = rs.ReducedModel.from_coefficients(dict.fromkeys(names, 0.1))
    with pytest.raises(ValueError, match="frequency has 4 values, too few for 8 unknowns"):
        rs.fit_steady(model, *(x[::7] for x in linear))
    twice = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "c_linear": 0.1, "c_q^2 q_dot": 0.0})
    w = np.linspace(0.9, 1.1, 6)
    with pytest.raises(ValueError, match="do not tell c_linear from c_q"):
        rs.fit_steady(twice, w, 0.05 * w, -1j + 0 * w, gain=1.0, phase=0.0)


@pytest.mark.slow
def test_a_measured_beam_its_fourth_level_foretold(measured):
    folder = Path(__file__).resolve().parents[1] / "benchmarks"
    file = measured / "stepped_sine_beam_eth.npz"
    if not file.is_file():
        pytest.skip(f"{file.name} is not beside the project")
    sys.path.insert(0, str(folder))
    try:
        benchmark = importlib.import_module("stepped_sine")
    finally:
        sys.path.remove(str(folder))
    sweeps = benchmark.Sweeps.read(file)
    for level, rms in ((0.1, 0.03), (0.45, 0.05)):
        found = benchmark.predicted(sweeps, level)
        assert found.rms < rms and abs(found.resonance) < 0.004
        assert 0.85 <= found.held <= 1 and found.score < found.constant


@pytest.mark.slow
def test_what_goes_with_the_motion_needs_no_noise_level(duffing):
    """A spring that is missing is noticed, and named, where the spread of the points is not known;
    of the right terms no more than chance says is: 2 of 10 at 1 % each in four trials in 1,000."""
    w, f, q, _ = duffing
    alarms = 0
    for seed in range(10):
        verdict = rs.fit_steady(START, w, f, q + noise_of(3e-3, len(w), seed)).verdict
        alarms += not verdict.explained
        assert verdict.unknown < 0.01 < verdict.part  # noise is that of the response
    assert alarms < 2
    linear = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "c_linear": 0.04})
    verdict = rs.fit_steady(linear, w, f, q + noise_of(3e-3, len(w), 0)).verdict
    assert not verdict.explained and verdict.p_value < 1e-6
    assert verdict.missing > 0.1 and "does not explain" in str(verdict)


def test_a_wrong_gain_goes_with_the_excitation(duffing):
    w, f, q, _ = duffing
    fit = rs.fit_steady(START, w, f, q + noise_of(1e-3, len(w), 1), std=1e-3, gain=1.05 * GAIN)
    assert not fit.verdict.explained and "gain of the force" in fit.verdict.like


def test_a_verdict_of_steady_states_is_saved(duffing, tmp_path):
    w, f, q, _ = duffing
    fit = rs.fit_steady(START, w, f, q + noise_of(1e-3, len(w), 1))
    fit.save(tmp_path / "fit.json")
    assert str(rs.Estimate.load(tmp_path / "fit.json").verdict) == str(fit.verdict)


def test_few_points_are_not_tried(linear):
    w, force, q = linear
    model = rs.ReducedModel.from_coefficients({"omega^2": 2.0, "c_linear": 1.0})
    some = slice(None, None, 4)
    noisy = q[some] + noise_of(1e-2, 6, 0)
    known = rs.fit_steady(model, w[some], force[some], noisy, std=1e-2).verdict
    assert known.explained and "too few to try" in str(known)
    assert not rs.fit_steady(model, w[some], force[some], noisy).verdict.explained


@pytest.mark.parametrize("given", [True, False])
def test_a_sensor_that_bends_with_frequency_is_no_noise_that_drifts(linear, given):
    """By a square of it, which no term of the equation does: it was taken for noise."""
    w, force, q = linear
    bent = q * (1 + 4.0 * (w - w.mean()) ** 2)
    std = 0.002 * np.abs(q).max()
    start = rs.ReducedModel.from_coefficients({"omega^2": 1.1, "c_linear": 0.1})
    wrong, right = (
        rs.fit_steady(start, w, force, x + noise_of(std, 24, 5), std=std if given else None)
        for x in (bent, q)
    )
    assert not wrong.verdict.explained and "other frequencies" in str(wrong.verdict)
    assert right.verdict.explained


def test_order_and_turns_of_the_phase_tell_nothing():
    """A linear oscillator by its closed form: shuffled, and with phases that wrap."""
    w, rng = np.tile(np.linspace(0.9, 1.1, 12), 2), np.random.default_rng(0)
    force = np.repeat([1.0, 2.0], 12)
    x = force / (1 - w**2 + 0.05j * w)
    model = rs.ReducedModel.from_coefficients({"omega^2": 1.1, "c_linear": 0.1})
    some = rng.permutation(len(w))
    turned = np.abs(x) * np.exp(1j * (np.angle(x) + 2 * np.pi * rng.integers(-2, 3, len(w))))
    for order, response in ((some, x), (slice(None), turned)):
        found = rs.fit_steady(model, w[order], force[order], response[order]).model.coefficients
        assert found == pytest.approx({"omega^2": 1.0, "c_linear": 0.05}, rel=1e-6)


def test_the_force_surface_is_that_of_the_orbits():
    """Of two levels, by continuation, the unstable branch too; a shaker that gives less at more."""
    model = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_3": 0.8, "c_linear": 0.05})
    w, f, x = [], [], []
    for force in (0.02, 0.04):
        orbits = rs.forced_response(model, force * (2.0 - 3.0 * force), (0.8, 1.7), n_points=60)
        assert not orbits.stable.all()
        w, f = [*w, orbits.frequency], [*f, np.full(len(orbits), force)]
        x.append(orbits.coefficients[:, 1] * 1j * orbits.frequency)
    w, f, x = map(np.concatenate, (w, f, x))
    fit = rs.fit_steady(model, w, f, x, measured="velocity", slope=None)
    # Harmonics beyond the third are in the orbits.
    np.testing.assert_allclose(fit.force_surface(w, np.abs(x)), f, rtol=2e-3)
    assert np.isnan(fit.force_surface(0.9, 50.0))  # no force of that shaker is so large
    with pytest.raises(ValueError, match="amplitude must be positive"):
        fit.force_surface(1.0, 0.0)
