"""What a simulation lacks, from measured free decays: the workflow from records to a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from romsindy.diagnosis.checks import check_request, checked_records, over_shared_amplitudes
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.prediction import predict
from romsindy.diagnosis.report import DiagnosisReport, verdict_of
from romsindy.diagnosis.search import Options, Search
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Scales
from romsindy.fit.coefficient import Coefficient, extended
from romsindy.fit.part import Part
from romsindy.fit.record import Record, scales
from romsindy.fit.verdict import ROUNDED
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.signals import fundamental_frequency

_TRAINING = 0.75  # of each record, where no other record is held out
_LEAST_CYCLES = 6  # of a part that is held out


def diagnose_model(
    model: ReducedModel,
    measured: Sequence[Decay],
    held_out: Decay | None,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    options: Options,
) -> DiagnosisReport:
    """Find, name and add what a reduced model lacks; arguments as those of `diagnose`."""
    check_request(model, measured, held_out, free, tolerances, options.false_alarm)
    several = [over_shared_amplitudes(model, d) for d in measured]
    training, late = _split(several, held_out)
    records = checked_records(model, training, options.floor)
    tests = [Record.loud(d, options.floor) for d in late] or records
    all_scales = scales(records)
    model = _smooth_model(model, all_scales)
    parts = _unsure(model, free, tolerances, all_scales, len(records))
    names = {p.effect.name for p in parts}
    looked_for = tuple(e for e in options.catalogue if e.name not in names)
    search = Search(model, records, parts, replace(options, catalogue=looked_for))
    found = search.run()
    best = found.rivals[0] if found.interrupted else _snapped(search, found.rivals[0])
    rivals = [best, *(h.at(best.form) for h in found.rivals[1:])]
    left = search.remainder(best)
    gap = Gap(tuple(predict(model, best.parts, test) for test in tests), bool(late))
    return DiagnosisReport(
        verdict=verdict_of(best, rivals, left, gap),
        nominal=model,
        model=extended(model, best.parts),
        best=best,
        rivals=tuple(rivals),
        compared=tuple(found.compared),
        base=found.base,
        remainder=left,
        gap=gap,
        records=tuple(records),
        scales=all_scales,
        interrupted=found.interrupted,
    )


def _split(
    several: Sequence[Decay], held_out: Decay | None
) -> tuple[Sequence[Decay], Sequence[Decay]]:
    """Records to learn from, and what takes no part: nothing where all are too short."""
    if held_out is not None:
        return several, [held_out]
    early, late = [], []
    for decay in several:
        cut = decay.t[0] + _TRAINING * (decay.t[-1] - decay.t[0])
        cycles = fundamental_frequency(decay.single().q, decay.dt) * (decay.t[-1] - cut)
        if cycles < _LEAST_CYCLES:
            early.append(decay)
        else:
            early.append(decay.between(end=cut))
            late.append(decay.between(start=cut))
    return early, late


def _smooth_model(model: ReducedModel, all_scales: Scales) -> ReducedModel:
    """Dry friction that the model has already must not jump."""
    if all(term.smooth for term in model.terms):
        return model
    return model.regularised(0.01 * all_scales.amplitude * all_scales.omega)


def _unsure(
    model: ReducedModel,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    all_scales: Scales,
    n_records: int,
) -> tuple[Part, ...]:
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
    fixed = [_with_textbook_exponent(p) for p in best.effects]
    if all(p is q for p, q in zip(fixed, best.effects, strict=True)):
        return best
    trial = search.hypothesis(fixed).at(best.form)
    rise = trial.solution.chi_squared - best.solution.chi_squared
    return trial if trial.solution.converged and rise < ROUNDED else best


def _with_textbook_exponent(part: Part) -> Part:
    known = [
        replace(p, low=p.starts[0], high=p.starts[0]) if p.name == "exponent" else p
        for p in part.parameters
    ]
    if known == list(part.parameters):
        return part
    shape = np.clip(part.shape, [p.low for p in known], [p.high for p in known])
    return replace(part.shaped(shape), parameters=tuple(known))
