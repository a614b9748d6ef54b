"""What the filter of a measuring chain does to the harmonics of a vibration.

Where noise ends at an edge, a filter took what lies beyond, and the vibration went through it, too.
A delay is no matter to a free decay; but a filter delays its harmonics differently, the more so the
nearer they are to the edge. How much follows from the noise, if it was white before the filter and
the filter is one of minimum phase (Butterworth, Bessel, Chebyshev): then its phase is the Hilbert
transform of the logarithm of its gain (A. Oppenheim, R. Schafer, Discrete-Time Signal Processing,
3rd ed., 2010, ch. 12).
"""

from __future__ import annotations

import numpy as np

from romsindy.record.spectrum import Spectrum
from romsindy.typing import Array

# Power of the quietest part over that of the loudest where there is a filter, and what is lost in
# an octave: more than red noise loses, which falls with the square of the frequency.
_EDGE, _OCTAVE = 1e-3, 8.0
_LINES = 4096
# The noise says little of how deep a stop band is, and of noise that was not white nothing.
_DOUBT = 3.0
_RINGS = 0.01  # of its largest response


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
