"""A structure as a simulator of free decays: one mode with all that follows it, and others beside.

With coordinates z = (q, r) and the tangents T = du/dz of displacements u (see `ringing`):

    T^T M (T z'' + (T' z')) + (K + r^T W' r / 2, W r) + alpha T^T M T z' + S^T c S z' = T_p^T f

where c are rates of the modes beside alpha, and S z' the rates of their coordinates (q, s(q) + r),
under a force f at a point p; a mass there is a part of M.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv
from scipy.optimize import brentq
from scipy.sparse import csc_array

from romsindy.structure.held import HeldCurve
from romsindy.structure.linear import HeldCases, LinearMode, LinearModel
from romsindy.structure.ringing import RungModes, RungValues
from romsindy.typing import Array

_TURN = 1.0  # rad of the fastest mode in a step, at the most: what is beside it turns it little
_MOVES = 0.05  # of the largest displacement of the mode: what moves less can hide nothing
_SETTLES = 4  # times that a force at rest and the shape that it bends are found in turn
_KEPT = 8  # structures between decks: each has shapes of all freedoms
HELD_BY = ("force", "mode")


Force = Callable[[float, float, float], float]


class Damping(NamedTuple):
    """Damping of all modes: 2 zeta omega + alpha + beta omega^2, 1/s."""

    damping_ratio: float = 0.0
    alpha: float = 0.0  # 1/s, in proportion to the mass
    beta: float = 0.0  # s, in proportion to the stiffness

    def rates(self, omega: Array) -> Array:
        """Rates of modes, 1/s."""
        return 2 * self.damping_ratio * omega + self.alpha + self.beta * omega**2

    def rayleigh(self, omega: float, beside: float = np.inf) -> tuple[float, float]:
        """Factors of mass (1/s) and stiffness (s): at these two frequencies the same rates."""
        ratio = 2 * self.damping_ratio
        return self.alpha + ratio * omega / (1 + omega / beside), self.beta + ratio / (
            omega + beside
        )


class Units(NamedTuple):
    """SI units in one of a model: m, kg."""

    length: float = 1.0
    mass: float = 1.0

    @property
    def force(self) -> float:
        """N in a unit of force; times are in s."""
        return self.length * self.mass


@dataclass(frozen=True, eq=False)
class Member:
    """A deck of several: modes that are kept, and the curve of the first of them."""

    omega2: Array  # (m,)
    shapes: Array  # (m, n), of the free freedoms of the deck as it is
    curve: HeldCurve

    @property
    def mass(self) -> csc_array:
        """Of those freedoms."""
        return self.curve.mode.mass


class PartDecks(NamedTuple):
    """The decks of a value of a part, beside the deck as it is.

    Between them it is a polynomial in the value v; with a ``scale`` in log(1 + v / scale), for a
    clamp first frees what is pressed sideways, and then turns.
    """

    assumed: float  # value of the deck as it is
    members: tuple[tuple[float, Member], ...]  # others, with their values
    scale: float = 0.0
    unit: float = 1.0  # SI unit of the value in that of the deck

    def weights(self, value: float) -> Array:
        """Of the decks in what lies at a value, that as it is first, by Lagrange."""
        at = np.array([self.assumed, *(v for v, _ in self.members), value])
        if self.scale:
            at = np.sign(at) * np.log1p(np.abs(at) / self.scale)
        nodes, there = at[:-1], at[-1]
        return np.array(
            [
                np.prod((there - np.delete(nodes, i)) / (x - np.delete(nodes, i)))
                for i, x in enumerate(nodes)
            ]
        )


class RightAt(PartDecks):
    """What puts right what lies between decks, by one deck more: its weights are those of decks."""

    def weights(self, value: float) -> Array:
        """Whatever the value is."""
        return np.array([self.assumed, *(weight for weight, _ in self.members)])


def member_of(
    base: LinearModel,
    kept: Sequence[int],
    other: LinearModel,
    curve: Callable[[int], HeldCurve],
) -> Member:
    """Modes of another deck that are those of a deck, ``kept`` by number.

    The first is held: ``curve`` gives its shapes, by its number in the other deck.
    """
    freedoms = zip(other.nodes.tolist(), other.directions.tolist(), strict=True)
    row_of = {freedom: i for i, freedom in enumerate(freedoms)}
    rows = [row_of[f] for f in zip(base.nodes.tolist(), base.directions.tolist(), strict=True)]
    alike = other.shapes[:, rows] @ (base.mass @ base.shapes[[n - 1 for n in kept]].T)
    found = np.argmax(np.abs(alike), axis=0)
    signs = np.sign(alike[found, np.arange(len(kept))])
    shapes = signs[:, None] * other.shapes[found][:, rows]
    held = curve(int(found[0]) + 1)
    mass = csc_array(other.mass[rows][:, rows])
    mode = LinearMode(kept[0], held.omega2, shapes[0], mass)
    cases = HeldCases(signs[0] * held.cases.factors, held.cases.shapes[:, rows])
    return Member(other.omega[found] ** 2, shapes, replace(held, mode=mode, cases=cases))


def between(base: Member, given: Sequence[tuple[PartDecks, float]]) -> Member:
    """A structure at values of its parts: between its decks, what each value does summed up."""
    weights, members = [1.0], [base]
    for varied, value in given:
        own, *others = varied.weights(value).tolist()
        weights = [weights[0] + own - 1, *weights[1:], *others]
        members += [member for _, member in varied.members]

    def mixed(several: Iterator[Any]) -> Any:
        return sum(w * x for w, x in zip(weights, several, strict=True))

    q = base.curve.at
    omega2, shapes = mixed(m.omega2 for m in members), mixed(m.shapes for m in members)
    force = mixed(m.curve.force_at(q) for m in members)
    follows = mixed(m.curve.following_at(q) for m in members)
    mass = csc_array(mixed(m.mass for m in members))
    mode = LinearMode(base.curve.mode.number, float(omega2[0]), shapes[0], mass)
    cases = HeldCases(force, np.outer(q, shapes[0]) + follows)
    return Member(omega2, shapes, HeldCurve(mode, cases, base.curve.order))


@dataclass(frozen=True, eq=False)
class StructureSimulator:
    """A structure that is let go, as `diagnose` asks a simulator: in SI units.

    Parameters
    ----------
    structure : LinearModel
        Its modes.
    sensors : sequence of int
        Rows of the freedoms that are measured; at the first the structure is let go.
    point : int
        Row of the freedom at which a force acts, if nothing else is asked.
    anywhere : bool
        Whether it may act elsewhere.
    damping : Damping
        Of all modes.
    ringing : RungModes
        The modes that ring beside it.
    held_by : str
        What holds the structure until it is let go: a "force" at the first sensor, or the modal
        force of the "mode".
    units : Units
        Of the structure.
    parts : dict
        Decks with other values of parts, by the name of the value.
    deck : callable, optional
        The deck that has values of several parts.
    right : RightAt, optional
        What puts right what lies between decks.
    """

    structure: LinearModel
    sensors: Sequence[int]
    point: int
    anywhere: bool
    damping: Damping
    ringing: RungModes
    held_by: str
    units: Units
    parts: Mapping[str, PartDecks] = field(default_factory=dict)
    deck: Callable[[Mapping[str, float]], Member] | None = None
    right: RightAt | None = None
    _between: dict[tuple[tuple[str, float], ...], StructureSimulator] = field(default_factory=dict)

    takes_force = True
    takes_mass = True

    @property
    def takes_values(self) -> tuple[str, ...]:
        """Names of the values that it takes."""
        return ("modulus", "density", *Damping._fields, *self.parts)

    @property
    def steps(self) -> dict[str, float]:
        """By how much values change that are zero in the deck."""
        return {name: v.scale for name, v in self.parts.items() if v.scale}

    def right_at(self, values: Mapping[str, float]) -> StructureSimulator | None:
        """The same, exact at values of its parts: their deck is held. None where it has no parts.

        Between decks a clamp is some per cent off, and so are values that are off together.
        """
        parts = {name: values[name] for name in self.parts if name in values}
        if self.deck is None or not parts:
            return None
        own, members = 0.0, [(1.0, self.deck(parts))]
        for name, value in parts.items():
            first, *others = self.parts[name].weights(value).tolist()
            own += 1 - first
            members += [(-w, m) for w, (_, m) in zip(others, self.parts[name].members, strict=True)]
        return replace(self, right=RightAt(own, tuple(members)), _between={})

    @property
    def __name__(self) -> str:
        return self.structure.name

    @cached_property
    def points(self) -> Mapping[str, Array]:
        """Where what is missing may act, "node:direction", and where that is, (3,), m.

        Of each node it is the direction in which the mode moves it most. Its own is the first.
        """
        known = self.structure
        if not self.anywhere or not known.coordinates:
            return {}
        moved = np.abs(self.curve.mode.shape)
        found: dict[int, int] = {}
        for row in np.argsort(moved):
            if moved[row] > _MOVES * moved.max() and int(known.nodes[row]) in known.coordinates:
                found[int(known.nodes[row])] = int(row)
        return {
            f"{known.nodes[row]}:{known.directions[row]}": (
                self.units.length * known.coordinates[int(known.nodes[row])]
            )
            for row in (self.point, *found.values())
        }

    def simulate(
        self,
        release: float,
        t: Array,
        force: Force | None = None,
        point: str | None = None,
        *,
        mass: float = 0.0,
        modulus: float = 1.0,
        density: float = 1.0,
        **values: float,
    ) -> Array:
        """Displacements (n, n_sensors), m, at times t (n,), s.

        Parameters
        ----------
        release : float
            Displacement of the first sensor, m.
        force : callable, optional
            Of time, displacement (m) and velocity (m/s) of the point, N.
        point : str, optional
            Another point than its own for the force and the mass, "node:direction".
        mass : float
            At the point, kg.
        modulus, density : float
            Over those of the deck, of all its materials.
        values : float
            Any of `Damping`, in the place of what was stated, and of values of parts.

        Raises
        ------
        ValueError
            For a release, or a motion, beyond the range that was held.
        """
        if parts := {name: values.pop(name) for name in self.parts if name in values}:
            given = {"mass": mass, "modulus": modulus, "density": density, **values}
            return self._with(parts).simulate(release, t, force, point, **given)
        row = self.point if point is None else self._row(point)
        start = self._held(release / self.units.length, row, force, modulus)
        damping = self.damping._replace(**values)
        omega2 = modulus / density * np.append(self.curve.omega2, self.ringing.omega2)
        rates = np.asarray(damping.rates(np.sqrt(omega2)))
        at_point = self.ringing.at_point(row, mass / self.units.mass / density)
        push = None if force is None else self._push(force, density)
        beside = _beside_linear(at_point, push, modulus / density, omega2, rates, damping.alpha)
        y = _in_time(t, start, omega2, rates, beside)
        q = y[:, 0, 0]
        psi = self.ringing.shapes_at(q, list(self.sensors))
        bent = np.einsum("ij,ijk->ik", y[:, 0, 1:], psi)
        moved = self.curve.shapes_at(q)[:, self.sensors] + bent
        return np.asarray(self.units.length * moved)

    @property
    def curve(self) -> HeldCurve:
        """Shapes along the mode that is kept."""
        return self.ringing.curve

    def _with(self, parts: Mapping[str, float]) -> StructureSimulator:
        """The structure with other values of its parts."""
        key = tuple(parts.items())
        if key not in self._between:
            if len(self._between) == _KEPT:
                del self._between[next(iter(self._between))]
            ringing = self.ringing
            kept = [self.curve.mode.number - 1, *(n - 1 for n in ringing.numbers)]
            base = Member(self.structure.omega[kept] ** 2, self.structure.shapes[kept], self.curve)
            varied = [(self.parts[name], value) for name, value in parts.items()]
            found = between(base, [*varied, *([(self.right, 0.0)] if self.right else [])])
            omega2, shapes = found.omega2[1:], found.shapes[1:]
            ringing = replace(ringing, curve=found.curve, omega2=omega2, shapes=shapes)
            self._between[key] = replace(self, ringing=ringing, parts={}, right=None, _between={})
        return self._between[key]

    def _row(self, point: str) -> int:
        node, _, direction = point.rpartition(":")
        return self.structure.freedom(node, int(direction))

    def _held(self, release: float, point: int, force: Force | None, stiffer: float) -> Array:
        """Coordinates and rates, (2, 1 + m), where the first sensor is displaced by so much.

        What was added at the point bends the structure as well, as far as it does so at rest.
        """
        row, units, ringing = self.sensors[0], self.units, self.ringing
        both = [row, point]

        def rung(q: float) -> Array:
            at = np.array([q])
            moved = self.curve.shapes_at(at)[0, both]
            slopes = self.curve.mode.shape[both] + self.curve.following_at(at, slope=True)[0, both]
            psi, turned = (ringing.shapes_at(at, both, slope=x)[0] for x in (False, True))
            stiffness, softer = (ringing.stiffness_at(at, slope=x)[0] for x in (False, True))
            pushed, bent = np.linalg.solve(stiffness, psi).T  # by a unit of force
            r, push = np.zeros(len(pushed)), 0.0
            for _ in range(_SETTLES):
                if force is not None:
                    x = float(moved[1] + psi[:, 1] @ r)
                    push = force(0.0, units.length * x, 0.0) / units.force / stiffer
                size, along = 0.0, slopes + r @ turned
                if self.held_by == "force":
                    needed = self.curve.force_at(at)[0] + r @ softer @ r / 2 - along[1] * push
                    size = float(needed / along[0])
                r = size * pushed + push * bent
            return np.asarray(r)

        def off(q: float) -> float:
            at = np.array([q])
            there = self.curve.shapes_at(at)[0, row]
            psi = ringing.shapes_at(at, [row])[0, :, 0]
            return float(there + psi @ rung(q) - release)

        low, high = self.curve.range
        if off(low) * off(high) > 0:
            ends = sorted(release + off(x) for x in (low, high))
            raise ValueError(
                f"the release {release:.4g} is beyond the range that was held, {ends[0]:.4g} to"
                f" {ends[1]:.4g} at the first sensor: hold it over a larger one"
            )
        q = brentq(off, low, high, xtol=1e-14 * (high - low))
        start = np.append(q, rung(q))
        return np.stack([start, np.zeros(len(start))])

    def _push(self, force: Force, density: float) -> Force:
        """A force in units of the model over its density, of what is in these."""
        length, unit = self.units.length, self.units.force * density
        return lambda t, x, v: force(t, length * x, length * v) / unit


def _beside_linear(
    at_point: Callable[[float], RungValues],
    push: Force | None,
    stiffer: float,
    omega2: Array,
    rates: Array,
    alpha: float,
) -> Callable[[float, Array], Array]:
    """Accelerations (m,) beside those of the linear modes, at a time and a state (2 m,)."""
    m, own = len(omega2), rates - alpha
    psi, turned, curved = slice(2, 1 + m), slice(1 + m, 2 * m), slice(2 * m, None)
    tangent, bends = np.zeros((2, 3 * m - 1))  # of q, and what does not follow accelerations
    tangent[0], mass, free, along = 1.0, np.empty((m, m)), np.empty(m), np.empty(m)

    def beside(t: float, y: Array) -> Array:
        here, r, v = at_point(float(y[0])), y[1:m], y[m:]
        q_dot, modal = v[0], here.follows * v[0] + v[1:]
        tangent[turned] = r
        bends[1], bends[turned], bends[curved] = q_dot**2, 2 * q_dot * v[1:], q_dot**2 * r
        momentum = here.inertia @ tangent
        mass[0, 0], mass[0, 1:], mass[1:, 0] = momentum @ tangent, momentum[psi], momentum[psi]
        mass[1:, 1:] = here.inertia[psi, psi]
        free[0] = -momentum @ bends - stiffer * (here.force + r @ here.stiffness_q @ r / 2)
        free[1:] = -here.inertia[psi] @ bends - stiffer * (here.stiffness @ r)
        free[0] -= own[0] * q_dot + here.follows @ (own[1:] * modal)
        free[1:] -= own[1:] * modal
        along[0], along[1:] = here.point @ tangent, here.point[psi]
        speed = float(along @ v)
        pushed = alpha * here.mass * speed  # what was added is not damped
        if push is not None:
            pushed += push(t, float(here.moved + here.point[psi] @ r), speed)
        _, solved, failed = dposv(mass, free - alpha * (mass @ v) + pushed * along)
        if failed:
            raise ValueError(f"the inertia at q = {y[0]:.4g} is not positive: hold more shapes")
        return np.asarray(solved + omega2 * y[:m] + rates * v)

    return beside


def _in_time(
    t: Array,
    start: Array,
    omega2: Array,
    damping: Array,
    beside: Callable[[float, Array], Array],
) -> Array:
    """States (n, 2, m) at even times: linear modes exactly, what is beside them by Runge and Kutta.

    J. D. Lawson, "Generalized Runge-Kutta processes for stable systems with large Lipschitz
    constants", SIAM J. Numer. Anal. 4 (1967), doi 10.1137/0704033, of the fourth order.
    """
    parts = max(int(np.ceil((t[1] - t[0]) * np.sqrt(omega2.max()) / _TURN)), 1)
    h, m = (t[1] - t[0]) / parts, len(omega2)
    half = _propagator(omega2, damping, h / 2)

    def pushed(y: Array, by: Array) -> Array:
        later = y.copy()
        later[m:] += by
        return later

    out, y = np.empty((len(t), 2 * m)), start.ravel()
    for i, time in enumerate(t.tolist()):
        out[i] = y
        for j in range(parts if i + 1 < len(t) else 0):
            s, middle = time + j * h, half @ y
            a = beside(s, y)
            b = beside(s + h / 2, half @ pushed(y, h / 2 * a))
            c = beside(s + h / 2, pushed(middle, h / 2 * b))
            d = beside(s + h, half @ pushed(middle, h * c))
            later = half @ pushed(y, h / 6 * a)
            y = pushed(half @ pushed(later, h / 3 * (b + c)), h / 6 * d)
    return out.reshape(-1, 2, m)


def _propagator(omega2: Array, damping: Array, h: float) -> Array:
    """(2 m, 2 m): displacements and rates of linear modes after a time, from those before."""
    turned = np.sqrt(omega2 - damping**2 / 4 + 0j)
    c, s = np.cos(turned * h), np.sin(turned * h) / turned
    slow = np.exp(-damping / 2 * h)
    rows = [[c + damping / 2 * s, s], [-omega2 * s, c - damping / 2 * s]]
    return np.block([[np.diag(np.real(slow * x)) for x in row] for row in rows])
