"""Noise of a record: its level, its colour and the lines in it. The one estimator of all rooms.

It looks at what a smooth motion (`romsindy.record.smoothing`) leaves of a record, between the
harmonics of the vibration, where no such motion reaches. Medians of the spectrum there do not see
lines (mains hum, a second mode), which are listed beside it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import dct, idct
from scipy.linalg import solve_toeplitz
from scipy.ndimage import median_filter
from scipy.signal import lfilter, periodogram
from scipy.stats import theilslopes

from romsindy.record.drift import drift
from romsindy.record.spectrum import Line, Spectrum, lines_between, strong_lines
from romsindy.typing import Array

# Bands of a spectrum for its slope, from this line on: what is slower may be drift.
_BANDS, _FIRST = 30, 4
# Where the noise is 30 dB below its mean (beyond a filter), all that is known is that it is quiet:
# whatever a wrong model leaves there must not decide.
_QUIETEST = 1e-3


@dataclass(frozen=True)
class Noise:
    """Noise of a record: its size, and what makes it white.

    Attributes
    ----------
    std : float
        Standard deviation of the noise without its lines and without drift, unit of the record.
    spectrum : Spectrum
        Of the same, at all frequencies.
    dt : float
        Sampling interval, s.
    floor : float
        Misfit that does not matter, unit of the record; part of std.
    lines : tuple of Line
        Strongest first.
    level : float
        Rms of all that lies between the harmonics, lines included.
    drift : Spectrum or None
        Power that a drifting offset adds.
    alike : bool
        Whether all samples weigh alike, by the level, and lines are noise. Whitening lets the
        quietest part of the spectrum decide, which a wrong model does not survive.
    """

    std: float
    spectrum: Spectrum
    dt: float
    floor: float
    lines: tuple[Line, ...] = ()
    level: float = 0.0
    drift: Spectrum | None = None
    alike: bool = False

    @classmethod
    def of(
        cls,
        rest: Array,
        slow: Array,
        amplitude: Array,
        cycle: float,
        dt: float,
        floor: float,
        after: Array | None = None,
    ) -> Noise:
        """From what a smooth motion leaves of a record, and the least standard deviation.

        Parameters
        ----------
        rest : (n,) array
            The record less the smooth motion.
        slow : (n,) array
            Mean of the smooth motion over its cycles.
        amplitude : (n,) array
            That of its fundamental.
        cycle : float
            Mean length of a cycle, s.
        dt : float
            Sampling interval, s.
        floor : float
            Unit of the record.
        after : (m,) array, optional
            What follows the vibration, where that is noise alone and tells more than the rest.
        """
        alone = rest if after is None else after
        order, power = lines_between(alone, cycle / dt)
        lines = strong_lines(order, power, len(alone), cycle)
        level = float(np.sqrt(np.mean(power) + floor**2))
        spectrum = Spectrum.between_harmonics(order, power, cycle)
        spectrum = replace(spectrum, power=spectrum.power + floor**2)
        every = np.fft.rfftfreq(len(rest), dt)
        std = float(np.sqrt(np.mean(spectrum(every))))
        beside = spectrum.leaking(len(rest) * dt)
        slowly = drift(rest + slow, amplitude, beside, cycle, dt)
        return cls(std, spectrum, dt, floor, lines, level, slowly)

    @classmethod
    def white(cls, std: float, dt: float, floor: float = 0.0) -> Noise:
        """White noise of a known standard deviation."""
        power = np.full(2, std**2)
        return cls(std, Spectrum(np.array([0.0, 0.5 / dt]), power), dt, floor, level=std)

    def weighing_alike(self) -> Noise:
        """The same for fits that may be wrong: see `alike`."""
        return replace(self, std=self.level, alike=True)

    def share(self, n: int) -> float:
        """Part of n samples that tells anything: what lies beyond a filter does not."""
        return 1.0 if self.alike else float(np.mean(self._power(n) / self._weighed(n)))

    def __call__(self, x: Array) -> Array:
        """Filter signals (n, ...) so that the noise in them is white with standard deviation 1."""
        if self.drift is None and (self.alike or self.spectrum.white):
            return x / self.std
        # The cosines of a record without memory of its ends are nearly independent for any noise
        # (N. Ahmed, T. Natarajan, K. Rao, IEEE Trans. Computers C-23, 1974, 90).
        weight = 1 / np.sqrt(self._weighed(len(x)))
        waves = dct(x, norm="ortho", axis=0)
        return idct(waves * weight.reshape(-1, *np.ones(x.ndim - 1, int)), norm="ortho", axis=0)

    def draw(self, n: int, dt: float, rng: np.random.Generator) -> Array:
        """Noise like this one: the same level and colour, lines with phases of their own, (n,)."""
        x = idct(np.sqrt(self._power(n)) * rng.standard_normal(n), norm="ortho")
        for line in self.lines:
            phase = 2 * np.pi * (line.frequency * dt * np.arange(n) + rng.random())
            x += np.sqrt(2) * line.rms * np.cos(phase)
        return x

    def _power(self, n: int) -> Array:
        """Variance of the cosines of n samples, (n,)."""
        return self._drifting(self.spectrum(self._frequency(n)))

    def _weighed(self, n: int) -> Array:
        """By what they are weighed: no less than what is quiet, or leaks from other cosines."""
        if self.alike:
            return self._drifting(np.full(n, self.std**2))
        power = self._drifting(self.spectrum.leaking(n * self.dt)(self._frequency(n)))
        return np.maximum(power, _QUIETEST * self.std**2)

    def _drifting(self, power: Array) -> Array:
        """Power of cosines, (n,), with that of the drift."""
        return power if self.drift is None else power + self.drift(self._frequency(len(power)))

    def _frequency(self, n: int) -> Array:
        return np.arange(n) / (2 * n * self.dt)


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


_HIGHEST_ORDER = 30  # of the autoregression of any signal


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
