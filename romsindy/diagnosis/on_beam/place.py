"""Where on a beam an effect acts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from romsindy.beam.structure import FREE, BeamStructure
from romsindy.fit.verdict import PLACE, PLACE_RISE
from romsindy.typing import Array

PLACE_ERRORS = PLACE_RISE**0.5  # standard errors to either side of a place that are told

# Parts of the length over which an effect is looked for, at so many points: nearer to a support
# nothing moves.
_WITH_FREE_END, _BETWEEN, _POINTS = (0.25, 1.0), (0.2, 0.8), 7


def points(beam: BeamStructure) -> list[float]:
    """Where an effect that may be anywhere is tried at all sensors, m."""
    between = _WITH_FREE_END if beam.right == FREE else _BETWEEN
    return (beam.length * np.linspace(*between, _POINTS)).tolist()


def some_points(beam: BeamStructure, usual: float | None) -> list[float | None]:
    """Where it is tried in the coordinate of the first mode, m: ``usual``, and at some others."""
    return [usual, *points(beam)[:-1:2]]


@dataclass(frozen=True)
class PlaceOnBeam:
    """Where an effect acts, m."""

    at: float  # the likeliest point
    # `PLACE_ERRORS` standard errors to either side
    low: float
    high: float
    length: float  # of the beam
    # Of the effect, were it at ``low`` and at ``high``, with their 95 % errors outwards; empty
    # where it was not found again
    strengths: tuple[float, ...] = ()

    @property
    def told(self) -> bool:
        """Whether the data can tell where."""
        return self.high - self.low < PLACE * self.length

    def holds(self, at: float) -> bool:
        """Whether an effect may act at a point, m."""
        return self.low <= at <= self.high

    def between(self, known: Array) -> list[float]:
        """Points to look at, beside those that are ``known``, where these are too far apart."""
        i = int(np.clip(np.searchsorted(known, self.at), 1, len(known) - 1))
        apart = float(known[i] - known[i - 1])
        if self.high - self.low > apart:
            return []
        return [x for x in (self.at - apart / 4, self.at + apart / 4) if known[0] < x < known[-1]]

    def about(self, points: Sequence[float]) -> list[float]:
        """Where to look again, of ``points`` at equal distances: all, or about where it was."""
        if not self.told:
            return list(points)
        apart = points[1] - points[0]
        near = np.clip([self.at - apart, self.at, self.at + apart], points[0], points[-1])
        return sorted(set(near.tolist()))

    def untold(self) -> PlaceOnBeam:
        """The same, where nothing else supports it."""
        return replace(self, low=0.0, high=self.length, strengths=())

    def __str__(self) -> str:
        if self.told:
            return f"it acts at {self.at:.3g} m ({self.low:.3g} to {self.high:.3g} m)"
        if not self.strengths:
            return "these data cannot tell where on the beam it acts"
        return f"between {self.low:.2g} and {self.high:.2g} m"
