"""Rounds of a diagnosis on a beam: all its sensors, and the modes that ring, are heard as well."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, cast

import numpy as np
from joblib import delayed

from romsindy.beam.beam import Beam
from romsindy.diagnosis.all_sensors import Readings, followed
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.found import family_of
from romsindy.diagnosis.gap import HELD_OUT, name_of
from romsindy.diagnosis.on_beam.all_sensors import (
    Heard,
    Latitude,
    SimulatedReadings,
    TriedOnBeam,
    left_of,
    weigh,
)
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import PlaceOnBeam, points
from romsindy.diagnosis.on_beam.parameters import (
    ParameterEffect,
    can_be_anywhere,
    moved_to,
    place_now,
    that_do_the_same,
    with_error_of_place,
)
from romsindy.diagnosis.on_beam.release import (
    FAILURES,
    STAND_INS,
    BeamRelease,
    OnBeam,
    read_release,
    ringing,
    rung_by,
    simulated,
)
from romsindy.diagnosis.on_beam.within_tolerances import (
    Opened,
    beam_with,
    linear,
    on_the_beam,
)
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.rounds import Names, Outcome, Rounds, names_of, undecided
from romsindy.diagnosis.structure import Corrected, as_measured, key_of
from romsindy.effects.base import Effect
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record, scales
from romsindy.fit.verdict import EQUIVALENT
from romsindy.record.decay import Decay
from romsindy.typing import Array

_COHERENT = 0.1  # of a motion: so far may a beam be from it, and do the same beside its model
_LOUD = 0.1  # of a motion: where other modes change it by so much, it is not that of the first
_LISTENED = 3  # times, each with the best so far on the beam
_MOST, _FEW = 8, 4  # explanations that are simulated; where values alone do as well
_FINER = 3  # times that points are added about the place of an effect
_ELSEWHERE = 0.02  # of the length: so far from where it was taken to act
# Times that open values are moved; radians of a higher mode that may be left, and that are few
_MOVED, _TURNED, _ALIKE = 4, 0.1, 0.5
_RINGS = 0.25  # times `ringing`: what a release may ring more


def _as_little(h: Hypothesis, than: Hypothesis) -> bool:
    """Whether something linear that no value of the beam stands for leaves as little as values."""
    left, least = (x.misfit + x.misfit_elsewhere for x in (h, than))
    return h.names == tuple(names_of(h)) and _unforeseen(h) and left <= least + EQUIVALENT


def _unforeseen(h: Hypothesis) -> bool:
    """Whether it is one linear effect, a clamp, a mass or a damper, and no value of the beam."""
    values = (isinstance(p.effect, ParameterEffect) and not p.effect.sign for p in h.effects)
    return len(h.effects) == 1 and linear(h.effects) and not any(values)


def _far(record: Record, signal: Array) -> float:
    """How far another signal is from a record, over its motion."""
    return float(np.std(record.signal - signal) / np.std(record.signal))


def _off(record: Record, sensed: Array) -> Array:
    """What a record has more of than a simulated coordinate: omega^2, c_linear.

    At equal amplitudes: with another damping the beam is soon at others.
    """
    size, *measured = _courses(record)
    others, *simulated = _courses(as_measured(record, sensed))
    reached = (size > others.min()) & (size < others.max())
    if not np.any(reached):
        return np.zeros(2)
    order = np.argsort(others)
    more = [
        np.mean(x[reached] - np.interp(size[reached], others[order], y[order]))
        for x, y in zip(measured, simulated, strict=True)
    ]
    return 2 * np.array(more) * [record.rate, 1.0]


def _courses(record: Record) -> tuple[Array, Array, Array]:
    """Amplitude, angular frequency and rate of decay of a record, once a cycle."""
    size = np.abs(record.spline.amplitudes(record.t)[:, 1])
    faster = np.gradient(record.phase(record.t), record.t)
    smaller = -np.gradient(np.log(size), record.t)
    return size[record.cycles], faster[record.cycles], smaller[record.cycles]


class _Begun(NamedTuple):
    """How a record begins: coordinate and its rate, the release, one that rings modes more.

    ``ring`` is what more of the modes does, once it is known for an effect nearby.
    """

    state: tuple[float, float]
    release: BeamRelease
    more: BeamRelease
    ring: Array | None = None

    def rung_by(self, by: Array) -> _Begun:
        """The same where higher modes ring so many times by what they ring more."""
        release = rung_by(self.release, self.more, by)
        # ... and as much more than that as before
        return self._replace(release=release, more=rung_by(self.release, self.more, by + 1))


@dataclass(eq=False)
class BeamRounds(Rounds):
    """A beam and its reduced model beside records: also where on it an effect acts."""

    structure: OnBeam
    # Combinations of values within tolerances that the first mode does not see; whether values of
    # the beam are known within tolerances
    unseen: tuple[Part, ...] = ()
    tolerant: bool = False
    given: list[BeamRelease | None] = field(init=False)  # of the releases, those that are known
    told: dict[str, PlaceOnBeam] = field(default_factory=dict)  # by name of an effect, once moved
    # What higher modes say of the values beside an explanation: its names, and changes by key
    more: tuple[Names, Mapping[tuple[str, str], Array]] = (frozenset(), {})
    # What all sensors are left with beside explanations, over the noise, with higher modes as they
    # may be
    with_modes: dict[Names, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.given = list(self.releases)

    @property
    def seen(self) -> InstrumentedBeam:
        """The beam with its sensors."""
        return self.structure.seen

    @property
    def loud(self) -> tuple[str, ...]:
        """Records that say nothing of the coordinate, as they are called."""
        names = [name_of(i) for i in range(self.n_training)] + [HELD_OUT] * self.held_out
        return tuple(name for i, name in enumerate(names) if i not in self.clear)

    def _depends_on_start(self, parts: tuple[Part, ...], found: Corrected, record: Record) -> bool:
        """As of any structure, but where all sensors tell how the record starts."""
        return found.release.state is None and super()._depends_on_start(parts, found, record)

    def near_the_records(
        self, effects: Sequence[Effect], found: list[Corrected]
    ) -> tuple[list[Corrected], tuple[Part, ...]]:
        """The beam with what brings it near the records, where it is far from them as it is.

        Its defect goes with its motion: a beam of another frequency or damping has another. Density
        and damping of the mass stand for whatever is missing, until that is known. A record in
        which the defect is as loud as what is looked for says little of the coordinate.
        """
        parts: tuple[Part, ...] = ()
        if self._farthest(found) > _COHERENT:
            given, parts = found, self._stand_ins(effects, found)
            try:
                found = self.simulate(parts)
                nearer = self._farthest(found) < self._farthest(given)
            except FAILURES:
                nearer = False
            if not nearer:
                found, parts = given, ()
                self.return_to(found)
        pairs = enumerate(zip(self.records, found, strict=True))
        clear = [i for i, (record, own) in pairs if _far(record, own.decay.signal) < _LOUD]
        if clear and clear[0] < self.n_training:
            self.clear = clear
        return found, parts

    def _farthest(self, found: Sequence[Corrected]) -> float:
        """How far what was simulated is from the record that it is farthest from."""
        return max(_far(record, sensed) for record, _, sensed in self._rows(found))

    def _rows(self, found: Sequence[Corrected]) -> list[tuple[Record, Corrected, Array]]:
        """Records beside what was simulated, and its coordinate."""
        sensed = [self.structure.coordinate(c.readings) for c in found]
        return list(zip(self.records, found, sensed, strict=True))

    def _stand_ins(self, effects: Sequence[Effect], found: Sequence[Corrected]) -> tuple[Part, ...]:
        """Density and damping of the mass by which the records differ from what was simulated."""
        rows = self._rows(found)[: self.n_training]
        # A record in which other modes are loud tells little of the first.
        weights = [1 / _far(record, own.decay.signal) ** 2 for record, own, _ in rows]
        off = [_off(record, sensed) for record, _, sensed in rows]
        omega2, c_linear = np.average(off, axis=0, weights=weights)
        by_name = {e.name: e for e in effects}
        density, damping = (by_name[name] for name in STAND_INS)
        change = omega2 / density.linear_shift(rows[0][0].rate ** 2)  # type: ignore[attr-defined]
        return self._stand_in(density, change), self._stand_in(damping, c_linear)

    def _stand_in(self, effect: Effect, strength: float) -> Part:
        """A linear effect with a strength that it can have."""
        part = Part.of(effect, scales(self.records), len(self.records))
        least, most = (x[0] for x in part.limits())
        return replace(part, strengths=np.full((1, 1), np.clip(strength, least, most)))

    def sought(self, effects: Sequence[Effect], parts: Sequence[Part]) -> list[Effect]:
        """Effects to look for: those that are on the beam already where they are.

        The first mode says little of places; all sensors do, once it has told what acts.
        """
        movable = [p.effect for p in parts if can_be_anywhere(p.effect)]
        there = {e.name: place_now(self.seen, e) for e in movable}
        return [
            e for e in effects if e.name not in there or place_now(self.seen, e) == there[e.name]
        ]

    def run(
        self, effects: Sequence[Effect], before: list[Corrected], parts: tuple[Part, ...] = ()
    ) -> Outcome:
        """As of any structure; records left out come back where the others lack nothing.

        They are the loudest: what acts beyond an amplitude may be in them alone.
        """
        found = super().run(effects, before, parts)
        if found.report.verdict != "none" or not self.loud:
            return found
        self.clear = list(range(len(self.records)))
        return super().run(effects, found.corrected, found.parts)

    def _simulated_of(self, report: DiagnosisReport) -> Hypothesis:
        """Of a family that does the same to the first mode, a member whose place is known.

        Elsewhere than where it acts an effect moves the other modes otherwise, and where these are
        loud the first as well. All sensors tell places, once one of the family is on the beam.
        """
        best = super()._simulated_of(report)
        if not any(map(self._somewhere, best.effects)):
            return best
        for h in report.rivals:
            alike = family_of([h.names, best.names]) is not None
            if self.can_have(h.effects) and alike and not any(map(self._somewhere, h.effects)):
                return h
        return best

    def _somewhere(self, part: Part) -> bool:
        """Whether an effect can be anywhere, and nothing said yet where."""
        return can_be_anywhere(part.effect) and part.effect.name not in self.told

    def in_equation(self, parts: Sequence[Part]) -> Sequence[Part]:
        """What the first mode says of parts that are on the beam."""
        of, more = self.more
        if of != self._names(parts):
            return parts
        return on_the_beam([p.moved(-more[key_of(p)]) if key_of(p) in more else p for p in parts])

    def next_parts(self, parts: Sequence[Part], found: Sequence[Part]) -> tuple[Part, ...]:
        """What was found, and by how much more higher modes move the values beside it."""
        of, more = self.more
        if of != self._names(found):
            return super().next_parts(parts, found)
        there = [*found, *self.unseen]
        return on_the_beam([p.moved(more[key_of(p)]) if key_of(p) in more else p for p in there])

    def _names(self, parts: Sequence[Part]) -> Names:
        """Names of the effects among parts, beside what follows the data."""
        known = {e.name for e in self.unsure} | {p.effect.name for p in self.unseen}
        return frozenset(p.effect.name for p in on_the_beam(parts)) - known

    def over_all_sensors(
        self,
        found: Outcome,
        effects_at: Callable[[Mapping[str, float]], Sequence[Effect]],
        slack: Latitude,
    ) -> tuple[Outcome, PlaceOnBeam | None]:
        """What is found once all sensors, and the modes that ring, have their say; where it acts.

        The beam is simulated with the likeliest effect where it acts, and looked at again, until
        that is what is found. Nothing is told of a place where it is not.
        """
        agreed, place = False, None
        heard_of: list[tuple[Names, Names]] = []  # what all sensors said, and what was found then
        for _ in range(_LISTENED):
            report = found.report
            silent = report.verdict == "none" or not report.best.effects
            if found.trouble or (silent and not self.tolerant):
                return found, None
            if self.options.over:
                return found._replace(report=replace(report, interrupted=True)), None
            asked = self._asked(report)
            try:
                heard = self.heard(report, asked, slack)
                asked = [h for h in asked if names_of(h) in heard or report.best.effects]
                if self.tolerant:
                    asked = [report.base, *asked]
                best = self.likeliest(asked, {names: h.misfit for names, h in heard.items()})
                said = heard.get(names_of(best))
                place = None if said is None else said.place
                parts, moved = self._placed(best, said)
                loud = any(r.state for r in self.releases)
                if best.names == report.best.names and not (moved or loud or self.tolerant):
                    again = self.run(effects_at(self.places), found.corrected, found.parts)
                else:
                    self.releases = [self._start(i, parts).release for i in range(len(self.raw))]
                    again = self.run(effects_at(self.places), self.simulate(parts), parts)
            except FAILURES:  # there it would have to be stronger than the beam bears
                return found, None
            if again.trouble:
                break
            found, agreed = again, again.report.best.names == best.names
            heard_of.append((names_of(best), names_of(again.report.best)))
            if heard_of[-1] in heard_of[:-1]:
                break
            # A release is read with what acts: where that is elsewhere, it was another.
            if agreed and moved < _ELSEWHERE * self.seen.beam.length:
                break
        found = found._replace(report=undecided(found.report, self.doubtful))
        if agreed:
            return self._with_error(found, place)
        return found, None if place is None else place.untold()

    def no_less(self, report: DiagnosisReport) -> DiagnosisReport:
        """A report that tells what does exactly the same to this beam beside what it names.

        Beside values that are further off than their tolerances let expect it tells what is linear
        and leaves as little: that one is likelier beforehand is no evidence.
        """
        if report.best.beyond and not report.best.effects:
            return undecided(
                report, {names_of(h): h for h in report.compared if _as_little(h, report.best)}
            )
        alike = that_do_the_same(self.seen.beam)
        there = [
            h for h in (report.best, *report.compared) if 0 < len(h.names) and {*h.names} <= alike
        ]
        if report.best not in there:
            return report
        return undecided(report, {names_of(h): h for h in there})

    @property
    def places(self) -> dict[str, float]:
        """Where effects act, by name, m."""
        return {name: place.at for name, place in self.told.items()}

    def _with_error(
        self, found: Outcome, place: PlaceOnBeam | None
    ) -> tuple[Outcome, PlaceOnBeam | None]:
        """The same with the error of its place in its strength."""
        if place is None:
            return found, None
        report = found.report
        best, place = with_error_of_place(self.seen, report.best, place, self.records[0])
        rivals = tuple(best if h is report.best else h for h in report.rivals)
        return found._replace(report=replace(report, best=best, rivals=rivals)), place

    def _asked(self, report: DiagnosisReport) -> list[Hypothesis]:
        """Explanations that all sensors are asked of; values alone leave next to nothing.

        A clamp, a mass or a damper the first mode hardly tells from values within tolerances: where
        it is about as likely as these, higher modes may ask for it.
        """
        best = report.best
        near = {names_of(h): h for h in self.near(report, _MOST) or [best]} if best.effects else {}
        most = report.base.at(best.noise).score + EQUIVALENT
        found: dict[Names, Hypothesis] = {}
        for h in (*report.rivals, *self.doubtful.values(), *report.compared):
            asked = _unforeseen(h) and h.score < most if best.effects else len(h.effects) == 1
            if asked and self.structure.with_effects(h.effects):
                found.setdefault(names_of(h), h)
        more = list(found.items())[:_FEW] if self.tolerant or not best.effects else []
        return list({**dict(more), **near}.values())

    def _placed(self, best: Hypothesis, said: Heard | None) -> tuple[tuple[Part, ...], float]:
        """An explanation on the beam, as all sensors say that it is; how far it moved, m."""
        before = Opened.of(best, self.unseen)
        if said is None:
            return on_the_beam(before.parts), 0.0
        apart, place = 0.0, said.place
        if place is not None:
            (part,) = (p for p in on_the_beam(before.parts) if can_be_anywhere(p.effect))
            now, usual = place_now(self.seen, part.effect), self.seen.usual
            at = next((x for x in (usual, now) if place.holds(x)), place.at)
            if at != now:
                self.told[part.effect.name] = replace(place, at=at)
                moved = moved_to(self.seen, part, at, self.records[0])
                before, apart = before.with_part(part, moved), abs(at - now)
        after = before.moved(said.off)
        self.more = names_of(best), after.changes(before)
        return on_the_beam(after.parts), apart

    def heard(
        self, report: DiagnosisReport, asked: Sequence[Hypothesis], slack: Latitude
    ) -> dict[Names, Heard]:
        """What all sensors say of explanations, and of values alone."""
        rows = list(zip(self.records, self.raw, self.calm, strict=True))[: self.n_training]
        read = [self._read(*row) for row in rows]
        found: list[TriedOnBeam | None] = [self._alone(report.base, read, slack)]
        for h in asked:
            self.options.progress(f"all sensors beside {' + '.join(h.names)}")
            found.append(self._tried(h, read, slack))
        tried = [t for t in found if t is not None]
        self.with_modes |= {t.names: t.rms for t in tried}
        weighed = weigh(tried, read, self.seen)
        return dict(zip((t.names for t in tried), weighed, strict=True))

    def _read(self, record: Record, raw: Decay, calm: float) -> Readings:
        t = record.decay.t
        own = self.seen.thinned(raw).between(t[0], t[-1])
        return Readings.of(record, own, calm, self.options.floor)

    def _tried(
        self, h: Hypothesis, read: Sequence[Readings], slack: Latitude
    ) -> TriedOnBeam | None:
        """The beam with an explanation, at several points if it can be anywhere.

        None where it would have to be stronger than the beam bears.
        """
        opened = Opened.of(h, self.unseen)
        try:
            starts = [self._start(i, opened.parts) for i in range(len(read))]
            ((left, off, begun),) = self._left([(opened, starts)], read, slack)
            opened = opened.moved(off)  # elsewhere values are nearly the same
            movable = [p for p in on_the_beam(opened.parts) if can_be_anywhere(p.effect)]
            if len(movable) != 1:
                return TriedOnBeam(names_of(h), None, left[:, None], off[None])
            starts = [s._replace(ring=None) for s in begun]
            everywhere = points(self.seen.beam)
            told = self.told.get(movable[0].effect.name)
            places = everywhere if told is None else told.about(everywhere)
            tried, several = self._at(places, opened, starts, read, slack)
            if self._place(tried, read).cut_off(places, everywhere):  # it may be elsewhere by now
                places = everywhere
                tried, several = self._at(places, opened, starts, read, slack)
            for _ in range(_FINER):  # what turns fast from point to point is no spline between
                place = self._place(tried, read)
                if not (finer := place.between(tried.points)):
                    break
                near = several[int(np.argmin(np.abs(np.subtract(places, place.at))))]
                tried = tried.joined(self._at(finer, opened, near, read, slack)[0])
        except FAILURES:
            return None
        return replace(tried, names=names_of(h))

    def _place(self, tried: TriedOnBeam, read: Sequence[Readings]) -> PlaceOnBeam:
        """Where all sensors say that an effect acts, which was tried at several points."""
        ((_, place, _),) = weigh([tried], read, self.seen)
        return cast(PlaceOnBeam, place)

    def _at(
        self,
        places: Sequence[float],
        opened: Opened,
        starts: Sequence[_Begun],
        read: Sequence[Readings],
        slack: Latitude,
    ) -> tuple[TriedOnBeam, list[list[_Begun]]]:
        """The beam with an effect that can be anywhere, at some points; how it begins at each."""
        (part,) = (p for p in on_the_beam(opened.parts) if can_be_anywhere(p.effect))
        moved = [moved_to(self.seen, part, at, self.records[0]) for at in places]
        several = [opened.with_part(part, m) for m in moved]
        # The coordinate begins otherwise with the same effect elsewhere, the release is the same.
        begun = [
            [
                s._replace(state=s.release.state or self._state(i, there.parts))
                for i, s in enumerate(starts)
            ]
            for there in several
        ]
        heard = self._left(list(zip(several, begun, strict=True)), read, slack)
        left, off, starts = zip(*heard, strict=True)
        names = frozenset({part.effect.name})
        tried = TriedOnBeam(names, np.array(places), np.stack(left, axis=1), np.array(off))
        return tried, list(starts)

    def _state(self, i: int, parts: Sequence[Part]) -> tuple[float, float]:
        """Coordinate and its rate at the start of a record."""
        return self.structure.start(self.model, on_the_beam(parts), self.smooth[i])

    def _left(
        self,
        several: Sequence[tuple[Opened, Sequence[_Begun]]],
        read: Sequence[Readings],
        slack: Latitude,
        measured: Sequence[Array] | None = None,
    ) -> list[tuple[Array, Array, list[_Begun]]]:
        """What beams with some parts, that begin each record somehow, leave: see `_left`."""
        rows = zip(self.records, self.raw, read, strict=False)
        early = [(record.until(float(own.t[-1])), raw) for record, raw, own in rows]
        given = (early, read, slack, self.tolerant, measured)
        tasks = (delayed(_left)(self.seen, opened, starts, *given) for opened, starts in several)
        return list(self.parallel(tasks))

    def _start(
        self, i: int, parts: Sequence[Part], start: tuple[float, float] | None = None
    ) -> _Begun:
        """How a record begins with some parts."""
        beam = beam_with(self.seen.beam, parts)
        start = self._state(i, parts) if start is None else start
        own = self.raw[i].between(self.records[i].decay.t[0])
        release = self.given[i]
        if release is None:
            measured = own.signal, own.dt, own.derivative
            release = read_release(self.seen, beam, start, *measured, near=self.releases[i])
        modes = self.seen.shapes.shape[1]
        start = release.state or start
        return _Begun(start, release, ringing(beam, start, release, modes, own.dt))

    def _alone(self, base: Hypothesis, read: Sequence[Readings], slack: Latitude) -> TriedOnBeam:
        """The beam with values alone, which leaves the less of two.

        As any explanation; where something acts its first mode soon moves otherwise: it may move
        as it was measured, which is as exact as the other modes follow it.
        """
        both = self._tried(base, read, slack), self._along(base, read, slack)
        return min((t for t in both if t is not None), key=lambda t: t.rms)

    def _along(self, base: Hypothesis, read: Sequence[Readings], slack: Latitude) -> TriedOnBeam:
        """The beam with values alone, along the first mode as that was measured."""
        opened, starts, measured = Opened.of(base, self.unseen), [], []
        for i, own in enumerate(read):
            smooth = self.smooth[i]
            q, q_dot = smooth.motion.start
            starts.append(self._start(i, opened.parts, (float(q), float(q_dot))))
            measured.append(smooth.spline(smooth.t[: len(own.t)])[0])
        ((left, off, _),) = self._left([(opened, starts)], read, slack, measured)
        return TriedOnBeam(frozenset(), None, left[:, None], off[None])


def _left(
    seen: InstrumentedBeam,
    opened: Opened,
    starts: Sequence[_Begun],
    early: Sequence[tuple[Record, Decay]],
    read: Sequence[Readings],
    slack: Latitude,
    tolerant: bool,
    measured: Sequence[Array] | None,
) -> tuple[Array, Array, list[_Begun]]:
    """What a beam with some parts leaves of all sensors (m,), and how each record begins with them.

    Values that the first mode leaves open are moved until higher modes move as they were measured;
    ``off`` (n,) is how far. The first mode moves as it was ``measured``, where that is given.
    """
    values = opened.values(seen) if tolerant else None
    best: tuple[Array, Array, list[_Begun]] | None = None
    for _ in range(_MOVED):
        beam = beam_with(seen.beam, opened.parts)
        pairs = zip(early, starts, strict=True)
        motions = [_motion(seen, beam, *own, start) for own, start in pairs]
        if measured is not None:
            rows = zip(motions, measured, read, strict=True)
            motions = [
                m._replace(readings=followed(m.readings, seen.coordinate(m.readings), q, r.t))
                for m, q, r in rows
            ]
        found = left_of(seen, read, motions, slack, values)
        if best is not None and found.left @ found.left >= best[0] @ best[0]:
            break  # what came nearer stands
        starts = [s._replace(ring=m.ring) for s, m in zip(starts, motions, strict=True)]
        best = found.left, opened.off, starts
        rings = max(float(np.abs(x).max(initial=0.0)) for x in found.more)
        if values is None or (found.turns < _TURNED and rings < _RINGS):
            break
        opened = opened.moved(found.step)
        values = values._replace(off=opened.off)
        starts = [s.rung_by(x) for s, x in zip(starts, found.more, strict=True)]
        if found.turns > _ALIKE:  # what rings more goes with the frequencies of its beam
            starts = [s._replace(ring=None) for s in starts]
    assert best is not None
    return best


def _motion(
    seen: InstrumentedBeam, beam: Beam, record: Record, decay: Decay, start: _Begun
) -> SimulatedReadings:
    """What sensors read of a beam."""

    def readings(release: BeamRelease) -> Array:
        found = simulated(seen, beam, record, decay, start.state, release, seen.fastest)
        return found[record.derivative]

    usual = readings(start.release)
    ring = readings(start.more) - usual if start.ring is None else start.ring
    return SimulatedReadings(usual, ring)
