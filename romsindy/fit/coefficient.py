"""A coefficient of the model that is to be found: a part of the equation like any effect."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from romsindy.effects.base import Effect, TermEffect
from romsindy.fit.part import Part
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.physics.term_sum import TermSum

Model = TypeVar("Model", bound=TermSum)


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


def free_coefficients(model: TermSum, names: Sequence[str]) -> tuple[Part, ...]:
    """Changes, 0 at first, of some coefficients of a model."""
    terms = {term.key: term for term in model.terms}
    return tuple(Part(Coefficient(terms[name]), (), np.zeros((1, 1))) for name in names)


def in_place(model: ReducedModel, catalogue: Iterable[Effect]) -> list[Coefficient]:
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
