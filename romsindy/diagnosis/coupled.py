"""What a model of several coordinates lacks, from decays in which they ring together.

Candidates are effects on one of the coordinates, and couplings that the model does not have. Mode
shapes beyond the main channels are fitted whatever the hypothesis, and the scale of a coordinate,
the gain of its main channel, as far as a measurement may be off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from romsindy.diagnosis.arguments import FREE, check_repeats, check_request
from romsindy.diagnosis.colour import Coloured, ColourOfBest
from romsindy.diagnosis.difference import Tolerance
from romsindy.diagnosis.held_out import tested
from romsindy.diagnosis.residual_report import CoupledDiagnosis, report_of
from romsindy.diagnosis.residual_search import ResidualSearch
from romsindy.diagnosis.search import Finding, Options
from romsindy.diagnosis.tolerance_sources import linear_values_within, of_driven_repeats
from romsindy.diagnosis.unsure import unsure_parts
from romsindy.effects.base import Effect, ReadingEffect, Scales
from romsindy.fit.adequacy import Adequacy, examine
from romsindy.fit.coefficient import Coefficient, OnCoordinate, in_place
from romsindy.fit.coupled_record import CoupledRecord, coupled_records, free_shapes
from romsindy.fit.coupled_terms import Kind, candidates
from romsindy.fit.estimate import Estimate
from romsindy.fit.friction import smoothed
from romsindy.fit.gauss_newton import Solution
from romsindy.fit.measured import small_frequencies
from romsindy.fit.mode_shape import ModeShape
from romsindy.fit.part import Part
from romsindy.fit.verdict import KNOWN_GAIN, SHARED
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import Along
from romsindy.physics.damping import PowerDamping
from romsindy.physics.stiffness import Stiffness
from romsindy.record.decay import Decay
from romsindy.text import quantity


@dataclass(frozen=True)
class Coupling(Coefficient):
    """What couples coordinates: a term that the model lacks, or has with another value."""

    label = "a coupling of modes"


def diagnose_coupled(
    model: CoupledModel,
    measured: Sequence[Decay],
    held_out: Decay | None,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    options: Options,
) -> CoupledDiagnosis:
    """Find, name and add what a model of several coordinates lacks; arguments as of `diagnose`."""
    linear = linear_values(model)
    free = [name for f in free for name in _of_every_coordinate(f, linear)]
    check_request(model, measured, held_out, free, tolerances, may_be_free=(*FREE, *linear))
    everything = [*measured, *([] if held_out is None else [held_out])]
    records = _records(model, everything, options.floor)
    test = None if held_out is None else records.pop()
    search = _search(model, records, free, tolerances, options)
    slack = linear_values_within(search, list(linear.values()))
    if slack is not None:
        exact = search.with_free(()).hypothesis([])
        found = Finding([slack], [slack, exact], exact)
    else:
        found = search.run()
        if test is not None and not found.interrupted:
            found = tested(search, found, test)
    return report_of(search, found, test, _notes(model, everything), CoupledDiagnosis)


def of_coupled_repeats(
    model: CoupledModel, repeats: Sequence[Decay], options: Options
) -> Tolerance:
    """What runs of one test of several coordinates differ by; see `of_driven_repeats`."""
    check_repeats(repeats)
    linear = list(linear_values(model))
    records = _records(model, repeats, options.floor)
    return of_driven_repeats([_search(model, [r], linear, {}, options) for r in records])


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
    model: CoupledModel,
    records: Sequence[CoupledRecord],
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    options: Options,
) -> ResidualSearch:
    """A search beside the mode shapes."""
    model, each = smoothed(model, records), _scales(model, records)
    largest = max(each, key=lambda scales: scales.amplitude)
    given = (model, free, tolerances, largest, len(records), linear_values(model))
    unsure = unsure_parts(*given)
    mains = [ModeShape(channel, i) for i, channel in enumerate(records[0].main)]
    sought = _sought(model, options.catalogue, each, unsure, tolerances)
    options = replace(options, catalogue=(*sought, *mains))
    gains = [Part(e, (), np.zeros((1, 1)), KNOWN_GAIN, KNOWN_GAIN) for e in mains]
    beside = (*free_shapes(records), *gains)
    noise = ColourOfBest(_examined, Coloured.of, unsettled=True)
    return ResidualSearch(model, records, unsure, options, noise, beside, scales=largest, chain=())


def _examined(
    model: CoupledModel, solution: Solution, records: Sequence[CoupledRecord], false_alarm: float
) -> Adequacy:
    return examine(records, solution.residuals, solution.n_values, false_alarm)


def _sought(
    model: CoupledModel,
    catalogue: Sequence[Effect],
    scales: Sequence[Scales],
    unsure: Sequence[Part],
    tolerances: Mapping[str, float],
) -> list[Effect]:
    """Effects on every coordinate, couplings, and too much of what the model has already."""
    taken = {p.effect.name for p in unsure}
    forces = [e for e in catalogue if not (isinstance(e, ReadingEffect) or e.per_record)]
    on = [OnCoordinate(e, i, own) for e in forces for i, own in enumerate(scales, 1)]
    on = [e for e in on if e.name not in taken]
    known = [c for c in in_place(model, on) if c.of.key not in tolerances]
    n = model.n_coordinates
    alone = candidates(n, Kind(coupled=False))
    missing = [t for t in candidates(n, Kind()) if t not in alone]
    own = [t for t in model.terms if not isinstance(t, Along) and t not in alone]
    couplings = {t.key: t for t in (*own, *missing) if t.key not in tolerances}
    return [*on, *known, *(Coupling(t, f"coupling {key}") for key, t in couplings.items())]


def _scales(model: CoupledModel, records: Sequence[CoupledRecord]) -> list[Scales]:
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
