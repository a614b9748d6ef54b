"""Where on a simulated structure something acts: at which of the points that it offers.

The first mode alone does not tell: a force elsewhere, as much larger as the point moves less, does
the same to it. Other modes are moved, damped and detuned in proportions that go with the point.
Points far from each other are tried first, on the first cycles, in which a mode that is detuned
has not lost step yet; then those about the likeliest, on more of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from romsindy.fit.verdict import PLACE, PLACE_RISE
from romsindy.typing import Array

# Parts of what all sensors are heard of, one after the other, and how many new points in each
_LEVELS = ((0.25, 16), (0.5, 8), (1.0, 6), (1.0, 6), (1.0, 6))
_AROUND = 8  # nearest points of the likeliest, which are tried last, until none is better
_CLOSE = 0.01  # of the size: nearer to each other none is tried
_ALIKE = 0.01  # a strength that differs less is the same
_SPANS = 0.2  # of the size: along an axis on which the structure is smaller nothing is told


@dataclass(frozen=True, eq=False)
class PlaceOnStructure:
    """Where an effect acts: the likeliest point, and the box of those that may be, m."""

    point: str
    at: Array  # (3,)
    low: Array  # (3,)
    high: Array  # (3,)
    extent: Array  # (3,), of the structure
    ends: tuple[str, str]  # points at the ends of the box, along its longest edge
    # How many times as strong it would be at either end, to do the same
    strengths: tuple[float, float] = (1.0, 1.0)

    @property
    def told(self) -> bool:
        """Whether the data can tell where."""
        return bool(np.linalg.norm(self.high - self.low) < PLACE * np.linalg.norm(self.extent))

    def __str__(self) -> str:
        if not self.told:
            return "these data cannot tell at which point of the structure it acts"
        along = self.extent > _SPANS * np.linalg.norm(self.extent)
        rows = zip("xyz", self.at, self.low, self.high, along, strict=True)
        spans = [f"{n} = {x:.3g} ({a:.3g} to {b:.3g}) m" for n, x, a, b, told in rows if told]
        where = f"it acts at {self.point}, {', '.join(spans)}"
        low, high = sorted(self.strengths)
        if high - low < _ALIKE:
            return where
        return f"{where}; at the ends of that it is {low:.3g} and {high:.3g} times as strong"

    def content(self) -> dict[str, object]:
        """What JSON keeps of it."""
        box = {name: getattr(self, name).tolist() for name in ("at", "low", "high")}
        strengths = list(self.strengths)
        return {"point": self.point, **box, "told": self.told, "strengths": strengths}


def likeliest_place(
    points: Mapping[str, Array],
    first: str,
    misfit: Callable[[str, float], float],
    tells: Callable[[float, float, float], float],
) -> tuple[float, PlaceOnStructure]:
    """The least misfit, and its place.

    ``first`` is tried before all others, and kept unless another one is better beyond doubt.
    ``misfit`` is of a point on a part of the readings; ``tells`` says what a rise of it beyond the
    least counts for, as chi-square.
    """
    names, places = [*points], np.array([*points.values()])
    extent = np.ptp(places, axis=0)
    close, own = _CLOSE * float(np.linalg.norm(extent)), names.index(first)
    likely, reach = {own}, np.inf
    for share, more in _LEVELS:
        near = np.flatnonzero(_distance(places, places[[*likely]]) <= reach)
        chosen = {own, *likely}
        for _ in range(more):
            apart = _distance(places[near], places[[*chosen]])
            if apart.max() <= close:
                break
            chosen.add(int(near[np.argmax(apart)]))
        left = {i: misfit(names[i], share) for i in sorted(chosen)}
        least = min(left.values())
        likely = {i for i, x in left.items() if tells(x - least, least, share) <= PLACE_RISE}
        # Between points that were tried one may be as likely.
        reach = max(float(_distance(places[near], places[[*chosen]]).max()), close)
    best = min(left, key=lambda i: left[i])
    while True:
        nearest = np.argsort(np.linalg.norm(places - places[best], axis=1))[1 : 1 + _AROUND]
        left |= {i: misfit(names[i], 1.0) for i in nearest.tolist() if i not in left}
        if left[best] <= min(left.values()):
            break
        best = min(left, key=lambda i: left[i])
    likely = {i for i, x in left.items() if tells(x - left[best], left[best], 1.0) <= PLACE_RISE}
    best = own if own in likely else best
    inside = np.flatnonzero(_distance(places, places[[*likely]]) <= reach)
    box = places[inside]
    along = box[:, int(np.argmax(np.ptp(box, axis=0)))]
    ends = names[inside[np.argmin(along)]], names[inside[np.argmax(along)]]
    spans = zip(places.T, box.min(axis=0), box.max(axis=0), strict=True)
    sides = [_beyond(*span) for span in spans]
    low, high = np.array(sides).T
    given = places[best], low, high, extent, ends
    return left[best], PlaceOnStructure(names[best], *given)


def _beyond(places: Array, low: float, high: float) -> tuple[float, float]:
    """Ends of an interval half-way to the next places outside: between them nothing is told."""
    below, above = places[places < low], places[places > high]
    first = (low + below.max()) / 2 if len(below) else low
    return float(first), float((high + above.min()) / 2 if len(above) else high)


def _distance(places: Array, others: Array) -> Array:
    """Of each place (n, 3) to the nearest of others (m, 3)."""
    return np.asarray(np.linalg.norm(places[:, None] - others, axis=2).min(axis=1))
