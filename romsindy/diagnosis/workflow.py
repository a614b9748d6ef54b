"""What a simulation lacks, from measured free decays: the workflow from records to a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from romsindy.diagnosis.checks import check_request, checked_records
from romsindy.diagnosis.decay_search import DecaySearch
from romsindy.diagnosis.difference import over_all
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.form import NO_FORM_ERROR, FormError
from romsindy.diagnosis.gap import HELD_OUT, Gap, name_of
from romsindy.diagnosis.held_out import parted
from romsindy.diagnosis.innocent import innocent, other_values
from romsindy.diagnosis.judged import Judges
from romsindy.diagnosis.nuisance import nuisances
from romsindy.diagnosis.prediction import follow, misfit_of, motions_of, predict
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.search import Finding, Options, alternatives
from romsindy.diagnosis.textbook import with_textbook_exponent, with_whole_exponent
from romsindy.diagnosis.tolerance import DEFAULT, KINDS, Tolerance
from romsindy.diagnosis.verdict import Explanation, Rule
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Scales
from romsindy.fit.coefficient import Coefficient, extended, in_place
from romsindy.fit.part import Part
from romsindy.fit.record import Record, scales, sharing_drift
from romsindy.fit.verdict import (
    AS_WELL,
    NEARLY_WHOLE,
    NOTHING_LEFT,
    ROUNDED,
    SHARED,
    UNJUDGED,
)
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
    own_values: bool = True,
) -> DiagnosisReport:
    """Find, name and add what a reduced model lacks; arguments as those of `diagnose`.

    ``own_values`` says whether its coefficients are values of the simulation, not of its reduction.
    """
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
    search = DecaySearch.of(model, records, parts, replace(options, catalogue=looked_for), form)
    exact = search.with_free(()).hypothesis([])
    slack = search.with_free(nuisances(records)).hypothesis([])
    agree = _agree(search, slack, as_it_was)
    found = Finding([exact], [exact], exact) if agree else search.run()
    judged = tests or {name_of(i): record for i, record in enumerate(records)}
    if not found.interrupted:
        judges = Judges(search, exact, judged, unseen=bool(tests))
        found = judges.weighed(found)
        found = judges.useful(found) if tests else _with_plain_values(found)
        if judges.blind:
            tests, judged = {}, {name_of(i): record for i, record in enumerate(records)}
    others = other_values(model, options.catalogue, tolerances) if own_values else ()
    own = frozenset({LinearFrequency.name, Viscous.name, *(v.name for v in others)})
    explained = partial(_explained, search, judged, bool(tests), as_it_was, own)
    settled = agree or found.interrupted
    plain = [slack] if settled else innocent(search, slack, found.base, others)
    usual = over_all(options.tolerance, as_it_was.differences_before)
    values = [_without_small(h, model, usual) for h in plain]
    best = found.rivals[0]
    effect = explained(_snapped(search, best, judged)) if best.names else None
    rule = Rule(as_it_was, values[0], values[:2][-1], options.tolerance, form)
    answer = rule.answer([explained(h) for h in values], effect)
    verdict, chosen = answer.verdict, answer.explanation
    best, left, gap = chosen.hypothesis, chosen.left, chosen.gap
    rivals = [*_rivals(best, found, values, chosen is effect)]
    if answer.rival is not None and answer.rival.hypothesis.names not in {h.names for h in rivals}:
        rivals.append(answer.rival.hypothesis.at(best.noise))
    # Of values of the model several are no headline; what it lacks is, whatever moved beside it.
    several = not chosen.lacking and len(best.blamed if not best.effects else best.moved) > 1
    if verdict == "named" and (several or len(rivals) > 1):
        verdict = "ambiguous"
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
        compared=tuple(sorted((h.at(best.noise) for h in found.compared), key=lambda h: h.score)),
        base=found.base.at(best.noise),
        remainder=left,
        gap=gap,
        differences=as_it_was.differences_before,
        tolerance=options.tolerance,
        records=tuple(records),
        scales=all_scales,
        interrupted=found.interrupted,
        form=form,
        small=answer.small,
        whole=chosen.whole.differences_after,
    )


def _explained(
    search: DecaySearch,
    judged: Mapping[str, Record],
    unseen: bool,
    as_it_was: Gap,
    own: frozenset[str],
    hypothesis: Hypothesis,
) -> Explanation:
    """A hypothesis with what it leaves and changes; ``own`` are names of values of the model."""
    near, given = motions_of(hypothesis), (search.model, hypothesis.parts)
    predictions = [predict(*given, r, name, near.get(name)) for name, r in judged.items()]
    whole = [follow(p, *given, near) for p in as_it_was.predictions]
    return Explanation(
        hypothesis,
        search.remainder(hypothesis),
        Gap(tuple(predictions), unseen),
        replace(as_it_was, predictions=tuple(whole)),
        lacking=not own.issuperset(hypothesis.names),
    )


def _rivals(
    best: Hypothesis, found: Finding, values: Sequence[Hypothesis], is_effect: bool
) -> Sequence[Hypothesis]:
    """What the data do not tell apart from the best, itself first; odds of values as told.

    ``values`` are what values of the model do; of effects the best of these is a rival alone.
    """
    if not is_effect:
        effects = [h for h in (*values, *found.rivals, *found.compared) if h.effects]
        return alternatives(best, [h.at(best.noise) for h in effects])
    likeliest = min(values, key=lambda h: h.score)
    alike = [h for h in found.compared if len(h.effects) == len(best.effects)] + [likeliest]
    near_by = alternatives(best, [h.at(best.noise) for h in alike])[1:]
    others = {h.names: h.at(best.noise) for h in (*found.rivals[1:], *near_by)}
    return [best, *(h for names, h in others.items() if names and names != best.names)]


def _without_small(plain: Hypothesis, model: ReducedModel, tolerance: Tolerance) -> Hypothesis:
    """The same; of several values that moved it says what is surely beyond the tolerance."""
    most = {"linear_frequency": 2 * tolerance.frequency, "viscous": tolerance.damping}
    keys = {"linear_frequency": "omega^2", "viscous": "c_linear"}
    names = [p.effect.name for p in plain.parts[: plain.n_free]]
    small = tuple(
        name
        for name in plain.moved
        if name in most
        and plain.at_least(names.index(name))
        <= most[name] * abs(model.coefficients.get(keys[name], 0.0))
    )
    return plain if len(small) == len(plain.moved) else replace(plain, unsaid=small)


def _with_plain_values(found: Finding) -> Finding:
    """Where nothing took no part, an effect must be twice as sure to outdo values that moved."""
    best, base = found.rivals[0], found.base.at(found.rivals[0].noise)
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


def _agree(search: DecaySearch, slack: Hypothesis, as_it_was: Gap) -> bool:
    """Whether there is nothing to look for in the simulation as it was.

    It is within what repeats or a reference leave open, is known to be within a tolerance that was
    stated, or leaves noise alone with what a measurement may add; a stated one asks for more.
    """
    tolerance = search.options.tolerance
    if not slack.solution.finite:  # it has no motion near that of the records
        return False
    differences = as_it_was.differences_before
    if any(d.exceeds(tolerance) for d in differences):
        return False  # of what takes no part, if not of the others
    if tolerance.stated:
        return all(d.agrees(kind, tolerance) for d in differences for kind in KINDS)
    if tolerance.source != DEFAULT and as_it_was.within(tolerance):
        return True
    left = search.remainder(slack)
    return left.p_value > search.options.false_alarm and left.ratio < NOTHING_LEFT


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


def _snapped(search: DecaySearch, best: Hypothesis, judged: Mapping[str, Record]) -> Hypothesis:
    """Round exponents to whole numbers where the data do not object, that of the textbook first."""
    for whole in (with_textbook_exponent, with_whole_exponent):
        fixed = [whole(p) for p in best.effects]
        if all(p is q for p, q in zip(fixed, best.effects, strict=True)):
            continue
        trial = search.unsure_as(best).hypothesis(fixed).at(best.noise)
        rise = trial.solution.chi_squared - best.solution.chi_squared
        if trial.solution.converged and (
            rise < ROUNDED * best.excess
            or (_nearly(best.effects, fixed) and _as_well(search, trial, best, judged))
        ):
            return trial
    return best


def _nearly(parts: Sequence[Part], fixed: Sequence[Part]) -> bool:
    """Whether exponents are next to the whole numbers that they were fixed at."""
    pairs = [
        (a.effect.value("exponent"), b.effect.value("exponent"))
        for a, b in zip(parts, fixed, strict=True)
        if a is not b
    ]
    return all(abs(x - n) <= NEARLY_WHOLE * abs(n) for x, n in pairs)


def _as_well(
    search: DecaySearch, trial: Hypothesis, best: Hypothesis, judged: Mapping[str, Record]
) -> bool:
    """Whether what took no part is foretold as well."""
    after, before = (
        float(np.sqrt(np.sum(misfit_of(search.model, h, judged) ** 2))) for h in (trial, best)
    )
    return after <= AS_WELL * before
