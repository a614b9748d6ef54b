"""Rounds of a diagnosis on a structure that is simulated: a beam, or a user's own simulator.

Evidence is that of an equation of one coordinate. What the structure does beside its equation is
simulated with what was found, and taken off, until the findings stay: they are then fitted to the
structure itself (defect correction).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed

from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError, Hypothesis
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.search import Options, Request
from romsindy.diagnosis.structure import Corrected, calm_from, corrected, key_of
from romsindy.effects.base import Effect
from romsindy.effects.choices import family_of
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay

_ROUNDS = 5
_STARTS = 4  # times that the starts of records are read again
_ELSEWHERE = 0.016  # of the noise: higher modes turn several times as far, so a tenth of the noise
_NEAR = 0.02  # of the gap in the coordinate: so much what is wrong may leave of it
_AS_LITTLE = 50.0  # twice the logarithm of odds
_SETTLED = 3.0  # standard errors: the defect changes by less than a hundredth of such a change

Names = frozenset[str]  # of the effects of an explanation


class Outcome(NamedTuple):
    """What was found, what is on the structure that was simulated, and this.

    Where the structure cannot be simulated with what was found, ``trouble`` says why.
    """

    report: DiagnosisReport
    parts: tuple[Part, ...]
    corrected: list[Corrected]
    trouble: str = ""

    def or_before(self, before: list[Corrected]) -> Outcome:
        """The same, or the structure as it was ``before`` where nothing explains the records."""
        return self._replace(parts=(), corrected=before) if self.report.refused else self


@dataclass(eq=False)
class Rounds:
    """A structure and its equation beside records."""

    structure: Any  # a `SimulatedStructure`
    look: Callable[..., DiagnosisReport]  # at decays of the coordinate: `diagnose_model`
    model: ReducedModel
    records: list[Record]  # of the coordinate
    raw: list[Decay]  # what the sensors measured in each, as fast as they did
    held_out: bool  # whether the last takes no part
    # What follows the data; what is looked for beside effects that it can have
    unsure: Sequence[Effect]
    general: Sequence[Effect]
    options: Options
    # How each record started; None is found
    releases: list[Any]
    form: FormError = NO_FORM_ERROR  # of the structure, as its reference records show it
    # What other modes say of effects, see `Hypothesis`
    elsewhere: dict[Names, float] = field(default_factory=dict)
    # What explanations leave more, once they were simulated, than their equation said
    refuted: dict[Names, float] = field(default_factory=dict)
    # What rounds that took turns had said, of the family of the last: see `EffectFamily`
    doubtful: dict[Names, Hypothesis] = field(default_factory=dict)
    looked: list[DiagnosisReport] = field(default_factory=list)  # all that was said so far
    smooth: list[Record] = field(init=False)  # without what the higher modes add
    calm: list[float] = field(init=False)  # when fast modes have died, s
    clear: list[int] = field(init=False)  # numbers of the records that tell of the coordinate

    def __post_init__(self) -> None:
        self.smooth = list(self.records)
        self.clear = list(range(len(self.records)))
        self.parallel = Parallel(self.options.n_jobs if self.structure.apart else 1)

    @property
    def n_training(self) -> int:
        """Number of records to learn from."""
        return len(self.records) - self.held_out

    def begin(self) -> list[Corrected]:
        """Simulate the structure as it is."""
        found = self.from_measured(())
        sensed = [self.structure.coordinate(c.readings) for c in found]
        self.calm = [calm_from(*pair) for pair in zip(self.records, sensed, strict=True)]
        return found

    def from_measured(self, parts: tuple[Part, ...]) -> list[Corrected]:
        """Simulate with some parts, from starts that nothing simulated before has a say in."""
        self.smooth = list(self.records)
        found = self.simulate(parts)
        for _ in range(_STARTS):
            rows = zip(found, self.records, strict=True)
            if not any([self._depends_on_start(parts, *row) for row in rows]):
                break
            found = self.simulate(parts)  # from starts that are read without the defect
        return found

    def _depends_on_start(self, parts: tuple[Part, ...], found: Corrected, record: Record) -> bool:
        """Whether what was taken off would be another from a start that is read without it.

        Both the structure and its equation start there: the defect follows the start in proportion.
        """
        smooth = Record.of(found.decay, self.options.floor)
        q, q_dot = np.subtract(self.structure.start(self.model, parts, smooth), found.start)
        moved = np.hypot(q, q_dot / smooth.rate) / smooth.amplitude
        defect = np.std(record.signal - found.decay.signal)
        return bool(moved * defect > _ELSEWHERE * record.noise.std)

    def simulate(
        self, parts: Sequence[Part], needed: Sequence[Part] | None = None
    ) -> list[Corrected]:
        """Simulate the structure with what was found, and its equation with what is ``needed``."""
        added = " + ".join(p.effect.name for p in parts) or "nothing more"
        self.options.progress(f"{self.structure.what} with {added}")
        rows = zip(self.records, self.raw, self.releases, self.smooth, strict=True)
        tasks = (
            delayed(corrected)(self.structure, self.model, parts, *row, needed) for row in rows
        )
        found: list[Corrected] = list(self.parallel(tasks))
        self.return_to(found)
        return found

    def run(
        self, effects: Sequence[Effect], before: list[Corrected], parts: tuple[Part, ...] = ()
    ) -> Outcome:
        """Simulate what was found, take the defect off and look again, until nothing changes.

        One effect that closes the gap counts more than several that fit a little better. ``parts``
        are on the structure that was simulated before. Where two explanations take turns, each
        from the structure with the other, both are told. Where values of the same effects do, with
        an exponent that is now the textbook's and now another, it is the textbook's.
        """
        most, found = 1, before
        reports: list[DiagnosisReport] = []
        last: tuple[DiagnosisReport, list[Corrected], tuple[Part, ...]] | None = None
        turns: list[tuple[Names, Names]] = []  # what was found, and what after it
        for _ in range(_ROUNDS + 1):
            report = self._look(self.sought(effects, parts), found, most)
            reports.append(report)
            self.looked.append(report)
            if report.interrupted:
                return Outcome(report, (), before, "the search was stopped")
            if last is not None and self._refutes(report, last[0], parts):
                (_, found, parts), last = last, None
                self.return_to(found)
                continue
            if self._settled(self.in_equation(parts), report):
                if report.verdict != "unknown" or most == self.options.max_effects:
                    return Outcome(self._checked(report), parts, found)
                most, turns = self.options.max_effects, []
                continue
            again = False
            if last is not None:
                turns.append((names_of(last[0].best), names_of(report.best)))
                again = turns[-1][0] != turns[-1][1] and turns[-1] in turns[:-1]
                if len(reports) > 2 and self._rounds_again(*reports[-3:]):
                    return Outcome(self._checked(last[0]), parts, found)
            last = report, found, parts
            told = self.structure.with_effects(self._simulated_of(report).parts)
            parts = self.next_parts(parts, told)
            try:
                found = self.simulate(parts, told)
            except self.structure.failures as error:
                names = names_of(self._simulated_of(report))
                if not names or np.inf in self.refuted.values():
                    return Outcome(report, (), before, str(error))
                self.refuted[names] = np.inf  # no such structure can be: another is asked, once
                (_, found, parts), last = last, None
                self.return_to(found)
            if again:  # what is told last stands on the structure
                break
        turned = {names_of(r.best): r.best for r in reports[-2:]}
        seen = [h for r in reports for h in (r.best, *r.rivals)]
        alike = {names_of(h): h for h in seen if family_of([h.names, report.best.names])}
        self.doubtful = alike | {names: h for names, h in turned.items() if names}
        return Outcome(self._checked(undecided(report, self.doubtful | turned)), parts, found)

    def _checked(self, report: DiagnosisReport) -> DiagnosisReport:
        """A report that names nothing on the structure which this cannot have, and so not refute.

        The likeliest that it can have, by the last look that compared such, is told
        beside it. What came from outside is told beside values that a look found to be enough.
        """
        own = [p for p in report.best.effects if p.effect.structural]
        if own and not self.can_have(own):
            compared = (h for r in reversed(self.looked) for h in r.compared if h.effects)
            beside = (h for h in compared if self.can_have(h.effects))
        elif report.best.effects and not own:
            beside = (r.best for r in reversed(self.looked) if r.verdict == "none")
        else:
            return report
        nearest = next(beside, None)
        return report if nearest is None else undecided(report, {names_of(nearest): nearest})

    def _refutes(
        self, report: DiagnosisReport, last: DiagnosisReport, parts: Sequence[Part]
    ) -> bool:
        """Whether nothing explains a structure with some parts, which had seemed to explain all.

        On the structure they do more than their equation says: what they leave counts from now on.
        """
        names = names_of(self._simulated_of(last))
        on_it = {p.effect.name for p in parts}
        if last.verdict == "unknown" or report.verdict != "unknown" or not names <= on_it:
            return False
        same = (h for h in (report.best, *report.compared) if names_of(h) == names)
        left = next(same, report.best).at(last.best.noise).misfit - last.best.misfit
        if left > EQUIVALENT:
            self.refuted[names] = self.refuted.get(names, 0.0) + left
        return left > EQUIVALENT

    def return_to(self, found: Sequence[Corrected]) -> None:
        """Go on from what was simulated before."""
        self.releases = [c.release for c in found]
        self.smooth = [Record.of(c.decay, self.options.floor) for c in found]

    def sought(self, effects: Sequence[Effect], parts: Sequence[Part]) -> Sequence[Effect]:
        """Effects to look for where some parts are on the structure."""
        return effects

    def in_equation(self, parts: Sequence[Part]) -> Sequence[Part]:
        """What stands in the equation for parts that are on the structure."""
        return parts

    def next_parts(self, parts: Sequence[Part], found: Sequence[Part]) -> tuple[Part, ...]:
        """What is put on the structure next, where ``parts`` are and some were ``found``."""
        return self.structure.with_effects(found)

    def _look(
        self, effects: Sequence[Effect], found: Sequence[Corrected], most: int
    ) -> DiagnosisReport:
        decays = [found[i].decay.between(self.calm[i]) for i in self.clear]
        n_training = sum(i < self.n_training for i in self.clear)
        test = decays[-1] if n_training < len(decays) else None
        chosen = replace(self.options, max_effects=most, catalogue=(*self.general, *effects))
        training = decays[:n_training]
        counts = {n: self.elsewhere.get(n, 0.0) + x for n, x in self.refuted.items()}
        request = Request(training, test, self.unsure, {}, chosen)
        return self.look(self.model, request, self.form, False, {**self.elsewhere, **counts})

    def can_have(self, parts: Sequence[Part]) -> bool:
        """Whether the structure can be simulated with all of these effects."""
        return len(self.structure.with_effects(parts)) == len(parts)

    def _simulated_of(self, report: DiagnosisReport) -> Hypothesis:
        """The best, or the first that is nearly as good and whose effects can all be simulated."""
        there = [h for h in report.rivals if self.can_have(h.effects)]
        return next(iter(there or self.near(report, 1)), report.best)

    def _rounds_again(self, *reports: DiagnosisReport) -> bool:
        """Whether the third says what the first did, and the second the same with fewer values."""
        first, second, third = (self._simulated_of(r) for r in reports)
        free = [
            sum(p.low < p.high for x in h.effects for p in x.parameters) for h in (second, third)
        ]
        alike = names_of(second) == names_of(third)
        return alike and free[0] < free[1] and self._settled(first.parts, reports[2])

    def _settled(self, parts: Sequence[Part], report: DiagnosisReport) -> bool:
        """Whether the effects that were simulated are those found, within some standard errors.

        Values that the simulation was unsure of count as well.
        """
        chosen = self._simulated_of(report)
        errors = np.sqrt(np.diag(chosen.covariance))
        rows = zip(chosen.parts, chosen.solution.slices(), strict=True)
        there = [(p, own) for p, own in rows if self.structure.with_effects([p])]
        after = {key_of(p): (p.values, errors[own]) for p, own in there}
        before = {key_of(p): p.values for p in self.structure.with_effects(parts)}
        if set(before) != set(after):
            return False
        return all(np.all(np.abs(before[k] - x) <= _SETTLED * e) for k, (x, e) in after.items())

    def near(self, report: DiagnosisReport, most: int, instead: float = 0.0) -> list[Hypothesis]:
        """At ``most`` so many explanations that leave next to nothing of the coordinate.

        They are those that the structure can have, and that leave as little of the other modes once
        these were heard. Where values alone are blamed they may be these, and effects that leave
        less than ``instead`` more.
        """
        best = report.best
        gap = report.base.at(best.noise).misfit - best.misfit
        slack = max(_NEAR * gap, 0.0) if best.effects else instead
        blamed = best if instead and not best.effects else None
        without = self.elsewhere.get(frozenset(), 0.0)
        found: dict[Names, Hypothesis] = {}
        for h in (best, *report.rivals, *report.compared):
            as_few = h is blamed or 0 < len(h.effects) <= max(len(best.effects), blamed is not None)
            heard = self.elsewhere.get(names_of(h), 0.0) < _AS_LITTLE + _NEAR * without
            if h.score <= best.score + slack and as_few and self.can_have(h.effects) and heard:
                found.setdefault(names_of(h), h)
        for names, h in self.doubtful.items():
            found.setdefault(names, h)
        return list(found.values())[:most]

    def likeliest(self, asked: Sequence[Hypothesis], misfits: Mapping[Names, float]) -> Hypothesis:
        """The best of explanations, with their misfits in other modes, which count from now on."""
        least = min(misfits.values())
        self.elsewhere = {names: x - least for names, x in misfits.items()}
        refused = {n for n, x in self.elsewhere.items() if x > EQUIVALENT}
        self.doubtful = {n: h for n, h in self.doubtful.items() if n not in refused}
        return min((replace(h, elsewhere=self.elsewhere) for h in asked), key=lambda h: h.score)


def undecided(report: DiagnosisReport, doubtful: Mapping[Names, Hypothesis]) -> DiagnosisReport:
    """A report with explanations that it would not have named, had it begun with them."""
    told = {names_of(h) for h in (report.best, *report.rivals)}
    others = [h for names, h in doubtful.items() if names not in told]
    if report.verdict not in ("named", "ambiguous") or not others:
        return report
    return replace(report, verdict="ambiguous", rivals=(*report.rivals, *others))


def names_of(h: Hypothesis) -> Names:
    """What it says beside unsure values."""
    return frozenset(p.effect.name for p in h.effects)
