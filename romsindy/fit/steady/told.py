"""What a fit to steady states says of itself and of its points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from romsindy.fit.kernel.part import LINEAR
from romsindy.fit.process_noise import KNOWN, wider
from romsindy.fit.steady.balance import linearised
from romsindy.fit.steady.points import SteadyPoints
from romsindy.fit.steady.solve import SteadySolution, without_neighbours
from romsindy.typing import Array

# Off the mean of its neighbours by so many times what is usual, a point is no steady state.
_ROUGH = 8.0
_NOISY = 10.0  # times the usual standard deviation
_TURNED = 0.5  # rad: a chain that turns further says what was measured, or its sign
_EM, _SAME, _ALIKE = 60, 1e-9, 0.99  # iterations; columns, and neighbours, that are one


def notes_on(
    points: SteadyPoints, solution: SteadySolution, together: float, given: bool
) -> list[str]:
    notes = []
    if not solution.converged:
        notes.append("the fit has not come to its end: use fewer terms")
    if not given:
        std = points.std[0, 0] * points.frequency[0] ** points.rate
        found = f"{std:.3g} was found in what is left" if std else "all that is left is a force"
        notes.append(f"std was not given: {found}")
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


def between_levels(
    points: SteadyPoints, solution: SteadySolution, together: float
) -> tuple[Array, Array]:
    """By how much a further level may differ, and what that of the levels makes the values err by.

    Points of a level go together: what the model lacks there, and how large the force really was.
    Each level gets a linear stiffness, a damping and a force of its own, whose scatter follows from
    the misfits, with the correlation of neighbours, by the EM algorithm of restricted likelihood
    [1]. Few levels tell it badly: that it is as large as what a point may leave unexplained counts
    for two, less what neighbours share anyway. What is beyond the data comes to as much in all.
    These are standard deviations, within the data and of what grows beyond, (2, 3), the last
    relative to the force; and the covariance of all that was fitted, (p, p), by levels alone.

    [1] N. Laird, J. Ware, "Random-effects models for longitudinal data", Biometrics 38 (1982) 963.
    """
    numbers, shape = np.unique(points.level), (len(points), -1, len(solution.free))
    if len(numbers) < 2:
        return np.zeros((2, 3)), np.zeros_like(solution.covariance)
    own, units = _by_level(points, solution)
    each = [own * (points.level == i)[:, None, None] for i in numbers]
    by_value = solution.rows.whitened(solution.floor)[0].reshape(shape)
    common = np.concatenate([by_value / np.linalg.norm(by_value, axis=(0, 1)), own], axis=2)
    table = np.concatenate([common, *each, solution.white[..., None]], axis=2)
    table = without_neighbours(table, points.level, min(together, _ALIKE))
    u, strong, _ = np.linalg.svd(table[:, : common.shape[2]], full_matrices=False)
    u, left = u[:, strong > _SAME * strong[0]], table[:, common.shape[2] :]
    left = left - u @ (u.T @ left)
    products, n, hidden = left.T @ left, len(each), solution.hidden
    expected = hidden * (1 - together)
    sizes = np.full(3, max(float(np.sqrt(np.mean(solution.misfit**2))), solution.floor))
    for _ in range(_EM):
        inner = np.linalg.inv(products[:-1, :-1] + np.diag(np.tile(sizes**-2.0, n)))
        squares = (inner @ products[:-1, -1]) ** 2 + np.diag(inner)
        seen = squares.reshape(n, 3).sum(axis=0)
        sizes = np.sqrt((KNOWN * expected**2 + seen) / (KNOWN + n))
    both = np.stack([sizes, np.maximum(sizes, hidden / np.sqrt(len(sizes)))]) * wider(KNOWN + n - 1)
    moved = [np.einsum("nkp,nkj->pj", by_value, z) * both[0] for z in each]
    passed = solution.covariance @ np.concatenate(moved, axis=1)
    return both * [*units, 1.0], passed @ passed.T


def _by_level(points: SteadyPoints, solution: SteadySolution) -> tuple[Array, Array]:
    """Rows (n, k, 3) by linear stiffness, damping and force, whitened, as parts of all the force.

    Of the first two that is what would take it up at the largest amplitude: their units, (2,).
    """
    model, largest = solution.model, int(np.argmax(points.amplitude))
    known = {t.key: t for t in (*model.terms, *LINEAR)}
    values = tuple(model.coefficients.get(key, 0.0) for key in known)
    rich = replace(model, terms=tuple(known.values()), values=values)
    rows = linearised(points, rich, tuple(t.key for t in LINEAR), solution.chain, solution.c)
    own, _ = replace(rows, by_parameter=rows.by_parameter[..., :3]).whitened(solution.floor)
    ratio = rows.size[largest] / points.amplitude[largest]
    units = ratio / np.array([1.0, points.frequency[largest]])
    return (own * [*units, solution.chain.gain]).reshape(len(points), -1, 3), units
