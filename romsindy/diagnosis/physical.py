"""From the reduced model back to the beam: the physical effect, its coefficient fitted there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from romsindy.beam import Beam
from romsindy.decay import Decay
from romsindy.diagnosis.fitting import Part, fit
from romsindy.diagnosis.records import Measured
from romsindy.diagnosis.report import DiagnosisReport

_ROUNDS, _CLOSE = 5, 0.003


def beam_with_effect(
    beam: Beam, report: DiagnosisReport, decay_of: Callable[[Beam], Decay], first: float
) -> tuple[Beam, float]:
    """Put the effect that was named into the beam.

    The coefficient is the one with which the beam's own decay shows, through the same reduced
    model, the strength that the measurement showed. The force on one mode is nearly proportional
    to it, so that a few simulations suffice.

    Parameters
    ----------
    beam : Beam
        The simulation as it was.
    report : DiagnosisReport
        With one effect that has a counterpart on a beam.
    decay_of : callable
        Simulates a beam and returns its decay, in the coordinate of the measurement.
    first : float
        First guess of the coefficient, in its own unit.

    Returns
    -------
    beam : Beam
        With the effect.
    coefficient : float

    Raises
    ------
    ValueError
        If the report names no such effect, or its strength does not follow the coefficient.
    """
    parts = report.best.effects
    if len(parts) != 1 or parts[0].effect.beam_effect(first) is None:
        raise ValueError(
            f"the report names {list(report.best.names)}: one effect that exists on a beam is"
            " needed; add others by hand with beam.with_effect"
        )
    part, coefficient = parts[0], first
    wanted = float(part.strengths[0, 0])
    for _ in range(_ROUNDS):
        changed = beam.with_effect(part.effect.beam_effect(coefficient))
        shown = _strength(report, part, decay_of(changed))
        if not shown * wanted > 0:
            raise ValueError(
                f"with a coefficient of {coefficient:.4g} the beam shows no {part.effect.name}:"
                " start from a larger one"
            )
        if abs(shown / wanted - 1) < _CLOSE:
            return changed, coefficient
        coefficient *= wanted / shown
    return beam.with_effect(part.effect.beam_effect(coefficient)), coefficient


def _strength(report: DiagnosisReport, part: Part, decay: Decay) -> float:
    """Strength of the effect in a simulated decay; its shape stays as it is."""
    shapes = tuple(
        replace(s, low=v, high=v, spread=None)
        for s, v in zip(part.shapes, part.shape.tolist(), strict=True)
    )
    free = report.best.solution.parts[: report.best.n_free]
    fresh = [replace(p, strengths=np.zeros((1, 1))) for p in free]
    own = replace(part, shapes=shapes, strengths=part.strengths[:1])
    solution = fit(report.nominal, [*fresh, own], [Measured.of(decay, 1e-4)], iterations=30)
    return float(solution.parts[-1].strengths[0, 0])
