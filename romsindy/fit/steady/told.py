"""What a fit to steady states says of itself and of its points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from romsindy.fit.adequacy import Adequacy
from romsindy.fit.steady.points import SteadyPoints
from romsindy.fit.steady.solve import SteadySolution
from romsindy.fit.verdict import EXPLAINED

# Off the mean of its neighbours by so many times what is usual, a point is no steady state.
_ROUGH = 8.0
_NOISY = 10.0  # times the usual standard deviation
_TURNED = 0.5  # rad: a chain that turns further says what was measured, or its sign
_HARMONICS = 6  # of the windows in `Adequacy`


def verdict_of(points: SteadyPoints, solution: SteadySolution) -> Adequacy:
    """Whether the noise explains the misfits."""
    freedom = solution.rows.misfit.size - len(solution.free)
    known = bool(np.all(points.std > 0))
    white = solution.over_noise if known else solution.white
    total = float(np.sum(white**2))
    by_harmonic = np.full((len(points), _HARMONICS), np.nan)
    by_harmonic[:, 1] = np.sqrt(np.mean(white**2, axis=1))
    ratio = np.sqrt(total / freedom) if known else 1.0
    return Adequacy(
        ratio=ratio,
        p_value=float(chi2.sf(total, freedom)) if known else 1.0,
        structure=ratio**2,
        below_floor=False,
        amplitude=points.amplitude,
        misfit=by_harmonic,
        limit=float(points.amplitude.max()) if ratio <= EXPLAINED else 0.0,
        unit=solution.model.unit,
    )


def notes_on(
    points: SteadyPoints, solution: SteadySolution, verdict: Adequacy, together: float
) -> list[str]:
    notes, known = [], bool(np.all(points.std > 0))
    if not solution.converged:
        notes.append("the fit has not come to its end: use fewer terms")
    if not known:
        notes.append("std was not given: all that is left counts as noise, and nothing is tested")
    if known and not verdict.explained:
        notes.append(
            f"{solution.unexplained:.2%} of the force is left unexplained by model and noise; the"
            " errors count it"
        )
    if together:
        notes.append(
            f"misfits of neighbouring points go together (correlation {together:.2f}): the errors"
            " count them so, and are larger than those of independent points"
        )
    turned = np.angle(np.exp(1j * solution.chain.phase))
    if "phase" in solution.free and abs(turned) > _TURNED:
        notes.append(
            f"the chain turns the phase by {np.degrees(turned):.0f} degrees: near 90, look at"
            " measured=; near 180, at the sign of the sensor"
        )
    return [*notes, *_unsteady(points, solution)]


def _unsteady(points: SteadyPoints, solution: SteadySolution) -> list[str]:
    """Points that lie off their neighbours, or scatter far more than others."""
    notes, rough = [], np.zeros(len(points), bool)
    misfit, level = solution.misfit, points.level
    inside = np.flatnonzero((level[:-2] == level[1:-1]) & (level[2:] == level[1:-1])) + 1
    if len(inside):
        off = misfit[inside] - (misfit[inside - 1] + misfit[inside + 1]) / 2
        size = np.linalg.norm(off, axis=1)
        spread = np.sqrt(np.trace(solution.rows.noise, axis1=1, axis2=2)) / solution.rows.size
        usual = np.hypot(np.median(size), spread[inside])
        # Its neighbours are off by half as much.
        peak = size >= np.maximum(*(np.interp(inside + d, inside, size) for d in (-1, 1)))
        rough[inside] = peak & (size > _ROUGH * usual)
    if np.any(rough):
        notes.append(
            f"off their neighbours: {_where(points, rough)}; where the vibration had not settled,"
            " wait longer, or leave the point out"
        )
    noisy = points.std[:, 0] > _NOISY * np.median(points.std[:, 0])
    if np.any(noisy):
        notes.append(
            f"far noisier than others: {_where(points, noisy)}; the vibration may not have settled"
        )
    return notes


def _where(points: SteadyPoints, some: NDArray[np.bool_]) -> str:
    shown = [
        f"{w / (2 * np.pi):.6g} Hz at {abs(f):.3g}"
        for w, f in zip(points.frequency[some], points.force[some], strict=True)
    ]
    more = f" and {len(shown) - 4} more" if len(shown) > 4 else ""
    return ", ".join(shown[:4]) + more
