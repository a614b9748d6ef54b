"""Points of a laboratory: a level that is told wrong, a response that is held, folds."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import romsindy as rs
from romsindy.fit.steady.balance import SteadyPoints

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import driven_modes
import steady_points

sys.path.pop(0)


def levels(force, response):
    w = np.linspace(5.0, 6.0, len(force))
    return SteadyPoints.of(w, force, response, None, "displacement").level.tolist()


def test_levels_are_of_the_force_or_of_a_response_that_is_held():
    """Of a controlled response the force differs from point to point, and noise is 1 %."""
    rng = np.random.default_rng(0)
    held = np.repeat([0.1, 0.2, 0.4], 6)
    noisy = held * (1 + 0.01 * rng.standard_normal(18)) + 0j
    force = rng.uniform(1.0, 2.0, 18)
    assert levels(force, noisy) == np.repeat([0, 1, 2], 6).tolist()
    assert levels(np.repeat([1.0, 2.0, 3.0], 6), force + 0j) == np.repeat([0, 1, 2], 6).tolist()
    assert levels(force, np.linspace(0.1, 0.4, 18) + 0j) == [0] * 18


@pytest.mark.parametrize("seed", [8, pytest.param(7, marks=pytest.mark.slow)])
def test_no_term_makes_up_for_a_level_that_is_told_wrong(seed):
    """A branch, and a response that is held; 2 % wrong at one of three levels."""
    one, _, w, force, response, spread = steady_points.measured(seed)
    fit = rs.fit_steady(None, w, force, response, std=spread, unit="m")
    assert {*fit.model.coefficients} == {*one.truth}
    for name, value in one.truth.items():
        low, high = fit.interval(name)
        assert low <= value <= high, name


@pytest.mark.parametrize("phased", [True, False])
@pytest.mark.parametrize(("more", "said"), [(0.0, False), (0.05, True)])
def test_a_level_that_stands_twice_with_other_values_is_told(more, said, phased):
    """The second time the force was larger than its column says."""
    beam = rs.ReducedModel.from_coefficients(
        {"omega^2": 2500.0, "gamma_3": 2e6, "c_linear": 0.8}, unit="m"
    )
    rng, columns = np.random.default_rng(2), []
    for level, true in ((0.1, 0.1), (0.2, 0.2), (0.2, 0.2 * (1 + more))):
        orbits = rs.forced_response(beam, true, (48.0, 54.0), n_points=120)
        w, q = orbits.frequency[::3], orbits.coefficients[::3, 1]
        columns.append((w, np.full(len(w), level), q))
    w, force, q = map(np.concatenate, zip(*columns, strict=True))
    noise = 0.01 * rng.standard_normal((len(q), 2)) @ [1, 1j]
    q = q * (1 + noise) if phased else np.abs(q) * (1 + noise.real)
    fit = rs.fit_steady(beam, w, force, q, unit="m", **({"phase": 0.0} if phased else {}))
    notes = [note for note in fit.notes if "stands twice" in note]
    assert bool(notes) == said
    if phased:  # as a display rounds them, so that many are alike
        q = np.abs(q) * np.exp(1j * np.radians(np.round(np.degrees(np.angle(q)))))
        rounded = rs.fit_steady(beam, w, force, q, unit="m", phase=0.0)
        assert any("stands twice" in note for note in rounded.notes) == said
    if said:
        rows = len(columns[0][0]), len(columns[0][0]) + len(columns[1][0])
        assert f"the level of 0.2 stands twice, in points {rows[0] + 1} to" in notes[0]


def test_noise_leaves_noise_at_folds():
    """There the frequency tells the force to a millionth, as no error of a value allows."""
    named = {"omega^2": 2500.0, "gamma_3": 2e6, "c_linear": 0.8}
    beam = rs.ReducedModel.from_coefficients(named, unit="m")
    rng, orbits = np.random.default_rng(3), rs.forced_response(beam, 0.3, (48.0, 54.0), n_points=60)
    assert len(orbits.folds) == 2
    exact, n = orbits.coefficients[:, 1], len(orbits.frequency)
    spread = 0.001 * np.abs(exact)
    q = exact + spread * (rng.standard_normal((n, 2)) @ [1, 1j])
    fit = rs.fit_steady(beam, orbits.frequency, np.full(n, 0.3), q, std=spread)
    assert 0.8 < fit.verdict.ratio < 1.2  # 120 parts: one standard deviation is 0.065


def test_folds_have_intervals():
    """Against those of the true equation, by continuation; the other level learns none of them."""
    named = {"omega^2": 2500.0, "gamma_3": 2e6, "c_linear": 0.8}
    beam = rs.ReducedModel.from_coefficients(named, unit="m")
    rng = np.random.default_rng(1)
    w, force, q = [], [], []
    for level in (0.1, 0.2):
        orbits = rs.forced_response(beam, level, (48.0, 54.0), n_points=120)
        w.append(orbits.frequency[::3])
        force.append(np.full(len(w[-1]), level))
        q.append(orbits.coefficients[::3, 1])
    w, force, q = map(np.concatenate, (w, force, q))
    spread = 0.01 * np.abs(q)
    q = q + spread * (rng.standard_normal(len(q)) + 1j * rng.standard_normal(len(q)))
    fit = rs.fit_steady(beam, w, force, q, std=spread, phase=0.0)
    true = rs.forced_response(beam, 0.4, (48.0, 54.0))
    band = fit.forced_response(0.4, (48.0, 54.0))
    folds = true.frequency[true.folds]
    assert len(band.folds) == len(folds) == 2
    for fold, exact in zip(band.folds, folds, strict=True):
        assert fold.low <= exact <= fold.high and fold.high - fold.low < 0.01 * exact
    assert f"Fold at {band.folds[0].frequency:.6g} rad/s" in str(band)


@pytest.mark.slow
def test_small_benchmark_of_points():
    right, holds, inside, (held, folds) = steady_points.main(["--first", "306", "--count", "6"])
    assert right == 6 and holds > 0.9 and inside > 0.9 and held == folds


@pytest.mark.slow
def test_small_benchmark_of_driven_modes():
    """A sweep whose first mode is so nonlinear that a linear look hears no second one."""
    assert driven_modes.main(["--first", "77", "--count", "1"])[:2] == (1, 1)
