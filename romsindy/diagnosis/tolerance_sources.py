"""Where tolerances come from: what was stated, repeat runs, and what a model is known to leave."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real

import numpy as np

from romsindy.diagnosis.arguments import check_repeats, checked_records
from romsindy.diagnosis.difference import DEFAULT, KINDS, Difference, Tolerance
from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError, Hypothesis
from romsindy.diagnosis.gap import beyond_noise, noise_std, predict
from romsindy.diagnosis.residual_search import ResidualSearch
from romsindy.diagnosis.search import Finding
from romsindy.effects.base import Effect
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.fit.results.estimate import Estimate
from romsindy.fit.verdict import SURE
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay

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
    usual = dict.fromkeys(KINDS, DEFAULT)
    return Tolerance(0.0, 0.0, 0.0, "bands", sources=usual, bands=bands)


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
