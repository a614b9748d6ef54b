"""Least squares on all sensors, against what two modes do in closed form."""

import numpy as np
import pytest

import romsindy as rs
from romsindy.diagnosis.on_simulator.seen import Beginning, OnSimulator, ValueEffect
from romsindy.diagnosis.on_simulator.sensor_fit import SensorFit, SensorRecord, known_rows, told
from romsindy.effects.base import Scales
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Combination
from romsindy.simulator.simulator import Simulator

RATE, OTHER, SLOW = 6.0, 26.3, 0.03
SHAPES = np.array([[1.0, 0.6], [0.12, -0.2]])  # of the slow mode, and of another as it rings
SIZE, T = 0.02, np.arange(1600) * 2 * np.pi / RATE / 40
MODEL = rs.ReducedModel.from_coefficients({"omega^2": RATE**2 + SLOW**2, "c_linear": 2 * SLOW})
KNOWN = {"stiffness": 0.03, "mass": 0.02}


def simulate(release, t, stiffness=1.0, mass=1.0, other=1.0):
    """Both modes are as fast as the root of stiffness over mass."""
    faster = np.sqrt(stiffness / mass)
    cosines = np.cos(faster * np.outer(t, [RATE, OTHER])) * [1.0, other]
    return release / SHAPES[:, 0].sum() * np.exp(-SLOW * t)[:, None] * (cosines @ SHAPES)


def fit_of(ratio):
    """A simulator beside a truth with so much more stiffness, whose other mode is louder."""
    x = simulate(SIZE, T, ratio, other=1.3)
    noise = 1e-3 * x.std(axis=0)
    x = x + noise * np.random.default_rng(3).standard_normal(x.shape)
    reading = np.linalg.pinv(SHAPES.T)[0]
    seen = OnSimulator(
        *(Simulator.of(simulate), np.array([1.0, 0.6]), reading, dict.fromkeys(KNOWN, 1.0)),
        released=[(SHAPES[:, 0].sum(), 1.0)],
    )
    record = Record.of(seen.decay(rs.Decay(T, x, unit="m")), 1e-6)
    return SensorFit(seen, MODEL, [record], [SensorRecord(x, noise)], 1)


def parts_of(stiffness, mass):
    values = {"stiffness": stiffness, "mass": mass}
    omega2 = MODEL.coefficients["omega^2"]
    found = []
    for sign, (name, x) in zip((1, -1), values.items(), strict=True):
        law = Combination(name, (Stiffness(1),), (sign * omega2,))
        part = Part.of(ValueEffect(name, 1.0, law, KNOWN[name]), Scales(SIZE, RATE, 10.0), 1)
        found.append(part.moved(np.array([x - 1]) - part.values))
    return tuple(found)


def test_values_that_do_the_same_together_are_as_near_as_they_are_known():
    """Their ratio is that of the records; along it the least of what is known is in closed form.

    Errors of differences, times what another mode leaves of the records, hold them elsewhere else.
    """
    ratio = 1.04
    begins = [Beginning(0, (SIZE / SHAPES[:, 0].sum(), 0.0))]
    fitted = fit_of(ratio).grown(parts_of(0.9 * ratio, 0.9), begins)
    stiffness, mass = (1 + float(p.values[0]) for p in fitted.parts)
    assert stiffness / mass == pytest.approx(ratio, rel=1e-4)
    weights = np.array([ratio / KNOWN["stiffness"] ** 2, 1 / KNOWN["mass"] ** 2])
    likeliest = weights.sum() / (weights @ [ratio, 1.0])
    assert mass == pytest.approx(likeliest, abs=2e-3)


def test_what_is_known_is_a_row_each():
    """Two values off by three and two standard deviations, among three unknowns."""
    rows, left = known_rows(parts_of(1.09, 0.96), 3)
    assert rows == pytest.approx(np.array([[1 / 0.03, 0, 0], [0, 1 / 0.02, 0]]))
    assert left == pytest.approx([-3.0, 2.0])


def test_columns_that_are_told_stay_and_others_lose_what_they_do_together():
    rng = np.random.default_rng(2)
    one, two = rng.normal(size=(2, 50))
    both = np.stack([one, 5 * one + 1e-6 * two, two], axis=1)
    found = told(both)
    assert np.linalg.matrix_rank(found, tol=1e-9) == 2
    assert np.abs(found - both).max() < 1e-5
    assert told(both[:, [0, 2]]) == pytest.approx(both[:, [0, 2]], abs=1e-12)
