"""The search for what is missing in forced vibrations: effects one after another, then rivals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from joblib import Parallel, delayed
from scipy.stats import chi2

from romsindy.diagnosis.forced.hypothesis import ForcedHypothesis, Trial, driven_instead, weighed
from romsindy.diagnosis.screening import Screened, Screening, part_of, screened
from romsindy.diagnosis.search import Options
from romsindy.diagnosis.tones import strongest_tones
from romsindy.diagnosis.workflow import with_textbook_exponent
from romsindy.effects import look_alikes
from romsindy.effects.base import Effect, ReadingEffect, Scales
from romsindy.effects.drive import Drive
from romsindy.fit.forced.adequacy import ForcedAdequacy, examine_forced
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.part import Part
from romsindy.fit.verdict import EQUIVALENT, ROUNDED
from romsindy.physics.model import ReducedModel

_SURVIVORS = 6  # of each screening are simulated
_SENSOR = 2  # of what may be wrong in the sensor
_FURTHER = 3  # of the best go on where they have not come to their end
_APART = 0.15  # of the frequency of the vibration: so far lines lie from each other


@dataclass(frozen=True)
class ForcedSearch:
    """Looks for effects that a model lacks in records with inputs.

    Attributes
    ----------
    model : ReducedModel
        Its inputs are known.
    records : sequence of ForcedRecord
    scales : Scales
    unsure : tuple of Part
        Values that the simulation is unsure of.
    nuisance : tuple of Part
        What is fitted whatever the hypothesis: offsets, and inputs that the model does not know.
    chain : tuple of Part
        What may stand instead of the inputs of the model.
    options : Options
    trials : list of Trial
        All that were fitted.
    known : dict
        The trials weighed, by their number.
    """

    model: ReducedModel
    records: Sequence[ForcedRecord]
    scales: Scales
    unsure: tuple[Part, ...]
    nuisance: tuple[Part, ...]
    chain: tuple[Part, ...]
    options: Options
    trials: list[Trial] = field(default_factory=list)
    known: dict[int, list[ForcedHypothesis]] = field(default_factory=dict)

    def run(self) -> list[ForcedHypothesis]:
        """All hypotheses, by the noise that the best leaves; the first is the finding.

        Raises
        ------
        ValueError
            If the model has no motion near the measured one.
        """
        exact = self.fitted([()], ())[0]
        if self.unsure:
            self.fitted([()], self.unsure)
        best = self._leader(0) or self._again(exact)
        if not best.solution.finite:
            raise ValueError(
                "the model has no motion near that of the records: check the signs and the units of"
                " its coefficients, and the gain of its input"
            )
        while len(best.effects) < self.options.max_effects and not (
            best.effects and self.remainder(best).explained
        ):
            self._look_beside(best)
            better = self._leader(len(best.effects) + 1)
            best = self._again(best.trial)
            if better is None or not self._worth(best, better):
                break
            best = better
        best = self._pruned(self._instead(self._again(best.trial)))
        plain = self._again(exact)
        best = self.settled(best if self._worth(plain, best) else plain)
        return [best, *(h for h in self._weighed() if h.trial is not best.trial)]

    def _weighed(self) -> list[ForcedHypothesis]:
        """All that were fitted so far, the best first."""
        n = len(self.trials)
        if n not in self.known:
            self.known.clear()
            self.known[n] = weighed(self.trials)
        return self.known[n]

    def remainder(self, hypothesis: ForcedHypothesis) -> ForcedAdequacy:
        """What a hypothesis leaves."""
        s = hypothesis.solution
        return examine_forced(self.records, s.residuals, s.n_values, self.options.false_alarm)

    def fitted(self, several: Sequence[Sequence[Part]], unsure: tuple[Part, ...]) -> list[Trial]:
        """Fit sets of effects, with some of the unsure values free."""
        for parts in several:
            self.options.progress(" + ".join(p.effect.name for p in parts) or "nothing")
        free = (*unsure, *self.nuisance)
        judged = sum(p.tolerance is None for p in unsure)
        tasks = (
            delayed(Trial.of)(self.model, (*free, *parts), judged, len(free), self.records)
            for parts in several
        )
        found = list(Parallel(self.options.n_jobs)(tasks))
        self.trials.extend(found)
        return found

    def _leader(self, n_effects: int) -> ForcedHypothesis | None:
        """The best with so many effects, the first few fitted to their end; None of none."""
        alike = [t for t in self.trials if len(t.solution.parts) - t.n_free == n_effects]
        nearest = sorted(alike, key=lambda t: t.solution.chi_squared)[:_FURTHER]
        for trial in nearest:
            further = trial.further(self.records)
            if further is not trial:
                self.trials.append(further)
        return next((h for h in self._weighed() if len(h.effects) == n_effects), None)

    def _again(self, trial: Trial) -> ForcedHypothesis:
        """By the noise as it is known now."""
        return next(h for h in self._weighed() if h.trial is trial)

    def _instead(self, best: ForcedHypothesis) -> ForcedHypothesis:
        """What says no more and fits better; distinctly better, instead of values that moved."""
        margin = 0.0 if best.forced else EQUIVALENT
        alike = (h for h in self._weighed() if _said(h) <= _said(best))
        other = next(alike)
        return other if other.score + margin < best.score else best

    def _worth(self, before: ForcedHypothesis, after: ForcedHypothesis) -> bool:
        """Whether one says more than chance would, over all that was looked at."""
        if not before.solution.finite:
            return after.solution.finite
        looks = 2 * np.log(max(len(self.options.catalogue), 1))
        more = max(len(after.effects) - len(before.effects), 1)
        gain, price = before.misfit - after.misfit, after.price - before.price
        n_values = sum(p.size for p in after.effects) - sum(p.size for p in before.effects)
        n_values += len(after.moved) - len(before.moved)
        alarm = chi2.isf(self.options.false_alarm * np.exp(-looks / 2 * more), max(n_values, more))
        return bool(gain > alarm and gain > price + more * looks)

    def _look_beside(self, best: ForcedHypothesis) -> None:
        """Fit what the screening leaves beside a hypothesis: unsure values as said, and free."""
        effects = best.effects
        several = ((), self.unsure) if self.unsure else ((),)
        for unsure in several:
            chosen = self._screened(self._start(effects, unsure))
            if not unsure:
                chosen += [part for part in self.chain if not _instead_of(part.effect, effects)]
            self.fitted([(*effects, part) for part in chosen], unsure)

    def _start(self, effects: Sequence[Part], unsure: tuple[Part, ...]) -> Trial:
        """The fit of what was accepted, with these values free."""
        names, n = _named(effects), len(unsure) + len(self.nuisance)
        for trial in reversed(self.trials):
            own = _named(trial.solution.parts[trial.n_free :])
            if own == names and trial.n_free == n and trial.solution.finite:
                return trial
        return self.fitted([effects], unsure)[0]

    def _screened(self, start: Trial) -> list[Part]:
        """The best of all candidates beside a fit, and what resembles the first of them."""
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
        chosen = []
        for candidates, motions, most in (
            (left, measured, _SURVIVORS),
            (sensor, start.solution.motions, _SENSOR),
        ):
            found = screened(model, parts, candidates, self.records, scales, motions)
            chosen += self._leaders(found, most)
        return [part_of(s, scales, len(self.records)) for s in chosen]

    def _leaders(self, found: Screening, most: int) -> list[Screened]:
        """The best of every effect, and what resembles the first; none that gains nothing."""
        needed = chi2.isf(self.options.false_alarm / max(len(self.options.catalogue), 1), 1)
        # How loud the noise is, is not known before something fits: what is left stands for it.
        loud = max(found.base / sum(len(r.signal) for r in self.records), 1.0)
        most_left = found.base - 0.5 * needed * loud
        singles = [s for s in found.singles() if s.chi_squared < most_left]
        if not singles:
            return []
        leaders: dict[str, Screened] = {}
        for s in singles:
            leaders.setdefault(s.effect.name + s.effect.variant, s)
        alike = look_alikes(singles[0].effect.name, self.options.catalogue)
        return [s for i, s in enumerate(leaders.values()) if i < most or s.effect.name in alike]

    def _tones(self, start: Trial) -> tuple[float, ...]:
        """The strongest lines of what a fit leaves, rad/s."""
        if not start.solution.finite:
            return ()
        longest = int(np.argmax([r.t[-1] for r in self.records]))
        record, left = self.records[longest], start.solution.residuals[longest]
        apart = _APART * self.scales.omega
        return tuple(strongest_tones(record.t, left * np.hanning(len(left)), 2, apart))

    def _pruned(self, best: ForcedHypothesis) -> ForcedHypothesis:
        """Without effects that are not needed beside the others."""
        while len(best.effects) > 1:
            unsure = best.parts[: best.n_free - len(self.nuisance)]
            parts = best.effects
            fewer = [(*parts[:i], *parts[i + 1 :]) for i in range(len(parts))]
            made = self.fitted(fewer, unsure)
            best = self._again(best.trial)
            shortest = min(map(self._again, made), key=lambda h: h.score)
            if self._worth(shortest, best):
                break
            best = shortest
        return best

    def settled(self, best: ForcedHypothesis) -> ForcedHypothesis:
        """The finding with the values free that moved, and textbook exponents if they fit."""
        unsure = best.parts[: best.n_free - len(self.nuisance)]
        kept = tuple(p for p in unsure if p.tolerance is not None or p.effect.name in best.moved)
        plain = tuple(with_textbook_exponent(p) for p in best.effects)
        for effects, rise in ((plain, ROUNDED), (best.effects, EQUIVALENT)):
            same = all(p is q for p, q in zip(effects, best.effects, strict=True))
            if len(kept) == len(unsure) and same:
                return best
            again = self._again(self.fitted([effects], kept)[0])
            if again.misfit < self._again(best.trial).misfit + rise:
                return again
        return best


def _said(hypothesis: ForcedHypothesis) -> int:
    """How many effects, and values that moved, it takes."""
    return len(hypothesis.effects) + len(hypothesis.moved)


def _named(effects: Sequence[Part]) -> list[tuple[str, str]]:
    return [(p.effect.name, p.effect.variant) for p in effects]


def _instead_of(effect: Effect, effects: Sequence[Part]) -> bool:
    """Whether an input is changed already."""
    return isinstance(effect, Drive) and any(
        isinstance(p.effect, Drive) and p.effect.of.key == effect.of.key for p in effects
    )
