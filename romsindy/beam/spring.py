"""A straight spring to a fixed anchor, whose pre-stretch is geometry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from romsindy.effects.load import MountedLaw
from romsindy.effects.mounting import TowardsAnchor
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.validation import require_finite, require_positive


@dataclass(frozen=True)
class Spring(MountedLaw):
    """A spring from a point of the beam to a fixed anchor, force k (l - l0) along itself.

    Parameters
    ----------
    at : float, optional
        Position on the undeformed axis [m]; None is the right end.
    stiffness : float
        Stiffness k [N/m].
    anchor : (float, float)
        (x, y) of the fixed end [m]; x runs along the undeformed beam from its left end.
    natural_length : float
        Length l0 [m] at which the spring is free of force.

    Raises
    ------
    ValueError
        For a negative stiffness or natural length, or an anchor that is not finite.
    """

    at: float | None = None
    stiffness: float = 1.0
    anchor: tuple[float, float] = (0.0, 0.0)
    natural_length: float = 0.0

    def __post_init__(self) -> None:
        require_positive("stiffness", self.stiffness, zero_allowed=True)
        require_positive("natural_length", self.natural_length, zero_allowed=True)
        require_finite("anchor", *self.anchor)

    law = Stiffness(1)

    @property
    def strength(self) -> float:  # type: ignore[override]
        """The stiffness."""
        return self.stiffness

    @cached_property
    def mounting(self) -> TowardsAnchor:  # type: ignore[override]
        """Towards the anchor, beyond the natural length."""
        return TowardsAnchor(self.anchor, self.at, self.natural_length)


def springs_of(beam: Any) -> list[Spring]:
    """Return the springs of a beam."""
    return [e for e in beam.effects if isinstance(e, Spring)]


def find_spring(beam: Any) -> Spring:
    """Return the one spring of a beam.

    Raises
    ------
    ValueError
        If there is none, or more than one.
    """
    springs = springs_of(beam)
    if len(springs) != 1:
        raise ValueError(f"the beam has {len(springs)} springs, this effect needs exactly one")
    return springs[0]
