"""Simulated decays as an equation of motion: what a simulation is where nothing else is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect
from romsindy.effects.choices import sought
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Coefficient, Part, Solution, extended
from romsindy.fit.records.record import Record, scales
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
_LEAST_NOISE = 1e-4  # of the amplitude: solvers are no better


class SimulationModel(NamedTuple):
    """An equation that stands for simulated decays, and arguments of `diagnose` beside it."""

    model: ReducedModel  # over the amplitudes of the simulation
    tolerances: dict[str, float]  # nonlinear stiffness is known to its own size only
    floor: float  # twice what the richest equation leaves, per amplitude: no better known
    reference: tuple[Decay, ...]  # the series: what the equation misses of them does not matter

    @property
    def missed(self) -> float:
        """What it leaves of the series, rms over the largest amplitude."""
        records = [Record.loud(decay, _LEAST_NOISE) for decay in self.reference]
        model = replace(self.model, amplitude_range=None)
        return _misfit(fit(model, (), records, iterations=30), records)


def model_of_simulation(simulated: Sequence[Decay]) -> SimulationModel:
    """Reduce simulated decays of one coordinate to an equation of motion.

    Raises a ValueError if they are too short, or no equation of motion of one coordinate follows
    them.
    """
    try:
        records = [Record.loud(decay, _LEAST_NOISE) for decay in simulated]
    except ValueError as error:
        raise ValueError(f"the simulated series cannot be analysed: {error}") from error
    omega = scales(records).omega
    start = ReducedModel.from_coefficients({"omega^2": omega**2}, simulated[0].unit)
    plain, rich = _plainest(start, records), _fitted(start, sought("rich"), records)
    left = min(_misfit(plain, records), _misfit(rich, records))
    if not left < ONE_MODE:
        raise ValueError(
            "no equation of motion follows the simulated series: is it the free decay of one mode?"
        )
    model = extended(start, plain.parts)
    amplitudes = np.concatenate([extract_backbone(r.decay).amplitude for r in records])
    reach = (float(amplitudes.min()), float(amplitudes.max()))
    model = ReducedModel(model.terms, model.values, model.unit, reach)
    return SimulationModel(model, {_CUBIC.key: 1.0}, max(2 * left, FLOOR), tuple(simulated))


def _plainest(start: ReducedModel, records: Sequence[Record]) -> Solution:
    """Cubic stiffness, and what else the series cannot do without."""
    laws: list[Term] = [_CUBIC]
    found = last = _fitted(start, laws, records)
    first, least = _misfit(found, records), len(laws)
    while _misfit(last, records) > FLOOR:
        left = [law for law in sought("series") if law not in laws]
        if not left:
            break
        trials = [_fitted(start, [*laws, law], records) for law in left]
        misfits = [_misfit(trial, records) for trial in trials]
        best = int(np.argmin(misfits))
        laws, last = [*laws, left[best]], trials[best]
        if first == np.inf:  # nothing followed the series until now
            found, first, least = last, misfits[best], len(laws)
        elif misfits[best] * _NEARLY_ALL ** (len(laws) - least) < first:
            found = last
    return found


def _fitted(start: ReducedModel, laws: Sequence[Term], records: Sequence[Record]) -> Solution:
    nonlinear = [Coefficient(law) for law in laws]
    effects: list[Effect] = [LinearFrequency(), Viscous(), *nonlinear]
    parts = [Part.of(e, scales(records), len(records)) for e in effects]
    return fit(start, parts, records, iterations=30)


def _misfit(solution: Solution, records: Sequence[Record]) -> float:
    """Rms over the largest amplitude; of a fit that broke off it says nothing of the equation."""
    if not solution.converged:
        return float("inf")
    pairs = zip(solution.residuals, records, strict=True)
    return max(float(np.sqrt(np.mean(e**2)) / np.abs(r.signal).max()) for e, r in pairs)
