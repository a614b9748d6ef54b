"""The equation of motion of a hypothesis in one record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from romsindy.effects.base import ReadingEffect, SampledInput, State
from romsindy.fit.coefficient import extended
from romsindy.fit.linear_steps import Linearisation
from romsindy.fit.part import Part
from romsindy.fit.record import Prepared
from romsindy.physics.coupled import AnyModel
from romsindy.physics.coupling import CoupledTerm
from romsindy.physics.memory import Memory
from romsindy.typing import Array


def equation_of(
    model: AnyModel, parts: Sequence[Part], number: int, record: Prepared
) -> ExtendedEquation:
    """The equation of a model with its parts in a record, which has this number."""
    step = record.motion.grid.step
    return ExtendedEquation(model, tuple(parts), number, step, record.clock, inputs=record.inputs)


@dataclass(frozen=True)
class ExtendedEquation:
    """The model with its parts, in one record: R equations of R coordinates.

    Inputs among the terms of the model drive it where they were measured. Effects of one coordinate
    pull beside the model; laws of several are within it, where one table serves all terms.
    """

    model: AnyModel
    parts: tuple[Part, ...]
    record: int
    step: float
    clock: float  # at the start of the record, s
    memories: tuple[Memory | None, ...] = ()  # of parts beside the model; none where it begins
    inputs: Mapping[str, SampledInput] | None = None  # that were measured

    @cached_property
    def _beside(self) -> dict[int, Part]:
        """Those that pull beside the model, by number: no sensors, nor laws of its one table."""
        return {
            i: part
            for i, part in enumerate(self.parts)
            if not isinstance(part.effect, ReadingEffect)
            and not isinstance(part.effect.term(), CoupledTerm)
        }

    @cached_property
    def _inside(self) -> AnyModel:
        laws = [p for p in self.parts if isinstance(p.effect.term(), CoupledTerm)]
        return extended(self.model, laws) if laws else self.model

    @cached_property
    def rate(self) -> float:
        """Angular frequency of small vibrations of the first coordinate, rad/s; 1 without any."""
        rest = np.zeros(self.model.n_coordinates)
        _, stiffness, _, mass = self.model.residual_and_slopes(rest, rest, rest)
        squared = float(stiffness[0, 0] / mass[0, 0])
        return float(np.sqrt(squared)) if 0 < squared < np.inf else 1.0

    def state(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> State:
        """What the effects of one coordinate take, (n,) each, from (n, 1) states."""
        motion = (q[:, 0], q_dot[:, 0], q_ddot[:, 0])
        return State(t, *motion, self.step, self.rate, clock=self.clock, inputs=self.inputs)

    def _pulling(self, *motion: Array) -> dict[int, tuple[Part, State]]:
        """Parts beside the model, each with what its effect takes and remembers, by number."""
        if not self._beside:
            return {}
        state, memories = self.state(*motion), self.memories or (None,) * len(self._beside)
        return {
            i: (part, state._replace(memory=m))
            for (i, part), m in zip(self._beside.items(), memories, strict=True)
        }

    def after(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> ExtendedEquation:
        """The equation of the motion that goes on from the end of one at its Gauss points."""
        pulling = self._pulling(t, q, q_dot, q_ddot).values()
        memories = tuple(part.effect.remembered(state) for part, state in pulling)
        return replace(self, memories=memories) if memories else self

    def linearise(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Linearisation:
        """Residual (n, R) and its derivatives (n, R, R)."""
        residual, *slopes = self._inside.residual_and_slopes(q, q_dot, q_ddot)
        residual = residual - self._pushed(t)
        for part, state in self._pulling(t, q, q_dot, q_ddot).values():
            own = part.own(self.record)
            forces = part.effect.forces(state) if np.any(own) else None
            if forces is not None:
                residual = residual + np.tensordot(own, forces, 1).reshape(len(t), -1)
                added = (np.reshape(b, (-1, 1, 1)) for b in part.effect.slopes(state, own))
                slopes = [a + b for a, b in zip(slopes, added, strict=True)]
        return Linearisation(residual, *slopes)

    def _pushed(self, t: Array) -> Array | float:
        """What inputs among the terms of the model add to the right sides."""
        pushed: Array | float = 0.0
        for term, gain in self._inside.pushes:
            if (samples := (self.inputs or {}).get(term.source)) is not None:
                pushed = pushed + np.outer(samples.at(t, term), term.sign * gain)
        return pushed

    def by_parameter(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """Derivatives of the residual by the values that act in the record, (m, n, R)."""
        pulling = self._pulling(t, q, q_dot, q_ddot)
        rows = [np.zeros((0, *q.shape))]
        for i, part in enumerate(self.parts):
            term = part.effect.term()
            if isinstance(term, CoupledTerm):
                rows.append(term.strong(q, q_dot, q_ddot)[None])
            elif i not in pulling or part.effect.forces(state := pulling[i][1]) is None:
                rows.append(np.zeros((len(part.columns(self.record)), *q.shape)))
            else:
                own = part.by_value("forces", (state,), self.record)
                rows.append(own.reshape(len(own), *q.shape))
        return np.concatenate(rows)
