"""A deck with what was found: other materials and nodes, a spring; in comments what has no element.

Tried in CalculiX 2.20: a nonlinear spring has no direction of its own, so it is stretched between
the node and a fixed one far away. A dashpot is not for `*DYNAMIC`: damping stands in comments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from romsindy.structure.deck import Deck
from romsindy.structure.parts import CLAMP, MATERIAL, PartValue, times
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
