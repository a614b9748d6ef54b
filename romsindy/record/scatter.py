"""What the noise of a record does to the crossings and peaks that are read off it.

The noise of what was measured is known between the harmonics of the vibration. Integration and the
removal of drift colour it, and what is coloured errs alike from one half-cycle to the next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import make_interp_spline
from scipy.signal.windows import parzen

from romsindy.record.decay import Decay
from romsindy.record.events import ARC, faded, sides
from romsindy.record.smoothing import MIDLINE, HarmonicSpline
from romsindy.record.spectrum import Spectrum, lines_between
from romsindy.typing import Array

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
    """What noise does to local values: standard deviation over their gain, and correlations.

    Attributes
    ----------
    std : float
        Unit of q.
    alike : (k,) array
        Correlation with the value 0, 1, ... half-cycles later, relative to its own side.
    """

    std: float
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
