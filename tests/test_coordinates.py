"""Motions of several coordinates, and of an equation with an input, against closed forms."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from oracles import equation_of
from scipy.linalg import block_diag, expm

from romsindy.fit.kernel.collocation import Grid, Trajectory, TrajectoryError, integrate
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.linear_response import (
    nodes,
    respond,
    respond_together,
    sampled,
    sensitivity,
)
from romsindy.fit.kernel.linear_steps import NODES, Equation, Linearisation, LinearSteps, inverse
from romsindy.physics.example import EXAMPLE_MODEL

MASS = np.array([[2.0, 0.3], [0.3, 1.0]])
DAMPING = np.array([[0.3, -0.1], [-0.1, 0.2]])
STIFFNESS = np.array([[80.0, -20.0], [-20.0, 50.0]])
START = np.array([1.0, -0.4, 2.0, 3.0])  # q, then q_dot
T = 0.3 + np.linspace(0, 6, 601)
PERIOD = 2 * np.pi / 8.7  # of the faster mode; the other has 5.0 rad/s


@dataclass(frozen=True)
class Linear:
    """M q'' + C q' + K q = F sin(W t); its parameter is the stiffness that couples."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    force: float = 0.0
    rate: float = 5.0

    def linearise(
        self, t: np.ndarray, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray
    ) -> Linearisation:
        residual = q_ddot @ self.mass.T + q_dot @ self.damping.T + q @ self.stiffness.T
        residual -= self.force * np.sin(self.rate * t)[:, None]
        wide = (np.tile(a, (len(t), 1, 1)) for a in (self.stiffness, self.damping, self.mass))
        return Linearisation(residual, *wide)

    def by_parameter(
        self, t: np.ndarray, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray
    ) -> np.ndarray:
        return q[None, :, ::-1]

    def coupled(self, change: float) -> Linear:
        return replace(self, stiffness=self.stiffness + change * np.array([[0, 1], [1, 0]]))

    def exact(self, start: np.ndarray = START) -> np.ndarray:
        """q, q_dot and q_ddot of the free motion by the matrix exponential, (3, n, 2)."""
        zero, one = np.zeros((2, 2)), np.eye(2)
        a = np.linalg.solve(self.mass, np.hstack([-self.stiffness, -self.damping]))
        state = expm((T - T[0])[:, None, None] * np.vstack([np.hstack([zero, one]), a])) @ start
        return np.stack([state[:, :2], state[:, 2:], state @ a.T])


COUPLED = Linear(MASS, DAMPING, STIFFNESS)


def test_two_coupled_oscillators_are_the_matrix_exponential() -> None:
    equation = COUPLED
    motion = integrate(equation, START, Grid.over(T, PERIOD, 150))
    for derivative, exact in enumerate(equation.exact()):
        found = motion.samples(equation, derivative)
        # Order six at 150 steps a cycle: (2 pi / 150)^6 / 1e5 per radian, 52 rad: far below 1e-9.
        np.testing.assert_allclose(found, exact, atol=1e-9 * np.abs(exact).max(), rtol=0)


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_sensitivities_of_coupled_oscillators_are_those_of_the_exponential(derivative: int) -> None:
    equation = COUPLED
    motion = integrate(equation, START, Grid.over(T, PERIOD, 150))
    found = sensitivity(equation, motion, derivative)
    h = 1e-3
    pairs = [[equation.coupled(s * h).exact() for s in (1, -1)]]
    pairs += [[equation.exact(START + s * h * e) for s in (1, -1)] for e in np.eye(4)]
    for i, (more, less) in enumerate(pairs):
        exact = (more - less)[derivative] / (2 * h)
        # The motion is linear in its first state; by the stiffness the difference errs by the
        # square of the change of phase, 52 rad * 1e-3 / 30, over six.
        atol = 1e-6 * np.abs(exact).max()
        np.testing.assert_allclose(found[..., i], exact, atol=atol, rtol=0)


def test_coupled_oscillators_converge_with_order_six() -> None:
    def error(steps: int) -> float:
        motion = integrate(COUPLED, START, Grid(T[0], 6 / steps, steps, *_ends(steps)))
        return float(np.abs(motion.q[-1] - COUPLED.exact()[0, -1]).max())

    assert np.log2(error(150) / error(300)) == pytest.approx(6, abs=0.1)


def _ends(steps: int) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(steps), np.ones(steps)


def test_an_equation_may_have_an_input() -> None:
    """From rest, q'' + c q' + k q = F sin(W t): a steady sinusoid and what makes it start at 0."""
    c, k, force, rate = 0.3, 36.0, 2.0, 5.0
    equation = Linear(*(np.array([[a]]) for a in (1.0, c, k)), force=force, rate=rate)
    steady = force / (k - rate**2 + 1j * c * rate)
    damped = np.sqrt(k - c * c / 4)
    exact = (steady * np.exp(1j * rate * T)).imag
    at = steady * np.exp(1j * rate * T[0])
    q0, v0, late = -at.imag, -(1j * rate * at).imag, T - T[0]
    wave = q0 * np.cos(damped * late) + (v0 + c / 2 * q0) / damped * np.sin(damped * late)
    exact = exact + np.exp(-c / 2 * late) * wave
    motion = integrate(equation, (0.0, 0.0), Grid.over(T, 2 * np.pi / 6, 150))
    # Order six, as above.
    np.testing.assert_allclose(motion.samples(equation)[:, 0], exact, atol=1e-9, rtol=0)


@dataclass(frozen=True)
class Pair:
    """Two equations that know nothing of one another, with the parameters of both."""

    first: Equation
    second: Equation

    def linearise(
        self, t: np.ndarray, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray
    ) -> Linearisation:
        own = [e.linearise(t, *x) for e, x in self.split(q, q_dot, q_ddot)]
        blocks = [[block_diag(*m) for m in zip(*x, strict=True)] for x in zip(*own, strict=True)]
        residual = np.hstack([o.residual for o in own])
        return Linearisation(residual, *map(np.array, blocks[1:]))

    def by_parameter(
        self, t: np.ndarray, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray
    ) -> np.ndarray:
        a, b = (e.by_parameter(t, *x) for e, x in self.split(q, q_dot, q_ddot))
        nothing = np.zeros_like(a)
        return np.concatenate([np.dstack([a, nothing]), np.dstack([nothing, b])])

    def split(self, *states: np.ndarray) -> list[tuple[Equation, list[np.ndarray]]]:
        pair = enumerate((self.first, self.second))
        return [(e, [x[:, i : i + 1] for x in states]) for i, e in pair]


def test_two_uncoupled_coordinates_are_two_motions_of_one() -> None:
    t = np.linspace(0, 6, 301)
    grid = Grid.over(t, 1.0)
    slower = replace(EXAMPLE_MODEL, values=tuple(0.7 * v for v in EXAMPLE_MODEL.values))
    alone: list[ExtendedEquation] = [equation_of(m, ("gamma_3",)) for m in (EXAMPLE_MODEL, slower)]
    both = Pair(*alone)
    motion = integrate(both, (1.2, -0.8, 0.5, 1.0), grid)
    slopes, response = sensitivity(both, motion), respond(both, motion, _slopes(both, motion))
    for i, (equation, start) in enumerate(zip(alone, ((1.2, 0.5), (-0.8, 1.0)), strict=True)):
        own = integrate(equation, start, grid)
        # Newton's method ends at a correction of 1e-11 and is quadratic: what is left is rounding.
        np.testing.assert_allclose(motion.samples(both)[:, [i]], own.samples(equation), atol=1e-11)
        np.testing.assert_allclose(sampled(motion)[:, [i]], sampled(own), atol=1e-11)
        columns = [i, 2 + i, 4 + i]
        np.testing.assert_allclose(
            slopes[:, [i]][..., columns], sensitivity(equation, own), atol=1e-10
        )
        single = respond(equation, own, _slopes(equation, own))
        np.testing.assert_allclose(
            response.samples()[:, [i]][..., [0, *(c + 1 for c in columns)]],
            single.samples(),
            atol=1e-10,
        )
        others = np.delete(slopes[:, i], columns, axis=-1)
        assert not np.any(others)


def test_motions_together_respond_as_each_alone() -> None:
    short = replace(COUPLED, stiffness=STIFFNESS + 0.1)
    motions = [
        integrate(COUPLED, start, Grid.over(T[:n], PERIOD))
        for n, start in ((301, START), (90, -START))
    ]
    for found, motion in zip(respond_together(short, motions), motions, strict=True):
        alone = respond(short, motion)
        for name in ("q", "q_dot", "q_ddot"):
            one, other = getattr(found, name), getattr(alone, name)
            np.testing.assert_allclose(one, other, atol=1e-12 * np.abs(other).max())  # rounding


def _slopes(equation: Equation, motion: Trajectory) -> np.ndarray:
    return equation.by_parameter(*nodes(motion))


def test_one_step_makes_a_wrong_motion_that_of_a_linear_equation() -> None:
    equation, grid = COUPLED, Grid.over(T, PERIOD)
    truth = integrate(equation, START, grid)
    noise = np.random.default_rng(0).normal(size=(3, *truth.q.shape))
    wrong = Trajectory(grid, truth.q + noise[0], truth.q_dot + noise[1], 0.5 * truth.q_ddot)
    response = respond(equation, wrong, np.zeros((0, 3 * grid.n_steps, 2)))
    mended = response.moved(np.array([1.0, *(START - wrong.start)]))
    for found, exact in ((mended.q, truth.q), (mended.q_ddot, truth.q_ddot)):
        # Rounding, which grows with the number of steps.
        np.testing.assert_allclose(found, exact, atol=1e-10 * np.abs(exact).max())


@pytest.mark.parametrize("coupling", [1.0, 2.0])  # singular, and indefinite
def test_mass_that_is_not_positive_is_refused_with_the_state(coupling: float) -> None:
    equation = replace(COUPLED, mass=np.array([[1.0, coupling], [coupling, 1.0]]))
    with pytest.raises(TrajectoryError, match=r"t = 0.3 s, q = 1, -0.4, q_dot = 2, 3: it diverges"):
        integrate(equation, START, Grid.over(T, PERIOD))


@pytest.mark.parametrize("size", [1, 3, 6])
def test_inverses_and_pivots(size: int) -> None:
    rng = np.random.default_rng(size)
    a = rng.normal(size=(50, size, size)) + 3 * size * np.eye(size)
    kept = a.copy()
    found, pivots = inverse(a)
    np.testing.assert_array_equal(a, kept)
    # Diagonals outweigh their rows: condition numbers stay below ten.
    np.testing.assert_allclose(found, np.linalg.inv(a), atol=1e-14)
    np.testing.assert_allclose(np.prod(pivots, axis=1), np.linalg.det(a), rtol=1e-12)


@pytest.mark.parametrize("damping", [1.0, 1e3, 1e6])
def test_strong_damping_makes_no_pivot_vanish(damping: float) -> None:
    """Dry friction, smoothed, damps a crawling motion by far more than its inertia."""
    equation = replace(COUPLED, damping=np.diag([damping, 3.0]))
    t, rest = 0.02 * NODES[None], np.zeros((2, 2))
    stages = LinearSteps.at(equation, 0.02, t, rest, rest, np.zeros((1, 3, 2))).stages
    found, pivots = inverse(stages)
    assert pivots.min() > 0.5  # the mass matrix has 1.0 and 1.955
    # Rows are of very different size, which neither way of inversion minds.
    np.testing.assert_allclose(found, np.linalg.inv(stages), rtol=1e-9, atol=1e-13)
