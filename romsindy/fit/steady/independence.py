"""Does the force that a model leaves of steady states go with the motion, or with the excitation?

Noise knows neither. Terms that the model lacks, and what the excitation may do beside what was
fitted, are tried together on what is left: an F test of generalised least squares. Noise is that of
the response, and a part of the force, whose neighbours may go together. Where the noise of the
response was not given, it is the same in all points as measured, of a size that the restricted
likelihood finds in what is left.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from romsindy.effects.choices import sought
from romsindy.fit.adequacy.together import tell_together
from romsindy.fit.adequacy.verdicts import SteadyAdequacy
from romsindy.fit.steady.balance import CHAIN, Rows, linearised
from romsindy.fit.steady.points import SteadyPoints
from romsindy.fit.steady.solve import SteadySolution, without_neighbours
from romsindy.physics.damping import Friction, PowerDamping
from romsindy.physics.inertia import Inertia
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.typing import Array

_SLIDES = 0.02  # of the largest velocity, above which a friction force is nearly all there
_ROUNDS = 3  # in which noises and the correlation of neighbours settle
# Correlation at most; part of the variance that is force at least: near a fold the noise of the
# response makes no force to first order, and some to second order.
_ALIKE, _FORCE = 0.99, 1e-3
_FREEDOM = 5  # rows beyond the columns, at least
_RANK = 1e-5  # of columns of unit size: directions below it are told by others
_CALLED = {
    "gain": "another gain of the force",
    "slope": "a gain that grows with the force",
    "phase": "another phase of the force",
}


class _TriedColumns(NamedTuple):
    """Columns of what is left of the force, (n, k, m): those that were fitted come first."""

    names: list[str]
    columns: Array
    rows: Rows


def verdict_of(points: SteadyPoints, solution: SteadySolution) -> SteadyAdequacy:
    """Whether what is left goes with motion or force, and how much it is."""
    (n, k), n_fitted = solution.misfit.shape, len(solution.free)
    power = float(np.sum(solution.over_noise**2)) if np.any(points.std > 0) else np.nan
    verdict = SteadyAdequacy(
        ratio=np.sqrt(power / (n * k - n_fitted)),
        p_value=np.nan,
        structure=1.0,
        below_floor=False,
        amplitude=np.zeros(0),
        misfit=np.zeros(0),
        limit=float(points.amplitude.max()),
        unit=solution.model.unit,
        part=_of_force(solution.misfit),
        unknown=np.sqrt(k) * solution.unexplained,
    )
    tried = _tried(points, solution)
    if n * k < tried.columns.shape[2] + _FREEDOM:
        return verdict
    if np.any(points.std > 0):
        covariance, unknown = tried.rows.covariance(solution.floor), solution.unexplained
        noise = _ForceNoise(points, tried, covariance).going_together()
    else:
        noise, unknown = _found_noise(points, tried)
    found = tell_together(noise.weighed.T @ noise.weighed, n_fitted, n * k)
    return replace(
        verdict,
        p_value=found.p_value,
        structure=found.excess,
        unknown=np.sqrt(k) * unknown,
        missing=_of_force(tried.columns @ found.values / tried.rows.size[:, None]),
        like=tried.names[n_fitted + found.most],
    )


def _of_force(parts: Array) -> float:
    """Rms of forces, given as parts of the force in every equation, (n, k)."""
    return float(np.sqrt(np.mean(np.sum(parts**2, axis=1))))


def _tried(points: SteadyPoints, solution: SteadySolution) -> _TriedColumns:
    model, chain = solution.model, solution.chain
    fast = float(np.max(points.frequency * points.amplitude))
    laws = (Stiffness(1), PowerDamping(1), *sought("steady"), Inertia(3))
    known = {law.key: law for law in (*laws, Friction().regularised(_SLIDES * fast), *model.terms)}
    values = dict.fromkeys(known, 0.0) | model.coefficients
    rich = ReducedModel(tuple(known.values()), tuple(values.values()))
    rows = linearised(points, rich, tuple(values), chain, solution.c)
    names = [*values, *CHAIN]
    by = dict(zip(names, np.moveaxis(rows.by_parameter, 2, 0), strict=True))
    if not points.phased:
        del by["phase"]
    # An excitation, or a sensor, of other dynamics.
    slow = (points.frequency / points.frequency.mean() - 1)[:, None]
    late = {f"{_CALLED[n]} at other frequencies": by[n] * slow for n in CHAIN if n in by}
    del late[f"{_CALLED['slope']} at other frequencies"]
    ordered = {n: by.pop(n) for n in solution.free}
    ordered |= {_CALLED.get(n, n): column for n, column in by.items()} | late
    return _TriedColumns([*ordered], np.stack([*ordered.values()], axis=2), rows)


@dataclass(frozen=True)
class _ForceNoise:
    """Noise in what is left of the force."""

    points: SteadyPoints
    tried: _TriedColumns
    covariance: Array  # (n, k, k), of every point
    together: float = 0.0  # correlation of neighbours

    @cached_property
    def weighed(self) -> Array:
        """Columns and what is left, (n k, m), over it."""
        joined = np.concatenate([self.tried.columns, -self.tried.rows.misfit[..., None]], axis=2)
        table = np.linalg.solve(np.linalg.cholesky(self.covariance), joined)
        return without_neighbours(table, self.points.level, self.together)

    @cached_property
    def size(self) -> tuple[float, float]:
        """Variance of what the columns leave over it, and minus twice its log-likelihood."""
        table, norms = self.weighed, np.linalg.norm(self.weighed[:, :-1], axis=0)
        u, sizes, _ = np.linalg.svd(table[:, :-1] / norms, full_matrices=False)
        told = sizes > _RANK
        left = table[:, -1] - u[:, told] @ (u[:, told].T @ table[:, -1])
        freedom, level = len(table) - np.count_nonzero(told), self.points.level
        variance = float(left @ left) / freedom
        followers = self.covariance.shape[1] * np.count_nonzero(level[1:] == level[:-1])
        unlikely = np.sum(np.linalg.slogdet(self.covariance)[1])
        unlikely += followers * np.log(1 - self.together**2) + freedom * np.log(variance)
        return variance, float(unlikely + 2 * np.log(sizes[told]).sum() + 2 * np.log(norms).sum())

    def going_together(self) -> _ForceNoise:
        """With the likeliest correlation of neighbours."""
        found = _least(lambda x: replace(self, together=x).size[1], 0.0, _ALIKE)
        return replace(self, together=found)


def _found_noise(points: SteadyPoints, tried: _TriedColumns) -> tuple[_ForceNoise, float]:
    """The likeliest noise where that of the response is not known, and what of it is force."""
    rows = tried.rows
    std = points.frequency ** -float(points.rate)
    sensor = (rows.by_q * std[:, None, None] ** 2) @ rows.by_q.swapaxes(1, 2)
    force = rows.size[:, None, None] ** 2 * np.eye(rows.misfit.shape[1])
    sensor *= np.trace(force.sum(axis=0)) / np.trace(sensor.sum(axis=0))

    def mixed(share: float) -> _ForceNoise:
        return replace(noise, covariance=share * force + (1 - share) * sensor)

    noise, share = _ForceNoise(points, tried, force), 1.0
    for _ in range(_ROUNDS):
        share = _least(lambda x: mixed(x).size[1], _FORCE, 1.0)
        noise = mixed(share).going_together()
    return noise, float(np.sqrt(share * noise.size[0]))


def _least(of: Callable[[float], float], low: float, high: float) -> float:
    return float(minimize_scalar(of, bounds=(low, high), method="bounded").x)
