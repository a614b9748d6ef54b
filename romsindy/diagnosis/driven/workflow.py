"""What a simulation lacks, from vibrations that measured inputs drive: from records to a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from romsindy.beam import Beam
from romsindy.diagnosis.checks import check_request
from romsindy.diagnosis.colour import ColourOfBest, driven_instead
from romsindy.diagnosis.driven.gap import ForcedGap
from romsindy.diagnosis.driven.report import ForcedReport
from romsindy.diagnosis.driven.search import DrivenSearch
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.search import Finding, Options
from romsindy.diagnosis.verdict import Verdict
from romsindy.diagnosis.workflow import smooth_model, unsure_parts
from romsindy.effects.base import Effect, Scales
from romsindy.effects.drive import (
    InputBetweenSamples,
    InputDelay,
    InputDistortion,
    InputGain,
    InputLag,
)
from romsindy.effects.memory import MemoryEffect
from romsindy.effects.outside import Bias, SecondMode
from romsindy.fit.coefficient import extended, in_place
from romsindy.fit.forced.between_samples import rated, ways
from romsindy.fit.forced.drives import (
    free_drives,
    freed,
    inputs_in,
    latest,
    regressed,
)
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.measured import free_offsets
from romsindy.fit.part import Part
from romsindy.fit.verdict import ABOVE_NOISE, CLOSED, NAMED_ABOVE, PREDICTED
from romsindy.physics.driven import inputs_of, without_inputs
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import INTERPOLATIONS, Interpolation

# Steps of a record, where more than the least in a cycle are not needed: many fits are compared.
_AFFORDABLE = 3000
# What follows a free vibration only: loops along slow changes of its amplitude, a mode that rings
# down. The zero of the sensor is fitted always.
_OF_DECAYS = (MemoryEffect, SecondMode, Bias)
_POWERS = 2, 3  # of an input that is distorted


def forced_alone(measured: object) -> list[ForcedVibration]:
    """Forced vibrations, one or several, as a list; empty where there are none.

    Raises
    ------
    ValueError
        For decays among them.
    """
    several = list(measured) if isinstance(measured, (list, tuple)) else [measured]
    driven = [v for v in several if isinstance(v, ForcedVibration)]
    if driven and len(driven) < len(several):
        raise ValueError(
            "measured holds forced vibrations and others: diagnose decays, and forced vibrations,"
            " one kind at a time"
        )
    return driven


def refuse_with_inputs(**given: object) -> None:
    """Refuse arguments that belong to decays, or to a beam.

    Raises
    ------
    ValueError
        By the name of the argument.
    """
    strange = [name for name, value in given.items() if value is not None]
    if strange:
        raise ValueError(
            f"{strange[0]} = ... does not go with forced vibrations: leave it out, or diagnose"
            " decays"
        )


def diagnose_forced(
    model: ReducedModel | Beam,
    measured: Sequence[ForcedVibration],
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    options: Options,
) -> ForcedReport:
    """Find, name and add what a reduced model lacks; arguments as those of `diagnose`.

    Gain and delay of an input that the model has are known, and may turn out to be wrong. Of other
    inputs both are fitted whatever the hypothesis.
    """
    if not isinstance(model, ReducedModel):
        raise ValueError(
            f"model is a {type(model).__name__}, and forced vibrations are compared with a"
            " ReducedModel: reduce it first, beam.reduce(...)"
        )
    check_request(model, measured, None, free, tolerances)
    _check_inputs(model, measured)
    records = _records(measured, options.floor)
    scales = _scales(records)
    model = smooth_model(model, scales)
    unsure = unsure_parts(model, free, tolerances, scales, len(records))
    options = replace(options, catalogue=_catalogue(model, unsure, tolerances, options))
    given = (model, records, scales, unsure, options)
    search = _search(*given, ways(measured)[0])
    found = search.run()
    way, note = _between_samples(search, found.rivals[0], measured)
    if way != ways(measured)[0]:
        search = _search(*given, way)
        found = search.run()
    return _report(search, found, note)


def _report(search: DrivenSearch, found: Finding, note: Sequence[str]) -> ForcedReport:
    records, best = search.records, found.rivals[0]
    left = search.remainder(best)
    gap = ForcedGap.of(records, found.base.solution.residuals, best.solution.residuals)
    verdict: Verdict
    little = gap.closed >= CLOSED and left.ratio <= PREDICTED
    if not (left.explained or little):
        verdict = "unknown"
    elif not best.names:
        verdict = "none"
    else:
        several = len(found.rivals) > 1 or len(best.moved) > 1 or found.interrupted
        verdict = "ambiguous" if several or best.sureness < NAMED_ABOVE else "named"
    added = best.parts if best.names else ()
    return ForcedReport(
        verdict=verdict,
        nominal=search.model,
        model=extended(driven_instead(search.model, best.parts), added) if added else search.model,
        best=best,
        rivals=tuple(found.rivals),
        compared=tuple(found.compared),
        base=found.base,
        remainder=left,
        gap=gap,
        records=tuple(records),
        scales=search.scales,
        added=added,
        interrupted=found.interrupted,
        notes=(*note, *_on_inputs(search)),
    )


def _records(measured: Sequence[ForcedVibration], floor: float) -> list[ForcedRecord]:
    records = [ForcedRecord.of(v, floor, _AFFORDABLE) for v in measured]
    for i, record in enumerate(records):
        if np.std(record.signal) < ABOVE_NOISE * record.noise.std:
            raise ValueError(
                f"record {i} is noise: its rms of {np.std(record.signal):.3g} is below twice the"
                f" noise ({record.noise.std:.3g}); check the channel, or excite more"
            )
    return records


def _check_inputs(model: ReducedModel, measured: Sequence[ForcedVibration]) -> None:
    for term in inputs_of(model):
        for i, v in enumerate(measured):
            if term.source not in v.names:
                raise ValueError(
                    f"the model is driven by {term.source!r}, and record {i} has {list(v.names)}:"
                    " give all inputs under the names of the model"
                )


def _scales(records: Sequence[ForcedRecord]) -> Scales:
    """Of all records together."""
    longest = max(records, key=lambda r: r.t[-1])
    return Scales(max(r.amplitude for r in records), longest.rate, float(longest.t[-1]))


def _catalogue(
    model: ReducedModel,
    unsure: Sequence[Part],
    tolerances: Mapping[str, float],
    options: Options,
) -> tuple[Effect, ...]:
    """What can be looked for in these records, and what may be wrong with the inputs."""
    taken = {p.effect.name for p in unsure}
    driven = [e for e in options.catalogue if not isinstance(e, _OF_DECAYS)]
    catalogue = [e for e in driven if e.name not in taken]
    known = [c for c in in_place(model, catalogue) if c.of.key not in tolerances]
    inputs = [(replace(t, delay=0.0), t.delay) for t in inputs_of(model)]
    plain = [(t, late) for t, late in inputs if t.power == 1]
    powers = [(replace(t, power=power), late) for t, late in plain for power in _POWERS]
    distorted = [InputDistortion(*p) for p in powers if p[0].key not in model.coefficients]
    gains = [InputGain(*given) for given in inputs]
    return (*catalogue, *known, *gains, *distorted)


def _search(
    model: ReducedModel,
    records: Sequence[ForcedRecord],
    scales: Scales,
    unsure: tuple[Part, ...],
    options: Options,
    way: Interpolation,
) -> DrivenSearch:
    """A search in which the inputs that the model does not know do this between their samples."""
    own = {t.source for t in inputs_of(model)}
    others = [t for t in inputs_in([r.decay for r in records], way) if t.source not in own]
    drives: tuple[Part, ...] = ()
    if others:
        gains = regressed(without_inputs(model).terms, others, records)[1].tolist()
        drives = free_drives(others, gains, records)
    beside = (*drives, free_offsets(records))
    given = (model, records, unsure, options, ColourOfBest(), beside)
    return DrivenSearch(*given, scales=scales, chain=_chain(model, records))


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


def _between_samples(
    search: DrivenSearch, best: Hypothesis, measured: Sequence[ForcedVibration]
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


def _on_inputs(search: DrivenSearch) -> list[str]:
    """That gains were fitted, and what cannot be seen then."""
    free = [p.effect.variant for p in search.beside if p.effect.name == "input"]
    if not free:
        return []
    return [
        f"the model has no {', '.join(free)}: gain and delay are fitted, so that a wrong one, or a"
        " factor on all forces, is not seen; add the Input to the model where it is known"
    ]
