"""What a simulation lacks by what it leaves: from records to a report.

Of vibrations that measured inputs drive, known inputs may be wrong, others are fitted every time.

Of decays in which several coordinates ring, candidates are effects on one of the coordinates, and
couplings that the model does not have. Mode shapes beyond the main channels are fitted whatever the
hypothesis, and the scale of a coordinate, the gain of its main channel, as far as a measurement may
be off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from romsindy.beam.beam import Beam
from romsindy.diagnosis.arguments import (
    FREE,
    check_inputs,
    check_repeats,
    check_request,
    checked_driven,
    linear_values_within,
    of_driven_repeats,
    reduced,
)
from romsindy.diagnosis.difference import DEFAULT, Tolerance
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.held_out import tested
from romsindy.diagnosis.residual_report import CoupledDiagnosis, ForcedReport, report_of
from romsindy.diagnosis.residual_search import NoiseOfBest, ResidualSearch
from romsindy.diagnosis.search import (
    LINEAR,
    Options,
    Request,
    smooth_model,
    sought_beside,
    unsure_parts,
)
from romsindy.effects.base import Effect, ReadingEffect, Scales
from romsindy.effects.choices import Kind, candidates, looked_for
from romsindy.effects.outside import (
    InputBetweenSamples,
    InputDelay,
    InputDistortion,
    InputGain,
    InputLag,
)
from romsindy.fit.adequacy.independence import examine_decays
from romsindy.fit.kernel.part import Coefficient, OnCoordinate, Part
from romsindy.fit.records.arguments import small_frequencies
from romsindy.fit.records.coupled import (
    CoupledRecord,
    ModeShape,
    coupled_records,
    free_offsets,
    free_shapes,
)
from romsindy.fit.records.driven import ForcedRecord, drives_of, freed, inputs_in, latest, regressed
from romsindy.fit.records.smooth import rated, ways
from romsindy.fit.results.estimate import Estimate
from romsindy.fit.verdict import KNOWN_GAIN, SHARED
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import Along
from romsindy.physics.damping import PowerDamping
from romsindy.physics.equations import Equations, inputs_of, with_inputs, without_inputs
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import INTERPOLATIONS, Interpolation
from romsindy.text import quantity


def diagnose_forced(model: Equations | Beam, request: Request) -> ForcedReport:
    """Find, name and add what a reduced model lacks.

    Gain and delay of an input that the model has are known, and may turn out to be wrong. Of other
    inputs both are fitted whatever the hypothesis.
    """
    model = reduced(model)
    check_request(model, request, "record")
    check_inputs(model, request.everything)
    measured, options, tolerances = request.measured, request.options, request.tolerances
    records = checked_driven(request.everything, options.floor)
    test = None if request.held_out is None else records.pop()
    scales = _scales(records)
    model = smooth_model(model, scales)
    unsure = unsure_parts(model, request.free, tolerances, scales, len(records))
    sought = catalogue_of(model, unsure, tolerances, options.catalogue)
    given = (model, records, scales, unsure, replace(options, catalogue=sought))
    search = search_beside_inputs(*given, ways(measured)[0])
    asked = options.tolerance.source != DEFAULT  # else noise alone decides
    slack = linear_values_within(search, [*LINEAR.values()]) if asked else None
    if slack is not None:
        return report_of(search, slack, test, on_inputs(search), ForcedReport)
    found = search.run()
    way, note = between_samples(search, found.rivals[0], measured)
    if way != ways(measured)[0]:
        search = search_beside_inputs(*given, way)
        found = search.run()
    found = tested(search, found, test)
    return report_of(search, found, test, (*note, *on_inputs(search)), ForcedReport)


def of_repeats(
    model: Equations | Beam, repeats: Sequence[ForcedVibration], options: Options
) -> Tolerance:
    """What runs of one driven test differ by; see `of_driven_repeats`.

    Raises a ValueError if there are fewer than two, one is there twice, or they cannot be compared.
    """
    model = reduced(model)
    check_repeats(repeats)
    check_inputs(model, repeats, "repeat")
    searches = []
    for record in checked_driven(repeats, options.floor, "repeat"):
        scales = _scales([record])
        smooth = smooth_model(model, scales)
        parts = unsure_parts(smooth, FREE, {}, scales, 1)
        way = ways([record.decay])[0]
        searches.append(search_beside_inputs(smooth, [record], scales, parts, options, way))
    return of_driven_repeats(searches)


def _scales(records: Sequence[ForcedRecord]) -> Scales:
    """Of all records together."""
    longest = max(records, key=lambda r: r.t[-1])
    return Scales(max(r.amplitude for r in records), longest.rate, float(longest.t[-1]))


_POWERS = 2, 3  # of an input that is distorted


def catalogue_of(
    model: ReducedModel,
    unsure: Sequence[Part],
    tolerances: Mapping[str, float],
    catalogue: Sequence[Effect],
) -> tuple[Effect, ...]:
    """What can be looked for in these records, and what may be wrong with the inputs."""
    sought = sought_beside(unsure, model, looked_for(catalogue, "driven"), tolerances)
    inputs = [(replace(t, delay=0.0), t.delay) for t in inputs_of(model)]
    plain = [(t, late) for t, late in inputs if t.power == 1]
    powers = [(replace(t, power=power), late) for t, late in plain for power in _POWERS]
    distorted = [InputDistortion(*p) for p in powers if p[0].key not in model.coefficients]
    return (*sought, *[InputGain(*given) for given in inputs], *distorted)


def search_beside_inputs(
    model: ReducedModel,
    records: Sequence[ForcedRecord],
    scales: Scales,
    unsure: tuple[Part, ...],
    options: Options,
    way: Interpolation,
) -> ResidualSearch:
    """A search in which the inputs that the model does not know do this between their samples."""
    own = {t.source for t in inputs_of(model)}
    others = [t for t in inputs_in([r.decay for r in records], way) if t.source not in own]
    drives: tuple[Part, ...] = ()
    if others:
        gains = regressed(without_inputs(model).terms, others, records)[1].tolist()
        drives = drives_of(with_inputs(without_inputs(model), others, gains), records)
    given = (model, records, unsure, options, NoiseOfBest(), (*drives, free_offsets(records)))
    return ResidualSearch(*given, scales=scales, chain=_chain(model, records))


def _chain(model: ReducedModel, records: Sequence[ForcedRecord]) -> tuple[Part, ...]:
    """What may stand instead of known inputs: late, after a lag, or another between samples."""
    parts: list[Part] = []
    dt = max(r.decay.dt for r in records)  # a lag of none is felt by no sample that is held
    for term in inputs_of(model):
        gain = model.coefficients[term.key]
        known = replace(term, delay=0.0), term.delay, latest(records)
        parts += [freed(InputDelay(*known), gain), freed(InputLag(*known, term.lag or dt), gain)]
        for way in INTERPOLATIONS:
            if way != term.interpolation:
                other = replace(term, interpolation=way, delay=0.0)
                parts.append(Part(InputBetweenSamples(other, term.delay), (), np.zeros((1, 0))))
    return tuple(parts)


def between_samples(
    search: ResidualSearch, best: Hypothesis, measured: Sequence[ForcedVibration]
) -> tuple[Interpolation, tuple[str, ...]]:
    """What inputs that the model does not know do between their samples, and a note on it."""
    first, *others = ways(measured)
    if not (others and any(p.effect.name == "input" for p in search.beside)):
        return first, ()
    residuals = {first: best.solution.residuals}
    for way in others:
        beside = tuple(_with_way(p, way) for p in search.beside)
        there = replace(search.unsure_as(best), beside=beside, compared=[])
        residuals[way] = there.hypothesis(best.effects).solution.residuals
    rivals = rated(residuals)
    return rivals.best, (str(rivals),)


def _with_way(part: Part, way: Interpolation) -> Part:
    of = getattr(part.effect, "of", None)
    if not isinstance(of, Input):
        return part
    return replace(part, effect=replace(part.effect, of=replace(of, interpolation=way)))  # type: ignore[type-var]


def on_inputs(search: ResidualSearch) -> list[str]:
    """That gains were fitted, and what cannot be seen then."""
    free = [p.effect.variant for p in search.beside if p.effect.name == "input"]
    if not free:
        return []
    return [
        f"the model has no {', '.join(free)}: gain and delay are fitted, so that a wrong one, or a"
        " factor on all forces, is not seen; add the Input to the model where it is known"
    ]


# -- several coordinates ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Coupling(Coefficient):
    """What couples coordinates: a term that the model lacks, or has with another value."""

    label = "a coupling of modes"


def diagnose_coupled(model: CoupledModel, request: Request) -> CoupledDiagnosis:
    """Find, name and add what a model of several coordinates lacks."""
    linear = linear_values(model)
    free = [name for f in request.free for name in _of_every_coordinate(f, linear)]
    request = replace(request, free=free)
    check_request(model, request, may_be_free=(*FREE, *linear))
    records = _records(model, request.everything, request.options.floor)
    test = None if request.held_out is None else records.pop()
    search = _search(model, records, request)
    slack = linear_values_within(search, list(linear.values()))
    found = tested(search, search.run(), test) if slack is None else slack
    return report_of(search, found, test, _notes(model, request.everything), CoupledDiagnosis)


def of_coupled_repeats(
    model: CoupledModel, repeats: Sequence[Decay], options: Options
) -> Tolerance:
    """What runs of one test of several coordinates differ by; see `of_driven_repeats`."""
    check_repeats(repeats)
    request = Request(repeats, None, [*linear_values(model)], {}, options)
    records = _records(model, repeats, options.floor)
    return of_driven_repeats([_search(model, [r], request) for r in records])


def tolerances_of(model: CoupledModel, estimate: Estimate) -> dict[str, float]:
    """How well an estimate knows its coefficients, relatively, but for the linear ones."""
    values, linear = model.coefficients, linear_values(model)
    errors = estimate.standard_errors.items()
    return {
        name: std / abs(values[name])
        for name, std in errors
        if name not in linear and values[name] and 0 < std < np.inf
    }


def linear_values(model: CoupledModel) -> dict[str, Effect]:
    """Other values of the linear stiffness and damping of every coordinate, by name."""
    laws = {"linear_frequency": Stiffness(1), "viscous": PowerDamping(1)}
    numbers = range(1, model.n_coordinates + 1)
    found = [
        Coefficient(Along.coordinate(law, i), called=f"{name} [q{i}]")
        for i in numbers
        for name, law in laws.items()
    ]
    return {effect.of.key: effect for effect in found}


def _of_every_coordinate(free: str | Effect, linear: Mapping[str, Effect]) -> list[str | Effect]:
    """Names of all coordinates, where one is given without any."""
    if free not in FREE:
        return [free]
    return [name for name in linear if name.startswith(f"{free} [")]


def _records(model: CoupledModel, decays: Sequence[Decay], floor: float) -> list[CoupledRecord]:
    return list(coupled_records([d.free() for d in decays], small_frequencies(model), floor))


def _search(
    model: CoupledModel, records: Sequence[CoupledRecord], request: Request
) -> ResidualSearch:
    """A search beside the mode shapes."""
    options, tolerances = request.options, request.tolerances
    each = _scales_of_each(model, records)
    largest = max(each, key=lambda scales: scales.amplitude)
    given = (model, request.free, tolerances, largest, len(records), linear_values(model))
    unsure = unsure_parts(*given)
    mains = [ModeShape(channel, i) for i, channel in enumerate(records[0].main)]
    sought = _sought(model, options.catalogue, each, unsure, tolerances)
    options = replace(options, catalogue=(*sought, *mains))
    gains = [Part(e, (), np.zeros((1, 1)), KNOWN_GAIN, KNOWN_GAIN) for e in mains]
    beside = (*free_shapes(records), *gains)
    noise = NoiseOfBest(examine_decays, unsettled=True)
    return ResidualSearch(model, records, unsure, options, noise, beside, scales=largest, chain=())


def _sought(
    model: CoupledModel,
    catalogue: Sequence[Effect],
    scales: Sequence[Scales],
    unsure: Sequence[Part],
    tolerances: Mapping[str, float],
) -> list[Effect]:
    """Effects on every coordinate, couplings, and too much of what the model has already."""
    forces = [e for e in catalogue if not (isinstance(e, ReadingEffect) or e.per_record)]
    on = [OnCoordinate(e, i, own) for e in forces for i, own in enumerate(scales, 1)]
    alike = sought_beside(unsure, model, on, tolerances)
    n = model.n_coordinates
    alone = candidates(n, Kind(coupled=False))
    missing = [t for t in candidates(n, Kind()) if t not in alone]
    own = [t for t in model.terms if not isinstance(t, Along) and t not in alone]
    couplings = {t.key: t for t in (*own, *missing) if t.key not in tolerances}
    return [*alike, *(Coupling(t, f"coupling {key}") for key, t in couplings.items())]


def _scales_of_each(model: CoupledModel, records: Sequence[CoupledRecord]) -> list[Scales]:
    """Of every coordinate, over all records."""
    sizes = np.max([np.abs(r.motion.q).max(axis=0) for r in records], axis=0)
    longest = max(float(r.t[-1]) for r in records)
    rates = 2 * np.pi * small_frequencies(model)
    return [Scales(float(a), float(w), longest) for a, w in zip(sizes, rates, strict=True)]


def _notes(model: CoupledModel, decays: Sequence[Decay]) -> list[str]:
    """Which records reach beyond the amplitudes that the model holds for."""
    if model.amplitude_range is None:
        return []
    most, unit = model.amplitude_range[1], model.unit or "[q]"
    reach = [float(np.abs(d.q).max()) for d in decays]
    return [
        f"record {i + 1} reaches {quantity(a, unit)}, the model {quantity(most, unit)}: beyond, its"
        " series may be too short, and look like an effect."
        for i, a in enumerate(reach)
        if SHARED * a > most
    ]
