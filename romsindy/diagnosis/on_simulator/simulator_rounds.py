"""Rounds of a diagnosis on a user's own simulator: values that it needs, and all its sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from romsindy.diagnosis.all_sensors import (
    GAINS,
    FirstMode,
    Readings,
    by_gains,
    followed,
    noise_of,
    with_errors,
    without,
)
from romsindy.diagnosis.evidence import Amended, Hypothesis, Solved
from romsindy.diagnosis.on_simulator.places import PlaceOnStructure, PlaceSearch
from romsindy.diagnosis.on_simulator.seen import (
    AskedMotion,
    Beginning,
    Failure,
    OnSimulator,
    ValueEffect,
    moved_together,
)
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.rounds import Names, Outcome, Rounds, names_of
from romsindy.diagnosis.search import strongest_tones
from romsindy.diagnosis.structure import Corrected, as_measured, key_of, sensor_errors, with_signal
from romsindy.effects.base import Effect
from romsindy.effects.outside import TONES
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Part, moved_parts
from romsindy.fit.records.record import Record, scales
from romsindy.fit.verdict import EQUIVALENT
from romsindy.record.spectrum import noise_std
from romsindy.simulator.simulator import whole
from romsindy.typing import Array

_CLOSE, _POLISHED = 1.05, 3  # own error over the noise that is good enough; rounds towards it
_ASTRAY = 2.0  # the same that a mode leaves which has lost step, at least
_LARGER = 1e-3  # beginning of a record, for what a change of it does
_STEP = 0.01  # of a value, for what a change of it does
_TURN = 0.02  # radians by which a change of a stated value may turn the slow mode by the end
# Cycles of the first look at all sensors, steps of each, and how much longer the next is
_FIRST, _STEPS, _LONGER = 3.0, 2, 2.0
_LISTENED = 3  # times that all sensors are heard, each with the best so far in the simulator
_RIGHTED = 2  # times that a simulator is made exact at the values that were found
_MOST = 6  # explanations that they are heard of: the best, and others that are simulated
_INSTEAD = 50.0  # of chi-square in the coordinate: by less it hardly tells values from effects
_RINGS = 0.05  # of another mode: how well a release is known, a standard deviation
# Of the frequencies of other modes, a standard deviation: elements and clamps are not known better
_DETUNED = 2e-3
# Tones of other modes: how many, how far apart (of the slow one), and how loud (of the noise)
_TONES, _APART, _AUDIBLE = 12, 0.15, 0.1
_HARMONICS = 3  # of the slow mode, which the form of the equation leaves
_UNEXPLAINED = 0.2  # of what no explanation explains: by so much one may seem better than another


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
    # Of the values in the simulator, by all sensors, where it was brought nearer to the records
    variances: dict[tuple[str, str], Array] = field(default_factory=dict)
    there: bool = False  # whether the last step towards the records was within its errors
    place: PlaceOnStructure | None = None  # of what acts at a point, once it was looked for

    def begin(self) -> list[Corrected]:
        """Simulate it as it is; what rings there is no tone of something else.

        It rings at another frequency than measured by as much as its other modes are off, which
        leaves tones.
        """
        found = super().begin()
        rows = zip(self.records, found, strict=True)
        tones = tuple(tone for record, c in rows for tone in _rung(record, c))
        self.general = [
            replace(e, beside=tones) if isinstance(e, TONES) else e for e in self.general
        ]
        return found

    def simulate(self, parts: Sequence[Part]) -> list[Corrected]:
        """Simulate with what was found, and let the equation follow.

        How records begin is looked at anew, unless the same effects were there before.
        """
        if [key_of(p) for p in parts] != [key_of(p) for p in self.own]:
            self.releases = [None] * len(self.records)
        found = super().simulate(parts)
        seen = [
            as_measured(r, self.structure.coordinate(c.readings))
            for r, c in zip(self.records, found, strict=True)
        ]
        # Values that do the same to the equation are those of the simulator, not the likelier ones.
        there = [p if p.tolerance is None else replace(p, near=float(p.values[0])) for p in parts]
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
        """Its report with the values that its best has in the simulator."""
        report, parts = outcome.report, outcome.parts
        found = {key_of(p): p.values for p in report.best.parts}
        more = {key_of(p): p.values - found[key_of(p)] for p in parts if key_of(p) in found}
        asked = set(self.variances) == {key_of(p) for p in parts}
        # What is left beside noise is not known to be without a say in the values.
        left = max(self.own_error(outcome.corrected), 1.0) ** 2 if asked else 1.0
        variances = {key: x * left for key, x in self.variances.items()}
        given = (report.best.weighed, more, variances, asked)
        best = replace(report.best, weighed=InSimulator(*given))
        rivals = tuple(best if h is report.best else h for h in report.rivals)
        return replace(report, best=best, rivals=rivals) if more else report

    def in_equation(self, parts: Sequence[Part]) -> Sequence[Part]:
        return self.own

    def run(
        self, effects: Sequence[Effect], before: list[Corrected], parts: tuple[Part, ...] = ()
    ) -> Outcome:
        """As every structure; then the simulator itself comes as near to the records as it can.

        What several sensors can refute is heard by them first.
        """
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
        self, best: Outcome, change: Callable[[Outcome], tuple[Part, ...]], times: int = _POLISHED
    ) -> Outcome:
        """The same, as long as a change of what is in the simulator brings it nearer."""
        error = self.own_error(best.corrected)
        valued = any(isinstance(p.effect, ValueEffect) for p in best.parts)
        for _ in range(times):
            if error <= _CLOSE and (self.there or not valued):
                break
            self.options.progress(f"{self.structure.what} nearer to the records")
            try:
                changed = change(best)
                found = self.simulate(changed)
            except self.structure.failures:  # what was found stands, and so does its error
                break
            last, error = error, self.own_error(found)
            if error >= last:
                break
            best = best._replace(parts=changed, corrected=found)
        return best

    def over_all_sensors(self, found: Outcome) -> Outcome:
        """What is found once all sensors, and the modes that ring, have their say.

        The simulator is simulated with the likeliest explanation, and looked at again, until that
        is what is found.
        """
        if len(self.structure.shape) == 1:
            return found
        found = self._with_one_value(found)
        for _ in range(_LISTENED):
            if self.options.over:
                return found._replace(report=replace(found.report, interrupted=True))
            before, kept = self.structure, (self.place, self.own, self.variances)
            try:
                again = self._once_heard(found)
            except self.structure.failures:  # what was found stands
                again = None
            if again is None or again.trouble or self._farther(again, found):
                self.structure, (self.place, self.own, self.variances) = before, kept
                self.return_to(found.corrected)
                return self._brought_nearer(found)
            settled = again.parts is found.parts and self.structure is before
            found = again
            if settled:
                break
        return found

    def _farther(self, again: Outcome, found: Outcome) -> bool:
        """Whether what stays the same leaves more of the sensors than before."""
        same = again.report.best.names == found.report.best.names
        return same and self.own_error(again.corrected) > self.own_error(found.corrected)

    def _once_heard(self, found: Outcome) -> Outcome:
        """What is found once all sensors had their say, and near to the records."""
        report, before = found.report, self.structure
        asked = self.near(report, _MOST, _INSTEAD)
        said = bool(report.best.names) and report.verdict != "none"
        if found.trouble or not said or len(asked) < (1 if before.points else 2):
            return self._brought_nearer(found)
        best = self.likeliest(asked, self._heard(asked, found))
        if best.names != report.best.names or self.structure is not before:
            parts = self.structure.with_effects(best.parts)
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

    def _with_one_value(self, found: Outcome) -> Outcome:
        """What is found where values within tolerances leave more than noise of all sensors.

        Each value that was stated without a tolerance is tried beside them: the first mode may not
        have asked for it.
        """
        known, n = scales(self.records), len(self.records)
        values = [e for e in self.general if isinstance(e, ValueEffect)]
        done = found.trouble or found.report.best.names or self.options.over
        if done or not values or self.own_error(found.corrected) <= _CLOSE:
            return found
        misfits = {frozenset[str](): self._misfit(found.parts, found.corrected)}
        tried: dict[Names, tuple[Part, ...]] = {}
        try:
            for effect in values:
                self.options.progress(f"all sensors beside {effect.name}")
                names, part = frozenset({effect.name}), Part.of(effect, known, n)
                tried[names] = self._grown(found._replace(parts=(*found.parts, part)))
                misfits[names] = self._misfit(tried[names], self.simulate(tried[names]))
            best = min(tried, key=lambda names: misfits[names])
            price = float(np.log(sum(r.count for r in self.records)))
            if misfits[frozenset()] - misfits[best] < price + EQUIVALENT:
                self.return_to(found.corrected)
                return found
            self.elsewhere = {names: x - misfits[best] for names, x in misfits.items()}
            again = self.run((), self.simulate(tried[best]), tried[best])
        except self.structure.failures:  # what was found stands
            self.return_to(found.corrected)
            return found
        return found if again.trouble else again

    def _misfit(self, parts: Sequence[Part], found: Sequence[Corrected]) -> float:
        """Chi-square of what the simulator leaves of all sensors, and of its values."""
        known = sum((float(p.values[0]) / p.tolerance) ** 2 for p in parts if p.tolerance)
        for c, raw in zip(found[: self.n_training], self.raw, strict=False):
            measured = raw.between(c.decay.t[0], c.decay.t[-1]).signal.reshape(len(c.readings), -1)
            noise = np.array([noise_std(y) for y in measured.T])
            known += float(np.sum(((measured - c.readings) / noise) ** 2))
        return known

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
            parts = here.with_effects(h.parts)
            there[names_of(h)] = found.parts if h.names == found.report.best.names else parts
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
        return PlaceSearch(points, here.at_point, misfits, told)

    def _left(self, read: Sequence[Readings], motions: Sequence[Array]) -> float:
        """Chi-square of what motions leave of all sensors."""
        heard = zip(read, motions, self.records, self.releases, strict=False)
        return chi_squared([left_of(self.structure, r, x, own.rate, b) for r, x, own, b in heard])

    def _read(self, i: int) -> Readings:
        """What all sensors read in a record."""
        record = self.records[i]
        own = self.raw[i].between(record.decay.t[0], record.decay.t[-1])
        return Readings.of(record, own, self.calm[i], self.options.floor)

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
            questions.append(AskedMotion(there, equation, parts, record, start, self.releases[i]))
        rows = zip(moved_together(questions), asked, questions, strict=True)
        return [
            m if isinstance(m, Failure) else m.readings[q.record.derivative][: len(read.t)]
            for m, (_, _, read, _), q in rows
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

    def _nearer(self, best: Outcome) -> tuple[Part, ...]:
        """What is in the simulator, changed by one step of least squares on whole records."""
        now = [Now(c.readings, c.start, c.release) for c in best.corrected]
        parts, self.releases = self._step(best.parts, now)
        return parts

    def _grown(self, best: Outcome) -> tuple[Part, ...]:
        """What is in the simulator, fitted to the first cycles of all sensors, and to ever more.

        Over whole records other modes lose step where values are off: no step leads from there.
        """
        parts = best.parts
        releases = [c.release._replace(state=c.start) for c in best.corrected]
        longest = max(float(r.t[-1]) for r in self.records)
        end = _FIRST * 2 * np.pi / min(r.rate for r in self.records)
        while True:
            for _ in range(_STEPS):
                now = self._now([(i, parts, r) for i, r in enumerate(releases)], end)
                parts, releases = self._step(parts, now, end)
            if end >= longest:
                break
            end *= _LONGER
        self.releases = releases
        return parts

    def _now(self, asked: Sequence[tuple[int, Sequence[Part], Beginning]], end: float) -> list[Now]:
        """Motions of records with some parts, from where these begin, up to a time."""
        questions = []
        for i, parts, release in asked:
            record = self.records[i].until(end)
            equation = equation_of(self.model, parts, i, record)
            assert release.state is not None
            given = (equation, parts, record, release.state, release)
            questions.append(AskedMotion(self.structure, *given))
        rows = zip(map(whole, moved_together(questions)), questions, strict=True)
        return [Now(m.readings[q.record.derivative], m.start, m.release) for m, q in rows]

    def _step(
        self, parts: tuple[Part, ...], now: Sequence[Now], end: float = np.inf
    ) -> tuple[tuple[Part, ...], list[Beginning]]:
        """One step of least squares on the simulator's own readings, up to a time of the records.

        Beside it each record may begin a little larger, or later.
        """
        values = np.concatenate([p.values for p in parts])
        steps = np.concatenate([self._small(p, end) for p in parts])
        rows = self._linear(now, parts, steps, end)
        change = np.zeros(len(steps))
        learnt = rows[: self.n_training]
        known = np.concatenate(
            [np.full(p.size, 1 / p.tolerance if p.tolerance else 0.0) for p in parts]
        )
        for own in (learnt, rows):  # what took no part says how it begins alone
            left = [r.left - r.by_value @ change for r in own]
            matrix = block_diag(*(r.by_start for r in own))
            free = own is learnt
            if free:
                whole = np.hstack([np.concatenate([r.by_value for r in own]), matrix])
                prior = np.hstack([np.diag(known), np.zeros((len(known), matrix.shape[1]))])
                matrix, left = np.vstack([whole, prior]), [*left, -known * values]
            # A value that is held, or at its limit, moves nothing: it stays.
            size = np.linalg.norm(matrix, axis=0)
            scale = np.where(size > 0, size, 1.0)
            scaled = matrix / scale
            found = np.linalg.lstsq(scaled, np.concatenate(left))[0] / scale
            if free:
                change = found[: len(steps)]
                known_to = np.diag(np.linalg.pinv(scaled.T @ scaled, hermitian=True)) / scale**2
                ends = np.cumsum([p.size for p in parts])[:-1]
                each = np.split(known_to[: len(steps)], ends)
                self.variances = {key_of(p): x for p, x in zip(parts, each, strict=True)}
                self.there = bool(np.all(change**2 <= known_to[: len(steps)]))
        larger = (1 + found[: 2 * len(now) : 2]).tolist()
        begins = [n.release.larger(n.start, by) for n, by in zip(now, larger, strict=True)]
        return moved_parts(parts, change), begins

    def _small(self, part: Part, end: float) -> Array:
        """Changes of the values of a part, for what they do until a time of the records."""
        values = np.where(part.values == 0, 1.0, np.abs(part.values))
        if not isinstance(part.effect, ValueEffect):
            return np.asarray(_STEP * values)
        turned = max(r.rate * min(float(r.t[-1]), end) for r in self.records)
        return np.full(1, _TURN / turned * part.effect.scale)

    def _linear(
        self, now: Sequence[Now], parts: tuple[Part, ...], steps: Array, end: float
    ) -> list[LinearReadings]:
        """What readings of each record follow, by simulations with small changes."""
        # To both sides: values that nearly do the same are told apart by what is left of both.
        changes = [x * one for x, one in zip(steps, np.eye(len(steps)), strict=True)]
        tried = [moved_parts(parts, sign * x) for x in changes for sign in (1, -1)]
        asked: list[tuple[int, Sequence[Part], Beginning]] = []
        for i, n in enumerate(now):
            asked += [(i, p, n.release.larger(n.start, 1.0)) for p in tried]
            asked.append((i, parts, n.release.larger(n.start, 1 + _LARGER)))
        found = iter(self._now(asked, end))
        rows = []
        for i, n in enumerate(now):
            record, raw = self.records[i], self.raw[i]
            own = raw.between(record.decay.t[0], record.decay.t[-1])
            measured = own.signal.reshape(len(own.t), -1)
            noise = np.array([noise_std(y) for y in measured.T])
            left = measured[: len(n.readings)] - n.readings
            pairs = [(next(found), next(found)) for _ in steps]
            by_value = [
                (more.readings - less.readings) / (2 * step)
                for (more, less), step in zip(pairs, steps, strict=True)
            ]
            larger = (next(found).readings - n.readings) / _LARGER
            later = np.gradient(n.readings, record.decay.dt, axis=0)
            columns = [left, *by_value, larger, later]
            table = np.stack([(x / noise).ravel() for x in columns], axis=1)
            rows.append(LinearReadings(table[:, 0], table[:, 1:-2], table[:, -2:]))
        return rows

    def next_parts(self, parts: Sequence[Part], found: Sequence[Part]) -> tuple[Part, ...]:
        """What was found, less what the equation needs for what is in the simulator.

        A value that is held in what was found is held from then on.
        """
        there = {key_of(p): p for p in parts}
        own = {key_of(p): p for p in self.own}
        return tuple(
            p.moved(there[key].values - own[key].values) if (key := key_of(p)) in there else p
            for p in self.structure.with_effects(found)
        )


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
    errors.append(_DETUNED * read.t[:, None] * later)
    if not begins.turns:
        errors, free = [*errors, *(_RINGS * x for x in free)], []
    known = [read.measured - motion, *(GAINS * x for x in by_gains(motion))]
    table = read.over_noise([*known, *free], seen.shape)
    table = with_errors(table, read.over_noise(errors, seen.shape))
    n = len(known)
    return without(table[:, :n], table[:, n:]) if free else table


def tells(rise: float, least: float, noise: float) -> float:
    """Chi-square that a misfit counts for beyond the least of all, which is ``noise`` times noise.

    What even the best leaves beside noise is an error of the simulator, such as modes that ring
    otherwise at large amplitude. It may go with any explanation, and with any place.
    """
    return max(rise - _UNEXPLAINED * least * (1 - 1 / noise), 0.0) / noise


def chi_squared(rows: Sequence[Array]) -> float:
    """What is left of all records, `left_of` each, by the likeliest gains."""
    table = np.concatenate([*rows, np.eye(rows[0].shape[1])[1:]])
    left, gains = table[:, 0], table[:, 1:]
    return float(np.sum((left - gains @ np.linalg.lstsq(gains, left)[0]) ** 2))


class Now(NamedTuple):
    """A simulated motion: what the sensors read, (n, n_sensors), and how it begins."""

    readings: Array
    start: tuple[float, float]
    release: Beginning


class LinearReadings(NamedTuple):
    """What is left of a record, (m,) over the noise, and what it follows, (m, k) each.

    Values of the simulator; the size and the time with which the record begins.
    """

    left: Array
    by_value: Array
    by_start: Array


@dataclass(frozen=True)
class InSimulator(Amended):
    """What a fit says of the values in a simulator: those in its equation, and by how much more."""

    more: Mapping[tuple[str, str], Array]
    variances: Mapping[tuple[str, str], Array]  # by all sensors, where these were asked
    asked: bool  # of just these values: the coordinate alone tells less of them

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
            sure = self.asked and isinstance(part.effect, ValueEffect)
            told = self.variances.get(key_of(part), alone)
            wanted = told if sure else np.maximum(alone, told)
            size = np.sqrt(np.divide(wanted, alone, out=np.ones_like(alone), where=alone > 0))
            covariance[own] *= size[:, None]
            covariance[:, own] *= size
        return found._replace(parts=tuple(there), covariance=covariance)
