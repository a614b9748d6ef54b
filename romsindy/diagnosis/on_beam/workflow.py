"""What a beam lacks, from decays measured by several sensors: from the records to a better beam.

Rounds simulate the beam, take off what it does beside its reduced model, and look again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from joblib import delayed

from romsindy.beam.beam import Beam
from romsindy.beam.equilibrium import Shape
from romsindy.beam.motion import SensorArray
from romsindy.beam.static_shapes import StaticCurve
from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError
from romsindy.diagnosis.on_beam.defect import FAILURES, OnBeam, ReleaseLoad, simulated
from romsindy.diagnosis.on_beam.instrumented import (
    UNIT,
    InstrumentedBeam,
    checked_readings,
    coarse,
)
from romsindy.diagnosis.on_beam.mounted import BeamEffect, DampingEffect, mounted_effects
from romsindy.diagnosis.on_beam.parameters import (
    damping_effects,
    parameter_effects,
    points,
    standard_deviations,
)
from romsindy.diagnosis.on_beam.place import (
    Latitude,
    PlaceOnBeam,
    can_be_anywhere,
    find_place,
    moved_to,
    place_now,
)
from romsindy.diagnosis.on_beam.report import BeamReport
from romsindy.diagnosis.on_beam.sensor_faults import SensorFault, find_fault
from romsindy.diagnosis.on_beam.within_tolerances import (
    beam_with,
    directions,
    position_error,
    position_gains,
)
from romsindy.diagnosis.rounds import Outcome, Rounds
from romsindy.diagnosis.search import Options
from romsindy.diagnosis.structure import corrected
from romsindy.diagnosis.structure_report import sensor_errors
from romsindy.diagnosis.tolerance_sources import of_references
from romsindy.diagnosis.workflow import diagnose_model
from romsindy.effects import BEAM_CATALOGUE
from romsindy.effects.base import Effect, TermEffect
from romsindy.effects.choices import looked_for
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.fit.refine import refine
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.typing import Array

_CYCLES = 12  # once it is calm: over these the beam is simulated with an effect at several places
_ORDER = 7
# Parameters of a beam that stand for the coefficients of a reduced model.
_FREE = {"omega^2": "bending_stiffness", "c_linear": "mass_damping"}


@dataclass(eq=False)
class BeamRounds(Rounds):
    """A beam and its reduced model beside records: also where on it an effect acts."""

    structure: OnBeam

    @property
    def seen(self) -> InstrumentedBeam:
        """The beam with its sensors."""
        return self.structure.seen

    def placed(
        self, found: Outcome, effects_at: Callable[[float], Sequence[Effect]], slack: Latitude
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


def diagnose_beam(
    beam: Beam,
    measured: Sequence[Decay],
    sensors: SensorArray,
    held_out: Decay | None,
    release: Shape | None,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    options: Options,
    references: Sequence[Decay] = (),
) -> BeamReport:
    """Find, name and add what a beam lacks; arguments as those of `diagnose`.

    The measurement is looked at in the coordinate of the first mode, beside a reduced model of the
    beam. What the beam does beside that model is simulated with the effects that were found, and
    taken off, until the effects stay: they are then fitted to the beam. `BEAM_CATALOGUE`
    and the parameters of the beam replace effects of the catalogue that have the same name; an
    effect of your own with a ``mounting`` is looked for there.
    """
    everything = [*measured, *([held_out] if held_out is not None else [])]
    load = _check(measured, free, release)
    free_names = {_FREE[str(name)] for name in free}
    near = standard_deviations(beam, tolerances)
    everything = [
        checked_readings(d, i, sensors, beam.length)
        for i, d in enumerate([*everything, *references])
    ]
    small = coarse(beam) if release is None else beam  # its load is one of these nodes
    seen = InstrumentedBeam(small, small.sensors(sensors.sensors))
    off = near.get("sensor_positions")
    seen, own, faults, raw = _with_right_sensors(seen, everything, len(measured), off)
    known, raw = raw[len(raw) - len(references) :], raw[: len(raw) - len(references)]
    decays = [seen.thinned(d) for d in raw]
    coordinates = [seen.decay(d) for d in decays]
    training = coordinates[: len(measured)]
    model = calibrated(seen.beam, own)
    curve, shift = seen.curve(float(np.abs(own.q).max())), _frequency_shift(model, training)
    effects_at = partial(_effects, seen, curve, shift, options.catalogue)
    effects = effects_at()
    mounted = {e.name for e in effects}
    general = [e for e in looked_for(options.catalogue, "beam") if e.name not in mounted]
    records = [Record.loud(d, options.floor) for d in coordinates]
    unsure: list[Effect] = [e for e in effects if e.name in free_names and e.name not in near]
    unsure += _within_tolerances(seen, model, records[: len(measured)], effects, near)
    start = None if load is None else ReleaseLoad(load)
    try:
        options, form = _known_errors(seen, model, known, start, options)
        starts: list[ReleaseLoad | None] = [start] * len(records)
        given = (raw, held_out is not None, unsure, general, options, starts, form)
        rounds = BeamRounds(OnBeam(seen), diagnose_model, model, records, *given)
        before = rounds.begin()
    except FAILURES as error:
        raise ValueError(
            f"the beam as it is cannot be simulated over the decays ({error}): check its values,"
            " or let it go from less"
        ) from error
    doubtful = [
        seen.beam.with_effect(p.on_beam(near[p.name]))
        for p in (parameter_effects(seen, curve.reach, names=near) if near else ())
    ]
    slack = Latitude.of(seen, doubtful, position_gains(seen, off or 0.0))
    found, place = rounds.placed(rounds.run(effects, before), effects_at, slack)
    last = decays[-1].between(rounds.calm[-1])
    errors = sensor_errors(seen.sensors.labels, last, (before[-1], found.corrected[-1]))
    whole = InstrumentedBeam(beam, seen.sensors_on(beam))
    return BeamReport(
        reduced=found.report,
        parts=found.parts,
        sensor_errors=errors,
        trouble=found.trouble,
        faults=faults,
        seen=whole,
        place=place,
    )


def _known_errors(
    seen: InstrumentedBeam,
    model: ReducedModel,
    references: Sequence[Decay],
    release: ReleaseLoad | None,
    options: Options,
) -> tuple[Options, FormError]:
    """What the beam leaves on the records that it was updated to: a tolerance, an error of form."""
    if not references:
        return options, NO_FORM_ERROR
    there = []
    for raw in references:
        record = Record.loud(seen.decay(seen.thinned(raw)), options.floor)
        there.append(corrected(OnBeam(seen), model, (), record, raw, release, record).decay)
    left, form = of_references(model, there, options.floor)
    return replace(options, tolerance=options.tolerance.or_more(left)), form


def _with_right_sensors(
    seen: InstrumentedBeam, decays: Sequence[Decay], n_training: int, off: float | None
) -> tuple[InstrumentedBeam, Decay, tuple[SensorFault, ...], list[Decay]]:
    """Leave a faulty sensor out, which the beam's own decay shows: that decay, and the others.

    ``off`` is by how much sensors may be off their places, m: a standard deviation.
    """
    training = decays[:n_training]
    reaches = [float(np.abs(seen.coordinate(d.q)).max()) for d in training]
    reach, largest = max(reaches), training[int(np.argmax(reaches))]
    own = seen.readings(seen.beam, reach, float(largest.t[-1] - largest.t[0]), largest.dt)
    labels = seen.sensors.labels
    gains = None if off is None else position_gains(seen, off)
    fault = find_fault(np.concatenate([d.q for d in training]), own, seen.shapes, labels, gains)
    kept = [i for i in range(len(labels)) if fault is None or i != fault.channel]
    seen = seen.keeping(kept)
    simulated = Decay(largest.dt * np.arange(len(own)), seen.coordinate(own[:, kept]), unit=UNIT)
    return seen, simulated, () if fault is None else (fault,), [_channels(d, kept) for d in decays]


def _channels(decay: Decay, kept: Sequence[int]) -> Decay:
    return replace(decay, **{n: x[:, kept] for n, x in decay.signals.items()})


def _effects(
    seen: InstrumentedBeam,
    curve: StaticCurve,
    shift: float,
    catalogue: Sequence[Effect],
    at: float | None = None,
) -> tuple[BeamEffect, ...]:
    """Effects in the form that they have on this beam; the user's own first.

    Those that may be anywhere are at ``at``, m; by default where the first mode moves most.
    """
    known = {e.name for e in BEAM_CATALOGUE}
    own = [e for e in catalogue if isinstance(e, TermEffect) and e.name not in known]
    mounted = mounted_effects(curve, [*own, *BEAM_CATALOGUE], at)
    parameters = parameter_effects(seen, curve.reach, shift, at=at)
    return (*damping_effects(curve), *mounted, *parameters)


def _within_tolerances(
    seen: InstrumentedBeam,
    model: ReducedModel,
    records: Sequence[Record],
    effects: Sequence[BeamEffect],
    near: Mapping[str, float],
) -> list[Effect]:
    """What stands for parameters that are known to a standard deviation."""
    reach = max(r.amplitude for r in records)
    known = parameter_effects(seen, reach, names=near) if near else ()
    alike = [p for p in known if not p.sign]
    apart = [*(p for p in known if p.sign), *(e for e in effects if isinstance(e, DampingEffect))]
    found: list[Effect] = [replace(e, tolerance=near[e.name]) for e in apart if e.name in near]  # type: ignore[type-var]
    if "sensor_positions" in near:
        found.append(position_error(seen, near["sensor_positions"]))
    deviations = np.array([near[p.name] for p in alike])
    return found + list(directions(model, records, alike, deviations) if alike else ())


def calibrated(beam: Beam, simulated: Decay) -> ReducedModel:
    """Reduced model of a beam that follows its own simulated decay.

    The static reduction is the start; the highest inertia terms stay as they are there.
    """
    reach = float(np.abs(simulated.q).max())
    static = beam.reduce(order=_ORDER, amplitude=1.05 * reach).coefficients
    omega2 = static["omega^2"]
    damping = {"c_linear": beam.alpha + beam.eta * omega2, "c_q^2 q_dot": 0.0}
    start = ReducedModel.from_coefficients({**static, **damping}, unit=UNIT)
    fitted = refine(start, simulated, fixed=("Upsilon_6", "Upsilon_7"))
    return replace(fitted.single_model, amplitude_range=None)


def _frequency_shift(model: ReducedModel, decays: Sequence[Decay]) -> float:
    """By how much omega^2 of the measured decays differs from the model's, 1/s^2."""
    fixed = [key for key in model.coefficients if key not in ("omega^2", "c_linear")]
    fitted = refine(model, [d.free() for d in decays], fixed=fixed)
    return fitted.model.coefficients["omega^2"] - model.coefficients["omega^2"]


def _check(
    several: Sequence[Decay], free: Sequence[str | Effect], release: Shape | None
) -> Array | None:
    """Refuse what cannot be meant; return the load of the release."""
    if not several:
        raise ValueError("measured is empty: give at least one Decay")
    if not set(free) <= set(_FREE):
        raise ValueError(f"free = {list(free)}: of a beam, {list(_FREE)} can be free")
    if release is not None and not np.any(release.load):
        raise ValueError(
            "release is held by no load: give a shape of beam.release_shape(...) or"
            " beam.equilibrium(load), or leave it out to read the load from the sensors"
        )
    return None if release is None else release.load
