"""Hits: what a force sensor shows where the force rests, and how well samples tell an impulse."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import romsindy as rs
from romsindy.effects.outside import Impulses
from romsindy.fit.kernel.hypothesis import NormalEquations
from romsindy.fit.kernel.part import Part
from romsindy.physics.input import Input
from romsindy.record.forced import ForceWindow

N = 4000


def pulses(places, width, size=1.0, zero=0.0, noise=0.002, seed=0):
    """Half sines that begin at places, both in samples, with noise and a zero that is off."""
    n = np.arange(N)
    x = (n[:, None] - np.asarray(places)) / width
    u = size * np.sum(np.where((x > 0) & (x < 1), np.sin(np.pi * x), 0.0), axis=1)
    return u + zero + noise * size * np.random.default_rng(seed).standard_normal(N)


def test_a_force_is_zero_where_it_rests():
    window = ForceWindow.of(pulses([500.3, 2500.7], 20, zero=0.3))
    assert [h.at.start < 500 and h.at.stop > 520 for h in window.hits] == [True, False]
    assert len(window.hits) == 2
    outside = np.ones(N, bool)
    for hit in window.hits:
        assert hit.at.stop - hit.at.start < 60
        outside[hit.at] = False
    assert not np.any(window.u[outside])
    assert abs(window.u[511] - 1.0) < 0.05  # the peak, its zero taken off


@pytest.mark.parametrize("width", [6.3, 15.6])
def test_errors_of_impulses_hold(width):
    """200 half sines that begin anywhere between two samples: 2 size width / pi is exact."""
    rng, off = np.random.default_rng(1), []
    for seed in range(100):
        window = ForceWindow.of(pulses(rng.uniform([800, 2800], [801, 2801]), width, seed=seed))
        sums = [window.u[h.at].sum() / (2 * width / np.pi) - 1 for h in window.hits]
        off += [s / h.error for s, h in zip(sums, window.hits, strict=True)]
    # The standard deviation of 200 is good to 5 %, the slope of a kink to some 20 %.
    assert 0.7 < np.std(off) < 1.2


OTHERS = {
    "a sine": np.sin(np.arange(N) / 9),
    "a sine that grows": np.arange(N) * np.sin(np.arange(N) / 9),
    "random": np.random.default_rng(2).standard_normal(N),
    "a square wave": np.sign(np.sin(np.arange(N) / 300)),
    "levels with noise": np.sign(np.sin(np.arange(N) / 300))
    + 0.001 * np.random.default_rng(3).standard_normal(N),
    "a ramp": np.arange(N) / N,
    "a sweep": np.sin((np.arange(N) / 400) ** 3),
    # What goes on slowly after a blow is a force.
    "a blow and a slow force": pulses([400], 20, noise=0.0) + 0.01 * np.sin(np.arange(N) / 50),
}


@pytest.mark.parametrize("name", OTHERS)
def test_other_forces_stay_as_they_are(name):
    window = ForceWindow.of(OTHERS[name])
    assert window.u is OTHERS[name] and not window.hits


def test_a_shaker_that_is_switched_off_rests_and_is_no_hit():
    drive = np.where(np.arange(N) < 2500, np.sin(np.arange(N) / 9), 0.0)
    window = ForceWindow.of(drive + 1e-3 * np.random.default_rng(4).standard_normal(N))
    assert not window.hits
    assert not np.any(window.u[-1000:]) and np.ptp(window.u[:1000]) > 1.9


def test_what_is_known_beforehand_counts_in_errors_by_colour():
    """Of a value that the data do not tell the error is what was known, whatever the colour."""
    part = Part(Impulses(Input(), (1.0,)), (), np.zeros((1, 1)), tolerance=0.02)
    rng = np.random.default_rng(5)
    rows = np.column_stack([np.zeros(300), *rng.standard_normal((3, 300))])
    system = NormalEquations(1, 1)
    where = np.arange(3)
    system.add(where, rows)
    system.add_priors([part])
    assert_allclose(system.coloured([(where, rows)])[0, 0], 0.02**2, rtol=1e-9)


@pytest.fixture
def hammer():
    folder = str(Path(__file__).resolve().parents[1] / "benchmarks")
    sys.path.insert(0, folder)
    try:
        import hammer

        yield hammer
    finally:
        sys.path.remove(folder)


@pytest.mark.parametrize("seed", [5, 25], ids=["displacement", "acceleration, three hits"])
def test_hit_and_decay_are_one_record(hammer, seed):
    """By another integrator; before, noise of the force sensor was taken for a force."""
    record, mass, truth = hammer.hit(seed)
    fit = rs.identify(record)
    low, high = fit.interval("gain [force]")
    assert {*fit.model.coefficients} == truth and fit.verdict.explained
    assert any(note.startswith("force: 0 beside its ") for note in fit.notes)
    assert low <= 1 / mass <= high and high - low < 0.03 / mass


@pytest.mark.slow
def test_small_benchmark_of_hits(hammer):
    explained, exact, inside = hammer.main(["--first", "101", "--count", "4"])
    assert (explained, exact) == (4, 4) and inside >= 3
