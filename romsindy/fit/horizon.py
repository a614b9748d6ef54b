"""Fits by simulation over a growing part of the records, for structures that are wrong.

Where no values make the equation follow the measured motion, Gauss-Newton's method about it does
not settle, and a simulation over the whole record is soon a cycle off. Over the first cycles it is
not: values found there start the fit of a few cycles more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from romsindy.fit.coefficient import extended
from romsindy.fit.collocation import Trajectory
from romsindy.fit.equation import ExtendedEquation
from romsindy.fit.linear_response import nodes
from romsindy.fit.part import Part
from romsindy.fit.record import Prepared
from romsindy.fit.shooting import shoot, simulated_misfit
from romsindy.physics.coupled import AnyModel
from romsindy.typing import Array

# In cycles: a wrong frequency shows as a phase that drifts, and must not drift far before it is
# corrected. Where a structure is wrong, longer strides (1.6) were seen to lose the motion.
_FIRST, _GROWTH = 2.5, 1.4
# Until the whole record is in sight, no term may change the acceleration by more than about this
# part of it: few cycles do not tell coefficients apart.
_LEASH = 0.01
_ROUGH = 1e-2  # tolerance of chi-square: shorter horizons only lead on


def fit_growing(
    model: AnyModel, parts: Sequence[Part], records: Sequence[Prepared]
) -> tuple[tuple[Part, ...], tuple[Trajectory, ...]]:
    """Values, and motions over most of the records, from which a fit over all of them may start.

    Parameters
    ----------
    model : AnyModel
    parts : sequence of Part
        Without values for their shapes.
    records : sequence of Record

    Raises
    ------
    TrajectoryError
        If the model cannot be simulated over the first cycles.
    """
    longest = max(float(r.t[-1]) for r in records)
    horizon = _FIRST * max(2 * np.pi / r.rate for r in records)
    found, motions = tuple(parts), tuple(r.motion for r in records)
    while horizon < longest:
        found, motions = _step(model, found, [r.until(horizon) for r in records], motions)
        horizon *= _GROWTH
    return found, motions


def _step(
    model: AnyModel,
    parts: tuple[Part, ...],
    records: Sequence[Prepared],
    motions: tuple[Trajectory, ...],
) -> tuple[tuple[Part, ...], tuple[Trajectory, ...]]:
    """Fit the first part of the records; coefficients are held near their present values."""
    here = extended(model, parts)
    still = tuple(replace(p, strengths=0 * p.strengths) if _is_law(p) else p for p in parts)
    leashes = _leashes(here, still, records[0])
    # Where the model misses more than the noise, its misfit takes the place of the noise.
    missed = max(float(np.median(np.abs(simulated_misfit(here, still, records, motions)))), 1.0)
    leashed = [
        replace(p, tolerance=leash / missed) if _is_law(p) else p
        for p, leash in zip(still, leashes, strict=True)
    ]
    solution = shoot(here, leashed, records, motions, tolerance=_ROUGH)[0]
    moved = tuple(
        replace(p, strengths=p.strengths + new.strengths) if _is_law(p) else new
        for p, new in zip(parts, solution.parts, strict=True)
    )
    return moved, solution.motions


def _is_law(part: Part) -> bool:
    return part.effect.term() is not None


def _leashes(model: AnyModel, parts: tuple[Part, ...], record: Prepared) -> Array:
    """Strength of each part that changes the acceleration by one part in a hundred."""
    motion = record.motion
    equation = ExtendedEquation(model, parts, 0, motion.grid.step, record.clock)
    slopes = equation.by_parameter(*nodes(motion))
    sizes = np.maximum(np.sqrt(np.mean(slopes**2, axis=(1, 2))), 1e-300)
    return _LEASH * float(np.sqrt(np.mean(motion.q_ddot**2))) / sizes
