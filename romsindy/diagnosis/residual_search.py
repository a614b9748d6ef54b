"""The search for what is missing by what is left: of driven records, and of several coordinates.

Hypotheses by the noises that the best of them leaves.

Where the noise starts in a driven record, or in channels in which several coordinates ring, is not
known beforehand: what the best explanation leaves stands for it, noise of the sensors and forces
that were not measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from romsindy.diagnosis.evidence import Hypothesis, Solved
from romsindy.diagnosis.search import (
    Finding,
    Screened,
    Screening,
    Search,
    leaders,
    part_of,
    rivals_of,
    screened,
    strongest_tones,
    with_textbook_exponent,
)
from romsindy.effects import look_alikes
from romsindy.effects.base import Effect, ReadingEffect, Scales
from romsindy.effects.memory import MemoryEffect
from romsindy.effects.outside import Drive, InputBetweenSamples, InputDelay, InputLag
from romsindy.fit.adequacy.independence import by_value_of, examine_driven, settled
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.hypothesis import NormalEquations
from romsindy.fit.kernel.noises import Noises, NoiseTable, found_noises, usual_noises
from romsindy.fit.kernel.part import Part, Solution, columns_of, limits, moved_parts
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.kernel.shooting import resimulated
from romsindy.fit.verdict import AS_ONE, EQUIVALENT, ROUNDED, WORTH
from romsindy.physics.equations import Equations
from romsindy.typing import Array, Indices

_FAR = 1e100  # nothing that moves
_CHECKS = 8  # iterations, to see what values that did not settle leave
_AGAIN = 40  # of a fit that others are held against
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
        motions: Sequence[Trajectory] | None = None,
    ) -> Hypothesis:
        # Parts that stand instead of inputs take their place.
        given = driven_instead(model, parts)
        n_samples = sum(r.count for r in records)
        with threadpool_limits(limits=1, user_api="blas"):
            iterations = _UNSETTLED if self.unsettled else _SETTLED
            solution = fit(given, parts, records, motions, iterations=iterations)
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
            more = fit(given, s.parts, records, s.motions, iterations=_AGAIN)
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
    return model.with_terms((instead.get(term.key, term), value) for term, value in model.pairs)


_SURVIVORS = 6  # of each screening are simulated
_SENSOR = 2  # of what may be wrong in the sensor
_PAIRS = 3  # where one alone does far less
_FURTHER = 3  # of the best go on where they have not come to their end
_APART = 0.15  # of the frequency of the vibration: so far lines lie from each other


@dataclass(eq=False)
class ResidualSearch(Search):
    """Looks for effects that a model lacks in records with inputs, those of the model known."""

    model: Equations
    noise: NoiseOfBest
    scales: Scales = field(kw_only=True)
    # What may stand instead of the inputs of the model
    chain: tuple[Part, ...] = field(kw_only=True)

    def unsure_as(self, hypothesis: Hypothesis) -> ResidualSearch:
        """The same, with the unsure values of a hypothesis free, from where they are."""
        return replace(self, free=self._unsure(hypothesis))

    def run(self) -> Finding:
        """Look for the best hypothesis."""
        exact = self.with_free(()).hypothesis([])
        if self.free:
            self.hypothesis([])
        best = self._best(0) or self._now(exact)
        if not best.solution.finite:
            raise ValueError(
                "the model has no motion near that of the records: check the signs and the units of"
                " its coefficients, and the gain of its input"
            )
        interrupted = False
        try:
            best = self._now(self.grown(best)[0])
            best = self._now(self.pruned(self._instead(best))[0])
            plain = self._now(exact)
            best = self._settled(best if self.worth(plain, best) else plain)
        except KeyboardInterrupt:
            best, interrupted = self._weighed()[0], True
        interrupted |= self.options.over
        best = self._now(best)
        others = [h for h in self._weighed() if h.solution is not best.solution]
        compared = [best, *others]
        found = rivals_of(best, compared, AS_ONE)
        return Finding(found, compared, self._now(exact), interrupted)

    def enough(self, best: Hypothesis) -> bool:
        """Whether it has effects, and leaves noise."""
        return bool(best.effects) and self.remainder(best).explained

    def one_more(self, best: Hypothesis) -> list[Hypothesis]:
        """What the screening leaves beside a hypothesis: unsure values as said, and free."""
        effects = best.effects
        for unsure in ((), self.free) if self.free else ((),):
            search = replace(self, free=unsure)
            chosen = search._screened(search._start(effects))
            if not unsure:
                other = [p for p in self.chain if not _instead_of(p.effect, effects)]
                chosen += [(part,) for part in other]
            search.fitted([(*effects, *parts) for parts in chosen])
        most = len(effects) + max(map(len, chosen), default=0)
        found = []
        for n in range(len(effects) + 1, most + 1):
            best_of = self._best(n)
            if best_of is None:
                continue
            found.append(best_of)
            # What leaves noise needs no second effect: that would take up the noise itself.
            if n < most and self.enough(best_of):
                break
        return self.ranked(found)

    def _weighed(self) -> list[Hypothesis]:
        """All that were fitted so far, the best first."""
        known = self.ranked(self.compared)
        by_fit = {id(h.solution): h for h in known}
        self.compared[:] = [by_fit[id(h.solution)] for h in self.compared]
        return known

    def _now(self, hypothesis: Hypothesis) -> Hypothesis:
        """By the noise as it is known now."""
        return next(h for h in self._weighed() if h.solution is hypothesis.solution)

    def _unsure(self, hypothesis: Hypothesis) -> tuple[Part, ...]:
        return hypothesis.parts[: hypothesis.n_free - len(self.beside)]

    def _best(self, n_effects: int) -> Hypothesis | None:
        """The best with so many effects, the first few fitted to their end; None of none."""
        alike = [h for h in self.compared if len(h.solution.parts) - h.n_free == n_effects]
        nearest = sorted(alike, key=lambda h: h.solution.chi_squared)[:_FURTHER]
        pairs = zip(self.further(nearest), nearest, strict=True)
        self.compared.extend(h for h, before in pairs if h.solution is not before.solution)
        return next((h for h in self._weighed() if len(h.effects) == n_effects), None)

    def _instead(self, best: Hypothesis) -> Hypothesis:
        """What says no more and fits better; distinctly better, instead of values that moved."""
        margin = 0.0 if best.forced else EQUIVALENT
        other = next(h for h in self._weighed() if _n_said(h) <= _n_said(best))
        return other if other.score + margin < best.score else best

    def _start(self, effects: Sequence[Part]) -> Hypothesis:
        """The fit of what was accepted, with the unsure values free."""
        names, n = _named(effects), len(self.free) + len(self.beside)
        for known in reversed(self.compared):
            own = _named(known.solution.parts[known.n_free :])
            if own == names and known.n_free == n and known.solution.finite:
                return known
        return self.hypothesis(effects)

    def _screened(self, start: Hypothesis) -> list[tuple[Part, ...]]:
        """The best of all candidates beside a fit, and what resembles the first of them.

        Where one does far less than two, a simulation with one alone may go another way than the
        measured motion: the best pairs are there as well.
        """
        parts = start.solution.parts
        effects = parts[start.n_free :]
        used = {p.effect.name for p in effects}
        left = [
            e for e in self.options.catalogue if e.name not in used and not _instead_of(e, effects)
        ]
        scales = self.scales._replace(tones=self._tones(start))
        model = driven_instead(self.model, parts)
        # About the measured motion, where all forces have left their mark; what is wrong in the
        # sensor left it in the measurement, and shows about the motion of the model.
        sensor = [e for e in left if isinstance(e, ReadingEffect)]
        measured = [r.motion for r in self.records]
        chosen: list[tuple[Screened, ...]] = []
        for candidates, motions, most in (
            (left, measured, _SURVIVORS),
            (sensor, start.solution.motions, _SENSOR),
        ):
            found = screened(model, parts, candidates, self.records, scales, motions)
            if not found.system.finite:  # a fit that went astray, beside which nothing is small
                continue
            chosen += [(s,) for s in self._survivors(found, most)]
            forces = [s for s in found.singles() if not isinstance(s.effect, ReadingEffect)]
            pairs = found.pairs(leaders(forces))[:_PAIRS]
            chosen += [p for p in pairs if WORTH * p[0].chi_squared < forces[0].chi_squared]
        return [tuple(part_of(s, scales, len(self.records)) for s in own) for own in chosen]

    def _survivors(self, found: Screening, most: int) -> list[Screened]:
        """The best of every effect, and what resembles the first; none that gains nothing."""
        needed = chi2.isf(self.options.false_alarm / max(len(self.options.catalogue), 1), 1)
        # How loud the noise is, is not known before something fits: what is left stands for it.
        loud = max(found.base / sum(len(r.signal) for r in self.records), 1.0)
        most_left = found.base - 0.5 * needed * loud
        singles = [s for s in found.singles() if s.chi_squared < most_left]
        if not singles:
            return []
        alike = look_alikes(singles[0].effect.name, self.options.catalogue)
        # What a joint remembers of the start is forgotten once it has slipped: one is enough.
        remember = [s for s in singles if isinstance(s.effect, MemoryEffect)]
        worse = {id(s) for s in remember} - {id(s) for s in leaders(remember)}
        best = leaders([s for s in singles if id(s) not in worse], by_variant=True)
        return [s for i, s in enumerate(best) if i < most or s.effect.name in alike]

    def _tones(self, start: Hypothesis) -> tuple[float, ...]:
        """The strongest lines of what a fit leaves, rad/s."""
        if not start.solution.finite:
            return ()
        longest = int(np.argmax([r.t[-1] for r in self.records]))
        record, left = self.records[longest], start.solution.residuals[longest]
        apart = _APART * self.scales.omega
        return tuple(strongest_tones(record.t, left * np.hanning(len(left)), 2, apart))

    def _settled(self, best: Hypothesis) -> Hypothesis:
        """The finding with the values free that moved, and textbook exponents if they fit."""
        unsure = self._unsure(best)
        kept = tuple(p for p in unsure if p.tolerance is not None or p.effect.name in best.moved)
        plain = tuple(with_textbook_exponent(p) for p in best.effects)
        for effects, rise in ((plain, ROUNDED), (best.effects, EQUIVALENT)):
            same = all(p is q for p, q in zip(effects, best.effects, strict=True))
            if len(kept) == len(unsure) and same:
                return best
            again = self._now(self.with_free(kept).hypothesis(effects))
            if again.misfit < self._now(best).misfit + rise:
                return again
        return best


def _n_said(hypothesis: Hypothesis) -> int:
    """How many effects, and values that moved, it takes."""
    return len(hypothesis.effects) + len(hypothesis.moved)


def _named(effects: Sequence[Part]) -> list[tuple[str, str]]:
    return [(p.effect.name, p.effect.variant) for p in effects]


def _instead_of(effect: Effect, effects: Sequence[Part]) -> bool:
    """Whether an input is changed already."""
    return isinstance(effect, Drive) and any(
        isinstance(p.effect, Drive) and p.effect.of.key == effect.of.key for p in effects
    )
