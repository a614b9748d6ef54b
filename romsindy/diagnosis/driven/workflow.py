"""What a simulation lacks, from vibrations that measured inputs drive: from records to a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from romsindy.beam import Beam
from romsindy.diagnosis.checks import FREE, check_request
from romsindy.diagnosis.colour import driven_instead
from romsindy.diagnosis.driven.checks import check_inputs, checked_driven, reduced
from romsindy.diagnosis.driven.gap import HELD_OUT, ForcedGap
from romsindy.diagnosis.driven.held_out import left_of, tested
from romsindy.diagnosis.driven.inputs import (
    between_samples,
    catalogue_of,
    on_inputs,
    search_beside_inputs,
)
from romsindy.diagnosis.driven.report import ForcedReport
from romsindy.diagnosis.driven.search import DrivenSearch
from romsindy.diagnosis.driven.tolerance import beyond_noise, of_driven_repeats, within
from romsindy.diagnosis.search import Finding, Options
from romsindy.diagnosis.tolerance import DEFAULT, Tolerance
from romsindy.diagnosis.verdict import Verdict
from romsindy.diagnosis.workflow import smooth_model, unsure_parts
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Scales
from romsindy.fit.adequacy import Adequacy
from romsindy.fit.any_record import AnyRecord
from romsindy.fit.coefficient import extended
from romsindy.fit.forced.between_samples import ways
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.verdict import CLOSED, NAMED_ABOVE, PREDICTED
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration


def diagnose_forced(
    model: ReducedModel | Beam,
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
    slack = within(search, linear) if asked else None
    if slack is not None:
        exact = search.with_free(()).hypothesis([])
        return report_of(search, Finding([slack], [slack, exact], exact), test, on_inputs(search))
    found = search.run()
    way, note = between_samples(search, found.rivals[0], measured)
    if way != ways(measured)[0]:
        search = search_beside_inputs(*given, way)
        found = search.run()
    if test is not None and not found.interrupted:
        found = tested(search, found, test)
    return report_of(search, found, test, (*note, *on_inputs(search)))


def check_repeats(repeats: Sequence[ForcedVibration] | Sequence[Decay]) -> None:
    """Raise a ValueError for fewer than two runs of a test, or one that is there twice."""
    if len(repeats) < 2:
        raise ValueError(f"repeats holds {len(repeats)} record: give two or more of the same test")
    if any(a.same_record(b) for i, a in enumerate(repeats) for b in repeats[:i]):
        raise ValueError("repeats holds a record twice: give each run of the test once")


def of_repeats(
    model: ReducedModel | Beam, repeats: Sequence[ForcedVibration], options: Options
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


def report_of(
    search: DrivenSearch,
    found: Finding,
    test: AnyRecord | None,
    notes: Sequence[str] = (),
    kind: type[ForcedReport] = ForcedReport,
) -> ForcedReport:
    """What a search found, by what it leaves of the records, or of one that took no part."""
    best, tolerance = found.rivals[0], search.options.tolerance
    added = best.parts if best.names else ()
    gap, tells = _gap(search, found, test), [search.remainder(best)]
    if test is not None:  # of its values only the start was fitted
        start = 2 * search.model.n_coordinates
        tells.append(search.examined([test], gap.residuals_after, start))
    kept = tolerance.source != DEFAULT and all(
        beyond_noise(*some) <= tolerance.signal
        for some in ((gap.records, gap.residuals_after), (search.records, best.solution.residuals))
    )
    return kind(
        verdict=_verdict(found, gap, tells, kept),
        nominal=search.model,
        model=extended(driven_instead(search.model, best.parts), added) if added else search.model,
        best=best,
        rivals=tuple(found.rivals),
        compared=tuple(found.compared),
        base=found.base,
        remainder=tells[-1],
        gap=gap,
        tolerance=tolerance,
        records=tuple(search.records),
        scales=search.scales,
        added=added,
        interrupted=found.interrupted,
        notes=tuple(notes),
    )


def _gap(search: DrivenSearch, found: Finding, test: AnyRecord | None) -> ForcedGap:
    """Before and after, on what took no part, or else on what was fitted."""
    best, base = found.rivals[0], found.base
    if test is None:
        return ForcedGap.of(search.records, base.solution.residuals, best.solution.residuals)
    before, after = ([left_of(search.model, h.parts, test)] for h in (base, best))
    return ForcedGap.of([test], before, after, HELD_OUT)


def _verdict(found: Finding, gap: ForcedGap, tells: Sequence[Adequacy], kept: bool) -> Verdict:
    """One word; ``kept`` says that what is left is within a tolerance."""
    best = found.rivals[0]
    explained = all(left.explained for left in tells)
    little = gap.closed >= CLOSED and all(left.ratio <= PREDICTED for left in tells)
    if not (explained or little or kept):
        return "unknown"
    if not best.names:
        return "none"
    several = len(found.rivals) > 1 or len(best.moved) > 1 or found.interrupted
    return "ambiguous" if several or best.sureness < NAMED_ABOVE else "named"


def _scales(records: Sequence[ForcedRecord]) -> Scales:
    """Of all records together."""
    longest = max(records, key=lambda r: r.t[-1])
    return Scales(max(r.amplitude for r in records), longest.rate, float(longest.t[-1]))
