"""What a simulation lacks, from vibrations that measured inputs drive: from records to a report.

Known inputs may be wrong, others are fitted every time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from romsindy.beam import Beam
from romsindy.diagnosis.arguments import FREE, check_inputs, check_repeats, check_request, reduced
from romsindy.diagnosis.checks import checked_driven
from romsindy.diagnosis.colour import ColourOfBest
from romsindy.diagnosis.difference import DEFAULT, Tolerance
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.held_out import tested
from romsindy.diagnosis.residual_report import ForcedReport, report_of
from romsindy.diagnosis.residual_search import ResidualSearch
from romsindy.diagnosis.search import Finding, Options
from romsindy.diagnosis.tolerance_sources import linear_values_within, of_driven_repeats
from romsindy.diagnosis.unsure import smooth_model, unsure_parts
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Scales
from romsindy.effects.choices import looked_for
from romsindy.effects.drive import (
    InputBetweenSamples,
    InputDelay,
    InputDistortion,
    InputGain,
    InputLag,
)
from romsindy.fit.coefficient import in_place
from romsindy.fit.forced.between_samples import rated, ways
from romsindy.fit.forced.drives import (
    drives_of,
    freed,
    inputs_in,
    latest,
    regressed,
)
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.measured import free_offsets
from romsindy.fit.part import Part
from romsindy.physics.coupled import AnyModel
from romsindy.physics.equations import inputs_of, with_inputs, without_inputs
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import INTERPOLATIONS, Interpolation


def diagnose_forced(
    model: AnyModel | Beam,
    measured: Sequence[ForcedVibration],
    held_out: ForcedVibration | None,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    options: Options,
) -> ForcedReport:
    """Find, name and add what a reduced model lacks; arguments as those of `diagnose`.

    Gain and delay of an input that the model has are known, and may turn out to be wrong. Of other
    inputs both are fitted whatever the hypothesis.
    """
    model = reduced(model)
    check_request(model, measured, held_out, free, tolerances, "record")
    everything = [*measured, *([] if held_out is None else [held_out])]
    check_inputs(model, everything)
    records = checked_driven(everything, options.floor)
    test = None if held_out is None else records.pop()
    scales = _scales(records)
    model = smooth_model(model, scales)
    unsure = unsure_parts(model, free, tolerances, scales, len(records))
    sought = catalogue_of(model, unsure, tolerances, options.catalogue)
    given = (model, records, scales, unsure, replace(options, catalogue=sought))
    search = search_beside_inputs(*given, ways(measured)[0])
    linear = (LinearFrequency(), Viscous())
    asked = options.tolerance.source != DEFAULT  # else noise alone decides
    slack = linear_values_within(search, linear) if asked else None
    if slack is not None:
        exact = search.with_free(()).hypothesis([])
        return report_of(
            search, Finding([slack], [slack, exact], exact), test, on_inputs(search), ForcedReport
        )
    found = search.run()
    way, note = between_samples(search, found.rivals[0], measured)
    if way != ways(measured)[0]:
        search = search_beside_inputs(*given, way)
        found = search.run()
    if test is not None and not found.interrupted:
        found = tested(search, found, test)
    return report_of(search, found, test, (*note, *on_inputs(search)), ForcedReport)


def of_repeats(
    model: AnyModel | Beam, repeats: Sequence[ForcedVibration], options: Options
) -> Tolerance:
    """What runs of one driven test differ by; see `of_driven_repeats`.

    Raises
    ------
    ValueError
        If there are fewer than two, one is there twice, or they cannot be compared.
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
    taken = {p.effect.name for p in unsure}
    sought = [e for e in looked_for(catalogue, "driven") if e.name not in taken]
    known = [c for c in in_place(model, sought) if c.of.key not in tolerances]
    inputs = [(replace(t, delay=0.0), t.delay) for t in inputs_of(model)]
    plain = [(t, late) for t, late in inputs if t.power == 1]
    powers = [(replace(t, power=power), late) for t, late in plain for power in _POWERS]
    distorted = [InputDistortion(*p) for p in powers if p[0].key not in model.coefficients]
    gains = [InputGain(*given) for given in inputs]
    return (*sought, *known, *gains, *distorted)


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
    beside = (*drives, free_offsets(records))
    given = (model, records, unsure, options, ColourOfBest(), beside)
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
