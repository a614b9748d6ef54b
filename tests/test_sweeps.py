"""Sweeps known by amplitude: lags, jumps and their delays, against the equation in time."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import romsindy as rs
from romsindy.commands.main import main
from romsindy.fit.steady.balance import Chain, SteadyPoints
from romsindy.fit.steady.sweeps import Sweeps, orbits_of
from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.orbits.sweeps import jumps

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import sweeps

sys.path.pop(0)

HARD = 17  # seed of a hardening structure with linear damping


@pytest.fixture(scope="module")
def one():
    structure = sweeps.Structure(HARD)
    assert (structure.form, structure.loss) == ("cubic", "linear")
    structure.rows = 110
    return structure


@pytest.fixture(scope="module")
def table(one):
    return one.table()


@pytest.fixture(scope="module")
def true(one):
    k, _, k3, _, c, *_ = one.law
    return rs.ReducedModel.from_coefficients({"omega^2": k, "gamma_3": k3, "c_linear": c}, "m")


def solution(model):
    """Of a model that is known, under forces per unit mass."""
    return SimpleNamespace(model=model, chain=Chain(1.0, 0.0, 0.0))


def test_folds_of_one_harmonic_in_closed_form(true):
    """(k - w^2 + 3/4 g x)^2 x + (c w)^2 x = f^2, x = A^2, is level in x at both, at fixed w."""
    k, g, c = (true.coefficients[n] for n in ("omega^2", "gamma_3", "c_linear"))
    f = 4.0 * c * np.sqrt(k) * np.sqrt(8 / 3 * 0.02 * k / g)
    response = rs.forced_response(true, f, (0.97 * np.sqrt(k), 1.5 * np.sqrt(k)), 1)
    assert len(response.folds) == 2
    for i in response.folds:
        w = response.frequency[i]
        a, b = k - w**2, 0.75 * g
        roots = (-2 * a + np.array([1, -1]) * np.sqrt(a**2 - 3 * (c * w) ** 2)) / (3 * b)
        force = np.sqrt(((a + b * roots) ** 2 + (c * w) ** 2) * roots)
        assert np.min(np.abs(force / f - 1)) < 1e-6


@pytest.mark.parametrize("up", [True, False])
def test_a_delay_is_that_of_the_equation_in_time(one, true, up):
    """By its slow motion: what the amplitude changes in a cycle, parts in a hundred, is lost."""
    response = rs.forced_response(true, one.force, one.range)
    ((fold, delay),) = jumps(true, response, one.rate if up else -one.rate)
    late = one.jump(1.0, up) - response.frequency[fold]
    assert abs(late) > 2e-3 * response.frequency[fold] and delay == pytest.approx(late, rel=0.05)


def test_a_delay_grows_with_the_rate_to_two_thirds(one, true):
    response = rs.forced_response(true, one.force, one.range)
    slow, fast = (jumps(true, response, rate * one.rate)[0].delay for rate in (1e-3, 8e-3))
    # What the jump itself takes grows with the rate: a few hundredths of the delay here.
    assert fast / slow == pytest.approx(4, rel=0.05)


def test_rows_between_jumps_are_steady_without_their_lag(one, true):
    """The force that their orbits need is that of the level, without noise."""
    quiet = [
        np.array([w, 0 * w + one.force, a])[:, ::12]
        for w, a in (one.sweep(1.0, up, one.range) for up in (True, False))
    ]
    w, f, a = np.concatenate(quiet, axis=1)
    points = SteadyPoints.of(w, f, a, 0.01 * a, "displacement")
    swept = Sweeps.of(points, one.rate)
    assert [sweep.last is None for sweep in swept.each] == [False, False]
    steady, notes = swept.steady(solution(true), True)
    assert not notes and np.sum(steady.frequency_std > 0) == 2
    large = (steady.frequency_std == 0) & (steady.amplitude > 0.3 * a.max())
    balance = HarmonicBalance(true, 5)

    def left(w, amplitude):
        return np.abs(orbits_of(balance, w, amplitude)[1] / one.force - 1)

    without = left(steady.frequency, steady.amplitude)[large]
    same = np.isin(w, steady.frequency[large])
    assert np.sum(large) > 50 and np.median(without) < 0.1 * np.median(left(w, a)[same])


def test_rows_after_a_jump_that_is_hardly_one_take_no_part():
    """A level just above that which folds first: its swinging was taken for steady states."""
    small = sweeps.Structure(126)
    k, _, k3, _, c, *_ = small.law
    true = rs.ReducedModel.from_coefficients({"omega^2": k, "gamma_3": k3, "c_linear": c}, "m")
    level = sweeps.LEVELS[0]
    w, a = small.sweep(level, True, small.range)
    at = np.linspace(*small.range, small.rows)
    a = np.interp(at, w, a)
    points = SteadyPoints.of(at, 0 * at + level * small.force, a, 0.01 * a, "displacement")
    swept = Sweeps.of(points, small.rate)
    assert swept.each[0].last is None
    steady, _ = swept.steady(solution(true), True)
    assert len(steady) > 0.8 * len(at)
    needed = orbits_of(HarmonicBalance(true, 5), steady.frequency, steady.amplitude)[1]
    # 0.25 of the force in the swinging; else lag to first order, and rows between samples.
    assert np.abs(needed / (level * small.force) - 1).max() < 0.03


@pytest.mark.slow
def test_a_level_that_is_not_given(one, table, true):
    fit = rs.fit_steady(None, *table, unit="m", sweep_rate=one.rate)
    assert {*fit.model.coefficients} == {*true.coefficients} and fit.verdict.explained
    band = fit.forced_response(one.unseen * one.force, one.wide)
    for up in (True, False):
        exact = one.jump(one.unseen, up)
        (jump,) = band.jumps(one.rate if up else -one.rate)
        assert jump.low < exact < jump.high and abs(jump.frequency / exact - 1) < 3e-3
    with pytest.raises(ValueError, match=r"sweep_rate = 0 must be finite and not 0"):
        band.jumps(0)


@pytest.mark.slow
def test_rates_are_a_column_or_an_option(one, table, true, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    w, f, a = table
    hz = one.rate / (2 * np.pi)
    way = np.repeat([hz, -hz, hz, -hz], one.rows)
    header = "frequency [Hz],force [N],displacement [mm]"
    columns = np.column_stack([w / (2 * np.pi), f, 1e3 * a, way])
    np.savetxt("a.csv", columns[:, :3], "%.15g", ",", header=header, comments="")
    mixed = columns[np.random.default_rng(0).permutation(len(columns))]
    np.savetxt("b.csv", mixed, "%.15g", ",", header=header + ",sweep rate [Hz/s]", comments="")
    found = []
    for arguments in (["a.csv", "--sweep-rate", str(hz)], ["b.csv"]):
        run = CliRunner().invoke(main, ["steady", *arguments, "--term", "gamma_3", "--json", "-"])
        assert run.exit_code == 0, run.output
        (content,) = json.loads(run.stdout)
        found.append({n: entry["value"] for n, entry in content["coefficients"].items()})
    assert found[0] == pytest.approx(found[1], rel=1e-6)
    assert found[0] == pytest.approx(true.coefficients, rel=0.05)
    both = CliRunner().invoke(main, ["steady", "b.csv", "--sweep-rate", "1"])
    assert both.exit_code == 2 and "leave out one of them" in both.stderr


def linear_sweep(n=60):
    w = np.linspace(0.8, 1.2, n)
    return w, np.full(n, 0.3), np.abs(0.3 / (1 - w**2 + 0.05j * w))


LINEAR = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "c_linear": 0.05})


def test_a_resonance_is_no_jump():
    swept = Sweeps.of(SteadyPoints.of(*linear_sweep(), None, "displacement"), 1e-5)
    assert [sweep.last for sweep in swept.each] == [None]


def test_a_jump_that_is_none_takes_no_part():
    """Where a sensor slipped; the model is linear, and has no fold."""
    w, f, x = linear_sweep(120)
    x[100:] *= 20
    swept = Sweeps.of(SteadyPoints.of(w, f, x, 0.01 * x, "displacement"), 1e-5)
    points, notes = swept.steady(solution(LINEAR), True)
    assert [sweep.last for sweep in swept.each] == [99] and not np.any(points.frequency_std)
    assert "amplitude changes as in a jump, where the model has none at 0.3" in notes[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sweep_rate": 0.0}, "sweep_rate = 0.0 must be positive and finite, in rad/s"),
        ({"sweep_rate": -1.0}, "whether a sweep rises or falls follows from the order"),
        ({"sweep_rate": np.zeros(60)}, "sweep_rate must be a number, or 60 that are finite"),
        ({"sweep_rate": np.ones(3)}, "sweep_rate must be a number, or 60 that are finite"),
        ({"frequency": linear_sweep()[0][np.argsort(np.arange(60) * 7 % 60)]}, "in the order of"),
        ({"response": linear_sweep()[2] + 0j}, r"give abs\(response\)"),
    ],
)
def test_what_is_refused_of_sweeps(change, words):
    w, f, x = linear_sweep()
    given = {"frequency": w, "force": f, "response": x, "sweep_rate": 1e-3} | change
    with pytest.raises(ValueError, match=words):
        rs.fit_steady(LINEAR, **given)
