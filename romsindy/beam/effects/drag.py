"""Quadratic air drag along the whole beam."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.beam.effects.base import LineEffect, Matrix, Point, Vector
from romsindy.beam.validation import require_positive


@dataclass(frozen=True)
class Drag(LineEffect):
    """Drag on the motion across the beam, per unit length 1/2 density c_d width |v_n| v_n.

    v_n is the velocity normal to the section's own axis; the motion along it is free.

    Parameters
    ----------
    coefficient
        Drag coefficient c_d [-]; a flat plate has 1.2 to 2.
    width
        Width of the beam across the flow [m].
    density
        Of the fluid [kg/m^3].
    """

    coefficient: float = 1.2
    width: float = 0.025
    density: float = 1.2

    def __post_init__(self) -> None:
        require_positive("coefficient", self.coefficient, zero_allowed=True)
        require_positive("width", self.width)
        require_positive("density", self.density)

    @property
    def _factor(self) -> float:
        return 0.5 * self.density * self.coefficient * self.width

    def force(self, point: Point) -> Vector:
        c, s = np.cos(point.theta), np.sin(point.theta)
        v_n = c * point.y_dot - s * point.x_dot
        f = -self._factor * np.abs(v_n) * v_n
        return -f * s, f * c, 0.0

    def tangent(self, point: Point) -> Matrix:
        c, s = np.cos(point.theta), np.sin(point.theta)
        v_n, v_t = c * point.y_dot - s * point.x_dot, c * point.x_dot + s * point.y_dot
        # turning the section by d theta takes v_n by -v_t, and the normal (-s, c) by -(c, s)
        k = -self._factor * np.abs(v_n)
        fx, fy = k * (-2.0 * v_t * s + v_n * c), k * (2.0 * v_t * c + v_n * s)
        return (0.0, 0.0, fx), (0.0, 0.0, fy), (0.0, 0.0, 0.0)

    def damping_tangent(self, point: Point) -> Matrix:
        c, s = np.cos(point.theta), np.sin(point.theta)
        k = 2.0 * self._factor * np.abs(c * point.y_dot - s * point.x_dot)
        return (k * s * s, -k * s * c, 0.0), (-k * s * c, k * c * c, 0.0), (0.0, 0.0, 0.0)
