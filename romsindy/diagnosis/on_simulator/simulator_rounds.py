"""Rounds of a diagnosis on a user's own simulator: values that it needs, and all its sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from romsindy.diagnosis.on_simulator.seen import Beginning, OnSimulator
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.rounds import Names, Outcome, Rounds, names_of
from romsindy.diagnosis.structure import Corrected, as_measured, key_of, sensor_errors, with_signal
from romsindy.effects.base import Effect
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Part, moved_parts
from romsindy.record.spectrum import noise_std
from romsindy.typing import Array

_CLOSE, _POLISHED = 1.05, 3  # own error over the noise that is good enough; rounds towards it
_LARGER = 1e-3  # beginning of a record, for what a change of it does
_STEP = 0.01  # of a value, for what a change of it does
_LISTENED = 2  # times that all sensors are heard, each with the best so far in the simulator
_MOST = 3  # explanations that they are heard of: the best, and two that are simulated
_RINGS = 0.05  # of another mode: how well a release is known, a standard deviation


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
        followed = fit(self.model, parts, seen, iterations=30)
        if not followed.finite:
            raise TrajectoryError("no motion of its equation follows it")
        self.own = followed.parts
        left = followed.residuals
        return [
            c._replace(decay=with_signal(c.decay, r.signal - beside))
            for r, c, beside in zip(self.records, found, left, strict=True)
        ]

    def with_values_of_simulator(
        self, report: DiagnosisReport, parts: Sequence[Part]
    ) -> DiagnosisReport:
        """The same with the values that its best has in the simulator."""
        found = {key_of(p): p.values for p in report.best.parts}
        more = {key_of(p): p.values - found[key_of(p)] for p in parts if key_of(p) in found}
        best = replace(report.best, weighed=InSimulator(report.best.weighed, more))
        rivals = tuple(best if h is report.best else h for h in report.rivals)
        return replace(report, best=best, rivals=rivals) if more else report

    def in_equation(self, parts: Sequence[Part]) -> Sequence[Part]:
        return self.own

    def run(
        self, effects: Sequence[Effect], before: list[Corrected], parts: tuple[Part, ...] = ()
    ) -> Outcome:
        """As every structure; then the simulator itself comes as near to the records as it can."""
        best = super().run(effects, before, parts)
        if best.trouble or not best.parts:
            return best
        nearer = self._polished(best)
        if nearer is best:
            return best
        report = self._look(effects, nearer.corrected, len(best.report.best.effects))
        same = report.best.names == best.report.best.names
        return nearer._replace(report=report) if same else best

    def _polished(self, best: Outcome) -> Outcome:
        """The same, but for its report, with the simulator as near to the records as it comes."""
        error = self.own_error(best.corrected)
        for _ in range(_POLISHED):
            if error <= _CLOSE:
                break
            self.options.progress(f"{self.structure.what} nearer to the records")
            try:
                changed = self._nearer(best)
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
        for _ in range(_LISTENED if len(self.structure.shape) > 1 else 0):
            report = found.report
            asked = self.near(report, _MOST)
            said = bool(report.best.effects) and report.verdict != "none"
            if found.trouble or not said or len(asked) < 2:
                break
            if self.options.over:
                return found._replace(report=replace(report, interrupted=True))
            try:
                best = self.likeliest(asked, self._heard(asked, found))
                if best.names == report.best.names:
                    look = self._look((), found.corrected, len(report.best.effects))
                    if look.best.names == best.names:
                        return found._replace(report=look)
                    again = self.run((), found.corrected, found.parts)
                else:
                    parts = self.structure.with_effects(best.parts)
                    again = self.run((), self.simulate(parts), parts)
            except self.structure.failures:  # what was found stands
                break
            if again.trouble:
                break
            found = again
            if found.report.best.names == best.names:
                break
        return found

    def _heard(self, asked: Sequence[Hypothesis], found: Outcome) -> dict[Names, float]:
        """What all sensors say of explanations, and of none: minus twice their log-likelihood."""
        read = [self._read(i) for i in range(self.n_training)]
        left = {frozenset[str](): self._left(read, [self._without(*x) for x in enumerate(read)])}
        for h in asked:
            self.options.progress(f"all sensors beside {' + '.join(h.names)}")
            if h.names == found.report.best.names:
                motions = [found.corrected[i].readings[: len(r.t)] for i, r in enumerate(read)]
            else:
                parts = self.structure.with_effects(h.parts)
                motions = [self._motion(i, parts, float(r.t[-1])) for i, r in enumerate(read)]
            left[names_of(h)] = self._left(read, motions)
        noise = noise_of(min(left.values()), read)
        return {names: x / noise for names, x in left.items()}

    def _left(self, read: Sequence[Readings], motions: Sequence[Array]) -> float:
        """Chi-square of what motions leave of all sensors."""
        heard = zip(read, motions, self.records, self.releases, strict=False)
        return chi_squared([left_of(self.structure, r, x, own.rate, b) for r, x, own, b in heard])

    def _read(self, i: int) -> Readings:
        """What all sensors read in a record."""
        record = self.records[i]
        own = self.raw[i].between(record.decay.t[0], record.decay.t[-1])
        return Readings.of(record, own, self.calm[i], self.options.floor)

    def _without(self, i: int, read: Readings) -> Array:
        """What the sensors read of the simulator as it is, along the first mode as measured."""
        motion, smooth = self._motion(i, (), float(read.t[-1])), self.smooth[i]
        measured = smooth.spline(smooth.t[: len(motion)])[0]
        return followed(motion, self.structure.coordinate(motion), measured, read.t)

    def _motion(self, i: int, parts: tuple[Part, ...], end: float) -> Array:
        """What the sensors read of the simulator with some parts, until a time of a record (s)."""
        record = self.records[i].until(end)
        equation = equation_of(self.model, parts, i, record)
        start = self.structure.start(self.model, parts, self.smooth[i])
        given = (equation, parts, record, self.raw[i], start, self.releases[i])
        return np.asarray(self.structure.moved(*given).readings[record.derivative])

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
        """What is in the simulator, changed by one step of least squares on its own readings.

        Beside it each record may begin a little larger, or later.
        """
        values = np.concatenate([p.values for p in best.parts])
        steps = _STEP * np.where(values == 0, 1.0, np.abs(values))
        rows = [self._linear(i, c, best.parts, steps) for i, c in enumerate(best.corrected)]
        change = np.zeros(len(steps))
        learnt = rows[: self.n_training]
        for own in (learnt, rows):  # what took no part says how it begins alone
            left = [r.left - r.by_value @ change for r in own]
            blocks = block_diag(*(r.by_start for r in own))
            free = own is learnt
            matrix = (
                np.hstack([np.concatenate([r.by_value for r in own]), blocks]) if free else blocks
            )
            # A value that is held, or at its limit, moves nothing: it stays.
            size = np.linalg.norm(matrix, axis=0)
            scale = np.where(size > 0, size, 1.0)
            found = np.linalg.lstsq(matrix / scale, np.concatenate(left))[0] / scale
            change = found[: len(steps)] if free else change
        for i, c in enumerate(best.corrected):
            size = c.release.size * (1 + found[2 * i])
            self.releases[i] = c.release._replace(size=float(size))
        return moved_parts(best.parts, change)

    def _linear(
        self, i: int, c: Corrected, parts: tuple[Part, ...], steps: Array
    ) -> LinearReadings:
        """What readings of a record follow, by simulations with small changes."""
        record, raw = self.records[i], self.raw[i]
        own = raw.between(c.decay.t[0], c.decay.t[-1])
        measured = own.signal.reshape(len(own.t), -1)
        noise = np.array([noise_std(y) for y in measured.T])

        def change(there: tuple[Part, ...], release: Beginning, step: float) -> Array:
            equation = equation_of(self.model, there, i, record)
            start = tuple(x / c.release.size for x in c.start)
            moved = self.structure.moved(equation, there, record, raw, start, release)
            return ((moved.readings[record.derivative] - c.readings) / step / noise).ravel()

        by_value = [
            change(moved_parts(parts, step * one), c.release, step)
            for step, one in zip(steps, np.eye(len(steps)), strict=True)
        ]
        larger = c.release._replace(size=c.release.size * (1 + _LARGER))
        later = np.gradient(c.readings, record.decay.dt, axis=0) / noise
        by_start = [change(parts, larger, _LARGER), later.ravel()]
        left = ((measured - c.readings) / noise).ravel()
        return LinearReadings(left, np.stack(by_value, axis=1), np.stack(by_start, axis=1))

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


def left_of(
    seen: OnSimulator, read: Readings, motion: Array, rate: float, begins: Beginning
) -> Array:
    """What a motion leaves of the sensors beside the first mode, and what their gains do.

    Columns (m, 1 + n_sensors) over the noise; the first mode has a ``rate``, rad/s. Other modes may
    ring by more, and be elsewhere in their cycle: by any amount where the record was cut, else as
    far as a release is known.
    """
    first = FirstMode.of(seen.coordinate(motion), motion, read.t)
    rung = motion - first.readings
    turned = np.gradient(rung, axis=0)
    turned *= np.linalg.norm(rung) / max(float(np.linalg.norm(turned)), 1e-300)
    errors, free = first.errors(read.t, rate), [rung, turned]
    if not begins.turns:
        errors, free = [*errors, *(_RINGS * x for x in free)], []
    known = [read.measured - motion, *(GAINS * x for x in by_gains(motion))]
    table = read.over_noise([*known, *free], seen.shape)
    table = with_errors(table, read.over_noise(errors, seen.shape))
    n = len(known)
    return without(table[:, :n], table[:, n:]) if free else table


def chi_squared(rows: Sequence[Array]) -> float:
    """What is left of all records, `left_of` each, by the likeliest gains."""
    table = np.concatenate([*rows, np.eye(rows[0].shape[1])[1:]])
    left, gains = table[:, 0], table[:, 1:]
    return float(np.sum((left - gains @ np.linalg.lstsq(gains, left)[0]) ** 2))


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

    def amended(self, found: Solved) -> Solved:
        there = [
            p.moved(self.more[key]) if (key := key_of(p)) in self.more else p for p in found.parts
        ]
        return found._replace(parts=tuple(there))
