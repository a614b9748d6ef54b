"""A grounded spring, linear and cubic."""

from __future__ import annotations

from dataclasses import dataclass

from romsindy.beam.effects.base import Point
from romsindy.beam.effects.directed import DirectedEffect
from romsindy.beam.validation import require_finite


@dataclass(frozen=True)
class CubicSpring(DirectedEffect):
    """A spring to the ground, f = -linear d - cubic d^3, slack on the undeformed beam.

    Parameters
    ----------
    linear
        Stiffness [N/m].
    cubic
        Cubic stiffness [N/m^3]; negative softens.
    """

    linear: float = 0.0
    cubic: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite("linear", self.linear)
        require_finite("cubic", self.cubic)

    def law(self, d: float, d_dot: float) -> float:
        return -self.linear * d - self.cubic * d**3

    def slopes(self, d: float, d_dot: float) -> tuple[float, float]:
        return -self.linear - 3.0 * self.cubic * d * d, 0.0

    def potential(self, point: Point) -> float:
        d, _ = self.motion(point)
        return 0.5 * self.linear * d**2 + 0.25 * self.cubic * d**4
