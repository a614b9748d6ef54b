"""Forces that jump, made smooth at the speeds of the records that they are fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from romsindy.fit.any_record import AnyRecord
from romsindy.physics.coupling import Along
from romsindy.physics.term import Term
from romsindy.physics.term_sum import TermSum
from romsindy.typing import Array

Model = TypeVar("Model", bound=TermSum)

# Dry friction is smoothed over this part of the largest velocity, see `Term.regularised`: more, and
# quiet motions see less friction than there is; less, and the steps in time miss where it jumps.
_SMOOTHING = 0.003


def smoothed(model: Model, records: Sequence[AnyRecord]) -> Model:
    """Model whose dry friction is smooth at the speeds of the records, each in its direction."""
    if all(term.smooth for term in model.terms):
        return model
    q_dot = np.concatenate([r.motion.q_dot for r in records])
    terms = (t if t.smooth else t.regularised(_SMOOTHING * _fastest(t, q_dot)) for t in model.terms)
    return replace(model, terms=tuple(terms))


def _fastest(term: Term, q_dot: Array) -> float:
    weights = np.array(term.weights) if isinstance(term, Along) else np.ones(1)
    return float(np.abs(q_dot[:, : len(weights)] @ weights).max())
