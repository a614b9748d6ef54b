"""Modes that ring beside the one that is held: stiffened, bent and driven by it.

With r_j = phi_j^T M u of such a mode, beyond where it follows the first at rest:

    displacements     u = x(q) + sum_j psi_j(q) r_j
    kinetic energy    u'^T M u' / 2
    potential energy  integral K dq + r^T W(q) r / 2

All other modes follow at rest, and what they move counts in M. Both W and psi come from the tangent
stiffness K_T at shapes that were held: with Phi of all modes that are kept, the first among them,

    H = (Phi^T M K_T^-1 M Phi)^-1,    psi = K_T^-1 M Phi H

of which W is the part of the modes that ring, and psi has their columns.

Many motions are followed side by side: a step costs little more than that of one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.polynomial import chebyshev

from romsindy.simulator.force import Force, acting
from romsindy.structure import kernel
from romsindy.structure.held import HeldCurve
from romsindy.structure.linear import Compliance
from romsindy.typing import Array

_ORDER = 8  # of changes along the curve, at most
_FINE = 40  # Chebyshev terms of functions of q that are asked one by one: twice the order
# Of coefficients of a sum of Chebyshev polynomials, those of its derivative
_DERIVED = np.vstack([chebyshev.chebder(np.eye(_FINE)), np.zeros(_FINE)])


class RungValues(NamedTuple):
    """Functions of one q."""

    force: float  # K
    moved: float  # x of the point
    point: Array  # x', x'', psi, psi', psi'' there, (2 + 3 k,)
    stiffness: Array  # W, (k, k)
    stiffness_q: Array  # W'


class RungTables(NamedTuple):
    """Functions of q as sums of Chebyshev polynomials over its range.

    Those of the ``curve`` are products of x', x'', psi, psi' and psi'', the lower triangle of their
    matrix, then K, s' of the modes that ring, where these follow at rest, W and W'. Those of the
    ``point`` are x and these vectors there, and the mass that is added there.
    """

    centre: float  # of the range of q
    half: float  # of its length
    curve: Array  # (terms, values)
    point: Array  # (terms, 4 + 3 k)
    k: int  # modes that ring

    @property
    def left(self) -> str:
        """What is to be said of a motion that went there."""
        low, high = self.centre - self.half, self.centre + self.half
        return (
            f"the motion leaves the range that was held, q = {low:.4g} to {high:.4g}: hold it over"
            " a larger one"
        )

    def at(self, q: float) -> RungValues:
        """The functions at q."""
        k, terms = self.k, np.empty(len(self.curve))
        kernel.polynomials((q - self.centre) / self.half, terms)
        moved, *point, _ = terms @ self.point
        v = (terms @ self.curve)[(2 + 3 * k) * (3 + 3 * k) // 2 :]
        stiffness, slope = v[1 + k :].reshape(2, k, k)
        return RungValues(float(v[0]), float(moved), np.array(point), stiffness, slope)


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


# -- in time --------------------------------------------------------------------------------------

_TURN = 1.0  # rad of the fastest mode in a step, at the most: what is beside it turns it little
_MOST = 64  # motions at once: their tables fit into the cache
_LATER = (0.0, 0.5, 0.5, 1.0)  # of a step: when its stages are
_PULLS = 0.5  # of a force that its own give adds to it, at the most
_MASSLESS = "the inertia of the motion is not positive: hold more shapes"
_BEYOND = 1.02  # times the range: so far what lies outside is still foretold


class Swing(NamedTuple):
    """One motion that is asked: a structure, how it begins, and what moves it."""

    t: Array  # (n,), of even steps from 0, s
    start: Array  # (2, m): coordinates and rates
    omega2: Array  # (m,), of its linear modes
    rates: Array  # (m,), of their damping, 1/s
    alpha: float  # 1/s, of all that moves
    stiffer: float  # its restoring force over that of the tables
    tables: RungTables
    force: Force | None  # at the point of the tables: N, of m and m/s
    length: float  # m, in a unit of displacements
    unit: float  # N, in a unit of what the tables have over their density
    give: float = 0.0  # of the point, beside all modes that ring, under a unit of these forces

    @property
    def parts(self) -> int:
        """Steps from one time to the next."""
        turned = (self.t[1] - self.t[0]) * np.sqrt(self.omega2.max())
        return max(int(np.ceil(turned / _TURN)), 1)


def side_by_side(swings: Sequence[Swing]) -> list[Array | ValueError]:
    """States of each motion at its times, or why it has none: (n, 2 m + 1), the force the last.

    A motion is the same, to rounding, whatever is beside it.
    """
    curves = [id(s.tables.curve) for s in swings]
    alike: dict[tuple[float, int, int], list[int]] = defaultdict(list)
    for i, s in enumerate(swings):
        alike[float(s.t[1] - s.t[0]), s.parts, len(s.omega2)].append(i)
    found: dict[int, Array | ValueError] = {}
    for numbers in alike.values():
        numbers.sort(key=lambda i: len(swings[i].t))  # those that end together are together
        for first in range(0, len(numbers), _MOST):
            # Those of one structure stand together, in an order that is always the same.
            some = sorted(numbers[first : first + _MOST], key=lambda i: curves.index(curves[i]))
            found |= dict(zip(some, _in_time([swings[i] for i in some]), strict=True))
    return [found[i] for i in range(len(swings))]


def _in_time(swings: Sequence[Swing]) -> list[Array | ValueError]:
    """The same of motions of equal steps: linear modes exactly, what is beside them by Runge-Kutta.

    J. D. Lawson, "Generalized Runge-Kutta processes for stable systems with large Lipschitz
    constants", SIAM J. Numer. Anal. 4 (1967), doi 10.1137/0704033, of the fourth order.
    """
    t, parts = max((s.t for s in swings), key=len), swings[0].parts
    h, together = float(t[1] - t[0]) / parts, _SideBySide(swings)
    rows = zip(together.states(t, parts, h), swings, together.troubles, strict=True)
    return [ValueError(trouble) if trouble else x[: len(s.t)] for x, s, trouble in rows]


class _SideBySide:
    """Motions of equal steps, and what compiled loops ask of them."""

    def __init__(self, swings: Sequence[Swing]) -> None:
        self.swings, self.push = swings, cast(Any, acting([s.force for s in swings]))

        def of_each(name: str, of: Sequence[Any] = swings) -> Array:
            return np.array([getattr(s, name) for s in of])

        self.known = tuple(map(of_each, ("omega2", "rates", "alpha", "stiffer")))
        self.length, self.unit, self.give = map(of_each, ("length", "unit", "give"))
        self.y = of_each("start").reshape(len(swings), -1)
        tables = [s.tables for s in swings]
        curves = [s.curve for s in tables]
        first = [i for i, c in enumerate(curves) if not i or c is not curves[i - 1]]
        own = np.stack([curves[i] for i in first]), of_each("point", tables)
        firsts = np.array([*first, len(swings)])
        self.given = of_each("centre", tables), of_each("half", tables), firsts, *own
        (count, m), (terms, n) = self.known[0].shape, own[1].shape[1:]
        # Polynomials, functions of the curve and of the point, what a force does work along; then
        # displacements and velocities of the points
        sizes = (count, terms), (count, curves[0].shape[1]), (count, n), (count, m), count, count
        self.here = tuple(np.zeros(size) for size in sizes)
        self.pushes, self.gone = np.zeros(count), np.zeros(count, bool)
        self.inertia = np.empty((m, m)), np.zeros(count, bool)  # of one; those that have none

    def states(self, t: Array, parts: int, h: float) -> Array:
        """Of all at times t (n,), in steps of h, and the forces there: (l, n, 2 m + 1)."""
        y, m = self.y.copy(), self.y.shape[1] // 2
        half = np.stack([_propagator(s.omega2, s.rates, h / 2) for s in self.swings])
        kept = half, y.copy(), np.empty_like(y), *np.empty((3, len(y), m))
        states = np.zeros((len(y), len(t), 2 * m + 1))
        ends = np.array([len(s.t) for s in self.swings])
        given = y, kept, self.known, self.given, self.here, self.pushes
        if self.push is None:
            kernel.run(states, ends, parts, h, _BEYOND, *given, self.gone, self.inertia)
            return states
        for i, time in enumerate(t.tolist()):
            now = i, ends, y, kept[1], _BEYOND
            kernel.check(*now, self.given, self.here, self.gone, self.inertia)
            share, forces = self._left(time)
            states[:, i, :-1], states[:, i, -1] = y, share * forces
            for j in range(4 * parts if i + 1 < len(t) else 0):
                number = j % 4
                forces = self._forces(time + (j // 4 + _LATER[number]) * h)
                np.multiply(share, forces, out=self.pushes)
                kernel.stage(number, h, *given, self.inertia)
        return states

    def _forces(self, t: float, gone: Array | float = 0.0) -> Array:
        """At points that gave so far beside what rings."""
        *_, moved, speed = self.here
        force = self.push(t, self.length * (moved + gone), self.length * speed)
        return np.asarray(force / self.unit)

    def _left(self, t: float) -> tuple[Array, Array]:
        """What is left of forces where their points give, by their slopes; forces if none did."""
        stiff = self._forces(t)
        given = self._forces(t, self.give * stiff) if np.any(self.give) else stiff
        slope = np.divide(given - stiff, stiff, out=np.zeros_like(stiff), where=stiff != 0)
        return 1 / (1 - np.minimum(slope, _PULLS)), stiff

    @property
    def troubles(self) -> list[str]:
        """Why each has no motion."""
        _, massless = self.inertia
        return [
            s.tables.left if gone else _MASSLESS if none else ""
            for s, gone, none in zip(self.swings, self.gone, massless, strict=True)
        ]


def _propagator(omega2: Array, damping: Array, h: float) -> Array:
    """(m, 4): displacements and rates of linear modes after a time, by those before."""
    turned = np.sqrt(omega2 - damping**2 / 4 + 0j)
    c, s = np.cos(turned * h), np.sin(turned * h) / turned
    rows = [c + damping / 2 * s, s, -omega2 * s, c - damping / 2 * s]
    return np.real(np.exp(-damping / 2 * h) * np.stack(rows)).T.copy()
