"""Noise of a record whose motion is known: its level, its colour, the lines and the drift in it.

It looks at what a smooth motion (`romsindy.record.smoothing`) leaves of a record, between the
harmonics of the vibration, where no such motion reaches. Medians of the spectrum there do not see
lines (mains hum, a second mode), which are listed beside it.

An offset that drifts is slower than the vibration, and no mean of it: that of asymmetric stiffness
follows the amplitude, and even powers of it, of any size, take no part. What is left of the slow
part of a record, in its cosine transform, is noise that goes on at low frequencies, power that
rises towards slow frequencies (a random walk: 1/f^2), and slow lines (a temperature that swings).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.fft import dct, idct
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from romsindy.record.spectrum import (
    TOGETHER,
    Line,
    Spectrum,
    before_filter,
    lines_between,
    strong_lines,
)
from romsindy.typing import Array, Indices

_MEAN = (2, 4, 6, 8)  # powers of the amplitude
_LEAST = 9  # cosines that tell a drift from such a mean
_SLOW, _LINES = 0.4, 0.2  # fundamentals: what is slow, and up to where slow lines are drift
_POWERS = (0.0, 1.0, 2.0, 3.0, 4.0)
_SIZES = np.geomspace(1e-2, 1e10, 61)  # of the slowest cosine, over the noise
_REACH = 3  # so many times further the drift goes on as it is found where it is slow
_CHANCE = 1e-2  # drift is believed against noise without it
_AROUND, _ROUNDS = 3, 4  # cosines that a slow line shares; passes over them
_TIMES = 10  # by so much the power of a drift may exceed that of such cosines, by chance


def drift(
    slow: Array, amplitude: Array, noise: Spectrum, cycle: float, dt: float
) -> Spectrum | None:
    """Power that a drifting offset adds to the noise; None where there is no drift.

    ``slow`` (n,) is a record without the harmonics of its vibration, ``amplitude`` (n,) that of the
    vibration, ``noise`` that between the harmonics; a ``cycle`` and ``dt`` in s.
    """
    n = len(slow)
    count = int(2 * n * dt * _SLOW / cycle)
    if count < _LEAST:
        return None
    k = np.arange(_REACH * count)
    frequency = k / (2 * n * dt)
    series = (amplitude / amplitude.max())[:, None] ** np.array(_MEAN)
    # The first cosine is a constant: an offset that stays is no drift, and free here.
    y, x = (dct(z, norm="ortho", axis=0)[1:count] for z in (slow, series))
    quiet = noise(frequency)
    added = _rising(y, x, quiet, k)
    lines = _lines(y, x, quiet + added, int(count * _LINES / _SLOW))
    if not np.any(added) and not np.any(lines):
        return None
    # From half of the fundamental on, the noise between the harmonics holds the drift, too.
    added = np.where(frequency * cycle > 0.5, np.maximum(added - quiet, 0.0), added) + lines
    # What is left beside a mean says little of the slowest: they hold no more than is there.
    near = _TIMES * uniform_filter1d(y**2, _AROUND, mode="nearest")
    added[:count] = np.minimum(added[:count], np.append(near[0] * 2 ** max(_POWERS), near))
    nothing = 1e-12 * float(quiet.min())  # beyond the slow part
    beyond = frequency[-1] + frequency[1]
    return Spectrum(np.append(frequency, beyond), np.append(np.maximum(added, nothing), nothing))


def _rising(y: Array, x: Array, quiet: Array, k: Indices) -> Array:
    """Power laws of the cosine's number, as likely as each is; none if none is distinctly so."""
    # A constant is as uncertain as half a cosine would be.
    laws = quiet[0] * _SIZES[:, None, None] / np.maximum(k, 0.5) ** np.array(_POWERS)[:, None]
    slow = slice(1, len(y) + 1)
    found = np.array([_left(y, x, (quiet + several)[:, slow])[0] for several in laws])
    gain = _left(y, x, quiet[slow])[0] - found.min()
    if gain < chi2.isf(_CHANCE, 2):
        return np.zeros(len(k))
    return np.average(laws, axis=(0, 1), weights=np.exp(-0.5 * (found - found.min())))


def _lines(y: Array, x: Array, variance: Array, slowest: int) -> Array:
    """What neighbouring cosines hold beyond their variance, together, with what leaks from it."""
    k, j = np.arange(len(variance)), np.arange(1, slowest)[:, None]
    # A line between two cosines is in all others, too: see `Spectrum.leaking`.
    leak = TOGETHER * j**2 / (j**2 + (k**2 - j**2) ** 2)
    lines = np.zeros(len(variance))
    for _ in range(_ROUNDS):
        total = (variance + lines)[1 : len(y) + 1]
        _, left, spare = _left(y, x, total)
        share = uniform_filter1d(spare, _AROUND, mode="nearest")
        near = uniform_filter1d(left**2, _AROUND, mode="nearest")
        loud = near > chi2.isf(_CHANCE / len(y), _AROUND * share) / _AROUND
        if not np.any(loud[: slowest - 1]):
            break
        own = np.where(loud, total * near / share, 0.0)[: slowest - 1]
        lines = np.maximum(lines, np.max(own[:, None] * leak, axis=0))
    return lines


def _left(y: Array, x: Array, variance: Array) -> tuple[Array, Array, Array]:
    """Fit y = x b + noise, for each variance (..., n).

    Minus twice the restricted log-likelihood, what is left over the noise, and the share of it that
    the fit leaves.
    """
    weight = 1 / np.sqrt(variance)
    q, r = np.linalg.qr(x * weight[..., None])
    left = y * weight
    left = left - (q @ (q.swapaxes(-1, -2) @ left[..., None]))[..., 0]
    scales = np.abs(np.diagonal(r, axis1=-2, axis2=-1)) + 1e-300
    surprise = np.log(variance).sum(-1) + 2 * np.log(scales).sum(-1) + np.sum(left**2, axis=-1)
    return surprise, left, np.maximum(1 - np.sum(q**2, axis=-1), 1e-3)


# Where the noise is 30 dB below its mean (beyond a filter), all that is known is that it is quiet:
# whatever a wrong model leaves there must not decide.
_QUIETEST = 1e-3


@dataclass(frozen=True)
class Noise:
    """Noise of a record: its size, and what makes it white."""

    # Standard deviation of the noise without its lines and without drift, unit of the record
    std: float
    spectrum: Spectrum  # of the same, at all frequencies
    dt: float  # sampling interval, s
    floor: float  # misfit that does not matter, unit of the record; part of std
    lines: tuple[Line, ...] = ()  # strongest first
    level: float = 0.0  # rms of all that lies between the harmonics, lines included
    drift: Spectrum | None = None  # power that a drifting offset adds
    # Whether all samples weigh alike, by the level, and lines are noise. Whitening lets the
    # quietest part of the spectrum decide, which a wrong model does not survive.
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
        """From what a smooth motion leaves of a record, ``rest`` (n,), and the least ``floor``.

        ``slow`` (n,) is the mean of the smooth motion over its cycles, ``amplitude`` (n,) that of
        its fundamental; a ``cycle`` and ``dt`` in s. ``after`` (m,) is what follows the vibration,
        where that is noise alone and tells more than the rest.
        """
        alone = rest if after is None else after
        order, power = lines_between(alone, cycle / dt)
        lines = strong_lines(order, power, len(alone), cycle)
        level = float(np.sqrt(np.mean(power) + floor**2))
        spectrum = Spectrum.between_harmonics(order, power, cycle)
        spectrum = replace(spectrum, power=spectrum.power + floor**2)
        every = np.fft.rfftfreq(len(rest), dt)
        std = float(np.sqrt(np.mean(spectrum(every))))
        slowly = drift(rest + slow, amplitude, spectrum.leaking(len(rest) * dt), cycle, dt)
        return cls(std, spectrum, dt, floor, lines, level, slowly)

    @classmethod
    def white(cls, std: float, dt: float, floor: float = 0.0) -> Noise:
        """White noise of a known standard deviation."""
        power = np.full(2, std**2)
        return cls(std, Spectrum(np.array([0.0, 0.5 / dt]), power), dt, floor, level=std)

    def weighing_alike(self) -> Noise:
        """The same for fits that may be wrong: see `alike`."""
        return replace(self, std=self.level, alike=True)

    def with_lines(self) -> Noise:
        """The same for a fit without these lines: louder by them, at all frequencies alike."""
        std = float(np.linalg.norm([self.std, *(line.rms for line in self.lines)]))
        power = self.spectrum.power * (std / self.std) ** 2
        return replace(self, std=std, spectrum=replace(self.spectrum, power=power))

    def share(self, n: int) -> float:
        """Part of n samples that tells anything: what lies beyond a filter does not."""
        return 1.0 if self.alike else float(np.mean(self._power(n) / self._weighed(n)))

    @property
    def one_by_one(self) -> bool:
        """Whether samples weigh alike, and none says anything of the noise in another."""
        return self.drift is None and (self.alike or self.spectrum.white)

    def __call__(self, x: Array) -> Array:
        """Filter signals (n, ...) so that the noise in them is white with standard deviation 1."""
        if self.one_by_one:
            return x / self.std
        return idct(self.cosines(x), norm="ortho", axis=0)

    def cosines(self, x: Array) -> Array:
        """Cosines of signals (n, ...), so that the noise in them has a standard deviation of 1.

        Those of a record without memory of its ends are nearly independent for any noise (N. Ahmed,
        T. Natarajan, K. Rao, IEEE Trans. Computers C-23, 1974, 90).
        """
        waves = dct(x, norm="ortho", axis=0)
        waves /= self.of_cosines(len(x)).reshape(-1, *np.ones(x.ndim - 1, int))
        return np.asarray(waves)

    def of_cosines(self, n: int) -> Array:
        """Standard deviations by which the cosines of n samples are weighed, (n,)."""
        return np.asarray(np.sqrt(self._weighed(n)))

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
        """By what they are weighed: no less than what is quiet, or leaks from other cosines.

        Beyond a filter as much as before it.
        """
        if self.alike:
            return self._drifting(np.full(n, self.std**2))
        power = self._drifting(self._unfiltered.leaking(n * self.dt)(self._frequency(n)))
        return np.maximum(power, _QUIETEST * self.std**2)

    @cached_property
    def _unfiltered(self) -> Spectrum:
        return before_filter(self.spectrum, self.dt)

    def _drifting(self, power: Array) -> Array:
        """Power of cosines, (n,), with that of the drift."""
        return power if self.drift is None else power + self.drift(self._frequency(len(power)))

    def _frequency(self, n: int) -> Array:
        return np.arange(n) / (2 * n * self.dt)
