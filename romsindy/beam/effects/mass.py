"""A point mass on the beam; with gravity it also weighs."""

from __future__ import annotations

from dataclasses import dataclass

from romsindy.beam.effects.base import Effect
from romsindy.beam.validation import require_positive


@dataclass(frozen=True)
class AddedMass(Effect):
    """A mass clamped to a point of the beam.

    Parameters
    ----------
    mass
        Mass [kg].
    at
        Position on the undeformed axis [m]; None is the right end.
    rotary_inertia
        Moment of inertia about the point [kg m^2].

    Raises
    ------
    ValueError
        For a negative mass or inertia.
    """

    mass: float
    at: float | None = None
    rotary_inertia: float = 0.0

    def __post_init__(self) -> None:
        require_positive("mass", self.mass, zero_allowed=True)
        require_positive("rotary_inertia", self.rotary_inertia, zero_allowed=True)
