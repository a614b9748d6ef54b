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
from romsindy.fit.gauss_newton import Solution
from romsindy.fit.linear_response import nodes
from romsindy.fit.part import ExtendedEquation, Part
from romsindy.fit.record import Record
from romsindy.fit.shooting import shoot, simulated_misfit
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

# In cycles: a wrong frequency shows as a phase that drifts, and must not drift far before it is
# corrected.
_FIRST, _GROWTH = 2.5, 1.6
# Until the whole record is in sight, no term may change the acceleration by more than about this
# part of it: few cycles do not tell coefficients apart.
_LEASH = 0.01
_ROUGH = 1e-2  # tolerance of chi-square: shorter horizons only lead on


def fit_growing(
    model: ReducedModel, parts: Sequence[Part], records: Sequence[Record]
) -> tuple[Part, ...]:
    """Values from which a fit over the whole records may start.

    Parameters
    ----------
    model : ReducedModel
    parts : sequence of Part
        Without values for their shapes.
    records : sequence of Record

    Raises
    ------
    TrajectoryError
        If the model cannot be simulated over the first cycles.
    """
    cycle = max(2 * np.pi / r.rate for r in records)
    longest = max(float(r.t[-1]) for r in records)
    horizon = _FIRST * cycle
    found = tuple(parts)
    states = None
    while horizon < longest:
        early = [r.until(horizon) for r in records]
        found, states = _step(model, found, early, states)
        horizon *= _GROWTH
    return found


