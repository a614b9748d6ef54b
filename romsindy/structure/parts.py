"""Values of parts of a deck, and decks that have others.

Modulus and density of a set of elements are told as factors, the compliance of a clamp (a set of
nodes that is held) in m/N of all its nodes together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from romsindy.structure.deck import Card, Deck, DeckError
from romsindy.text import listed

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
