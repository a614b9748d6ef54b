"""What an effect is: a force on the beam, at a point or along it, or a change of the beam itself.

The contract for a new effect, one small file:

* a frozen dataclass that derives from `PointEffect` (a force at one point), `LineEffect` (a force
  per unit length) or `Effect` (then override `applied_to`, which returns the changed beam);
* `force(point)` gives (fx, fy, moment) acting on the beam, in N and N m (per metre for a line);
* `tangent(point)` = -d force / d(x, y, theta) and `damping_tangent(point)` = -d force / d velocity,
  each as three rows of three; leave out what is zero;
* an effect either stores energy (override `potential`) or dissipates it (potential zero, and
  force times velocity never positive): the energy balance counts on that.

The formulas must hold for numbers and, in a `LineEffect`, for arrays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

Vector = tuple[Any, Any, Any]
Matrix = tuple[Vector, Vector, Vector]

ZERO: Vector = (0.0, 0.0, 0.0)
ZEROS: Matrix = (ZERO, ZERO, ZERO)


class Point(NamedTuple):
    """Where a point of the beam's axis is and how it moves [m, m, rad; m/s, m/s, rad/s].

    `s` is its position on the undeformed axis, so the axial displacement is x - s.
    """

    s: Any
    x: Any
    y: Any
    theta: Any
    x_dot: Any = 0.0
    y_dot: Any = 0.0
    theta_dot: Any = 0.0


class Effect:
    """Anything that `Beam.with_effect` accepts."""

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with this effect."""
        return replace(beam, effects=(*beam.effects, self))


class ForceEffect(Effect, ABC):
    """An effect that is a force."""

    @abstractmethod
    def force(self, point: Point) -> Vector:
        """Return (fx, fy, moment) on the beam."""

    def tangent(self, point: Point) -> Matrix:
        """Return -d(force)/d(x, y, theta)."""
        return ZEROS

    def damping_tangent(self, point: Point) -> Matrix:
        """Return -d(force)/d(x_dot, y_dot, theta_dot)."""
        return ZEROS

    def potential(self, point: Point) -> Any:
        """Return the stored energy [J] (per metre for a line); zero if the effect dissipates."""
        return 0.0


@dataclass(frozen=True)
class PointEffect(ForceEffect):
    """A force at one point.

    Parameters
    ----------
    at
        Position on the undeformed axis [m]; None is the right end, the tip of a cantilever.
    """

    at: float | None = None


class LineEffect(ForceEffect):
    """A force per unit length all along the beam; fields of `Point` are arrays over the nodes."""
