"""The smooth motion behind a forced record: what a fit starts from."""

from __future__ import annotations

import numpy as np
from scipy.fft import dct, idct
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d

from romsindy.fit.collocation import Grid, Trajectory
from romsindy.record.spectrum import quiet_power
from romsindy.typing import Array

_LINES = 9  # of the spectrum over which its power is averaged
_FINER = 4  # samples of the smooth motion in the place of one


def smooth_motion(y: Array, dt: float, derivative: int, grid: Grid) -> Trajectory:
    """Displacement on the steps of a simulation, from a measured derivative of it (n,).

    What stands out of the noise passes (N. Wiener's filter); of a velocity or an acceleration, what
    stands out of the noise integrated. Ends go on by odd reflection.
    """
    n = len(y)
    # One period of the reflection about both ends, on a line through them.
    line = np.linspace(y[0], y[-1], n)
    rest = y - line
    wave = np.concatenate([rest, -rest[-2:0:-1]])
    lines = np.fft.rfft(wave)
    power = np.abs(lines) ** 2
    noise = quiet_power(power)
    mean = uniform_filter1d(power, _LINES, mode="nearest")
    lines *= np.clip(1 - noise / np.maximum(mean, 1e-300), 0.0, 1.0)
    fine: Array = np.fft.irfft(lines, _FINER * len(wave))[: _FINER * (n - 1) + 1] * _FINER
    t = dt / _FINER * np.arange(len(fine))
    fine += np.interp(t, dt * np.arange(n), line)
    for times in range(derivative, 0, -1):
        lowest = _lowest(y, dt, times)
        fine = _without_slow(
            make_interp_spline(t, fine - fine.mean(), k=5).antiderivative()(t), t, lowest
        )
    spline = make_interp_spline(t, fine, k=5)
    at = np.clip(grid.start + grid.step * np.arange(grid.n_steps + 1), 0.0, t[-1])
    inside = np.clip(grid.node_times(0, grid.n_steps), 0.0, t[-1])
    return Trajectory(
        grid, spline(at)[:, None], spline(at, 1)[:, None], spline(inside, 2)[..., None]
    )


def _without_slow(x: Array, t: Array, lowest: float) -> Array:
    """A signal without a parabola, and without cosines slower than a frequency (Hz)."""
    place = np.linspace(-1, 1, len(x))
    x = x - np.polynomial.Legendre.fit(place, x, 2)(place)
    waves = dct(x, norm="ortho")
    waves[: int(np.ceil(2 * lowest * t[-1]))] = 0.0
    return idct(waves, norm="ortho")


def _lowest(y: Array, dt: float, times: int) -> float:
    """Frequency, Hz, below which integrals of a signal are left out: there is more noise in them.

    Noise above it, and signal below, together are least.
    """
    frequency = np.fft.rfftfreq(len(y), dt)[1:]
    power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(len(y)))) ** 2
    noise = quiet_power(power)
    mean = uniform_filter1d(power, _LINES, mode="nearest")[1:]
    weight = frequency ** (-2.0 * times)
    lost = np.cumsum(np.maximum(mean - noise, 0.0) * weight)
    heard = np.cumsum((noise * weight)[::-1])[::-1]
    return float(frequency[np.argmin(lost + heard)])
