"""Crossings of zero and turning points of a decay, each from the samples round it.

Values of polynomials fitted to the samples near an instant: linear in them, so that noise biases
nothing. Where to look is told by what is known of the decay as a whole. What the noise does to them
follows from what was measured, between the harmonics of the vibration: integration and the removal
of drift colour it, and what is coloured errs alike from one half-cycle to the next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d
from scipy.signal.windows import parzen

from romsindy.record.decay import Decay
from romsindy.record.smoothing import MIDLINE, HarmonicSpline
from romsindy.record.spectrum import Spectrum, lines_between
from romsindy.typing import Array

# Half-width of the local fits in cycles, and their degrees: a sine is a cubic (quartic) to 4e-4
# (4e-5) over this arc round its zero (its peak), and what is left is even (odd) there and harmless.
ARC = 0.15
CROSSING, PEAK = 3, 4
_TOGETHER = 256  # fits at a time
_RANGE = 4.0  # of the periods of a decay, either way
_FAINTEST = 1e-6  # amplitude, of the largest deflection
_RIDGE = 1e-10  # of the weight of a sample: an arc at the end of a record holds half of them
# Error of band-limited interpolation at an end, over amplitude and (omega dt)^2, and what is left
# of it a sample farther inside; measured on sines.
_END, _FORGETS = 0.05, 0.6


@dataclass(frozen=True)
class LocalValues:
    """Values of local polynomials."""

    # (n,), unit of q, and per s
    value: Array
    slope: Array
    gain: Array  # (n,), standard error of the value in white noise of standard deviation one

    @classmethod
    def of(cls, decay: Decay, at: Array, period: Array, degree: int) -> LocalValues:
        """At times ``at`` (n,), where a cycle takes ``period`` (n,)."""
        usual = abs(float(np.median(period)))  # noise makes no arc longer than a few cycles
        period = np.clip(period, usual / _RANGE, usual * _RANGE)
        at = np.clip(at, decay.t[0], decay.t[-1])
        parts = [slice(i, i + _TOGETHER) for i in range(0, len(at), _TOGETHER)]
        found = [_fitted(decay, at[p], period[p], degree) for p in parts]
        return cls(*(np.concatenate(x) for x in zip(*found, strict=True)))


def faded(x: Array, degree: int) -> tuple[Array, Array]:
    """Polynomials at places x (..., k) of an arc from -1 to 1, and the same times weights.

    The weights fade out: samples that come and go at the ends of an arc move nothing.
    """
    basis = chebyshev.chebvander(np.clip(x, -1, 1), degree)
    return basis, basis * (np.maximum(1 - x**2, 0.0) ** 2)[..., None]


def _fitted(decay: Decay, at: Array, period: Array, degree: int) -> tuple[Array, Array, Array]:
    half = np.maximum(ARC * period, (degree + 4) / 2 * decay.dt)
    first = np.floor((at - half - decay.t[0]) / decay.dt).astype(int)
    index = first[:, None] + np.arange(int(2 * half.max() / decay.dt) + 3)
    inside = (index >= 0) & (index < len(decay.t))
    index = np.clip(index, 0, len(decay.t) - 1)
    x = (decay.t[index] - at[:, None]) / half[:, None]
    basis, weighted = faded(np.where(inside, x, 1.0), degree)
    centre = np.eye(degree + 1)
    wanted = np.stack([chebyshev.chebval(0.0, c) for c in (centre, chebyshev.chebder(centre))], 1)
    square = basis.transpose(0, 2, 1) @ weighted + _RIDGE * np.eye(degree + 1)
    weights = weighted @ np.linalg.solve(square, np.broadcast_to(wanted, (len(at), *wanted.shape)))
    value, slope = np.einsum("nk,nkj->jn", decay.q[index], weights)
    return value, slope / half, np.sqrt(np.sum(weights[..., 0] ** 2, axis=1))


def sides(n: int) -> Array:
    """1, -1, 1, ..., (n,): the sides of half-cycles in turn."""
    return np.resize([1.0, -1.0], n)


def half_cycles(decay: Decay) -> tuple[Array, Array]:
    """Numbers of the crossings of whole cycles, up and down in turn, and when they are, about."""
    up, down = decay.crossings
    n = min(len(up) - 1, len(down))
    at = np.empty(2 * n + 1)
    at[::2], at[1::2] = decay.t[up[: n + 1]], decay.t[down[:n]]
    return np.arange(2 * n + 1) / 2, at


def crossings_near(decay: Decay, at: Array, period: Array, amplitude: Array) -> tuple[Array, Array]:
    """When q crosses zero, up and down in turn, (n,), and its standard error in unit noise.

    By Newton's method; a slope that noise has spoilt is replaced by that of the amplitude, which is
    no more than the largest deflection, whatever a trend through few peaks says.
    """
    largest = float(np.abs(decay.q).max())
    amplitude = np.clip(amplitude, _FAINTEST * largest, largest)
    slope = 2 * np.pi / period * amplitude
    for _ in range(3):
        local = LocalValues.of(decay, at, period, CROSSING)
        ratio = np.clip(sides(len(at)) * local.slope / slope, 0.5, 2.0)
        step = sides(len(at)) * local.value / (slope * ratio)
        at = at - np.clip(step, -period / 8, period / 8)
    return at, local.gain / (slope * uniform_filter1d(ratio, 9))


def interpolation_error(decay: Decay, fine: Decay, at: Array, period: Array) -> Array:
    """Of interpolated samples at times ``at`` (n,), over the amplitude: large near the ends."""
    if fine is decay:
        return np.zeros(len(at))
    apart = np.minimum(at - fine.t[0], fine.t[-1] - at) / decay.dt
    return _END * (2 * np.pi * decay.dt / period) ** 2 * _FORGETS ** np.maximum(apart, 0)


# Cycles that tell the noise: of the later, quieter half, but so many at least and at most; between
# the knots of the smooth motion that is taken off.
_LEAST, _MOST, _KNOTS = 16, 64, 2.0
_LAGS = 128  # half-cycles, beyond which errors are not alike
# Correlations that do not matter, and what every value has of its own, so that rounding does not
# make them impossible.
_ALONE, _OWN = 0.03, 1e-6
# Frequencies of noise that are heard, in fundamentals, and how many are looked at.
_HIGHEST, _FREQUENCIES = 30, 3000

Power = Callable[[Array], Array]


def noise_behind(decay: Decay, number: Array, at: Array) -> Power:
    """Power of the noise of q per Hz, of positive and negative frequencies alike.

    ``at`` (n,) are the times of the half-cycles ``number`` (n,).
    """
    n = number[-1]
    first = np.searchsorted(number, max(0.0, min(n / 2, n - _LEAST), n - _MOST))
    at, number = at[first:], number[first:]
    later = np.diff(np.maximum.accumulate(at), prepend=-np.inf) > 0
    at, number = at[later], number[later]
    part = decay.between(at[0], at[-1])
    phase = make_interp_spline(at, 2 * np.pi * number, 3)
    motion = HarmonicSpline.along(phase, part.t, part.signal, _KNOTS)
    cycle = float((at[-1] - at[0]) / (number[-1] - number[0]))
    order, power = lines_between(part.signal - motion(part.t)[0], cycle / decay.dt)
    spectrum = Spectrum.between_harmonics(order, power, cycle)
    times, slowest, highest = decay.derivative, 1 / (2 * MIDLINE * cycle), 0.5 / decay.dt

    def integrated(frequency: Array) -> Array:
        # Cubic splines take off what is slower than two of their knots.
        slow = (slowest / frequency) ** 8
        kept = ((2 * np.pi * frequency) * (1 + slow)) ** (-2 * times) if times else 1.0
        return decay.dt * spectrum(frequency) * kept * (frequency < highest)

    return integrated


@dataclass(frozen=True)
class Scatter:
    """What noise does to local values: standard deviation over their gain, and correlations."""

    std: float  # unit of q
    # (k,), correlation with the value 0, 1, ... half-cycles later, relative to its own side.
    alike: Array

    @classmethod
    def of(cls, noise: Power, cycle: float, dt: float, degree: int, n: int) -> Scatter:
        """Of n values half a ``cycle`` apart, of polynomials fitted to samples every ``dt`` s."""
        count = max(int(ARC * cycle / dt), degree // 2 + 2)
        basis, weighted = faded(np.arange(-count, count + 1) / (count + 0.5), degree)
        centre = chebyshev.chebvander([0.0], degree)[0]
        weights = weighted @ np.linalg.solve(basis.T @ weighted, centre)
        highest = min(0.5 / dt, _HIGHEST / cycle)
        frequency = (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES * highest
        angle = 2 * np.pi * dt * frequency[:, None] * np.arange(1, count + 1)
        passed = (weights[count] + 2 * np.cos(angle) @ weights[count + 1 :]) ** 2
        power = noise(frequency) * passed
        lag = np.arange(min(n, _LAGS))
        shared = np.cos(np.pi * cycle * lag[:, None] * frequency) @ power
        std = float(np.sqrt(shared[0] / passed.sum() / dt))
        if not shared[0] > 0 or np.abs(shared[1:]).max(initial=0.0) < _ALONE * shared[0]:
            return cls(std, np.ones(1))
        alike = sides(len(lag)) * shared / shared[0]
        alike[1:] *= 1 - _OWN
        # A window whose spectrum is positive leaves the correlations possible.
        return cls(std, alike * parzen(2 * _LAGS - 1)[_LAGS - 1 :] if n > _LAGS else alike)
