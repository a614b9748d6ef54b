"""What is free under every hypothesis: values that the simulation is unsure of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Scales
from romsindy.fit.coefficient import Coefficient
from romsindy.fit.part import Part
from romsindy.physics.coupled import AnyModel
from romsindy.physics.model import ReducedModel


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
