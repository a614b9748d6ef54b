"""A clamp that gives way in rotation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from romsindy.beam.effects.base import Effect
from romsindy.beam.validation import require_positive

if TYPE_CHECKING:
    from romsindy.beam.structure import Structure


@dataclass(frozen=True)
class ClampCompliance(Effect):
    """Rotational compliance of the left clamp.

    Parameters
    ----------
    compliance
        Rotation per moment [rad/(N m)].
    """

    compliance: float

    def __post_init__(self) -> None:
        require_positive("compliance", self.compliance)

    def applied_to(self, beam: Structure) -> Structure:
        """Return `beam` with its left clamp on a rotational spring."""
        support = replace(
            beam.left, fixed=(True, True, False), rotational_stiffness=1.0 / self.compliance
        )
        return replace(beam, left=support)
