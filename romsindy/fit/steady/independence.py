"""Does the force that a model leaves of steady states go with the motion, or with the excitation?

Noise knows neither. Terms that the model lacks, and what the excitation may do beside what was
fitted, are tried together on what is left: an F test of generalised least squares. Noise is that of
the response, and a part of the force, whose neighbours may go together. Where the noise of the
response was not given, it is found in what is left, by the restricted likelihood.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import f as fdist

from romsindy.effects.choices import sought
from romsindy.fit.adequacy.independence import SLIDES, tell_together
from romsindy.fit.adequacy.verdicts import NOT_TRIED, SteadyAdequacy
from romsindy.fit.kernel.part import LINEAR
from romsindy.fit.process_noise import KNOWN, wider
from romsindy.fit.steady.balance import CHAIN, SAME_LEVEL, Rows, SteadyPoints, linearised
from romsindy.fit.steady.solve import SteadySolution, without_neighbours
from romsindy.physics.damping import Friction, PowerDamping
from romsindy.physics.inertia import Inertia
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.typing import Array

_ROUNDS = 3  # in which noises and the correlation of neighbours settle
_ALIKE = 0.99  # correlation at most
_CHANCE = 4.0  # fall of minus twice the log-likelihood that is chance: two standard errors
_FREEDOM = 5  # rows beyond the columns, at least
# Of columns of unit size: directions below it are told by others, and by the noise of the response
# in the columns themselves, which is about as large.
_RANK = 1e-2
_CALLED = {
    "gain": "another gain of the force",
    "slope": "a gain that grows with the force",
    "phase": "another phase of the force",
}


@dataclass(frozen=True)
class _PointColumns:
    """Columns of what is left of the force, (n, k, m): those that were fitted come first."""

    names: list[str]
    columns: Array
    rows: Rows

    @property
    def enough(self) -> bool:
        """Whether there are more rows than columns."""
        return self.rows.misfit.size >= self.columns.shape[2] + _FREEDOM

    @cached_property
    def directions(self) -> Array:
        """Of the columns over the size of the force, those that differ; as columns."""
        size = self.rows.size[:, None, None]
        flat = (self.columns / size).reshape(-1, self.columns.shape[2])
        u, sizes, _ = np.linalg.svd(flat / np.linalg.norm(flat, axis=0), full_matrices=False)
        return size * u[:, sizes > _RANK].reshape(*self.columns.shape[:2], -1)


def with_spread(points: SteadyPoints, solution: SteadySolution) -> SteadyPoints:
    """Points with the likeliest noise of the response in what a fit without it leaves.

    It is the same in all points as measured; they stay as they are where they are too few.
    """
    tried = _tried(points, solution)
    if not tried.enough:
        return points
    rows, std = tried.rows, points.frequency ** -float(points.rate)
    sensor = (rows.by_q * std[:, None, None] ** 2) @ rows.by_q.swapaxes(1, 2)
    force = rows.size[:, None, None] ** 2 * np.eye(rows.misfit.shape[1])
    scale = np.trace(force.sum(axis=0)) / np.trace(sensor.sum(axis=0))

    def mixed(share: float) -> _PointNoise:
        return replace(noise, covariance=share * force + (1 - share) * scale * sensor)

    noise, share = _PointNoise(points, tried, force), 1.0
    for _ in range(_ROUNDS):
        share = _least(lambda x: mixed(x).size[1], 0.0, 1.0)
        noise = mixed(share).going_together()
    size = np.sqrt((1 - share) * scale * noise.size[0])
    return replace(points, std=np.outer(size * std, np.ones(points.q.shape[1])))


def verdict_of(points: SteadyPoints, solution: SteadySolution, given: bool) -> SteadyAdequacy:
    """Whether what is left goes with motion or force, and how much it is.

    The noise of the response was ``given``, or else found in what is left.
    """
    (n, k), n_fitted = solution.misfit.shape, len(solution.free)
    verdict = SteadyAdequacy(
        ratio=solution.over_noise if given else np.nan,
        limit=float(points.amplitude.max()),
        unit=solution.model.unit,
        part=_of_force(solution.misfit),
        unknown=np.sqrt(k) * solution.unexplained,
        **NOT_TRIED,
    )
    tried = _tried(points, solution)
    if not tried.enough:
        return verdict
    covariance = tried.rows.covariance(solution.floor)
    table = _PointNoise(points, tried, covariance).going_together().over(tried.columns)
    found = tell_together(table.T @ table, n_fitted, n * k)
    moved = tried.columns @ found.values / tried.rows.size[:, None]
    return replace(
        verdict,
        p_value=found.p_value,
        structure=found.excess,
        missing=min(_of_force(moved), verdict.part),
        like=tried.names[n_fitted + found.most],
    )


def _of_force(parts: Array) -> float:
    """Rms of forces, given as parts of the force in every equation, (n, k)."""
    return float(np.sqrt(np.mean(np.sum(parts**2, axis=1))))


def _tried(points: SteadyPoints, solution: SteadySolution) -> _PointColumns:
    model, chain = solution.model, solution.chain
    fast = float(np.max(points.frequency * points.amplitude))
    laws = (Stiffness(1), PowerDamping(1), *sought("steady"), Inertia(3))
    known = {law.key: law for law in (*laws, Friction().regularised(SLIDES * fast), *model.terms)}
    values = dict.fromkeys(known, 0.0) | model.coefficients
    rich = ReducedModel(tuple(known.values()), tuple(values.values()))
    rows = linearised(points, rich, tuple(values), chain, solution.c)
    by = dict(zip([*values, *CHAIN], np.moveaxis(rows.by_parameter, 2, 0), strict=True))
    if not points.phased:
        del by["phase"]
    # An excitation, or a sensor, of other dynamics.
    slow = (points.frequency / points.frequency.mean() - 1)[:, None]
    late = {
        f"{_CALLED[n]} {where} other frequencies": by[n] * slow**power
        for n in ("gain", "phase")
        for power, where in ((1, "at"), (2, "about"))
        if n in by
    }
    ordered = {n: by.pop(n) for n in solution.free}
    ordered |= {_CALLED.get(n, n): column for n, column in by.items()} | late
    return _PointColumns([*ordered], np.stack([*ordered.values()], axis=2), rows)


@dataclass(frozen=True)
class _PointNoise:
    """Noise in what is left of the force."""

    points: SteadyPoints
    tried: _PointColumns
    covariance: Array  # (n, k, k), of every point
    together: float = 0.0  # correlation of neighbours

    def over(self, columns: Array) -> Array:
        """Columns (n, k, m) and what is left, (n k, m + 1), over it."""
        joined = np.concatenate([columns, -self.tried.rows.misfit[..., None]], axis=2)
        table = np.linalg.solve(np.linalg.cholesky(self.covariance), joined)
        return without_neighbours(table, self.points.level, self.together)

    @cached_property
    def size(self) -> tuple[float, float]:
        """Variance of what the columns leave over it, and minus twice its log-likelihood."""
        table, level = self.over(self.tried.directions), self.points.level
        u, r = np.linalg.qr(table[:, :-1])
        left = table[:, -1] - u @ (u.T @ table[:, -1])
        freedom = len(table) - len(r)
        variance = float(left @ left) / freedom
        followers = self.covariance.shape[1] * np.count_nonzero(level[1:] == level[:-1])
        unlikely = np.linalg.slogdet(self.covariance)[1].sum() + freedom * np.log(variance)
        unlikely += followers * np.log(1 - self.together**2)
        return variance, float(unlikely + 2 * np.log(np.abs(np.diag(r))).sum())

    def going_together(self) -> _PointNoise:
        """With the likeliest correlation of neighbours, where none is much less likely."""
        found = replace(
            self, together=_least(lambda x: replace(self, together=x).size[1], 0.0, _ALIKE)
        )
        none = replace(self, together=0.0)
        return found if none.size[1] - found.size[1] > _CHANCE else none


def _least(of: Callable[[float], float], low: float, high: float) -> float:
    return float(minimize_scalar(of, bounds=(low, high), method="bounded").x)


# Off the mean of its neighbours by so many times what is usual, a point is no steady state.
_ROUGH = 8.0
_NOISY = 10.0  # times the usual standard deviation
_TURNED = 0.5  # rad: a chain that turns further says what was measured, or its sign
# Points of a run that is compared with another; logarithm of amplitudes on one branch; part of the
# force by which repeats differ anyway; chance of a difference that is noise.
_RUN, _BRANCH, _REPEATS, _BY_CHANCE = 4, 0.3, 0.02, 1e-3
_EM, _SAME = 60, 1e-9  # iterations; columns that are one


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
    return [*notes, *_unsteady(points, solution), *_repeated(points, solution)]


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
    std = points.std[:, 0]
    noisy = np.ones(len(std), bool)
    for size in (std, std / points.amplitude):  # noise may be a part of the amplitude
        noisy &= size > _NOISY * np.median(size)
    if np.any(noisy):
        notes.append(
            f"far noisier than others: {_where(points, noisy)}; the vibration may not have settled"
        )
    return notes


def _repeated(points: SteadyPoints, solution: SteadySolution) -> list[str]:
    """Levels that were measured more than once, with other values.

    Of what two runs leave where they pass through the same phases, or frequencies where phases are
    not known, the difference is compared with that of another stiffness, damping and force.
    """
    rows, scale = _own_rows(points, solution)
    own = rows.by_parameter * scale / rows.size[:, None, None]
    at = np.angle(points.q[:, 0] / points.force) if points.phased else points.frequency
    notes, misfit = [], solution.misfit
    for one, other in itertools.combinations([r for r in points.runs if len(r) >= _RUN], 2):
        force = np.abs(points.force[np.concatenate([one, other])])
        order = other[np.argsort(at[other])]
        table = np.column_stack([points.amplitude, misfit])
        ends = {"left": np.nan, "right": np.nan}
        rest = np.stack([np.interp(at[one], at[order], x[order], **ends) for x in table.T], axis=1)
        with np.errstate(invalid="ignore"):  # beyond the other run
            beside = np.abs(np.log(rest[:, 0] / points.amplitude[one])) < _BRANCH
        if np.ptp(force) > SAME_LEVEL * force.max() or np.count_nonzero(beside) < _RUN:
            continue
        same = one[beside]
        off, columns = (misfit[same] - rest[beside, 1:]).ravel(), np.concatenate(own[same])
        moved = columns @ np.linalg.lstsq(columns, off, rcond=None)[0]
        free, left = len(off) - columns.shape[1], max(float(np.sum((off - moved) ** 2)), 1e-300)
        ratio = (moved @ moved / columns.shape[1]) / (left / free)
        part = _of_force(moved.reshape(len(same), -1))
        if part > _REPEATS and fdist.sf(ratio, columns.shape[1], free) < _BY_CHANCE:
            first, second = (f"{r[0] + 1} to {r[-1] + 1}" for r in (one, other))
            notes.append(
                f"the level of {abs(points.force[one[0]]):.3g} stands twice, in points {first} and"
                f" {second}, which differ by {100 * part:.2g} % of the force: one equation runs"
                " between them; fit one of them, or give each the force that it had"
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
    rows, scale = _own_rows(points, solution)
    own = rows.whitened(solution.floor)[0].reshape(len(points), -1, 3) * scale
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
    return both * [*scale[:2], 1.0], passed @ passed.T


def _own_rows(points: SteadyPoints, solution: SteadySolution) -> tuple[Rows, Array]:
    """Rows by linear stiffness, damping and force, and of each the value that is all the force.

    Of the first two it takes up the force at the largest amplitude.
    """
    model, largest = solution.model, int(np.argmax(points.amplitude))
    known = {t.key: t for t in (*model.terms, *LINEAR)}
    values = tuple(model.coefficients.get(key, 0.0) for key in known)
    rich = replace(model, terms=tuple(known.values()), values=values)
    rows = linearised(points, rich, tuple(t.key for t in LINEAR), solution.chain, solution.c)
    ratio = rows.size[largest] / points.amplitude[largest]
    scale = np.array([ratio, ratio / points.frequency[largest], solution.chain.gain])
    return replace(rows, by_parameter=rows.by_parameter[..., :3]), scale
