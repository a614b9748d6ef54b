"""Values of parts of a deck: other decks are held beside it, and what lies between is a polynomial.

Modulus and density of a set of elements are told as factors, the compliance of a clamp (a set of
nodes that is held) in m/N of all its nodes together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_array

from romsindy.structure.calculix import HeldCases
from romsindy.structure.deck import Card, Deck, DeckError
from romsindy.structure.held import HeldCurve
from romsindy.structure.linear import LinearMode, LinearModel
from romsindy.text import listed
from romsindy.typing import Array

MATERIAL = {"modulus": "ELASTIC", "density": "DENSITY"}
CLAMP = "clamp"
_KINDS = (*MATERIAL, CLAMP)
_NAME = "ROMSINDY"
PART = 0.1  # by which a modulus or a density of a part is varied to either side
SOFT = (0.05, 0.2, 0.6, 2.0, 5.0)  # of the compliance of a clamp that is felt
# By which a clamp changes omega^2: wanted, and near enough
_SOFTER, _NEAR, _TRIED = 0.02, 2.0, 8


class PartValue(NamedTuple):
    """A value of a part of a deck, such as "modulus of ROOT"."""

    kind: str
    of: str  # set of elements, or of nodes that are held

    @classmethod
    def of_name(cls, name: str) -> PartValue | None:
        """From its name; None where it names no part."""
        kind, between, part = name.partition(" of ")
        return cls(kind, part.upper()) if between and kind in _KINDS else None

    @property
    def assumed(self) -> float:
        """As the deck has it."""
        return 0.0 if self.kind == CLAMP else 1.0

    def deck(self, deck: Deck, value: float) -> Deck:
        """The deck with another value; a compliance is in its own units.

        Raises a DeckError where the deck has no such part.
        """
        if value == self.assumed:
            return deck
        cards = [*(_softer if self.kind == CLAMP else _scaled)(deck, self, value)]
        return replace(deck, cards=tuple(cards))


def _scaled(deck: Deck, value: PartValue, factor: float) -> Iterator[Card]:
    """Cards with a material of its own for a set of elements."""
    sections = [
        c for c in deck.of("SOLID SECTION") if c.parameters.get("ELSET", "").upper() == value.of
    ]
    if not sections:
        sets = {c.parameters.get("ELSET", "").upper() for c in deck.of("SOLID SECTION")}
        raise DeckError(
            f"{deck.path}: {value.kind} of {value.of} is asked, and no *SOLID SECTION has that"
            f" ELSET: there are {listed(sorted(sets))}; give a part a section of its own"
        )
    material = sections[0].parameters.get("MATERIAL", "")
    name = f"{_NAME}_{value.kind}_{value.of}".upper()
    inside, copy = False, []
    for card in deck.cards:
        if card.name == "MATERIAL":
            inside = card.parameters.get("NAME", "").upper() == material.upper()
            if inside:
                copy.append(_of_text(card, f"*MATERIAL, NAME={name}"))
            continue
        # All that follows a material is its own, until another block of the model begins.
        inside = inside and card.name in _OF_MATERIAL
        if inside:
            copy.append(times(card, factor) if card.name == MATERIAL[value.kind] else card)
    if not any(card.name == MATERIAL[value.kind] for card in copy):
        raise DeckError(
            f"{sections[0].at}: the material {material} has no *{MATERIAL[value.kind]}, of which"
            f" {value.kind} of {value.of} is a factor"
        )
    done = False
    for card in deck.cards:
        if card in sections:
            if not done:
                yield from copy
                done = True
            others = "".join(
                f", {k}={v}" if v else f", {k}"
                for k, v in card.parameters.items()
                if k != "MATERIAL"
            )
            yield _of_text(card, f"*SOLID SECTION{others}, MATERIAL={name}", *card.data)
        else:
            yield card


_OF_MATERIAL = ("ELASTIC", "DENSITY", "EXPANSION", "CONDUCTIVITY", "SPECIFIC HEAT", "DAMPING")


def times(card: Card, factor: float) -> Card:
    """A card of a material with the first entries of its lines so many times as large."""
    if not card.parameters.get("TYPE", "ISO").upper().startswith("ISO"):
        raise DeckError(f"{card.at}: *{card.name} is not isotropic: its modulus is no one number")
    rows = [line.partition(",") for line in card.data]
    lines = [f"{float(first) * factor:.12e}{comma}{rest}" for first, comma, rest in rows]
    again = f"** romsindy: {factor:.6g} times as large", card.lines[0]
    return replace(card, lines=(*again, *lines), data=tuple(lines))


def _softer(deck: Deck, value: PartValue, compliance: float) -> Iterator[Card]:
    """Cards with springs to the ground in the place of a set of nodes that is held."""
    nodes = sorted(set(deck.sets.get(value.of, ())))
    held = [
        fields
        for card in deck.of("BOUNDARY")
        for fields in card.fields()
        if fields[0].upper() == value.of
    ]
    if not nodes or not held:
        named = {f[0].upper() for card in deck.of("BOUNDARY") for f in card.fields()}
        known = sorted(n for n in named if n in deck.sets)
        raise DeckError(
            f"{deck.path}: {value.kind} of {value.of} is asked, and no line of *BOUNDARY holds a"
            f" set of nodes of that name: there are {listed(known) or 'none'}; hold the clamp by a"
            " set of its nodes"
        )
    last = None
    for card in deck.cards:
        last = card
        if card.name != "BOUNDARY":
            yield card
            continue
        left = [line for line in card.data if line.split(",")[0].strip().upper() != value.of]
        if left:
            yield _of_text(card, card.lines[0], *left)
    assert last is not None
    stiffness = 1 / (compliance * len(nodes))
    element = deck.next_element
    for fields in held:
        first = int(fields[1])
        for direction in range(
            first, min(int(fields[2] or first) if len(fields) > 2 else first, 3) + 1
        ):
            name = f"{_NAME}_{value.of}_{direction}"
            numbers = [f"{element + i}, {node}" for i, node in enumerate(nodes)]
            element += len(nodes)
            said = f"** romsindy: {value.of} is held by springs, direction {direction}"
            spring = _of_text(last, f"*ELEMENT, TYPE=SPRING1, ELSET={name}", *numbers)
            yield replace(spring, lines=(said, *spring.lines))
            yield _of_text(last, f"*SPRING, ELSET={name}", f"{direction}", f"{stiffness:.12e}")


def _of_text(card: Card, head: str, *data: str) -> Card:
    """A card with another text, in the place of one."""
    name, *rest = [p.strip() for p in head.lstrip("*").split(",")]
    pairs = (p.partition("=") for p in rest if p)
    parameters = {key.strip().upper(): entry.strip() for key, _, entry in pairs}
    return replace(card, name=name.upper(), parameters=parameters, lines=(head, *data), data=data)


# -- between decks ---------------------------------------------------------------------------------


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


class Varied(NamedTuple):
    """The decks of a value, beside the deck as it is.

    Between them it is a polynomial in the value v; with a ``scale`` in log(1 + v / scale), for a
    clamp first frees what is pressed sideways, and then turns.
    """

    assumed: float  # value of the deck as it is
    members: tuple[tuple[float, Member], ...]  # others, with their values
    scale: float = 0.0

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


def between(base: Member, given: Sequence[tuple[Varied, float]]) -> Member:
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


def softened(omega2: Callable[[float], float], guess: float) -> float:
    """A compliance that changes omega^2, which is asked of it, by about two per cent.

    Raises a ValueError where none of many does.
    """
    rigid, compliance = omega2(0.0), guess
    for _ in range(_TRIED):
        change = 1 - omega2(compliance) / rigid
        if 1 / _NEAR < change / _SOFTER < _NEAR:
            return compliance
        compliance *= float(np.clip(_SOFTER / max(change, 1e-9), 1e-4, 1e4))
    raise ValueError(
        f"a softer clamp changes the square of the frequency by a part of {change:.2g}: this mode"
        " does not feel it; take another set of nodes"
    )
