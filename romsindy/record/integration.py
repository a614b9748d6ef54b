"""Displacement from a measured velocity or acceleration of a free decay."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d

from romsindy.record.signals import lowpass
from romsindy.record.smoothing import HarmonicSpline
from romsindy.typing import Array

# Knots of the midline, in cycles: it follows slow noise and leaves the vibration alone. Knots
# farther apart tell how far it can be trusted: what both disagree about is of the
# size of the true error.
MIDLINE, _CHECK = 3.5, 5.0
# Of the amplitude: an end where the midline is known no better is left out, half a cycle at most;
# farther inside it is as good as anywhere.
_SPOILT, _LONGEST = 0.01, 0.5


def displacement(x: Array, dt: float, frequency: float, times: int) -> tuple[Array, slice]:
    """Displacement from one channel (n,), and the samples that the removal of drift leaves sound.

    Arguments as those of `integrate`.
    """
    q = integrate(x, dt, frequency, times)
    check = integrate(x, dt, frequency, times, _CHECK)
    cycle = max(round(1 / (frequency * dt)), 1)
    amplitude = np.sqrt(2 * uniform_filter1d(q**2, cycle))
    spoilt = np.abs(q - check) > _SPOILT * amplitude
    longest = round(_LONGEST * cycle)
    first = np.flatnonzero(spoilt[:longest])
    last = np.flatnonzero(spoilt[::-1][:longest])
    return q, slice(first[-1] + 1 if len(first) else 0, len(q) - (last[-1] + 1 if len(last) else 0))


def integrate(
    x: Array, dt: float, frequency: float, times: int = 1, cycles: float = MIDLINE
) -> Array:
    """Integrate one channel (n,) of a free decay over time and remove the drift.

    The integration constant, an offset and slow noise of the sensor leave a wandering midline. It
    is the slow part of a sum of harmonics whose amplitudes drift (`HarmonicSpline`), fitted to the
    integral and subtracted: at the ends this is far better than a high-pass filter. The cost: the
    mean of an asymmetric vibration, which a velocity cannot show, is set to zero too.

    Parameters
    ----------
    x : (n,) array
        Sampled every ``dt`` seconds.
    dt : float
        s.
    frequency : float
        Of the slowest vibration, Hz.
    times : int
        1 for a velocity, 2 for an acceleration.
    cycles : float
        Between the knots of the midline.

    Raises
    ------
    ValueError
        If the record holds fewer than three cycles.
    """
    t = dt * np.arange(len(x))
    cycle = max(round(1 / (frequency * dt)), 2)
    for _ in range(times):
        x = make_interp_spline(t, x - x.mean(), k=5).antiderivative()(t)
        slow = lowpass(x, dt, 3 * frequency)
        for _ in range(2):
            slow = slow - uniform_filter1d(slow, cycle, mode="mirror")
        x = x - HarmonicSpline.fit(t, x, cycles, slow).midline(t)
    return x
