"""A simulation known only as a time series: the reduced model that stands for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect
from romsindy.effects.choices import sought
from romsindy.fit.coefficient import Coefficient, extended
from romsindy.fit.gauss_newton import Solution, fit
from romsindy.fit.part import Part
from romsindy.fit.record import Record, scales
from romsindy.fit.verdict import FLOOR, ONE_MODE
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.record.backbone import extract_backbone
from romsindy.record.decay import Decay

_CUBIC = Stiffness(3)
# Laws are added one by one beside it where they explain nearly all: so many times less is left for
# each of them.
_NEARLY_ALL = 5.0


class SimulationModel(NamedTuple):
    """Arguments of `diagnose` that stand for a simulated series."""

    model: ReducedModel  # over the amplitudes of the simulation
    tolerances: dict[str, float]  # nonlinear stiffness is known to its own size only
    floor: float  # twice what the richest equation leaves, per amplitude: no better known
    reference: Decay  # the series itself: what the equation misses of it does not matter


def model_of_simulation(simulated: Decay) -> SimulationModel:
    """Reduce a simulated decay to an equation of motion.

    Raises
    ------
    ValueError
        If it is too short, or no equation of motion of one coordinate follows it.
    """
    try:
        record = Record.loud(simulated, 1e-4)
    except ValueError as error:
        raise ValueError(f"the simulated series cannot be analysed: {error}") from error
    start = ReducedModel.from_coefficients({"omega^2": scales([record]).omega ** 2}, simulated.unit)
    plain, rich = _plainest(start, record), _fitted(start, sought("rich"), record)
    left = min(_misfit(s, record) for s in (plain, rich))
    if not left < ONE_MODE:
        raise ValueError(
            "no equation of motion follows the simulated series: is it the free decay of one mode?"
        )
    model = extended(start, plain.parts)
    amplitudes = extract_backbone(record.decay).amplitude
    reach = (float(amplitudes.min()), float(amplitudes.max()))
    model = ReducedModel(model.terms, model.values, model.unit, reach)
    return SimulationModel(model, {_CUBIC.key: 1.0}, max(2 * left, FLOOR), simulated)


def _plainest(start: ReducedModel, record: Record) -> Solution:
    """Cubic stiffness, and what else the series cannot do without."""
    laws: list[Term] = [_CUBIC]
    found = last = _fitted(start, laws, record)
    first, least = _misfit(found, record), len(laws)
    while _misfit(last, record) > FLOOR:
        left = [law for law in sought("series") if law not in laws]
        if not left:
            break
        trials = [_fitted(start, [*laws, law], record) for law in left]
        misfits = [_misfit(trial, record) for trial in trials]
        best = int(np.argmin(misfits))
        laws, last = [*laws, left[best]], trials[best]
        if first == np.inf:  # nothing followed the series until now
            found, first, least = last, misfits[best], len(laws)
        elif misfits[best] * _NEARLY_ALL ** (len(laws) - least) < first:
            found = last
    return found


def _fitted(start: ReducedModel, laws: Sequence[Term], record: Record) -> Solution:
    nonlinear = [Coefficient(law) for law in laws]
    effects: list[Effect] = [LinearFrequency(), Viscous(), *nonlinear]
    parts = [Part.of(e, scales([record]), 1) for e in effects]
    return fit(start, parts, [record], iterations=30)


def _misfit(solution: Solution, record: Record) -> float:
    """Rms over the largest amplitude; of a fit that broke off it says nothing of the equation."""
    if not solution.converged:
        return float("inf")
    return float(np.sqrt(np.mean(solution.residuals[0] ** 2)) / np.abs(record.signal).max())
