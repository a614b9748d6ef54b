"""Least squares on all sensors, against what two modes do in closed form."""

from dataclasses import replace

import numpy as np
import pytest

import romsindy as rs
from romsindy.diagnosis.all_sensors import Readings
from romsindy.diagnosis.on_simulator.seen import Beginning, OnSimulator, ValueEffect
from romsindy.diagnosis.on_simulator.sensor_fit import SensorFit, known_rows, told
from romsindy.effects.base import Scales
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Combination
from romsindy.record.noise import Noise
from romsindy.simulator.simulator import Simulator

RATE, OTHER, SLOW = 6.0, 26.3, 0.03
SHAPES = np.array([[1.0, 0.6], [0.12, -0.2]])  # of the slow mode, and of another as it rings
SIZE, T = 0.02, np.arange(1600) * 2 * np.pi / RATE / 40
MODEL = rs.ReducedModel.from_coefficients({"omega^2": RATE**2 + SLOW**2, "c_linear": 2 * SLOW})
KNOWN = {"stiffness": 0.03, "mass": 0.02}


def simulate(release, t, stiffness=1.0, mass=1.0, other=1.0, faster_other=1.0):
    """Both modes are as fast as the root of stiffness over mass."""
    faster = np.sqrt(stiffness / mass)
    cosines = np.cos(faster * np.outer(t, [RATE, faster_other * OTHER])) * [1.0, other]
    return release / SHAPES[:, 0].sum() * np.exp(-SLOW * t)[:, None] * (cosines @ SHAPES)


def fit_of(ratio, **truth):
    """A simulator beside a truth with so much more stiffness, whose other mode is another."""
    x = simulate(SIZE, T, ratio, **truth)
    noise = 1e-3 * x.std(axis=0)
    x = x + noise * np.random.default_rng(3).standard_normal(x.shape)
    reading = np.linalg.pinv(SHAPES.T)[0]
    seen = OnSimulator(
        *(Simulator.of(simulate), np.array([1.0, 0.6]), reading, dict.fromkeys(KNOWN, 1.0)),
        released=[(SHAPES[:, 0].sum(), 1.0)],
    )
    record = Record.of(seen.decay(rs.Decay(T, x, unit="m")), 1e-6)
    noises = tuple(Noise.white(std, T[1]) for std in noise)
    read = Readings(T, x, noises).unsure(seen.coordinate(x), RATE)
    return SensorFit(seen, MODEL, [record], [read], 1)


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
    fitted = fit_of(ratio, other=1.3).grown(parts_of(0.9 * ratio, 0.9), begins)
    stiffness, mass = (1 + float(p.values[0]) for p in fitted.parts)
    assert stiffness / mass == pytest.approx(ratio, rel=1e-4)
    weights = np.array([ratio / KNOWN["stiffness"] ** 2, 1 / KNOWN["mass"] ** 2])
    likeliest = weights.sum() / (weights @ [ratio, 1.0])
    assert mass == pytest.approx(likeliest, abs=2e-3)


def test_a_mode_that_loses_step_has_no_say_in_a_value():
    """Half a per cent faster it is 7 radians ahead at the end, and leaves 100 times the noise.

    By least squares over the noise alone that moves the stiffness by 5e-4, which the slow mode
    tells: here by 1e-5.
    """
    ratio = 1.04
    begins = [Beginning(0, (SIZE / SHAPES[:, 0].sum(), 0.0))]
    (stiffness, _) = parts_of(0.99 * ratio, 1.0)
    (fitted,) = fit_of(ratio, faster_other=1.005).grown((stiffness,), begins).parts
    assert 1 + float(fitted.values[0]) == pytest.approx(ratio, rel=2e-5)


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


def test_cosines_are_as_unsure_as_phases_of_other_modes():
    """A mode is drawn with frequencies that are off by 0.2 %: what it leaves is of size one.

    So it is wherever it rings, within what spans of samples blur; the slow mode stays as it is.
    """
    rng, omega, noise = np.random.default_rng(5), 5.2 * RATE, 1e-3
    slow, other = np.cos(RATE * T)[:, None] * [1.0, 0.6], np.cos(omega * T)[:, None] * [0.3, -0.4]
    noises = (Noise.white(noise, T[1]),) * 2
    read = Readings(T, slow + other, noises).unsure((slow + other) @ [0.8, 0.6], RATE)
    sure = replace(read, rung=np.zeros_like(slow))
    # Parseval, but for weights at the ends of the spectrum, which leak.
    assert np.sum(sure.cosines(slow) ** 2) == pytest.approx(np.sum(slow**2) / noise**2, rel=0.02)
    assert read.cosines(0.01 * slow) == pytest.approx(sure.cosines(0.01 * slow), abs=0.3)
    off = omega * (1 + 2e-3 * rng.standard_normal(200))
    left = np.cos(np.outer(T, off))[:, None] * [[0.3], [-0.4]] - other[:, :, None]
    before, now = (np.mean(x.cosines(left) ** 2, axis=1) for x in (sure, read))
    loud = before > 0.1 * before.max()
    assert before[loud].min() > 100 and 0.2 < now[loud].mean() < 1.0
