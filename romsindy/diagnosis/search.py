"""The search for what is missing: effects accepted one after another, pairs, and rivals of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from joblib import Parallel, delayed
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from romsindy.diagnosis.evidence import Hypothesis, ranked
from romsindy.diagnosis.form import NO_FORM_ERROR, FormError
from romsindy.diagnosis.screening import Screened, Screening, part_of, screen
from romsindy.diagnosis.tolerance import Tolerance
from romsindy.effects import look_alikes
from romsindy.effects.base import Effect
from romsindy.effects.memory import MemoryEffect
from romsindy.effects.outside import Hum
from romsindy.fit.adequacy import Adequacy, examine
from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.gauss_newton import fit
from romsindy.fit.part import Part
from romsindy.fit.record import Record, scales
from romsindy.fit.shooting import shoot
from romsindy.fit.verdict import EQUIVALENT, SCREENED, WORTH
from romsindy.physics.model import ReducedModel

# So many candidates are simulated again after each screening.
_SURVIVORS = 8
_PAIRS = 5
_INSTEAD = 2  # of what stands for values that moved, however coarse their shapes in the screening
_CHECKS = 6  # iterations, to see what values that did not settle leave
_HOPELESS = 30.0  # chi-square over samples
_SIMULATIONS = 20  # to settle values by simulation


@dataclass(frozen=True)
class Options:
    """How to look for what is missing: see `romsindy.diagnosis.diagnose`."""

    catalogue: tuple[Effect, ...]
    false_alarm: float
    max_effects: int
    floor: float
    n_jobs: int
    progress: Callable[[str], None]
    tolerance: Tolerance = field(default_factory=Tolerance)


@dataclass(frozen=True)
class Finding:
    """What a search found; its lists have the best first."""

    rivals: list[Hypothesis]  # what the data do not tell apart
    compared: list[Hypothesis]  # all that were fitted
    base: Hypothesis  # without any effect
    interrupted: bool = False


@dataclass(frozen=True)
class Search:
    """Looks for effects that a model lacks in some records."""

    model: ReducedModel
    records: Sequence[Record]
    free: tuple[Part, ...]  # always fitted, blamed only if nothing else is
    options: Options
    form: FormError = NO_FORM_ERROR  # of the model, as its reference record shows it
    done: list[Hypothesis] = field(default_factory=list)  # what is left by an interrupt

    def unsure_as(self, hypothesis: Hypothesis) -> Search:
        """The same, unsure of the values that are free in a hypothesis alone."""
        names = {p.effect.name for p in hypothesis.parts[: hypothesis.n_free]}
        return replace(self, free=tuple(p for p in self.free if p.effect.name in names))

    def hypothesis(self, parts: Sequence[Part]) -> Hypothesis:
        """Fit and weigh the unsure values together with some effects."""
        return self.fitted([parts])[0]

    def fitted(self, trials: Sequence[Sequence[Part]]) -> list[Hypothesis]:
        """Fit and weigh several, in parallel."""
        for parts in trials:
            self.options.progress(" + ".join(p.effect.name for p in parts))
        given = (self.model, self.records, len(self.free))
        # Functions of data alone go to other processes: a Search holds what cannot.
        tasks = (delayed(_fitted)(*given, (*self.free, *parts)) for parts in trials)
        fits = Parallel(self.options.n_jobs, return_as="generator")(tasks)
        found = []
        for hypothesis in fits:
            found.append(hypothesis)
            self.done.append(hypothesis)
        return found

    def polished(self, several: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Go on with the fits that have not come to their end."""
        given = (self.model, self.records)
        return list(Parallel(self.options.n_jobs)(delayed(_polished)(*given, h) for h in several))

    def remainder(self, hypothesis: Hypothesis) -> Adequacy:
        """What a hypothesis leaves."""
        s = hypothesis.solution
        return examine(self.records, s.residuals, s.n_values, self.options.false_alarm)

    def run(self) -> Finding:
        """Look for the best hypothesis; an interrupt keeps what was compared.

        Raises
        ------
        ValueError
            If the model alone has no motion near the measured one.
        """
        base = self.settled(self.hypothesis([])).settled(self.form)
        if not base.solution.finite:
            raise ValueError(
                "the model has no motion near that of the records: small disturbances of it grow"
                " without bound; check the signs and the units of its coefficients"
            )
        interrupted = False
        try:
            best, seen = self._best_of(base)
        except KeyboardInterrupt:
            seen, interrupted = [base, *self.done[1:]], True  # the first is the base
            best = self.ranked(seen)[0]
        # An effect beside values that moved is no rival of these alone unless it gains something.
        seen = [h for h in seen if not self._beside(h.at(base.form), base)]
        if not self.remainder(best).explained:
            best = self._plainest([best, *seen])
            more = [] if interrupted else self._with_hum(best)
            seen += more
            best = next((h for h in more if self._worth(best, h)), best)
        alike = [h for h in seen if len(h.effects) == len(best.effects)]
        best = self.settled(self.ranked([best, *alike])[0])
        best = self.ranked([best, *alike])[0]
        compared = sorted((h.at(best.form) for h in seen), key=lambda h: h.score)
        return Finding(self.rivals(best, compared), compared, base.at(best.form), interrupted)

    def _best_of(self, base: Hypothesis) -> tuple[Hypothesis, list[Hypothesis]]:
        """The best hypothesis, and all that were weighed on the way."""
        best, seen = base, [base]
        first: Screening | None = None
        while len(best.effects) < self.options.max_effects and not self._negligible(best):
            screening = self._screened(best)
            first = first or screening
            tried = self._one_more(best, screening)
            if best is base and tried and not self.remainder(tried[0]).explained:
                pairs = [*self._pairs(screening), *self._beside_hum(screening)]
                tried = self.ranked([*tried, *pairs])
            seen += tried
            if not tried or not self._worth(best, tried[0]):
                break
            best = tried[0]
        if best.moved:
            seen += self._instead(base)
            beside = best.effects if len(best.effects) < self.options.max_effects else ()
            if beside and not best.forced:
                seen += self._instead(best, beside)
            # Unsure values alone are blamed unless something else fits distinctly better.
            margin = 0.0 if best.forced else EQUIVALENT
            most = len(best.effects) + 1
            instead = [h for h in seen if 0 < len(h.effects) <= most and not h.moved]
            other = self.ranked([best, *instead])[0]
            if other.score + margin < best.at(other.form).score:
                best = other
        best, tried = self._pruned(best, seen)
        seen += tried
        seen += self._replaced(best, first) if first is not None else []
        return best, seen

    def settled(self, hypothesis: Hypothesis) -> Hypothesis:
        """One that others are held against, at its least misfit."""
        s = hypothesis.solution
        # Two forces that remember can be followed in short steps only: hours.
        slow = sum(isinstance(p.effect, MemoryEffect) for p in s.parts) > 1
        if s.converged or slow or not s.chi_squared < _HOPELESS * hypothesis.n_samples:
            return hypothesis
        try:
            more = shoot(self.model, s.parts, self.records, s.motions, evaluations=_SIMULATIONS)[0]
        except TrajectoryError:
            return hypothesis
        again = Hypothesis.of(self.model, more, hypothesis.n_free, self.records)
        # A motion that is not settled is judged by its misfit: its score may lie steps away.
        better = again.solution.chi_squared < s.chi_squared
        return again if more.converged or better else hypothesis

    def _beside(self, hypothesis: Hypothesis, base: Hypothesis) -> bool:
        """Whether it is what explains already, and an effect that gains next to nothing."""
        if not (hypothesis.effects and hypothesis.moved):
            return False
        margin = EQUIVALENT if set(hypothesis.moved) >= set(base.moved) else 0.0
        return hypothesis.score > base.score - margin

    def _negligible(self, best: Hypothesis) -> bool:
        """Whether what a hypothesis leaves is too small to matter."""
        left = self.remainder(best)
        return left.explained and left.below_floor

    def _screened(self, best: Hypothesis) -> Screening:
        used = {p.effect.name for p in best.solution.parts}
        left = [e for e in self.options.catalogue if e.name not in used]
        # Linearised about the measured motion, where all effects have left their mark.
        return screen(self.model, best.solution.parts, left, self.records, scales(self.records))

    def _instead(self, base: Hypothesis, beside: tuple[Part, ...] = ()) -> list[Hypothesis]:
        """Effects that do what values that moved do, with those at their nominal values."""
        used = {p.effect.name for p in beside}
        left = [e for e in self.options.catalogue if e.name not in used]
        parts = (*self.free, *beside)
        screening = screen(self.model, parts, left, self.records, scales(self.records))
        n_free = sum(p.strengths.size for p in self.free)
        leaders = _leaders(screening.singles(held=n_free), 1)
        slack = SCREENED * (screening.left(held=n_free) - screening.base)
        most = screening.base + max(3 * EQUIVALENT * base.excess, slack)
        near = [s for i, s in enumerate(leaders) if i < _INSTEAD or s.chi_squared < most]
        trials = [[*beside, self._part(s, screening)] for s in near[:_SURVIVORS]]
        known = tuple(p for p in self.free if p.tolerance is not None)
        return replace(self, free=known).fitted(trials)

    def _one_more(self, best: Hypothesis, screening: Screening) -> list[Hypothesis]:
        """The survivors of a screening, fitted together with what was accepted, best first."""
        singles = screening.singles()
        needed = chi2.isf(self.options.false_alarm / max(len(self.options.catalogue), 1), 1)
        now = min(screening.base, best.at(NO_FORM_ERROR).misfit)
        if not singles or now - singles[0].chi_squared < 0.5 * needed:
            return []
        trials = [[*best.effects, self._part(s, screening)] for s in self._survivors(singles)]
        tried = self.ranked(self.fitted(trials))
        tried = self.ranked([*self.polished(tried[:3]), *tried[3:]])
        return self.ranked([self.settled(tried[0]), *tried[1:]])

    def _survivors(self, singles: Sequence[Screened]) -> list[Screened]:
        """The best effects and what resembles them, and a second start for the leaders."""
        leaders = _leaders(singles, 1)
        names = [s.effect.name for s in leaders[:_SURVIVORS]]
        alike = [look_alikes(name, self.options.catalogue) for name in names[:2]]
        kept = set(names).union(*alike)
        chosen = [s for s in leaders if s.effect.name in kept]
        again = [s for s in singles if s.effect.name in names[:2] and s not in chosen]
        return chosen + again[:2]

    def _part(self, screened: Screened, screening: Screening) -> Part:
        return part_of(screened, screening.scales, len(self.records))

    def _pairs(self, screening: Screening) -> list[Hypothesis]:
        chosen = _leaders(screening.singles(), 3)
        trials, names = [], set()
        for a, b in screening.pairs(chosen):
            key = frozenset((a.effect.name, b.effect.name))
            if key not in names:
                names.add(key)
                trials.append([self._part(a, screening), self._part(b, screening)])
            if len(trials) == _PAIRS:
                break
        return self.fitted(trials)

    def _beside_hum(self, screening: Screening) -> list[Hypothesis]:
        """Where the records show lines: hum, and effects that show once it is gone."""
        hums = self._hums(screening)
        if not hums:
            return []
        hum = self.hypothesis([self._part(hums[0], screening)])
        return [hum, *self._one_more(hum, self._screened(hum))]

    def _with_hum(self, best: Hypothesis) -> list[Hypothesis]:
        """The same and hum, where the records show lines; found late, no screening led there."""
        used = {p.effect.name for p in best.solution.parts}
        left = [e for e in self.options.catalogue if isinstance(e, Hum) and e.name not in used]
        if not left or len(best.effects) == self.options.max_effects:
            return []
        known, motions = scales(self.records), best.solution.motions
        screening = screen(self.model, best.solution.parts, left, self.records, known, motions)
        hums = self._hums(screening)[:1]
        return self.fitted([[*best.effects, self._part(s, screening)] for s in hums])

    def _hums(self, screening: Screening) -> list[Screened]:
        """Hum that lines of the records show, what gains most for its price first."""
        lines = np.array([line.frequency for r in self.records for line in r.noise.lines])
        width = 2 / min(float(r.t[-1]) for r in self.records)  # Hz, as in `combs`
        price = float(np.log(sum(r.count for r in self.records)))

        def shown(hum: Hum) -> bool:
            apart = np.abs(lines - hum.frequency / (2 * np.pi))
            return hum.harmonics > 1 or bool(np.any(apart < width))

        hums = [s for s in screening.singles() if isinstance(s.effect, Hum) and shown(s.effect)]
        return sorted(hums, key=lambda s: s.chi_squared + price * s.strengths.size)

    def _worth(self, before: Hypothesis, after: Hypothesis) -> bool:
        """Whether more effects gain more than chance would, over all that was looked at."""
        if after.weighed is None:  # it has no motion
            return False
        more = len(after.effects) - len(before.effects)
        n_looks = max(len(self.options.catalogue), 1) ** more
        # Structure that stays unexplained is as large by chance: the test is one of variances.
        after = after.settled(self.form)
        before = before.at(after.form)
        gain = before.misfit - after.misfit
        n_values = sum(p.size for p in after.effects) - sum(p.size for p in before.effects)
        alarm = chi2.isf(self.options.false_alarm / n_looks, max(n_values, more))
        return bool(gain > alarm and gain > after.price - before.price + 2 * np.log(n_looks))

    def _pruned(
        self, best: Hypothesis, known: list[Hypothesis]
    ) -> tuple[Hypothesis, list[Hypothesis]]:
        """Drop effects that the others have made superfluous."""
        seen: list[Hypothesis] = []
        while len(best.effects) > 1:
            fewer = self.without_one(best, seen + known)
            seen += fewer
            shortest = self.ranked(fewer)[0]
            if self._worth(shortest, best):
                break
            best = shortest
        return best, seen

    def without_one(self, best: Hypothesis, known: Sequence[Hypothesis]) -> list[Hypothesis]:
        """What is left of a hypothesis without one of its effects, for each of them.

        The best of several fits: those that are known started elsewhere.
        """
        parts = best.effects
        fewer = [(*parts[:i], *parts[i + 1 :]) for i in range(len(parts))]
        found = []
        for fitted in self.unsure_as(best).fitted(fewer):
            alike = [h for h in known if _same_effects(h, fitted)]
            found.append(min([fitted, *alike], key=lambda h: h.at(best.form).score))
        return found

    def finding(self, best: Hypothesis, found: Finding) -> Finding:
        """The same finding without what was better than another hypothesis, now the best."""
        (best,) = self.ranked([best])
        others = (h.at(best.form) for h in found.compared)
        worse = sorted((h for h in others if h.score >= best.score), key=lambda h: h.score)
        compared = [best, *worse]
        rivals = self.rivals(best, [h for h in compared if len(h.effects) == len(best.effects)])
        return replace(found, rivals=rivals, compared=compared, base=found.base.at(best.form))

    def _replaced(self, best: Hypothesis, first: Screening) -> list[Hypothesis]:
        """Where several effects were accepted: siblings of each in its place."""
        if len(best.effects) < 2:
            return []
        leaders = {s.effect.name: s for s in reversed(first.singles())}
        used = {p.effect.name for p in best.effects}
        trials = []
        for i, part in enumerate(best.effects):
            for name in sorted(look_alikes(part.effect.name, self.options.catalogue) - used):
                if name in leaders:
                    other = self._part(leaders[name], first)
                    trials.append([*best.effects[:i], other, *best.effects[i + 1 :]])
        return self.fitted(trials)

    def ranked(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Best first, with at least the form error of the model."""
        return ranked(hypotheses, self.form)

    def _plainest(self, seen: Sequence[Hypothesis]) -> Hypothesis:
        """Where nothing closes the gap: as few effects as explain nearly as much."""
        best = min(seen, key=lambda h: h.solution.chi_squared * WORTH ** len(h.effects))
        return self.ranked([h for h in seen if len(h.effects) == len(best.effects)])[0]

    def rivals(self, best: Hypothesis, seen: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Different hypotheses that the data do not tell apart from the best, best first."""
        found = {frozenset(best.names): best}
        # One effect may stand for values that moved.
        instead = not best.effects or (best.changed and not best.forced)
        most = len(best.effects) + bool(instead)
        for h in seen:
            near = h.score - best.score < EQUIVALENT
            more = h.said > best.said
            if near and not more and len(h.effects) <= most and h.names:
                found.setdefault(frozenset(h.names), h)
        return list(found.values()) if best.names else [best]


def _same_effects(a: Hypothesis, b: Hypothesis) -> bool:
    return [p.effect.name for p in a.effects] == [p.effect.name for p in b.effects]


def _fitted(
    model: ReducedModel, records: Sequence[Record], n_free: int, parts: Sequence[Part]
) -> Hypothesis:
    # One thread: the same sums in the same order, however many processes there are.
    with threadpool_limits(limits=1, user_api="blas"):
        solution = fit(model, parts, records)
        if solution.finite and not solution.converged:
            # A motion that does not yet satisfy its equation leaves too little.
            motions = solution.motions
            solution = fit(model, solution.parts, records, motions, fixed=True, iterations=_CHECKS)
            solution = replace(solution, converged=False)
        return Hypothesis.of(model, solution, n_free, records)


def _polished(model: ReducedModel, records: Sequence[Record], hypothesis: Hypothesis) -> Hypothesis:
    s = hypothesis.solution
    if s.converged or not s.finite:
        return hypothesis
    with threadpool_limits(limits=1, user_api="blas"):
        more = fit(model, s.parts, records, s.motions, iterations=40)
        return ranked([hypothesis, Hypothesis.of(model, more, hypothesis.n_free, records)])[0]


def _leaders(singles: Sequence[Screened], each: int) -> list[Screened]:
    """The best few shapes of every effect."""
    found: dict[str, list[Screened]] = {}
    for s in singles:
        if len(found.setdefault(s.effect.name, [])) < each:
            found[s.effect.name].append(s)
    return [s for group in found.values() for s in group]
