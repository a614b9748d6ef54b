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
from scipy.optimize import brentq
from scipy.sparse import csc_array

from romsindy.simulator.force import Force
from romsindy.simulator.simulator import Question
from romsindy.structure.held import HeldCurve
from romsindy.structure.linear import HeldCases, LinearMode, LinearModel, Units
from romsindy.structure.ringing import RungModes, RungTables, Swing, side_by_side
from romsindy.typing import Array

_MOVES = 0.05  # of the largest displacement of the mode: what moves less can hide nothing
_SETTLES = 4  # times that a force at rest and the shape that it bends are found in turn
_KEPT = 8  # structures between decks: each has shapes of all freedoms
HELD_BY = ("force", "mode")


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
        alpha = self.alpha + ratio * omega / (1 + omega / beside)
        return alpha, self.beta + ratio / (omega + beside)


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
        others = [np.delete(nodes, i) for i in range(len(nodes))]
        pairs = zip(nodes, others, strict=True)
        return np.array([np.prod((there - other) / (x - other)) for x, other in pairs])


class RightAt(PartDecks):
    """What puts right what lies between decks, by one deck more: its weights are those of decks."""

    def weights(self, value: float) -> Array:
        """Whatever the value is."""
        return np.array([self.assumed, *(weight for weight, _ in self.members)])


def member_of(
    base: LinearModel, kept: Sequence[int], other: LinearModel, curve: Callable[[int], HeldCurve]
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
    mode = LinearMode(kept[0], held.omega2, shapes[0], csc_array(other.mass[rows][:, rows]))
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

    @property
    def mode_frequencies(self) -> tuple[float, ...]:
        """Of the modes of the structure, rad/s; few of them ring here."""
        return tuple(self.structure.omega.tolist())

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
        given = {"mass": mass, "modulus": modulus, "density": density, **values}
        (found,) = self.together([Question(release, t, force, given, point)])
        if isinstance(found, ValueError):
            raise found
        return found

    def together(self, questions: Sequence[Question]) -> list[Array | ValueError]:
        """What `simulate` gives for each question, or raises: as many as can be at a time."""
        found: list[Array | ValueError] = []
        asked: list[tuple[int, StructureSimulator, Swing, Array]] = []
        for i, question in enumerate(questions):
            parts = {k: x for k, x in question.values.items() if k in self.parts}
            own = {k: x for k, x in question.values.items() if k not in parts}
            try:
                there = self._with(parts) if parts else self
                asked.append((i, there, *there._swing(question, **own)))
                found.append(ValueError())
            except ValueError as error:
                found.append(error)
        swings = [swing for _, _, swing, _ in asked]
        for (i, there, _, beside), y in zip(asked, side_by_side(swings), strict=True):
            found[i] = y if isinstance(y, ValueError) else there._read(y, beside)
        return found

    def _swing(
        self,
        question: Question,
        mass: float = 0.0,
        modulus: float = 1.0,
        density: float = 1.0,
        **damping: float,
    ) -> tuple[Swing, Array]:
        """The motion that is asked, of the structure with its parts as they are.

        And what its state moves sensors by, beside all that rings.
        """
        row = self.point if question.point is None else self._row(question.point)
        stiffer, units, m = modulus / density, self.units, mass / self.units.mass / density
        own, *others = self._gives(row, [row, *self.sensors])
        kept = (self.curve.mode.number, *self.ringing.numbers)
        tables = self.ringing.at_point(row, m, self.structure.counts(row, m, kept) if m else 1.0)
        known = np.append(self.curve.omega2, self.ringing.omega2)
        omega2 = stiffer * known
        if not np.all(omega2 > 0):
            raise ValueError(f"{question.values}: no stiffness there; take values nearer to 1")
        start = self._held(question.release / units.length, row, tables, question.force, modulus)
        found = self.damping._replace(**damping)
        rates = np.asarray(found.rates(np.sqrt(omega2)))
        given = (question.t, start, omega2, rates, found.alpha, stiffer, tables, question.force)
        pulls = m * known * np.append(self.curve.mode.shape[row], self.ringing.shapes[:, row])
        beside = np.outer(others, [*pulls, *np.zeros(len(known)), 1 / stiffer])
        return Swing(*given, units.length, units.force * density, own / stiffer), beside

    def _gives(self, row: int, rows: Sequence[int]) -> Array:
        """What a unit of force at a freedom moves others by, beside all that rings."""
        return self.structure.gives(row, rows, (self.curve.mode.number, *self.ringing.numbers))

    def _read(self, y: Array, beside: Array) -> Array:
        """Displacements of the sensors, m, from states and forces (n, 2 m + 1)."""
        q, rows, m = y[:, 0], list(self.sensors), y.shape[1] // 2
        bent = np.einsum("ij,ijk->ik", y[:, 1:m], self.ringing.shapes_at(q, rows)) + y @ beside.T
        return np.asarray(self.units.length * (self.curve.shapes_at(q, rows) + bent))

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

    @cached_property
    def _at_first(self) -> RungTables:
        """At the first sensor."""
        return self.ringing.at_point(self.sensors[0], 0.0)

    def _held(
        self, release: float, row: int, point: RungTables, force: Force | None, over: float
    ) -> Array:
        """Coordinates and rates, (2, 1 + m), where the first sensor is displaced by so much.

        What was added at the point bends the structure as well, as far as it does so at rest; it is
        ``over`` times as stiff as its tables say.
        """

        gives = self._gives(row, [self.sensors[0], row])

        def rung(q: float) -> tuple[float, Array]:
            """The displacement of the first sensor, and the coordinates of other modes."""
            here, there, k = self._at_first.at(q), point.at(q), point.k
            both = np.stack([here.point, there.point])
            slopes, psi, turned = both[:, 0], both[:, 2 : 2 + k], both[:, 2 + k : 2 + 2 * k]
            bent = np.linalg.solve(here.stiffness, psi.T)  # by units of force
            pulls, moved = np.zeros(2), np.array([here.moved, there.moved])
            for _ in range(_SETTLES):
                r = bent @ pulls
                x, along = moved + psi @ r + gives * pulls[1], slopes + turned @ r
                if force is not None:
                    found = force(0.0, self.units.length * float(x[1]), 0.0)
                    pulls[1] = found / self.units.force / over
                if self.held_by == "force":
                    needed = here.force + r @ here.stiffness_q @ r / 2 - along[1] * pulls[1]
                    pulls[0] = needed / along[0]
            r = bent @ pulls
            return float(moved[0] + psi[0] @ r + gives[0] * pulls[1]), r

        def off(q: float) -> float:
            return rung(q)[0] - release

        low, high = self.curve.range
        if off(low) * off(high) > 0:
            ends = sorted(release + off(x) for x in (low, high))
            raise ValueError(
                f"the release {release:.4g} is beyond the range that was held, {ends[0]:.4g} to"
                f" {ends[1]:.4g} at the first sensor: hold it over a larger one"
            )
        q = brentq(off, low, high, xtol=1e-14 * (high - low))
        start = np.append(q, rung(q)[1])
        return np.stack([start, np.zeros(len(start))])
