"""How strong the noise in one channel is, whatever vibrates in it.

`noise_std` is for white noise beside a decay; `NoiseLevel` for noise of any colour; `quiet_std`
for a driven record, in which a broad band may fill most of the spectrum. Where the motion is known,
`romsindy.record.noise.Noise` tells more. Arrays are one channel (n,) with a uniform rate.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import periodogram, welch
from scipy.stats import theilslopes

from romsindy.typing import Array

# Bands of a spectrum for its slope, from this line on: what is slower may be drift.
_BANDS, _FIRST = 30, 4
_QUIET_PART = 20  # of the spectrum: its quietest such part is taken for noise


def noise_std(x: Array) -> float:
    """Standard deviation of white noise in one channel, from the median of its spectrum.

    Vibration fills few lines of the spectrum, white noise all of them; the median sees the noise.
    Coloured or low-passed noise is underestimated.
    """
    pieces = max(len(x) // 1024, 1)
    # Half overlapping, these are an odd number of segments. The median of a line over them is
    # distributed about ln 2 of its mean, but was divided by its expectation there, an alternating
    # harmonic sum (Allen et al., FINDCHIRP, Phys. Rev. D 85 (2012), appendix B).
    _, power = welch(x, 1.0, nperseg=len(x) // pieces, average="median")
    expected = 1 + sum(1 / (k + 1) - 1 / k for k in range(2, 2 * pieces - 1, 2))
    return float(np.sqrt(np.median(power) * expected / np.log(2) / 2))


def quiet_power(power: Array) -> float:
    """Mean power of a line in the quietest part of a spectrum, (n,)."""
    return float(min(np.mean(band) for band in np.array_split(power[1:], _QUIET_PART)))


def quiet_std(y: Array) -> float:
    """Standard deviation of white noise as strong as the quietest part of a signal's spectrum."""
    n = len(y)
    window = np.hanning(n)
    power = np.abs(np.fft.rfft((y - y.mean()) * window)) ** 2
    return float(np.sqrt(quiet_power(power) / np.sum(window**2)))


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
