"""A magnet: attraction or repulsion by an inverse power of the distance."""

from __future__ import annotations

import math
from dataclasses import dataclass

from romsindy.beam.effects.base import ZERO, Matrix, Point, PointEffect, Vector
from romsindy.beam.validation import require_finite, require_positive


@dataclass(frozen=True)
class Magnet(PointEffect):
    """A force strength / r^power from a point of the beam towards a fixed magnet.

    Parameters
    ----------
    at
        Position on the undeformed axis [m]; None is the right end.
    strength
        Force times distance^power [N m^power]; negative repels.
    position
        (x, y) of the magnet [m].
    power
        Exponent, above 1; 4 is that of two dipoles.
    """

    strength: float = 1e-6
    position: tuple[float, float] = (0.0, 0.0)
    power: float = 4.0

    def __post_init__(self) -> None:
        require_finite("strength", self.strength)
        for value in self.position:
            require_finite("position", value)
        require_positive("power - 1", self.power - 1.0)

    def _towards(self, point: Point) -> tuple[float, float, float]:
        dx, dy = self.position[0] - point.x, self.position[1] - point.y
        return dx, dy, math.hypot(dx, dy)

    def force(self, point: Point) -> Vector:
        dx, dy, r = self._towards(point)
        f = self.strength / r ** (self.power + 1.0)
        return f * dx, f * dy, 0.0

    def tangent(self, point: Point) -> Matrix:
        dx, dy, r = self._towards(point)
        f = self.strength / r ** (self.power + 1.0)
        g = (self.power + 1.0) * f / r**2
        xy = -g * dx * dy
        return (f - g * dx * dx, xy, 0.0), (xy, f - g * dy * dy, 0.0), ZERO

    def potential(self, point: Point) -> float:
        *_, r = self._towards(point)
        return -self.strength / ((self.power - 1.0) * r ** (self.power - 1.0))
