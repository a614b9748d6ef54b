"""Values of parts of a deck, and decks that have others.

Modulus, density and thickness of a set of elements are told as factors, the compliance of a clamp
(a set of nodes that is held) in m/N of all its nodes together.

A deck with what was found has other materials and nodes, and a spring; in comments what has no
element. Tried in CalculiX 2.20: a nonlinear spring has no direction of its own, so it is stretched
between the node and a fixed one far away. A dashpot is not for `*DYNAMIC`: damping stands in
comments.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from romsindy.physics.validation import require_positive
from romsindy.structure.deck import CORNERS, Card, Deck, DeckError, said_by
from romsindy.structure.linear import Units
from romsindy.text import listed
from romsindy.typing import Array

MATERIAL = {"modulus": "ELASTIC", "density": "DENSITY"}
CLAMP, THICKNESS = "clamp", "thickness"
_KINDS = (*MATERIAL, THICKNESS, CLAMP)
_NAME = "ROMSINDY"
PART = 0.1  # by which a factor of a part is varied to either side
SOFT = (0.05, 0.2, 0.6, 2.0, 5.0)  # of the compliance of a clamp that is felt
# By which a clamp changes omega^2: wanted, and near enough
_SOFTER, _NEAR, _TRIED = 0.02, 2.0, 8
_BROAD = 1.8  # times its thickness a part is wide, at least: a square bar has no thickness
# Of solids, by their number of corners: from face to opposite face, edges that do not cross
_ACROSS = {
    6: (((0, 3), (1, 4), (2, 5)),),
    8: (
        ((0, 1), (3, 2), (7, 6), (4, 5)),
        ((0, 3), (1, 2), (5, 6), (4, 7)),
        ((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}
_Edges = list[tuple[int, int]]  # pairs of nodes
# Edges in the order of the nodes in their middles
_EDGES = {
    4: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    6: ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    8: (
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}


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
        cards = {CLAMP: _softer, THICKNESS: _thicker}.get(self.kind, _scaled)
        return replace(deck, cards=(*cards(deck, self, value),))


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
    for card in deck.cards:
        if card in sections:
            if card is sections[0]:
                yield from copy
            kept = [(k, v) for k, v in card.parameters.items() if k != "MATERIAL"]
            others = "".join(f", {k}={v}" if v else f", {k}" for k, v in kept)
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
    head = (line for line in card.lines if line.lstrip().startswith("*"))  # comments before as well
    again = (f"** romsindy: {factor:.6g} times as large", *head, *lines)
    return replace(card, lines=again, data=tuple(lines))


def _softer(deck: Deck, value: PartValue, compliance: float) -> Iterator[Card]:
    """Cards with springs to the ground in the place of a set of nodes that is held."""
    nodes = sorted(set(deck.sets.get(value.of, ())))
    rows = [fields for card in deck.of("BOUNDARY") for fields in card.fields()]
    held = [fields for fields in rows if fields[0].upper() == value.of]
    if not nodes or not held:
        known = sorted({f[0].upper() for f in rows} & deck.sets.keys())
        raise DeckError(
            f"{deck.path}: {value.kind} of {value.of} is asked, and no line of *BOUNDARY holds a"
            f" set of nodes of that name: there are {listed(known) or 'none'}; hold the clamp by a"
            " set of its nodes"
        )
    for card in deck.cards:
        if card.name != "BOUNDARY":
            yield card
            continue
        left = [line for line in card.data if line.split(",")[0].strip().upper() != value.of]
        if left:
            yield _of_text(card, card.lines[0], *left)
    last = deck.cards[-1]
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


def _thicker(deck: Deck, value: PartValue, factor: float) -> Iterator[Card]:
    """Cards with the nodes of a set of elements moved away from its middle surface."""
    require_positive(f"thickness of {value.of}", factor)
    away = _from_middle(deck, value)
    for nodes in deck.solids.values():  # edges of neighbours stay straight
        for a, b, middle in _middles(nodes):
            if middle not in away and (a in away or b in away):
                away[middle] = (away.get(a, np.zeros(3)) + away.get(b, np.zeros(3))) / 2
    most = abs(factor - 1) * max(float(np.linalg.norm(x)) for x in away.values())
    for card in deck.cards:
        numbers = [int(fields[0]) for fields in card.fields()] if card.name == "NODE" else []
        if away.keys().isdisjoint(numbers):
            yield card
            continue
        data = list(card.data)
        for i, node in enumerate(numbers):
            if node in away:
                place = deck.nodes[node] + (factor - 1) * away[node]
                data[i] = ", ".join([f"{node}", *(f"{x:.12e}" for x in place)])
        said = f"{value.of} is {factor:.6g} times as thick: nodes move by up to {most:.3g}"
        yield replace(card, lines=(f"** romsindy: {said}", card.lines[0], *data), data=tuple(data))


def _from_middle(deck: Deck, value: PartValue) -> dict[int, Array]:
    """How far nodes are from the middle surface of a set, (3,), along lines of nodes across it."""
    solids = {n: deck.solids[n] for n in deck.parts.get(value.of, ())}
    if not solids:
        raise DeckError(
            f"{deck.path}: thickness of {value.of} is asked, and no set of solids has that name:"
            f" there are {listed(sorted(n for n, s in deck.parts.items() if s)) or 'none'}; name"
            " the part by *ELSET"
        )
    line = _bound(edge for edges in _across(deck, value, solids).values() for edge in edges)
    groups: dict[frozenset[int], list[int]] = {}
    for node, number in line.items():
        groups.setdefault(frozenset({number}), []).append(node)
    for a, b, middle in {m for nodes in solids.values() for m in _middles(nodes)}:
        # What is between two lines is a line of its own.
        groups.setdefault(frozenset({line[a], line[b]}), []).append(middle)
    found: dict[int, Array] = {}
    for nodes in groups.values():
        places = np.array([deck.nodes[n] for n in nodes])
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        first, last = places[list(np.unravel_index(np.argmax(apart), apart.shape))]
        along = (last - first) / (apart.max() or 1.0)
        heights = (places - (first + last) / 2) @ along
        found |= dict(zip(nodes, np.outer(heights, along), strict=True))
    return found


def _across(deck: Deck, value: PartValue, solids: Mapping[int, list[int]]) -> dict[int, _Edges]:
    """Edges of each solid of a set that lead through its thickness.

    It is the way to the nearest opposite face of the set, as most solids of a layer have it.

    Raises a DeckError where there is no such way, or more than one.
    """
    asked = f"{deck.path}: thickness of {value.of} is asked, and"
    ways: dict[tuple[int, int], _Edges] = {}  # by element and direction
    for element, nodes in solids.items():
        corners = CORNERS[len(nodes)]
        if corners not in _ACROSS:
            raise DeckError(
                f"{asked} its element {element} is a tetrahedron: there are no lines of nodes"
                " across; mesh the part with hexahedra or wedges (C3D6 to C3D20R)"
            )
        for i, pairs in enumerate(_ACROSS[corners]):
            ways[element, i] = [(nodes[a], nodes[b]) for a, b in pairs]
    # Ways that go on through a face are a column, those beside each other are of a layer.
    column = _bound((w, *map(frozenset, zip(*e, strict=True))) for w, e in ways.items())
    layer = _bound((w, *map(frozenset, e)) for w, e in ways.items())
    size: dict[int, float] = defaultdict(float)  # of columns
    own: dict[int, list[tuple[int, int]]] = {}
    for way, edges in ways.items():
        a, b = np.array([[deck.nodes[n] for n in edge] for edge in edges]).swapaxes(0, 1)
        size[column[way]] += float(np.linalg.norm(b - a, axis=1).mean())
        own.setdefault(way[0], []).append(way)
    every = Counter(layer[w] for w in ways)
    shortest = Counter(layer[min(o, key=lambda w: size[column[w]])] for o in own.values())
    places = np.array([deck.nodes[n] for nodes in solids.values() for n in nodes])
    extent, found, wide = float(np.linalg.norm(np.ptp(places, axis=0))), {}, []
    for element, several in own.items():
        through = [w for w in several if shortest[layer[w]] > every[layer[w]] / 2]
        if len(through) != 1:
            raise DeckError(
                f"{asked} {'no' if not through else 'more than one'} pair of broad faces lies"
                f" opposite each other at element {element}: give each plate or shell of it a set"
                " of its own (*ELSET)"
            )
        found[element] = ways[through[0]]
        beside = [size[column[w]] for w in several if w not in through]
        wide.append(min(beside, default=extent) / size[column[through[0]]])
    if np.median(wide) < _BROAD:
        raise DeckError(
            f"{asked} it is only {np.median(wide):.2g} times as wide as thick: which of its faces"
            " are the broad ones nobody can say; take a flat part, or vary its modulus and density"
        )
    return found


def _bound(several: Iterable[Iterable[Any]]) -> dict[Any, int]:
    """A number for each thing, the same of those that are bound together."""
    index: dict[Any, int] = {}
    pairs = [
        (index.setdefault(first, len(index)), index.setdefault(other, len(index)))
        for first, *others in several
        for other in others
    ]
    rows, columns = np.array(pairs, int).reshape(-1, 2).T
    graph = coo_array((np.ones(len(rows)), (rows, columns)), (len(index), len(index)))
    return dict(zip(index, connected_components(graph, directed=False)[1].tolist(), strict=True))


def _middles(nodes: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """Corners of the edges of a solid, and the node in the middle; none where it has none."""
    corners = CORNERS[len(nodes)]
    for (a, b), middle in zip(_EDGES[corners], nodes[corners:], strict=False):
        yield nodes[a], nodes[b], middle


def _of_text(card: Card, head: str, *data: str) -> Card:
    """A card with another text, in the place of one."""
    name, parameters = said_by(head)
    return replace(card, name=name, parameters=parameters, lines=(head, *data), data=data)


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


# -- what was found --------------------------------------------------------------------------------

_FAR = 1e3  # times the size of the structure: from there a spring pulls along one direction
_TABLE, _BEYOND = 401, 2.0  # points of a spring, and how far: it is constant beyond its table
_LINEAR = 1e-6  # of a force: a spring that bends less is one number


class Correction(NamedTuple):
    """What was found, in SI units."""

    node: int
    direction: int
    spring: Callable[[float], float] | None  # force on the node (N) over its displacement (m)
    reach: float  # largest displacement of the node that was compared, m
    mass: float  # at the node, kg
    modulus: float  # over that of the deck
    density: float
    parts: Mapping[str, float]  # values of parts, see `PartValue`
    remarks: Sequence[str]  # what was found, and what no element stands for


def corrected_deck(deck: Deck, found: Correction, units: Units) -> str:
    """The text of the deck with the correction, each change under a comment that says what it is.

    Files that it includes stand in it.

    Raises a ValueError for a material that is not isotropic, and a part that is not there.
    """
    changed = deck
    for name, value in found.parts.items():
        part = PartValue.of_name(name)
        assert part is not None
        unit = units.length / units.force if part.kind == CLAMP else 1.0
        changed = part.deck(changed, value / unit)
    factors = {MATERIAL["modulus"]: found.modulus, MATERIAL["density"]: found.density}
    lines = deck.lines
    end = len(lines) if deck.step is None else deck.step.source[1] - 1
    model = [c for c in changed.cards if c.source[0] != deck.path or c.source[1] <= end]
    if found.parts and len(model) < len(changed.cards):
        raise ValueError(
            f"{deck.path}: supports stand in the first step: put them before it, so that they can"
            " be written beside what was found"
        )
    first = min((c.source[1] for c in deck.cards if c.source[0] == deck.path), default=1)
    text = [line for line in lines[: first - 1] if line.lstrip().startswith("**")]  # no *INCLUDE
    for card in model:
        factor = factors.get(card.name, 1.0)
        text += (card if factor == 1.0 else times(card, factor)).lines
    text += [f"** romsindy: {remark}" for remark in found.remarks]
    if found.mass:
        text += [
            f"*ELEMENT, TYPE=MASS, ELSET={_NAME}_MASS",
            f"{changed.next_element + 1}, {found.node}",
            f"*MASS, ELSET={_NAME}_MASS",
            f"{found.mass / units.mass:.9e}",
        ]
    if found.spring is not None:
        text += _spring(changed, found, units)
    return "\n".join([*text, *lines[end:]]) + "\n"


def _spring(deck: Deck, found: Correction, units: Units) -> list[str]:
    """Cards of a spring between the node and the ground."""
    assert found.spring is not None
    pull = found.spring
    x = _BEYOND * found.reach * np.linspace(-1, 1, _TABLE)
    force = np.array([-pull(float(v)) for v in x]) / units.force
    x = x / units.length
    node, element = max(deck.nodes) + 1, deck.next_element
    slope = np.polyfit(x, force, 1)[0]
    if np.abs(force - slope * x).max() < _LINEAR * np.abs(force).max():
        return [
            f"*ELEMENT, TYPE=SPRING1, ELSET={_NAME}",
            f"{element}, {found.node}",
            f"*SPRING, ELSET={_NAME}",
            f"{found.direction}",
            f"{slope:.9e}",  # without a point it would be a direction
        ]
    places = np.array([*deck.nodes.values()])
    away = deck.nodes[found.node].copy()
    away[found.direction - 1] -= _FAR * float(np.ptp(places, axis=0).max())
    return [
        "*NODE",
        f"{node}, " + ", ".join(f"{v:.12g}" for v in away),
        "*BOUNDARY",
        f"{node}, 1, 3",
        f"*ELEMENT, TYPE=SPRINGA, ELSET={_NAME}",
        f"{element}, {node}, {found.node}",
        f"*SPRING, ELSET={_NAME}, NONLINEAR",
        "",
        *(f"{f:.9e}, {v:.9e}" for f, v in zip(force, x, strict=True)),
    ]
