"""Differences between a simulation and driven records that do not matter.

Frequency and damping are those of the equation, of small vibrations: in resonance a frequency that
is off by 0.1 % changes the response by several per cent. The signal is what is left beside them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from romsindy.diagnosis.driven.gap import noise_std
from romsindy.diagnosis.driven.search import DrivenSearch
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.tolerance import DEFAULT, Tolerance
from romsindy.effects.base import Effect
from romsindy.fit.any_record import AnyRecord
from romsindy.fit.part import Part
from romsindy.physics.coupled import AnyModel
from romsindy.typing import Array


def _size(model: AnyModel, part: Part) -> float:
    """Change of a linear value by all of the frequency, or of the damping ratio."""
    law = part.effect.term()
    now = 0.0 if law is None else model.coefficients.get(law.key, 0.0)
    return abs(2 * now if _kind(part) == "frequency" else now)


def _kind(part: Part) -> str:
    return "damping" if part.effect.family == "damping" else "frequency"


def within(search: DrivenSearch, linear: Sequence[Effect]) -> Hypothesis | None:
    """Frequencies and damping fitted, if neither they nor what is left matter; None if they do.

    They are changes of the ``linear`` values. What is left beyond the noise is tolerated only as a
    user, or repeats, say.
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
    return replace(found, unsaid=tuple(p.effect.name for p in free))


def beyond_noise(records: Sequence[AnyRecord], residuals: Sequence[Array]) -> float:
    """The most that is left of a record: rms without noise, over its largest value."""
    sizes = []
    for record, e in zip(records, residuals, strict=True):
        peak = float(np.abs(record.signal - record.signal.mean()).max())
        power = float(np.mean(e**2)) - noise_std(record) ** 2
        sizes.append(max(power, 0.0) ** 0.5 / peak)
    return max(sizes)


def of_driven_repeats(searches: Sequence[DrivenSearch]) -> Tolerance:
    """What runs of one driven test differ by, each with a search of its own.

    Frequency and damping are fitted to each; what their fits leave differs by the signal.

    Raises
    ------
    ValueError
        If runs differ in length, or the model has no motion near one of them.
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


def _values_apart(model: AnyModel, a: Hypothesis, b: Hypothesis) -> list[tuple[str, float]]:
    """How far frequencies and dampings may be apart, by their standard errors."""
    apart = []
    for i, part in enumerate(a.parts[: a.n_unsure]):
        size = _size(model, part)
        value = [float(h.solution.parts[i].strengths[0, 0]) for h in (a, b)]
        variance = sum(float(h.covariance[i, i]) for h in (a, b))
        off = (abs(value[0] - value[1]) + variance**0.5) / size if size > 0 else 0.0
        apart.append((_kind(part), off))
    return apart


def _signals_apart(one: DrivenSearch, a: Hypothesis, other: DrivenSearch, b: Hypothesis) -> float:
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
