"""Frequency and damping against amplitude, read off a free decay cycle by cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from romsindy.record.decay import Decay
from romsindy.typing import Array

# Half-width of the local fits in cycles, and their degrees: a sine is a cubic (quartic) to 2e-4
# (1e-5) over this arc round its zero (its peak), and what is left is even (odd) there and harmless.
_ARC = 1 / 8
_CROSSING_DEGREE, _PEAK_DEGREE = 3, 4
# Degrees in the cycle number: of crossing times, and of logarithms of peaks, which are straighter.
_TIME_DEGREE, _SIZE_DEGREE = 4, 2
# Errors of neighbours are correlated by this much at most.
_MOST_ALIKE = 0.8
# A part of the largest amplitude that stands for none at all.
_NO_PEAK = 1e-12
# Squared amplitudes must differ by this part of the least: further than a hundred times what they
# span, nothing but noise is extrapolated.
_LEVER = 0.01
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


def extract_backbone(decay: Decay, *, cycles: int = 12) -> Backbone:
    """Read amplitude, frequency and damping ratio of every cycle off a decay.

    Zero crossings and peaks are the roots and extremes of polynomials fitted to the samples an
    eighth of a cycle to either side, which averages the noise. Crossing times and peaks are then
    followed along the decay by polynomials in the cycle number over the neighbouring cycles, and
    evaluated at the middle of each cycle: the maximum of a cycle comes a quarter period early.
    Records of few samples a cycle are interpolated first.

    Parameters
    ----------
    decay : Decay
        One channel. Its free part is found; what lies below the noise is left out.
    cycles : int
        Number of neighbouring cycles behind each value, at least 2: more of them average more
        noise, fewer follow faster changes.

    Returns
    -------
    Backbone

    Raises
    ------
    ValueError
        If the decay has several channels, fewer than three cycles, or grows.

    Notes
    -----
    Measured (``benchmarks/identification.py``) on an oscillator of 1 % decrement a cycle:
    frequency error at most 3e-5 without noise, 2e-4 in the median at 35 dB.
    """
    if cycles < 2:
        raise ValueError(f"cycles = {cycles!r} must be at least 2")
    record = decay.single().free()
    fine = record.upsampled()
    repeats = (len(fine.t) - 1) / (len(record.t) - 1)  # interpolated samples are not independent
    up, down = fine.crossings
    period = np.gradient(fine.t[up])
    rise = _roots(fine, fine.t[up], period, repeats)
    fall = _roots(fine, fine.t[down], period[: len(down)], repeats)
    n = min(len(rise.at) - 1, len(fall.at))
    rise, fall = rise.first(n + 1), fall.first(n)
    top = _peaks(fine, rise.at[:n], fall.at, repeats)
    bottom = _peaks(fine, fall.at, rise.at[1:], repeats)
    return _follow(rise, fall, top, bottom, cycles, record.unit)


_Followed = tuple[Array, Array, float]  # values, their standard errors, and the excess of these


@dataclass(frozen=True)
class _Points:
    """Events of a decay: when, how high, and the standard error of the one that matters."""

    at: Array
    value: Array
    std: Array

    def first(self, n: int) -> _Points:
        return _Points(self.at[:n], self.value[:n], self.std[:n])


def _roots(decay: Decay, guess: Array, period: Array, repeats: float) -> _Points:
    at = guess
    # The guess is off by up to a sample and the filter's distortion: centre the fit and repeat.
    for _ in range(2):
        fits = [
            _LocalFit.of(decay, t, _ARC * T, _CROSSING_DEGREE)
            for t, T in zip(at, period, strict=True)
        ]
        at = np.array([fit.root(fit.coefficients) for fit in fits])
    slopes = np.array([fit.slope(t) for fit, t in zip(fits, at, strict=True)])
    errors = np.array([fit.std(t) for fit, t in zip(fits, at, strict=True)])
    # No crossing is off by more than its cycle, however flat the noise makes a fit.
    std = errors / np.maximum(np.abs(slopes), errors / period)
    return _Points(at, np.zeros_like(at), std * np.sqrt(repeats))


def _peaks(decay: Decay, start: Array, end: Array, repeats: float) -> _Points:
    fits = [
        _LocalFit.of(decay, (a + b) / 2, 2 * _ARC * (b - a), _PEAK_DEGREE)
        for a, b in zip(start, end, strict=True)
    ]
    at = np.array([fit.root(chebyshev.chebder(fit.coefficients)) for fit in fits])
    value = np.array([fit(t) for fit, t in zip(fits, at, strict=True)])
    std = np.array([fit.std(t) for fit, t in zip(fits, at, strict=True)])
    return _Points(at, value, std * np.sqrt(repeats))


@dataclass(frozen=True)
class _LocalFit:
    """Least-squares polynomial through the samples round one instant."""

    centre: float
    half_width: float
    coefficients: Array
    covariance: Array

    @classmethod
    def of(cls, decay: Decay, centre: float, half_width: float, degree: int) -> _LocalFit:
        half_width = max(half_width, (degree + 2) / 2 * decay.dt)
        low, high = np.searchsorted(decay.t, [centre - half_width, centre + half_width])
        low = max(0, min(low, len(decay.t) - degree - 2))
        high = max(high, low + degree + 2)
        x = (decay.t[low:high] - centre) / half_width
        basis = chebyshev.chebvander(x, degree)
        inverse = np.linalg.inv(basis.T @ basis)
        coefficients = inverse @ (basis.T @ decay.q[low:high])
        misfit = decay.q[low:high] - basis @ coefficients
        variance = misfit @ misfit / max(len(x) - degree - 1, 1)
        return cls(centre, half_width, coefficients, inverse * variance)

    def __call__(self, t: float) -> float:
        return float(chebyshev.chebval((t - self.centre) / self.half_width, self.coefficients))

    def slope(self, t: float) -> float:
        derivative = chebyshev.chebder(self.coefficients)
        x = (t - self.centre) / self.half_width
        return float(chebyshev.chebval(x, derivative)) / self.half_width

    def root(self, coefficients: Array) -> float:
        """Real root nearest to the centre, within the fit; the centre where there is none."""
        roots = chebyshev.chebroots(coefficients)
        real = roots.real[np.abs(roots.imag) < 1e-9]
        x = real[np.argmin(np.abs(real))] if len(real) else 0.0
        return self.centre + self.half_width * float(np.clip(x, -1, 1))

    def std(self, t: float) -> float:
        """Standard error of the fit at t."""
        x = (t - self.centre) / self.half_width
        row = chebyshev.chebvander(x, len(self.coefficients) - 1)[0]
        return float(np.sqrt(row @ self.covariance @ row))


def _follow(
    rise: _Points, fall: _Points, top: _Points, bottom: _Points, cycles: int, unit: str | None
) -> Backbone:
    n = len(fall.at)
    middle = np.arange(n) + 0.5  # in cycles; up-crossings are at 0, 1, ..., down-crossings at 1/2
    value, slope = 0, 1
    t = _along(rise.at, rise.std, 0.0, middle, cycles, value, _TIME_DEGREE)[0]
    rising = _along(rise.at, rise.std, 0.0, middle, cycles, slope, _TIME_DEGREE)
    falling = _along(fall.at, fall.std, 0.5, middle, cycles, slope, _TIME_DEGREE)
    period, period_std = _mean(rising, falling)
    high = _peaks_along(top.value, top.std, 0.25, middle, cycles)
    low = _peaks_along(-bottom.value, bottom.std, 0.75, middle, cycles)
    amplitude, amplitude_std = _mean(high, low)
    swing = top.value - bottom.value
    swing = np.maximum(swing, _NO_PEAK * swing.max())
    swing_std = np.hypot(top.std, bottom.std) / swing
    log_decay = _along(np.log(swing), swing_std, 0.5, middle, cycles, slope, _SIZE_DEGREE)
    decrement, decrement_std = -log_decay[0], log_decay[1]
    frequency = 2 * np.pi / period
    return Backbone(
        t=t,
        amplitude=amplitude,
        frequency=frequency,
        damping_ratio=decrement / np.hypot(2 * np.pi, decrement),
        positive_peak=high[0],
        negative_peak=-low[0],
        amplitude_std=amplitude_std,
        frequency_std=frequency * period_std / period,
        damping_ratio_std=decrement_std / (2 * np.pi),
        unit=unit,
    )


def _peaks_along(size: Array, std: Array, first: float, at: Array, cycles: int) -> _Followed:
    """Sizes of peaks followed by their logarithm, which stays positive however fast they decay."""
    size = np.maximum(size, np.maximum(std, _NO_PEAK * size.max()))
    log_size, log_std, excess = _along(np.log(size), std / size, first, at, cycles, 0, _SIZE_DEGREE)
    return np.exp(log_size), np.exp(log_size) * log_std, excess


def _mean(one: _Followed, other: _Followed) -> tuple[Array, Array]:
    """Mean of two values half a cycle apart, and its standard error.

    Errors that the samples round an event show are independent. What exceeds them is noise near
    the frequency of the vibration, and is the same half a cycle later.
    """
    common = 1 - 1 / (one[2] * other[2])
    variance = one[1] ** 2 + other[1] ** 2 + 2 * common * one[1] * other[1]
    return (one[0] + other[0]) / 2, np.sqrt(variance) / 2


def _along(
    x: Array, std: Array, first: float, at: Array, cycles: int, derivative: int, degree: int
) -> _Followed:
    """Value or slope of x against the cycle number, by local polynomials, and its standard error.

    Last comes how much larger the error is than that by the noise round single events.

    ``first`` is the cycle number of x[0].
    """
    number = first + np.arange(len(x))
    width = min(cycles, len(x))
    degree = min(degree, width - 1, max(1, width - 2))
    result, misfits = np.empty((2, len(at))), np.empty((len(at), width))
    for i, centre in enumerate(at):
        low = int(np.clip(np.round(centre - first - (width - 1) / 2), 0, len(x) - width))
        inside = slice(low, low + width)
        powers = np.vander((number[inside] - centre) / width, degree + 1, increasing=True)
        inverse = np.linalg.pinv(powers)
        weights = inverse[derivative] / width**derivative
        result[:, i] = weights @ x[inside], np.sqrt(np.sum((weights * std[inside]) ** 2))
        misfit = x[inside] - powers @ (inverse @ x[inside])
        misfits[i] = misfit / np.maximum(std[inside], np.finfo(float).tiny)
    spare = width - degree - 1
    if spare <= 0:
        return result[0], result[1], 1.0
    excess = _excess(np.mean(misfits**2, axis=1) * width / spare, len(x) / width * spare)
    if excess > 1:
        excess *= _persistence(misfits, np.eye(width) - powers @ inverse)
    return result[0], excess * result[1], excess


def _persistence(misfits: Array, left: Array) -> float:
    """How much larger a mean of errors is because neighbours err alike; 1 at least.

    That of an autoregression of the first order. Its coefficient is what neighbouring misfits
    (n, width) have in common beyond what polynomials leave of independent errors: ``left`` maps
    errors to misfits.
    """
    own, next_one = np.sum(misfits**2), np.sum(misfits[:, 1:] * misfits[:, :-1])
    expected = np.trace(left, 1) / np.trace(left)
    alike = float(np.clip(next_one / own - expected, 0.0, _MOST_ALIKE))
    return float(np.sqrt((1 + alike) / (1 - alike)))


def _excess(variance: Array, freedom: float) -> float:
    """How much larger than expected events scatter about the local polynomials; 1 at least.

    The expected standard errors know the noise within a fraction of a cycle alone. That of
    coloured noise is larger from one cycle to the next. ``variance`` of the windows is relative,
    with so many degrees of freedom in all.
    """
    pooled = float(np.median(variance))
    chance = 4 * np.sqrt(2 / freedom)
    return float(np.sqrt(pooled)) if pooled > 1 + chance else 1.0
