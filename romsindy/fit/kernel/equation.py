"""The equation of motion of a hypothesis in one record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from romsindy.effects.base import Effect, ReadingEffect, SampledInput, State, TermEffect
from romsindy.effects.memory import FadingEffect, MemoryEffect
from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.linear_response import inside, nodes, sampled
from romsindy.fit.kernel.linear_steps import Carried, Linearisation, inverse
from romsindy.fit.kernel.part import Coefficient, OnCoordinate, Part, extended
from romsindy.fit.kernel.prepared import ACCELERATION, Prepared
from romsindy.physics.coupling import Along, CoupledTerm
from romsindy.physics.equations import Equations
from romsindy.physics.memory import Memory
from romsindy.typing import Array, Indices

_JUMPED = 1e-9  # of a friction: by so much its mean over a step differs where it jumps


def equation_of(
    model: Equations, parts: Sequence[Part], number: int, record: Prepared
) -> ExtendedEquation:
    """The equation of a model with its parts in a record, which has this number."""
    given = (model, tuple(parts), number, record.motion.grid.step, record.clock)
    return ExtendedEquation(
        *given, inputs=record.inputs, creep=record.creep, held_from=record.held_from
    )


@dataclass(frozen=True)
class ExtendedEquation:
    """The model with its parts, in one record: R equations of R coordinates.

    Inputs among the terms of the model drive it where they were measured. Effects pull beside the
    model, each at one coordinate, inputs at all of them; laws of several are within it, where one
    table serves all terms.
    """

    model: Equations
    parts: tuple[Part, ...]
    record: int
    step: float
    clock: float  # at the start of the record, s
    memories: tuple[Memory | None, ...] = ()  # of parts beside the model; none where it begins
    inputs: Mapping[str, SampledInput] | None = None  # that were measured
    creep: float = 0.0  # velocity below which friction turns round smoothly
    held_from: tuple[float, ...] = ()  # times at which it holds coordinates for good

    @cached_property
    def _beside(self) -> dict[int, Part]:
        """Those that pull beside the model, by number: no sensors, nor laws of its one table.

        Jumps of the model come last: they are averaged over each step, as those of parts are.
        """
        return {
            i: part
            for i, part in enumerate((*self.parts, *_jumps(self.model)))
            if not (isinstance(part.effect, ReadingEffect) or _inner(part.effect))
        }

    @cached_property
    def _inside(self) -> Equations:
        laws = [p for p in self.parts if _inner(p.effect)]
        still = [replace(p, strengths=-p.strengths) for p in _jumps(self.model)]
        return extended(self.model, [*laws, *still]) if laws or still else self.model

    @cached_property
    def rates(self) -> list[float]:
        """Angular frequency of small vibrations of each coordinate, rad/s; 1 without any."""
        rest = np.zeros(self.model.n_coordinates)
        _, stiffness, _, mass = self.model.residual_and_slopes(rest, rest, rest)
        squared = np.diag(stiffness) / np.diag(mass)
        return [float(np.sqrt(x)) if 0 < x < np.inf else 1.0 for x in squared]

    def state(self, effect: Effect, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> State:
        """What an effect on one coordinate takes, (n,) each, from (n, R) states."""
        along = self._direction(effect)
        own, place = [x @ along for x in (q, q_dot, q_ddot)], int(np.argmax(np.abs(along)))
        beside = (self.rates[place], None, self.clock, self.inputs, self.creep)
        alone = self.held_from and np.count_nonzero(along) == 1
        held = t >= self.held_from[place] if alone else None
        return State(t, own[0], own[1], own[2], self.step, *beside, held)

    @cached_property
    def jumping(self) -> tuple[Part, ...]:
        """Friction that jumps: where it creeps it does not."""
        return tuple(
            part
            for part in (() if self.creep else self._beside.values())
            if isinstance(part.effect, TermEffect)
            and part.effect.jumping is not None
            and np.any(part.own(self.record))
        )

    def sampled(self, motion: Trajectory, derivative: int = 0) -> Array:
        """The motion at the wanted times, (n, R): accelerations jump where friction turns round.

        Steps in time average such a force.
        """
        x = sampled(motion, derivative)
        for part in self.jumping if derivative == ACCELERATION else ():
            where, averaged = self._averaged_away(part, motion)
            x[where] += averaged
        return x

    def _averaged_away(self, friction: Part, motion: Trajectory) -> tuple[Indices, Array]:
        """Samples of steps in which a friction jumps, and what these miss of q_ddot, (k, R)."""
        smooth = [p for p in self.parts if isinstance(p.effect, TermEffect)]
        sharp = replace(self, step=0.0, parts=tuple(smooth), memories=())
        grid, at = motion.grid, nodes(motion)
        mean, there = self._pulled(friction, *at), sharp._pulled(friction, *at)
        jumped = np.abs(mean - there).max(axis=1) > _JUMPED * np.abs(there).max()
        where = np.flatnonzero(np.any(jumped.reshape(-1, 3), axis=1)[grid.sample_step])
        if not len(where):
            return where, motion.q[:0]
        still = np.zeros_like(motion.q)
        shown = inside(grid, still, still, mean.reshape(motion.q_ddot.shape), ACCELERATION)
        t = grid.start + grid.step * (grid.sample_step + grid.fraction)
        states = t[where], *(sampled(motion, order)[where] for order in range(3))
        missed = shown[where] - sharp._pulled(friction, *states)
        mass = sharp.linearise(*states).by_q_ddot
        return where, (inverse(mass)[0] @ missed[..., None])[..., 0]

    def _pulled(self, part: Part, *motion: Array) -> Array:
        """The force of a part that is no sensor, (n, R)."""
        forces = self.forces(part.effect, *motion)
        assert forces is not None
        return np.tensordot(part.own(self.record), forces, 1)

    def forces(self, effect: Effect, *motion: Array) -> Array | None:
        """Of an effect of unit strengths in every equation, (k, n, R); None of a sensor."""
        if (law := _inner(effect)) is not None:
            return law.strong(*motion[1:])[None]
        forces = effect.forces(self.state(effect, *motion))
        return None if forces is None else self._everywhere(effect, forces)

    def _everywhere(self, effect: Effect, forces: Array) -> Array:
        """Forces (k, n) on its coordinate, or (k, n, R), in every equation: (k, n, R)."""
        return forces if forces.ndim == 3 else forces[..., None] * self._direction(effect)

    def _direction(self, effect: Effect) -> Array:
        """Along which an effect acts, (R,): 1 for its coordinate, or the weights of its law."""
        unit = np.eye(self.model.n_coordinates)
        if isinstance(effect, TermEffect) and isinstance(law := effect.term(), Along):
            return law.weights @ unit[: len(law.weights)]
        return unit[effect.acts_on]

    def _pulling(self, *motion: Array) -> dict[int, tuple[Part, State]]:
        """Parts beside the model, each with what its effect takes and remembers, by number."""
        if not self._beside:
            return {}
        memories = self.memories or (None,) * len(self._beside)
        return {
            i: (part, self.state(part.effect, *motion)._replace(memory=m))
            for (i, part), m in zip(self._beside.items(), memories, strict=True)
        }

    def is_like(self, other: ExtendedEquation) -> bool:
        """Whether motions of both records follow one equation."""
        alone = all(isinstance(p.effect, TermEffect) for p in self._beside.values())
        driven = self.inputs or other.inputs
        mine, others = ((x.step, x.creep, x.held_from) for x in (self, other))
        return alone and not driven and mine == others

    def after(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> ExtendedEquation:
        """The equation of the motion that goes on from the end of one at its Gauss points."""
        pulling = self._pulling(t, q, q_dot, q_ddot).values()
        memories = tuple(part.effect.remembered(state) for part, state in pulling)
        return replace(self, memories=memories) if memories else self

    def carried(self, *motion: Array) -> Carried | None:
        """What linear forces beside the model remember from one step to the next, less slopes."""
        found = [
            part.effect.carried(state, part.own(self.record))
            for part, state in self._pulling(*motion).values()
            if isinstance(part.effect, FadingEffect)
        ]
        if not found:
            return None
        by_values, by_motion, values_on, motion_on = zip(*found, strict=True)
        beside = np.concatenate(by_values, axis=1), np.concatenate(motion_on, axis=1)
        return Carried(beside[0], sum(by_motion), block_diag(*values_on), beside[1])

    @property
    def slides(self) -> bool:
        """Whether the model remembers what is not linear in the motion so far."""
        return any(self._is_exact(part.effect, False) for part in self._beside.values())

    def _is_exact(self, effect: Effect, carried: bool) -> bool:
        """Not of those that are looked for, but for linear ones: these are found quickly."""
        if isinstance(effect, FadingEffect):
            return carried
        return isinstance(effect, MemoryEffect) and bool(self.model.memories)

    def beyond_slopes(
        self, motion: tuple[Array, ...], q: Array, q_dot: Array, carried: bool = False
    ) -> Array:
        """What small changes (n, 1, m) do to forces that remember, less what slopes say of it."""
        found = np.zeros((q.shape[2], *q.shape[:2]))
        for part, state in self._pulling(*motion).values():
            if not (
                isinstance(effect := part.effect, MemoryEffect) and self._is_exact(effect, carried)
            ):
                continue
            own, d, v = part.own(self.record), q[:, 0], q_dot[:, 0]
            by_q, by_q_dot, _ = effect.slopes(state, own)
            changes = own[0] * effect.changes(state, d, v)
            found[..., 0] += (changes.T - by_q * d.T) - by_q_dot * v.T
        return found

    def linearise(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Linearisation:
        """Residual (n, R) and its derivatives (n, R, R)."""
        residual, *slopes = self._inside.residual_and_slopes(q, q_dot, q_ddot)
        residual = residual - self._pushed(t)
        for part, state in self._pulling(t, q, q_dot, q_ddot).values():
            own = part.own(self.record)
            forces = part.effect.forces(state) if np.any(own) else None
            if forces is not None:
                residual = residual + np.tensordot(own, self._everywhere(part.effect, forces), 1)
                along = self._direction(part.effect)
                both = np.outer(along, along)
                added = (np.reshape(b, (-1, 1, 1)) * both for b in part.effect.slopes(state, own))
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
            if (law := _inner(part.effect)) is not None:
                rows.append(law.strong(q, q_dot, q_ddot)[None])
            elif i not in pulling or part.effect.forces(state := pulling[i][1]) is None:
                rows.append(np.zeros((len(part.columns(self.record)), *q.shape)))
            else:
                by_value = part.by_value("forces", (state,), self.record)
                rows.append(self._everywhere(part.effect, by_value))
        return np.concatenate(rows)


def _jumps(model: Equations) -> list[Part]:
    """What jumps in a model, with its strength there."""
    jumping = [(t, c) for t, c in model.pairs if c and not t.smooth]
    return [Part(Coefficient(t), (), np.full((1, 1), c)) for t, c in jumping]


def _inner(effect: Effect) -> CoupledTerm | None:
    """A smooth law of several coordinates, which stands in the one table of its model."""
    law = None if isinstance(effect, OnCoordinate) else effect.term()
    return law if isinstance(law, CoupledTerm) and law.smooth else None
