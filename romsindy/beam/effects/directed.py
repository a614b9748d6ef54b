"""Point effects that act along one fixed direction: only a law f(d, d_dot) is left to write."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

from romsindy.beam.effects.base import ZERO, Matrix, Point, PointEffect, Vector


@dataclass(frozen=True)
class DirectedEffect(PointEffect):
    """A force along `direction` that depends on the displacement d along it and its rate.

    d is counted from the undeformed beam [m].

    Parameters
    ----------
    at
        Position on the undeformed axis [m]; None is the right end.
    direction
        (x, y), of any length; (0, 1) is transverse, upwards.

    Raises
    ------
    ValueError
        For a direction of length zero.
    """

    direction: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        norm = math.hypot(*self.direction)
        if not 0.0 < norm < math.inf:
            raise ValueError(f"direction = {self.direction} points nowhere; (0, 1) is upwards")
        unit = (self.direction[0] / norm, self.direction[1] / norm)
        object.__setattr__(self, "direction", unit)

    @abstractmethod
    def law(self, d: float, d_dot: float) -> float:
        """Return the force [N] along `direction`."""

    def slopes(self, d: float, d_dot: float) -> tuple[float, float]:
        """Return the derivatives of the law, to d and to d_dot."""
        return 0.0, 0.0

    def motion(self, point: Point) -> tuple[float, float]:
        """Return (d, d_dot)."""
        ex, ey = self.direction
        d = ex * (point.x - point.s) + ey * point.y
        return d, ex * point.x_dot + ey * point.y_dot

    def force(self, point: Point) -> Vector:
        f = self.law(*self.motion(point))
        return f * self.direction[0], f * self.direction[1], 0.0

    def tangent(self, point: Point) -> Matrix:
        return self._dyad(-self.slopes(*self.motion(point))[0])

    def damping_tangent(self, point: Point) -> Matrix:
        return self._dyad(-self.slopes(*self.motion(point))[1])

    def _dyad(self, value: float) -> Matrix:
        ex, ey = self.direction
        return (
            (value * ex * ex, value * ex * ey, 0.0),
            (value * ex * ey, value * ey * ey, 0.0),
            ZERO,
        )
