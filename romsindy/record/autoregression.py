"""Autoregressions: what foretells a sample from those before it, and what its errors tell.

Coefficients are [1, a_1, ..., a_p]: x_t + a_1 x_(t-1) + ... + a_p x_(t-p) is the error of the
prediction. Arrays are one channel (n,) with a uniform rate.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq, solve_toeplitz
from scipy.signal import lfilter

from romsindy.typing import Array

_HIGHEST_ORDER = 30  # of those that the Bayesian criterion may choose


def autoregression(x: Array, order: int | None = None) -> Array:
    """Coefficients [1, a_1, ..., a_p] that whiten a signal (n,), p by the Bayesian criterion.

    Yule-Walker equations; p = 0, no filter at all, where the signal is white already. With an
    order, that is taken, less in a short signal.
    """
    n = len(x)
    highest = min(order or _HIGHEST_ORDER, n // 10)
    lags = np.array([x[: n - k] @ x[k:] / n for k in range(highest + 1)])
    if not lags[0] > 0:
        return np.ones(1)
    if order is not None:
        lags[0] *= 1 + 1e-8  # a clean signal needs fewer values than there are
        return np.concatenate([[1.0], solve_toeplitz(lags[:-1], -lags[1:])])
    best, choice = n * np.log(lags[0]), np.ones(1)
    for p in range(1, highest + 1):
        a = solve_toeplitz(lags[:p], -lags[1 : p + 1])
        power = lags[0] + a @ lags[1 : p + 1]
        criterion = n * np.log(power) + p * np.log(n) if power > 0 else np.inf
        if criterion < best:
            best, choice = criterion, np.concatenate([[1.0], a])
    return choice


def innovation(x: Array) -> tuple[Array, int]:
    """That part of a signal (n,) which its own past does not foretell, and the order of that.

    Of its departure from its mean, by `autoregression`; the first samples have no past.
    """
    centred = x - x.mean()
    a = autoregression(centred)
    return lfilter(a, [1.0], centred)[len(a) :], len(a) - 1


def predictor(x: Array, order: int, stride: int = 1) -> Array:
    """Coefficients (order + 1,) by least squares, over lags of ``stride`` samples.

    For few cycles of a vibration, which it goes on with: Yule-Walker equations, which take a
    signal to be nothing beyond its ends, would damp it.
    """
    order = min(order, (len(x) // stride - 1) // 3)
    rows = np.stack(
        [x[(order - k) * stride : len(x) - k * stride] for k in range(order + 1)], axis=1
    )
    return np.concatenate([[1.0], -lstsq(rows[:, 1:], rows[:, 0], cond=1e-6)[0]])


def interpolated(x: Array, missing: NDArray[np.bool_], a: Array) -> Array:
    """Least-squares interpolation by an autoregression (Janssen, Veldhuis and Vries, 1986)."""
    known = np.where(missing, 0.0, x)
    units = np.eye(len(x))[missing]
    columns = np.stack([np.convolve(unit, a, "valid") for unit in units], axis=1)
    known[missing] = lstsq(columns, -np.convolve(known, a, "valid"))[0]
    return known


def coloured_product(a: Array, x: Array, y: Array) -> Array:
    """x' S y, (m, k), for the covariance matrix S of an autoregression driven by unit white noise.

    The coefficients a (p + 1,) are those of `autoregression`; x is (n, m), y (n, k).
    """
    # S = H H' with H the impulse response 1/A: filtering backwards in time applies H'.
    left = lfilter([1.0], a, x[::-1], axis=0)
    right = lfilter([1.0], a, y[::-1], axis=0)
    return left.T @ right
