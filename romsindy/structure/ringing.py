"""Modes that ring beside the one that is held: stiffened, bent and driven by it.

With r_j = phi_j^T M u of such a mode, beyond where it follows the first at rest:

    displacements     u = x(q) + sum_j psi_j(q) r_j
    kinetic energy    u'^T M u' / 2
    potential energy  integral K dq + r^T W(q) r / 2

All other modes follow at rest, and what they move counts in M. Both W and psi come from the tangent
stiffness K_T at shapes that were held: with Phi of all modes that are kept, the first among them,

    H = (Phi^T M K_T^-1 M Phi)^-1,    psi = K_T^-1 M Phi H

of which W is the part of the modes that ring, and psi has their columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from romsindy.structure.held import HeldCurve
from romsindy.structure.in_time import RungTables
from romsindy.structure.linear import Compliance
from romsindy.typing import Array

_ORDER = 8  # of changes along the curve, at most
_FINE = 40  # Chebyshev terms of functions of q that are asked one by one: twice the order
# Of coefficients of a sum of Chebyshev polynomials, those of its derivative
_DERIVED = np.vstack([chebyshev.chebder(np.eye(_FINE)), np.zeros(_FINE)])


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
        solve = np.linalg.pinv(curve.chebyshev_at(known.at, 1, min(len(known.at), _ORDER)))
        changes = stiffness - np.diag(omega2), follow - shapes
        return cls(curve, numbers, omega2, shapes, *(np.tensordot(solve, x, 1) for x in changes))

    def stiffness_at(self, q: Array, slope: bool = False) -> Array:
        """W(q), or its derivative, (len(q), k, k)."""
        powers = self.curve.chebyshev_at(q, 1, len(self.stiffer), slope)
        change = np.tensordot(powers, self.stiffer, 1)
        return change if slope else np.diag(self.omega2) + change

    def shapes_at(self, q: Array, rows: Any, slope: bool = False) -> Array:
        """psi(q) of some freedoms, or its derivative, (len(q), k, len(rows))."""
        powers = self.curve.chebyshev_at(q, 1, len(self.bent), slope)
        change = np.tensordot(powers, self.bent[:, :, rows], 1)
        return change if slope else self.shapes[:, rows] + change

    @cached_property
    def products(self) -> Array:
        """B M B^T of all shapes of which others are sums: those at rest, then what follows.

        Those at rest are modes: between decks they are so nearly.
        """
        curve, k = self.curve, len(self.omega2)
        modes = np.vstack([curve.mode.shape, self.shapes])
        changes = np.vstack([curve.follows, self.bent.reshape(-1, modes.shape[1])])
        beside = np.asarray(modes @ (curve.mode.mass @ changes.T))
        beside[0] = 0.0  # by what q is
        beside[1:, len(curve.follows) :] = 0.0  # by what r is
        return np.block(
            [[np.eye(1 + k), beside], [beside.T, changes @ (curve.mode.mass @ changes.T)]]
        )

    @cached_property
    def _sampled(self) -> AlongCurve:
        curve, k = self.curve, len(self.omega2)
        low, high = curve.range
        q = curve.evenly(_FINE)
        half = (high - low) / 2
        fit = np.linalg.inv(chebyshev.chebvander((2 * q - low - high) / (high - low), _FINE - 1))

        def derived(values: Array) -> Array:
            return np.asarray(np.linalg.solve(fit, _DERIVED @ fit @ values) / half)

        along = curve.powers_at(q, slope=True)
        bends = [curve.chebyshev_at(q, 1, len(self.bent), slope) for slope in (False, True)]
        first = 1 + k + along.shape[1]
        parts = np.zeros((_FINE, 2 + 3 * k, len(self.products)))  # x', x'', psi, psi', psi''
        parts[:, 0, 0], parts[:, 0, 1 + k : first] = 1.0, along
        parts[:, 1, 1 + k : first] = derived(along)
        parts[:, 2 : 2 + k, : 1 + k] = np.eye(1 + k)[1:]
        for i, powers in enumerate((*bends, derived(bends[1]))):
            for j in range(k):
                parts[:, 2 + i * k + j, first + j :: k] = powers
        inertia = parts @ self.products @ np.swapaxes(parts, 1, 2)
        follows = along @ self.products[1 + k : first, 1 : 1 + k]
        stiffness = [self.stiffness_at(q, slope=slope) for slope in (False, True)]
        rows, columns = np.tril_indices(2 + 3 * k)
        own = inertia[:, rows, columns], curve.force_at(q), follows, *stiffness
        values = np.hstack([x.reshape(_FINE, -1) for x in own])
        return AlongCurve((low + high) / 2, half, q, fit, parts, fit @ values)

    def at_point(self, row: int, mass: float, counts: Array | float = 1.0) -> RungTables:
        """What the motion asks of one q after the other, with a mass at a freedom.

        They are polynomials, fitted to what they are at many points to rounding: ten times as fast.
        The mass ``counts`` (1 + m,) times as much in each mode: it moves others that are not here.
        """
        known = self._sampled
        phi, follows = self.curve.mode.shape[row], self.curve.follows[:, row]
        modes = counts * np.append(phi, self.shapes[:, row])
        shapes = np.array([*modes, *follows, *self.bent[:, :, row].ravel()])
        moved = known.q * phi + self.curve.powers_at(known.q) @ follows
        columns = np.column_stack([moved, known.parts @ shapes, np.full(_FINE, mass)])
        at_row = known.fit @ columns
        return RungTables(known.centre, known.half, known.table, at_row, len(self.omega2))


class AlongCurve(NamedTuple):
    """What `RungTables` hold whatever the point is."""

    centre: float  # of the range of q
    half: float  # of its length
    q: Array  # Chebyshev points of the range
    fit: Array  # coefficients from values there
    parts: Array  # of the vectors of `RungTables`, in the shapes of which they are sums
    table: Array  # of functions of the curve, (terms, values)
