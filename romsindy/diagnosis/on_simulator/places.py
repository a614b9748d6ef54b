"""Where on a simulated structure something acts: at which of the points that it offers.

The first mode alone does not tell: a force elsewhere, as much larger as the point moves less, does
the same to it. Other modes are moved, damped and detuned in proportions that go with the point.
Points far from each other are tried first, on the first cycles, in which a mode that is detuned
has not lost step yet; then those about the likeliest, on more of them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

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


@dataclass(frozen=True, eq=False)
class PlaceSearch:
    """Looks for the place of something among points, from afar to near.

    Where there are no ``points`` it is at the ``own`` one, which is tried before all others, and
    kept unless another one is better beyond doubt. ``misfits`` are those of points on a part of
    the readings; ``tells`` says what a rise of it beyond the least counts for, as chi-square.
    """

    points: Mapping[str, Array]
    own: str
    misfits: Callable[[Sequence[str], float], Sequence[float]]
    tells: Callable[[float, float, float], float]
    known: dict[tuple[str, float], float] = field(default_factory=dict)

    def left(self, points: Iterable[str], share: float = 1.0) -> dict[str, float]:
        """The misfits of points; each is asked once."""
        names = [*points]
        new = [name for name in names if (name, share) not in self.known]
        if new:
            rows = zip(new, self.misfits(new, share), strict=True)
            self.known.update({(name, share): misfit for name, misfit in rows})
        return {name: self.known[name, share] for name in names}

    @cached_property
    def places(self) -> Array:
        """Of all points, (n, 3)."""
        return np.array([*self.points.values()])

    @cached_property
    def first(self) -> float:
        """The least misfit on the first cycles of points that are far from each other."""
        share, more = _LEVELS[0]
        far = self._apart({self.own}, np.inf, more)[0] if self.points else [self.own]
        return min(self.left(far, share).values())

    def _apart(self, likely: Collection[str], reach: float, more: int) -> tuple[list[str], float]:
        """Likely points, the own one and so many ``more`` within reach, far from each other.

        As second how far the rest within reach is from them.
        """
        names, places = [*self.points], self.places
        chosen = {names.index(name) for name in (self.own, *likely)}
        near = np.flatnonzero(_distance(places, places[[names.index(n) for n in likely]]) <= reach)
        for _ in range(more):
            apart = _distance(places[near], places[[*chosen]])
            if apart.max() <= self._close:
                break
            chosen.add(int(near[np.argmax(apart)]))
        rest = float(_distance(places[near], places[[*chosen]]).max())
        return [names[i] for i in sorted(chosen)], max(rest, self._close)

    @property
    def _close(self) -> float:
        return _CLOSE * float(np.linalg.norm(np.ptp(self.places, axis=0)))

    def likeliest(self, most: float = np.inf) -> tuple[float, PlaceOnStructure | None]:
        """The least misfit, and its place.

        What leaves more than ``most`` of the first cycles already, wherever it is, leaves more of
        all: its place is not told.
        """
        if not self.points:
            return self.left([self.own])[self.own], None
        names, places = [*self.points], self.places
        likely, reach = {self.own}, np.inf
        for level, (share, more) in enumerate(_LEVELS):
            chosen, reach = self._apart(likely, reach, more)
            left = self.left(chosen, share)
            least = min(left.values())
            if level and least > most and not self._alike(least, most, share):
                return least, None
            likely = {n for n, x in left.items() if self._alike(x, least, share)}
        best = min(left, key=lambda n: left[n])
        while True:
            apart = np.linalg.norm(places - self.points[best], axis=1)
            nearest = [names[i] for i in np.argsort(apart)[1 : 1 + _AROUND]]
            left |= self.left(nearest)
            if left[best] <= min(left.values()):
                break
            best = min(left, key=lambda n: left[n])
        likely = {n for n, x in left.items() if self._alike(x, left[best], 1.0)}
        best = self.own if self.own in likely else best
        return left[best], self._told(best, likely, reach)

    def _alike(self, x: float, least: float, share: float) -> bool:
        return self.tells(x - least, least, share) <= PLACE_RISE

    def _told(self, best: str, likely: Collection[str], reach: float) -> PlaceOnStructure:
        """The place, with the box of points that may be."""
        names, places = [*self.points], self.places
        extent = np.ptp(places, axis=0)
        inside = np.flatnonzero(
            _distance(places, np.array([self.points[n] for n in likely])) <= reach
        )
        box = places[inside]
        along = box[:, int(np.argmax(np.ptp(box, axis=0)))]
        ends = names[inside[np.argmin(along)]], names[inside[np.argmax(along)]]
        spans = zip(places.T, box.min(axis=0), box.max(axis=0), strict=True)
        low, high = np.array([_beyond(*span) for span in spans]).T
        return PlaceOnStructure(best, self.points[best], low, high, extent, ends)


def _beyond(places: Array, low: float, high: float) -> tuple[float, float]:
    """Ends of an interval half-way to the next places outside: between them nothing is told."""
    below, above = places[places < low], places[places > high]
    first = (low + below.max()) / 2 if len(below) else low
    return float(first), float((high + above.min()) / 2 if len(above) else high)


def _distance(places: Array, others: Array) -> Array:
    """Of each place (n, 3) to the nearest of others (m, 3)."""
    return np.asarray(np.linalg.norm(places[:, None] - others, axis=2).min(axis=1))
