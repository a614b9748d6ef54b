"""What a beam lacks, from decays measured by several sensors: from the records to a better beam.

Rounds simulate the beam, take off what it does beside its reduced model, and look again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from romsindy.beam.beam import Beam
from romsindy.beam.equilibrium import Shape
from romsindy.beam.motion import SensorArray
from romsindy.beam.static_shapes import StaticCurve
from romsindy.diagnosis.arguments import of_references
from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError
from romsindy.diagnosis.on_beam.all_sensors import Latitude, SensorFault, find_fault
from romsindy.diagnosis.on_beam.beam_rounds import BeamRounds
from romsindy.diagnosis.on_beam.instrumented import UNIT, InstrumentedBeam, checked_readings, coarse
from romsindy.diagnosis.on_beam.mounted import BeamEffect, DampingEffect, mounted_effects
from romsindy.diagnosis.on_beam.parameters import (
    PLACED_MASS,
    damping_effects,
    parameter_effects,
    standard_deviations,
)
from romsindy.diagnosis.on_beam.release import FAILURES, BeamRelease, OnBeam
from romsindy.diagnosis.on_beam.report import BeamReport
from romsindy.diagnosis.on_beam.within_tolerances import (
    ParameterDirection,
    directions,
    masked,
    position_error,
    position_gains,
    slopes,
)
from romsindy.diagnosis.rounds import names_of
from romsindy.diagnosis.search import Options, Request
from romsindy.diagnosis.structure import corrected, sensor_errors
from romsindy.diagnosis.workflow import diagnose_model
from romsindy.effects import BEAM_CATALOGUE
from romsindy.effects.base import Effect, TermEffect
from romsindy.effects.choices import looked_for
from romsindy.effects.outside import SecondMode
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.arguments import free_names
from romsindy.fit.records.record import Record, scales
from romsindy.fit.refine import refine
from romsindy.fit.results.fitted import refined
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.typing import Array

_ORDER = 7
# Of the largest reading: so closely a model follows a simulated decay. There is no noise in that,
# and without a floor what other modes do between the harmonics would count for nothing.
_FOLLOWED = 1e-3
# Parameters of a beam that stand for the coefficients of a reduced model.
_FREE = {"omega^2": "bending_stiffness", "c_linear": "mass_damping"}


def diagnose_beam(
    beam: Beam,
    request: Request,
    sensors: SensorArray,
    release: Shape | None,
    references: Sequence[Decay],
) -> BeamReport:
    """Find, name and add what a beam lacks; arguments as those of `diagnose`.

    The measurement is looked at in the coordinate of the first mode, beside a reduced model of the
    beam. What the beam does beside that model is simulated with the effects that were found, and
    taken off, until the effects stay: they are then fitted to the beam. `BEAM_CATALOGUE`
    and the parameters of the beam replace effects of the catalogue that have the same name; an
    effect of your own with a ``mounting`` is looked for there.
    """
    load, options, measured = _check(request, release), request.options, request.measured
    free_names = {_FREE[str(name)] for name in request.free}
    near = standard_deviations(beam, request.tolerances)
    everything = [
        checked_readings(d, i, sensors, beam.length)
        for i, d in enumerate([*request.everything, *references])
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
    tolerant = bool(near.keys() - {"sensor_positions"})
    # A beam whose values are known to tolerances has other modes of its own that are a little off.
    taken = mounted | ({SecondMode.name} if tolerant else set())
    general = [e for e in looked_for(options.catalogue, "beam") if e.name not in taken]
    records = [Record.loud(d, options.floor) for d in coordinates]
    unsure: list[Effect] = [e for e in effects if e.name in free_names and e.name not in near]
    unsure += _within_tolerances(seen, model, records[: len(measured)], effects, near)
    unseen = [e for e in unsure if isinstance(e, ParameterDirection) and not e.seen]
    unsure = [e for e in unsure if e not in unseen]
    start = None if load is None else BeamRelease(load)
    try:
        options, form = _known_errors(seen, model, known, start, options)
        starts: list[BeamRelease | None] = [start] * len(records)
        given = (raw, request.held_out is not None, unsure, general, options, starts, form)
        rounds = BeamRounds(OnBeam(seen), diagnose_model, model, records, *given)
        rounds.unseen = tuple(Part.of(e, scales(records), len(records)) for e in unseen)
        rounds.tolerant = tolerant
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
    damping = near.get("mass_damping", 0.0), near.get("material_damping", 0.0)
    places = (off or 0.0) * slopes(seen)
    slack = Latitude.of(seen, doubtful, damping, places)
    beside = Latitude.of(seen, (), (0.0, 0.0), places)  # what values do is known where they move
    first = rounds.run(effects, *rounds.near_the_records(effects, before))
    found, place = rounds.over_all_sensors(first, effects_at, beside)
    found = found._replace(report=rounds.no_less(found.report)).or_before(before)
    last = decays[-1].between(rounds.calm[-1])
    errors = sensor_errors(seen.sensors.labels, last, (before[-1], found.corrected[-1]))
    whole = InstrumentedBeam(beam, seen.sensors_on(beam))
    told = found.report
    alone = tolerant and not (told.best.effects or found.trouble or told.verdict == "unknown")
    near_by = [Part.of(e, scales(records), len(records)) for e in unsure]
    return BeamReport(
        reduced=replace(found.report, gap=replace(found.report.gap, sensor=seen.shown)),
        parts=found.parts,
        sensor_errors=errors,
        trouble=found.trouble,
        faults=faults,
        seen=whole,
        slack=slack,
        place=place,
        loud=rounds.loud,
        masked=masked(seen, told.best, near_by, effects, near) if alone else (),
        with_modes=rounds.with_modes.get(names_of(found.report.best)),
    )


def _known_errors(
    seen: InstrumentedBeam,
    model: ReducedModel,
    references: Sequence[Decay],
    release: BeamRelease | None,
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
    right = seen.beam.sensors([seen.sensors.sensors[i] for i in kept])
    seen = InstrumentedBeam(seen.beam, right)
    simulated = Decay(largest.dt * np.arange(len(own)), seen.coordinate(own[:, kept]), unit=UNIT)
    measured = [replace(d, **{n: x[:, kept] for n, x in d.signals.items()}) for d in decays]
    return seen, simulated, () if fault is None else (fault,), measured


def _effects(
    seen: InstrumentedBeam,
    curve: StaticCurve,
    shift: float,
    catalogue: Sequence[Effect],
    places: Mapping[str, float] | None = None,
) -> tuple[BeamEffect, ...]:
    """Effects in the form that they have on this beam; the user's own first.

    Those that may be anywhere are where ``places`` say, m by name; by default where the first mode
    moves most.
    """
    known = {e.name for e in BEAM_CATALOGUE}
    own = [e for e in catalogue if isinstance(e, TermEffect) and e.name not in known]
    mounted = mounted_effects(curve, [*own, *BEAM_CATALOGUE], places)
    at = (places or {}).get(PLACED_MASS)
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
    damping = {"c_linear": beam.alpha + beam.eta * static["omega^2"], "c_q^2 q_dot": 0.0}
    start = ReducedModel.from_coefficients({**static, **damping}, unit=UNIT)
    free = free_names(start, ("Upsilon_6", "Upsilon_7"))
    fitted = refined(start, free, (Record.of(simulated, _FOLLOWED),))
    return replace(fitted.single_model, amplitude_range=None)


def _frequency_shift(model: ReducedModel, decays: Sequence[Decay]) -> float:
    """By how much omega^2 of the measured decays differs from the model's, 1/s^2."""
    fixed = [key for key in model.coefficients if key not in ("omega^2", "c_linear")]
    fitted = refine(model, [d.free() for d in decays], fixed=fixed)
    return fitted.model.coefficients["omega^2"] - model.coefficients["omega^2"]


def _check(request: Request, release: Shape | None) -> Array | None:
    """Refuse what cannot be meant; return the load of the release."""
    if not request.measured:
        raise ValueError("measured is empty: give at least one Decay")
    if not set(request.free) <= set(_FREE):
        raise ValueError(f"free = {list(request.free)}: of a beam, {list(_FREE)} can be free")
    if release is not None and not np.any(release.load):
        raise ValueError(
            "release is held by no load: give a shape of beam.release_shape(...) or"
            " beam.equilibrium(load), or leave it out to read the load from the sensors"
        )
    return None if release is None else release.load
