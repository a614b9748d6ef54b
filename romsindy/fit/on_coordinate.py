"""An effect on one of several coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from romsindy.effects.base import Effect, Parameter, Scales, State
from romsindy.fit.coefficient import SMOOTHING, Coefficient
from romsindy.physics.coupling import Along
from romsindy.physics.memory import Memory
from romsindy.typing import Array


def _own(name: str) -> Any:
    """What the effect has without its coordinate."""
    return property(lambda self: getattr(self.of, name))


@dataclass(frozen=True)
class OnCoordinate(Effect):
    """An effect on one of several coordinates, counted from 1, which has these scales.

    Its name ends in the coordinate, as the names of coefficients do: "dry_friction [q2]".
    """

    of: Effect
    number: int
    scales: Scales

    family, variant, sign, start, tolerance, n_strengths, per_record, n_shared, advice = map(
        _own,
        "family variant sign start tolerance n_strengths per_record n_shared advice".split(),
    )

    @property
    def name(self) -> str:  # type: ignore[override]
        """Of the effect and its coordinate."""
        return self._called(self.of.name)

    @property
    def label(self) -> str:  # type: ignore[override]
        """As an engineer says it."""
        return f"{self.of.label} of mode {self.number}"

    @property
    def resembles(self) -> tuple[str, ...]:  # type: ignore[override]
        """Others on the same coordinate."""
        return tuple(map(self._called, self.of.resembles))

    def _called(self, name: str) -> str:
        return f"{name} [q{self.number}]"

    @property
    def coordinate(self) -> int:  # type: ignore[override]
        """The column of a motion (n, R)."""
        return self.number - 1

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        return self.of.parameters(self.scales)

    def forms(self, scales: Scales) -> tuple[Effect, ...]:
        return tuple(replace(self, of=form) for form in self.of.forms(self.scales))

    def elsewhere(self, t: Array) -> OnCoordinate:
        return replace(self, of=self.of.elsewhere(t))

    def shaped(self, values: Mapping[str, float]) -> OnCoordinate:
        return replace(self, of=self.of.shaped(values)) if values else self

    def value(self, name: str) -> float:
        return self.of.value(name)

    @property
    def _acting(self) -> Effect:
        """What acts: smooth, for a coordinate that friction stops is moved by the others."""
        law = self.of.term()
        if law is None or law.smooth:
            return self.of
        fastest = self.scales.amplitude * self.scales.omega
        return Coefficient(law.regularised(SMOOTHING * fastest))

    def forces(self, state: State) -> Array | None:
        """From the state of its coordinate."""
        return self._acting.forces(state)

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        return self._acting.slopes(state, strengths)

    def remembered(self, state: State) -> Memory | None:
        return self.of.remembered(state)

    def term(self) -> Along | None:
        """The law along the coordinate."""
        law = self.of.term()
        return None if law is None else Along.coordinate(law, self.number)

    def strength_unit(self, unit: str | None) -> str:
        return self.of.strength_unit(unit)
