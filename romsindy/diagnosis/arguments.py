"""Arguments that cannot be meant are refused, with a hint, before anything is looked at."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.ndimage import uniform_filter1d

from romsindy.beam.beam import Beam
from romsindy.diagnosis.difference import DEFAULT, KINDS, Difference, Tolerance
from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError, Hypothesis
from romsindy.diagnosis.gap import beyond_noise, noise_std, predict
from romsindy.diagnosis.residual_search import ResidualSearch
from romsindy.diagnosis.search import LINEAR, Finding, Request
from romsindy.effects import QuadraticStiffness
from romsindy.effects.base import Effect
from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.linear_response import nodes
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.prepared import creeping
from romsindy.fit.records.driven import ForcedRecord
from romsindy.fit.records.record import Record, scales
from romsindy.fit.results.estimate import Estimate
from romsindy.fit.verdict import (
    ABOVE_NOISE,
    EXPLAINED,
    LEAST_CYCLES,
    NO_OVERLAP,
    OTHER_MODE,
    REVERSED,
    REVERSED_IS_BETTER,
    REVERSED_IS_NO_WORSE,
    SHARED,
    SURE,
)
from romsindy.physics.equations import Equations, inputs_of
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Given
from romsindy.record.signals import rest_level
from romsindy.record.smoothing import HarmonicSpline, swing
from romsindy.record.units import UNITS
from romsindy.text import listed, quantity
from romsindy.typing import Array

FREE = (*LINEAR,)
_WHOLE = (int, np.integer)
_NUMBER = (*_WHOLE, float, np.floating)


def decays_of(name: str, argument: object) -> list[Decay]:
    """One decay or several, as a list; other things are refused by the name of the argument."""
    given = Given.of(argument)
    for wrong in (*given.others, *given.driven):
        if wrong is argument and given.others:
            raise ValueError(f"{name} = {wrong!r} must be a Decay, or several of them in a list")
        raise ValueError(
            f"{name} holds a {type(wrong).__name__}: give Decay objects, as load_decay reads them"
        )
    return given.decays


def check_numbers(
    floor: float, false_alarm: float, max_effects: int, n_jobs: int, budget: float | None
) -> None:
    """Raise a ValueError for settings of a search that are no numbers, or not of their range."""
    if not (isinstance(floor, _NUMBER) and 0 < floor < 1):
        raise ValueError(f"floor = {floor!r} must be a part of the largest amplitude, below 1")
    if not (isinstance(false_alarm, _NUMBER) and 0 < false_alarm < 1):
        raise ValueError(f"false_alarm = {false_alarm!r} must be a probability between 0 and 1")
    if not (isinstance(max_effects, _WHOLE) and max_effects >= 0):
        raise ValueError(f"max_effects = {max_effects!r} must be a number of effects, such as 3")
    if not (isinstance(n_jobs, _WHOLE) and n_jobs != 0):
        raise ValueError(f"n_jobs = {n_jobs!r} must be a number of processes; -1 uses all cores")
    if budget is not None and not (isinstance(budget, _NUMBER) and budget > 0):
        raise ValueError(f"budget = {budget!r} must be seconds, such as 60")


def check_request(
    model: Equations,
    request: Request,
    word: str = "decay",
    may_be_free: Collection[str] = FREE,
) -> None:
    """Raise a ValueError for arguments that cannot be meant: "decay 0" in messages."""
    free, tolerances, everything = request.free, request.tolerances, request.everything
    if not request.measured:
        raise ValueError("measured is empty: give at least one Decay")
    if isinstance(free, str) or not isinstance(free, Iterable):
        raise ValueError(f"free = {free!r} must be a list of names or effects, such as ['omega^2']")
    unknown = [name for name in free if not isinstance(name, Effect) and name not in may_be_free]
    if unknown:
        raise ValueError(
            f"free = {list(free)}: {unknown} cannot be free; use names of {list(may_be_free)}, and"
            " tolerances for other coefficients"
        )
    if not isinstance(tolerances, Mapping):
        raise ValueError(
            f"tolerances = {tolerances!r} must map names to relative standard deviations, such as"
            " {'gamma_3': 0.05}"
        )
    for name, relative in tolerances.items():
        if name not in model.coefficients:
            raise ValueError(
                f"tolerances name {name!r}, but the model has {list(model.coefficients)}"
            )
        if not (isinstance(relative, _NUMBER) and 0 < relative < float("inf")):
            raise ValueError(f"tolerances of {name} = {relative!r} must be positive (relative)")
        if model.coefficients[name] == 0:
            raise ValueError(
                f"tolerances name {name!r}, which is 0 in the model: a relative tolerance of 0 is"
                " none; give the coefficient its expected size, or leave it to the catalogue"
            )
    for i, decay in enumerate(everything):
        if decay.unit is not None and model.unit is not None and decay.unit != model.unit:
            known = UNITS.get(model.unit)
            remedy = f"load the {word} with unit={model.unit!r}, or give"
            if known is None or known.base == decay.unit:  # records are in SI once they are read
                remedy = "give"
            raise ValueError(
                f"{word} {i} is in {decay.unit}, the model in {model.unit}: {remedy} the model's"
                f" coefficients for q in {decay.unit}"
            )
        if any(np.array_equal(decay.signal, other.signal) for other in everything[:i]):
            raise ValueError(
                f"{word} {i} is the same record as an earlier one: give it once, and hold out"
                " another"
            )


def forced_alone(measured: object) -> list[ForcedVibration]:
    """Forced vibrations, one or several, as a list; empty where there are none.

    Raises a ValueError for decays among them.
    """
    given = Given.of(measured)
    if 0 < len(given.driven) < len(given.several):
        raise ValueError(
            "measured holds forced vibrations and others: diagnose decays, and forced vibrations,"
            " one kind at a time"
        )
    return given.driven


def refuse_beside(what: str, instead: str, **given: object) -> None:
    """Refuse arguments that do not go with something, and say what to do instead.

    Raises a ValueError by the name of the argument.
    """
    strange = [name for name, value in given.items() if value is not None]
    if strange:
        raise ValueError(f"{strange[0]} = ... does not go with {what}: leave it out, or {instead}")


def driven_of(name: str, given: object) -> list[ForcedVibration]:
    """Driven records of an argument beside driven ``measured``, one or several, as a list.

    Raises a ValueError for decays, and for anything else.
    """
    found = Given.of(given)
    for wrong in (*found.others, *found.decays):
        raise ValueError(
            f"{name} = a {type(wrong).__name__} does not go with forced vibrations: give a"
            " ForcedVibration, with its inputs"
        )
    return found.driven


def reduced(model: Equations | Beam) -> ReducedModel:
    """The model, if it is one that driven records can be compared with.

    Raises a ValueError for a Beam, and for several coordinates.
    """
    if not isinstance(model, Beam) and model.n_coordinates == 1:
        model.refuse_memory("what is compared here")
        return cast(ReducedModel, model)
    beam = isinstance(model, Beam)
    remedy = "reduce it first, beam.reduce(...)" if beam else "give that of one coordinate"
    raise ValueError(
        f"model is a {type(model).__name__}, and forced vibrations are compared with a"
        f" ReducedModel: {remedy}"
    )


def check_inputs(
    model: ReducedModel, measured: Sequence[ForcedVibration], word: str = "record"
) -> None:
    """Raise a ValueError for a record without an input of the model."""
    for term in inputs_of(model):
        for i, v in enumerate(measured):
            if term.source not in v.names:
                raise ValueError(
                    f"the model is driven by {term.source!r}, and {word} {i} has {list(v.names)}:"
                    " give all inputs under the names of the model"
                )


def check_repeats(repeats: Sequence[Any], word: str = "record") -> None:
    """Raise a ValueError for fewer than two runs of a test, or one that is there twice."""
    if len(repeats) < 2:
        raise ValueError(f"repeats holds {len(repeats)} {word}: give two or more of the same test")
    if any(a.same_record(b) for i, a in enumerate(repeats) for b in repeats[:i]):
        raise ValueError("repeats holds a record twice: give each run of the test once")


# -- records ---------------------------------------------------------------------------------------


# Asymmetry drifts with amplitude alone: so many cycles between knots average the noise.
_ASYMMETRY_CYCLES = 20.0


class Shared(NamedTuple):
    """The part of a decay whose amplitudes the model holds for, and what was left out, in words."""

    decay: Decay
    left_out: str = ""


def shared_part(model: ReducedModel, decay: Decay) -> Shared:
    """Cut a decay to the amplitudes that the model reaches up and down to, where it says so.

    Raises a ValueError if they have next to none in common.
    """
    if model.amplitude_range is None:
        return Shared(decay)
    (low, high), unit = model.amplitude_range, model.unit or "[q]"
    told, x = [], decay.single().q
    level = rest_level(x, decay.dt) if np.abs(x).max() > high / SHARED else 0.0
    if level:  # the model has no motion about it
        told.append(f"rests at {quantity(level, unit)}, which is taken off")
        decay = replace(decay, q=x - level)
    centred, cycle = swing(x)
    envelope = np.sqrt(2 * np.maximum(uniform_filter1d(centred**2, cycle, mode="mirror"), 0.0))
    largest = float(envelope.max())
    first = int(np.flatnonzero(np.append(True, envelope > high / SHARED))[-1])
    last = int(np.flatnonzero(np.append(True, envelope >= SHARED * low))[-1])
    if last - first < 2 * cycle:
        if NO_OVERLAP * low <= largest <= high / SHARED:
            return Shared(decay, listed(told or [""]))  # a little below
        raise ValueError(
            f"it reaches {largest:.3g}, the model holds from {low:.3g} to {high:.3g} {unit}: no"
            " overlap in amplitude, so of other scale; check the unit of the record, or excite"
            f" {'more' if largest < low else 'less'}"
        )
    if first:
        reached = float(np.ptp(x)) / 2
        told.append(f"reaches {quantity(reached, unit)}, the model {quantity(high, unit)}")
    if last < len(x):
        told.append(f"falls below {quantity(low, unit)}, the least of the model")
    if not told:
        return Shared(decay)
    part = decay.between(float(decay.t[first]), float(decay.t[last - 1]))
    return Shared(part, f"{listed(told)}: compared from {part.t[0]:.4g} to {part.t[-1]:.4g} s")


def checked_records(
    model: ReducedModel, decays: Sequence[Decay], floor: float, word: str = "decay"
) -> list[Record]:
    """Prepare records, and refuse those that the model cannot be about: "decay 0" in messages."""
    records = []
    for i, decay in enumerate(decays):
        name = f"{word} {i}"
        try:
            record = Record.loud(shared_part(model, decay).decay, floor)
        except ValueError as error:
            raise ValueError(f"{name} cannot be analysed: {error}") from error
        n_cycles = _turns(record) / (2 * np.pi)
        if n_cycles < LEAST_CYCLES:
            raise ValueError(
                f"{name} holds {n_cycles:.1f} cycles, at least {LEAST_CYCLES} are needed: record"
                " longer, or start earlier"
            )
        signal = record.spline(record.t)[0]
        if np.std(signal) < ABOVE_NOISE * record.noise.std:
            raise ValueError(
                f"{name} is noise: its vibration (rms {np.std(signal):.3g}) is below twice the"
                f" noise (rms {record.noise.std:.3g}); check the channel, or excite more"
            )
        _check_frequency(model, record, name)
        records.append(record)
    _check_sign(model, records, word)
    return records


def _turns(record: Record) -> float:
    t = record.t
    return float(record.spline.phase(t[-1]) - record.spline.phase(t[0]))


def _check_frequency(model: ReducedModel, record: Record, name: str) -> None:
    measured = _turns(record) / record.t[-1]
    largest = float(np.ptp(record.motion.q)) / 2  # an offset is no amplitude
    reach = model.amplitude_range
    top = largest if reach is None else min(largest, reach[1])
    said = model.backbone(top * np.array([0.05, 0.2, 0.5, 1.0]))
    if np.all(np.isnan(said)):
        raise ValueError(
            f"the model has no periodic motion at the amplitudes of {name} (up to"
            f" {largest:.3g}): check the unit of the record, or its scale"
        )
    ratio = measured / np.nanmedian(said)
    if not 1 / OTHER_MODE < ratio < OTHER_MODE:
        raise ValueError(
            f"{name} vibrates at {measured / 2 / np.pi:.4g} Hz, the model at"
            f" {np.nanmedian(said) / 2 / np.pi:.4g} Hz: another mode, another time unit, or another"
            " scale of the displacement; if its mode is in the record, isolate it (inspect names"
            " it, mode= takes it)"
        )


def _check_sign(model: ReducedModel, records: Sequence[Record], word: str) -> None:
    """Refuse records whose asymmetry is that of the model, mirrored."""
    alike = [i for i, record in enumerate(records) if _mirrored_asymmetry(model, record)]
    if alike and _fit_mirrored(model, [records[i] for i in alike]):
        raise ValueError(
            f"{word} {alike[0]} fits the model better with its sign reversed: pass Decay(t, -q); if"
            " the sign is certain, the model's even terms (gamma_2, Upsilon_4, ...) have the wrong"
            " one"
        )


def _mirrored_asymmetry(model: ReducedModel, record: Record) -> bool:
    """Whether the asymmetry of a record is about -1 times that of the model.

    Even forces deflect the vibration by a mean and a second harmonic. What of them the odd forces
    of the measured motion balance is -1 times what the even forces say, or +1 if q has the other
    sign; an effect that is missing makes it anything.
    """
    t, *state = nodes(record.motion)
    q, q_dot, q_ddot = (x[:, 0] for x in state)
    residual, mirrored = model.residual(q, q_dot, q_ddot), model.residual(-q, -q_dot, -q_ddot)
    even = _asymmetry(record, t, (residual + mirrored) / 2)
    odd = _asymmetry(record, t, (residual - mirrored) / 2)
    size = float(even @ even)
    if size == 0:
        return False
    part = float(even @ odd) / size
    error = float(np.sqrt(np.mean((odd - part * even) ** 2) / size))
    return abs(part - 1) < REVERSED and error < REVERSED / 2


def _fit_mirrored(model: ReducedModel, records: Sequence[Record]) -> bool:
    """Whether records fit much better mirrored, and no quadratic force explains them as well.

    Such a force may reverse the model's own, but not its other even terms.
    """
    at = scales(records)
    free = [Part.of(effect, at, 1) for effect in LINEAR.values()]
    quadratic = Part.of(QuadraticStiffness(), at, 1)
    mirrored = fit(model, free, [_mirrored(r) for r in records]).chi_squared
    if mirrored > REVERSED_IS_BETTER * fit(model, free, records).chi_squared:
        return False
    direct = fit(model, [*free, quadratic], records).chi_squared
    explained = direct < EXPLAINED**2 * sum(r.count for r in records)
    return not explained or mirrored < REVERSED_IS_NO_WORSE * direct


def _mirrored(record: Record) -> Record:
    m = record.motion
    motion = Trajectory(m.grid, -m.q, -m.q_dot, -m.q_ddot)
    return replace(record, signal=-record.signal, motion=motion)


def _asymmetry(record: Record, t: Array, force: Array) -> Array:
    """Mean and second harmonic of the deflection by a force, unit of q times omega^2.

    The mean of the mean is left out: it may be an offset of the sensor.
    """
    z = HarmonicSpline.along(record.spline.phase, t, force, _ASYMMETRY_CYCLES, 2).amplitudes.c
    mean, second = z[:, 0].real, z[:, 2] / (1 - 2**2)
    return np.concatenate([mean - np.mean(mean), second.real, second.imag])


# Steps of a record, where more than the least in a cycle are not needed: many fits are compared.
_AFFORDABLE = 3000


def checked_driven(
    measured: Sequence[ForcedVibration], floor: float, word: str = "record"
) -> list[ForcedRecord]:
    """Prepare records, and refuse noise: "record 0" in messages."""
    records = [ForcedRecord.of(v, floor, _AFFORDABLE) for v in measured]
    for i, record in enumerate(records):
        if np.std(record.signal) < ABOVE_NOISE * record.noise.std:
            raise ValueError(
                f"{word} {i} is noise: its rms of {np.std(record.signal):.3g} is below twice the"
                f" noise ({record.noise.std:.3g}); check the channel, or excite more"
            )
    return creeping(records)


_FROM = 0.1  # of the largest amplitude: bands of an estimate are wide below
_BAND = 2.0  # standard errors


def stated(tolerance: object) -> Tolerance:
    """A tolerance as a user gives it: of the frequency, or by kind, or ready.

    Raises a ValueError if it is none of these.
    """
    if isinstance(tolerance, Tolerance):
        return tolerance
    if isinstance(tolerance, Real) and not isinstance(tolerance, bool):
        return Tolerance(frequency=float(tolerance), source="stated")
    if isinstance(tolerance, Mapping) and set(tolerance) <= set(KINDS):
        return Tolerance(**tolerance, source="stated")
    raise ValueError(
        f"tolerance = {tolerance!r} must be a relative size of the frequency, such as 0.001, or a"
        f" mapping of {list(KINDS)} to such sizes"
    )


def of_repeats(repeats: Sequence[Decay], floor: float) -> Tolerance:
    """How far decays that were measured again are from each other, at equal amplitude.

    Raises a ValueError if there are fewer than two, one is there twice, or two share no amplitudes.
    """
    check_repeats(repeats, "decay")
    try:
        records = [Record.loud(d, floor) for d in repeats]
        found = [Difference.between(a, b) for a, b in itertools.combinations(records, 2)]
    except ValueError as error:
        raise ValueError(f"repeats of the same test cannot be compared: {error}") from error
    return _largest(found, "repeats")


def of_references(
    model: ReducedModel, references: Sequence[Decay], floor: float
) -> tuple[Tolerance, FormError]:
    """What a model leaves on the records that it was identified from.

    Raises a ValueError if a record cannot be that of the model.
    """
    records = checked_records(model, references, floor, "reference")
    form = NO_FORM_ERROR
    for reference in references:
        form = form.joined(FormError.of(model, reference, floor))
    left = [Difference.of(r, predict(model, (), r).before) for r in records]
    return _largest(left, "reference"), form


def of_estimate(estimate: Estimate, largest: float) -> Tolerance:
    """How far the curves of an estimate may be off, at amplitudes up to one (unit of q)."""
    band = estimate.band(np.geomspace(_FROM * largest, largest, 12))
    off = {
        "frequency": band.frequency_std / band.frequency,
        "damping": np.abs(band.damping_ratio_std / band.damping_ratio),
    }
    bands = {}
    for kind, part in off.items():
        known = np.isfinite(part)
        if np.any(known):
            bands[kind] = np.array([band.amplitude[known], _BAND * part[known]])
    return Tolerance(0.0, 0.0, 0.0, "bands", sources=dict.fromkeys(KINDS, DEFAULT), bands=bands)


def _largest(differences: Sequence[Difference], source: str) -> Tolerance:
    """The largest difference that is sure, or what all cycles leave open."""
    sizes = dict.fromkeys(KINDS, 0.0)
    for kind, d in itertools.product(KINDS, differences):
        value, std = _value(d, kind)
        parts = [_value(p, kind) for p in d.parts]
        sure = [abs(v) + s for v, s in parts if abs(v) > SURE * s]
        sizes[kind] = max([sizes[kind], abs(value) + std, *sure])
    return Tolerance.read_off(sizes, source)


def _value(difference: Difference, kind: str) -> tuple[float, float]:
    return getattr(difference, kind), getattr(difference, f"{kind}_std")


def _size(model: Equations, part: Part) -> float:
    """Change of a linear value by all of the frequency, or of the damping ratio."""
    law = part.effect.term()
    now = 0.0 if law is None else model.coefficients.get(law.key, 0.0)
    return abs(2 * now if _kind(part) == "frequency" else now)


def _kind(part: Part) -> str:
    return "damping" if part.effect.family == "damping" else "frequency"


def linear_values_within(search: ResidualSearch, linear: Sequence[Effect]) -> Finding | None:
    """Frequencies and damping alone, if neither they nor what is left matter; None if they do.

    They are changes of the ``linear`` values, fitted. What is left beyond the noise is tolerated
    only as a user, or repeats, say.
    """
    tolerance = search.options.tolerance
    parts = [Part(effect, (), np.zeros((1, 1))) for effect in linear]
    free = tuple(p for p in parts if _size(search.model, p) > 0)
    found = replace(search, free=free, compared=[]).hypothesis([])
    residuals = found.solution.residuals
    little = (
        tolerance.source != DEFAULT and beyond_noise(search.records, residuals) <= tolerance.signal
    )
    if not (found.solution.finite and (little or search.remainder(found).explained)):
        return None
    for i, part in enumerate(free):
        value, std = abs(found.parts[i].strengths[0, 0]), found.covariance[i, i] ** 0.5
        if value + std > getattr(tolerance, _kind(part)) * _size(search.model, part):
            return None
    slack = replace(found, unsaid=tuple(p.effect.name for p in free))
    exact = search.with_free(()).hypothesis([])
    return Finding([slack], [slack, exact], exact)


def of_driven_repeats(searches: Sequence[ResidualSearch]) -> Tolerance:
    """What runs of one driven test differ by, each with a search of its own.

    Frequency and damping are fitted to each; what their fits leave differs by the signal.

    Raises a ValueError if runs differ in length, or the model has no motion near one of them.
    """
    fits = [search.hypothesis([]) for search in searches]
    if not all(h.solution.finite for h in fits):
        raise ValueError(
            "repeats of the same test cannot be compared: the model has no motion near one of them"
        )
    sizes = dict.fromkeys(("frequency", "damping", "signal"), 0.0)
    pairs = zip(searches, fits, strict=True)
    for (one, a), (other, b) in itertools.combinations(list(pairs), 2):
        for kind, size in _values_apart(one.model, a, b):
            sizes[kind] = max(sizes[kind], size)
        sizes["signal"] = max(sizes["signal"], _signals_apart(one, a, other, b))
    return Tolerance.read_off(sizes, "repeats")


def _values_apart(model: Equations, a: Hypothesis, b: Hypothesis) -> list[tuple[str, float]]:
    """How far frequencies and dampings may be apart, by their standard errors."""
    apart = []
    for i, part in enumerate(a.parts[: a.n_unsure]):
        size = _size(model, part)
        value = [float(h.solution.parts[i].strengths[0, 0]) for h in (a, b)]
        variance = sum(float(h.covariance[i, i]) for h in (a, b))
        off = (abs(value[0] - value[1]) + variance**0.5) / size if size > 0 else 0.0
        apart.append((_kind(part), off))
    return apart


def _signals_apart(
    one: ResidualSearch, a: Hypothesis, other: ResidualSearch, b: Hypothesis
) -> float:
    """Rms by which what two fits leave differs, without noise, over the largest value."""
    x, y = a.solution.residuals[0], b.solution.residuals[0]
    first, second = one.records[0], other.records[0]
    if len(x) != len(y):
        raise ValueError(
            f"repeats of the same test hold {len(x)} and {len(y)} samples: cut them alike"
        )
    peak = float(np.abs(first.signal - first.signal.mean()).max())
    power = float(np.mean((x - y) ** 2)) - noise_std(first) ** 2 - noise_std(second) ** 2
    return max(power, 0.0) ** 0.5 / peak
