"""Identify an equation of motion from free decays: as much structure as the data support."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.effects.choices import sought
from romsindy.fit.adequacy.verdicts import Adequacy, examine
from romsindy.fit.functions import unmeasured
from romsindy.fit.functions.evidence import Fitted, draw, fit, regressed
from romsindy.fit.functions.identification import Identification
from romsindy.fit.functions.series import (
    RICHEST,
    Magnitudes,
    ModelStructure,
    SensorCurvature,
    Series,
    compared,
    contains,
    curvature_for,
    simpler,
)
from romsindy.fit.functions.windows import Window, windows_of
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.gauss_newton import fit as fit_states
from romsindy.fit.kernel.hypothesis import free_parts
from romsindy.fit.kernel.prepared import record_notes
from romsindy.fit.process_noise import SIGMAS
from romsindy.fit.records.arguments import prepared, require_known, several_decays
from romsindy.fit.records.record import Record
from romsindy.fit.results.predict import form_of
from romsindy.fit.verdict import BY_CHANCE, CURVATURE, DEPARTURE, DETERMINED, EQUIVALENT, NOISE_FREE
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.backbone import extract_backbone
from romsindy.record.decay import Decay
from romsindy.text import percent
from romsindy.typing import Array

_PLACES = 40


def sentences(found: Identification, fitted: Fitted, records: Sequence[Record]) -> Iterator[str]:
    """What is wrong with the result or the records, then what is known of inertia and stiffness."""
    if fitted.noise > BY_CHANCE:
        yield _misfit(found, fitted, records)
    if fitted.jump > DEPARTURE:
        cycles = sum(len(r.cycles) for r in records) / len(fitted.windows)
        yield (
            f"every {cycles:.0f} cycles the motion departs from this equation by"
            f" {percent(fitted.jump)} of its amplitude: another mode takes part, the sensor"
            " drifts, its noise is slow, or a force is no function of q"
        )
    if found.verdict.structured and fitted.noise > BY_CHANCE:
        yield (
            "what other modes or the sensor do in time with the motion cannot be told from"
            " stiffness and inertia: bands may miss the truth where the model does not explain"
            " the data"
        )
    yield from record_notes(records)
    if not fitted.converged:
        yield "the fit has not come to its end: bands may be too narrow"
    unit = found.model.unit or "[q]"
    sizes = np.linspace(0.05, 1.0, _PLACES)
    q = np.concatenate([sizes * end for end in found.reach])
    yield _inertia(found, sizes, unit)
    yield from _sensor(found, fitted)
    least, largest = found.reach
    yield f"nothing is known beyond q = {least:.3g} and {largest:.3g} {unit}: do not extrapolate"
    if found.structure.name == "linear":
        yield _straight(found, q)
    k = found.stiffness(q)
    width = (k.high - k.low) / 2 / np.abs(k.value)
    inner = np.tile((sizes > 0.3) & (sizes < 0.7), 2)
    within, worst = (float(np.max(w)) for w in (width[inner], width))
    ends = f"to +- {percent(worst)}" if worst < 1 else "not at all"
    if within < 1:
        yield (
            f"K(q)/q is known to +- {percent(within)} (95 %) between 0.3 and 0.7 of the range,"
            f" {ends} at worst"
        )
    else:
        yield "K(q)/q is not determined: its 95 % band is wider than the stiffness itself"


def _inertia(found: Identification, sizes: Array, unit: str) -> str:
    both = sizes * min(map(abs, found.reach))
    q = np.concatenate([-both, both])
    h = found.inertia(q)
    if not found.structure.sizes.inertia:
        worst = int(np.argmax(h.high))
        return (
            f"the data do not ask for inertia: h(q) is at most {h.high[worst]:.2g} (95 %,"
            f" at q = {q[worst]:.3g} {unit})"
        )
    good = (((h.high - h.low) / 2) <= DETERMINED * h.value).reshape(2, -1).all(axis=0)
    if not np.any(good):
        return (
            "the data ask for inertia, but hardly say how much: nowhere is h(q) known to"
            f" {percent(DETERMINED)} on both sides"
        )
    ends = np.flatnonzero(np.diff(np.pad(good.astype(int), 1))).reshape(-1, 2)
    parts = " and ".join(f"from |q| = {both[a]:.3g} to {both[b - 1]:.3g}" for a, b in ends)
    return (
        "given one coordinate, inertia is determined (95 % band within"
        f" {percent(DETERMINED)} of h(q)) {parts} {unit}; elsewhere the band says how little"
    )


def _sensor(found: Identification, fitted: Fitted) -> Iterator[str]:
    """What the sensor may have of what was found, and what it seems to have itself."""
    expected = fitted.series.sensor.curvature
    usual = f"{percent(expected)} is expected of a sensor"
    if found.structure.sizes.inertia:
        q = np.linspace(0.0, 1.0, _PLACES)
        ends = [curvature_for(abs(x) * q, found.inertia(x * q).value) for x in found.reach]
        short = float(np.mean(ends))
        nothing = short < SIGMAS * expected
        yield (
            "one sensor cannot tell inertia from a characteristic that bends as q^3: one that shows"
            f" {percent(short)} too little at the largest amplitude would stand for all of h(q);"
            f" {usual}" + (": it may be the sensor" if nothing else "")
        )
    e, error = fitted.curvature
    if abs(e) > 3 * error:
        more = f"far more than the {percent(expected)} of a usual sensor"
        held = more if abs(e) > 3 * expected else usual
        yield (
            f"the sensor seems to be curved by {100 * e:.2g} +- {100 * error:.1g} % of the largest"
            f" amplitude (a square, fitted beside the equation; {held})"
        )


def _straight(found: Identification, q: Array) -> str:
    """How much of a nonlinear stiffness the data would allow."""
    k = found.allowed_stiffness(q)
    middle = float(found.stiffness(0.0).value[0])
    most = max(float(np.max(k.high)) - middle, middle - float(np.min(k.low))) / middle
    if most > 1:
        return "the data do not tell whether the stiffness is nonlinear"
    return (
        f"the data do not ask for nonlinear stiffness: K(q)/q changes by at most {percent(most)}"
        " over the range (95 %)"
    )


def _misfit(found: Identification, fitted: Fitted, records: Sequence[Record]) -> str:
    counted = f"errors and bands count it: they stand for {fitted.noise:.3g} times the noise"
    if all(r.noise.std < NOISE_FREE * r.noise.floor for r in records):
        size = max(r.noise.std / float(np.abs(r.signal).max()) for r in records)
        return (
            "the records are nearly free of noise, and what limits the fit is the equation, which"
            f" misses the signal by {found.adequacy * size:.1g} of its largest value (rms);"
            f" {counted}"
        )
    if found.verdict.explained:
        return f"windows of a few cycles disagree by more than their noise, and {counted}"
    return f"the misfit is larger than the noise of the records, and {counted}"


_DRAWS = 400
# Fewer functions save at most about so much in the logarithm of the evidence.
_HOPELESS = 100.0
_EXACT = 1e-8  # error of what is known, in values of order one
_LARGEST = 1e15  # amplitude, or its inverse, of which all powers of the series are numbers
# Of the draws, those of the structure at the head are so many at least: what is printed of it lies
# within its band.
_HEAD = _DRAWS // 5


def identify_decays(
    decays: Decay | Sequence[Decay],
    *,
    fixed: Mapping[str, float] | None = None,
    curvature: float = CURVATURE,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Identification:
    """Identify stiffness, inertia and damping of one coordinate as functions of q, with bands.

    Arguments as those of `romsindy.identify`; decays have one channel each.
    """
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ValueError(f"seed = {seed!r} must be a whole number of at least 0")
    several = several_decays(decays)
    records = prepared(several, several[0].unit, coloured=True)
    if isinstance(curvature, bool) or not 0 <= curvature < 1:
        raise ValueError(
            f"curvature = {curvature!r} must be a part of the largest amplitude: 0.01 of a usual"
            " sensor, 0 of a straight one"
        )
    reach = max(r.amplitude for r in records)
    if not 1 / _LARGEST < reach < _LARGEST:
        raise ValueError(
            f"the decay reaches {reach:.3g} {several[0].unit or '[q]'}, of which no power can be"
            " computed: say what the samples are in with unit=, or scale them"
        )
    say = progress or (lambda line: None)
    series = Series.linear(
        _scales(records), RICHEST, sensor=SensorCurvature(curvature, len(records))
    )
    known = _known(series, fixed or {})
    # Tall and narrow matrices: threads of the linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        series = regressed(series, records)
        plain = _settled(series, windows_of(records), records, known, say)
        rng = np.random.default_rng(seed)
        richest, others = _with_forces(plain, say)
        if richest is not plain:
            richest, others = _settled_again(richest, say), []
        told = _explained(richest) or not all(r.whole for r in records)
        starts = [] if told else dict.fromkeys([plain, richest])
        found = _under_a_force(starts, say) or _simpler(richest, say)
        others = [] if found[0].noises else others
        return _assembled(found, others, richest.records, dict(fixed or {}), rng)


def _under_a_force(starts: Iterable[Fitted], say: Callable) -> list[Fitted]:
    """Fits by the noise of a force that nobody measured; none where more than noise is left."""
    for start in starts:
        try:
            richest = unmeasured.weighed(start)
        except TrajectoryError:
            continue
        if richest is not None and _explained(richest):
            return _simpler(richest, say)
    return []


def _explained(found: Fitted) -> bool:
    return _judged(found, found.series.values)[1].explained


def _judged(found: Fitted, values: Array) -> tuple[list[Array], Adequacy]:
    """What one simulation of each record leaves, and whether that is noise."""
    ways = unmeasured.simulated(found, values)
    left = [x for _, x in ways]
    if found.noises:
        return left, unmeasured.verdict(found, values, ways)
    return left, examine(found.records, left, found.n_effective)


def _settled(
    series: Series,
    windows: Sequence[Window],
    records: Sequence[Record],
    known: Array,
    say: Callable,
) -> Fitted:
    """A fit whose noise is as large as its windows disagree."""
    found = fit(series, windows, records, known, progress=say)
    level = found.noise * np.sqrt(max(found.dispersion, 1.0))
    if not np.isfinite(level):
        raise TrajectoryError(
            "windows of the record disagree without limit: no equation of one coordinate holds for"
            " all of them; cut the record with start= and end=, or isolate another mode"
        )
    return _again(found, found.series, level, say)


def _settled_again(richest: Fitted, say: Callable) -> Fitted:
    """With the process noise that is left beside its forces: they may have been taken for it.

    The fit stands where windows with less of it lead astray: another force may move them.
    """
    try:
        return _settled(richest.series, richest.windows, richest.records, richest.known, say)
    except TrajectoryError as trouble:
        say(f"as it was: {trouble}")
        return richest


def _scales(records: Sequence[Record]) -> Magnitudes:
    reach = max(r.amplitude for r in records)
    rate = float(np.mean([r.rate for r in records]))
    ratio = np.concatenate([extract_backbone(r.decay).damping_ratio for r in records])
    return Magnitudes(reach, rate, 2 * rate * max(float(np.nanmedian(ratio)), 1e-5))


def _known(series: Series, fixed: Mapping[str, float]) -> Array:
    """Rows for what is known of the coefficients."""
    names = [t.key for t in series.terms()]
    require_known(fixed, names)
    # Coefficients are linear in the values, but for the damping that follows the inertia.
    nothing = series.moved(np.zeros_like(series.values))
    slopes = nothing.taylor(np.eye(len(series.values)))
    rows = []
    for name, value in fixed.items():
        slope = slopes[:, names.index(name)]
        size = np.abs(slope).max()
        rows.append(np.append(slope, value) / (size * _EXACT))
    return np.array(rows).reshape(len(rows), len(series.values) + 1)


def _again(start: Fitted, series: Series, noise: float, say: Callable) -> Fitted:
    """Fit a like series from where another has ended."""
    known = start.known
    if len(series.values) != len(start.series.values):
        known = _narrowed(start, series)
    if start.noises:
        return unmeasured.again(replace(start, known=known), series)
    return fit(
        series,
        start.windows,
        start.records,
        known,
        start=start,
        noise=noise,
        jumps=np.array([start.jump]),
        progress=say,
    )


def _narrowed(start: Fitted, series: Series) -> Array:
    """Rows for what is known, for a series with fewer or more terms."""
    parts = start.series.split(start.known[:, :-1])
    lengths = [len(x) for x in series.split(series.values)]
    fitted = [
        np.pad(x[:, :n], ((0, 0), (0, max(n - x.shape[1], 0))))
        for x, n in zip(parts, lengths, strict=True)
    ]
    return np.column_stack([*fitted, start.known[:, -1:]])


def _with_forces(richest: Fitted, say: Callable) -> tuple[Fitted, list[Fitted]]:
    """With the further damping forces that the data ask for, one after the other.

    Beside it, what the data cannot tell from it with one force more.
    """
    left = list(sought("decay"))  # what no smooth function of q times q_dot can be
    while left:
        more = [_tried(richest, richest.series.widened([f]), say) for f in left]
        gains = np.array([2 * (evidence - richest.log_evidence()) for _, evidence in more])
        best = int(np.argmax(gains))
        if gains[best] <= EQUIVALENT:
            return richest, [f for (f, _), g in zip(more, gains, strict=True) if g > -EQUIVALENT]
        richest = more[best][0]
        left.pop(best)
    return richest, []


def _tried(start: Fitted, series: Series, say: Callable) -> tuple[Fitted, float]:
    """A fit of another structure and the logarithm of its evidence: none if it has no motion."""
    try:
        found = _again(start, series, start.noise, say)
    except TrajectoryError:
        return start, -np.inf
    return found, found.log_evidence()


def _simpler(richest: Fitted, say: Callable) -> list[Fitted]:
    """Fits of simpler structures, simplest first; none simpler than one that is hopeless."""
    found, evidence = [richest], {richest.series.sizes: richest.log_evidence()}
    for series in simpler(richest.series):
        sizes, least = series.sizes, max(evidence.values()) - _HOPELESS
        if any(e < least for s, e in evidence.items() if contains(s, sizes)):
            continue
        fitted, evidence[sizes] = _tried(richest, series, say)
        if np.isfinite(evidence[sizes]):
            found.append(fitted)
    return found[::-1]


def _assembled(
    found: Sequence[Fitted],
    others: Sequence[Fitted],
    records: Sequence[Record],
    fixed: Mapping[str, float],
    rng: np.random.Generator,
) -> Identification:
    structures = compared(
        [
            ModelStructure(f.series.sizes, tuple(t.key for t in f.series.forces), f.log_evidence())
            for f in (*found, *others)
        ]
    )
    equivalent = [i for i, s in enumerate(structures) if s.equivalent]
    at = equivalent[0]
    if found[at].noises:  # evidence knows these noises; the simplest must leave no more
        good = (i for i in equivalent if _explained(found[i]))
        at = next(good, at)
    head, richest = found[at], found[-1]
    by_key = {t.key: t for f in (richest, *others) for t in f.series.terms()}
    terms = list(by_key.values())
    # Structures with all of the damping, by their evidence: a law of damping that is nearly right
    # would bend stiffness and inertia.
    whole = [s.sizes.damping == richest.series.sizes.damping for s in structures]
    odds = np.exp([s.log_evidence for s in structures]) * whole
    # Evidence says little of laws of damping that the data cannot tell apart: they count alike.
    odds[len(found) :] = odds.max()
    # No structure is exact. However small its evidence, the richest keeps half of the draws.
    counts = np.round(_DRAWS / 2 * odds / odds.sum()).astype(int)
    counts[len(found) - 1] += _DRAWS // 2
    counts[at] = max(counts[at], _HEAD)
    own, widest = (draw(f, _DRAWS, rng) for f in (head, richest))
    samples = [
        _among(terms, f, draw(f, n, rng))
        for f, n in zip((*found, *others), counts, strict=True)
        if n > 0
    ]
    pooled = _exactly(terms, np.concatenate(samples), fixed)
    middle = _exactly(head.series.terms(), head.series.taylor(own), fixed).mean(axis=0)
    model = ReducedModel(
        head.series.terms(), tuple(middle), records[0].decay.unit, (0.0, head.series.scales.reach)
    )
    free = tuple(k for k in model.coefficients if k not in fixed)
    columns = [[t.key for t in terms].index(key) for key in free]
    motions = [r.motion.q for r in records]
    values = own.mean(axis=0)
    residuals, verdict = _judged(head, values)
    result = Identification(
        model,
        free,
        np.atleast_2d(np.cov(pooled[:, columns], rowvar=False)),
        verdict,
        (),
        structures,
        structures[at],
        tuple(terms),
        pooled,
        _exactly(terms, _among(terms, richest, widest), fixed),
        (float(min(q.min() for q in motions)), float(max(q.max() for q in motions))),
        tuple(records),
        tuple(residuals),
    )
    told = replace(result, notes=tuple(sentences(result, richest, records)))
    alike = [r.weighing_alike() for r in records]
    smooth, parts = free_parts(model, free, alike)
    known = fit_states(smooth, parts, alike, fixed=True)
    return told.with_form(form_of(smooth, known.parts, alike, known.motions))


def _exactly(terms: Sequence[Term], samples: Array, fixed: Mapping[str, float]) -> Array:
    """Samples whose fixed coefficients are what they were fixed to, to the last digit."""
    for i, term in enumerate(terms):
        samples[:, i] = fixed.get(term.key, samples[:, i])
    return samples


def _among(terms: Sequence[Term], found: Fitted, draws: Array) -> Array:
    """Coefficients of the terms (n, n_terms) from draws; 0 for those that a structure has not."""
    keys = [t.key for t in terms]
    samples = np.zeros((len(draws), len(keys)))
    samples[:, [keys.index(t.key) for t in found.series.terms()]] = found.series.taylor(draws)
    return samples
