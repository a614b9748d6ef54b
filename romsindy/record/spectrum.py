"""Noise of a record by its spectrum: of one channel, whatever vibrates, and between harmonics.

`noise_std` is for white noise beside a decay; `NoiseLevel` for noise of any colour; `quiet_std`
for a driven record, in which a broad band may fill most of the spectrum. Where the motion is known,
`romsindy.record.noise.Noise` tells more. Arrays are one channel (n,) with a uniform rate.

A smooth motion (`romsindy.record.smoothing`) takes all that lies near its harmonics with it. What
it leaves half-way between them is noise alone, and lines (mains hum, a second mode). Medians do not
see lines; a smooth curve through their logarithms is as rough as the record asks for, so that the
edge of a filter is resolved where there is one.

The vibration went through such a filter, too, which delays its harmonics differently, the more so
the nearer they are to the edge. How much follows from the noise, if it was white before and the
filter is one of minimum phase (Butterworth, Bessel, Chebyshev): its phase is the Hilbert transform
of the logarithm of its gain (A. Oppenheim, R. Schafer, Discrete-Time Signal Processing, 3rd ed.,
2010, ch. 12).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import find_peaks, periodogram, welch
from scipy.stats import chi2, theilslopes

from romsindy.typing import Array, Indices

# Bands of a spectrum for its slope, from this line on: what is slower may be drift.
_BANDS, _FIRST = 30, 4
_QUIET_PART = 20  # of the spectrum: its quietest such part is taken for noise
# A wave that stays: parts of a record at its end, the departure of each quarter of it beside that
# by noise, in standard deviations; the frequency is refined so often.
_ENDS, _SAME, _BY_CHANCE, _REFINED = (2, 4, 8), 0.04, 2.5, 4


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


def falling_power(power: Array, mean: Array) -> Array:
    """Power of noise that falls with the frequency, line by line of a spectrum (n,).

    Below the band of a motion there is noise alone: no more than in any slower line, of ``mean``
    power over its neighbours, and no less than in the quietest part.
    """
    return np.maximum(np.minimum.accumulate(mean), quiet_power(power))


def quiet_std(y: Array) -> float:
    """Standard deviation of white noise as strong as the quietest part of a signal's spectrum."""
    window = np.hanning(len(y))
    power = np.abs(np.fft.rfft((y - y.mean()) * window)) ** 2
    return float(np.sqrt(quiet_power(power) / np.sum(window**2)))


@dataclass(frozen=True)
class NoiseLevel:
    """Noise of one channel in two numbers, whatever vibrates in it."""

    rms: float  # without the vibration and lines, unit of the channel
    slope: float  # power of the frequency that the spectrum of the noise follows: 0 white, -1 pink
    slope_std: float  # its standard error
    ratio: float  # signal-to-noise ratio at the loudest, dB

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


HARMONICS = 6  # of the smooth motion
# Scatter of the logarithm of the median of n lines of a windowed spectrum: 1.8 / sqrt(n). Noise
# counts as white where no part of its spectrum is off by five times that.
_SCATTER, _WHITE, _CHANCE = 1.8, 5.0, 1e-6
# Width of a median: in fundamentals, as a part of the frequency, and in lines, at least.
_WIDTH, _RELATIVE, _LEAST = 0.25, 0.06, 8
_STEEP = np.log(10.0)  # from bin to bin: an edge
# Cosines that hold parts of one wave: their sum may be larger than if they were independent.
TOGETHER = 5.0
# Power of a line over the median of its surroundings, which is known to a fifth: noise reaches as
# much once in 1e7 lines of a spectrum. What lies below half of the fundamental is drift.
_LINE, _NEAR = 30.0, 40


@dataclass(frozen=True)
class Line:
    """Another vibration in a record: frequency in Hz, rms in the unit of the record."""

    frequency: float
    rms: float


@dataclass(frozen=True)
class Spectrum:
    """Power of noise against frequency: the variance of a sample if it were the same everywhere."""

    frequency: Array  # (m,), Hz, increasing
    power: Array  # (m,), unit of the record squared

    def __call__(self, frequency: Array) -> Array:
        """Power at some frequencies [Hz]."""
        return np.interp(frequency, self.frequency, self.power)

    def leaking(self, duration: float) -> Spectrum:
        """The same in the cosine transform of a record of so many seconds.

        A wave that ends anywhere is in all cosines: one of frequency g has in those of frequency f
        2 g^2 / (pi^2 T (g^2 - f^2)^2) of its power (per Hz). These parts are not independent of
        each other, and count for more than they are. The edge of a filter is anywhere in the bins
        beside it: noise reaches to their ends.
        """
        if self.white:
            return self
        f = self.frequency
        apart = f[:, None] ** 2 - f**2
        np.fill_diagonal(apart, np.inf)
        share = 2 * f**2 / (np.pi**2 * duration * apart**2)
        leak = share @ (self.power * np.gradient(f))
        return replace(self, power=_at_edges(self.power) + TOGETHER * leak)

    @property
    def white(self) -> bool:
        """Whether it is the same at all frequencies."""
        return len(self.power) == 1

    @classmethod
    def between_harmonics(cls, order: Array, power: Array, cycle: float) -> Spectrum:
        """From `lines_between`; ``cycle`` is the length of one, s."""
        smallest = np.finfo(float).tiny
        parts = _bins(order)
        middle = np.array([np.mean(order[p]) for p in parts]) / cycle
        logs = np.array([np.log(max(np.median(power[p]) / np.log(2), smallest)) for p in parts])
        variance = np.array([_SCATTER**2 / (p.stop - p.start) for p in parts])
        off = (logs - np.average(logs, weights=1 / variance)) / np.sqrt(variance)
        if np.abs(off).max() < _WHITE and off @ off < chi2.isf(_CHANCE, len(off)):
            return cls(np.zeros(1), np.array([level_of(power)]))
        return cls(middle, np.exp(_smoothed(logs, variance)))


def lines_between(x: Array, cycle: float) -> tuple[Array, Array]:
    """Frequencies over the fundamental, and the spectrum there, where a smooth motion is blind.

    ``cycle`` in samples.
    """
    n = len(x)
    window = np.hanning(n)
    power = np.abs(np.fft.rfft(x * window)) ** 2 / np.sum(window**2)
    order = np.arange(len(power)) * cycle / n
    between = (np.abs(order % 1 - 0.5) < 0.25) | (order > HARMONICS + 0.5)
    between[: min(3, len(between))] = False
    between[-3:] = False  # near half the sampling rate a window mirrors its line into itself
    return order[between], power[between]


def _bins(order: Array) -> list[slice]:
    """Neighbouring lines that share a median."""
    parts, first = [], 0
    for i in range(len(order)):
        wide = order[i] - order[first] >= max(_WIDTH, _RELATIVE * order[i])
        if wide and i + 1 - first >= _LEAST and len(order) - i > _LEAST:
            parts.append(slice(first, i + 1))
            first = i + 1
    return [*parts, slice(first, len(order))]


def _smoothed(y: Array, variance: Array) -> Array:
    """Smoothing spline through values of known variance, its roughness the most likely one.

    G. Wahba, Spline Models for Observational Data (1990), ch. 4: second differences are normal with
    mean zero, and their variance is that of the largest marginal likelihood.
    """
    weight = 1 / np.sqrt(variance)
    bend = np.diff(np.eye(len(y)), 2, axis=0) / weight
    stiffness, modes = np.linalg.eigh(bend.T @ bend)
    stiffness = np.maximum(stiffness, 0.0)
    part = modes.T @ (weight * y)
    rough = slice(2, None)  # straight lines do not bend

    def surprise(softness: float) -> float:
        spread = 1 + softness / stiffness[rough]
        return float(np.sum(np.log(spread) + part[rough] ** 2 / spread))

    softness = min(np.geomspace(1e-8, 1e4, 61), key=surprise)
    return (modes @ (part * softness / (softness + stiffness))) / weight


def _at_edges(power: Array) -> Array:
    """The largest power near an edge, in the bins on either side of it."""
    found = power.copy()
    for i in np.flatnonzero(np.abs(np.diff(np.log(power))) > _STEEP):
        found[i : i + 2] = np.maximum(found[i : i + 2], power[max(i - 1, 0) : i + 3].max())
    return found


def level_of(power: Array) -> float:
    """Mean of a white spectrum from its lower 95 %, which a few lines do not move."""
    cut = np.quantile(power, 0.95)
    tail = -np.log(0.05)
    return float(np.mean(power[power <= cut]) / (1 - 0.05 * tail / 0.95))


def round_about(power: Array) -> Array:
    """Medians of a spectrum round each of its lines, which a line itself does not move."""
    return median_filter(power, 2 * _NEAR + 1, mode="nearest")


def standing_out(power: Array, floor: Array, apart: int) -> Indices:
    """Places of lines in a spectrum that noise does not reach, ``apart`` places at least."""
    over = np.concatenate([[0.0], power / np.maximum(floor, np.finfo(float).tiny), [0.0]])
    return find_peaks(over, height=_LINE, distance=apart)[0] - 1


def strong_lines(order: Array, power: Array, n: int, cycle: float) -> tuple[Line, ...]:
    """Peaks that stand out of the spectrum round them as noise never does, strongest first."""
    # What does not stand out of the whole spectrum adds nothing to the noise.
    floor = np.maximum(round_about(power), np.median(power) / 2)
    power = np.where(order > 0.5, power, 0.0)
    found = []
    for peak in standing_out(power, floor, _NEAR + 1).tolist():
        # The window spreads a line over four lines of the spectrum; a decaying one over more.
        around = slice(max(peak - 5, 0), peak + 6)
        energy = np.sum(np.maximum(power[around] - floor[around] / np.log(2), 0.0))
        found.append(Line(float(order[peak] / cycle), float(np.sqrt(2 * energy / n))))
    return tuple(sorted(found, key=lambda line: -line.rms))


# Power of the quietest part over that of the loudest where there is a filter, and what is lost in
# an octave: more than red noise loses, which falls with the square of the frequency.
_EDGE, _OCTAVE = 1e-3, 8.0
_LINES = 4096
# The noise says little of how deep a stop band is, and of noise that was not white nothing.
_DOUBT = 3.0
_RINGS = 0.01  # of its largest response
_LEAST_EDGE = 0.125  # of the sampling rate, of a filter before a converter


def distortion(noise: Spectrum, dt: float, frequency: float, harmonics: int) -> Array:
    """Relative change of harmonics 2, 3 ... of a vibration [Hz] that a filter may have made.

    Relative to a delay of them all; zero where the noise shows no filter.
    """
    response = _response(noise, dt)
    if response is None:
        return np.zeros(harmonics - 1)
    number = np.arange(1, harmonics + 1)
    at = _frequencies(dt)
    gain, phase = (np.interp(number * frequency, at, x) for x in (response.real, response.imag))
    change = np.exp(gain - gain[0] + 1j * (phase - number * phase[0])) - 1
    return _DOUBT * np.abs(change[1:])


def settling(noise: Spectrum, dt: float) -> float:
    """How long the filter that the noise shows rings after a sudden change, s; 0 without one.

    It is held, with the structure, before a release.
    """
    response = _response(noise, dt)
    if response is None:
        return 0.0
    rings = np.abs(np.fft.irfft(np.exp(response)))[:_LINES]
    return dt * float(np.flatnonzero(rings > _RINGS * rings.max())[-1] + 1)


def before_filter(noise: Spectrum, dt: float) -> Spectrum:
    """The same without what the filter of a converter took away; as it is where it shows none.

    The filter took that of every jump of a model, too, which a record does not show. Noise of a
    narrower band is another's: beside it harmonics are as they were.
    """
    if noise.white or _response(noise, dt) is None:
        return noise
    loudest = noise.power.max()
    if noise.frequency[noise.power > loudest / 2][-1] < _LEAST_EDGE / dt:
        return noise
    last = np.flatnonzero(noise.power > _EDGE * loudest)[-1]
    beyond = np.arange(len(noise.power)) > last
    return replace(noise, power=np.where(beyond, loudest, noise.power))


def _frequencies(dt: float) -> Array:
    return np.linspace(0, 0.5 / dt, _LINES + 1)


def _response(noise: Spectrum, dt: float) -> np.ndarray | None:
    """Logarithm of the response of the filter, (m,) complex; None where there is none."""
    at = _frequencies(dt)
    power = noise(at)
    beyond = power[int(np.argmax(power)) :].min()
    steepest = np.max(power / noise(np.minimum(2 * at, at[-1])))
    if beyond > _EDGE * power.max() or steepest < _OCTAVE:
        return None
    cepstrum = np.fft.irfft(0.5 * np.log(power))
    cepstrum[1:_LINES] *= 2
    cepstrum[_LINES + 1 :] = 0
    return np.fft.rfft(cepstrum)


class Wave(NamedTuple):
    """A sine of constant size: ``size`` (complex) at time 0, unit of the signal."""

    frequency: float
    size: complex

    def __call__(self, t: Array) -> Array:
        """At times t, s."""
        return np.real(self.size * np.exp(2j * np.pi * self.frequency * t))


def steady_wave(x: Array, dt: float, cycles: float = 20.0, louder: float = 10.0) -> Wave | None:
    """What goes on as a decay has faded, such as a hum; None where there is no such vibration.

    It has a third of the power of the end of the signal, more than so many ``cycles``, and is the
    same in all quarters of that, but for white noise: what decays to a tenth over the record, or is
    moved by a force that is noise, changes there. The signal is ``louder`` by so many times at
    least.
    """
    t = dt * np.arange(len(x))
    for part in _ENDS:
        end = slice(len(x) - len(x) // part, len(x))
        wave = _fitted_wave(t[end], x[end])
        left = x[end] - np.mean(x[end]) - wave(t[end])
        faded = louder * abs(wave.size) < np.abs(x).max()
        lasts = wave.frequency * len(left) * dt > cycles
        if not (faded and lasts) or np.var(left) > abs(wave.size) ** 2:  # twice its power
            continue
        turned = left * np.exp(-2j * np.pi * wave.frequency * t[end])
        each = [2 * np.mean(quarter) for quarter in np.array_split(turned, 4)]
        by_noise = _BY_CHANCE * 2 * noise_std(left) / np.sqrt(len(left) / 4)
        if np.all(np.abs(each) < _SAME * abs(wave.size) + by_noise):
            return wave
    return None


def _fitted_wave(t: Array, x: Array) -> Wave:
    """The strongest line of a signal, by least squares from the peak of its spectrum."""
    n, dt = len(x), float(t[1] - t[0])
    spectrum = np.abs(np.fft.rfft((x - np.mean(x)) * np.hanning(n), 8 * n))
    frequency = float(np.argmax(spectrum)) / (8 * n * dt)
    for _ in range(_REFINED):
        turn = np.exp(-2j * np.pi * frequency * t)
        basis = np.stack([turn.real, -turn.imag, np.ones(n)], axis=1)
        a, b, rest = np.linalg.lstsq(basis, x, rcond=None)[0]
        wave = Wave(frequency, complex(a, -b))
        first, last = (np.mean(half) for half in np.array_split((x - rest) * turn, 2))
        frequency += float(np.angle(last / first)) / (np.pi * n * dt)  # by how its phase turns
    return wave
