"""A viscous damper between a point and the ground."""

from __future__ import annotations

from dataclasses import dataclass

from romsindy.beam.effects.directed import DirectedEffect
from romsindy.beam.validation import require_positive


@dataclass(frozen=True)
class Dashpot(DirectedEffect):
    """A damper to the ground, f = -coefficient d_dot.

    Parameters
    ----------
    coefficient
        Viscous coefficient [N s/m].
    """

    coefficient: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("coefficient", self.coefficient, zero_allowed=True)

    def law(self, d: float, d_dot: float) -> float:
        return -self.coefficient * d_dot

    def slopes(self, d: float, d_dot: float) -> tuple[float, float]:
        return 0.0, -self.coefficient
