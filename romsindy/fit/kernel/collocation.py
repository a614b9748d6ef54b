"""Motion by Gauss-Legendre collocation, many time steps at once.

Newton's method runs over all steps of a window, so that terms are evaluated on arrays; what is left
is one linear system for all of them (`romsindy.fit.kernel.linear_steps`). Arrays carry an axis of R
coordinates, the last one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import eigh

from romsindy.fit.kernel.linear_steps import (
    NODES,
    Equation,
    LinearSteps,
    RememberingEquation,
    at_nodes,
    gains,
    inverse,
)
from romsindy.typing import Array, Indices

STEPS_PER_CYCLE = 40
# Newton's method stops when the correction of q_ddot is below this, relative to its largest.
_CONVERGED = 1e-11
_ITERATIONS = 12
_FAR = 100.0  # times that, foretold for the last step, at which a window is given up
_SLOW, _MIXED = 0.01, 4  # corrections that shrink by less are mixed, with so many before them
# Steps in the first window: Newton starts from a linear oscillator, good for about two cycles.
_FIRST_WINDOW = 2 * STEPS_PER_CYCLE


GROWN = 1e100  # whitened disturbances of a motion beyond which their squares are no numbers, nearly


class TrajectoryError(RuntimeError):
    """The motion could not be followed to its end: it diverges, or its inertia vanishes.

    ``motion`` is the Trajectory up to there, if there is any.
    """

    def __init__(self, message: str, motion: Trajectory | None = None) -> None:
        super().__init__(message)
        self.motion = motion


def _hermite(theta: Array, derivative: int) -> Array:
    """Quintic through q, h q_dot, h^2 q_ddot at both ends, shape (len(theta), 6)."""
    ends = [_monomials(np.array([end]), d)[0] for end in (0.0, 1.0) for d in range(3)]
    return _monomials(theta, derivative) @ np.linalg.inv(np.array(ends))


def _monomials(theta: Array, derivative: int) -> Array:
    """Derivatives of 1, theta, ..., theta^5, shape (len(theta), 6)."""
    powers = np.arange(6)
    factor = np.prod([powers - d for d in range(derivative)], axis=0)
    return factor * theta[:, None] ** np.clip(powers - derivative, 0, None)


@dataclass(frozen=True)
class Grid:
    """Steps of equal length, and where the wanted times lie in them."""

    start: float  # first time, s
    step: float  # length, s
    n_steps: int
    sample_step: Array  # (n,) of int, which step holds each wanted time
    fraction: Array  # (n,), place of each wanted time in its step, 0 to 1

    @classmethod
    def over(
        cls, t: Array, period: float, steps_per_cycle: int = STEPS_PER_CYCLE, parts: int = 1
    ) -> Grid:
        """Lay steps over uniform times t (s): a whole number of samples each, or a part of one.

        ``period`` (s) is the shortest of the motion. Steps of more than a sample may end at so
        many ``parts`` of one.
        """
        dt = (t[-1] - t[0]) / (len(t) - 1)
        samples = period / (steps_per_cycle * dt)
        length = np.floor(parts * samples) / parts if samples >= 1 else 1 / np.ceil(1 / samples)
        step = dt * length
        place = np.arange(len(t)) * (dt / step)
        # A sample at the end of a step is read there; only the very first one lies at a start.
        index = np.clip(np.ceil(place - 1e-9).astype(int) - 1, 0, None)
        return cls(float(t[0]), float(step), int(index[-1]) + 1, index, place - index)

    @property
    def ends(self) -> Array:
        """Times of the ends of the steps, the first start among them, (n_steps + 1,)."""
        return self.start + self.step * np.arange(self.n_steps + 1)

    def node_times(self, first: int, last: int) -> Array:
        """Times of the Gauss points of steps first to last - 1, shape (last - first, 3)."""
        return self.start + self.step * (np.arange(first, last)[:, None] + NODES)

    @cached_property
    def places(self) -> tuple[Array, Indices]:
        """Which fractions there are, few for uniform samples, and which each wanted time has."""
        return np.unique(np.round(self.fraction, 9), return_inverse=True)

    def until(self, t: float) -> Grid:
        """The part of the grid whose samples are not later than t (s)."""
        place = (self.sample_step + self.fraction) * self.step
        kept = int(np.searchsorted(place, t - self.start, side="right"))
        index = self.sample_step[:kept]
        return Grid(self.start, self.step, int(index[-1]) + 1, index, self.fraction[:kept])

    def between(self, first: int, last: int) -> Grid:
        """Steps first to last - 1, with the samples in them."""
        inside = (self.sample_step >= first) & (self.sample_step < last)
        start = self.start + first * self.step
        return Grid(
            start, self.step, last - first, self.sample_step[inside] - first, self.fraction[inside]
        )


@dataclass(frozen=True)
class Abreast(Grid):
    """Steps of several motions, one after the other, and of what lies between, at their times."""

    times: Array  # (n_steps, 3), of the Gauss points

    def node_times(self, first: int, last: int) -> Array:
        return self.times[first:last]


@dataclass(frozen=True)
class Trajectory:
    """A motion on a grid: q and q_dot at the start of each step, q_ddot at its Gauss points.

    Shapes (n_steps + 1, R), (n_steps + 1, R) and (n_steps, 3, R) for R coordinates.
    """

    grid: Grid
    q: Array
    q_dot: Array
    q_ddot: Array

    @property
    def start(self) -> Array:
        """State at the start: q, then q_dot, (2 R,)."""
        return np.concatenate([self.q[0], self.q_dot[0]])

    def between(self, first: int, last: int) -> Trajectory:
        """The motion in steps first to last - 1."""
        grid, ends = self.grid.between(first, last), slice(first, last + 1)
        return Trajectory(grid, self.q[ends], self.q_dot[ends], self.q_ddot[first:last])

    @classmethod
    def joined(cls, grid: Grid, pieces: Sequence[Trajectory]) -> Trajectory:
        """Motions that follow one another on a grid; where two meet, the state is the later's."""
        q, q_dot = (
            np.concatenate([*(x[:-1] for x in several), several[-1][-1:]])
            for several in ([p.q for p in pieces], [p.q_dot for p in pieces])
        )
        return cls(grid, q, q_dot, np.concatenate([p.q_ddot for p in pieces]))

    def samples(self, equation: Equation, derivative: int = 0) -> Array:
        """q (derivative 0), q_dot (1) or q_ddot (2) at the wanted times, shape (n, R)."""
        q_ddot = end_states(equation, self)[3]
        return interpolated(self.grid, derivative, self.q, self.q_dot, q_ddot)


def end_states(equation: Equation, motion: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Times, q, q_dot and q_ddot at the ends of the steps, where the equation gives q_ddot."""
    t = motion.grid.ends
    ends = equation.linearise(t, motion.q, motion.q_dot, np.zeros_like(motion.q))
    q_ddot = -(inverse(ends.by_q_ddot)[0] @ ends.residual[..., None])[..., 0]
    return t, motion.q, motion.q_dot, q_ddot


def interpolated(grid: Grid, derivative: int, q: Array, q_dot: Array, q_ddot: Array) -> Array:
    """A derivative of q at the wanted times from values at step ends, (n_steps + 1, ...) each.

    A quintic over each step: values at its ends have order six, those inside the step five.
    """
    h = grid.step
    ends = np.stack([q, h * q_dot, h * h * q_ddot], axis=1).reshape(len(q), 3, -1)
    steps = np.concatenate([ends[:-1], ends[1:]], axis=1)
    fractions, kind = grid.places
    values = (_hermite(fractions, derivative) / h**derivative) @ steps
    return values[grid.sample_step, kind].reshape(-1, *q.shape[1:])


def integrate(
    equation: Equation, state: Sequence[float] | Array, grid: Grid, guess: Trajectory | None = None
) -> Trajectory:
    """Follow the motion from a state, q and q_dot (2 R,), over a grid.

    A ``guess`` is a motion with similar parameters on the same steps, or on the first of them.
    Raises a TrajectoryError if the motion diverges, or M(q) is not positive on the way.
    """
    n, now = grid.n_steps, np.reshape(np.asarray(state, float), (2, -1))
    r = now.shape[1]
    q, q_dot, q_ddot = np.empty((n + 1, r)), np.empty((n + 1, r)), np.empty((n, 3, r))
    q[0], q_dot[0] = now
    known = min(len(guess.q_ddot), n) if guess is not None else 0
    first, width = 0, max(known, _FIRST_WINDOW)
    while first < n:
        now = np.stack([q[first], q_dot[first]])
        if guess is not None and first < known:
            last = min(first + width, known)
            start = _shifted(guess, first, last, now)
        else:
            last = min(first + min(width, _FIRST_WINDOW), n)
            start = _linear_motion(equation, grid, first, last, now)
        window = _newton(equation, grid, first, now, start)
        if window is not None and _resolved(
            grid.step, *window, float(np.abs(q[: first + 1]).max())
        ):
            q[first : last + 1], q_dot[first : last + 1], q_ddot[first:last] = window
            if isinstance(equation, RememberingEquation):
                at = (*at_nodes(grid.step, *window), window[2])
                t = grid.node_times(first, last).ravel()
                equation = equation.after(t, *(x.reshape(-1, r) for x in at))
            first, width = last, 2 * (last - first)
        elif last - first > 1:
            width = (last - first) // 4 or 1
        elif first < known:
            known = 0  # the other motion misleads
        elif (rest := _stopped(equation, grid, first, now)) is not None:
            where, last = rest
            q[first + 1 : last + 1], q_dot[first + 1 : last + 1], q_ddot[first:last] = where, 0, 0
            first, width = last, _FIRST_WINDOW
        else:
            end = grid.start + first * grid.step
            done = (q[: first + 1], q_dot[: first + 1], q_ddot[:first])
            raise TrajectoryError(
                f"the motion cannot be followed beyond t = {end:.6g} s,"
                f" q = {_digits(now[0])}, q_dot = {_digits(now[1])}: it diverges, or 1 + h(q) is"
                " not positive there",
                Trajectory(grid.until(end), *done) if first > 0 else None,
            )
    return Trajectory(grid, q, q_dot, q_ddot)


def _resolved(h: float, q: Array, q_dot: Array, q_ddot: Array, reach: float) -> bool:
    """Whether steps are short against the motion: else it escapes, or solves the steps only.

    An oscillation at twenty steps a cycle has |q_ddot| h^2 = 0.1 |q|.
    """
    reach = max(reach, float(np.abs(q).max())) + h * float(np.abs(q_dot).max())
    return bool(np.abs(q_ddot).max() * h * h <= reach)


def _stopped(equation: Equation, grid: Grid, first: int, now: Array) -> tuple[Array, int] | None:
    """Where friction holds what stops within a step, and up to which step; None where it does not.

    At rest the force lies between those that meet a motion either way; it may change in time.
    """
    q, q_dot = now[:1], now[1:]
    t = grid.start + grid.step * np.arange(first, grid.n_steps + 1)
    at = equation.linearise(t[:1], q, q_dot, np.zeros_like(q))
    slowing = (inverse(at.by_q_ddot)[0] @ at.residual[..., None])[..., 0]
    with np.errstate(all="ignore"):
        stop = np.where(q_dot == 0, 0.0, q_dot / slowing)  # s
    if not np.all((stop >= 0) & (stop <= grid.step)):
        return None
    where = np.repeat(q + q_dot * stop / 2, len(t), axis=0)
    creep = np.full_like(where, np.finfo(float).eps)
    onward, back = (
        equation.linearise(t, where, v, np.zeros_like(v)).residual for v in (creep, -creep)
    )
    held = np.all((onward >= 0) & (back <= 0), axis=1)
    steps = len(t) - 1 if np.all(held) else int(np.argmin(held))
    return (where[0], first + steps) if steps else None


def _digits(x: Array) -> str:
    return ", ".join(f"{value:.4g}" for value in x)


def _shifted(guess: Trajectory, first: int, last: int, now: Array) -> Array:
    """Accelerations of another motion, moved in time and scaled to go through a state (2, R).

    After many cycles two motions differ mostly by their phase: each coordinate by its own.
    """
    times = guess.grid.step * (np.arange(len(guess.q_ddot))[:, None] + NODES)
    found = guess.q_ddot[first:last].copy()
    spread = np.std(guess.q[first : last + 1], axis=0) + 1e-300
    for i, omega in enumerate(np.sqrt(np.std(found, axis=(0, 1)) / spread)):
        rate = float(omega) or 1.0
        wanted = complex(now[0, i], -now[1, i] / rate)
        then = complex(guess.q[first, i], -guess.q_dot[first, i] / rate)
        if wanted == then or not abs(then) * rate:
            continue
        late = np.angle(wanted / then) / rate
        a = np.interp(times[first:last] + late, times.ravel(), guess.q_ddot[..., i].ravel())
        found[..., i] = abs(wanted / then) * a
    return found


def _linear_motion(equation: Equation, grid: Grid, first: int, last: int, now: Array) -> Array:
    """Acceleration, (steps, 3, R), of the equation without damping, linearised at a state (2, R).

    In its normal modes; one without stiffness, or where it is negative, keeps its acceleration.
    """
    t = grid.node_times(first, last)
    at = equation.linearise(t[:1, 0], now[:1], now[1:], np.zeros_like(now[:1]))
    residual, stiffness, _, mass = (x[0] for x in at)
    finite = np.all(np.isfinite(stiffness) & np.isfinite(mass))
    if not finite or not np.all(inverse(at.by_q_ddot)[1] > 0):
        return np.zeros((*t.shape, len(mass)))
    squared, modes = eigh((stiffness + stiffness.T) / 2, mass)
    omega = np.sqrt(np.maximum(squared, 0.0))
    phase = omega * (t - grid.start - first * grid.step)[..., None]
    a, v = -modes.T @ residual, modes.T @ mass @ now[1]
    return (a * np.cos(phase) - omega * v * np.sin(phase)) @ modes.T


def _newton(
    equation: Equation, grid: Grid, first: int, now: Array, q_ddot: Array
) -> tuple[Array, Array, Array] | None:
    """States and accelerations of one window, or None where Newton's method fails."""
    t = grid.node_times(first, first + len(q_ddot))
    tried: list[tuple[Array, Array]] = []  # accelerations and what corrects them, the last ones
    last_size = np.inf
    for left in reversed(range(_ITERATIONS)):
        q, q_dot = _states(grid.step, now, q_ddot)
        with np.errstate(all="ignore"):
            system = LinearSteps.at(equation, grid.step, t, q, q_dot, q_ddot)
            correction = system.solve(-system.residual[..., None])[2][..., 0]
        size = float(np.abs(correction).max())
        scale = float(np.abs(q_ddot).max()) + size
        if not np.isfinite(size) or size > 10 * last_size:
            return None
        # Too slow to end in time, if it goes on like this.
        if (
            left < _ITERATIONS // 2
            and size * (size / last_size) ** left > _FAR * _CONVERGED * scale
        ):
            return None
        tried = [*tried[-_MIXED:], (q_ddot, correction)] if size > _SLOW * last_size else []
        q_ddot = _mixed(tried) if len(tried) > 1 else q_ddot + correction
        if size <= _CONVERGED * scale:
            q, q_dot = _states(grid.step, now, q_ddot)
            return (q, q_dot, q_ddot) if system.positive else None
        last_size = size
    return None


def _mixed(tried: Sequence[tuple[Array, Array]]) -> Array:
    """Where corrections vanish, as the last of them change: Anderson's mixing.

    Slopes of forces that remember are no more than about right, and Newton's steps converge slowly.
    D. G. Anderson, Journal of the ACM 12 (1965) 547-560.
    """
    at, step = (np.array([x[i].ravel() for x in tried]) for i in (0, 1))
    moved, changed = np.diff(at, axis=0), np.diff(step, axis=0)
    share = np.linalg.lstsq(changed.T, step[-1])[0]
    return (at[-1] + step[-1] - share @ (moved + changed)).reshape(tried[0][0].shape)


def _states(h: float, now: Array, q_ddot: Array) -> tuple[Array, Array]:
    """q and q_dot at the ends of the steps, from the accelerations inside."""
    rise, gain = gains(h, q_ddot)
    q_dot = np.cumsum(np.concatenate([now[1:], gain]), axis=0)
    return np.cumsum(np.concatenate([now[:1], h * q_dot[:-1] + rise]), axis=0), q_dot
