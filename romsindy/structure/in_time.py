"""Motions of structures in time, many side by side: a step costs little more than that of one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from romsindy.simulator.force import Force, acting
from romsindy.structure import kernel
from romsindy.typing import Array

_TURN = 1.0  # rad of the fastest mode in a step, at the most: what is beside it turns it little
_MOST = 64  # motions at once: their tables fit into the cache
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

    @property
    def parts(self) -> int:
        """Steps from one time to the next."""
        turned = (self.t[1] - self.t[0]) * np.sqrt(self.omega2.max())
        return max(int(np.ceil(turned / _TURN)), 1)


def side_by_side(swings: Sequence[Swing]) -> list[Array | ValueError]:
    """States (n, 2, m) of each motion at its times, or why it has none.

    A motion is the same, to rounding, whatever is beside it.
    """
    alike: dict[tuple[float, int, int], list[int]] = defaultdict(list)
    for i, s in enumerate(swings):
        alike[float(s.t[1] - s.t[0]), s.parts, len(s.omega2)].append(i)
    found: dict[int, Array | ValueError] = {}
    for numbers in alike.values():
        numbers.sort(key=lambda i: len(swings[i].t))  # those that end together are together
        for first in range(0, len(numbers), _MOST):
            some = sorted(numbers[first : first + _MOST], key=lambda i: id(swings[i].tables.curve))
            found |= dict(zip(some, _in_time([swings[i] for i in some]), strict=True))
    return [found[i] for i in range(len(swings))]


def _in_time(swings: Sequence[Swing]) -> list[Array | ValueError]:
    """The same of motions of equal steps: linear modes exactly, what is beside them by Runge-Kutta.

    J. D. Lawson, "Generalized Runge-Kutta processes for stable systems with large Lipschitz
    constants", SIAM J. Numer. Anal. 4 (1967), doi 10.1137/0704033, of the fourth order.
    """
    t, parts = max((s.t for s in swings), key=len), swings[0].parts
    h, m = (t[1] - t[0]) / parts, len(swings[0].omega2)
    half = np.stack([_propagator(s.omega2, s.rates, h / 2) for s in swings])
    beside = _BesideLinear(swings)

    def later(y: Array, by: Array) -> Array:
        kernel.step(y, by, half, found := np.empty_like(y))
        return found

    def pushed(y: Array, by: Array) -> Array:
        moved = y.copy()
        moved[:, m:] += by
        return moved

    y = np.stack([s.start.ravel() for s in swings])
    out, still = np.empty((len(swings), len(t), 2 * m)), np.zeros((len(swings), m))
    for i, time in enumerate(t.tolist()):
        beside.check(y)
        out[:, i] = y
        for j in range(parts if i + 1 < len(t) else 0):
            s, middle = time + j * h, later(y, still)
            a = beside(s, y)
            b = beside(s + h / 2, later(y, h / 2 * a))
            c = beside(s + h / 2, pushed(middle, h / 2 * b))
            d = beside(s + h, later(middle, h * c))
            first = later(y, h / 6 * a)
            y = pushed(later(first, h / 3 * (b + c)), h / 6 * d)
    rows = zip(out, swings, beside.troubles, strict=True)
    return [
        ValueError(trouble) if trouble else x[: len(s.t)].reshape(-1, 2, m)
        for x, s, trouble in rows
    ]


class _BesideLinear:
    """Accelerations (l, m) of l motions beside those of their linear modes."""

    def __init__(self, swings: Sequence[Swing]) -> None:
        self.tables, self.push = [s.tables for s in swings], acting([s.force for s in swings])
        self.troubles = [""] * len(swings)

        def of_each(name: str) -> Array:
            return np.array([getattr(s, name) for s in swings])

        self.known = [*map(of_each, ("omega2", "rates", "alpha", "stiffer"))]
        self.length, self.unit = of_each("length"), of_each("unit")
        count, m = self.known[0].shape
        curves = [s.curve for s in self.tables]
        first = [i for i, c in enumerate(curves) if not i or c is not curves[i - 1]]
        spans = np.array([(s.centre, s.half) for s in self.tables]).T.copy()
        points = np.stack([s.point for s in self.tables])
        self.given = *spans, np.array([*first, count]), np.stack([curves[i] for i in first]), points
        # Polynomials, functions of the curve and of the point, and what a force does work along
        sizes = (points.shape[1], curves[0].shape[1], points.shape[2], m)
        self.terms, self.values, self.there, self.along = (np.empty((count, n)) for n in sizes)
        self.moved, self.speed, self.pushes = np.zeros((3, count))
        self.mass, self.massless = np.empty((m, m)), np.zeros(count, bool)

    def check(self, y: Array) -> None:
        """Let motions rest that left what is known of their structure, and say so."""
        centre, half, *_ = self.given
        for i in np.flatnonzero(~(np.abs(y[:, 0] - centre) < _BEYOND * half)).tolist():
            self._end(i, y, self.tables[i].left)
        for i in np.flatnonzero(self.massless).tolist():
            self._end(i, y, "the inertia of the motion is not positive: hold more shapes")

    def _end(self, i: int, y: Array, why: str) -> None:
        self.troubles[i] = self.troubles[i] or why
        y[i] = 0.0

    def __call__(self, t: float, y: Array) -> Array:
        here = self.values, self.there, self.along
        kernel.look(y, *self.given, self.terms, *here, self.moved, self.speed)
        if self.push is not None:
            moved = self.push(t, self.length * self.moved, self.length * self.speed)
            self.pushes = moved / self.unit
        out = np.empty_like(self.along)
        kernel.accelerate(y, *here, self.pushes, *self.known, self.mass, out, self.massless)
        return out


def _propagator(omega2: Array, damping: Array, h: float) -> Array:
    """(m, 4): displacements and rates of linear modes after a time, by those before."""
    turned = np.sqrt(omega2 - damping**2 / 4 + 0j)
    c, s = np.cos(turned * h), np.sin(turned * h) / turned
    rows = [c + damping / 2 * s, s, -omega2 * s, c - damping / 2 * s]
    return np.real(np.exp(-damping / 2 * h) * np.stack(rows)).T.copy()
