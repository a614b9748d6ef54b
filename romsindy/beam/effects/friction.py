"""Dry friction, regularised: at a point, or inside the spring."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from romsindy.beam.effects.base import ZERO, Matrix, Point, PointEffect, Vector
from romsindy.beam.effects.directed import DirectedEffect
from romsindy.beam.effects.spring import find_spring
from romsindy.beam.validation import require_positive

if TYPE_CHECKING:
    from romsindy.beam.structure import Structure


@dataclass(frozen=True)
class Friction(DirectedEffect):
    """Coulomb friction against the ground, f = -limit tanh(d_dot / creep).

    Parameters
    ----------
    limit
        Friction force [N].
    creep
        Velocity [m/s] below which the force turns round smoothly; small against the
        velocities of interest.
    """

    limit: float = 0.01
    creep: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("limit", self.limit, zero_allowed=True)
        require_positive("creep", self.creep)

    def law(self, d: float, d_dot: float) -> float:
        return -self.limit * math.tanh(d_dot / self.creep)

    def slopes(self, d: float, d_dot: float) -> tuple[float, float]:
        return 0.0, -self.limit / self.creep * (1.0 - math.tanh(d_dot / self.creep) ** 2)


@dataclass(frozen=True)
class SpringFriction(PointEffect):
    """Coulomb friction inside the spring: limit tanh(l_dot / creep) against its lengthening l_dot.

    Parameters
    ----------
    limit
        Friction force [N].
    creep
        See `Friction` [m/s].
    anchor
        Fixed end (x, y) [m]; None takes place and anchor from the beam's own spring.
    """

    limit: float = 0.01
    creep: float = 1e-3
    anchor: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        require_positive("limit", self.limit, zero_allowed=True)
        require_positive("creep", self.creep)

    def applied_to(self, beam: Structure) -> Structure:
        """Return `beam` with friction in its spring.

        Raises
        ------
        ValueError
            If no anchor was given and the beam has not exactly one spring.
        """
        effect = self
        if self.anchor is None:
            spring = find_spring(beam)
            effect = replace(self, at=spring.at, anchor=spring.anchor)
        return replace(beam, effects=(*beam.effects, effect))

    def _direction(self, point: Point) -> tuple[float, float, float]:
        """Return the unit vector away from the anchor, and the length."""
        if self.anchor is None:
            raise ValueError("anchor = None; add SpringFriction with beam.with_effect(...)")
        dx, dy = point.x - self.anchor[0], point.y - self.anchor[1]
        span = math.hypot(dx, dy)
        return dx / span, dy / span, span

    def force(self, point: Point) -> Vector:
        ex, ey, _ = self._direction(point)
        f = -self.limit * math.tanh((ex * point.x_dot + ey * point.y_dot) / self.creep)
        return f * ex, f * ey, 0.0

    def tangent(self, point: Point) -> Matrix:
        ex, ey, span = self._direction(point)
        lengthening = ex * point.x_dot + ey * point.y_dot
        across = ex * point.y_dot - ey * point.x_dot
        turn = math.tanh(lengthening / self.creep)
        slope = (1.0 - turn * turn) / self.creep
        # moving across the spring turns it: d(l_dot) = across / span, d(e) = (-ey, ex) / span
        fx = self.limit / span * (slope * across * ex - turn * ey)
        fy = self.limit / span * (slope * across * ey + turn * ex)
        return (-ey * fx, ex * fx, 0.0), (-ey * fy, ex * fy, 0.0), ZERO

    def damping_tangent(self, point: Point) -> Matrix:
        ex, ey, _ = self._direction(point)
        turn = math.tanh((ex * point.x_dot + ey * point.y_dot) / self.creep)
        c = self.limit / self.creep * (1.0 - turn * turn)
        return (c * ex * ex, c * ex * ey, 0.0), (c * ex * ey, c * ey * ey, 0.0), ZERO
