"""An elastic stop with a gap, on one side or on both."""

from __future__ import annotations

import math
from dataclasses import dataclass

from romsindy.beam.effects.base import Point
from romsindy.beam.effects.directed import DirectedEffect
from romsindy.beam.validation import require_positive


@dataclass(frozen=True)
class Stop(DirectedEffect):
    """An elastic stop: no force inside the gap, stiffness times penetration beyond it.

    Parameters
    ----------
    stiffness
        Contact stiffness [N/m].
    above
        Displacement d [m] at which the upper stop is met; None is no upper stop.
    below
        Displacement d [m] at which the lower stop is met; None is no lower stop.

    Raises
    ------
    ValueError
        If there is no stop at all, or the lower is not below the upper.
    """

    stiffness: float = 1e4
    above: float | None = None
    below: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("stiffness", self.stiffness)
        if self.above is None and self.below is None:
            raise ValueError("above = below = None is no stop; give the gap on one side [m]")
        if not self._bounds[0] < self._bounds[1]:
            raise ValueError(f"below = {self.below} must be less than above = {self.above}")

    @property
    def _bounds(self) -> tuple[float, float]:
        below = -math.inf if self.below is None else self.below
        return below, math.inf if self.above is None else self.above

    def _penetration(self, d: float) -> float:
        below, above = self._bounds
        return max(d - above, 0.0) + min(d - below, 0.0)

    def law(self, d: float, d_dot: float) -> float:
        return -self.stiffness * self._penetration(d)

    def slopes(self, d: float, d_dot: float) -> tuple[float, float]:
        return (-self.stiffness if self._penetration(d) else 0.0), 0.0

    def potential(self, point: Point) -> float:
        d, _ = self.motion(point)
        return 0.5 * self.stiffness * self._penetration(d) ** 2
