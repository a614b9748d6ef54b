"""The equation of motion of a hypothesis in one record, of one coordinate or of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from romsindy.fit.any_record import AnyRecord
from romsindy.fit.coefficient import extended
from romsindy.fit.linear_steps import Equation, Linearisation
from romsindy.fit.part import ExtendedEquation, Part
from romsindy.physics.coupled import AnyModel, CoupledModel
from romsindy.physics.coupling import CoupledTerm
from romsindy.typing import Array


def equation_of(model: AnyModel, parts: Sequence[Part], number: int, record: AnyRecord) -> Equation:
    """The equation of a model with its parts in a record, which has this number."""
    if isinstance(model, CoupledModel):
        return CoupledEquation(model, tuple(parts), number)
    step = record.motion.grid.step
    return ExtendedEquation(model, tuple(parts), number, step, record.clock, inputs=record.inputs)


@dataclass(frozen=True)
class CoupledEquation:
    """The model with changed coefficients, in one record: R equations of R coordinates."""

    model: CoupledModel
    parts: tuple[Part, ...]
    record: int

    @cached_property
    def _changed(self) -> CoupledModel:
        return extended(self.model, self.parts)

    def linearise(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Linearisation:
        """Residual (n, R) and its derivatives (n, R, R)."""
        return Linearisation(*self._changed.linearise(q, q_dot, q_ddot))

    def by_parameter(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """Derivatives of the residual by the values that act in the record, (m, n, R)."""
        rows = np.zeros((sum(len(p.columns(self.record)) for p in self.parts), *q.shape))
        first = 0
        for part in self.parts:
            term = part.effect.term()
            if isinstance(term, CoupledTerm):
                rows[first] = term.strong(q, q_dot, q_ddot)
            first += len(part.columns(self.record))
        return rows
