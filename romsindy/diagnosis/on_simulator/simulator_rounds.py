"""Rounds of a diagnosis on a user's own simulator: values that it needs, and all its sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from romsindy.diagnosis.all_sensors import (
    GAINS,
    UNEXPLAINED,
    FirstMode,
    Readings,
    beside_known,
    by_gains,
    chi_squared,
    detuned,
    followed,
    noise_of,
    refuted_by,
    samples_beside,
    tells,
    with_errors,
    without,
)
from romsindy.diagnosis.evidence import Amended, Hypothesis, Solved
from romsindy.diagnosis.on_simulator.candidates import (
    CandidateSearch,
    PlaceOnStructure,
    PlaceSearch,
    matters,
)
from romsindy.diagnosis.on_simulator.seen import (
    Beginning,
    Failure,
    OnSimulator,
    ValueEffect,
    moved_together,
)
from romsindy.diagnosis.on_simulator.sensor_fit import FittedSimulator, Now, SensorFit
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.rounds import Names, Outcome, Rounds, names_of
from romsindy.diagnosis.search import strongest_tones
from romsindy.diagnosis.structure import (
    AskedMotion,
    Corrected,
    as_measured,
    key_of,
    sensor_errors,
    with_signal,
)
from romsindy.effects.base import Effect
from romsindy.effects.outside import TONES
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Part, prior_cost
from romsindy.fit.records.record import Record, scales
from romsindy.fit.verdict import EQUIVALENT, NAMED_ABOVE
from romsindy.record.noise import Noise
from romsindy.record.spectrum import noise_std
from romsindy.simulator.simulator import whole
from romsindy.typing import Array

_CLOSE, _POLISHED = 1.05, 3  # own error over the noise that is good enough; rounds towards it
_NO_LESS = 0.98  # of an error: what leaves as much is no nearer
_ASTRAY = 2.0  # the same that a mode leaves which has lost step, at least
_LISTENED = 3  # times that all sensors are heard, each with the best so far in the simulator
_RIGHTED = 2  # times that a simulator is made exact at the values that were found
_MOST = 6  # explanations that they are heard of: the best, and others that are simulated
_INSTEAD = 50.0  # of chi-square in the coordinate: by less it hardly tells values from effects
# Times that a strength changes at the most, from one round to the next, and logarithm from which on
# that tells what the next must be
_TIMES, _CHANGED = 5.0, 0.01
_RINGS = 0.05  # of another mode: how well a release is known, a standard deviation
# Tones of other modes: how many, how far apart (of the slow one), and how loud (of the noise)
_TONES, _APART, _AUDIBLE = 12, 0.15, 0.1
_HARMONICS = 3  # of the slow mode, which the form of the equation leaves
_HALF = 0.5  # of what no explanation explains of whole records, of which the first mode is most


@dataclass(eq=False)
class SimulatorRounds(Rounds):
    """A simulator and its equation beside records.

    The equation follows what the simulator does with its own values of what was added: a strong
    effect bends the structure otherwise than its slow mode, and the equation needs another one for
    the same motion. What is measured is compared with that, and the simulator is changed by the
    difference (indirect inference, [1]).

    [1] C. Gourieroux, A. Monfort, E. Renault, Indirect inference, J. Appl. Econometrics 8 (1993).
    """

    structure: OnSimulator
    own: tuple[Part, ...] = ()  # in the equation, for what is in the simulator
    # What was in the simulator before, and in its equation for that
    known: Mapping[tuple[str, str], tuple[Part, Part]] = field(default_factory=dict)
    # Of the values in the simulator, by all sensors, where it was brought nearer to the records
    variances: Mapping[tuple[str, str], Array] = field(default_factory=dict)
    # What was told where all that may be missing was compared with it
    compared: list[Names] = field(default_factory=list)
    decided: bool = False  # whether something else left less of all sensors, and stands
    there: bool = False  # whether the last step towards the records was within its errors
    place: PlaceOnStructure | None = None  # of what acts at a point, once it was looked for

    def begin(self) -> list[Corrected]:
        """Simulate it as it is; what rings there, and its modes, are no tones of something else.

        It rings at another frequency than measured by as much as its other modes are off, which
        leaves tones. And what a sensor may add, several would have to add alike.
        """
        found = super().begin()
        alike = (len(self.structure.shape) - 1) * EQUIVALENT
        sensed = [e for e in self.general if e.family == "measurement"]
        self.refuted = {frozenset({e.name}): alike for e in sensed if alike}
        rows = zip(self.records, found, strict=True)
        rung = (tone for record, c in rows for tone in _rung(record, c))
        tones = (*rung, *self.structure.simulator.mode_frequencies)
        self.general = [
            replace(e, beside=tones) if isinstance(e, TONES) else e for e in self.general
        ]
        return found

    def simulate(
        self, parts: Sequence[Part], needed: Sequence[Part] | None = None
    ) -> list[Corrected]:
        """Simulate with what was found, and let the equation follow.

        How records begin is looked at anew, unless the same effects were there before.
        """
        if [key_of(p) for p in parts] != [key_of(p) for p in self.own]:
            self.releases = [None] * len(self.records)
        found = super().simulate(parts, needed)
        seen = [
            as_measured(r, self.structure.coordinate(c.readings))
            for r, c in zip(self.records, found, strict=True)
        ]
        # Values that do the same to the equation are those of the simulator, not the likelier ones.
        pairs = zip(parts, parts if needed is None else needed, strict=True)
        there = [
            x if p.tolerance is None else replace(x, near=float(p.values[0])) for p, x in pairs
        ]
        followed = fit(self.model, there, seen, iterations=30)
        if not followed.finite:
            raise TrajectoryError("no motion of its equation follows it")
        self.own = followed.parts
        left = followed.residuals
        return [
            c._replace(decay=with_signal(c.decay, r.signal - beside))
            for r, c, beside in zip(self.records, found, left, strict=True)
        ]

    def with_values_of_simulator(self, outcome: Outcome) -> DiagnosisReport:
        """Its report with the values that its best has in the simulator.

        Where all sensors decided what explains the records they say how sure it is, too.
        """
        report, parts = outcome.report, outcome.parts
        found = {key_of(p): p.values for p in report.best.parts}
        more = {key_of(p): p.values - found[key_of(p)] for p in parts if key_of(p) in found}
        asked = set(self.variances) == {key_of(p) for p in parts}
        # What is left beside noise is not known to be without a say in the values.
        left = max(self.own_error(outcome.corrected), 1.0) ** 2 if asked else 1.0
        variances = {key: x * left for key, x in self.variances.items()}
        sole = asked and self.decided
        weighed = InSimulator(report.best.weighed, more, variances, asked, sole)
        best = replace(report.best, weighed=weighed)
        rivals = tuple(best if h is report.best else h for h in report.rivals)
        sole &= len(rivals) == 1 and not best.pliable
        sure = sole and best.sureness >= NAMED_ABOVE
        verdict = "named" if sure and report.verdict == "ambiguous" else report.verdict
        return replace(report, best=best, rivals=rivals, verdict=verdict) if more else report

    def in_equation(self, parts: Sequence[Part]) -> Sequence[Part]:
        return self.own

    def run(
        self, effects: Sequence[Effect], before: list[Corrected], parts: tuple[Part, ...] = ()
    ) -> Outcome:
        """As every structure; then the simulator itself comes as near to the records as it can.

        What several sensors can refute is heard by them first. Once these decided, the coordinate
        has no say in what is in the simulator.
        """
        if self.decided:
            return self._brought_nearer(Outcome(self._look((), before, 1), parts, before))
        best = super().run(effects, before, parts)
        refutable = len(self.structure.shape) > 1 and best.report.best.names
        return best if refutable else self._brought_nearer(best)

    def _brought_nearer(self, best: Outcome) -> Outcome:
        """The same, with the simulator as near to the records as it comes, if it stays the same."""
        if best.trouble or not best.parts or self.options.over:
            return best
        kept = self.own, self.variances
        nearer = self._polished(best)
        if nearer is best:
            return best
        report = self._look((), nearer.corrected, len(best.report.best.effects))
        if report.best.names == best.report.best.names:
            return nearer._replace(report=report)
        self.own, self.variances = kept
        self.return_to(best.corrected)
        return best

    def _polished(self, best: Outcome) -> Outcome:
        """The same, but for its report, with the simulator as near to the records as it comes."""
        best = self._changed(best, self._nearer)
        if self.there and self.own_error(best.corrected) < _ASTRAY:
            return best
        grown = self._changed(best, self._grown, 1)
        return best if grown is best else self._changed(grown, self._nearer)

    def _changed(
        self, best: Outcome, change: Callable[[Outcome], FittedSimulator], times: int = _POLISHED
    ) -> Outcome:
        """The same, as long as a change of what is in the simulator brings it nearer."""
        error = self.own_error(best.corrected)
        valued = any(isinstance(p.effect, ValueEffect) for p in best.parts)
        for _ in range(times):
            if error <= _CLOSE and (self.there or not valued):
                break
            self.options.progress(f"{self.structure.what} nearer to the records")
            try:
                fitted = change(best)
                self.releases = fitted.releases
                self.variances, self.there = fitted.step.variances, fitted.step.there
                found = self.simulate(fitted.parts)
            except self.structure.failures:  # what was found stands, and so does its error
                break
            last, error = error, self.own_error(found)
            if error >= last:
                break
            best = best._replace(parts=fitted.parts, corrected=found)
        return best

    def over_all_sensors(self, found: Outcome) -> Outcome:
        """What is found once all sensors, and the modes that ring, have their say.

        What leaves more of them than noise is compared with all that may be missing: what is told
        once it was heard, for its place may be another.
        """
        if len(self.structure.shape) == 1:
            return found
        told = found.report.best
        if not (told.names and self.can_have(told.effects)):
            found = self._with_one_more(found)
        found = self._heard_out(found)
        again = self._with_one_more(found)
        return found if again is found else self._heard_out(again)

    def _heard_out(self, found: Outcome) -> Outcome:
        """What is found once all sensors are heard of explanations of the coordinate.

        The simulator is simulated with the likeliest explanation, and looked at again, until that
        is what is found, or what is found comes no nearer.
        """
        near = False
        for _ in range(_LISTENED):
            if self.options.over:
                return found._replace(report=replace(found.report, interrupted=True))
            before, kept = self.structure, (self.place, self.own, self.variances)
            try:
                again = self._once_heard(found)
            except self.structure.failures:  # what was found stands
                again = None
            if again is None or again.trouble or self._no_nearer(again, found, near):
                anywhere = None if self.place is None or self.place.told else self.place
                self.structure, (self.place, self.own, self.variances) = before, kept
                if self.place is None and anywhere is not None:  # the box that was found stands
                    point = before.at_point
                    self.place = replace(anywhere, point=point, at=before.points[point])
                self.return_to(found.corrected)
                return found if near else self._brought_nearer(found)
            if again.parts is found.parts and self.structure is before:
                return again
            found, near = again, True
        return found

    def _no_nearer(self, again: Outcome, found: Outcome, near: bool) -> bool:
        """Whether what stays the same leaves more of the sensors, or once near nearly as much."""
        if again.report.best.names != found.report.best.names:
            return self.decided  # then they would not have it
        part = _NO_LESS if near else 1.0
        return self.own_error(again.corrected) > part * self.own_error(found.corrected)

    def _once_heard(self, found: Outcome) -> Outcome:
        """What is found once all sensors had their say, and near to the records."""
        report, before = found.report, self.structure
        asked = self.near(report, _MOST, _INSTEAD)
        said = bool(report.best.names) and report.verdict != "none"
        if found.trouble or not said or len(asked) < (1 if before.points else 2):
            return self._brought_nearer(found)
        best = self.likeliest(asked, self._heard(asked, found))
        if best.names != report.best.names or self.structure is not before:
            stays = self.decided and best.names == report.best.names  # elsewhere
            parts = found.parts if stays else self.next_parts(found.parts, best.parts)
            return self._brought_nearer(self.run((), self.from_measured(parts), parts))
        look = self._look((), found.corrected, len(report.best.effects))
        if look.best.names == best.names:
            return self._brought_nearer(found._replace(report=look))
        return self._brought_nearer(self.run((), found.corrected, found.parts))

    def right(self, found: Outcome) -> Outcome:
        """The same by a simulator that is exact at the values that were found, where it can be."""
        for _ in range(_RIGHTED):
            before, most = self.structure, len(found.report.best.effects)
            valued = any(isinstance(p.effect, ValueEffect) for p in found.parts)
            if found.trouble or not valued or self.options.over:
                break
            right = before.simulator.right_at(before.values_with(found.parts))
            if right is None:
                break
            self.options.progress(f"{before.what} at the values that were found")
            kept = self.own, self.variances
            self.structure, self.there = replace(before, simulator=right), False
            try:
                again = self._polished(found._replace(corrected=self.simulate(found.parts)))
                report = self._look((), again.corrected, most)
            except self.structure.failures:
                report = found.report
            right.computed[:0] = before.simulator.computed
            if report is found.report or report.best.names != found.report.best.names:
                self.structure, (self.own, self.variances) = before, kept
                self.return_to(found.corrected)
                break
            found = again._replace(report=report)
        return found

    def _with_one_more(self, found: Outcome) -> Outcome:
        """What is found where the simulator leaves more than noise of all sensors.

        Each effect that may act somewhere, and each value without a tolerance, is compared beside
        values within theirs: the first mode may not have asked for it.
        """
        told, before = found.report.best, (self.structure, self.own, self.variances, self.place)
        said = self.elsewhere, self.decided, self.general
        there = bool(told.names) and self.can_have(told.effects)
        enough = self.own_error(found.corrected) <= (_ASTRAY if there else _CLOSE)
        if found.trouble or self.options.over or enough or names_of(told) in self.compared:
            return found
        self.compared.append(names_of(told))
        try:
            again = self._compared(found, there)
        except self.structure.failures:  # what was found stands
            again = found
        if again is found or again.trouble:
            self.structure, self.own, self.variances, self.place = before
            self.elsewhere, self.decided, self.general = said
            self.return_to(found.corrected)
            return found
        return again

    def _compared(self, found: Outcome, there: bool) -> Outcome:
        """What leaves less of all sensors, or is in the place of what is told but not ``there``."""
        first, known = self.structure, scales(self.records)
        stated = (Part.of(e, known, 1) for e in self.unsure if e.tolerance is not None)
        values = tuple(p for p in found.parts or stated if p.tolerance is not None)
        told = frozenset(p.effect.name for p in found.parts if p.tolerance is None)
        read, begins = [self._read(i) for i in range(self.n_training)], _begins(found)
        left = {told: self._left_by(read, found.parts, begins)}
        promising = CandidateSearch.of(self._fit, values, begins).promising(self.general)
        fits = {told: (found.parts, first, begins)}
        tried = [((), first), *(((c.part,), c.there) for c in promising)]
        for more, self.structure in tried if promising else ():
            names = frozenset(p.effect.name for p in more)
            self.options.progress(f"all sensors beside {' + '.join(names) or 'values alone'}")
            try:
                fitted = self._fit.grown((*values, *more), begins)
                parts, self.releases = fitted.parts, fitted.releases
                own = self._left_by(read, parts, self.releases)
            except self.structure.failures:  # what it leads to cannot be simulated
                continue
            if not all(matters(p, known) for p in parts[len(values) :]):
                continue
            fits[names] = parts, self.structure, fitted.releases
            left[names] = np.minimum(own, left.get(names, np.inf))
        table = np.array([*left.values()])
        samples = sum(m.measured.size for m in self.measured[: self.n_training])
        shares = zip(table.T, (UNEXPLAINED, _HALF), (samples_beside(read), samples), strict=True)
        rises = np.sum([refuted_by(*row) for row in shares], axis=0)
        misfits = dict(zip(left, (rises - rises.min()).tolist(), strict=True))
        price = float(np.log(sum(r.count for r in self.records)))
        if (stays := misfits[told] < price + EQUIVALENT) and (there or not told):
            return found
        best = told if stays else min(misfits, key=lambda names: misfits[names])
        parts, self.structure, self.releases = fits[best]
        self.elsewhere, self.decided, self.own = misfits, True, parts
        asked = {p.effect.name for more, _ in tried for p in more} | told
        self.general = [e for e in self.general if e.name in asked]
        again = self.run((), self.simulate(parts), parts)
        return again if names_of(again.report.best) == best else found

    def _left_by(
        self, read: Sequence[Readings], parts: tuple[Part, ...], releases: Sequence[Beginning]
    ) -> Array:
        """Chi-squares that the structure with some parts leaves, and of values, (2,).

        Of all sensors beside the first mode, while these are heard, and of whole records.
        """
        asked = [(i, parts, r, self.structure) for i, r in enumerate(read)]
        beside = self._left(read, [*map(whole, self._motions(asked))])
        here, own = self.structure, self.records[: self.n_training]
        (moved,) = self._fit.moved([(here, parts, releases[: self.n_training])])
        pairs = zip(map(whole, moved), own, strict=True)
        rows = [(n.left, n.allowed(here, r.t)) for n, r in pairs]
        known = prior_cost(parts)
        return np.array([beside, sum(map(beside_known, *zip(*rows, strict=True)))]) + known

    def _heard(self, asked: Sequence[Hypothesis], found: Outcome) -> dict[Names, float]:
        """What all sensors say of explanations, and of none: minus twice their log-likelihood.

        What acts at a point is heard wherever it may be; the structure has it where the likeliest
        explanation is likeliest.
        """
        read, here = [self._read(i) for i in range(self.n_training)], self.structure
        left = {frozenset[str](): self._left(read, [self._without(*x) for x in enumerate(read)])}
        places: dict[Names, PlaceOnStructure | None] = {}
        there: dict[Names, tuple[Part, ...]] = {}
        for h in asked:
            same = h.names == found.report.best.names
            there[names_of(h)] = found.parts if same else self._fitted(h, found)
        heard = {names: self._anywhere(read, parts) for names, parts in there.items()}
        for names in sorted(heard, key=lambda names: heard[names].first):
            self.options.progress(f"all sensors beside {' + '.join(sorted(names))}")
            nearest = min((left[n] for n in places), default=np.inf)
            left[names], places[names] = heard[names].likeliest(nearest)
        least = min(left.values())
        noise = noise_of(least, read)
        best = min(places, key=lambda names: left[names])
        self.place = places[best]
        if self.place is not None:
            if self.place.point != here.at_point:
                (self.structure,) = here.at([self.place.point])
            ends = self.structure.at(self.place.ends)
            low, high = (e.strength(there[best], self.structure) for e in ends)
            self.place = replace(self.place, strengths=(low, high))
        return {names: tells(x - least, least, noise) for names, x in left.items()}

    def _fitted(self, h: Hypothesis, found: Outcome) -> tuple[Part, ...]:
        """What an explanation adds, fitted to all sensors if a value is: it may do less."""
        parts = self.structure.with_effects(h.parts)
        free = [p for p in parts if isinstance(p.effect, ValueEffect) and p.tolerance is None]
        try:
            return self._fit.grown(parts, _begins(found)).parts if free else parts
        except self.structure.failures:
            return parts

    def _anywhere(self, read: Sequence[Readings], parts: tuple[Part, ...]) -> PlaceSearch:
        """Chi-square that some parts leave of all sensors, wherever they may act."""
        here = self.structure

        def misfits(names: Sequence[str], share: float) -> list[float]:
            elsewhere = [name for name in names if name != here.at_point]
            there = dict(zip(elsewhere, here.at(elsewhere) if elsewhere else (), strict=True))
            part = heard(share)
            asked = [(i, parts, r, there.get(n, here)) for n in names for i, r in enumerate(part)]
            found = iter(self._motions(asked))
            return [misfit(name, part, [next(found) for _ in part]) for name in names]

        def misfit(
            name: str, part: Sequence[Readings], motions: Sequence[Array | Failure]
        ) -> float:
            known = [m for m in motions if not isinstance(m, Failure)]
            if len(known) == len(motions):
                return self._left(part, known)
            if name == here.at_point:
                whole(next(m for m in motions if isinstance(m, Failure)))
            return np.inf  # where it moves least, a law would be too strong for any motion

        def heard(share: float) -> list[Readings]:
            return [r.part(share) for r in read]

        def told(rise: float, least: float, share: float) -> float:
            return tells(rise, least, noise_of(least, heard(share)))

        points = here.points if here.acts(parts) else {}
        return PlaceSearch(points, here.at_point, misfits, told, stated=here.point is None)

    def _left(self, read: Sequence[Readings], motions: Sequence[Array]) -> float:
        """Chi-square of what motions leave of all sensors."""
        heard = zip(read, motions, self.records, self.releases, strict=False)
        return chi_squared([left_of(self.structure, r, x, own.rate, b) for r, x, own, b in heard])

    def _read(self, i: int) -> Readings:
        """What all sensors read in a record."""
        record = self.records[i]
        own = self.raw[i].between(record.decay.t[0], record.decay.t[-1])
        read = Readings.of(record, own, self.calm[i], self.options.floor)
        return read.unsure(self.structure.coordinate(read.measured), record.rate)

    def place_of(self, parts: Sequence[Part]) -> PlaceOnStructure | None:
        """The place of what acts at a point, where it is the one that was found."""
        there = self.structure
        known = self.place is not None and self.place.point == there.at_point
        return self.place if known and there.acts(parts) else None

    def _without(self, i: int, read: Readings) -> Array:
        """What the sensors read of the simulator as it is, along the first mode as measured."""
        (moved,) = self._motions([(i, (), read, self.structure)])
        motion, smooth = whole(moved), self.smooth[i]
        measured = smooth.spline(smooth.t[: len(motion)])[0]
        return followed(motion, self.structure.coordinate(motion), measured, read.t)

    def _motions(
        self, asked: Sequence[tuple[int, tuple[Part, ...], Readings, OnSimulator]]
    ) -> list[Array | Failure]:
        """What the sensors read of the simulator with some parts in a record, while it is heard.

        Or why there is no such motion.
        """
        questions = []
        for i, parts, read, there in asked:
            own = self.records[i]
            record = own.until(float(read.t[-1]) + own.decay.dt)
            equation = equation_of(self.model, parts, i, record)
            start = there.start(self.model, parts, self.smooth[i])
            questions.append((there, AskedMotion(equation, parts, record, start, self.releases[i])))
        rows = zip(moved_together(questions), asked, questions, strict=True)
        return [
            m if isinstance(m, Failure) else m.readings[q.record.derivative][: len(read.t)]
            for m, (_, _, read, _), (_, q) in rows
        ]

    def own_error(self, found: Sequence[Corrected]) -> float:
        """Rms of measured minus simulated over the noise, at the worst sensor of all records."""
        rows = zip(found, self.raw, strict=True)
        names = [""] * len(self.structure.shape)
        errors = [
            sensor_errors(names, raw.between(c.decay.t[0], c.decay.t[-1]), (c, c))
            for c, raw in rows
        ]
        return max(e.after for several in errors for e in several)

    def left_beside(self, found: Sequence[Corrected]) -> float:
        """Rms over the noise of what all sensors keep, where gains and other modes may be off."""
        rows = zip(self._now(found), self.records, strict=True)
        left = sum(beside_known(n.left, n.allowed(self.structure, r.t)) for n, r in rows)
        return (left / sum(m.measured.size for m in self.measured)) ** 0.5

    def _nearer(self, best: Outcome) -> FittedSimulator:
        """What is in the simulator, changed by one step of least squares on whole records."""
        return self._fit.after_step(best.parts, self._now(best.corrected))

    def _now(self, found: Sequence[Corrected]) -> list[Now]:
        rows = zip(found, self.measured, strict=True)
        return [Now(c.readings, c.start, c.release, own) for c, own in rows]

    def _grown(self, best: Outcome) -> FittedSimulator:
        """What is in the simulator, fitted to the first cycles, and to ever more."""
        return self._fit.grown(best.parts, _begins(best))

    @property
    def _fit(self) -> SensorFit:
        return SensorFit(self.structure, self.model, self.records, self.measured, self.n_training)

    @cached_property
    def measured(self) -> list[Readings]:
        """What the sensors measured in each record."""
        found = []
        for record, raw in zip(self.records, self.raw, strict=True):
            own = raw.between(record.decay.t[0], record.decay.t[-1])
            x = own.signal.reshape(len(own.t), -1)
            noises = tuple(Noise.white(noise_std(y), own.dt) for y in x.T)
            read = Readings(own.t - own.t[0], x, noises)
            found.append(read.unsure(self.structure.coordinate(x), record.rate))
        return found

    def next_parts(self, parts: Sequence[Part], found: Sequence[Part]) -> tuple[Part, ...]:
        """What was found, less what the equation needs for what is in the simulator.

        A value that is held in what was found is held from then on.
        """
        own = {key_of(p): p for p in self.own}
        now = {key: (p, own[key]) for p in parts if (key := key_of(p)) in own}
        known, self.known = self.known, now
        return tuple(
            p.moved(_less(p, *now[key], *known.get(key, now[key])))
            if (key := key_of(p)) in now
            else p
            for p in self.structure.with_effects(found)
        )


def _less(found: Part, there: Part, own: Part, before: Part, own_before: Part) -> Array:
    """Change of a part that was found, where the equation needs its ``own`` for what is there.

    Of a value it needs so much more. What acts it needs so many times as strong, to a power that
    this had ``before``: a clamp that gives way the more does ever less.
    """
    more, n = there.values - own.values, found.strengths.size
    if isinstance(found.effect, ValueEffect) and found.effect.assumed:
        return more
    with np.errstate(divide="ignore", invalid="ignore"):
        change, by = np.log(there.values / before.values), np.log(own.values / own_before.values)
        same = np.all(np.append(change[n:], by[n:]) == 0)  # exponents
        power = np.where(same & (np.abs(change[:n]) > _CHANGED), change[:n] / by[:n], 1.0)
        ratio = found.values[:n] / own.values[:n]
        times = np.where(ratio > 0, ratio, np.nan) ** np.clip(power, 1 / _TIMES, _TIMES)
    times = np.clip(times, 1 / _TIMES, _TIMES)
    more[:n] = np.where(np.isfinite(times), times * there.values[:n] - found.values[:n], more[:n])
    return more


def _rung(record: Record, found: Corrected) -> tuple[float, ...]:
    """Frequencies (rad/s) of what other modes of a simulator do in its coordinate."""
    beside = record.signal - found.decay.signal
    window = np.hanning(len(beside))
    tones = strongest_tones(record.t, beside * window, _TONES, _APART * record.rate)
    loud = _AUDIBLE * record.noise.std * window.sum() / 2

    def rung(tone: float) -> bool:
        order = tone / record.rate
        apart = round(order) > _HARMONICS or abs(order - round(order)) > _APART
        return apart and abs(np.sum(window * beside * np.exp(-1j * tone * record.t))) > loud

    return tuple(tone for tone in tones if rung(tone))


def _begins(found: Outcome) -> list[Beginning]:
    """How each record began as it was simulated."""
    return [c.release._replace(state=c.start) for c in found.corrected]


def left_of(
    seen: OnSimulator, read: Readings, motion: Array, rate: float, begins: Beginning
) -> Array:
    """What a motion leaves of the sensors beside the first mode, and what their gains do.

    Columns (m, 1 + n_sensors) over the noise; the first mode has a ``rate``, rad/s. Other modes may
    ring by more, and be elsewhere in their cycle: by any amount where the record was cut, else as
    far as a release is known. Their frequencies may be others by a little.
    """
    first = FirstMode.of(seen.coordinate(motion), motion, read.t)
    rung = motion - first.readings
    later = np.gradient(rung, read.t, axis=0)
    turned = later * np.linalg.norm(rung) / max(float(np.linalg.norm(later)), 1e-300)
    errors, free = first.errors(read.t, rate), [rung, turned]
    errors += detuned(rung, read.t)
    if not begins.since:
        errors, free = [*errors, *(_RINGS * x for x in free)], []
    known = [read.measured - motion, *(GAINS * x for x in by_gains(motion))]
    table = read.over_noise([*known, *free], seen.shape)
    table = with_errors(table, read.over_noise(errors, seen.shape))
    n = len(known)
    return without(table[:, :n], table[:, n:]) if free else table


@dataclass(frozen=True)
class InSimulator(Amended):
    """What a fit says of the values in a simulator: those in its equation, and by how much more."""

    more: Mapping[tuple[str, str], Array]
    variances: Mapping[tuple[str, str], Array]  # by all sensors, where these were asked
    asked: bool  # of just these values: the coordinate alone tells less of them
    sole: bool = False  # whether the coordinate has no say in what is in the simulator

    def amended(self, found: Solved) -> Solved:
        there = [
            p.moved(self.more[key]) if (key := key_of(p)) in self.more else p for p in found.parts
        ]
        # The equation holds what other modes need as well.
        covariance, first = found.covariance.copy(), 0
        for part in found.parts:
            own = np.arange(first, first + part.size)
            first += part.size
            alone = np.diag(covariance)[own].copy()
            sure = self.asked and (self.sole or isinstance(part.effect, ValueEffect))
            told = self.variances.get(key_of(part), alone)
            wanted = told if sure else np.maximum(alone, told)
            size = np.sqrt(np.divide(wanted, alone, out=np.ones_like(alone), where=alone > 0))
            covariance[own] *= size[:, None]
            covariance[:, own] *= size
        return found._replace(parts=tuple(there), covariance=covariance)
