"""Crossings of zero and turning points of a decay, each from the samples round it.

Values of polynomials fitted to an eighth of a cycle on either side: linear in the samples, so that
noise biases nothing. Where to look is told by what is known of the decay as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.signal.windows import parzen

from romsindy.record.decay import Decay
from romsindy.record.spectrum import Spectrum
from romsindy.typing import Array

# Half-width of the local fits in cycles, and their degrees: a sine is a cubic (quartic) to 2e-4
# (1e-5) over this arc round its zero (its peak), and what is left is even (odd) there and harmless.
_ARC = 0.15
CROSSING, PEAK = 3, 4
_FADED = 1.0
_TOGETHER = 256  # fits at a time
_LAGS = 128  # half-cycles, beyond which errors are not alike
_ALONE = 0.03  # correlations that do not matter
# Frequencies of noise that local values hear, in fundamentals, and how many are looked at.
_HIGHEST, _FREQUENCIES = 30, 3000


@dataclass(frozen=True)
class LocalValues:
    """Values of local polynomials, their slopes, and the error of each in units of white noise."""

    value: Array
    slope: Array
    gain: Array

    @classmethod
    def of(cls, decay: Decay, at: Array, period: Array, degree: int) -> LocalValues:
        """At times ``at`` (n,), where a cycle takes ``period`` (n,)."""
        parts = [slice(i, i + _TOGETHER) for i in range(0, len(at), _TOGETHER)]
        found = [_fitted(decay, at[p], period[p], degree) for p in parts]
        return cls(*(np.concatenate(x) for x in zip(*found, strict=True)))


def _fitted(decay: Decay, at: Array, period: Array, degree: int) -> tuple[Array, Array, Array]:
    half = np.maximum(_ARC * period, (degree + 2) / 2 * decay.dt)
    n = len(decay.t)
    low = np.clip(np.ceil((at - half - decay.t[0]) / decay.dt).astype(int), 0, n - degree - 2)
    high = np.clip(np.floor((at + half - decay.t[0]) / decay.dt).astype(int) + 1, low + degree + 2, n)
    index = low[:, None] + np.arange(np.max(high - low))
    inside = index < high[:, None]
    index = np.minimum(index, n - 1)
    x = (decay.t[index] - at[:, None]) / half[:, None]
    basis = chebyshev.chebvander(np.where(inside, x, 0.0), degree)
    # Weights that fade out: samples that come and go at the ends move nothing.
    faded = basis * (inside * np.maximum(_FADED - x**2, 0.0) ** 2)[..., None]
    centre = chebyshev.chebvander(np.zeros(1), degree)[0]
    tilt = chebyshev.chebval(0.0, chebyshev.chebder(np.eye(degree + 1)))
    square = basis.transpose(0, 2, 1) @ faded
    wanted = np.broadcast_to(np.stack([centre, tilt], axis=1), (len(at), degree + 1, 2))
    weights = faded @ np.linalg.solve(square, wanted)
    value, slope = np.einsum("nk,nkj->jn", decay.q[index], weights)
    return value, slope / half, np.sqrt(np.sum(weights[..., 0] ** 2, axis=1))


@dataclass(frozen=True)
class Scatter:
    """What noise does to local values: standard deviation over their gain, and correlations.

    Attributes
    ----------
    std : float
        Unit of q.
    alike : (k,) array
        Correlation with the value 0, 1, ... half-cycles later.
    """

    std: float
    alike: Array

    @classmethod
    def of(cls, noise: Spectrum, cycle: float, dt: float, degree: int, n: int) -> Scatter:
        """Of n values half a ``cycle`` apart, fitted to samples every ``dt`` seconds."""
        count = max(int(_ARC * cycle / dt), degree // 2 + 1)
        x = np.arange(-count, count + 1) / (count + 0.5)
        basis = chebyshev.chebvander(x, degree)
        faded = basis * (_FADED - x**2)[:, None] ** 2
        weights = faded @ np.linalg.solve(basis.T @ faded, chebyshev.chebvander([0.0], degree)[0])
        highest = min(0.5 / dt, _HIGHEST / cycle)
        frequency = (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES * highest
        angle = 2 * np.pi * dt * frequency[:, None] * np.arange(1, count + 1)
        passed = (weights[count] + 2 * np.cos(angle) @ weights[count + 1 :]) ** 2
        power = noise(frequency) * passed
        lag = np.arange(min(n, _LAGS))
        shared = np.cos(np.pi * cycle * lag[:, None] * frequency) @ power
        alike = (-1.0) ** lag * shared / shared[0]  # neighbours are on opposite sides
        if n > _LAGS:
            alike *= parzen(2 * _LAGS - 1)[_LAGS - 1 :]
        if np.abs(alike[1:]).max(initial=0.0) < _ALONE:
            alike = alike[:1]
        return cls(float(np.sqrt(shared[0] / passed.sum())), alike)
