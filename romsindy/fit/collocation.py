"""Motion and its sensitivities by Gauss-Legendre collocation, all time steps at once.

A step of length h carries q and q_dot at its start and q_ddot at the three Gauss points. The
equation of motion holds at these points; q and q_dot follow by the quadrature of [1] (order six,
symplectic, unconditionally stable). Newton's method runs over many steps at once, so that terms
are evaluated on arrays, and the linear system left is a recursion from step to step: a banded
triangular one. The same system with other right-hand sides gives the exact derivatives of the
motion with respect to parameters and initial conditions.

[1] E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential Equations I", section
    II.14 (Nystroem methods) and "Geometric Numerical Integration", section II.1.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg.lapack import dtbtrs

from romsindy.typing import Array

STEPS_PER_CYCLE = 40
# Newton's method stops when the correction of q_ddot is below this, relative to its largest.
_CONVERGED = 1e-11
_ITERATIONS = 12
# Steps in the first window: Newton starts from a linear oscillator, good for about two cycles.
_FIRST_WINDOW = 2 * STEPS_PER_CYCLE


class TrajectoryError(RuntimeError):
    """The motion could not be followed to its end: it diverges, or its inertia vanishes.

    ``motion`` is the Trajectory up to there, if there is any.
    """

    def __init__(self, message: str, motion: Trajectory | None = None) -> None:
        super().__init__(message)
        self.motion = motion


class Linearisation(NamedTuple):
    """Residual of the equation of motion and its derivatives, shape (n,) each."""

    residual: Array
    by_q: Array
    by_q_dot: Array
    by_q_ddot: Array


class Equation(Protocol):
    """An equation of motion R(t, q, q_dot, q_ddot) = 0 that is linear in q_ddot."""

    def linearise(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Linearisation:
        """R and its derivatives at (n,) times (s) and states."""

    def by_parameter(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """dR/dp for every parameter, shape (n_parameters, n)."""


def _gauss() -> tuple[Array, Array, Array, Array]:
    """Nodes on [0, 1], weights, and the coefficients of q_dot and of q at the nodes.

    They integrate the parabola through q_ddot at the nodes once and twice.
    """
    x, w = np.polynomial.legendre.leggauss(3)
    nodes, powers = (x + 1) / 2, np.arange(3)
    lagrange = np.linalg.inv(np.vander(nodes, 3, increasing=True))  # powers to nodes
    once = nodes[:, None] ** (powers + 1) / (powers + 1) @ lagrange
    twice = nodes[:, None] ** (powers + 2) / ((powers + 1) * (powers + 2)) @ lagrange
    return nodes, w / 2, once, twice


def _hermite(theta: Array, derivative: int) -> Array:
    """Quintic through q, h q_dot, h^2 q_ddot at both ends, shape (len(theta), 6)."""
    ends = [_monomials(np.array([end]), d)[0] for end in (0.0, 1.0) for d in range(3)]
    return _monomials(theta, derivative) @ np.linalg.inv(np.array(ends))


def _monomials(theta: Array, derivative: int) -> Array:
    """Derivatives of 1, theta, ..., theta^5, shape (len(theta), 6)."""
    powers = np.arange(6)
    factor = np.prod([powers - d for d in range(derivative)], axis=0)
    return factor * theta[:, None] ** np.clip(powers - derivative, 0, None)


_NODES, _WEIGHTS, _ONCE, _TWICE = _gauss()
_END_TWICE = _WEIGHTS * (1 - _NODES)  # q at the end of a step


@dataclass(frozen=True)
class Grid:
    """Steps of equal length, and where the wanted times lie in them.

    Parameters
    ----------
    start, step : float
        First time and length of a step, s.
    n_steps : int
    sample_step : (n,) array of int
        Step that holds each wanted time.
    fraction : (n,) array
        Place of each wanted time in its step, 0 to 1.
    """

    start: float
    step: float
    n_steps: int
    sample_step: Array
    fraction: Array

    @classmethod
    def over(cls, t: Array, period: float, steps_per_cycle: int = STEPS_PER_CYCLE) -> Grid:
        """Lay steps over uniform times t (s): a whole number of samples each, or a part of one.

        ``period`` (s) is the shortest of the motion.
        """
        dt = (t[-1] - t[0]) / (len(t) - 1)
        samples = period / (steps_per_cycle * dt)
        step = dt * np.floor(samples) if samples >= 1 else dt / np.ceil(1 / samples)
        place = np.arange(len(t)) * (dt / step)
        # A sample at the end of a step is read there; only the very first one lies at a start.
        index = np.clip(np.ceil(place - 1e-9).astype(int) - 1, 0, None)
        return cls(float(t[0]), float(step), int(index[-1]) + 1, index, place - index)

    def node_times(self, first: int, last: int) -> Array:
        """Times of the Gauss points of steps first to last - 1, shape (last - first, 3)."""
        return self.start + self.step * (np.arange(first, last)[:, None] + _NODES)

    def until(self, t: float) -> Grid:
        """The part of the grid whose samples are not later than t (s)."""
        place = (self.sample_step + self.fraction) * self.step
        kept = int(np.searchsorted(place, t - self.start, side="right"))
        index = self.sample_step[:kept]
        return Grid(self.start, self.step, int(index[-1]) + 1, index, self.fraction[:kept])


@dataclass(frozen=True)
class Trajectory:
    """A motion on a grid: q and q_dot at the start of each step, q_ddot at its Gauss points.

    Shapes (n_steps + 1,), (n_steps + 1,) and (n_steps, 3).
    """

    grid: Grid
    q: Array
    q_dot: Array
    q_ddot: Array

    def samples(self, equation: Equation, derivative: int = 0) -> Array:
        """q (derivative 0), q_dot (1) or q_ddot (2) at the wanted times, shape (n,)."""
        ends = _end_system(equation, self)
        q_ddot = -ends.residual / ends.by_q_ddot
        return _sampled(self.grid, derivative, self.q, self.q_dot, q_ddot)


def _end_system(equation: Equation, motion: Trajectory) -> Linearisation:
    """The equation at the ends of the steps with no acceleration: -residual / inertia is it."""
    grid = motion.grid
    t = grid.start + grid.step * np.arange(grid.n_steps + 1)
    return equation.linearise(t, motion.q, motion.q_dot, np.zeros_like(t))


def _sampled(grid: Grid, derivative: int, q: Array, q_dot: Array, q_ddot: Array) -> Array:
    """A derivative of q at the wanted times from values at step ends, (n_steps + 1, ...) each.

    A quintic over each step: values at its ends have order six, those inside the step five.
    """
    h = grid.step
    ends = np.stack([q, h * q_dot, h * h * q_ddot], axis=1).reshape(len(q), 3, -1)
    steps = np.concatenate([ends[:-1], ends[1:]], axis=1)
    # Uniform samples share few fractions of a step: one small matrix serves all steps.
    fractions, kind = np.unique(np.round(grid.fraction, 9), return_inverse=True)
    values = (_hermite(fractions, derivative) / h**derivative) @ steps
    return values[grid.sample_step, kind].reshape(-1, *q.shape[1:])


def integrate(
    equation: Equation, state: Sequence[float], grid: Grid, guess: Trajectory | None = None
) -> Trajectory:
    """Follow the motion from a state over a grid.

    Parameters
    ----------
    equation : Equation
    state : (2,) sequence
        q and q_dot at the start of the grid.
    grid : Grid
    guess : Trajectory, optional
        Motion with similar parameters on the same steps, or on the first of them.

    Returns
    -------
    Trajectory

    Raises
    ------
    TrajectoryError
        If the motion cannot be followed: it diverges, or M(q) is not positive on the way.
    """
    n = grid.n_steps
    q, q_dot, q_ddot = np.empty(n + 1), np.empty(n + 1), np.empty((n, 3))
    q[0], q_dot[0] = state
    known = min(len(guess.q_ddot), n) if guess is not None else 0
    first, width = 0, max(known, _FIRST_WINDOW)
    while first < n:
        if guess is not None and first < known:
            last = min(first + width, known)
            start = _shifted(guess, first, last, q[first], q_dot[first])
        else:
            last = min(first + min(width, _FIRST_WINDOW), n)
            start = _linear_motion(equation, grid, first, last, q[first], q_dot[first])
        window = _newton(equation, grid, first, q[first], q_dot[first], start)
        if window is not None and _resolved(
            grid.step, *window, float(np.abs(q[: first + 1]).max())
        ):
            q[first : last + 1], q_dot[first : last + 1], q_ddot[first:last] = window
            first, width = last, 2 * (last - first)
        elif last - first > 1:
            width = (last - first) // 4 or 1
        elif first < known:
            known = 0  # the other motion misleads
        else:
            end = grid.start + first * grid.step
            done = (q[: first + 1], q_dot[: first + 1], q_ddot[:first])
            raise TrajectoryError(
                f"the motion cannot be followed beyond t = {end:.6g} s,"
                f" q = {q[first]:.4g}, q_dot = {q_dot[first]:.4g}: it diverges, or 1 + h(q) is not"
                " positive there",
                Trajectory(grid.until(end), *done) if first > 0 else None,
            )
    return Trajectory(grid, q, q_dot, q_ddot)


def _resolved(h: float, q: Array, q_dot: Array, q_ddot: Array, reach: float) -> bool:
    """Whether steps are short against the motion: else it escapes, or solves the steps only.

    An oscillation at twenty steps a cycle has |q_ddot| h^2 = 0.1 |q|.
    """
    reach = max(reach, float(np.abs(q).max())) + h * float(np.abs(q_dot).max())
    return bool(np.abs(q_ddot).max() * h * h <= reach)


def _shifted(guess: Trajectory, first: int, last: int, q: float, q_dot: float) -> Array:
    """Accelerations of another motion, moved in time and scaled to go through a state.

    After many cycles two motions differ mostly by their phase.
    """
    h, a = guess.grid.step, guess.q_ddot[first:last]
    omega = float(np.sqrt(np.std(a) / (np.std(guess.q[first : last + 1]) + 1e-300))) or 1.0
    now, then = complex(q, -q_dot / omega), complex(guess.q[first], -guess.q_dot[first] / omega)
    if now == then or not abs(then) * omega:
        return a
    late = np.angle(now / then) / omega
    times = h * (np.arange(len(guess.q_ddot))[:, None] + _NODES)
    wanted = times[first:last] + late
    return abs(now / then) * np.interp(wanted, times.ravel(), guess.q_ddot.ravel())


def _linear_motion(
    equation: Equation, grid: Grid, first: int, last: int, q: float, q_dot: float
) -> Array:
    """Acceleration of the equation linearised at the start of a window, shape (steps, 3)."""
    t = grid.node_times(first, last)
    now = (t[:1, 0], np.array([q]), np.array([q_dot]))
    residual, by_q, _, mass = (float(x[0]) for x in equation.linearise(*now, np.zeros(1)))
    squared = by_q / mass if mass > 0 else 0.0
    a = -residual / mass if mass > 0 else 0.0
    if squared <= 0:
        return np.full(t.shape, a)
    omega = np.sqrt(squared)
    phase = omega * (t - grid.start - first * grid.step)
    return a * np.cos(phase) - omega * q_dot * np.sin(phase)


def _newton(
    equation: Equation, grid: Grid, first: int, q0: float, q_dot0: float, q_ddot: Array
) -> tuple[Array, Array, Array] | None:
    """States and accelerations of one window, or None where Newton's method fails."""
    t = grid.node_times(first, first + len(q_ddot))
    last_size = np.inf
    for _ in range(_ITERATIONS):
        q, q_dot = _states(grid.step, q0, q_dot0, q_ddot)
        with np.errstate(all="ignore"):
            system = LinearSteps.at(equation, grid.step, t, q, q_dot, q_ddot)
            correction = system.solve(-system.residual[..., None])[2][..., 0]
        size = float(np.abs(correction).max())
        scale = float(np.abs(q_ddot).max()) + size
        if not np.isfinite(size) or size > 10 * last_size:
            return None
        q_ddot = q_ddot + correction
        if size <= _CONVERGED * scale:
            q, q_dot = _states(grid.step, q0, q_dot0, q_ddot)
            return (q, q_dot, q_ddot) if system.positive else None
        last_size = size
    return None


def _states(h: float, q0: float, q_dot0: float, q_ddot: Array) -> tuple[Array, Array]:
    """q and q_dot at the ends of the steps, from the accelerations inside."""
    q_dot = q_dot0 + h * np.concatenate([[0.0], np.cumsum(q_ddot @ _WEIGHTS)])
    rise = h * q_dot[:-1] + h * h * (q_ddot @ _END_TWICE)
    return q0 + np.concatenate([[0.0], np.cumsum(rise)]), q_dot


@dataclass(frozen=True)
class LinearSteps:
    """The linearised equations of all steps of a window."""

    h: float
    residual: Array  # (n, 3)
    stages: Array  # (n, 3, 3): what the accelerations do to the residual
    by_state: Array  # (n, 3, 2): what q and q_dot at the start of the step do to it
    positive: bool  # inertia > 0 at every node

    @classmethod
    def at(
        cls, equation: Equation, h: float, t: Array, q: Array, q_dot: Array, q_ddot: Array
    ) -> LinearSteps:
        q_node, v_node = at_nodes(h, q, q_dot, q_ddot)
        flat = equation.linearise(t.ravel(), q_node.ravel(), v_node.ravel(), q_ddot.ravel())
        residual, by_q, by_v, by_a = (x.reshape(t.shape) for x in flat)
        stages = by_q[..., None] * (h * h * _TWICE) + by_v[..., None] * (h * _ONCE)
        diagonal = np.arange(3)
        stages[:, diagonal, diagonal] += by_a
        by_state = np.stack([by_q, by_v + h * _NODES * by_q], axis=-1)
        return cls(h, residual, stages, by_state, bool(np.all(by_a > 0)))

    def solve(
        self, force: Array, start: Array | None = None, jump: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Small changes of q, q_dot (n + 1, m) and q_ddot (n, 3, m) due to a residual -force.

        ``force`` has shape (n, 3, m), ``start`` the change of the first state, (2, m), ``jump``
        (n, 2, m) what is added to q and q_dot at the end of each step.
        """
        n, h = len(force), self.h
        inverse = _inverse(self.stages)
        direct = inverse @ force
        by_state = -inverse @ self.by_state
        end = np.array([h * h * _END_TWICE, h * _WEIGHTS])  # (2, 3): accelerations to the end
        transition = end @ by_state + np.array([[1.0, h], [0.0, 1.0]])
        steps = end @ direct
        states = _recursion(transition, steps if jump is None else steps + jump, start)
        q_ddot = direct + by_state @ states[:n]
        return states[:, 0], states[:, 1], q_ddot


def at_nodes(h: float, q: Array, q_dot: Array, q_ddot: Array) -> tuple[Array, Array]:
    v_node = q_dot[:-1, None] + h * q_ddot @ _ONCE.T
    q_node = q[:-1, None] + h * q_dot[:-1, None] * _NODES + h * h * q_ddot @ _TWICE.T
    return q_node, v_node


def _inverse(a: Array) -> Array:
    """Inverse of many 3 x 3 matrices by cofactors: ten times faster than one LAPACK call each."""
    ((a00, a01, a02), (a10, a11, a12), (a20, a21, a22)) = a.transpose(1, 2, 0)
    out = np.empty_like(a)
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = (
        a11 * a22 - a12 * a21,
        a02 * a21 - a01 * a22,
        a01 * a12 - a02 * a11,
    )
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = (
        a12 * a20 - a10 * a22,
        a00 * a22 - a02 * a20,
        a02 * a10 - a00 * a12,
    )
    out[:, 2, 0], out[:, 2, 1], out[:, 2, 2] = (
        a10 * a21 - a11 * a20,
        a01 * a20 - a00 * a21,
        a00 * a11 - a01 * a10,
    )
    determinant = a00 * out[:, 0, 0] + a01 * out[:, 1, 0] + a02 * out[:, 2, 0]
    return out / determinant[:, None, None]


def _recursion(transition: Array, force: Array, start: Array | None) -> Array:
    """x[k + 1] = transition[k] x[k] + force[k], shape (n + 1, 2, m), as a banded system."""
    n, _, m = force.shape
    x = np.zeros((n + 1, 2, m))
    if start is not None:
        x[0] = start
    x[1:] = force
    band = np.zeros((4, 2 * (n + 1)))
    band[1, 1:-2:2] = -transition[:, 0, 1]
    band[2, 0:-2:2] = -transition[:, 0, 0]
    band[2, 1:-2:2] = -transition[:, 1, 1]
    band[3, 0:-2:2] = -transition[:, 1, 0]
    solution, info = dtbtrs(band, x.reshape(2 * (n + 1), m), uplo="L", diag="U")
    if info:
        raise ValueError(f"banded solve failed with info = {info}")
    return solution.reshape(n + 1, 2, m)


def sensitivity(equation: Equation, motion: Trajectory, derivative: int = 0) -> Array:
    """Exact derivatives of the (discrete) motion with respect to parameters and initial state.

    Parameters
    ----------
    equation : Equation
        With the parameters that the motion was integrated with.
    motion : Trajectory
    derivative : int
        Of q (0), q_dot (1) or q_ddot (2) at the wanted times.

    Returns
    -------
    (n, n_parameters + 2) array
        The last two columns belong to q and q_dot at the start.
    """
    grid, h = motion.grid, motion.grid.step
    t = grid.node_times(0, grid.n_steps)
    system = LinearSteps.at(equation, h, t, motion.q, motion.q_dot, motion.q_ddot)
    q_node, v_node = at_nodes(h, motion.q, motion.q_dot, motion.q_ddot)
    slopes = equation.by_parameter(t.ravel(), q_node.ravel(), v_node.ravel(), motion.q_ddot.ravel())
    p = len(slopes)
    force = np.zeros((*t.shape, p + 2))
    force[..., :p] = -slopes.reshape(p, *t.shape).transpose(1, 2, 0)
    start = np.zeros((2, p + 2))
    start[0, p] = start[1, p + 1] = 1.0
    q, q_dot, _ = system.solve(force, start)
    q_ddot = _end_acceleration(equation, motion, q, q_dot)
    return _sampled(grid, derivative, q, q_dot, q_ddot)


def _end_acceleration(equation: Equation, motion: Trajectory, q: Array, q_dot: Array) -> Array:
    """Change of q_ddot at the ends of the steps, from that of q, q_dot and the parameters."""
    grid = motion.grid
    t = grid.start + grid.step * np.arange(grid.n_steps + 1)
    resting = _end_system(equation, motion)
    state = (t, motion.q, motion.q_dot, -resting.residual / resting.by_q_ddot)
    at = equation.linearise(*state)
    force = at.by_q[:, None] * q + at.by_q_dot[:, None] * q_dot
    slopes = equation.by_parameter(*state)
    force[:, : len(slopes)] += slopes.T
    return -force / at.by_q_ddot[:, None]
