"""Dry friction that stops and holds a motion, against strokes that are integrated one by one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import romsindy as rs
from romsindy.effects import DryFriction
from romsindy.effects.base import State, TimedEffect
from romsindy.fit.kernel.collocation import Grid, TrajectoryError, integrate
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.linear_response import sampled
from romsindy.fit.kernel.part import Part

VALUES = {"omega^2": 900.0, "gamma_3": 100.0, "c_linear": 0.18}
MODEL = rs.ReducedModel.from_coefficients(VALUES)
T = np.arange(0, 4, 0.0025)


def rubbed(strength):
    """The model with friction in it."""
    return rs.ReducedModel.from_coefficients(VALUES | {"c_coulomb": strength})


def followed(start, strength, *others):
    """q by collocation."""
    grid = Grid.over(T, 2 * np.pi / 33, 40)
    parts = (Part(DryFriction(), (), np.array([[strength]])), *others)
    return sampled(integrate(ExtendedEquation(MODEL, parts, 0, grid.step, 0.0), start, grid))[:, 0]


@pytest.mark.parametrize("strength", [5.0, 12.0, 25.0, 80.0])
@pytest.mark.parametrize("amplitude", [1.0, 0.7, 0.6])
def test_motion_is_followed_to_its_rest(amplitude, strength):
    true = rubbed(strength).simulate(amplitude, 0.0, T)
    found = followed([amplitude, 0.0], strength)
    # The jump is averaged over a third of a step: 2e-5 of the friction's own displacement, a turn.
    assert np.abs(found - true.q).max() < 1e-3 * max(1, strength / 25)
    if np.all(true.q_dot[-400:] == 0):
        assert np.ptp(found[-400:]) == 0


def test_friction_holds_from_the_start():
    assert np.all(followed([0.05, 0.0], 60.0) == 0.05)  # 900 * 0.05 is 45


@dataclass(frozen=True)
class Push(TimedEffect):
    """A force from an instant on."""

    time: float = 2.0

    name, label, family = "push", "a push", "outside"

    def pull(self, t, q):
        return -1.0 * (t > self.time)[None]


def test_what_is_held_breaks_away_when_it_is_pushed():
    push = Part(Push(2.0), (), np.array([[150.0]]))
    found = followed([0.6, 0.0], 25.0, push)
    before = rubbed(25.0).simulate(0.6, 0.0, T[T <= 2.0])
    assert np.abs(found[T <= 2.0] - before.q).max() < 1e-3
    # From there on the strokes about the place to which the push moves the middle.
    late = T[T > 2.0]
    pushed = rs.ReducedModel.from_coefficients(VALUES | {"c_coulomb": 25.0, "f_constant": -150.0})
    after = pushed.simulate(before.q[-1], 0.0, late - 2.0)
    assert np.ptp(after.q) > 0.1
    # The push comes within a step of 0.0025 s, at 130 of acceleration.
    assert np.abs(found[T > 2.0] - after.q).max() < 3e-3


def test_what_diverges_is_not_held():
    falling = rs.ReducedModel.from_coefficients({"omega^2": 900.0, "gamma_3": -1200.0})
    grid = Grid.over(T, 2 * np.pi / 33, 40)
    parts = (Part(DryFriction(), (), np.array([[1.0]])),)
    with pytest.raises(TrajectoryError):
        integrate(ExtendedEquation(falling, parts, 0, grid.step, 0.0), [1.0, 0.0], grid)


@pytest.mark.parametrize("share", [-0.6, 0.3])
def test_averaged_friction_knows_how_it_follows_the_acceleration(share):
    """Central differences, where the speed is less than its change over the step."""
    a, h = np.array([7.0]), 1e-6
    v = share * a * 1e-3 / 3

    def force(more):
        return DryFriction().forces(State(np.zeros(1), 0.3 + 0 * a, v, a + more, 1e-3))[0]

    slope = DryFriction().slopes(State(np.zeros(1), 0.3 + 0 * a, v, a, 1e-3), np.ones(1))[2]
    np.testing.assert_allclose(slope, (force(h) - force(-h)) / (2 * h), rtol=1e-6)


@pytest.mark.study
@pytest.mark.slow
def test_decays_that_end_at_rest_are_diagnosed_and_predicted():
    """Friction ends the vibration after a few cycles, and holds the mass away from the middle."""
    t = np.arange(0, 8, 0.0025)
    decays = [
        rs.add_noise(rs.Decay(t, rubbed(25.0).simulate(a, 0.0, t).q), 40, i)
        for i, a in enumerate((1.0, 0.6, 0.8))
    ]
    report = rs.diagnose(MODEL, decays[:2], held_out=decays[2])
    assert report.verdict == "named" and report.best.names == ("dry_friction",)
    assert report.effects[0].values["strength"] == pytest.approx(25.0, rel=0.01)
    assert report.gap.after < 1.2


def half_swings(x, omega, zeta, friction, t):
    """Closed form of a linear oscillator with viscous and dry friction, half a swing at a time."""
    damped, off = omega * np.sqrt(1 - zeta**2), friction / omega**2
    q, start = np.zeros_like(t), 0.0
    while abs(x) > off:
        side = np.sign(x)
        s = t[(t >= start) & (t < start + np.pi / damped)] - start
        swing = np.cos(damped * s) + zeta * omega / damped * np.sin(damped * s)
        q[(t >= start) & (t < start + np.pi / damped)] = side * off + (x - side * off) * swing * (
            np.exp(-zeta * omega * s)
        )
        x = side * off - (x - side * off) * np.exp(-zeta * omega * np.pi / damped)
        start += np.pi / damped
    q[t >= start] = x
    return q


@pytest.mark.slow
def test_friction_and_viscous_damping_are_told_apart_where_the_motion_is_quiet():
    """Made smooth at the largest speed, friction took 4 % of the viscous damping to itself."""
    omega, zeta, friction = 75.4, 0.002, 0.15
    t = np.arange(5000) / 500
    q = half_swings(0.01, omega, zeta, friction, t)
    noise = np.sqrt(np.mean(q**2)) * 10 ** (-50 / 20)
    decay = rs.Decay(t, q + noise * np.random.default_rng(8).standard_normal(5000))
    found = rs.identify(decay)
    truth = {"omega^2": omega**2, "c_linear": 2 * zeta * omega, "c_coulomb": friction}
    bands = found.short.bands
    assert bands.keys() == truth.keys()
    for name, value in truth.items():
        low, high = bands[name]
        # A band of 95 % is 2 standard errors to either side; 4 are missed once in 16,000.
        assert low - (high - low) / 2 < value < high + (high - low) / 2
    assert np.ptp(bands["c_linear"]) < 0.02 * truth["c_linear"]
    fit = rs.refine(
        rs.ReducedModel.from_coefficients({name: 1.1 * v for name, v in truth.items()}), decay
    )
    assert all(
        abs(fit.model.coefficients[k] - v) < 4 * fit.standard_errors[k] for k, v in truth.items()
    )


RATE, FRICTION = 47.0, 10.0  # rad/s of a second mode without viscous damping, and what rubs there


def strokes(t, start):
    """q of a mode that friction alone damps, from rest: half cosines about +-F/k, then it rests."""
    rest = FRICTION / RATE**2
    q, now, found = start, 0, np.empty_like(t)
    half = np.floor(t * RATE / np.pi).astype(int)
    while abs(q) > rest and now <= half[-1]:
        middle = np.sign(q) * rest
        inside = half == now
        found[inside] = middle + (q - middle) * np.cos(RATE * t[inside] - now * np.pi)
        q, now = 2 * middle - q, now + 1
    found[half >= now] = q
    return found, now * np.pi / RATE


@pytest.mark.parametrize("fine", [1, 3])  # samples in each step
def test_accelerations_jump_where_friction_turns_round(fine):
    """Averaged over a step they are wrong by up to F at each turn, which no noise hides."""
    t = np.arange(0, 0.9, 0.0025 / fine)
    exact, stop = strokes(t, 0.3)
    half = np.floor(t * RATE / np.pi)
    pulled = np.where(t < stop, -(RATE**2) * exact + FRICTION * (-1) ** half, 0.0)
    grid = Grid.over(t, 2 * np.pi / RATE, 40)
    model = rs.ReducedModel.from_coefficients({"omega^2": RATE**2})
    parts = (Part(DryFriction(), (), np.array([[FRICTION]])),)
    equation = ExtendedEquation(model, parts, 0, grid.step, 0.0)
    motion = integrate(equation, [0.3, 0.0], grid)
    off = np.abs(equation.sampled(motion, 2)[:, 0] - pulled)
    smeared = np.abs(sampled(motion, 2)[:, 0] - pulled)
    # Instants of turns are found to a fiftieth of a step; phases drift by 1e-4 of a cycle in all.
    turn = np.abs((t * RATE / np.pi + 0.5) % 1 - 0.5) * np.pi / RATE
    moving = (turn > 0.02 * grid.step) & (t < stop - np.pi / RATE) & (t > grid.step)
    assert off[moving].max() < 0.05 * FRICTION
    assert smeared[moving].max() > 0.3 * FRICTION
    assert np.array_equal(equation.sampled(motion, 1), sampled(motion, 1))
    # Where no sample lies in a step in which it turns nothing jumps.
    half = motion.between(1, grid.n_steps // 40)
    assert np.array_equal(equation.sampled(half, 2), sampled(half, 2))


TWO_MODES = rs.CoupledModel.from_coefficients(
    {"omega^2 [q1]": 900.0, "omega^2 [q2]": RATE**2, "c_coulomb [q2]": FRICTION}
)


def two_modes(held_from=(), model=TWO_MODES):
    """Two modes side by side, friction in the second, in steps of a twelfth of its cycle."""
    grid = Grid.over(T, 2 * np.pi / RATE, 12, 4)
    equation = ExtendedEquation(
        model, (), 0, grid.step, 0.0, creep=1e-3 * RATE, held_from=held_from
    )
    return sampled(integrate(equation, (0.6, 0.3, 0.0, 0.0), grid))


def test_friction_of_one_of_several_coordinates_is_averaged_over_steps():
    exact, stop = strokes(T, 0.3)
    moving = T < stop - np.pi / RATE
    smooth = TWO_MODES.regularised(1e-3 * 0.3 * RATE)
    found, pointwise = two_modes(), two_modes(model=smooth)
    np.testing.assert_allclose(found[:, 0], 0.6 * np.cos(30 * T), atol=1e-6)  # order six
    off = np.abs(np.stack([found, pointwise])[..., 1] - exact)[:, moving].max(axis=1)
    # The jump lies somewhere between Gauss points. Of 31 strokes, each of which takes twice what
    # friction holds, a thirteenth of one is left; at the points alone it is twice as much.
    assert off[0] < 0.2 * FRICTION / RATE**2
    assert off[0] < 0.6 * off[1]


def test_a_coordinate_that_friction_holds_stays_where_it_is():
    exact, stop = strokes(T, 0.3)
    free, held = two_modes()[:, 1], two_modes((np.inf, stop))[:, 1]
    after, rest = stop + np.pi / RATE < T, FRICTION / RATE**2
    # Friction that turns round smoothly creeps back to the middle; what is held does not.
    assert np.ptp(held[after]) < 0.01 * rest  # Gauss's points let what is stiff ring on
    assert np.ptp(free[after]) > 0.1 * rest
    assert abs(held[-1] - exact[-1]) < 0.3 * rest  # as far as it was off before
