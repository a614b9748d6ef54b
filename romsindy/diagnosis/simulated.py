"""A simulation known only as a time series: the reduced model that stands for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect
from romsindy.fit.coefficient import Coefficient, extended
from romsindy.fit.gauss_newton import Solution, fit
from romsindy.fit.part import Part
from romsindy.fit.record import Record, scales
from romsindy.fit.verdict import FLOOR, ONE_MODE
from romsindy.physics.model import ReducedModel
from romsindy.physics.serial import term_from_key
from romsindy.record.backbone import extract_backbone
from romsindy.record.decay import Decay

_STIFFNESS = ("gamma_3",)
# One by one beside it, where they explain nearly all: so many times less is left for each of them.
_MORE, _NEARLY_ALL = ("c_coulomb", "c_quadratic", "Upsilon_3", "gamma_5", "gamma_2"), 5.0
_RICH = ("gamma_2", "gamma_3", "gamma_4", "gamma_5", "Upsilon_3", "Upsilon_5", "c_quadratic")


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
    plain, rich = _plainest(start, record), _fitted(start, _RICH, record)
    left = min(_misfit(s, record) for s in (plain, rich))
    if not left < ONE_MODE:
        raise ValueError(
            "no equation of motion follows the simulated series: is it the free decay of one mode?"
        )
    model = extended(start, plain.parts)
    amplitudes = extract_backbone(record.decay).amplitude
    reach = (float(amplitudes.min()), float(amplitudes.max()))
    model = ReducedModel(model.terms, model.values, model.unit, reach)
    return SimulationModel(model, dict.fromkeys(_STIFFNESS, 1.0), max(2 * left, FLOOR), simulated)


def _plainest(start: ReducedModel, record: Record) -> Solution:
    """Cubic stiffness, and what else the series cannot do without."""
    found = last = _fitted(start, _STIFFNESS, record)
    first, names, least = _misfit(found, record), [*_STIFFNESS], len(_STIFFNESS)
    while len(names) <= len(_MORE) and _misfit(last, record) > FLOOR:
        left = [name for name in _MORE if name not in names]
        trials = [_fitted(start, [*names, name], record) for name in left]
        misfits = [_misfit(trial, record) for trial in trials]
        best = int(np.argmin(misfits))
        names, last = [*names, left[best]], trials[best]
        if first == np.inf:  # nothing followed the series until now
            found, first, least = last, misfits[best], len(names)
        elif misfits[best] * _NEARLY_ALL ** (len(names) - least) < first:
            found = last
    return found


def _fitted(start: ReducedModel, names: Sequence[str], record: Record) -> Solution:
    nonlinear = [Coefficient(term_from_key(n)) for n in names]
    effects: list[Effect] = [LinearFrequency(), Viscous(), *nonlinear]
    parts = [Part.of(e, scales([record]), 1) for e in effects]
    return fit(start, parts, [record], iterations=30)


def _misfit(solution: Solution, record: Record) -> float:
    """Rms over the largest amplitude; of a fit that broke off it says nothing of the equation."""
    if not solution.converged:
        return float("inf")
    return float(np.sqrt(np.mean(solution.residuals[0] ** 2)) / np.abs(record.signal).max())
