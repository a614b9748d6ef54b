"""A deck of CalculiX: what of it describes the model, and what of it cannot be reduced.

No element is interpreted: CalculiX itself gives the matrices. Read are the nodes and sets, for
sensors, and the corners of the elements, for pictures.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from romsindy.physics.validation import refuse_unknown
from romsindy.text import listed
from romsindy.typing import Array

# Corners of the faces of solids, by their number of corners.
_FACES = {
    4: ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    6: ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    8: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
CORNERS = {4: 4, 10: 4, 6: 6, 15: 6, 8: 8, 20: 8}  # by number of nodes
_SOLID = re.compile(r"C3D(\d+)[A-Z0-9]*$")
_FLAT = re.compile(r"(CPS|CPE|T3D)\d")
_POINTS = ("MASS", "SPRINGA", "SPRING1", "SPRING2")
_SOLIDS = "use solids (C3D4 to C3D20R), masses and springs"
_INDEPENDENT = "its matrices hold other freedoms than those of the nodes; model it without"
_CONSERVES = "a structure that keeps energy is reduced; leave it out"
# Cards that are refused, and why.
_REFUSED = {
    "EQUATION": _INDEPENDENT,
    "MPC": _INDEPENDENT,
    "RIGID BODY": _INDEPENDENT,
    "COUPLING": _INDEPENDENT,
    "DISTRIBUTING COUPLING": _INDEPENDENT,
    "TIE": _INDEPENDENT,
    "CYCLIC SYMMETRY MODEL": _INDEPENDENT,
    "PRE-TENSION SECTION": _INDEPENDENT,
    "TRANSFORM": "its matrices are in directions of their own; give all directions as global ones",
    "CONTACT PAIR": "contact opens and closes, and no polynomial follows that; leave it out",
    "SHELL SECTION": f"shells are expanded into solids, and their mass is not positive; {_SOLIDS}",
    "BEAM SECTION": f"beams are expanded into solids, and their mass is not positive; {_SOLIDS}",
    "MEMBRANE SECTION": f"membranes are expanded into solids; {_SOLIDS}",
    "PLASTIC": _CONSERVES,
    "CREEP": _CONSERVES,
    "DASHPOT": f"{_CONSERVES}, and state damping beside the deck",
    "RESTART": "a deck is reduced from its text alone; write the model out",
    "SUBMODEL": "a deck is reduced from its text alone; write the model out",
}
_LOADS = ("CLOAD", "DLOAD", "DSLOAD", "TEMPERATURE")


class DeckError(ValueError):
    """A deck that cannot be reduced: file, line, why, and what to do."""


@dataclass(frozen=True)
class Card:
    """A keyword of a deck with its data."""

    name: str  # in capitals
    parameters: dict[str, str]
    source: tuple[Path, int]  # file, and line of the keyword
    lines: tuple[str, ...]  # all of it as it stands
    data: tuple[str, ...]  # lines of data, without comments and what is empty
    rows: tuple[int, ...]  # their numbers in the file

    @property
    def at(self) -> str:
        """Where it stands, in words."""
        return f"{self.source[0]}, line {self.source[1]}"

    def fields(self) -> Iterator[list[str]]:
        """The entries of each line of data."""
        for line in self.data:
            yield [field.strip() for field in line.split(",")]


@dataclass(frozen=True, eq=False)
class Deck:
    """A deck up to its first step; supports may stand in that step."""

    path: Path
    cards: tuple[Card, ...]  # of the model, with the supports
    notes: tuple[str, ...]  # what of the deck is left out
    step: Card | None  # the first step, where there is one

    @classmethod
    def load(cls, path: str | Path) -> Deck:
        """Read a deck, with the files that it includes.

        Raises
        ------
        DeckError
            For a card that cannot be reduced, a file that is missing, or a deck without nodes,
            elements or density: file, line and remedy.
        """
        model: list[Card] = []
        step: list[Card] = []
        several = 0
        for card in _cards(Path(path)):
            several += card.name == "STEP"
            if several < 2:
                (step if several else model).append(card)
        supports = [c for c in step if c.name == "BOUNDARY"]
        unused = _without_section(model)
        kept = tuple(card for card in (*model, *supports) if card not in unused)
        notes = (*map(_said, unused), *_left_out(step))
        deck = cls(Path(path), kept, notes, next(iter(step), None))
        deck._check()
        return deck

    @property
    def files(self) -> dict[str, Path]:
        """Files that it was read from, by what they are."""
        others = {c.source[0] for c in self.cards} - {self.path}
        included = {f"included by the deck ({path.name})": path for path in sorted(others)}
        return {"the deck": self.path, **included}

    @property
    def lines(self) -> list[str]:
        """Lines of the file itself, as they stand."""
        return _lines(self.path)

    @property
    def text(self) -> str:
        """The model, to which steps can be added."""
        return "\n".join(line for card in self.cards for line in card.lines) + "\n"

    def of(self, name: str) -> Iterator[Card]:
        """Cards of a name."""
        return (card for card in self.cards if card.name == name)

    @cached_property
    def nodes(self) -> dict[int, Array]:
        """Coordinates (3,) by number of the node."""
        found = {}
        for card in self.of("NODE"):
            for number, *xyz in card.fields():
                place = [_number(card, x) if x else 0.0 for x in xyz[:3]]
                found[int(_number(card, number))] = np.array(place + [0.0] * (3 - len(place)))
        return found

    @cached_property
    def sets(self) -> dict[str, list[int]]:
        """Numbers of nodes by name of their set, in capitals."""
        return self._named("NSET", "NODE", lambda card: (int(f[0]) for f in card.fields()))

    @cached_property
    def solids(self) -> dict[int, list[int]]:
        """Nodes of the solids by number of the element, corners first."""
        return {n: nodes for card in self.of("ELEMENT") for n, nodes in _solids(card)}

    @cached_property
    def parts(self) -> dict[str, list[int]]:
        """Numbers of solids by name of their set of elements, in capitals."""
        named = self._named("ELSET", "ELEMENT", lambda card: (n for n, _ in _solids(card)))
        return {name: [n for n in own if n in self.solids] for name, own in named.items()}

    def _named(
        self, kind: str, first: str, members: Callable[[Card], Iterator[int]]
    ) -> dict[str, list[int]]:
        """Members of sets of a kind, by the cards of what it has and by those of sets."""
        found: dict[str, list[int]] = {}
        for card in self.cards:
            name = card.parameters.get(kind, "").upper()
            if name and card.name in (first, kind):
                own = members(card) if card.name == first else _members(card, found)
                found.setdefault(name, []).extend(own)
        return found

    @cached_property
    def faces(self) -> list[tuple[int, ...]]:
        """Corners of the outer faces of the solids: those that belong to one element alone."""
        sides = [side for nodes in self.solids.values() for side in _sides(nodes)]
        times = Counter(frozenset(side) for side in sides)
        return [side for side in sides if times[frozenset(side)] == 1]

    @property
    def solid(self) -> str:
        """Number of one of its solids."""
        first = (c for c in self.of("ELEMENT") if _SOLID.match(_type(c)))
        return next(next(card.fields())[0] for card in first)

    @property
    def next_element(self) -> int:
        """A number that no element has."""
        firsts = [int(f[0]) for c in self.of("ELEMENT") for f in c.fields() if f[0].isdigit()]
        return max(firsts, default=0) + 1

    def node(self, name: str) -> int:
        """A node by its number, or by a set that holds it alone.

        Raises a ValueError where there is no such node, or a set holds several.
        """
        if name.isdigit():
            if int(name) not in self.nodes:
                raise ValueError(
                    f"node {name} is not in {self.path}: its nodes are {min(self.nodes)} to"
                    f" {max(self.nodes)}"
                )
            return int(name)
        refuse_unknown(f"sets of nodes of {self.path}", [name.upper()], [*self.sets])
        members = sorted(set(self.sets[name.upper()]))
        if len(members) > 1:
            raise ValueError(
                f"the set {name} of {self.path} holds {len(members)} nodes: name one of them, such"
                f" as {members[0]}"
            )
        return members[0]

    def _check(self) -> None:
        for card in self.cards:
            if card.name in _REFUSED:
                raise DeckError(f"{card.at}: *{card.name} cannot be reduced: {_REFUSED[card.name]}")
        for card in self.of("ELEMENT"):
            kind = _type(card)
            solid = _SOLID.match(kind)
            if kind not in _POINTS and (solid is None or int(solid[1]) not in CORNERS):
                raise DeckError(
                    f"{card.at}: elements {kind or 'without TYPE'} cannot be reduced: shells, beams"
                    f" and plane elements are expanded, and their mass is not positive; {_SOLIDS}"
                )
        for card in self.of("BOUNDARY"):
            for fields in card.fields():
                if len(fields) > 3 and fields[3] and _number(card, fields[3]):
                    raise DeckError(
                        f"{card.at}: *BOUNDARY holds a node away from its place"
                        f" ({', '.join(fields)}): the rest of a reduced structure is its undeformed"
                        " shape; give supports without a value"
                    )
        missing = [n for n in ("NODE", "ELEMENT", "DENSITY") if not any(self.of(n))]
        if missing:
            cards = listed([f"*{name}" for name in missing])
            raise DeckError(f"{self.path}: there is no {cards}: this is no deck of a vibration")


def _cards(path: Path, including: Sequence[Path] = ()) -> Iterator[Card]:
    """Cards of a file and of those that it includes, in their order."""
    for start, head, block, data in _blocks(_lines(path)):
        name, parameters = said_by(head)
        card = Card(name, parameters, (path, start), block, (*data.values(),), (*data,))
        if card.name != "INCLUDE":
            yield card
            continue
        other = path.parent / parameters.get("INPUT", "")
        if not other.is_file():
            raise DeckError(
                f"{card.at}: *INCLUDE asks for {parameters.get('INPUT', 'no file')}, which is not"
                f" there ({other}): put it there, or into the deck"
            )
        if other.resolve() in {p.resolve() for p in (*including, path)}:
            raise DeckError(f"{card.at}: *INCLUDE of {other} goes round in a circle: take it out")
        yield from _cards(other, (*including, path))


def said_by(head: str) -> tuple[str, dict[str, str]]:
    """Name and parameters of a card, by its first line."""
    name, *rest = [p.strip() for p in head.lstrip("*").split(",")]
    pairs = (p.partition("=") for p in rest if p)
    parameters = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
    return " ".join(name.upper().split()), parameters


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except FileNotFoundError as error:
        raise DeckError(f"{path}: there is no such deck") from error


def _blocks(lines: Sequence[str]) -> Iterator[tuple[int, str, tuple[str, ...], dict[int, str]]]:
    """Of each keyword the number of its line, its head, all lines, and those of data by number."""
    starts = [i for i, line in enumerate(lines) if _is_keyword(line)]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        head, first = lines[start], start + 1
        while head.rstrip().endswith(",") and first < end:  # the head goes on
            head, first = head + lines[first], first + 1
        rows = range(first, end)
        data = {i + 1: lines[i] for i in rows if lines[i].strip() and not _is_comment(lines[i])}
        yield start + 1, head, tuple(lines[start:end]), data


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("**")


def _is_keyword(line: str) -> bool:
    return line.lstrip().startswith("*") and not _is_comment(line)


def _members(card: Card, sets: dict[str, list[int]]) -> Iterator[int]:
    """Nodes of a set."""
    for fields in card.fields():
        entries = [f for f in fields if f]
        if "GENERATE" in card.parameters:
            first, last, *step = (int(f) for f in entries)
            yield from range(first, last + 1, step[0] if step else 1)
            continue
        for entry in entries:
            yield from [int(entry)] if entry.isdigit() else sets.get(entry.upper(), [])


def _solids(card: Card) -> Iterator[tuple[int, list[int]]]:
    """Solids of a card: number, and nodes."""
    solid = _SOLID.match(_type(card))
    size = int(solid[1]) + 1 if solid else 0
    numbers = [int(f) for fields in card.fields() for f in fields if f] if solid else []
    for i in range(0, len(numbers), size or 1):
        yield numbers[i], numbers[i + 1 : i + size]


def _sides(nodes: Sequence[int]) -> list[tuple[int, ...]]:
    return [tuple(nodes[i] for i in face) for face in _FACES[CORNERS[len(nodes)]]]


def _type(card: Card) -> str:
    return card.parameters.get("TYPE", "").upper()


def _number(card: Card, entry: str) -> float:
    try:
        return float(entry.upper().replace("D", "E"))
    except ValueError:
        raise DeckError(f"{card.at}: *{card.name} has {entry!r} where a number stands") from None


def _without_section(cards: Sequence[Card]) -> list[Card]:
    """Plane and line elements without a section: gmsh writes them of surfaces, for their sets."""
    named = {c.parameters.get("ELSET", "").upper() for c in cards if c.name.endswith(" SECTION")}
    members = {
        entry
        for c in cards
        if c.name == "ELSET" and c.parameters.get("ELSET", "").upper() in named
        for fields in c.fields()
        for entry in fields
    }

    def used(card: Card) -> bool:
        own = card.parameters.get("ELSET", "").upper() in named
        return own or any(f[0] in members for f in card.fields())

    flat = [c for c in cards if c.name == "ELEMENT" and _FLAT.match(_type(c))]
    return [card for card in flat if not used(card)]


def _said(card: Card) -> str:
    return f"{card.at}: elements {_type(card)} are left out: they have no section"


def _left_out(step: Sequence[Card]) -> Iterator[str]:
    """What of the first step a reduction does not know."""
    loads = [c for c in step if c.name in _LOADS]
    if loads:
        cards = listed(sorted({f"*{c.name}" for c in loads}))
        yield (
            f"{loads[0].at}: {cards} of the step is left out: the rest of what is reduced is the"
            " undeformed shape, without load"
        )
