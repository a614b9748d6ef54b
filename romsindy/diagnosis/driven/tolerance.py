"""Differences between a simulation and driven records that do not matter.

Frequency and damping are those of the equation, of small vibrations: in resonance a frequency that
is off by 0.1 % changes the response by several per cent. The signal is what is left beside them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from romsindy.diagnosis.driven.search import DrivenSearch
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.tolerance import DEFAULT, Tolerance
from romsindy.effects import LinearFrequency, Viscous
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.part import Part
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array


def linear_values(model: ReducedModel) -> dict[str, float]:
    """Change of the values of frequency and damping by all of themselves, by name of the effect."""
    known = model.coefficients
    sizes = {"linear_frequency": 2 * known["omega^2"], "viscous": known.get("c_linear", 0.0)}
    return {name: abs(size) for name, size in sizes.items()}


def within(search: DrivenSearch) -> Hypothesis | None:
    """Frequency and damping fitted, if neither they nor what is left matter; None if they do.

    Only a tolerance that was stated, or read off repeats, is asked: else noise alone decides.
    """
    tolerance = search.options.tolerance
    if tolerance.source == DEFAULT:
        return None
    sizes = linear_values(search.model)
    effects = [e for e in (LinearFrequency(), Viscous()) if sizes[e.name] > 0]
    free = tuple(Part(effect, (), np.zeros((1, 1))) for effect in effects)
    found = replace(search, free=free, compared=[]).hypothesis([])
    residuals = found.solution.residuals
    little = beyond_noise(search.records, residuals) <= tolerance.signal
    if not (found.solution.finite and (little or search.remainder(found).explained)):
        return None
    most = {"linear_frequency": tolerance.frequency, "viscous": tolerance.damping}
    for i, effect in enumerate(effects):
        value, std = abs(found.parts[i].strengths[0, 0]), found.covariance[i, i] ** 0.5
        if value + std > most[effect.name] * sizes[effect.name]:
            return None
    return replace(found, unsaid=tuple(e.name for e in effects))


def beyond_noise(records: Sequence[ForcedRecord], residuals: Sequence[Array]) -> float:
    """The most that is left of a record: rms without noise, over its largest value."""
    sizes = []
    for record, e in zip(records, residuals, strict=True):
        peak = float(np.abs(record.signal - record.signal.mean()).max())
        power = float(np.mean(e**2)) - record.noise.std**2
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
        for kind, size in _values_apart(one.model, a, b).items():
            sizes[kind] = max(sizes[kind], size)
        sizes["signal"] = max(sizes["signal"], _signals_apart(one, a, other, b))
    return Tolerance.read_off(sizes, "repeats")


def _values_apart(model: ReducedModel, a: Hypothesis, b: Hypothesis) -> dict[str, float]:
    """How far frequency and damping may be apart, by their standard errors."""
    sizes = linear_values(model)
    apart = {}
    for i, kind in enumerate(("frequency", "damping")):
        size = sizes[("linear_frequency", "viscous")[i]]
        value = [float(h.solution.parts[i].strengths[0, 0]) for h in (a, b)]
        variance = sum(float(h.covariance[i, i]) for h in (a, b))
        apart[kind] = (abs(value[0] - value[1]) + variance**0.5) / size if size > 0 else 0.0
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
    power = float(np.mean((x - y) ** 2)) - first.noise.std**2 - second.noise.std**2
    return max(power, 0.0) ** 0.5 / peak
