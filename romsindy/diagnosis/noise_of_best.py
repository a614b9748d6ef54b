"""Hypotheses by the noises that the best of them leaves.

Where the noise starts in a driven record, or in channels in which several coordinates ring, is not
known beforehand: what the best explanation leaves stands for it, noise of the sensors and forces
that were not measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.diagnosis.evidence import Hypothesis, Solved
from romsindy.effects.drive import InputBetweenSamples, InputDelay, InputLag
from romsindy.fit.adequacy.independence import by_value_of, examine_driven, settled
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.noises import Noises, NoiseTable, found_noises, usual_noises
from romsindy.fit.kernel.normal_equations import NormalEquations
from romsindy.fit.kernel.part import Part, Solution, columns_of, limits, moved_parts
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.kernel.shooting import resimulated
from romsindy.physics.equations import Equations
from romsindy.typing import Array, Indices

_FAR = 1e100  # nothing that moves
_CHECKS = 8  # iterations, to see what values that did not settle leave
_FURTHER = 40  # of a fit that others are held against
# Of a first fit; where friction stops a coordinate, many are short.
_SETTLED, _UNSETTLED = 16, 60


@dataclass(frozen=True, eq=False)
class ByNoises:
    """What a fit says of its values by noises of the sensors, and forces that were not measured.

    ``tables`` are derivatives of the reading of each record by the values of the ``parts``, and its
    misfit, at the ``places`` of the values; states at the start are those that the forces allow.
    """

    parts: tuple[Part, ...]
    places: tuple[Indices, ...]
    tables: tuple[NoiseTable, ...]

    @classmethod
    def of(cls, model: Equations, solution: Solution, records: Sequence[Prepared]) -> ByNoises:
        """Linearise a fit about its motion.

        Of driven records about that which forces move, where values go further than it can tell:
        the squares that a fit left least are another's where forces shift a jump of the response.
        """
        found = cls._about(model, solution, records)
        if not (found.finite and all(r.driven for r in records)):
            return found
        usual = tuple(usual_noises(t.noises, t.left) for t in found.tables)
        if found._within(found._step(usual)[1]) < 1:
            moved = settled(model, solution, records, dict(enumerate(found.needed)))
            return found if moved is None else cls._about(model, moved, records)
        return found

    @classmethod
    def _about(cls, model: Equations, solution: Solution, records: Sequence[Prepared]) -> ByNoises:
        places = tuple(columns_of(solution.parts, i) for i in range(len(records)))
        return cls(solution.parts, places, tuple(by_value_of(model, solution, records)))

    @property
    def finite(self) -> bool:
        """Whether the motions, and squares of what moves them, stay within reach of numbers."""
        return all(bool(np.abs(y).max() < _FAR) for t in self.tables for y in t.channels)

    @cached_property
    def needed(self) -> tuple[Noises, ...]:
        """The noises in what it leaves itself."""
        return tuple(found_noises(t.noises, t.left) for t in self.tables)

    def excess(self, noise: tuple[Noises, ...]) -> float:
        """None: what is left is noise by its own sizes."""
        return 1.0

    def solved(self, solution: Solution, noise: tuple[Noises, ...]) -> Solved:
        """The fit by these noises, its own where none are given."""
        system, step = self._step(noise or self.needed)
        step = step * self._within(step)
        moved = moved_parts(self.parts, step)
        return Solved(system, system.chi_squared(step), moved, system.covariance(), self.parts)

    def _step(self, noise: tuple[Noises, ...]) -> tuple[NormalEquations, Array]:
        """Normal equations by these noises, and the step that they ask for."""
        n_values = sum(p.size for p in self.parts)
        system = NormalEquations(n_values, 0)
        for where, table, own in zip(self.places, self.tables, noise, strict=True):
            system.add_products(where, table.weighed(own).products)
        system.add_priors(self.parts)
        return system, system.bounded_step(np.zeros(n_values, bool), *limits(self.parts))

    def _within(self, step: Array) -> float:
        """Of a step, as far as it moves the simulation by no more than what is left of the records.

        A linear problem does not know what lies beyond.
        """
        left = sum(float(t.left @ t.left) for t in self.tables)
        pairs = zip(self.tables, self.places, strict=True)
        moved = sum(float(np.sum((t.fitted @ step[where]) ** 2)) for t, where in pairs)
        return float(min(1.0, np.sqrt(left / max(moved, 1e-300))))


@dataclass(frozen=True)
class NoiseOfBest:
    """All by the noise that the one leaves that fits best, of all that were fitted so far."""

    # What says whether a solution leaves noise: of driven records, or of decays
    examine: Callable[..., Adequacy] = examine_driven
    # Whether a fit that has not come to its end counts for what it reached: where one of several
    # coordinates stops while others go on, friction lets none settle
    unsettled: bool = False

    def fitted(
        self,
        model: Equations,
        records: Sequence[Prepared],
        parts: Sequence[Part],
        n_unsure: int,
        n_free: int,
    ) -> Hypothesis:
        # Parts that stand instead of inputs take their place.
        given = driven_instead(model, parts)
        n_samples = sum(r.count for r in records)
        with threadpool_limits(limits=1, user_api="blas"):
            iterations = _UNSETTLED if self.unsettled else _SETTLED
            solution = fit(given, parts, records, iterations=iterations)
            empty = Hypothesis(solution, n_free, n_samples, None, noise=(), n_unsure=n_unsure)
            return self._weighed(given, records, empty)

    def further(
        self, model: Equations, records: Sequence[Prepared], hypothesis: Hypothesis
    ) -> Hypothesis:
        s = hypothesis.solution
        if s.converged or not s.finite:
            return hypothesis
        given = driven_instead(model, s.parts)
        with threadpool_limits(limits=1, user_api="blas"):
            more = fit(given, s.parts, records, s.motions, iterations=_FURTHER)
            return self._weighed(given, records, replace(hypothesis, solution=more))

    def ranked(
        self, hypotheses: Sequence[Hypothesis], among: Sequence[Hypothesis]
    ) -> list[Hypothesis]:
        noise, plain = _noise_of(among), among[0].solution
        most = plain.chi_squared if among[0].weighed is not None else np.inf
        weighed = (h.at(noise) for h in hypotheses)
        # What leaves more than the first, without any effect, went astray and says nothing.
        return sorted(weighed, key=lambda h: (h.solution.chi_squared > most, h.score))

    def alike(
        self, before: Hypothesis, after: Hypothesis, among: Sequence[Hypothesis]
    ) -> tuple[Hypothesis, Hypothesis]:
        noise = _noise_of(among)
        return before.at(noise), after.at(noise)

    def examined(
        self, model: Any, records: Sequence[Any], solution: Solution, false_alarm: float
    ) -> Adequacy:
        given = driven_instead(model, solution.parts)
        return self.examine(given, solution, records, false_alarm)

    def _weighed(
        self, model: Equations, records: Sequence[Prepared], hypothesis: Hypothesis
    ) -> Hypothesis:
        """The same with what its fit says; nothing where no motion satisfies its equation."""
        s = hypothesis.solution
        ended = s.converged
        if s.finite and not ended:
            # A motion that does not yet satisfy its equation leaves too little.
            s = fit(model, s.parts, records, s.motions, fixed=True, iterations=_CHECKS)
            if s.finite and not (s.converged or self.unsettled):
                with suppress(TrajectoryError):  # then nothing is said of it
                    s = resimulated(model, s, records)
        there = s.converged or (self.unsettled and s.finite)
        weighed = ByNoises.of(model, s, records) if there else None
        told = weighed if weighed is not None and weighed.finite else None
        return replace(hypothesis, solution=replace(s, converged=ended), weighed=told)


def _noise_of(hypotheses: Sequence[Hypothesis]) -> tuple[Any, ...]:
    """What the one that fits best leaves of the records."""
    followed = [h for h in hypotheses if h.weighed is not None]
    if not followed:
        return ()
    nearest = min(followed, key=lambda h: h.solution.chi_squared).weighed
    return nearest.needed if nearest is not None else ()


def driven_instead(model: Equations, parts: Sequence[Part]) -> Equations:
    """The model without the inputs that parts stand instead of, and with those that are others."""
    others = (InputDelay, InputLag, InputBetweenSamples)
    instead = {
        e.of.key: replace(e.of, delay=e.delay) if isinstance(e, InputBetweenSamples) else None
        for e in (p.effect for p in parts)
        if isinstance(e, others)
    }
    pairs = zip(model.terms, model.values, strict=True)
    changed = ((instead.get(term.key, term), value) for term, value in pairs)
    kept = {term: value for term, value in changed if term is not None}
    return replace(model, terms=tuple(kept), values=tuple(kept.values()))
