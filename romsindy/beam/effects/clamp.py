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
    """Rotational compliance of the left clamp, in series with the stiffness that it has.

    Parameters
    ----------
    compliance : float
        Rotation per moment, rad/(N m).
    """

    compliance: float

    def __post_init__(self) -> None:
        require_positive("compliance", self.compliance)

    def applied_to(self, beam: Structure) -> Structure:
        """Return `beam` with its left clamp on a softer rotational spring.

        Raises
        ------
        ValueError
            If the left end turns freely.
        """
        u, w, theta = beam.left.fixed
        stiffness = beam.left.rotational_stiffness
        if not theta and stiffness == 0.0:
            raise ValueError(
                "the left end turns freely, so no clamp can give way; give it "
                "left=CLAMPED or left=Support.elastic(...)"
            )
        own = 0.0 if theta else 1.0 / stiffness
        softer = replace(
            beam.left,
            fixed=(u, w, False),
            rotational_stiffness=1.0 / (own + self.compliance),
        )
        return replace(beam, left=softer)
