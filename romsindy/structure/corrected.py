"""A deck with what was found: changed materials, a spring, and in comments what has no element.

Tried in CalculiX 2.20: a nonlinear spring has no direction of its own, so it is stretched between
the node and a fixed one far away. A dashpot is not for `*DYNAMIC`: damping stands in comments.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from romsindy.structure.deck import Card, Deck
from romsindy.structure.simulator import Units

_FAR = 1e3  # times the size of the structure: from there a spring pulls along one direction
_TABLE, _BEYOND = 401, 2.0  # points of a spring, and how far: it is constant beyond its table
_LINEAR = 1e-6  # of a force: a spring that bends less is one number
_NAME = "ROMSINDY"


class Correction(NamedTuple):
    """What was found, in SI units."""

    node: int
    direction: int
    spring: Callable[[float], float] | None  # force on the node (N) over its displacement (m)
    reach: float  # largest displacement of the node that was compared, m
    modulus: float  # over that of the deck
    density: float
    remarks: Sequence[str]  # what was found, and what no element stands for


def corrected_deck(deck: Deck, found: Correction, units: Units) -> str:
    """The text of the deck with the correction, each change under a comment that says what it is.

    Raises a ValueError for a material in a file that the deck includes, whose text is not written.
    """
    lines = deck.lines
    for name, factor in (("ELASTIC", found.modulus), ("DENSITY", found.density)):
        if factor != 1.0:
            for card in deck.of(name):
                _scale(lines, deck, card, factor)
    added = [f"** romsindy: {remark}" for remark in found.remarks]
    if found.spring is not None:
        added += _spring(deck, found, units)
    here = deck.step is not None and deck.step.source[0] == deck.path
    end = deck.step.source[1] - 1 if here and deck.step is not None else len(lines)
    return "\n".join([*lines[:end], *added, *lines[end:]]) + "\n"


def _scale(lines: list[str], deck: Deck, card: Card, factor: float) -> None:
    """Multiply what the first lines of a material have first, under a comment."""
    kind = card.parameters.get("TYPE", "ISO").upper()
    if card.source[0] != deck.path or (card.name == "ELASTIC" and not kind.startswith("ISO")):
        raise ValueError(
            f"{card.at}: *{card.name} is to be multiplied by {factor:.6g}, and stands in a file"
            " that is included, or is not isotropic: change it by hand, or put it into the deck"
        )
    for row, line in zip(card.rows, card.data, strict=True):
        first, comma, rest = line.partition(",")
        lines[row - 1] = f"{float(first) * factor:.9e}{comma}{rest}"
    head = card.source[1] - 1
    lines[head] = f"** romsindy: {factor:.6g} times as large\n{lines[head]}"


def _spring(deck: Deck, found: Correction, units: Units) -> list[str]:
    """Cards of a spring between the node and the ground."""
    assert found.spring is not None
    pull = found.spring
    x = _BEYOND * found.reach * np.linspace(-1, 1, _TABLE)
    force = np.array([-pull(float(v)) for v in x]) / units.force
    x = x / units.length
    node, element = max(deck.nodes) + 1, _next_element(deck)
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


def _next_element(deck: Deck) -> int:
    """A number that no element has."""
    firsts = [int(f[0]) for card in deck.of("ELEMENT") for f in card.fields() if f[0].isdigit()]
    return max(firsts, default=0) + 1
