"""Functions that may be true: draws of the posterior in which inertia is never negative.

h is the kinetic energy of the modes that are dragged along, a sum of squares. Draws keep to the
cone of series with h >= 0 on the range of the data; their mean is in it too, for a cone is convex.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.special import ndtr, ndtri

from romsindy.fit.functions import prior
from romsindy.fit.functions.evidence import Fitted
from romsindy.fit.functions.prior import constraints, lifted
from romsindy.typing import Array

_EACH = 8  # draws for each set of scales
_SWEEPS = 20  # of Gibbs' sampler: each forgets where it started after a few


def draw(found: Fitted, n: int, rng: np.random.Generator) -> Array:
    """Values of the series, (n, p), drawn from their posterior over all scales of the prior."""
    spread = np.linalg.cholesky(found.scale_covariance())
    draws = []
    for _ in range(-(-n // _EACH)):
        scales = found.scales + spread @ rng.standard_normal(len(spread))
        normal = found.posterior(np.clip(scales, prior.LOW, prior.HIGH))
        draws.append(_in_cone(found, *normal, rng))
    return np.concatenate(draws)[:n]


def _in_cone(found: Fitted, mean: Array, root: Array, rng: np.random.Generator) -> Array:
    """Draws of mean + root x, x standard normal, with h >= 0, (_EACH, p)."""
    x = rng.standard_normal((len(mean), _EACH))
    inertia, places = constraints(found.series)
    if not found.series.sizes.inertia:
        return np.asarray((mean[:, None] + root @ x).T)
    # x = q u + what inertia does not see; r = mean + t' u.
    q, t = np.linalg.qr(root[inertia].T)
    u = _positive(places @ mean[inertia], places @ t.T, q.T @ x, rng)
    draws = mean[:, None] + root @ (x + q @ (u - q.T @ x))
    draws[inertia] = np.stack([lifted(r) for r in draws[inertia].T], axis=1)
    return np.asarray(draws.T)


def _positive(offset: Array, slope: Array, u: Array, rng: np.random.Generator) -> Array:
    """Standard normal u (k, m) with offset + slope u >= 0: Gibbs' sampler, one u_i after another.

    J. Geweke, "Efficient simulation from the multivariate normal subject to linear constraints",
    1991.
    """
    if np.all(offset[:, None] + slope @ u >= 0):
        return u
    u = np.repeat(_inside(offset, slope)[:, None], u.shape[1], axis=1)
    for _ in range(_SWEEPS):
        for i in range(len(u)):
            column = slope[:, [i]]
            rest = offset[:, None] + slope @ u - column * u[i]
            with np.errstate(divide="ignore", invalid="ignore"):
                limit = -rest / column
            low = np.max(limit, axis=0, initial=-np.inf, where=column > 0)
            high = np.min(limit, axis=0, initial=np.inf, where=column < 0)
            u[i] = _truncated(low, np.maximum(high, low), rng)
    return u


def _truncated(low: Array, high: Array, rng: np.random.Generator) -> Array:
    """Standard normal between limits, (m,) each; by symmetry in the tail where digits are left."""
    flip = np.where(low > 0, -1.0, 1.0)
    a, b = np.where(flip < 0, -high, low), np.where(flip < 0, -low, high)
    below, above = ndtr(a), ndtr(b)
    drawn = ndtri(below + (above - below) * rng.random(len(low)))
    # So far out that no digits are left, all of it is at the near end.
    drawn = np.where(above > 0, np.clip(drawn, a, b), b)
    return np.asarray(flip * drawn)


def _inside(offset: Array, slope: Array) -> Array:
    """A point well inside offset + slope u >= 0: the margin, up to one, as large as can be."""
    size = np.abs(offset).max()
    k = slope.shape[1]
    found = linprog(
        np.append(np.zeros(k), -1.0),
        A_ub=np.column_stack([-slope, np.full(len(offset), size)]),
        b_ub=offset,
        bounds=[(None, None)] * k + [(0.0, 1.0)],
    )
    return np.asarray(found.x[:-1])
