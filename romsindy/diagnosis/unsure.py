"""What is free under every hypothesis: unsure values, and what a measurement may add.

An offset, and gain and curvature to a limit, may be there though the measurement is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Scales
from romsindy.effects.outside import Bias, Gain, SensorNonlinearity
from romsindy.fit.coefficient import Coefficient
from romsindy.fit.measured import free_offsets
from romsindy.fit.part import Part
from romsindy.fit.record import Record
from romsindy.fit.verdict import KNOWN_CURVATURE, KNOWN_GAIN
from romsindy.physics.coupled import AnyModel
from romsindy.physics.model import ReducedModel


def allowed(effect: Effect, reach: float) -> float:
    """Strength up to which an effect is none: what a measurement up to ``reach`` may add."""
    if isinstance(effect, Bias):
        return np.inf
    if isinstance(effect, Gain):
        return KNOWN_GAIN
    if isinstance(effect, SensorNonlinearity) and effect.power == 2 and reach:
        return KNOWN_CURVATURE / reach
    return 0.0


def largest_reading(records: Sequence[Record]) -> float:
    """In any record, unit of what was measured."""
    return max(float(np.abs(r.signal).max()) for r in records)


def offsets(records: Sequence[Record]) -> Part:
    """The zero of the sensor in each record: free."""
    return replace(free_offsets(records), tolerance=largest_reading(records))


def nuisances(records: Sequence[Record]) -> tuple[Part, ...]:
    """What the measurement may add: an offset, and gain and curvature as far as they are known."""
    reach, found = largest_reading(records), [offsets(records)]
    for effect in (Gain(), SensorNonlinearity(2)):
        most = allowed(effect, reach)
        found.append(Part(effect, (), np.zeros((1, 1)), tolerance=most, most=most))
    return tuple(found)


def smooth_model(model: ReducedModel, all_scales: Scales) -> ReducedModel:
    """Dry friction that the model has already must not jump."""
    if all(term.smooth for term in model.terms):
        return model
    return model.regularised(0.01 * all_scales.amplitude * all_scales.omega)


_LINEAR: Mapping[str, Effect] = {"omega^2": LinearFrequency(), "c_linear": Viscous()}


def unsure_parts(
    model: AnyModel,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    all_scales: Scales,
    n_records: int,
    known: Mapping[str, Effect] = _LINEAR,
) -> tuple[Part, ...]:
    """Parts of the values that a simulation is unsure of, or knows to a tolerance.

    Effects that stand for linear values are ``known`` by the names of these.
    """
    unsure = [known[f] if isinstance(f, str) else f for f in free if f not in tolerances]
    parts = [Part.of(effect, all_scales, n_records) for effect in unsure]
    terms = {term.key: term for term in model.terms}
    for name, relative in tolerances.items():
        effect: Effect = known.get(name) or Coefficient(terms[name])
        part = Part.of(effect, all_scales, n_records)
        parts.append(replace(part, tolerance=relative * abs(model.coefficients[name])))
    return tuple(parts)
