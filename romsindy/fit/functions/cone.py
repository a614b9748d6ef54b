"""The cone of series whose inertia is nowhere negative on the range of the data."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import nnls

from romsindy.fit.functions.series import Series
from romsindy.typing import Array

_PLACES = 81  # where h >= 0 is asked for


def constraints(series: Series) -> tuple[slice, Array]:
    """Where the values of the inertia are, and h / z^2 at many places for each of them."""
    n_k, n_r, _ = series.sizes
    z = np.cos(np.linspace(0, np.pi, _PLACES))
    return slice(n_k, n_k + n_r), chebyshev.chebvander(z, max(n_r - 1, 0))


def nearest(series: Series, mean: Array, root: Array) -> Array:
    """The most probable of mean + root x, x standard normal, that lie in the cone.

    Least distance by non-negative least squares: C. L. Lawson, R. J. Hanson, "Solving Least Squares
    Problems", 1974, chapter 23.
    """
    inertia, places = constraints(series)
    if not series.sizes.inertia or np.all(places @ mean[inertia] >= 0):
        return mean
    slope, missing = places @ root[inertia], -places @ mean[inertia]
    size = np.linalg.norm(slope, axis=1)
    if not (np.all(np.isfinite(mean)) and np.all(size > 0)):
        return mean  # there is no motion: nothing is to be mended
    table = np.vstack([slope.T / size, missing / size])
    aim = np.append(np.zeros(len(mean)), 1.0)
    rest = table @ nnls(table, aim, maxiter=50 * _PLACES)[0] - aim
    if not rest[-1] < 0:
        return mean  # so far off that no digits are left
    return np.asarray(mean - root @ (rest[:-1] / rest[-1]))


def lifted(r: Array) -> Array:
    """A Chebyshev series that dips below 0 between the places by a trace, lifted to 0."""
    roots = chebyshev.chebroots(chebyshev.chebder(r)) if len(r) > 2 else np.zeros(0)
    inner = roots.real[(np.abs(roots.imag) < 1e-6) & (np.abs(roots.real) < 1)]
    least = np.min(chebyshev.chebval(np.r_[-1.0, 1.0, inner], r))
    return np.append(r[0] + max(-least, 0.0), r[1:])
