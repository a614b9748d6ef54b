"""Motions of structures in time, many side by side: a step costs little more than that of one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from romsindy.simulator.force import Force, acting
from romsindy.typing import Array

_TURN = 1.0  # rad of the fastest mode in a step, at the most: what is beside it turns it little
_MOST = 64  # motions at once: their tables fit into the cache
_BEYOND = 1.02  # times the range: so far what lies outside is still foretold


class RungValues(NamedTuple):
    """Functions of q; vectors are x', x'', psi, psi', psi'', which are 2 + 3 k."""

    force: Array  # (l,), K
    moved: Array  # (l,), x of the point
    point: Array  # the vectors at the point, (l, 2 + 3 k)
    follows: Array  # s' of the modes that ring, where these follow at rest, (l, k)
    inertia: Array  # products of the vectors, with the mass at the point, (l, 2 + 3 k, 2 + 3 k)
    stiffness: Array  # W, (l, k, k)
    stiffness_q: Array  # W'


class RungTables(NamedTuple):
    """Functions of q of l structures or points, as sums of Chebyshev polynomials."""

    centre: Array  # (l,), of the range of q
    half: Array  # (l,), of its length
    table: Array  # (l, values, terms)
    k: int  # modes that ring

    @classmethod
    def together(cls, several: Sequence[RungTables]) -> RungTables:
        """Those of several."""
        joined = zip(*(s[:3] for s in several), strict=True)
        return cls._make([*map(np.concatenate, joined), several[0].k])

    def beyond(self, q: Array) -> Array:
        """Whether each q, (l,), is where nothing is foretold any more."""
        return np.asarray(~(np.abs(q - self.centre) < _BEYOND * self.half))

    def left(self, i: int) -> str:
        """What is to be said of a motion that went there."""
        low, high = self.centre[i] - self.half[i], self.centre[i] + self.half[i]
        return (
            f"the motion leaves the range that was held, q = {low:.4g} to {high:.4g}: hold it over"
            " a larger one"
        )

    def at(self, q: Array) -> RungValues:
        """The functions at each q, (l,)."""
        k, x = self.k, (q - self.centre) / self.half
        orders, n = np.arange(self.table.shape[2]), 2 + 3 * self.k
        terms = np.cos(np.arccos(np.clip(x, -1, 1))[:, None] * orders)
        for i in np.flatnonzero(np.abs(x) > 1):
            out = np.arccosh(min(abs(x[i]), _BEYOND))
            terms[i] = np.sign(x[i]) ** orders * np.cosh(orders * out)
        v = (self.table @ terms[..., None])[..., 0]
        first, second = 2 + n + k, 2 + n + k + n * n
        return RungValues(
            v[:, 0],
            v[:, 1],
            v[:, 2 : 2 + n],
            v[:, 2 + n : first],
            v[:, first:second].reshape(len(v), n, n),
            v[:, second : second + k * k].reshape(len(v), k, k),
            v[:, second + k * k :].reshape(len(v), k, k),
        )


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
            some = numbers[first : first + _MOST]
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

    def later(y: Array) -> Array:
        return (half @ y[..., None])[..., 0]

    def pushed(y: Array, by: Array) -> Array:
        moved = y.copy()
        moved[:, m:] += by
        return moved

    y = np.stack([s.start.ravel() for s in swings])
    out = np.empty((len(swings), len(t), 2 * m))
    for i, time in enumerate(t.tolist()):
        beside.check(y)
        out[:, i] = y
        for j in range(parts if i + 1 < len(t) else 0):
            s, middle = time + j * h, later(y)
            a = beside(s, y)
            b = beside(s + h / 2, later(pushed(y, h / 2 * a)))
            c = beside(s + h / 2, pushed(middle, h / 2 * b))
            d = beside(s + h, later(pushed(middle, h * c)))
            first = later(pushed(y, h / 6 * a))
            y = pushed(later(pushed(first, h / 3 * (b + c))), h / 6 * d)
    rows = zip(out, swings, beside.troubles, strict=True)
    return [
        ValueError(trouble) if trouble else x[: len(s.t)].reshape(-1, 2, m)
        for x, s, trouble in rows
    ]


class _BesideLinear:
    """Accelerations (k, m) of k motions beside those of their linear modes."""

    def __init__(self, swings: Sequence[Swing]) -> None:
        self.tables = RungTables.together([s.tables for s in swings])
        self.push = acting([s.force for s in swings])
        self.troubles = [""] * len(swings)
        self.omega2 = np.stack([s.omega2 for s in swings])
        self.rates = np.stack([s.rates for s in swings])
        self.alpha = np.array([s.alpha for s in swings])
        self.stiffer = np.array([s.stiffer for s in swings])
        self.length = np.array([s.length for s in swings])
        self.unit = np.array([s.unit for s in swings])
        k, m = self.omega2.shape
        self.own = self.rates - self.alpha[:, None]
        # Tangents of q, and what does not follow accelerations, of the vectors of `RungValues`
        self.tangent, self.bends = np.zeros((2, k, 3 * m - 1, 1))
        self.tangent[:, 0] = 1.0
        self.mass, self.free, self.along = np.tile(np.eye(m), (k, 1, 1)), *np.empty((2, k, m))

    def check(self, y: Array) -> None:
        """Let motions rest that left what is known of their structure, and say so."""
        for i in np.flatnonzero(self.tables.beyond(y[:, 0])).tolist():
            self._end(i, y, self.tables.left(i))
        try:
            np.linalg.cholesky(self.mass)
        except np.linalg.LinAlgError:
            for i, mass in enumerate(self.mass):
                known = np.all(np.isfinite(mass))
                if not (known and np.all(np.linalg.eigvalsh(mass) > 0)):
                    self._end(i, y, "the inertia of the motion is not positive: hold more shapes")

    def _end(self, i: int, y: Array, why: str) -> None:
        self.troubles[i] = self.troubles[i] or why
        y[i], self.mass[i] = 0.0, np.eye(self.mass.shape[1])

    def __call__(self, t: float, y: Array) -> Array:
        m = self.omega2.shape[1]
        psi, turned, curved = slice(2, 1 + m), slice(1 + m, 2 * m), slice(2 * m, None)
        here, r, v = self.tables.at(y[:, 0]), y[:, 1:m], y[:, m:]
        q_dot, rung = v[:, :1], v[:, 1:]
        modal = here.follows * q_dot + rung
        tangent, bends = self.tangent, self.bends
        mass, free, along = self.mass, self.free, self.along
        tangent[:, turned, 0] = r
        bends[:, 1, 0] = v[:, 0] ** 2
        bends[:, turned, 0] = 2 * q_dot * rung
        bends[:, curved, 0] = q_dot**2 * r
        both = here.inertia @ np.concatenate([tangent, bends], axis=2)
        momentum, turning = both[..., 0], both[..., 1]
        mass[:, 0, 0] = _each(momentum, tangent[..., 0])
        mass[:, 0, 1:] = mass[:, 1:, 0] = momentum[:, psi]
        mass[:, 1:, 1:] = here.inertia[:, psi, psi]
        rung_column = r[..., None]
        softer = _each((here.stiffness_q @ rung_column)[..., 0], r) / 2
        stiff = (here.stiffness @ rung_column)[..., 0]
        free[:, 0] = -_each(turning, tangent[..., 0]) - self.stiffer * (here.force + softer)
        free[:, 0] -= self.own[:, 0] * v[:, 0] + _each(here.follows, self.own[:, 1:] * modal)
        free[:, 1:] = -turning[:, psi] - self.stiffer[:, None] * stiff - self.own[:, 1:] * modal
        along[:, 0], along[:, 1:] = _each(here.point, tangent[..., 0]), here.point[:, psi]
        right = free - self.alpha[:, None] * (mass @ v[..., None])[..., 0]
        if self.push is not None:
            moved = self.length * (here.moved + _each(here.point[:, psi], r))
            speed = self.length * _each(along, v)
            right += (self.push(t, moved, speed) / self.unit)[:, None] * along
        solved = np.linalg.solve(mass, right[..., None])[..., 0]
        return np.asarray(solved + self.omega2 * y[:, :m] + self.rates * v)


def _each(a: Array, b: Array) -> Array:
    """Products of rows, (k,)."""
    return np.asarray(np.einsum("ij,ij->i", a, b))


def _propagator(omega2: Array, damping: Array, h: float) -> Array:
    """(2 m, 2 m): displacements and rates of linear modes after a time, from those before."""
    turned = np.sqrt(omega2 - damping**2 / 4 + 0j)
    c, s = np.cos(turned * h), np.sin(turned * h) / turned
    slow = np.exp(-damping / 2 * h)
    rows = [[c + damping / 2 * s, s], [-omega2 * s, c - damping / 2 * s]]
    return np.block([[np.diag(np.real(slow * x)) for x in row] for row in rows])
