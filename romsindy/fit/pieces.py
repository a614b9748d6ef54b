"""Fits to pieces of the records, each with an initial state of its own: multiple shooting.

Over few cycles no phase is lost, whatever is still missing from the model. Pieces become longer,
until the records are whole.

[1] H. G. Bock, "Recent Advances in Parameter Identification Techniques for O.D.E.", in: Numerical
Treatment of Inverse Problems in Differential and Integral Equations, 1983.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from romsindy.fit.collocation import Trajectory, TrajectoryError
from romsindy.fit.gauss_newton import Solution, fit
from romsindy.fit.part import Part
from romsindy.fit.record import Prepared
from romsindy.fit.shooting import simulated
from romsindy.physics.coupled import AnyModel
from romsindy.typing import Array

R = TypeVar("R", bound=Prepared)

# Cycles of the slowest coordinate in the first pieces, and at least so many beats of the two that
# are nearest; by about how much they grow.
_CYCLES, _BEATS, _GROWTH = 10.0, 2.0, 2.0
_ROUGH = 1e-3  # change of chi-square, of what is left beyond the noise, at which a fit ends


def cut(record: R, cycles: float) -> list[R]:
    """A record in pieces about so many cycles of its slowest coordinate long."""
    return record.pieces(max(1, round(record.turns / cycles)))


def lengths(records: Sequence[Prepared]) -> list[float]:
    """Of pieces, in cycles, until no record is cut; infinite at the end."""
    first = shortest(*(r.frequencies for r in records))
    longest = max(record.turns for record in records)
    more = max(longest / first, 1.0)
    count = round(np.log(more) / np.log(_GROWTH))
    return [*(first * more ** (k / count) for k in range(count)), np.inf]


def shortest(*several: Array) -> float:
    """Cycles of the slowest frequency in which all are told apart, in that of several records."""
    apart = max(float(np.min(np.diff(np.sort(f)), initial=np.inf) / f.min()) for f in several)
    return max(_CYCLES, _BEATS / apart) if apart > 0 else _CYCLES


def fit_pieces(
    model: AnyModel, parts: Sequence[Part], records: Sequence[Prepared], cycles: float
) -> Solution | None:
    """The model fitted to pieces so many cycles long, from the motions of the records.

    Motions and residuals of the solution are those of whole records. None if there is no motion.
    """
    several = [cut(record, cycles) for record in records]
    every = [piece for own in several for piece in own]
    solution = fit(model, parts, every, rough=_ROUGH)
    if not solution.finite:
        return None
    motions, residuals = list(solution.motions), list(solution.residuals)
    if not solution.converged:  # then the motions are not yet those of the model
        try:
            motions, residuals = simulated(model, solution.parts, every, motions)
        except TrajectoryError:
            return None
    whole, left, first = [], [], 0
    for record, own in zip(records, several, strict=True):
        here = slice(first, first + len(own))
        whole.append(Trajectory.joined(record.motion.grid, motions[here]))
        pieces = zip(own, residuals[here], strict=True)
        channels = [piece.by_channel(x) for piece, x in pieces]
        left.append(np.concatenate(channels, axis=1).ravel())
        first += len(own)
    return replace(solution, motions=tuple(whole), residuals=tuple(left))


def moved(records: Sequence[R], motions: Sequence[Trajectory]) -> tuple[R, ...]:
    """Records with other motions behind them."""
    return tuple(r.with_motion(m) for r, m in zip(records, motions, strict=True))
