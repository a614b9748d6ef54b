"""Frequency and damping against amplitude, read off a free decay cycle by cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d

from romsindy.record.decay import Decay
from romsindy.record.events import CROSSING, PEAK, LocalValues, Scatter
from romsindy.record.signals import noise_std
from romsindy.record.smoothing import HarmonicSpline
from romsindy.record.spectrum import Spectrum, lines_between
from romsindy.record.trend import Curves, Pace, Trend
from romsindy.typing import Array

# Squared amplitudes must differ by this part of the least: further than a hundred times what they
# span, nothing but noise is extrapolated.
_LEVER = 0.01
_ROUNDING = 1e-6  # of the largest amplitude
_SHAPE = 1e-5  # of an amplitude, that local polynomials are off by
_TIME, _SIZE = 5, 5
_ENDS, _FORGETS = 0.05, 0.6
_WHITE = np.ones(1)
_SIZES = 10 ** np.linspace(-1.5, 3, 19)
_TIMES = 10 ** np.linspace(-4, 1, 21)
# A cycle whose own frequency has a larger relative standard error judges no model.
CERTAIN = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Backbone:
    """Amplitude, frequency and damping of the cycles of a decay, in the order of time.

    Attributes
    ----------
    t : (n,) array
        Middle of each cycle, s.
    amplitude : (n,) array
        Half of peak to peak, at the middle of the cycle, unit of q.
    frequency : (n,) array
        Angular frequency, rad/s.
    damping_ratio : (n,) array
        Logarithmic decrement over sqrt(4 pi^2 + decrement^2), dimensionless.
    positive_peak, negative_peak : (n,) arrays
        Largest and smallest q, at the middle of the cycle; they differ for asymmetric systems.
    amplitude_std, frequency_std, damping_ratio_std : (n,) arrays
        Standard errors from the scatter of the samples about the local fits, or that of the
        cycles about their neighbours where it is larger, as in coloured noise. Neighbouring
        cycles share samples, so their errors are correlated.
    unit : str or None
        Unit of q.
    """

    t: Array
    amplitude: Array
    frequency: Array
    damping_ratio: Array
    positive_peak: Array
    negative_peak: Array
    amplitude_std: Array
    frequency_std: Array
    damping_ratio_std: Array
    unit: str | None = None

    def __len__(self) -> int:
        return len(self.t)

    @property
    def certain(self) -> NDArray[np.bool_]:
        """Cycles whose own frequency is known well enough to judge a model, (n,)."""
        return np.asarray(self.frequency_std < CERTAIN * self.frequency)

    def linear_frequency(self) -> float:
        """Angular frequency at vanishing amplitude, rad/s.

        Intercept of frequency^2 against amplitude^2 over the quietest third of the cycles (four at
        least), weighted by their standard errors; the mean where their amplitudes hardly differ.
        """
        quiet = np.argsort(self.amplitude)[: max(len(self) // 3, min(4, len(self)))]
        squared = self.frequency[quiet] ** 2
        std = 2 * self.frequency[quiet] * self.frequency_std[quiet]
        std = np.maximum(std, 1e-6 * squared)  # clean records have no scatter to weigh by
        sizes = self.amplitude[quiet] ** 2
        if np.ptp(sizes) < _LEVER * sizes.min():
            return float(np.sqrt(np.average(squared, weights=1 / std**2)))
        line = np.polynomial.Polynomial.fit(sizes, squared, 1, w=1 / std)
        return float(np.sqrt(line(0.0)))

    def __repr__(self) -> str:
        a, f = self.amplitude, self.frequency / (2 * np.pi)
        return (
            f"<Backbone: {len(a)} cycles, amplitude {a.max():.4g} to {a.min():.4g}"
            f" {self.unit or '[q]'}, frequency {f[np.argmax(a)]:.5g} to {f[np.argmin(a)]:.5g} Hz>"
        )


def joined(backbones: Sequence[Backbone]) -> Backbone:
    """The cycles of several decays of one structure as one backbone, in the order given."""
    names = [f.name for f in fields(Backbone) if f.name != "unit"]
    values = {n: np.concatenate([getattr(b, n) for b in backbones]) for n in names}
    return Backbone(**values, unit=backbones[0].unit)


def extract_backbone(decay, *, cycles=None):
    if cycles is not None and cycles < 2:
        raise ValueError(f"cycles = {cycles!r} must be at least 2")
    record = decay.single().free()
    fine = record.upsampled()
    number, at = _half_cycles(fine)
    period = 2 * np.gradient(at)
    cycle = float(np.median(period))
    centre = number[:-1] + 0.25
    level = noise_std(record.signal) * (cycle / (2 * np.pi)) ** record.derivative * np.sqrt(record.dt / fine.dt)
    # first look
    peak = LocalValues.of(fine, (at[1:] + at[:-1]) / 2, period[1:], PEAK)
    size = np.maximum(np.abs(peak.value), level * peak.gain)
    level = max(level, _ROUNDING * size.max())
    rough = np.convolve(np.log(size), [0.25, 0.5, 0.25], "same")
    rough[0], rough[-1] = 2 * rough[1] - rough[2], 2 * rough[-2] - rough[-3]
    pace = Pace.of(centre, rough, -np.gradient(rough, centre))
    sizes = Trend.through(centre, np.log(size), peak.gain * level / size, _WHITE, Curves.at(pace, _SIZE, 2 * _SIZE - 1), _SIZES, cycles)
    pace = Pace.of(centre, sizes(centre)[0], -sizes(centre, 1)[0])
    expected = np.exp(sizes(number)[0])
    curves = Curves.at(pace, _TIME, 2 * _TIME - 3)
    for _ in range(2):
        at, std = _crossings(fine, at, period, expected)
        times = _Times(number, at, std * level, _WHITE, curves, cycles)
        period = times(number, 1)[0]
    at, std = _crossings(fine, at, period, expected)
    # Interpolation knows nothing of what is beyond the ends.
    def edge(at, period):
        apart = np.minimum(at - fine.t[0], fine.t[-1] - at) / record.dt
        return (fine is not record) * _ENDS * (2 * np.pi * record.dt / period) ** 2 * _FORGETS**apart
    # noise
    curves = Curves.at(pace, _TIME, 2 * _TIME - 3)
    noise = _noise(record, fine.dt, number, times)
    one, other = (Scatter.of(noise, cycle, fine.dt, k, len(at)) for k in (CROSSING, PEAK))
    floor = _ROUNDING * size.max()
    times = _Times(number, at, np.hypot(std * np.hypot(one.std, floor), (_SHAPE + edge(at, period)) * period / 6), one.alike, curves, cycles)
    # peaks
    decrement = -sizes(centre, 1)[0]
    middle = times.peaks(centre)
    rate = times(centre, 1)[0]
    peak = LocalValues.of(fine, middle - rate * decrement / (4 * np.pi**2), rate, PEAK)
    swing = np.resize([1.0, -1.0], len(centre)) * peak.value
    side = np.resize([1.0, -1.0], len(centre))
    curves = Curves.at(pace, _SIZE, 2 * _SIZE - 1)
    for _ in range(2):
        expected = sizes.sided(centre, side)
        std = np.hypot(peak.gain * np.hypot(other.std, floor) / np.exp(expected), _SHAPE + edge(middle, rate))
        sizes = Trend.through(centre, expected + np.clip(swing / np.exp(expected) - 1, -1,1), std, other.alike, curves, _SIZES, cycles)
    return _read(number, times, sizes, record.unit)


def _crossings(fine, at, period, expected):
    slope = 2 * np.pi / period * expected
    sides = np.resize([1.0, -1.0], len(at))
    for _ in range(3):
        local = LocalValues.of(fine, at, period, CROSSING)
        ratio = np.clip(sides * local.slope / slope, 0.5, 2.0)
        at = at - np.clip(sides * local.value / (slope * ratio), -period / 8, period / 8)
    return at, local.gain / (slope * uniform_filter1d(ratio, 9))


class _Times:
    def __init__(self, number, at, std, alike, curves, cycles):
        self.first, self.cycle = at[0], (at[-1] - at[0]) / (number[-1] - number[0])
        self.trend = Trend.through(number, (at - self.first) / self.cycle - number, std / self.cycle, alike, curves, _TIMES, cycles)

    def __call__(self, number, derivative=0, side=0.0):
        value, std = self.trend(number, derivative, side)
        line = number if derivative == 0 else 1.0
        return (self.first if derivative == 0 else 0.0) + self.cycle * (value + line), self.cycle * std

    def peaks(self, centre):
        s = np.resize([1.0, -1.0], len(centre))
        before, after = (self.cycle * (self.trend.sided(centre + o * 0.25, o * -s) + centre + o * .25) for o in (-1, 1))
        return self.first + (before + after) / 2


def _noise(record, dt, number, times):
    n = number[-1]
    first = max(0.0, min(n / 2, n - 16.0), n - 64)
    whole = np.arange(np.ceil(first), n + 0.25, 0.5)
    at = times(whole)[0]
    phase = make_interp_spline(at, 2 * np.pi * whole, 3)
    part = record.between(at[0], at[-1])
    spline = HarmonicSpline.along(phase, part.t, part.signal, 2.0)
    rest = part.signal - spline(part.t)[0]
    cycle = (at[-1] - at[0]) / (whole[-1] - whole[0])
    spectrum = Spectrum.between_harmonics(*lines_between(rest, cycle / record.dt), cycle)
    lowest = 1 / (7 * cycle)
    k = record.derivative

    def heard(frequency):
        r = (frequency / lowest) ** 8
        kept = (r / (1 + r)) ** (2 * k)
        return spectrum(frequency) * record.dt / dt / (2 * np.pi * frequency) ** (2 * k) * kept * (frequency < 0.5 / record.dt)

    return heard


def _read(number, times, sizes, unit):
    middle = np.arange(len(number) // 2) + 0.5
    t = times(middle, 0, 1.0)[0]
    period, period_std = times(middle, 1)
    high, low = (np.exp(sizes(middle, 0, s)[0]) for s in (1.0, -1.0))
    rows = [sizes.rows(middle, 0, s) for s in (1.0, -1.0)]
    def _mixed(share, rows): return tuple(share * x + (1 - share) * y for x, y in zip(*rows))
    amplitude = (high + low) / 2
    share = (high / (high + low))[:, None]
    relative = sizes.of_rows(_mixed(share, rows))[1]
    places = (middle - 0.25, 1.0), (middle + 0.25, -1.0)
    top, bottom = (np.exp(sizes(m, 0, s)[0]) for m, s in places)
    share = (top / (top + bottom))[:, None]
    rows = [sizes.rows(m, 1, s) for m, s in places]
    slope, slope_std = sizes.of_rows(_mixed(share, rows))
    frequency = 2 * np.pi / period
    return Backbone(
        t=t, amplitude=amplitude, frequency=frequency, damping_ratio=-slope / np.hypot(2 * np.pi, slope),
        positive_peak=high, negative_peak=-low, amplitude_std=amplitude * relative,
        frequency_std=frequency * period_std / period,
        damping_ratio_std=slope_std * (2 * np.pi) ** 2 / np.hypot(2 * np.pi, slope) ** 3,
        unit=unit,
    )


def _half_cycles(decay):
    """Cycle numbers of all crossings of whole cycles, up and down in turn, and when about."""
    up, down = decay.crossings
    n = min(len(up) - 1, len(down))
    at = np.empty(2 * n + 1)
    at[::2], at[1::2] = decay.t[up[: n + 1]], decay.t[down[:n]]
    return np.arange(2 * n + 1) / 2, at
