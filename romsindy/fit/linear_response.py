"""Motions near a given one, by linear equations: Bellman's quasilinearisation.

A measured motion, smoothed, nearly satisfies the right equation of motion. The equation
linearised about it gives, by one banded solve, how the motion must change so that it does, and
how it changes with every parameter, candidate force and initial state. Fits that start from the
measured motion need no growing horizon: the phase is right from the beginning.

[1] R. Bellman, R. Kalaba, "Quasilinearization and Nonlinear Boundary-Value Problems", 1965.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from romsindy.fit.collocation import Equation, Grid, LinearSteps, Trajectory, at_nodes
from romsindy.typing import Array


def nodes(motion: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Times, q, q_dot and q_ddot at the Gauss points, shape (3 n_steps,) each."""
    grid = motion.grid
    t = grid.node_times(0, grid.n_steps)
    q, q_dot = at_nodes(grid.step, motion.q, motion.q_dot, motion.q_ddot)
    return t.ravel(), q.ravel(), q_dot.ravel(), motion.q_ddot.ravel()


def sampled(motion: Trajectory, derivative: int = 0) -> Array:
    """q, q_dot or q_ddot at the wanted times, (n,), from the parabola of each step's q_ddot."""
    return _inside(motion.grid, motion.q, motion.q_dot, motion.q_ddot, derivative)


@dataclass(frozen=True)
class Response:
    """Changes of a motion: column 0 makes it satisfy its equation, the others are small forces.

    The last two columns are changes of q and q_dot at the start. Shapes (n_steps + 1, m),
    (n_steps + 1, m), (n_steps, 3, m).
    """

    motion: Trajectory
    q: Array
    q_dot: Array
    q_ddot: Array

    def samples(self, derivative: int = 0) -> Array:
        """Changes at the wanted times, (n, m)."""
        return _inside(self.motion.grid, self.q, self.q_dot, self.q_ddot, derivative)

    def moved(self, weights: Array) -> Trajectory:
        """The motion plus the columns times their weights, (m,)."""
        m = self.motion
        return replace(
            m,
            q=m.q + self.q @ weights,
            q_dot=m.q_dot + self.q_dot @ weights,
            q_ddot=m.q_ddot + self.q_ddot @ weights,
        )


def respond(equation: Equation, motion: Trajectory, forces: Array) -> Response:
    """Linear response of a motion that need not satisfy the equation, nor join from step to step.

    Parameters
    ----------
    equation : Equation
    motion : Trajectory
        For example a smoothed measurement.
    forces : (m, 3 n_steps) array
        Additions to the residual at the Gauss points, each for one column.
    """
    grid, h, n = motion.grid, motion.grid.step, motion.grid.n_steps
    t = grid.node_times(0, n)
    system = LinearSteps.at(equation, h, t, motion.q, motion.q_dot, motion.q_ddot)
    m = len(forces) + 3
    force = np.zeros((n, 3, m))
    force[..., 0] = -system.residual
    force[..., 1:-2] = -forces.T.reshape(n, 3, m - 3)
    start = np.zeros((2, m))
    start[0, -2] = start[1, -1] = 1.0
    end_q, end_q_dot = _step_ends(h, motion.q, motion.q_dot, motion.q_ddot)
    jump = np.zeros((n, 2, m))
    jump[:, 0, 0] = end_q - motion.q[1:]
    jump[:, 1, 0] = end_q_dot - motion.q_dot[1:]
    return Response(motion, *system.solve(force, start, jump))


def _step_ends(h: float, q: Array, q_dot: Array, q_ddot: Array) -> tuple[Array, Array]:
    displacement, velocity = (_weights(np.ones(1), d)[0] for d in (0, 1))
    end_q = q[:-1] + h * q_dot[:-1] + h * h * q_ddot @ displacement
    return end_q, q_dot[:-1] + h * q_ddot @ velocity


def _weights(theta: Array, derivative: int) -> Array:
    """What the accelerations at the Gauss points add at fractions theta of a step, (n, 3)."""
    points = (np.polynomial.legendre.leggauss(3)[0] + 1) / 2
    lagrange = np.linalg.inv(np.vander(points, 3, increasing=True))
    powers = np.arange(3)
    if derivative == 2:
        return theta[:, None] ** powers @ lagrange
    if derivative == 1:
        return theta[:, None] ** (powers + 1) / (powers + 1) @ lagrange
    return theta[:, None] ** (powers + 2) / ((powers + 1) * (powers + 2)) @ lagrange


def _inside(grid: Grid, q: Array, q_dot: Array, q_ddot: Array, derivative: int) -> Array:
    h = grid.step
    fractions, kind = np.unique(np.round(grid.fraction, 9), return_inverse=True)
    weights = _weights(fractions, derivative)
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
