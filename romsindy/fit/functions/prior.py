"""What is known of the functions of an equation before the data speak: smooth, no inertia below 0.

Smooth: Gaussian processes with scales of their own, a trend that may be anything (a constant, a
slope, a parabola) and a departure from it, with correlation

    size^2 (1 + d) exp(-d),  d = sqrt(3) |z - z'| / length       (Matern, once differentiable [1])

between places z = q / reach. Its part that is odd in z, which a symmetric structure has not, is
smaller by a factor. Size, length and asymmetry of each function follow from the data
(`romsindy.fit.functions.evidence`): terms that the data do not support shrink to nothing, and no
order has to be chosen. The process is once differentiable only: the shrinkage of high
orders stays mild, so that features that are sharper than the rest are not smoothed away.

The inertia is nowhere negative on the range of the data: values keep to a cone of series.

[1] C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", 2006, sections
    4.2 (kernels), 2.7 (trend) and 5.4 (scales from the marginal likelihood).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import nnls

from romsindy.fit.functions.series import Series
from romsindy.typing import Array

# Of stiffness, inertia and damping: standard deviations of the first terms of the trend. Values of
# order one are normal (see `Series`); the constants of stiffness and damping may be anything.
_TREND = ((10.0, 1.0, 1.0), (1.0,), (0.0, 1.0))
_CONSTANT = 10.0  # of the damping, see `Series`
_FORCE = 3.0
# Logarithms of size, length and asymmetry: middle and spread of what they are expected to be, wide,
# and their limits. A length of 0.2 is about what 17 polynomials resolve.
_SIZES = (0.2, 0.1, 0.1)
MIDDLE = np.log([(size, 1.0, 0.3) for size in _SIZES]).ravel()
SPREAD = np.tile([2.0, 0.7, 1.0], 3)
LOW = np.tile(np.log([1e-6, 0.2, 0.01]), 3)
HIGH = np.tile(np.log([10.0, 5.0, 1.5]), 3)
_PLACES = 81  # where h >= 0 is asked for


def factor(series: Series, scales: Array) -> Array:
    """L with prior covariance L L' of the values of a series; ``scales`` (9,) as in `MIDDLE`."""
    sizes = np.exp(scales).reshape(3, 3)
    k, r, d = (
        _of_function(n, *own, trend)
        for n, own, trend in zip(series.sizes, sizes.tolist(), _TREND, strict=True)
    )
    others = [_FORCE] * len(series.forces) + series.sensor.spread
    blocks = (k, r, np.full((1, 1), _CONSTANT), d, np.diag(others))
    ends = np.cumsum([len(b) for b in blocks])
    out = np.zeros((ends[-1], ends[-1]))
    for own, end in zip(blocks, ends, strict=True):  # as block_diag, which takes longer by far
        out[end - len(own) : end, end - len(own) : end] = own
    return out


def cost(scales: Array) -> float:
    """Minus the logarithm of the prior density of the scales."""
    off = (scales - MIDDLE) / SPREAD
    return float(off @ off / 2 + np.sum(np.log(SPREAD * np.sqrt(2 * np.pi))))


@lru_cache(maxsize=64)  # differences by one scale leave two of the functions as they are
def _of_function(n: int, size: float, length: float, odd: float, trend: tuple[float, ...]) -> Array:
    """Factor of the covariance of the Chebyshev coefficients of one function, (n, n)."""
    if n <= 1:  # a constant
        return np.eye(n) * trend[0]
    apart, to_series = _grid(n)
    d = np.sqrt(3) * (apart / length)
    near, far = (1 + d) * np.exp(-d)
    values = size**2 * ((near + far) / 2 + odd**2 * (near - far) / 2)
    covariance = to_series @ values @ to_series.T
    first = range(min(len(trend), n))
    covariance[first, first] += np.square(trend[:n])
    w, v = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray(v * np.sqrt(np.maximum(w, 1e-14 * w[-1])))


@lru_cache(maxsize=64)
def _grid(n: int) -> tuple[Array, Array]:
    """Distances of n places from one another and from their images, and what makes a series."""
    z = chebyshev.chebpts1(n)
    apart = np.abs(np.stack([z[:, None] - z, z[:, None] + z]))
    return apart, np.linalg.inv(chebyshev.chebvander(z, n - 1))


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
