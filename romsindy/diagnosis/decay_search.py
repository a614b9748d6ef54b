"""The search for what is missing in decays: effects one after another, pairs, and their rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from romsindy.diagnosis.evidence import (
    NO_FORM_ERROR,
    FormError,
    Hypothesis,
    Weighed,
    said_elsewhere,
)
from romsindy.diagnosis.search import (
    Finding,
    Screened,
    Screening,
    Search,
    leaders,
    part_of,
    rivals_of,
    screen,
)
from romsindy.effects import look_alikes
from romsindy.effects.memory import MemoryEffect
from romsindy.effects.outside import TONES, Hum
from romsindy.fit.adequacy.verdicts import Adequacy, examine
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Part, Solution
from romsindy.fit.kernel.shooting import shoot, simulated_misfit
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import EQUIVALENT, SCREENED, WORTH
from romsindy.physics.model import ReducedModel

_CHECKS = 6  # iterations, to see what values that did not settle leave
_FURTHER = 40  # of a fit that others are held against


@dataclass(frozen=True)
class ProcessNoise:
    """The motion of a model may depart from the measured one; see `romsindy.fit.process_noise`."""

    known: FormError = NO_FORM_ERROR  # of the model, as its reference record shows it
    # What other modes say of effects: see `Hypothesis.elsewhere`
    elsewhere: Mapping[frozenset[str], float] = field(default_factory=dict)
    # Changes of unsure values that matter: see `Hypothesis.matters`
    matters: Mapping[str, float] = field(default_factory=dict)

    def fitted(
        self,
        model: ReducedModel,
        records: Sequence[Record],
        parts: Sequence[Part],
        n_unsure: int,
        n_free: int,
        motions: Sequence[Trajectory] | None = None,
    ) -> Hypothesis:
        # One thread: the same sums in the same order, however many processes there are.
        with threadpool_limits(limits=1, user_api="blas"):
            solution = fit(model, parts, records, motions)
            if solution.finite and not solution.converged:
                # A motion that does not yet satisfy its equation leaves too little.
                given = (solution.parts, records, solution.motions)
                solution = fit(model, *given, fixed=True, iterations=_CHECKS)
                solution = replace(solution, converged=False)
            found = Hypothesis.of(model, solution, n_free, records)
            found = replace(found, elsewhere=self.elsewhere, matters=self.matters)
            return replace(found, n_unsure=n_unsure)

    def further(
        self, model: ReducedModel, records: Sequence[Record], hypothesis: Hypothesis
    ) -> Hypothesis:
        """Go on with a fit that has not come to its end; the same one where that is no better."""
        s = hypothesis.solution
        if s.converged or not s.finite:
            return hypothesis
        with threadpool_limits(limits=1, user_api="blas"):
            more = fit(model, s.parts, records, s.motions, iterations=_FURTHER)
            return ProcessNoise().ranked([hypothesis, hypothesis.again(model, more, records)])[0]

    def ranked(
        self, hypotheses: Sequence[Hypothesis], among: Sequence[Hypothesis] = ()
    ) -> list[Hypothesis]:
        """Best first, with the form error that is known, or as much more as one of them needs.

        It is the one that is most likely with departures of its own size.
        """
        if not hypotheses:
            return []
        form = min([h.settled(self.known) for h in hypotheses], key=_own_score).noise
        return sorted((h.at(form) for h in hypotheses), key=lambda h: h.score)

    def alike(
        self, before: Hypothesis, after: Hypothesis, among: Sequence[Hypothesis] = ()
    ) -> tuple[Hypothesis, Hypothesis]:
        """Two by the same noise: structure that stays unexplained is as large by chance."""
        after = after.settled(self.known)
        return before.at(after.noise), after

    def examined(
        self, model: ReducedModel, records: Sequence[Record], solution: Solution, false_alarm: float
    ) -> Adequacy:
        return examine(records, solution.residuals, solution.n_values, false_alarm)


def _own_score(hypothesis: Hypothesis) -> float:
    """Score at the form error that it needs itself: what repeats has the power of that."""
    weighed = hypothesis.weighed
    if not isinstance(weighed, Weighed):
        return np.inf
    plain, n = hypothesis.at(FormError(weighed.needed.jump)), weighed.n_functions
    # The other samples hold noise: what repeats cannot have more than the rest of the misfit.
    most = max((plain.misfit - (hypothesis.n_samples - n)) / n, 1.0)
    excess = min(weighed.excess(weighed.needed), most)
    return plain.score - n * (excess - 1 - float(np.log(excess)))


# So many candidates are simulated again after each screening.
_SURVIVORS = 8
_INSTEAD = 2  # of what stands for values that moved, however coarse their shapes in the screening
_PAIRS = 5
_HOPELESS = 30.0  # chi-square over samples
_SIMULATIONS = 20  # to settle values by simulation


@dataclass(eq=False)
class DecaySearch(Search):
    """Looks for effects that a model lacks in decays."""

    model: ReducedModel
    records: Sequence[Record]
    noise: ProcessNoise

    def run(self) -> Finding:
        """Look for the best hypothesis."""
        base = self.settled(self.hypothesis([])).settled(self.noise.known)
        if not base.solution.finite:
            raise ValueError(
                "the model has no motion near that of the records: small disturbances of it grow"
                " without bound; check the signs and the units of its coefficients"
            )
        interrupted = False
        try:
            best, seen = self._best_of(base)
        except KeyboardInterrupt:
            seen, interrupted = [base, *self.compared[1:]], True  # the first is the base
            best = self.ranked(seen)[0]
        interrupted |= self.options.over
        # An effect beside values that moved is no rival of these alone unless it gains something.
        seen = [h for h in seen if not self._gains_nothing(h.at(base.noise), base)]
        if not self.remainder(best).explained:
            best = self._plainest([best, *seen])
            more = [] if interrupted else self._with_hum(best)
            seen += more
            best = next((h for h in more if self.worth(best, h)), best)
        alike = [h for h in seen if len(h.effects) == len(best.effects)]
        best = self.settled(self.ranked([best, *alike])[0])
        best = self.ranked([best, *alike])[0]
        compared = sorted((h.at(best.noise) for h in seen), key=lambda h: h.score)
        return Finding(rivals_of(best, compared), compared, base.at(best.noise), interrupted)

    def _best_of(self, base: Hypothesis) -> tuple[Hypothesis, list[Hypothesis]]:
        """The best hypothesis, and all that were weighed on the way."""
        best, tried = self.grown(base)
        seen = [base, *tried]
        if best.moved or best.beyond:
            seen += self._instead(base)
            beside = best.effects if len(best.effects) < self.options.max_effects else ()
            if beside and (best.material or not best.forced):
                seen += self._instead(best if best.forced else base, beside)
            best = self._other_than_values(best, seen)
        best, tried = self.pruned(best, seen)
        seen += tried
        return best, seen + self._replaced(base, best)

    def _other_than_values(self, best: Hypothesis, seen: Sequence[Hypothesis]) -> Hypothesis:
        """Unsure values alone are blamed unless something else fits distinctly better."""
        blamed = {*best.names} & {*best.moved}
        margin = EQUIVALENT if blamed else 0.0
        most = len(best.effects) + 1
        instead = [h for h in seen if 0 < len(h.effects) <= most and not blamed & {*h.moved}]
        other = self.ranked([best, *instead])[0]
        return other if other.score + margin < best.at(other.noise).score else best

    def settled(self, hypothesis: Hypothesis) -> Hypothesis:
        """One that others are held against, at its least misfit."""
        s = hypothesis.solution
        # Two forces that remember can be followed in short steps only: hours.
        slow = sum(isinstance(p.effect, MemoryEffect) for p in s.parts) > 1
        most = _HOPELESS * hypothesis.n_samples
        if s.converged or slow or not s.chi_squared < most:
            return hypothesis
        given = (self.model, s.parts, self.records, s.motions)
        try:
            first = simulated_misfit(*given)
            if not first @ first < most:  # too far to come near in some simulations
                return hypothesis
            more = shoot(*given, evaluations=_SIMULATIONS)[0]
        except TrajectoryError:
            return hypothesis
        again = hypothesis.again(self.model, more, self.records)
        # A motion that is not settled is judged by its misfit: its score may lie steps away.
        better = again.solution.chi_squared < s.chi_squared
        return again if more.converged or better else hypothesis

    def _gains_nothing(self, hypothesis: Hypothesis, base: Hypothesis) -> bool:
        """Whether it is what explains already, and an effect that gains next to nothing."""
        if not (hypothesis.effects and hypothesis.moved):
            return False
        margin = EQUIVALENT if set(hypothesis.moved) >= set(base.moved) else 0.0
        return hypothesis.score > base.score - margin

    def enough(self, best: Hypothesis) -> bool:
        """Whether what a hypothesis leaves is too small to matter."""
        left = self.remainder(best)
        return left.explained and left.below_floor

    def one_more(self, best: Hypothesis) -> list[Hypothesis]:
        """The survivors of a screening beside a hypothesis; at first two at once, if needed."""
        screening = self._screened(best)
        tried = self._one_more(best, screening)
        if not (tried or best.effects):  # about the fitted motion something may gain all the same
            screening = self._screened(best, fitted=True)
            tried = self._one_more(best, screening)
        if best.effects or not tried or self.remainder(tried[0]).explained:
            return tried
        beside = self._one_more(tried[0], self._screened(tried[0]))
        if not beside or not self.remainder(beside[0]).explained:
            beside += [*self._pairs(screening), *self._beside_hum(screening)]
        return self.ranked([*tried, *beside])

    def _screened(self, best: Hypothesis, fitted: bool = False) -> Screening:
        used = {p.effect.name for p in best.solution.parts}
        left = [e for e in self.options.catalogue if e.name not in used]
        given = (self.model, best.solution.parts, left, self.records)
        # Linearised about the measured motion, where all effects have left their mark.
        screening = screen(*given)
        far = screening.base > best.at(NO_FORM_ERROR).misfit
        if not far or not (best.effects or fitted):
            return screening
        # That is too far from the fitted one, which explains more.
        return screen(*given, best.solution.motions)

    def _instead(self, base: Hypothesis, beside: tuple[Part, ...] = ()) -> list[Hypothesis]:
        """Effects that do what values that moved do, with those at their nominal values.

        Beside a force these are the values that moved by more than matters; others follow the data.
        """
        used = {p.effect.name for p in beside}
        left = [e for e in self.options.catalogue if e.name not in used]
        usual = (p.effect.name for p in self.free if p.tolerance is None)
        names = {*(base.material if base.forced else usual)}
        held = tuple(p for p in self.free if p.effect.name in names)
        free = tuple(p for p in self.free if p.effect.name not in names)
        parts, n_held = (*held, *free, *beside), sum(p.strengths.size for p in held)
        screening = screen(self.model, parts, left, self.records)
        singles = leaders(screening.singles(n_held))
        slack = SCREENED * (screening.left(n_held) - screening.base)
        most = screening.base + max(3 * EQUIVALENT * base.excess, slack)
        near = [s for i, s in enumerate(singles) if i < _INSTEAD or s.chi_squared < most]
        trials = [[*beside, self._part(s, screening)] for s in near[:_SURVIVORS]]
        return self.with_free(free).fitted(trials)

    def _one_more(self, best: Hypothesis, screening: Screening) -> list[Hypothesis]:
        """The survivors of a screening, fitted together with what was accepted, best first."""
        singles = self._heard(screening.singles(), best)
        needed = chi2.isf(self.options.false_alarm / max(len(self.options.catalogue), 1), 1)
        now = min(screening.base, best.at(NO_FORM_ERROR).misfit) + best.misfit_elsewhere
        if not singles or now - singles[0].chi_squared < 0.5 * needed:
            return []
        trials = [[*best.effects, self._part(s, screening)] for s in self._survivors(singles)]
        shown = any(p.effect.family == "measurement" for p in best.effects)  # another motion
        tried = self.ranked(self.fitted(trials, best.solution.motions if shown else None))
        if not tried:
            return []
        tried = self.ranked([*self.further(tried[:3]), *tried[3:]])
        return self.ranked([self.settled(tried[0]), *tried[1:]])

    def _heard(self, singles: Sequence[Screened], best: Hypothesis) -> list[Screened]:
        """Candidates with what other modes say of each beside a hypothesis, best first."""
        known, names = self.noise.elsewhere, frozenset(p.effect.name for p in best.effects)

        def heard(s: Screened) -> Screened:
            more = said_elsewhere(known, names | {s.effect.name})
            return replace(s, chi_squared=s.chi_squared + more)

        return sorted(map(heard, singles), key=lambda s: s.chi_squared)

    def _survivors(self, singles: Sequence[Screened]) -> list[Screened]:
        """The best effects and what resembles them, and a second start for the leaders."""
        best = leaders(singles)
        names = [s.effect.name for s in best[:_SURVIVORS]]
        alike = [look_alikes(name, self.options.catalogue) for name in names[:2]]
        kept = set(names).union(*alike)
        chosen = [s for s in best if s.effect.name in kept]
        again = [s for s in singles if s.effect.name in names[:2] and s not in chosen]
        return chosen + again[:2]

    def _part(self, screened: Screened, screening: Screening) -> Part:
        return part_of(screened, screening.scales, len(self.records))

    def _pairs(self, screening: Screening) -> list[Hypothesis]:
        pairs: dict[frozenset[str], list[Part]] = {}
        for pair in screening.pairs(leaders(screening.singles(), 3)):
            both = [self._part(s, screening) for s in pair]
            pairs.setdefault(frozenset(p.effect.name for p in both), both)
        return self.fitted(list(pairs.values())[:_PAIRS])

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
        parts, motions = best.solution.parts, best.solution.motions
        screening = screen(self.model, parts, left, self.records, motions)
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

    def _plainest(self, seen: Sequence[Hypothesis]) -> Hypothesis:
        """Where nothing closes the gap: as few effects as explain nearly as much.

        Values that other modes refute are no fewer than an effect in their place.
        """

        def left(h: Hypothesis) -> float:
            n = max(len(h.effects), h.misfit_elsewhere > EQUIVALENT)  # if refuted there
            return (h.solution.chi_squared + h.misfit_elsewhere) * float(WORTH**n)

        best = min(seen, key=left)
        return self.ranked([h for h in seen if len(h.effects) == len(best.effects)])[0]

    def with_instead(self, found: Finding) -> Finding:
        """The same finding with what does as well as the values that moved beside its effects."""
        best = found.rivals[0]
        more = [h.at(best.noise) for h in self._instead(best, best.effects)]
        rivals = [*found.rivals, *rivals_of(best, more)[1:]]
        return replace(found, rivals=rivals, compared=[*found.compared, *more])

    def finding(self, best: Hypothesis, found: Finding) -> Finding:
        """The same finding without what was better than another hypothesis, now the best."""
        (best,) = self.ranked([best])
        others = (h.at(best.noise) for h in found.compared)
        worse = sorted((h for h in others if h.score >= best.score), key=lambda h: h.score)
        compared = [best, *worse]
        rivals = rivals_of(best, [h for h in compared if len(h.effects) == len(best.effects)])
        return replace(found, rivals=rivals, compared=compared, base=found.base.at(best.noise))

    def _replaced(self, base: Hypothesis, best: Hypothesis) -> list[Hypothesis]:
        """Where several effects were accepted: siblings of each in its place.

        And those of what is likelier with one of them, until nothing is.
        """
        if len(best.effects) < 2:
            return []
        screening = self._screened(base)
        seen: list[Hypothesis] = []
        tried: list[set[str]] = []
        while True:
            named = [({p.effect.name for p in t}, t) for t in self._siblings(best, screening)]
            new = [(names, t) for names, t in named if names not in tried]
            if not new:
                return seen
            tried += [names for names, _ in new]
            tones = {e.name for e in TONES} - {p.effect.name for p in best.effects}
            seen += self.fitted([t for names, t in new if not names & tones])
            # Where a tone stands for another the motion is what it was.
            toned = [t for names, t in new if names & tones]
            seen += map(self.settled, self.fitted(toned, best.solution.motions))
            best = self.ranked([best, *seen])[0]

    def _siblings(self, best: Hypothesis, screening: Screening) -> list[list[Part]]:
        """The effects of a hypothesis, each once with what it looks like in its place."""
        singles = {s.effect.name: s for s in reversed(screening.singles())}
        used = {p.effect.name for p in best.effects}
        trials = []
        for i, part in enumerate(best.effects):
            for name in sorted(look_alikes(part.effect.name, self.options.catalogue) - used):
                if name in singles:
                    other = self._sibling(part, singles[name], screening)
                    trials.append([*best.effects[:i], other, *best.effects[i + 1 :]])
        return trials

    def _sibling(self, part: Part, other: Screened, screening: Screening) -> Part:
        """One effect in the place of another; a tone in that of a tone, at its frequency.

        Lines that a fit came to need not be among those of the screening.
        """
        if not (isinstance(part.effect, TONES) and isinstance(other.effect, TONES)):
            return self._part(other, screening)
        effect, known = other.effect.forms(screening.scales)[0], screening.scales
        values = {p.name: effect.value(p.name) for p in effect.parameters(known)}
        values["frequency"] = part.effect.value("frequency")
        return Part.of(effect, known, len(self.records), list(values.values()))
