"""Rounds: simulate a beam, take off what it does beside its reduced model, look again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from romsindy.beam import NoEquilibriumError, StepTooLongError
from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError, Hypothesis
from romsindy.diagnosis.on_beam.defect import (
    Corrected,
    ReleaseLoad,
    beam_with,
    calm_from,
    corrected,
    on_the_beam,
    simulated,
    start_of,
)
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.parameters import points
from romsindy.diagnosis.on_beam.place import (
    Latitude,
    PlaceOnBeam,
    can_be_anywhere,
    find_place,
    moved_to,
    place_now,
)
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.search import Options
from romsindy.diagnosis.workflow import diagnose_model
from romsindy.effects.base import Effect
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay

FAILURES = (NoEquilibriumError, StepTooLongError, TrajectoryError)
_ROUNDS = 5
_ELSEWHERE = 0.016  # of the noise: higher modes turn several times as far, so a tenth of the noise
_SETTLED = 3.0  # standard errors: the defect changes by less than a hundredth of such a change
_CYCLES = 12  # once it is calm: over these the beam is simulated with an effect at several places


class Outcome(NamedTuple):
    """What was found, what is on the beam that was simulated, and this.

    Where the beam cannot be simulated with what was found, ``trouble`` says why.
    """

    report: DiagnosisReport
    parts: tuple[Part, ...]
    corrected: list[Corrected]
    trouble: str = ""


@dataclass(eq=False)
class BeamRounds:
    """A beam and its reduced model beside records."""

    seen: InstrumentedBeam
    model: ReducedModel
    records: list[Record]  # of the coordinate
    raw: list[Decay]  # what the sensors measured in each, as fast as they did
    held_out: bool  # whether the last takes no part
    # What follows the data; what is looked for beside effects that a beam can have
    unsure: Sequence[Effect]
    general: Sequence[Effect]
    options: Options
    # How each record started; None is read from the sensors, once
    releases: list[ReleaseLoad | None]
    form: FormError = NO_FORM_ERROR  # of the beam, as its reference records show it
    smooth: list[Record] = field(init=False)  # without what the higher modes add
    calm: list[float] = field(init=False)  # when fast modes have died, s

    def __post_init__(self) -> None:
        self.smooth = list(self.records)
        self.parallel = Parallel(self.options.n_jobs)

    @property
    def n_training(self) -> int:
        """Number of records to learn from."""
        return len(self.records) - self.held_out

    def begin(self) -> list[Corrected]:
        """Simulate the beam as it is."""
        found = self.simulate(())
        if any(self._depends_on_start(*row) for row in zip(found, self.records, strict=True)):
            found = self.simulate(())  # from starts that are read without the ringing
        sensed = [self.seen.coordinate(c.readings) for c in found]
        self.calm = [calm_from(*pair) for pair in zip(self.records, sensed, strict=True)]
        return found

    def _depends_on_start(self, found: Corrected, record: Record) -> bool:
        """Whether what was taken off would be another from a start that is read without it.

        Both the beam and its reduced model start there: the defect follows the start in proportion.
        """
        smooth = Record.of(found.decay, self.options.floor)
        q, q_dot = np.subtract(start_of(self.model, (), smooth), found.start)
        moved = np.hypot(q, q_dot / smooth.rate) / smooth.amplitude
        defect = np.std(record.signal - found.decay.signal)
        return bool(moved * defect > _ELSEWHERE * record.noise.std)

    def simulate(self, parts: Sequence[Part]) -> list[Corrected]:
        """Simulate the beam with what was found."""
        added = " + ".join(p.effect.name for p in parts) or "nothing more"
        self.options.progress(f"the beam with {added}")
        rows = zip(self.records, self.raw, self.releases, self.smooth, strict=True)
        found: list[Corrected] = list(
            self.parallel(delayed(corrected)(self.seen, self.model, parts, *row) for row in rows)
        )
        self.releases = [c.release for c in found]
        self.smooth = [Record.of(c.decay, self.options.floor) for c in found]
        return found

    def run(
        self, effects: Sequence[Effect], before: list[Corrected], parts: tuple[Part, ...] = ()
    ) -> Outcome:
        """Simulate what was found, take the defect off and look again, until nothing changes.

        One effect that closes the gap counts more than several that fit a little better. ``parts``
        are on the beam that was simulated before.
        """
        most, found = 1, before
        for _ in range(_ROUNDS + 1):
            report = self._look(effects, found, most)
            if report.interrupted:
                return Outcome(report, (), before, "interrupted")
            if _settled(parts, report):
                if report.verdict != "unknown" or most == self.options.max_effects:
                    break
                most = self.options.max_effects
                continue
            parts = on_the_beam(_simulated_of(report).parts)
            try:
                found = self.simulate(parts)
            except FAILURES as error:
                return Outcome(report, (), before, str(error))
        return Outcome(report, parts, found)

    def _look(
        self, effects: Sequence[Effect], found: Sequence[Corrected], most: int
    ) -> DiagnosisReport:
        decays = [c.decay.between(start) for c, start in zip(found, self.calm, strict=True)]
        test = decays[-1] if self.held_out else None
        chosen = replace(self.options, max_effects=most, catalogue=(*self.general, *effects))
        training = decays[: self.n_training]
        known = chosen, self.form, False
        return diagnose_model(self.model, training, test, self.unsure, {}, *known)

    def placed(
        self,
        found: Outcome,
        effects_at: Callable[[float], Sequence[Effect]],
        slack: Latitude,
    ) -> tuple[Outcome, PlaceOnBeam | None]:
        """Where the effect that was found acts, and what is found with it there.

        Nothing is told where the same effect is not found there again.
        """
        movable = [p for p in found.parts if can_be_anywhere(p)]
        if len(movable) != 1 or len(found.report.best.effects) != 1:
            return found, None
        (part,) = movable
        try:
            place = self.place_of(part, found, slack)
            if not place.told or place.low <= place_now(self.seen, part) <= place.high:
                return found, place
            moved = moved_to(self.seen, part, place.at, self.records[0])
            parts = tuple(moved if p is part else p for p in found.parts)
            there = self.run(effects_at(place.at), self.simulate(parts), parts)
        except FAILURES:  # elsewhere it would have to be stronger than the beam bears
            return found, None
        if there.trouble or there.report.best.names != found.report.best.names:
            return found, place.untold()
        return there, place

    def place_of(self, part: Part, outcome: Outcome, slack: Latitude) -> PlaceOnBeam:
        """Where one of the effects that were found acts; see `find_place`."""
        others = [p for p in outcome.parts if p.effect.name != part.effect.name]
        beams = [
            beam_with(self.seen.beam, [*others, moved_to(self.seen, part, at, self.records[0])])
            for at in points(self.seen.beam)
        ]
        rows = list(zip(self.records, self.raw, outcome.corrected, self.calm, strict=True))
        rows = rows[: self.n_training]
        # From when it is calm, which may be after as many cycles.
        last = [c - r.decay.t[0] + _CYCLES * 2 * np.pi / r.rate for r, *_, c in rows]
        early = [r.until(min(end, float(r.t[-1]))) for (r, *_), end in zip(rows, last, strict=True)]
        tasks = [
            delayed(simulated)(self.seen, beam, record, decay, c.start, c.release)
            for record, (_, decay, c, _) in zip(early, rows, strict=True)
            for beam in beams
        ]
        found = [x[self.records[0].derivative] for x in self.parallel(tasks)]
        n = len(beams)
        moved = [found[n * i :][:n] for i in range(len(rows))]
        measured, heard = [], []
        for record, (_, decay, _, calm) in zip(early, rows, strict=True):
            t = record.decay.t
            measured.append(self.seen.thinned(decay).between(t[0], t[-1]).signal)
            heard.append(replace(record, valid=record.valid & (t >= calm)))
        return find_place(self.seen, heard, measured, moved, slack)


def _simulated_of(report: DiagnosisReport) -> Hypothesis:
    """The best, or the first that is as good and whose effects can all be simulated."""
    for rival in report.rivals:
        if len(on_the_beam(rival.effects)) == len(rival.effects):
            return rival
    return report.best


def _settled(parts: Sequence[Part], report: DiagnosisReport) -> bool:
    """Whether the effects that were simulated are those found, within some standard errors.

    Values that the simulation was unsure of count as well.
    """
    chosen = _simulated_of(report)
    errors = np.sqrt(np.diag(chosen.covariance))
    rows = zip(chosen.parts, chosen.solution.slices(), strict=True)
    after = {_key(p): (p.values, errors[own]) for p, own in rows if on_the_beam([p])}
    before = {_key(p): p.values for p in parts}
    if set(before) != set(after):
        return False
    return all(np.all(np.abs(before[k] - x) <= _SETTLED * e) for k, (x, e) in after.items())


def _key(part: Part) -> tuple[str, str]:
    return part.effect.name, part.effect.variant
