"""Motions of structures in time, many side by side: a step costs little more than that of one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from romsindy.simulator.force import Force, acting
from romsindy.structure import kernel
from romsindy.typing import Array

_TURN = 1.0  # rad of the fastest mode in a step, at the most: what is beside it turns it little
_MOST = 64  # motions at once: their tables fit into the cache
_LATER = (0.0, 0.5, 0.5, 1.0)  # of a step: when its stages are
_PULLS = 0.5  # of a force that its own give adds to it, at the most
_MASSLESS = "the inertia of the motion is not positive: hold more shapes"
_BEYOND = 1.02  # times the range: so far what lies outside is still foretold


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
        return np.asarray(
            self.push(t, self.length * (moved + gone), self.length * speed) / self.unit
        )

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
