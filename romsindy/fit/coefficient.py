"""What acts within a model: another coefficient, or an effect on one of several coordinates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from romsindy.effects.base import Effect, Parameter, Scales, State, TermEffect
from romsindy.fit.part import Part
from romsindy.physics.coupling import Along
from romsindy.physics.damping import PowerDamping
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.physics.term_sum import TermSum
from romsindy.typing import Array

Model = TypeVar("Model", bound=TermSum)

# Dry friction is smoothed over this part of the largest velocity, see `Term.regularised`: more, and
# quiet motions see less friction than there is; less, and the steps in time miss where it jumps.
SMOOTHING = 0.001
LINEAR: tuple[Term, ...] = (Stiffness(1), PowerDamping(1))


@dataclass(frozen=True)
class Coefficient(TermEffect):
    """Another value of one coefficient; the strength is the change.

    It is ``called`` as the effect whose law the model has already, where it stands for that.
    """

    of: Term
    called: str = "coefficient"

    label = "another coefficient than assumed"
    name = property(lambda self: self.called)

    @property
    def family(self) -> str:  # type: ignore[override]
        """That of the law."""
        return next((f for f in ("damping", "inertia") if self.of.has(f)), "stiffness")

    @property
    def variant(self) -> str:
        """Name of the coefficient."""
        return self.of.key

    def term(self) -> Term:
        """The term of the model itself."""
        return self.of


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

    family, variant, sign, start, tolerance, advice = map(
        _own, ("family", "variant", "sign", "start", "tolerance", "advice")
    )
    n_strengths, per_record, n_shared = map(_own, ("n_strengths", "per_record", "n_shared"))
    value, remembered, strength_unit = map(_own, ("value", "remembered", "strength_unit"))

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
    def acts_on(self) -> int:  # type: ignore[override]
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

    def term(self) -> Along | None:
        """The law along the coordinate."""
        law = self.of.term()
        return None if law is None else Along.coordinate(law, self.number)


def free_coefficients(model: TermSum, names: Sequence[str]) -> tuple[Part, ...]:
    """Changes, 0 at first, of some coefficients of a model."""
    terms = {term.key: term for term in model.terms}
    return tuple(Part(Coefficient(terms[name]), (), np.zeros((1, 1))) for name in names)


def in_place(model: TermSum, catalogue: Iterable[Effect]) -> list[Coefficient]:
    """Wrong coefficients of what only adds to a model, but is in it already: it may be too much."""
    terms = {term.key: term for term in model.terms}
    laws = {e: e.term() for e in catalogue if e.sign}
    there = [(e, terms[law.key]) for e, law in laws.items() if law and law.key in terms]
    return [Coefficient(term, called=effect.name) for effect, term in there]


def extended(model: Model, parts: Sequence[Part]) -> Model:
    """The model with the terms of the parts added; parts that are no terms are left out."""
    terms = {t.key: t for t in model.terms}
    values = model.coefficients
    for part in parts:
        for term, strength in zip(part.effect.laws(), part.strengths[0].tolist(), strict=False):
            terms[term.key] = terms.get(term.key, term)
            values[term.key] = values.get(term.key, 0.0) + strength
    return replace(model, terms=tuple(terms.values()), values=tuple(values[k] for k in terms))
