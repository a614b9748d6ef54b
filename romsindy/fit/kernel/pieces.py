"""Fits to parts of the records, which become longer until the records are whole.

Over few cycles no phase is lost, whatever is still missing from the model. Pieces have each an
initial state of its own: multiple shooting [1]. Where a structure is wrong and Gauss-Newton's
method about the measured motion does not settle, the first cycles are fitted alone: values found
there start the fit of a few cycles more.

[1] H. G. Bock, "Recent Advances in Parameter Identification Techniques for O.D.E.", in: Numerical
Treatment of Inverse Problems in Differential and Integral Equations, 1983.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.linear_response import nodes
from romsindy.fit.kernel.part import Part, Solution, extended
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.kernel.shooting import shoot, simulated, simulated_misfit
from romsindy.physics.equations import Equations
from romsindy.typing import Array

R = TypeVar("R", bound=Prepared)
# Cycles of the slowest coordinate in the first pieces, and at least so many beats of the two that
# are nearest; by about how much they grow.
_CYCLES, _BEATS, _GROWTH = 10.0, 2.0, 2.0
_ROUGH = 1e-3  # change of chi-square, of what is left beyond the noise, at which a fit ends
# In cycles: a wrong frequency shows as a phase that drifts, and must not drift far before it is
# corrected. Where a structure is wrong, longer strides (1.6) were seen to lose the motion.
_FIRST, _LONGER = 2.5, 1.4
# Until the whole record is in sight, no term may change the acceleration by more than about this
# part of it: few cycles do not tell coefficients apart.
_LEASH = 0.01
_LEADS = 1e-2  # tolerance of chi-square: shorter horizons only lead on


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
    model: Equations, parts: Sequence[Part], records: Sequence[Prepared], cycles: float
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


def fit_growing(
    model: Equations, parts: Sequence[Part], records: Sequence[Prepared]
) -> tuple[tuple[Part, ...], tuple[Trajectory, ...]]:
    """Values, and motions over most of the records, from which a fit over all of them may start.

    Of parts whose shapes have no values. Raises a TrajectoryError if the model cannot be simulated
    over the first cycles.
    """
    longest = max(float(r.t[-1]) for r in records)
    horizon = _FIRST * max(2 * np.pi / r.rate for r in records)
    found, motions = tuple(parts), tuple(r.motion for r in records)
    while horizon < longest:
        found, motions = _step(model, found, [r.until(horizon) for r in records], motions)
        horizon *= _LONGER
    return found, motions


def _step(
    model: Equations,
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
    solution = shoot(here, leashed, records, motions, tolerance=_LEADS)[0]
    moved = tuple(
        replace(p, strengths=p.strengths + new.strengths) if _is_law(p) else new
        for p, new in zip(parts, solution.parts, strict=True)
    )
    return moved, solution.motions


def _is_law(part: Part) -> bool:
    return part.effect.term() is not None


def _leashes(model: Equations, parts: tuple[Part, ...], record: Prepared) -> Array:
    """Strength of each part that changes the acceleration by one part in a hundred."""
    motion = record.motion
    slopes = equation_of(model, parts, 0, record).by_parameter(*nodes(motion))
    sizes = np.maximum(np.sqrt(np.mean(slopes**2, axis=(1, 2))), 1e-300)
    return _LEASH * float(np.sqrt(np.mean(motion.q_ddot**2))) / sizes
