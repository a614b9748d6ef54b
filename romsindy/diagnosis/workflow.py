"""What a simulation lacks, from measured free decays: the workflow from records to a report."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from romsindy.diagnosis.arguments import FREE, check_request, checked_records
from romsindy.diagnosis.decay_search import DecaySearch, ProcessNoise
from romsindy.diagnosis.difference import DEFAULT, KINDS, Tolerance, over_all
from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError, Hypothesis, nuisances
from romsindy.diagnosis.gap import (
    HELD_OUT,
    Gap,
    follow,
    misfit_of,
    motions_of,
    name_of,
    predict,
)
from romsindy.diagnosis.held_out import Validation, parted
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.search import (
    Finding,
    Request,
    part_of,
    rivals_of,
    screen,
    smooth_model,
    sought_beside,
    unsure_parts,
    with_textbook_exponent,
    with_whole_exponent,
)
from romsindy.diagnosis.verdict import Answer, Explanation, Rule, Verdict
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Scales
from romsindy.fit.kernel.part import Coefficient, Part, extended
from romsindy.fit.records.record import Record, scales, sharing_drift
from romsindy.fit.verdict import (
    AS_WELL,
    EQUIVALENT,
    EXPLAINED,
    NEARLY_WHOLE,
    NOTHING_LEFT,
    PREDICTED,
    ROUNDED,
    SHARED,
    UNJUDGED,
)
from romsindy.physics.equations import inputs_of
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness


def diagnose_model(
    model: ReducedModel,
    request: Request,
    form: FormError = NO_FORM_ERROR,
    own_values: bool = True,
    elsewhere: Mapping[frozenset[str], float] | None = None,
) -> DiagnosisReport:
    """Find, name and add what a reduced model lacks.

    ``own_values`` says whether its coefficients are values of the simulation, not of its reduction,
    ``elsewhere`` what other modes say of effects, see `Hypothesis`.
    """
    check_request(model, request)
    options, tolerances, records = request.options, request.tolerances, _Records.of(model, request)
    model = smooth_model(model, records.scales)
    whole = tuple(predict(model, (), r, name) for name, r in records.whole.items())
    as_it_was = Gap(whole, unseen=True)
    parts = unsure_parts(model, request.free, tolerances, records.scales, len(records.learning))
    sought = sought_beside(parts, model, options.catalogue, tolerances)
    given = (model, records.learning, parts, replace(options, catalogue=sought))
    usual = over_all(options.tolerance, as_it_was.differences_before)
    search = DecaySearch(*given, ProcessNoise(form, elsewhere or {}, _least_changes(model, usual)))
    exact = search.with_free(()).hypothesis([])
    slack = search.with_free(nuisances(records.learning)).hypothesis([])
    agree = _agree(search, slack, as_it_was)
    found = Finding([exact], [exact], exact) if agree else search.run()
    if not found.interrupted:
        found, records = _without_refuted(search, exact, found, records)
    others = other_values(model, options.catalogue, tolerances) if own_values else ()
    unsure = [p.effect.name for p in parts]
    linear = (LinearFrequency.name, Viscous.name, *(v.name for v in others))
    own = frozenset(linear if own_values else unsure)
    compared = [predict(model, (), r, name) for name, r in records.compared.items()]
    on_tests = Gap(tuple(compared), bool(records.tests))
    explained = partial(_explained, search, on_tests, as_it_was, own)
    # The reduction of a structure is known no better than to a tolerance, and where nothing took no
    # part nobody asks whether several effects foretell more than fewer.
    judged = own_values and records.tests
    found = found if judged else _that_matter(search, explained, found)
    known = agree or found.interrupted
    plain = [slack] if known else without_effects(search, slack, found.base, others)
    values = [_without_small(h) for h in plain]
    best = found.rivals[0]
    effect = explained(_snapped(search, best, records.compared)) if best.names else None
    rule = Rule(as_it_was, values[0], values[:2][-1], options.tolerance, form, own_values)
    answer = rule.answer([explained(h) for h in values], effect)
    rivals = _rivals(answer, found, values, answer.explanation is effect)
    return _report(search, records, as_it_was, found, answer, rivals)


@dataclass(frozen=True)
class _Records:
    """Records of a diagnosis: what they learn from, and what takes no part."""

    whole: dict[str, Record]  # all of them by name, that which was held out last
    # What hypotheses are fitted to: whole records, or these without the stretches of ``tests``
    learning: list[Record]
    # What takes no part, by name; empty where all are too short to spare anything
    tests: dict[str, Record]
    scales: Scales

    @classmethod
    def of(cls, model: ReducedModel, request: Request) -> _Records:
        """Look at decays, and hold out what judges.

        A record that was held out but reaches less far tells too little alone.
        """
        records = checked_records(model, request.everything, request.options.floor)
        records = sharing_drift(records)
        tests = {} if request.held_out is None else {HELD_OUT: records.pop()}
        whole = {name_of(i): record for i, record in enumerate(records)} | tests
        all_scales = scales(records)
        largest = max(record.amplitude for record in records)
        if any(test.amplitude >= SHARED * largest for test in tests.values()):
            return cls(whole, records, tests, all_scales)
        pairs = [parted(record) or (record, None) for record in records]
        apart = {name_of(i): test for i, (_, test) in enumerate(pairs) if test is not None}
        return cls(whole, [learns for learns, _ in pairs], {**apart, **tests}, all_scales)

    @property
    def compared(self) -> dict[str, Record]:
        """That on which explanations are compared: what took no part, if there is such."""
        return self.tests or {name_of(i): record for i, record in enumerate(self.learning)}


def _validated(
    search: DecaySearch, exact: Hypothesis, found: Finding, records: _Records
) -> tuple[Finding, _Records]:
    """The finding by what took no part; records without tests where these cannot tell."""
    if found.rivals[0].weighed is None:  # the best has no motion, and foretells none
        return found, records
    validation = Validation(search, exact, records.compared, unseen=bool(records.tests))
    found, least = validation.weighed(found)
    if not records.tests:
        return _with_plain_values(found), records
    first = found.rivals[0]
    found, blind = validation.useful(found, least)
    best = found.rivals[0]
    if best.effects and best.material and len(best.effects) < len(first.effects):
        found = search.with_instead(found)  # the search asked that of more effects
    return found, replace(records, tests={}) if blind else records


def _without_refuted(
    search: DecaySearch, exact: Hypothesis, found: Finding, records: _Records
) -> tuple[Finding, _Records]:
    """The finding by what took no part; looked for again without effects that this refutes.

    They seemed to explain all that was learned, which kept others from being tried. The finding
    that foretells more.
    """
    tested, first = _validated(search, exact, found, records), found.rivals[0]
    gone = {p.effect.name for p in first.effects} - {*tested[0].rivals[0].names}
    if not (gone and records.tests and search.remainder(first).explained) or search.options.over:
        return tested

    def misfit(validated: tuple[Finding, _Records]) -> float:
        left = misfit_of(search.model, validated[0].rivals[0], records.tests)
        return float(np.sum(left**2))

    if misfit(tested) < PREDICTED**2 * sum(r.count for r in records.tests.values()):
        return tested
    left = tuple(e for e in search.options.catalogue if e.name not in gone)
    other = replace(search, options=replace(search.options, catalogue=left), compared=[])
    again = other.run()
    if again.interrupted:
        return replace(tested[0], interrupted=True), tested[1]
    return min(tested, _validated(other, exact, again, records), key=misfit)


def _that_matter(
    search: DecaySearch, explained: Callable[[Hypothesis], Explanation], found: Finding
) -> Finding:
    """The finding with fewer of several effects, where what these say is within the tolerance.

    What is in the measurement changes no motion, and stays; so does what leaves noise alone, where
    fewer leave distinctly more.
    """
    best = found.rivals[0]
    while len(best.effects) > 1 and not (found.interrupted or search.options.over):
        whole, tolerance = explained(best), search.options.tolerance
        fewer = [
            h
            for h, part in zip(search.without_one(best, found.compared), best.effects, strict=True)
            if h.solution.finite and part.effect.structural
        ]
        most = EXPLAINED * whole.left.ratio if whole.leaves_noise else np.inf
        alike = [
            h
            for h, e in zip(fewer, map(explained, fewer), strict=True)
            if not e.differs(whole, tolerance) and (e.leaves_noise or e.left.ratio < most)
        ]
        if not alike:
            break
        best = search.ranked(alike)[0]
        found = search.finding(best, found)
    return found


def _report(
    search: DecaySearch,
    records: _Records,
    as_it_was: Gap,
    found: Finding,
    answer: Answer,
    rivals: Sequence[Hypothesis],
) -> DiagnosisReport:
    chosen, model = answer.explanation, search.model
    best, gap, added = chosen.hypothesis, chosen.gap, chosen.hypothesis.parts
    if answer.verdict == "unknown" and not gap.closed:  # nothing is added that makes it worse
        added, gap = (), gap.unchanged()
    return DiagnosisReport(
        verdict=_verdict(answer, found, rivals),
        nominal=model,
        model=extended(model, added),
        added=added,
        best=best,
        rivals=tuple(rivals),
        compared=tuple(sorted((h.at(best.noise) for h in found.compared), key=lambda h: h.score)),
        base=found.base.at(best.noise),
        remainder=chosen.left,
        gap=gap,
        differences=as_it_was.differences_before,
        tolerance=search.options.tolerance,
        records=tuple(records.learning),
        scales=records.scales,
        interrupted=found.interrupted,
        form=search.noise.known,
        small=answer.small,
        whole=chosen.whole.differences_after,
    )


def _verdict(answer: Answer, found: Finding, rivals: Sequence[Hypothesis]) -> Verdict:
    """That of the rule; named is one thing alone, beside which all was compared."""
    chosen = answer.explanation
    best = chosen.hypothesis
    # Of values of the model several are no headline; what it lacks is, whatever moved beside it.
    several = not chosen.lacking and len(best.blamed if not best.effects else best.moved) > 1
    several |= len(rivals) > 1 or best.pliable
    if answer.verdict == "named" and (several or found.interrupted):
        return "ambiguous"
    return answer.verdict


def _explained(
    search: DecaySearch, on_tests: Gap, as_it_was: Gap, own: frozenset[str], hypothesis: Hypothesis
) -> Explanation:
    """A hypothesis with what it leaves and changes; ``own`` are names of values of the model.

    The gaps are those of the simulation, on what explanations are compared on and on whole records.
    """
    near, given = motions_of(hypothesis), (search.model, hypothesis.parts)
    gap, whole = (
        replace(before, predictions=tuple(follow(p, *given, near) for p in before.predictions))
        for before in (on_tests, as_it_was)
    )
    lacking = not own.issuperset(hypothesis.names)
    return Explanation(hypothesis, search.remainder(hypothesis), gap, whole, lacking)


def _rivals(
    answer: Answer, found: Finding, values: Sequence[Hypothesis], is_effect: bool
) -> list[Hypothesis]:
    """What the data do not tell apart from the best, itself first; odds of values as told.

    ``values`` are what values of the model do; of effects the best of these is a rival alone.
    """
    best = answer.explanation.hypothesis
    if is_effect:
        apart = sorted((h for h in values if h.names != best.names), key=lambda h: h.score)
        alike = [h for h in found.compared if len(h.effects) == len(best.effects)] + apart[:1]
        near_by = rivals_of(best, [h.at(best.noise) for h in alike])[1:]
        others = {h.names: h.at(best.noise) for h in (*found.rivals[1:], *near_by)}
        rivals = [best, *(h for names, h in others.items() if names and names != best.names)]
    else:
        effects = [h for h in (*values, *found.rivals, *found.compared) if h.effects]
        rivals = rivals_of(best, [h.at(best.noise) for h in effects])
    if answer.rival is None or answer.rival.hypothesis.names in {h.names for h in rivals}:
        return rivals
    return [*rivals, answer.rival.hypothesis.at(best.noise)]


def _least_changes(model: ReducedModel, tolerance: Tolerance) -> dict[str, float]:
    """Changes of linear values from which on they are beyond a tolerance, by their names."""
    known = model.coefficients
    return {
        LinearFrequency.name: 2 * tolerance.frequency * abs(known.get("omega^2", 0.0)),
        Viscous.name: tolerance.damping * abs(known.get("c_linear", 0.0)),
    }


def _without_small(plain: Hypothesis) -> Hypothesis:
    """The same; of several values that moved it says what is surely beyond the tolerance."""
    small = tuple(n for n in plain.moved if n in plain.matters and n not in plain.material)
    return plain if len(small) == len(plain.moved) else replace(plain, unsaid=small)


def _with_plain_values(found: Finding) -> Finding:
    """Where nothing took no part, an effect must be twice as sure to outdo values that moved."""
    best, base = found.rivals[0], found.base.at(found.rivals[0].noise)
    if not (best.effects and base.names) or base.score - best.score > UNJUDGED:
        return found
    others = [h for h in found.rivals if h.names != base.names]
    return replace(found, rivals=[*others, base])


def _agree(search: DecaySearch, slack: Hypothesis, as_it_was: Gap) -> bool:
    """Whether there is nothing to look for in the simulation as it was.

    It is within what repeats or a reference leave open, is known to be within a tolerance that was
    stated, or leaves noise alone with what a measurement may add; a stated one asks for more. Other
    modes may ask for more as well.
    """
    tolerance = search.options.tolerance
    if not slack.solution.finite or slack.misfit_elsewhere > EQUIVALENT:
        return False  # it has no motion near that of the records, or not those of other modes
    differences = as_it_was.differences_before
    if any(d.exceeds(tolerance) for d in differences):
        return False  # of what takes no part, if not of the others
    if tolerance.stated:
        return all(d.agrees(kind, tolerance) for d in differences for kind in KINDS)
    if tolerance.source != DEFAULT and as_it_was.within(tolerance):
        return True
    left = search.remainder(slack)
    return left.p_value > search.options.false_alarm and left.ratio < NOTHING_LEFT


def _snapped(search: DecaySearch, best: Hypothesis, records: Mapping[str, Record]) -> Hypothesis:
    """Round exponents to whole numbers where the data do not object, that of the textbook first."""
    for whole in (with_textbook_exponent, with_whole_exponent):
        fixed = [whole(p) for p in best.effects]
        if all(p is q for p, q in zip(fixed, best.effects, strict=True)):
            continue
        unsure, motions = search.unsure_as(best), best.solution.motions
        trial = unsure.hypothesis(fixed, motions).at(best.noise)
        rise = trial.solution.chi_squared - best.solution.chi_squared
        # No value of the model moves to make up for it.
        same = trial.solution.converged and trial.names == best.names
        if same and (
            rise < ROUNDED * best.excess
            or (_nearly(best.effects, fixed) and _as_well(search, trial, best, records))
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
    search: DecaySearch, trial: Hypothesis, best: Hypothesis, records: Mapping[str, Record]
) -> bool:
    """Whether what took no part is foretold as well."""
    after, before = (
        float(np.sqrt(np.sum(misfit_of(search.model, h, records) ** 2))) for h in (trial, best)
    )
    return after <= AS_WELL * before


# -- what needs no effect --------------------------------------------------------------------------

# Offset, gain and curvature of the sensor within what is known of them are fitted, and nobody is
# told that anything is missing. With them linear stiffness and damping are asked before any effect
# is, then each other coefficient.

_TRIED = 3  # of the coefficients, those that the screening puts first


def other_values(
    model: ReducedModel, catalogue: Sequence[Effect], known: Collection[str]
) -> tuple[Coefficient, ...]:
    """Each coefficient of a model that may be another, but for those that are ``known``.

    It goes by the name of the effect that has the same law, if there is one.
    """
    laws = {e.term(): e.name for e in catalogue}
    names = {law.key: name for law, name in laws.items() if law is not None}
    taken = {*FREE, *known, *(term.key for term in inputs_of(model))}
    return tuple(
        Coefficient(term, names.get(term.key, "coefficient"))
        for term in model.terms
        if term.key not in taken
    )


def without_effects(
    search: DecaySearch, slack: Hypothesis, base: Hypothesis, values: Sequence[Coefficient]
) -> list[Hypothesis]:
    """What nuisances do, ``slack``, linear values beside, and these with one more of ``values``.

    One more value is asked where more than noise is left. Fits begin with the linear values of
    ``base``, without nuisances: beside these a frequency that is far off is not found by itself.
    """
    started = base.solution.parts[: base.n_free] if base.solution.finite else search.free
    search = replace(search, free=(*started, *nuisances(search.records)), compared=[])
    linear = search.settled(search.hypothesis([]))
    left = search.remainder(linear)
    enough = left.explained and left.ratio < NOTHING_LEFT
    if enough or not (values and linear.solution.finite):
        linear = linear.settled(search.noise.known)
        return [slack.at(linear.noise), linear]
    known = scales(search.records)
    parts, names = linear.solution.parts, {v.variant: v for v in values}
    found = screen(search.model, parts, list(names.values()), search.records)
    singles = [s for s in found.singles() if np.isfinite(s.chi_squared)]
    # A quadratic force acts to second order in its strength, which the screening does not see.
    second = [s for s in singles[_TRIED:] if s.effect.term() == Stiffness(2)]
    asked = [*singles[:_TRIED], *second]
    trials = search.fitted([[part_of(s, known, len(search.records))] for s in asked])
    ranked = search.ranked([linear, *(h for h in trials if h.solution.finite)])
    form, most = ranked[0].noise, linear.at(ranked[0].noise).score + UNJUDGED
    return [slack.at(form), linear.at(form), *(h for h in ranked if h.effects and h.score < most)]
