"""A model to be fitted, and its free terms as parts.

Forces that jump are made smooth there; those that remember are parts with what shapes them.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from romsindy.effects.base import Effect, Scales
from romsindy.effects.memory import MemoryEffect, SmallMass
from romsindy.fit.kernel.part import SMOOTHING, Model, Part, free_coefficients
from romsindy.fit.kernel.prepared import Prepared
from romsindy.physics.coupling import Along
from romsindy.physics.memory import MemoryLaw
from romsindy.physics.term import Term
from romsindy.physics.term_sum import TermSum
from romsindy.typing import Array


def free_parts(
    model: Model, names: Sequence[str], records: Sequence[Prepared]
) -> tuple[Model, tuple[Part, ...]]:
    """A model to fit, and its free coefficients as parts.

    The jump of a free force is averaged over each step in time, which no velocity scale blurs: all
    of it is in its part, and none in the model. Other jumps are smoothed, and those of several
    coordinates: one of them may stop while others go on. Forces that remember are in parts, too.
    """
    memories = memory_parts(model, records)
    remembering = {law.key for law in model.memories}
    names = [name for name in names if name not in remembering]
    alone = {t.key for t in model.terms if not (t.smooth or isinstance(t, Along))}
    apart = alone & {*names}
    values = model.coefficients
    outside = apart | remembering
    inside = tuple(0.0 if name in outside else value for name, value in values.items())
    left = smoothed(replace(model, values=inside), records, apart)
    parts = free_coefficients(left, names)
    free = (
        replace(p, strengths=np.full((1, 1), values[name])) if name in apart else p
        for name, p in zip(names, parts, strict=True)
    )
    return left, (*free, *memories)


def smoothed(model: Model, records: Sequence[Prepared], but: Collection[str] = ()) -> Model:
    """Model whose dry friction is smooth at the speeds of the records, each in its direction.

    Coefficients with names that stand in ``but`` keep their jump.
    """
    stays = [term.smooth or term.key in but for term in model.terms]
    if all(stays):
        return model
    q_dot = np.concatenate([r.motion.q_dot for r in records])
    terms = tuple(
        t if stay else t.regularised(SMOOTHING * _fastest(t, q_dot))
        for t, stay in zip(model.terms, stays, strict=True)
    )
    return replace(model, terms=terms)


def _fastest(term: Term, q_dot: Array) -> float:
    weights = np.array(term.weights) if isinstance(term, Along) else np.ones(1)
    return float(np.abs(q_dot[:, : len(weights)] @ weights).max())


def memory_parts(model: TermSum, records: Sequence[Prepared]) -> tuple[Part, ...]:
    """The forces of a model that remember, from their values there.

    Raises a ValueError if a shape value is so far from what the records can show that no fit finds
    it.
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
