"""Motions near a given one, by linear equations: Bellman's quasilinearisation.

A measured motion, smoothed, nearly satisfies the right equation of motion. The equation
linearised about it gives, by one banded solve, how the motion must change so that it does, and
how it changes with every parameter, candidate force and initial state. Fits that start from the
measured motion need no growing horizon: the phase is right from the beginning.

[1] R. Bellman, R. Kalaba, "Quasilinearization and Nonlinear Boundary-Value Problems", 1965.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from romsindy.fit.kernel.collocation import Abreast, Grid, Trajectory, end_states, interpolated
from romsindy.fit.kernel.linear_steps import (
    Equation,
    LinearSteps,
    RememberingEquation,
    at_nodes,
    gains,
    inverse,
    quadrature,
)
from romsindy.typing import Array, Indices

# Of what forces that remember do beside their slopes: how often, and to which part of a change.
_CORRECTIONS, _SAME = 30, 1e-4


def nodes(motion: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Times (3 n_steps,), q, q_dot and q_ddot (3 n_steps, R) at the Gauss points."""
    grid, r = motion.grid, motion.q.shape[1]
    q, q_dot = at_nodes(grid.step, motion.q, motion.q_dot, motion.q_ddot)
    flat = [x.reshape(-1, r) for x in (q, q_dot, motion.q_ddot)]
    return grid.node_times(0, grid.n_steps).ravel(), flat[0], flat[1], flat[2]


def sampled(motion: Trajectory, derivative: int = 0) -> Array:
    """q, q_dot or q_ddot at the wanted times, (n, R), from the parabola of each step's q_ddot."""
    return inside(motion.grid, motion.q, motion.q_dot, motion.q_ddot, derivative)


@dataclass(frozen=True)
class Response:
    """Changes of a motion: column 0 makes it satisfy its equation, the others are small forces.

    The last 2 R columns are changes of q and q_dot at the start. Shapes (n_steps + 1, R, m),
    (n_steps + 1, R, m), (n_steps, 3, R, m).
    """

    motion: Trajectory
    q: Array
    q_dot: Array
    q_ddot: Array

    def samples(self, derivative: int = 0) -> Array:
        """Changes at the wanted times, (n, R, m)."""
        return inside(self.motion.grid, self.q, self.q_dot, self.q_ddot, derivative)

    def moved(self, weights: Array) -> Trajectory:
        """The motion plus the columns times their weights, (m,)."""
        m = self.motion
        return replace(
            m,
            q=m.q + self.q @ weights,
            q_dot=m.q_dot + self.q_dot @ weights,
            q_ddot=m.q_ddot + self.q_ddot @ weights,
        )


def respond(
    equation: Equation,
    motion: Trajectory,
    forces: Array | None = None,
    between: Sequence[int] = (),
) -> Response:
    """Linear response of a motion that need not satisfy the equation, nor join from step to step.

    ``forces`` (m, 3 n_steps, R) are added to the residual at the Gauss points, each for one column:
    by default its derivatives by the values of the equation. Steps ``between`` motions that stand
    one after the other lead from each to the start of the next.
    """
    if forces is None:
        forces = equation.by_parameter(*nodes(motion))
    h, state = motion.grid.step, (motion.q, motion.q_dot, motion.q_ddot)
    t = motion.grid.node_times(0, motion.grid.n_steps)
    system = replace(LinearSteps.at(equation, h, t, *state), between=between)
    residual = system.residual.reshape(1, *forces.shape[1:])
    force, start = _columns(motion, -np.concatenate([residual, forces]))
    jump = np.zeros((len(t), *start.shape))
    rise, gain = gains(h, motion.q_ddot)
    jump[:, 0, :, 0] = motion.q[:-1] + h * motion.q_dot[:-1] + rise - motion.q[1:]
    jump[:, 1, :, 0] = motion.q_dot[:-1] + gain - motion.q_dot[1:]
    return Response(motion, *_solved(equation, motion, system, force, start, jump))


def respond_together(equation: Equation, motions: Sequence[Trajectory]) -> list[Response]:
    """`respond` of motions with steps of one length, by one equation.

    All at once: of short motions most of the time goes into calls, not into numbers.
    """
    if len(motions) == 1:
        return [respond(equation, motions[0])]
    gap = np.zeros((1, *motions[0].q_ddot.shape[1:]))
    q_ddot = np.concatenate([x for m in motions for x in (m.q_ddot, gap)][:-1])
    times = [x for m in motions for x in (m.grid.node_times(0, m.grid.n_steps), gap[..., 0])]
    q, q_dot = (np.concatenate(x) for x in zip(*((m.q, m.q_dot) for m in motions), strict=True))
    firsts, none = np.cumsum([0, *(len(m.q) for m in motions)]), np.zeros(0)
    step, t = motions[0].grid.step, np.concatenate(times[:-1])
    joined = Trajectory(Abreast(0.0, step, len(t), none, none, t), q, q_dot, q_ddot)
    found = respond(equation, joined, between=(firsts[1:-1] - 1).tolist())
    return [
        Response(m, found.q[a:b], found.q_dot[a:b], found.q_ddot[a : b - 1])
        for m, (a, b) in zip(motions, itertools.pairwise(firsts), strict=True)
    ]


def sensitivity(equation: Equation, motion: Trajectory, derivative: int = 0) -> Array:
    """Exact derivatives of a (discrete) motion by parameters and initial state.

    Of q (derivative 0), q_dot (1) or q_ddot (2) at the wanted times, (n, R, n_parameters + 2 R);
    the last columns belong to q at the start, then to q_dot.
    """
    grid, h = motion.grid, motion.grid.step
    t = grid.node_times(0, grid.n_steps)
    system = LinearSteps.at(equation, h, t, motion.q, motion.q_dot, motion.q_ddot)
    force = equation.by_parameter(*nodes(motion))
    q, q_dot, _ = _solved(equation, motion, system, *_columns(motion, -force))
    q_ddot = _end_acceleration(equation, motion, q, q_dot)
    return interpolated(grid, derivative, q, q_dot, q_ddot)


def _solved(
    equation: Equation,
    motion: Trajectory,
    system: LinearSteps,
    columns: Array,
    start: Array,
    jump: Array | None = None,
) -> tuple[Array, Array, Array]:
    """What `LinearSteps.solve` gives, and what forces that remember add to it.

    Linear ones are carried from step to step. Slopes of others are those of slow changes: what
    these miss is computed from the changes, and brought in as a force, until nothing more changes.
    """
    q, q_dot, q_ddot = system.solve(columns, start, jump)
    if not (isinstance(equation, RememberingEquation) and equation.slides):
        return q, q_dot, q_ddot
    at, (n, _, r, m) = nodes(motion), columns.shape
    moving = np.arange(m)  # columns that still change
    for _ in range(_CORRECTIONS):
        now = (x[..., moving] for x in (q, q_dot, q_ddot))
        flat = at_nodes(system.h, *(x.reshape(*x.shape[:-2], -1) for x in now))
        d, v = (x.reshape(-1, r, len(moving)) for x in flat)
        missed = equation.beyond_slopes(at, d, v)
        pushed = columns[..., moving] - missed.transpose(1, 2, 0).reshape(n, 3, r, len(moving))
        shifted = None if jump is None else jump[..., moving]
        before, solved = q[..., moving], system.solve(pushed, start[..., moving], shifted)
        for x, new in zip((q, q_dot, q_ddot), solved, strict=True):
            x[..., moving] = new
        changed = np.abs(solved[0] - before).max(axis=(0, 1))
        moving = moving[changed > _SAME * np.abs(solved[0]).max(axis=(0, 1))]
        if not len(moving):
            break
    return q, q_dot, q_ddot


def states_shown(grid: Grid, system: LinearSteps, derivative: int = 0) -> tuple[Indices, Array]:
    """At which step's start the state tells each wanted time, (n,), and its derivatives by it.

    Those of q, q_dot or q_ddot by q and q_dot there, (n, R, 2 R).
    """
    wide = system.mass.shape[-1]
    q, q_dot = np.split(np.tile(np.eye(2 * wide), (grid.n_steps + 1, 1, 1)), 2, axis=1)
    q_ddot = system.by_start.reshape(-1, 3, wide, 2 * wide)
    at_end = (grid.fraction > 1 - 1e-9) & (derivative == 0)
    return (grid.sample_step + at_end).astype(int), inside(grid, q, q_dot, q_ddot, derivative)


def _end_acceleration(equation: Equation, motion: Trajectory, q: Array, q_dot: Array) -> Array:
    """Change of q_ddot at the ends of the steps, from that of q, q_dot and the parameters."""
    state = end_states(equation, motion)
    at = equation.linearise(*state)
    force = at.by_q @ q + at.by_q_dot @ q_dot
    slopes = equation.by_parameter(*state)
    force[..., : len(slopes)] += slopes.transpose(1, 2, 0)
    if isinstance(equation, RememberingEquation):
        force += equation.beyond_slopes(state, q, q_dot, carried=True).transpose(1, 2, 0)
    return -inverse(at.by_q_ddot)[0] @ force


def _columns(motion: Trajectory, force: Array) -> tuple[Array, Array]:
    """Forces (m, 3 n_steps, R), then unit changes of the first state, as columns of `solve`."""
    n, _, r = motion.q_ddot.shape
    m = len(force)
    wide = np.zeros((n, 3, r, m + 2 * r))
    wide[..., :m] = force.transpose(1, 2, 0).reshape(n, 3, r, m)
    start = np.zeros((2 * r, m + 2 * r))
    start[:, m:] = np.eye(2 * r)
    return wide, start.reshape(2, r, -1)


def inside(grid: Grid, q: Array, q_dot: Array, q_ddot: Array, derivative: int) -> Array:
    """A derivative of q at the wanted times, (n, ...), from the parabola of each step's q_ddot."""
    h = grid.step
    fractions, kind = grid.places
    weights = quadrature(fractions, derivative)
    out = np.empty((len(kind), *q.shape[1:]))
    for i, theta in enumerate(fractions):
        rows = kind == i
        k = grid.sample_step[rows]
        if derivative == 0 and theta == 1.0:
            out[rows] = q[k + 1]
            continue
        part = np.tensordot(weights[i], q_ddot[k], axes=([0], [1]))
        if derivative == 0:
            out[rows] = q[k] + theta * h * q_dot[k] + h * h * part
        else:
            out[rows] = q_dot[k] + h * part if derivative == 1 else part
    return out
