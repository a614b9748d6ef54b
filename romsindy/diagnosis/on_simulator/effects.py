"""What a simulator of one's own can be given: a force at its point, and other values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from romsindy.effects.base import TermEffect
from romsindy.physics.term import Combination


class ForceScale(NamedTuple):
    """What a force does: its point moves by ``per_q`` q, over the modal ``mass`` of q."""

    mass: float
    per_q: float


@dataclass(frozen=True)
class ValueEffect(TermEffect):
    """A value that the simulator takes is another than assumed; the strength is its change.

    ``direction`` is what a unit of the change does to the coefficients of the equation, ``assumed``
    the value, ``tolerance`` the standard deviation of a change that is known to be near 0.
    """

    value_name: str
    assumed: float
    direction: Combination
    tolerance: float | None = None  # type: ignore[misc]

    family = "value"
    advice = "measure the value by itself"

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the value."""
        return self.value_name

    @property
    def label(self) -> str:  # type: ignore[override]
        """As an engineer says it."""
        return f"another {self.value_name} than {self.assumed:.6g}"

    def term(self) -> Combination:
        return self.direction

    def strength_unit(self, unit: str | None) -> str:
        """Its own, which nobody knows."""
        return ""
