"""A model to be fitted, and its free terms as parts; forces that jump are made smooth there."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from romsindy.fit.coefficient import SMOOTHING, free_coefficients
from romsindy.fit.part import Part
from romsindy.fit.record import Prepared
from romsindy.fit.remembering import memory_parts
from romsindy.physics.coupling import Along
from romsindy.physics.term import Term
from romsindy.physics.term_sum import TermSum
from romsindy.typing import Array

Model = TypeVar("Model", bound=TermSum)


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
