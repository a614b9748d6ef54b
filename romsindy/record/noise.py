"""Noise of a record whose motion is known: its level, its colour and the lines in it.

It looks at what a smooth motion (`romsindy.record.smoothing`) leaves of a record, between the
harmonics of the vibration, where no such motion reaches. Medians of the spectrum there do not see
lines (mains hum, a second mode), which are listed beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import dct, idct

from romsindy.record.drift import drift
from romsindy.record.spectrum import Line, Spectrum, lines_between, strong_lines
from romsindy.typing import Array

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
