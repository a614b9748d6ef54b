"""What a simulation lacks, from measured free decays: the workflow from records to a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from romsindy.diagnosis.checks import check_request, checked_records
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.form import NO_FORM_ERROR, FormError
from romsindy.diagnosis.gap import HELD_OUT, Gap, name_of
from romsindy.diagnosis.held_out import parted
from romsindy.diagnosis.judged import Judges
from romsindy.diagnosis.prediction import follow, motions_of, predict
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.search import Finding, Options, Search
from romsindy.diagnosis.tolerance import DEFAULT, Tolerance
from romsindy.diagnosis.verdict import verdict_of
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Scales
from romsindy.fit.coefficient import Coefficient, extended, in_place
from romsindy.fit.part import Part
from romsindy.fit.record import Record, scales, sharing_drift
from romsindy.fit.verdict import NOTHING_LEFT, PREDICTED, ROUNDED, SHARED, UNJUDGED
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay


def diagnose_model(
    model: ReducedModel,
    measured: Sequence[Decay],
    held_out: Decay | None,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    options: Options,
    form: FormError = NO_FORM_ERROR,
) -> DiagnosisReport:
    """Find, name and add what a reduced model lacks; arguments as those of `diagnose`."""
    check_request(model, measured, held_out, free, tolerances)
    everything = [*measured, *([] if held_out is None else [held_out])]
    records = sharing_drift(checked_records(model, everything, options.floor))
    tests = {} if held_out is None else {HELD_OUT: records.pop()}
    all_scales = scales(records)
    model = smooth_model(model, all_scales)
    judged = {name_of(i): record for i, record in enumerate(records)} | tests
    as_it_was = Gap(tuple(predict(model, (), r, n) for n, r in judged.items()), unseen=True)
    largest = max(record.amplitude for record in records)
    if not any(test.amplitude >= SHARED * largest for test in tests.values()):
        records, tests = _parted(records, tests)
    parts = unsure_parts(model, free, tolerances, all_scales, len(records))
    unsure = {p.effect.name for p in parts}
    catalogue = [e for e in options.catalogue if e.name not in unsure]
    known = [c for c in in_place(model, catalogue) if c.of.key not in tolerances]
    looked_for = (*catalogue, *known)
    search = Search(model, records, parts, replace(options, catalogue=looked_for), form)
    exact = replace(search, free=()).hypothesis([])
    found = Finding([exact], [exact], exact) if _agree(search, exact, as_it_was) else search.run()
    judged = tests or {name_of(i): record for i, record in enumerate(records)}
    if not found.interrupted:
        judges = Judges(search, exact, judged, unseen=bool(tests))
        found = judges.weighed(found)
        found = judges.useful(found) if tests else _with_plain_values(found)
        if judges.blind:
            tests, judged = {}, {name_of(i): record for i, record in enumerate(records)}
    best = found.rivals[0] if found.interrupted else _snapped(search, found.rivals[0])
    # Odds are those of the values as they are told.
    alike = [h for h in found.compared if len(h.effects) == len(best.effects)]
    near_by = search.rivals(best, [h.at(best.form) for h in alike])[1:]
    others = {h.names: h.at(best.form) for h in (*found.rivals[1:], *near_by)}
    rivals = [best, *others.values()]
    left = search.remainder(best)
    near = motions_of(best)
    predictions = [
        predict(model, best.parts, r, name, near.get(name)) for name, r in judged.items()
    ]
    gap = Gap(tuple(predictions), bool(tests))
    matters, improves = as_it_was.matters(options.tolerance), gap.improves(options.tolerance)
    if _sure(best, (exact, found.base), options.tolerance) and gap.after <= PREDICTED:
        matters = improves = True
    if matters and not improves and best.parts:  # what was held out may not reach where it matters
        after = (follow(p, model, best.parts, near) for p in as_it_was.predictions)
        improves = replace(as_it_was, predictions=tuple(after)).improves(options.tolerance)
    verdict = verdict_of(best, rivals, left, gap, options.tolerance, form, matters, improves)
    added = best.parts
    if verdict == "unknown" and not gap.closed:  # nothing is added that makes it worse
        added, gap = (), gap.unchanged()
    if found.interrupted and verdict == "named":
        verdict = "ambiguous"  # with what was not compared
    return DiagnosisReport(
        verdict=verdict,
        nominal=model,
        model=extended(model, added),
        added=added,
        best=best,
        rivals=tuple(rivals),
        compared=tuple(found.compared),
        base=found.base,
        remainder=left,
        gap=gap,
        differences=as_it_was.differences_before,
        tolerance=options.tolerance,
        records=tuple(records),
        scales=all_scales,
        interrupted=found.interrupted,
        form=form,
    )


def _with_plain_values(found: Finding) -> Finding:
    """Where nothing took no part, an effect must be twice as sure to outdo values that moved."""
    best, base = found.rivals[0], found.base.at(found.rivals[0].form)
    if not (best.effects and base.names) or base.score - best.score > UNJUDGED:
        return found
    others = [h for h in found.rivals if h.names != base.names]
    return replace(found, rivals=[*others, base])


def _parted(
    records: Sequence[Record], tests: Mapping[str, Record]
) -> tuple[list[Record], dict[str, Record]]:
    """Records to learn from, and what takes no part: nothing where all are too short.

    A record that was held out but reaches less far tells too little alone.
    """
    pairs = [parted(record) or (record, None) for record in records]
    judges = {name_of(i): judge for i, (_, judge) in enumerate(pairs) if judge is not None}
    return [learns for learns, _ in pairs], {**judges, **tests}


def _agree(search: Search, exact: Hypothesis, as_it_was: Gap) -> bool:
    """Whether the simulation as it was is within the tolerance of all records.

    A tolerance that was asked for says what matters. Where it is but the default, what repeats with
    the vibration must not stand out of the noise either.
    """
    tolerance = search.options.tolerance
    if as_it_was.matters(tolerance):
        return False
    if tolerance.source != DEFAULT:
        return True
    left = search.remainder(exact)
    return left.p_value > search.options.false_alarm and left.ratio < NOTHING_LEFT


def _sure(best: Hypothesis, plainer: Sequence[Hypothesis], tolerance: Tolerance) -> bool:
    """Whether an effect is there beyond doubt, in swings too few for a difference to be sure.

    A tolerance that was asked for covers what repeats of a test differ by, which is sure, too.
    """
    odds = min(h.at(best.form).score for h in plainer) - best.score
    return bool(best.effects) and tolerance.source == DEFAULT and odds > 2 * UNJUDGED


def smooth_model(model: ReducedModel, all_scales: Scales) -> ReducedModel:
    """Dry friction that the model has already must not jump."""
    if all(term.smooth for term in model.terms):
        return model
    return model.regularised(0.01 * all_scales.amplitude * all_scales.omega)


def unsure_parts(
    model: ReducedModel,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    all_scales: Scales,
    n_records: int,
) -> tuple[Part, ...]:
    """Parts of the values that a simulation is unsure of, or knows to a tolerance."""
    known = {"omega^2": LinearFrequency(), "c_linear": Viscous()}
    unsure = [known[f] if isinstance(f, str) else f for f in free if f not in tolerances]
    parts = [Part.of(effect, all_scales, n_records) for effect in unsure]
    terms = {term.key: term for term in model.terms}
    for name, relative in tolerances.items():
        effect: Effect = known.get(name) or Coefficient(terms[name])
        part = Part.of(effect, all_scales, n_records)
        parts.append(replace(part, tolerance=relative * abs(model.coefficients[name])))
    return tuple(parts)


def _snapped(search: Search, best: Hypothesis) -> Hypothesis:
    """Round exponents back to those of the textbook where the data do not object."""
    fixed = [with_textbook_exponent(p) for p in best.effects]
    if all(p is q for p, q in zip(fixed, best.effects, strict=True)):
        return best
    trial = search.unsure_as(best).hypothesis(fixed).at(best.form)
    rise = trial.solution.chi_squared - best.solution.chi_squared
    return trial if trial.solution.converged and rise < ROUNDED else best


def with_textbook_exponent(part: Part) -> Part:
    """The same with its exponent held at that of the textbook."""
    known = [
        replace(p, low=p.starts[0], high=p.starts[0]) if p.name == "exponent" else p
        for p in part.parameters
    ]
    if known == list(part.parameters):
        return part
    shape = np.clip(part.shape, [p.low for p in known], [p.high for p in known])
    return replace(part.shaped(shape), parameters=tuple(known))
