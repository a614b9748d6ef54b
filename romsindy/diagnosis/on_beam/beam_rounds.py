"""Rounds of a diagnosis on a beam: all its sensors, and the modes that ring, are heard as well."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from joblib import delayed

from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.on_beam.all_sensors import (
    Heard,
    Latitude,
    Motion,
    Readings,
    Tried,
    followed,
    weigh,
)
from romsindy.diagnosis.on_beam.defect import (
    FAILURES,
    OnBeam,
    ReleaseLoad,
    read_release,
    ringing,
    simulated,
)
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.parameters import points
from romsindy.diagnosis.on_beam.place import (
    PlaceOnBeam,
    can_be_anywhere,
    moved_to,
    place_now,
)
from romsindy.diagnosis.on_beam.within_tolerances import beam_with
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.rounds import Outcome, Rounds
from romsindy.effects.base import Effect
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.record.decay import Decay

_CYCLES = 12  # once it is calm: over these all sensors are heard
_LISTENED = 3  # times, each with the best so far on the beam
_NEAR = 0.02  # of the gap in the coordinate: so much a wrong place may leave of it
_MOST = 8  # explanations that are simulated
_LEAST_POINTS = 4  # of an effect that can be anywhere

Names = frozenset[str]


class _Start(NamedTuple):
    """How a record begins: coordinate and its rate, the release, one that rings modes more."""

    state: tuple[float, float]
    release: ReleaseLoad
    more: ReleaseLoad


@dataclass(eq=False)
class BeamRounds(Rounds):
    """A beam and its reduced model beside records: also where on it an effect acts."""

    structure: OnBeam
    given: list[ReleaseLoad | None] = field(init=False)  # of the releases, those that are known

    def __post_init__(self) -> None:
        super().__post_init__()
        self.given = list(self.releases)

    @property
    def seen(self) -> InstrumentedBeam:
        """The beam with its sensors."""
        return self.structure.seen

    def over_all_sensors(
        self,
        found: Outcome,
        effects_at: Callable[[Mapping[str, float]], Sequence[Effect]],
        slack: Latitude,
    ) -> tuple[Outcome, PlaceOnBeam | None]:
        """What is found once all sensors, and the modes that ring, have their say; where it acts.

        The beam is simulated with the likeliest effect where it acts, and looked at again, until
        it stays. Nothing is told of a place where the same effect is not found there again.
        """
        place: PlaceOnBeam | None = None
        places: dict[str, float] = {}
        for _ in range(_LISTENED):
            report = found.report
            if found.trouble or report.interrupted or not report.best.effects:
                return found, None
            asked = self.asked(report)
            heard = self.heard(asked, slack)
            before, self.elsewhere = self.elsewhere, _beyond_best(heard)
            best = min((replace(h, elsewhere=self.elsewhere) for h in asked), key=lambda h: h.score)
            place = heard[_names(best)].place if _names(best) in heard else None
            movable = [p for p in best.effects if can_be_anywhere(p)]
            stays = place is None or place.holds(place_now(self.seen, movable[0]))
            if before and stays and best.names == report.best.names:
                return found, place
            parts = self.structure.with_effects(best.parts)
            if not stays and place is not None:
                (part,) = movable
                moved = moved_to(self.seen, part, place.at, self.records[0])
                parts = tuple(moved if p is part else p for p in parts)
                places[part.effect.name] = place.at
            try:
                again = self.run(effects_at(places), self.simulate(parts), parts)
            except FAILURES:  # there it would have to be stronger than the beam bears
                return found, None
            if again.trouble:
                return found, None if place is None else place.untold()
            found = again
        same = place is not None and found.report.best.names == best.names
        return found, place if same or place is None else place.untold()

    def asked(self, report: DiagnosisReport) -> list[Hypothesis]:
        """What the coordinate leaves of explanations, as far as a beam can have them."""
        best = report.best
        gap = report.base.at(best.noise).misfit - best.misfit
        near = [h for h in (best, *report.compared) if h.score < best.score + _NEAR * gap]
        found: dict[Names, Hypothesis] = {}
        for h in near:
            there = len(self.structure.with_effects(h.effects)) == len(h.effects)
            if h.effects and there and len(h.effects) <= len(best.effects):
                found.setdefault(_names(h), h)
        return list(found.values())[:_MOST] or [best]

    def heard(self, asked: Sequence[Hypothesis], slack: Latitude) -> dict[Names, Heard]:
        """What all sensors say of explanations, and of none."""
        rows = list(zip(self.records, self.raw, self.calm, strict=True))[: self.n_training]
        read = [self._read(*row) for row in rows]
        found = [self._without(read)]
        for h in asked:
            self.options.progress(f"all sensors beside {' + '.join(h.names)}")
            found.append(self._tried(h, read))
        tried = [t for t in found if t is not None]
        weighed = weigh(self.seen, read, tried, slack)
        return dict(zip((t.names for t in tried), weighed, strict=True))

    def _read(self, record: Record, raw: Decay, calm: float) -> Readings:
        t = record.decay.t
        own = self.seen.thinned(raw).between(t[0], t[-1])
        # From when it is calm, which may be after as many cycles.
        last = calm + _CYCLES * 2 * np.pi / record.rate
        return Readings.of(record, own, calm, last, self.options.floor)

    def _tried(self, h: Hypothesis, read: Sequence[Readings]) -> Tried | None:
        """The beam with an explanation, at several points if it can be anywhere.

        None where it would have to be stronger than the beam bears.
        """
        parts = self.structure.with_effects(h.parts)
        movable = [p for p in parts if can_be_anywhere(p)]
        anywhere = len(movable) == 1
        at = points(self.seen.beam) if anywhere else []
        elsewhere = [moved_to(self.seen, movable[0], x, self.records[0]) for x in at]
        several = [tuple(m if p is movable[0] else p for p in parts) for m in elsewhere]
        try:
            starts = [self._start(i, parts) for i in range(len(read))]
        except FAILURES:
            return None
        tasks = [
            delayed(_motion)(self.seen, there, *self._early(i, own), start)
            for (i, own), start in zip(enumerate(read), starts, strict=True)
            for there in several or [parts]
        ]
        n, found = len(several or [parts]), list(self.parallel(tasks))
        borne = [j for j in range(n) if all(m is not None for m in found[j::n])]
        if len(borne) < (_LEAST_POINTS if anywhere else 1):
            return None
        motions = [[found[n * i + j] for j in borne] for i in range(len(read))]
        return Tried(_names(h), np.array(at)[borne] if anywhere else None, motions)

    def _start(
        self, i: int, parts: Sequence[Part], start: tuple[float, float] | None = None
    ) -> _Start:
        """How a record begins with some parts."""
        beam = beam_with(self.seen.beam, parts)
        if start is None:
            start = self.structure.start(self.model, parts, self.smooth[i])
        own = self.raw[i].between(self.records[i].decay.t[0])
        release = self.given[i]
        if release is None:
            release = read_release(self.seen, beam, start, own.signal, own.dt, own.derivative)
        modes = self.seen.shapes.shape[1]
        return _Start(start, release, ringing(beam, start, release, modes, own.dt))

    def _early(self, i: int, read: Readings) -> tuple[Record, Decay]:
        return self.records[i].until(float(read.t[-1])), self.raw[i]

    def _without(self, read: Sequence[Readings]) -> Tried | None:
        """The beam as it is, along the first mode as that was measured."""
        motions = []
        for i, own in enumerate(read):
            smooth = self.smooth[i]
            q, q_dot = smooth.motion.start
            begin = self._start(i, (), (float(q), float(q_dot)))
            motion = _motion(self.seen, (), *self._early(i, own), begin)
            if motion is None:
                return None
            measured = smooth.spline(smooth.t[: len(own.t)])[0]
            motions.append([followed(self.seen, own.t, motion, measured)])
        return Tried(frozenset(), None, motions)


def _names(h: Hypothesis) -> Names:
    return frozenset(p.effect.name for p in h.effects)


def _beyond_best(heard: Mapping[Names, Heard]) -> dict[Names, float]:
    least = min(h.misfit for h in heard.values())
    return {names: h.misfit - least for names, h in heard.items()}


def _motion(
    seen: InstrumentedBeam,
    parts: Sequence[Part],
    record: Record,
    decay: Decay,
    start: _Start,
) -> Motion | None:
    """What sensors read of a beam with some parts; None where it bears them not."""
    try:
        beam = beam_with(seen.beam, parts)
        fastest = float(seen.basis.omega[seen.shapes.shape[1] - 1])
        usual, more = (
            simulated(seen, beam, record, decay, start.state, r, fastest)[record.derivative]
            for r in (start.release, start.more)
        )
    except FAILURES:
        return None
    return Motion(usual, more - usual)
