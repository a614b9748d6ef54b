"""The equation of motion, linearised over many steps of Gauss-Legendre collocation at once.

A step of length h carries q and q_dot at its start and q_ddot at the three Gauss points. The
equation of motion holds at these points; q and q_dot follow by the quadrature of [1] (order six,
symplectic, unconditionally stable). What is left is a recursion from step to step: a banded
triangular system for the R coordinates and their velocities.

[1] E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential Equations I", section
    II.14 (Nystroem methods) and "Geometric Numerical Integration", section II.1.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from scipy.linalg.lapack import dtbtrs

from romsindy.typing import Array


class Linearisation(NamedTuple):
    """Residual of the equation of motion, (n, R), and its derivatives, (n, R, R) each.

    Rows are equations, columns coordinates; ``by_q_ddot`` is the mass matrix, positive definite.
    """

    residual: Array
    by_q: Array
    by_q_dot: Array
    by_q_ddot: Array


class Equation(Protocol):
    """R equations of motion F(t, q, q_dot, q_ddot) = 0 for R coordinates, linear in q_ddot.

    An input u(t), such as a measured excitation, is part of the equation, which evaluates it at the
    times that it is asked for.
    """

    def linearise(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Linearisation:
        """F and its derivatives at (n,) times (s) and (n, R) states."""

    def by_parameter(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """dF/dp for every parameter, shape (n_parameters, n, R)."""


class Carried(NamedTuple):
    """What forces on one coordinate that are linear in the motion so far do beside their slopes.

    They remember k values. What these do at the start of any step to the forces at its Gauss
    points, (3, k), and to the values at the start of the next, (k, k); and what q and q_dot at the
    Gauss points of each of n steps do to these, (n, 3, 3, 2) and (n, k, 3, 2).
    """

    by_values: Array
    by_motion: Array
    values_on: Array
    motion_on: Array


@runtime_checkable
class RememberingEquation(Protocol):
    """An equation whose forces may depend on the motion so far, from its first time on."""

    def carried(self, *motion: Array) -> Carried | None:
        """What linear ones remember from step to step, of times (n,) and states (n, R)."""

    @property
    def slides(self) -> bool:
        """Whether others do, of which `beyond_slopes` is to be asked."""

    def beyond_slopes(
        self, motion: tuple[Array, ...], q: Array, q_dot: Array, carried: bool = False
    ) -> Array:
        """What small changes (n, R, m) of q and q_dot do beside the slopes of `linearise`.

        ``motion`` are times (n,), q, q_dot and q_ddot (n, R); the result is (m, n, R). Forces that
        steps carry count where ``carried``.
        """

    def after(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Equation:
        """The equation of the motion that goes on from the end of this one, (n, R) states."""


NODES = (np.polynomial.legendre.leggauss(3)[0] + 1) / 2
_LAGRANGE = np.linalg.inv(np.vander(NODES, 3, increasing=True))  # powers to nodes


def quadrature(theta: Array, derivative: int) -> Array:
    """What q_ddot at the Gauss points adds at fractions theta of a step of length one, (n, 3).

    To q (derivative 0), q_dot (1) or q_ddot (2), by the parabola through q_ddot.
    """
    powers, fold = np.arange(3), 2 - derivative
    factor = np.prod([powers + i + 1.0 for i in range(fold)], axis=0)
    return np.asarray(theta)[:, None] ** (powers + fold) / factor @ _LAGRANGE


_TWICE, _ONCE = quadrature(NODES, 0), quadrature(NODES, 1)
_END = np.stack([quadrature(np.ones(1), d)[0] for d in (0, 1)])


def at_nodes(h: float, q: Array, q_dot: Array, q_ddot: Array) -> tuple[Array, Array]:
    """q and q_dot at the Gauss points, (n, 3, R) each, of steps as in a Trajectory."""
    v_node = q_dot[:-1, None] + h * np.einsum("ij,njr->nir", _ONCE, q_ddot)
    q_node = q[:-1, None] + h * q_dot[:-1, None] * NODES[:, None]
    return q_node + h * h * np.einsum("ij,njr->nir", _TWICE, q_ddot), v_node


def gains(h: float, q_ddot: Array) -> tuple[Array, Array]:
    """What the accelerations (n, 3, R) of steps add to q and to q_dot at their ends, (n, R)."""
    gain = np.einsum("ei,nir->enr", _END, q_ddot)
    return h * h * gain[0], h * gain[1]


@dataclass(frozen=True)
class LinearSteps:
    """The linearised equations of all steps of a window.

    The state at the start of a step is q, q_dot and the k values that forces remember.
    """

    h: float
    residual: Array  # (n, 3, R)
    stages: Array  # (n, 3 R, 3 R): what the accelerations do to the residual
    by_state: Array  # (n, 3 R, 2 R + k): what the state at the start of the step does to it
    mass: Array  # (3 n, R, R)
    # What the accelerations and the state at the start do to the state at the end, of every step or
    # of all, (., 2 R + k, 3 R) and (., 2 R + k, 2 R + k)
    end: Array
    kept: Array
    between: Sequence[int] = ()  # steps that only lead from one motion to the start of the next

    @classmethod
    def at(
        cls,
        equation: Equation,
        h: float,
        t: Array,
        q: Array,
        q_dot: Array,
        q_ddot: Array,
        remember: bool = True,
    ) -> LinearSteps:
        """Linearise about a motion: times (n, 3), and its arrays as in a Trajectory.

        Of forces that remember there are their slopes alone where they are not to ``remember``.
        """
        n, r = len(t), q.shape[1]
        states = (*at_nodes(h, q, q_dot, q_ddot), q_ddot)
        motion = (t.ravel(), *(x.reshape(-1, r) for x in states))
        flat = equation.linearise(*motion)
        by_q, by_v, by_a = (x.reshape(n, 3, r, r) for x in flat[1:])
        once, twice = (h * _ONCE)[:, None, :, None], (h * h * _TWICE)[:, None, :, None]
        stages = by_q[:, :, :, None] * twice + by_v[:, :, :, None] * once
        point = np.arange(3)
        stages[:, point, :, point] += by_a.swapaxes(0, 1)
        by_state = np.concatenate([by_q, by_v + h * NODES[:, None, None] * by_q], axis=-1)
        system = cls(
            h,
            flat.residual.reshape(n, 3, r),
            stages.reshape(n, 3 * r, 3 * r),
            by_state.reshape(n, 3 * r, 2 * r),
            flat.by_q_ddot,
            _for_each(_END * [[h**2], [h]], r)[None],
            _for_each(np.array([[1.0, h], [0.0, 1.0]]), r)[None],
        )
        carried = None
        if remember and isinstance(equation, RememberingEquation):
            carried = equation.carried(*motion)
        return system if carried is None else system._remembering(carried)

    def _remembering(self, carried: Carried) -> LinearSteps:
        """With the values that forces remember in the state."""
        h, k, n = self.h, len(carried.values_on), len(self.stages)
        # q and q_dot at the Gauss points, by q and q_dot at the start, and by the accelerations
        start = np.stack([[[1.0, h * node], [0.0, 1.0]] for node in NODES])
        inside = np.stack([h * h * _TWICE, h * _ONCE], axis=1)
        forced, handed = (
            [np.tensordot(x, y, 2) for y in (start, inside)]
            for x in (carried.by_motion, carried.motion_on)
        )
        end = np.concatenate([np.repeat(self.end, n, axis=0), handed[1]], axis=1)
        kept = np.zeros((n, 2 + k, 2 + k))
        kept[:, :2, :2], kept[:, 2:, :2], kept[:, 2:, 2:] = self.kept, handed[0], carried.values_on
        remembered = np.tile(carried.by_values, (n, 1, 1))
        by_state = np.concatenate([self.by_state + forced[0], remembered], axis=2)
        return replace(self, stages=self.stages + forced[1], by_state=by_state, end=end, kept=kept)

    @property
    def positive(self) -> bool:
        """Whether the mass matrix is positive definite at every Gauss point."""
        return bool(np.all(inverse(self.mass)[1] > 0))

    @cached_property
    def _solved(self) -> Array:
        return inverse(self.stages)[0]

    @cached_property
    def by_start(self) -> Array:
        """What the state at the start of a step does to q_ddot in it, (n, 3 R, 2 R + k)."""
        return -self._solved @ self.by_state

    @cached_property
    def transition(self) -> Array:
        """What the state at the start of a step does to that at its end, (n, 2 R + k, 2 R + k)."""
        found = self.end @ self.by_start + self.kept
        found[[*self.between]] = 0.0
        return found

    def solve(
        self, force: Array, start: Array | None = None, jump: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Small changes of q, q_dot (n + 1, R, m) and q_ddot (n, 3, R, m) by a residual -force.

        ``force`` has shape (n, 3, R, m), ``start`` the change of the first state, (2, R, m), of
        every motion, ``jump`` (n, 2, R, m) what is added to q and q_dot at the end of each step.
        """
        n, _, r, m = force.shape
        direct = self._solved @ force.reshape(n, 3 * r, m)
        x = np.zeros((n + 1, self.end.shape[1], m))
        x[1:] = self.end @ direct
        if jump is not None:
            x[1:, : 2 * r] += jump.reshape(n, 2 * r, m)
        if start is not None:
            x[[0, *(step + 1 for step in self.between)], : 2 * r] = start.reshape(2 * r, m)
        states = _recursion(self.transition, x)
        q_ddot = direct + self.by_start @ states[:n]
        return states[:, :r], states[:, r : 2 * r], q_ddot.reshape(force.shape)


def _for_each(a: Array, r: int) -> Array:
    """A matrix that acts on each of R coordinates alike: its Kronecker product with the unit."""
    return (a[:, None, :, None] * np.eye(r)[:, None]).reshape(len(a) * r, -1)


@np.errstate(all="ignore")  # a singular matrix has a pivot that is not positive, and says so
def inverse(a: Array) -> tuple[Array, Array]:
    """Inverses (n, k, k) and pivots (n, k) of many small matrices, by Gauss and Jordan.

    All matrices at once: several times faster than a call of LAPACK for each. Rows stay where they
    are: a mass matrix is positive definite, and the leading minors of the collocation matrices of
    [1] are positive, so that strong damping and stiffness make no pivot vanish either.
    """
    x = np.array(a.transpose(1, 2, 0), order="C")  # matrices last: long loops
    pivots = np.empty((len(x), len(a)))
    for i, pivot in enumerate(pivots):
        pivot[:] = x[i, i]
        x[i, i] = 1.0
        row, column = x[i] / pivot, x[:, i].copy()
        x[:, i] = column[i] = 0.0
        x[i] = row
        x -= column[:, None] * row
    return x.transpose(2, 0, 1).copy(), pivots.T


def _recursion(transition: Array, force: Array) -> Array:
    """x[k + 1] = transition[k] x[k] + force[k + 1] from x[0] = force[0] on, (n + 1, width, m)."""
    n, width, m = force.shape
    band = np.zeros((2 * width, n * width))
    for i in range(width):
        for j in range(width):
            band[width + i - j, j:-width:width] = -transition[:, i, j]
    solution, info = dtbtrs(band, force.reshape(n * width, m), uplo="L", diag="U")
    if info:
        raise ValueError(f"banded solve failed with info = {info}")
    return np.ascontiguousarray(solution).reshape(n, width, m)
