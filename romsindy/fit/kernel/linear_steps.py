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
from dataclasses import dataclass
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


@runtime_checkable
class RememberingEquation(Protocol):
    """An equation whose forces may depend on the motion so far, from its first time on."""

    @property
    def remembers(self) -> bool:
        """Whether they do, and `beyond_slopes` is to be asked."""

    def beyond_slopes(self, motion: tuple[Array, ...], q: Array, q_dot: Array) -> Array:
        """What small changes (n, R, m) of q and q_dot do beside the slopes of `linearise`.

        ``motion`` are times (n,), q, q_dot and q_ddot (n, R); the result is (m, n, R).
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
    """The linearised equations of all steps of a window."""

    h: float
    residual: Array  # (n, 3, R)
    stages: Array  # (n, 3 R, 3 R): what the accelerations do to the residual
    by_state: Array  # (n, 3 R, 2 R): what q and q_dot at the start of the step do to it
    mass: Array  # (3 n, R, R)
    between: Sequence[int] = ()  # steps that only lead from one motion to the start of the next

    @classmethod
    def at(
        cls, equation: Equation, h: float, t: Array, q: Array, q_dot: Array, q_ddot: Array
    ) -> LinearSteps:
        """Linearise about a motion: times (n, 3), and its arrays as in a Trajectory."""
        n, r = len(t), q.shape[1]
        states = (*at_nodes(h, q, q_dot, q_ddot), q_ddot)
        flat = equation.linearise(t.ravel(), *(x.reshape(-1, r) for x in states))
        by_q, by_v, by_a = (x.reshape(n, 3, r, r) for x in flat[1:])
        once, twice = (h * _ONCE)[:, None, :, None], (h * h * _TWICE)[:, None, :, None]
        stages = by_q[:, :, :, None] * twice + by_v[:, :, :, None] * once
        point = np.arange(3)
        stages[:, point, :, point] += by_a.swapaxes(0, 1)
        by_state = np.concatenate([by_q, by_v + h * NODES[:, None, None] * by_q], axis=-1)
        return cls(
            h,
            flat.residual.reshape(n, 3, r),
            stages.reshape(n, 3 * r, 3 * r),
            by_state.reshape(n, 3 * r, 2 * r),
            flat.by_q_ddot,
        )

    @property
    def positive(self) -> bool:
        """Whether the mass matrix is positive definite at every Gauss point."""
        return bool(np.all(inverse(self.mass)[1] > 0))

    @cached_property
    def _solved(self) -> Array:
        return inverse(self.stages)[0]

    @cached_property
    def by_start(self) -> Array:
        """What q and q_dot at the start of a step do to q_ddot in it, (n, 3 R, 2 R)."""
        return -self._solved @ self.by_state

    @cached_property
    def transition(self) -> Array:
        """What q and q_dot at the start of a step do to those at its end, (n, 2 R, 2 R)."""
        r = self.mass.shape[-1]
        found = self._end(r) @ self.by_start + _for_each(np.array([[1.0, self.h], [0.0, 1.0]]), r)
        found[[*self.between]] = 0.0
        return found

    def _end(self, r: int) -> Array:
        """What the accelerations in a step do to q and q_dot at its end, (2 R, 3 R)."""
        return _for_each(_END * [[self.h**2], [self.h]], r)

    def solve(
        self, force: Array, start: Array | None = None, jump: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Small changes of q, q_dot (n + 1, R, m) and q_ddot (n, 3, R, m) by a residual -force.

        ``force`` has shape (n, 3, R, m), ``start`` the change of the first state, (2, R, m), of
        every motion, ``jump`` (n, 2, R, m) what is added to q and q_dot at the end of each step.
        """
        n, _, r, m = force.shape
        direct = self._solved @ force.reshape(n, 3 * r, m)
        x = np.zeros((n + 1, 2 * r, m))
        x[1:] = self._end(r) @ direct
        if jump is not None:
            x[1:] += jump.reshape(n, 2 * r, m)
        if start is not None:
            x[[0, *(step + 1 for step in self.between)]] = start.reshape(2 * r, m)
        states = _recursion(self.transition, x)
        q_ddot = direct + self.by_start @ states[:n]
        return states[:, :r], states[:, r:], q_ddot.reshape(force.shape)


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
    """x[k + 1] = transition[k] x[k] + force[k + 1] from x[0] = force[0] on, (n + 1, 2 R, m)."""
    n, width, m = force.shape
    band = np.zeros((2 * width, n * width))
    for i in range(width):
        for j in range(width):
            band[width + i - j, j:-width:width] = -transition[:, i, j]
    solution, info = dtbtrs(band, force.reshape(n * width, m), uplo="L", diag="U")
    if info:
        raise ValueError(f"banded solve failed with info = {info}")
    return np.ascontiguousarray(solution).reshape(n, width, m)
