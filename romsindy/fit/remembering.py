"""Forces that remember, as parts of a fit: their strengths, and what shapes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from romsindy.effects.base import Effect, Scales
from romsindy.effects.memory import MemoryEffect, SmallMass
from romsindy.fit.part import Part
from romsindy.fit.record import Prepared
from romsindy.physics.memory import MemoryLaw
from romsindy.physics.term import Term
from romsindy.physics.term_sum import TermSum

Model = TypeVar("Model", bound=TermSum)


def memory_parts(model: TermSum, records: Sequence[Prepared]) -> tuple[Part, ...]:
    """The forces of a model that remember, from their values there.

    Raises
    ------
    ValueError
        If a shape value is so far from what the records can show that no fit finds it.
    """
    if not model.memories:
        return ()
    longest = max(records, key=lambda r: float(r.t[-1]))
    scales = Scales(max(r.amplitude for r in records), longest.rate, float(longest.t[-1]))
    return tuple(_part(law, c, scales, len(records)) for law, c in model.memories.items())


def _part(law: MemoryLaw, strength: float, scales: Scales, n_records: int) -> Part:
    effect = MemoryEffect.of_law(law)
    if isinstance(effect, SmallMass):  # it may vibrate where a record begins
        effect = replace(effect, late=True)
    shapes = effect.parameters(scales)
    for p in shapes:
        if not p.low <= effect.value(p.name) <= p.high:
            raise ValueError(
                f"{law.key} starts from {p.name} = {effect.value(p.name):.4g}, and of these records"
                f" a fit finds values from {p.low:.4g} to {p.high:.4g}: start between them"
            )
    part = Part.of(effect, scales, n_records, [effect.value(p.name) for p in shapes])
    strengths = part.strengths.copy()
    strengths[:, 0] = max(strength, 0.0)
    return replace(part, strengths=strengths)


def laws_in(effect: Effect) -> tuple[Term | MemoryLaw, ...]:
    """The terms that an effect is in a model, with a memory or without, one for each strength."""
    return (effect.remembering,) if isinstance(effect, MemoryEffect) else effect.laws()


def with_memories(model: Model, parts: Sequence[Part]) -> Model:
    """The model with the forces of parts that remember in the place of those it has."""
    found = {p.effect.remembering: p for p in parts if isinstance(p.effect, MemoryEffect)}
    by_key = {law.key: (law, float(p.strengths[0, 0])) for law, p in found.items()}
    pairs = zip(model.terms, model.values, strict=True)
    new = [by_key.get(t.key, (t, v)) for t, v in pairs]
    return replace(model, terms=tuple(t for t, _ in new), values=tuple(v for _, v in new))
