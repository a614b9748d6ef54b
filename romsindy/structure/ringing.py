"""Modes that ring beside the one that is held: stiffened, bent and driven by it.

With a_j = phi_j^T M x of such a mode, s_j(q) where it follows the first at rest, and r = a - s(q):

    kinetic energy    (1 + h(q) - s'^T s') q'^2 / 2 + a'^T a' / 2
    potential energy  integral K dq + r^T W(q) r / 2
    displacements     x(q) + sum_j psi_j(q) r_j

All other modes follow at rest. Both W and psi come from the tangent stiffness K_T at shapes that
were held: with Phi of all modes that are kept, the first among them,

    H = (Phi^T M K_T^-1 M Phi)^-1,    psi = K_T^-1 M Phi H

of which W is the part of the modes that ring, and psi has their columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from romsindy.structure.held import HeldCurve
from romsindy.structure.linear import Compliance
from romsindy.typing import Array

_ORDER = 8  # of changes along the curve, at most
_BEYOND = 1.02  # times the range: so far what lies outside is still foretold
_FINE = 40  # Chebyshev terms of functions of q that are asked one by one: twice the order


@dataclass(frozen=True, eq=False)
class RungModes:
    """Modes that ring beside the one that is held.

    Changes of W and psi are q times Chebyshev polynomials over the range; without a ``Compliance``
    they are those at rest.
    """

    curve: HeldCurve
    numbers: Sequence[int]
    omega2: Array  # (k,), at rest
    shapes: Array  # (k, n), at rest
    stiffer: Array  # (order, k, k), of W - omega^2
    bent: Array  # (order, k, n), of psi - phi

    @classmethod
    def of(
        cls,
        curve: HeldCurve,
        numbers: Sequence[int],
        omega2: Array,
        shapes: Array,
        known: Compliance | None,
    ) -> RungModes:
        """Modes by number, with what is known of their compliance."""
        k, n = shapes.shape
        if known is None or not k:
            return cls(curve, numbers, omega2, shapes, np.zeros((1, k, k)), np.zeros((1, k, n)))
        momenta = np.asarray(curve.mode.mass @ np.vstack([curve.mode.shape, shapes]).T)
        inner = np.linalg.inv(known.shapes @ momenta)
        stiffness = (inner + np.swapaxes(inner, 1, 2))[:, 1:, 1:] / 2
        follow = (np.swapaxes(inner, 1, 2) @ known.shapes)[:, 1:]
        order = min(len(known.at), _ORDER)
        solve = np.linalg.pinv(_powers(curve, known.at, order))
        changes = stiffness - np.diag(omega2), follow - shapes
        return cls(curve, numbers, omega2, shapes, *(np.tensordot(solve, x, 1) for x in changes))

    @cached_property
    def momenta(self) -> Array:
        """M phi, (n, k)."""
        return np.asarray(self.curve.mode.mass @ self.shapes.T)

    def rest_at(self, q: Array, slope: bool = False) -> Array:
        """s(q), or its derivative, (len(q), k)."""
        return self.curve.following_at(q, slope) @ self.momenta

    def stiffness_at(self, q: Array, slope: bool = False) -> Array:
        """W(q), or its derivative, (len(q), k, k)."""
        change = np.tensordot(_powers(self.curve, q, len(self.stiffer), slope), self.stiffer, 1)
        return change if slope else np.diag(self.omega2) + change

    def shapes_at(self, q: Array, rows: Any, slope: bool = False) -> Array:
        """psi(q) of some freedoms, or its derivative, (len(q), k, len(rows))."""
        powers = _powers(self.curve, q, len(self.bent), slope)
        change = np.tensordot(powers, self.bent[:, :, rows], 1)
        return change if slope else self.shapes[:, rows] + change

    def at_point(self, row: int) -> Callable[[float], RungValues]:
        """What the motion asks of one q after the other, at a freedom.

        They are polynomials, fitted to what they are at many points to rounding: ten times as fast.
        The function raises a ValueError for a q beyond the range.
        """
        low, high = self.curve.range
        centre, half, k = (low + high) / 2, (high - low) / 2, len(self.omega2)
        q = self.curve.evenly(_FINE)
        nodes = (q - centre) / half

        def derived(values: Array) -> Array:
            slopes = chebyshev.chebder(chebyshev.chebfit(nodes, values, _FINE - 1)) / half
            return np.asarray(chebyshev.chebval(nodes, slopes).T)

        s_q, moved, psi = (
            self.rest_at(q, True),
            self.curve.shapes_at(q)[:, row],
            self.shapes_at(q, [row])[:, :, 0],
        )
        inertia = self.curve.inertia_at(q) - np.sum(s_q**2, axis=1)
        stiffness, psi_q = self.stiffness_at(q), self.shapes_at(q, [row], True)[:, :, 0]
        moved_q = derived(moved)
        single = [
            self.curve.force_at(q),
            inertia,
            derived(inertia),
            moved,
            moved_q - np.sum(psi * s_q, axis=1),
            derived(moved_q) - np.sum(psi * derived(s_q), axis=1),
            np.sum(psi_q * s_q, axis=1),
        ]
        several = [
            self.rest_at(q),
            psi,
            psi_q,
            derived(psi_q),
            -np.einsum("ijk,ik->ij", stiffness, s_q),
        ]
        squares = [stiffness, self.stiffness_at(q, True)]
        columns = [np.array(single).T, *several, *(x.reshape(_FINE, -1) for x in squares)]
        table = chebyshev.chebfit(nodes, np.hstack(columns), _FINE - 1).T
        orders, n, m = np.arange(_FINE), len(single), len(single) + len(several) * k

        def at(q: float) -> RungValues:
            x = (q - centre) / half
            if not abs(x) < _BEYOND:
                raise ValueError(
                    f"the motion leaves the range that was held, q = {low:.4g} to {high:.4g}: hold"
                    " it over a larger one"
                )
            if abs(x) <= 1:
                terms = np.cos(orders * math.acos(x))
            else:
                terms = np.sign(x) ** orders * np.cosh(orders * np.arccosh(abs(x)))
            v = table @ terms
            vectors, matrices = v[n:m].reshape(len(several), k), v[m:].reshape(2, k, k)
            return RungValues(*v[:n].tolist(), *vectors, *matrices)

        return at


class RungValues(NamedTuple):
    """Functions of q at a freedom, whose displacement is x + psi^T r."""

    force: float  # K
    inertia: float  # m = 1 + h - s'^T s'
    inertia_q: float  # m'
    moved: float  # x
    slope: float  # x' - psi^T s', by q
    curvature: float  # x'' - psi^T s''
    turned: float  # psi'^T s'
    rest: Array  # s, (k,)
    psi: Array
    psi_q: Array
    psi_qq: Array
    pull: Array  # -W s'
    stiffness: Array  # W, (k, k)
    stiffness_q: Array  # W'


def _powers(curve: HeldCurve, q: Array, order: int, slope: bool = False) -> Array:
    """q T_k over the range, or their derivatives, (len(q), order)."""
    low, high = curve.range
    x, scale, unit = (2 * q - low - high) / (high - low), 2 / (high - low), np.eye(order)
    values = chebyshev.chebval(x, unit).T
    if not slope:
        return q[:, None] * values
    if order == 1:
        return values
    return values + q[:, None] * chebyshev.chebval(x, chebyshev.chebder(unit)).T * scale
