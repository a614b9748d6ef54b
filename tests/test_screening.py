"""A linear look at what all sensors leave, against least squares in closed form."""

import numpy as np
import pytest

from romsindy.diagnosis.all_sensors import beside_known, refuted_by
from romsindy.diagnosis.on_simulator.candidates import (
    Candidate,
    LinearLook,
    best_of_each,
    little_of,
    matters,
)
from romsindy.effects import CubicStiffness, DryFriction, LinearFrequency, Viscous
from romsindy.effects.base import Scales
from romsindy.effects.stiffness import TwoSidedGap

SCALES = Scales(0.02, 30.0, 10.0)


class _Takes:
    """A simulator that takes any force."""

    at_point = "1:1"

    def with_effects(self, parts):
        return tuple(parts)


def _little(*effects):
    return [Candidate(part, _Takes()) for part in little_of(effects, _Takes(), SCALES, 2)]


def test_strength_and_gain_are_those_of_least_squares():
    """One column beside three others and a prior, by numpy; what the prior says has no reading."""
    rng = np.random.default_rng(1)
    known, change = rng.normal(size=(50, 3)), rng.normal(size=40)
    left = known @ [1.0, -2.0, 0.5] + 0.1 * rng.normal(size=50)
    left[:40] += 3.0 * change
    (candidate,) = _little(LinearFrequency())
    found = LinearLook.of(left, known).with_strength(candidate, change)
    column = np.append(change, np.zeros(10))
    without = np.linalg.lstsq(known, left)
    beside = np.linalg.lstsq(np.column_stack([known, column]), left)
    times = found.part.strengths[0, 0] / candidate.part.strengths[0, 0]
    assert times == pytest.approx(beside[0][3], rel=1e-9) == pytest.approx(3.0, abs=0.1)
    assert found.gain == pytest.approx(without[1][0] - beside[1][0], rel=1e-9)


def test_friction_is_no_source_of_energy():
    """Friction whose likeliest strength is less than nothing explains nothing."""
    change = np.array([1.0, 2.0, 3.0])
    look = LinearLook.of(-change, np.zeros((3, 1)))
    friction, spring = (
        look.with_strength(c, change) for c in _little(DryFriction(), LinearFrequency())
    )
    assert friction.part.strengths[0, 0] == 0.0 == friction.gain
    assert spring.part.strengths[0, 0] < 0 and spring.gain == pytest.approx(14.0)
    assert best_of_each([friction, spring])[0] is spring


def test_little_of_an_effect_is_a_thousandth_of_the_restoring_force():
    """By hand, and less does not matter. Laws with further values are not looked at so."""
    effects = (LinearFrequency(), Viscous(), CubicStiffness(), DryFriction(), TwoSidedGap())
    strengths = {c.part.effect.name: c.part.strengths[0, 0] for c in _little(*effects)}
    q, omega = SCALES.amplitude, SCALES.omega
    expected = {
        "linear_frequency": 1e-3 * omega**2,
        "viscous": 1e-3 * omega,
        "cubic_stiffness": 1e-3 * omega**2 / q**2,
        "dry_friction": 1e-3 * omega**2 * q,
    }
    assert strengths == pytest.approx(expected, rel=1e-9)
    (candidate,) = _little(LinearFrequency())
    less = candidate.part.moved(-0.1 * candidate.part.values)
    assert matters(candidate.part, SCALES) and not matters(less, SCALES)


def test_what_is_known_to_a_standard_deviation_is_taken_off_as_that():
    """Chi-square with the covariance that columns of standard deviation 1 add, by its inverse."""
    rng = np.random.default_rng(2)
    left, known = rng.normal(size=30), rng.normal(size=(30, 4))
    expected = left @ np.linalg.solve(np.eye(30) + known @ known.T, left)
    assert beside_known(left, known) == pytest.approx(expected, rel=1e-10)


def test_a_part_of_what_nothing_explains_may_go_with_any_explanation():
    """Of 1,000 samples: noise alone counts in full, 4 times the noise but what a half of it leaves.

    Where the least is 4,000 three quarters of that are no noise: half of these go off 3,000.
    """
    left = np.array([1000.0, 1030.0])
    assert refuted_by(left, 0.5, 1000).tolist() == [0.0, 30.0]
    left = np.array([4000.0, 7000.0, 5400.0])
    assert refuted_by(left, 0.5, 1000).tolist() == [0.0, (3000 - 1500) / 4, 0.0]
