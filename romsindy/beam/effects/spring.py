"""A straight spring to a fixed anchor, whose pre-stretch is geometry; more tension in it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from romsindy.beam.effects.base import ZERO, Effect, Matrix, Point, PointEffect, Vector
from romsindy.beam.validation import require_finite, require_positive

if TYPE_CHECKING:
    from romsindy.beam.structure import Structure


@dataclass(frozen=True)
class Spring(PointEffect):
    """A spring from a point of the beam to a fixed anchor, force k (l - l0) along itself.

    Parameters
    ----------
    at
        Position on the undeformed axis [m]; None is the right end.
    stiffness
        Stiffness k [N/m].
    anchor
        (x, y) of the fixed end [m]; x runs along the undeformed beam from its left end.
    natural_length
        Length l0 [m] at which the spring is free of force.

    Raises
    ------
    ValueError
        For a negative stiffness or natural length, or an anchor that is not finite.
    """

    stiffness: float = 1.0
    anchor: tuple[float, float] = (0.0, 0.0)
    natural_length: float = 0.0

    def __post_init__(self) -> None:
        require_positive("stiffness", self.stiffness, zero_allowed=True)
        require_positive("natural_length", self.natural_length, zero_allowed=True)
        for value in self.anchor:
            require_finite("anchor", value)

    def span(self, x: float, y: float) -> float:
        """Return the length [m] of the spring when its beam end is at (x, y)."""
        return math.hypot(self.anchor[0] - x, self.anchor[1] - y)

    def force(self, point: Point) -> Vector:
        dx, dy = self.anchor[0] - point.x, self.anchor[1] - point.y
        pull = self.stiffness * (1.0 - self.natural_length / math.hypot(dx, dy))
        return pull * dx, pull * dy, 0.0

    def tangent(self, point: Point) -> Matrix:
        span = self.span(point.x, point.y)
        ex, ey = (self.anchor[0] - point.x) / span, (self.anchor[1] - point.y) / span
        along, across = self.stiffness, self.stiffness * (1.0 - self.natural_length / span)
        xy = (along - across) * ex * ey
        return (
            (along * ex * ex + across * ey * ey, xy, 0.0),
            (xy, along * ey * ey + across * ex * ex, 0.0),
            ZERO,
        )

    def potential(self, point: Point) -> float:
        return 0.5 * self.stiffness * (self.span(point.x, point.y) - self.natural_length) ** 2


@dataclass(frozen=True)
class ExtraTension(Effect):
    """More (or less) tension in the beam's spring, by a shorter natural length.

    Parameters
    ----------
    tension
        Added tension [N] at the spring's present length.
    """

    tension: float

    def __post_init__(self) -> None:
        require_finite("tension", self.tension)

    def applied_to(self, beam: Structure) -> Structure:
        """Return `beam` with its spring tightened.

        Raises
        ------
        ValueError
            If the beam has not exactly one spring, or it would have to be shorter
            than nothing.
        """
        spring = find_spring(beam)
        natural = spring.natural_length - self.tension / spring.stiffness
        if natural < 0.0:
            most = spring.natural_length * spring.stiffness
            raise ValueError(
                f"tension = {self.tension} N would need a negative natural length; at most "
                f"{most:.4g} N can be added"
            )
        tightened = replace(spring, natural_length=natural)
        return replace(beam, effects=tuple(tightened if e is spring else e for e in beam.effects))


def find_spring(beam: Structure) -> Spring:
    """Return the one spring of a beam.

    Raises
    ------
    ValueError
        If there is none, or more than one.
    """
    springs = [e for e in beam.effects if isinstance(e, Spring)]
    if len(springs) != 1:
        raise ValueError(f"the beam has {len(springs)} springs, this effect needs exactly one")
    return springs[0]
