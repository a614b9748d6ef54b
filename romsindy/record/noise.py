"""Noise of a record: its level, its colour and the lines in it. The one estimator of all rooms.

It looks at what a smooth motion (`romsindy.record.smoothing`) leaves of a record, between the
harmonics of the vibration, where no such motion reaches. Medians of the spectrum there do not see
lines (mains hum, a second mode), which are listed beside it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.ndimage import median_filter
from scipy.signal import lfilter, periodogram
from scipy.stats import theilslopes

from romsindy.typing import Array

HARMONICS = 6  # of the smooth motion
_ORDER = 8  # of the autoregression of coloured noise
_HIGHEST_ORDER = 30  # of that of any signal
# Scatter of the logarithm of the median of n lines of a windowed spectrum: 1.8 / sqrt(n). Noise
# counts as white where no part of its spectrum is off by five times that.
_SCATTER, _WHITE = 1.8, 5.0
# Between low harmonics the smooth motion takes part of the noise, or leaves some of itself. Only a
# large difference over many lines says that the noise is louder there.
_LOW_MAY_DIFFER, _MANY_LINES = 2.0, 50
# Power of a line over the median of its surroundings, which is known to a fifth: noise reaches as
# much once in 1e7 lines of a spectrum. What lies below half of the fundamental is drift.
_LINE, _NEAR = 30.0, 40
# Bands of a spectrum for its slope, from this line on: what is slower may be drift.
_BANDS, _FIRST = 30, 4


@dataclass(frozen=True)
class Line:
    """Another vibration in a record: frequency in Hz, rms in the unit of the record."""

    frequency: float
    rms: float


@dataclass(frozen=True)
class Noise:
    """Noise of a record: its size, and the filter that makes it white.

    Attributes
    ----------
    std : float
        Standard deviation of the noise without its lines, unit of the record.
    filter : (p + 1,) array
        Coefficients of an autoregression; [1] for white noise.
    innovation : float
        Standard deviation of the filtered noise.
    floor : float
        Misfit that does not matter, unit of the record; part of std.
    lines : tuple of Line
        Strongest first.
    level : float
        Rms of all that lies between the harmonics, lines included.
    alike : bool
        Whether all samples weigh alike, by the level, and lines are noise. Whitening lets the
        quietest part of the spectrum decide, which a wrong model does not survive.
    """

    std: float
    filter: Array
    innovation: float
    floor: float
    lines: tuple[Line, ...] = ()
    level: float = 0.0
    alike: bool = False

    @classmethod
    def of(cls, rest: Array, cycle: float, dt: float, floor: float) -> Noise:
        """From what a smooth motion leaves of a record, (n,), and the least standard deviation.

        ``cycle`` is the mean length of a cycle, ``dt`` the sampling interval, s.
        """
        order, power = _between_harmonics(rest, cycle / dt)
        lines = _lines(order, power, len(rest), cycle)
        power = power + floor**2
        level = float(np.sqrt(np.mean(power)))
        high = order > HARMONICS + 0.5
        asked = power[high] if np.count_nonzero(high) > 200 else power
        std = float(np.sqrt(_level(asked)))
        if _is_white(asked, std) and (np.all(high) or _low_is_alike(power[~high], std)):
            return cls(std, np.ones(1), std, floor, lines, level)
        smooth = median_filter(power, max(len(power) // 12, 15), mode="nearest") / np.log(2)
        every = np.linspace(0, order[-1], len(rest) // 2 + 1)
        lags = np.fft.irfft(np.interp(every, order, smooth))[: _ORDER + 1]
        a = np.concatenate([[1.0], solve_toeplitz(lags[:-1], -lags[1:])])
        white = _between_harmonics(lfilter(a, [1.0], rest), cycle / dt)[1]
        innovation = float(np.sqrt(_level(white) + floor**2 * float(a @ a)))
        return cls(float(np.sqrt(lags[0])), a, innovation, floor, lines, level)

    def weighing_alike(self) -> Noise:
        """The same for fits that may be wrong: see `alike`."""
        return replace(self, std=self.level, alike=True)

    def __call__(self, x: Array) -> Array:
        """Filter signals (n, ...) so that the noise in them is white with standard deviation 1."""
        if self.alike or len(self.filter) == 1:
            return x / self.std
        return lfilter(self.filter, [1.0], x, axis=0) / self.innovation

    def draw(self, n: int, dt: float, rng: np.random.Generator) -> Array:
        """Noise like this one: the same level and colour, lines with phases of their own, (n,)."""
        settle = 20 * len(self.filter)
        white = self.innovation * rng.standard_normal(n + settle)
        x = lfilter([1.0], self.filter, white)[settle:]
        for line in self.lines:
            phase = 2 * np.pi * (line.frequency * dt * np.arange(n) + rng.random())
            x += np.sqrt(2) * line.rms * np.cos(phase)
        return x


@dataclass(frozen=True)
class NoiseLevel:
    """Noise of one channel in two numbers, whatever vibrates in it.

    Attributes
    ----------
    rms : float
        Without the vibration and lines, unit of the channel.
    slope : float
        Power of the frequency that the spectrum of the noise follows: 0 white, -1 pink.
    slope_std : float
        Its standard error.
    ratio : float
        Signal-to-noise ratio at the loudest, dB.
    """

    rms: float
    slope: float
    slope_std: float
    ratio: float

    @property
    def coloured(self) -> bool:
        """Whether slow noise is clearly the stronger."""
        return self.slope + 2 * self.slope_std < -0.5

    @classmethod
    def of(cls, x: Array, dt: float) -> NoiseLevel:
        """From medians of the spectrum of the later, quieter half of a channel (n,).

        Vibrations and lines fill few lines of the spectrum, and the slope that suits most pairs of
        medians (Theil and Sen) does not see those that they do fill.
        """
        frequency, power = periodogram(x[len(x) // 2 :], 1 / dt, window="hann")
        edges = np.geomspace(_FIRST * frequency[1], 0.5 / dt, _BANDS + 1)
        places = np.searchsorted(frequency, edges)
        bands = [slice(a, b) for a, b in itertools.pairwise(places) if b - a >= 3]
        middle = np.array([np.sqrt(frequency[b.start] * frequency[b.stop - 1]) for b in bands])
        density = np.array([np.median(power[b]) for b in bands]) / np.log(2)
        density = np.maximum(density, np.finfo(float).tiny)
        slope, _, low, high = theilslopes(np.log(density), np.log(middle), 0.95)
        width = frequency[1] * np.array([b.stop - b.start for b in bands])
        rms = float(np.sqrt(np.sum(median_filter(density, 3) * width)))
        ratio = 20 * np.log10(np.abs(x).max() / np.sqrt(2) / max(rms, np.finfo(float).tiny))
        return cls(rms, float(slope), float(high - low) / 4, float(ratio))


def _between_harmonics(x: Array, cycle: float) -> tuple[Array, Array]:
    """Frequencies over the fundamental, and the spectrum there, where a smooth motion is blind."""
    n = len(x)
    window = np.hanning(n)
    power = np.abs(np.fft.rfft(x * window)) ** 2 / np.sum(window**2)
    order = np.arange(len(power)) * cycle / n
    between = (np.abs(order % 1 - 0.5) < 0.25) | (order > HARMONICS + 0.5)
    between[: min(3, len(between))] = False
    between[-3:] = False  # near half the sampling rate a window mirrors its line into itself
    return order[between], power[between]


def _level(power: Array) -> float:
    """Mean of a white spectrum from its lower 95 %, which a few lines do not move."""
    cut = np.quantile(power, 0.95)
    tail = -np.log(0.05)
    return float(np.mean(power[power <= cut]) / (1 - 0.05 * tail / 0.95))


def _is_white(power: Array, std: float) -> bool:
    blocks = np.array_split(power, max(min(6, len(power) // 15), 1))
    return all(_off(b, std) < _WHITE * _SCATTER / np.sqrt(len(b)) for b in blocks)


def _low_is_alike(power: Array, std: float) -> bool:
    return len(power) < _MANY_LINES or _off(power, std) < np.log(_LOW_MAY_DIFFER)


def _off(power: Array, std: float) -> float:
    return float(np.abs(np.log(np.median(power) / np.log(2) / std**2)))


def _lines(order: Array, power: Array, n: int, cycle: float) -> tuple[Line, ...]:
    """Peaks that stand out of the spectrum round them as noise never does."""
    # What does not stand out of the whole spectrum adds nothing to the noise.
    floor = np.maximum(median_filter(power, 2 * _NEAR + 1, mode="nearest"), np.median(power) / 2)
    left, found = np.where(order > 0.5, power, 0.0), []
    while np.any(left > _LINE * floor):
        peak = int(np.argmax(left / np.maximum(floor, 1e-300)))
        # The window spreads a line over four lines of the spectrum; a decaying one over more.
        around = slice(max(peak - 5, 0), peak + 6)
        energy = np.sum(np.maximum(left[around] - floor[around] / np.log(2), 0.0))
        found.append(Line(float(order[peak] / cycle), float(np.sqrt(2 * energy / n))))
        left[slice(max(peak - _NEAR, 0), peak + _NEAR + 1)] = 0.0
    return tuple(sorted(found, key=lambda line: -line.rms))


def autoregression(x: Array) -> Array:
    """Coefficients [1, a_1, ..., a_p] that whiten a signal (n,), p by the Bayesian criterion.

    Yule-Walker equations; p = 0, no filter at all, where the signal is white already.
    """
    n = len(x)
    highest = min(_HIGHEST_ORDER, n // 10)
    lags = np.array([x[: n - k] @ x[k:] / n for k in range(highest + 1)])
    if not lags[0] > 0:
        return np.ones(1)
    best, choice = n * np.log(lags[0]), np.ones(1)
    for p in range(1, highest + 1):
        a = solve_toeplitz(lags[:p], -lags[1 : p + 1])
        power = lags[0] + a @ lags[1 : p + 1]
        criterion = n * np.log(power) + p * np.log(n) if power > 0 else np.inf
        if criterion < best:
            best, choice = criterion, np.concatenate([[1.0], a])
    return choice


def coloured_product(a: Array, x: Array, y: Array) -> Array:
    """x' S y, (m, k), for the covariance matrix S of an autoregression driven by unit white noise.

    The coefficients a (p + 1,) are as `autoregression` returns them; x is (n, m), y (n, k).
    """
    # S = H H' with H the impulse response 1/A: filtering backwards in time applies H'.
    left = lfilter([1.0], a, x[::-1], axis=0)
    right = lfilter([1.0], a, y[::-1], axis=0)
    return left.T @ right
