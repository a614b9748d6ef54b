"""The smooth motion behind a forced record: what a fit starts from."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d

from romsindy.fit.collocation import Grid, Trajectory
from romsindy.typing import Array

_LINES = 9  # of the spectrum over which its power is averaged
_FINER = 4  # samples of the smooth motion in the place of one
_QUIET_PART = 20  # of the spectrum: its quietest such part is taken for noise


def quiet_power(power: Array) -> float:
    """Mean power of a line in the quietest part of a spectrum, (n,)."""
    return float(min(np.mean(band) for band in np.array_split(power[1:], _QUIET_PART)))


def quiet_std(y: Array) -> float:
    """Standard deviation of white noise as strong as the quietest part of a signal's spectrum."""
    n = len(y)
    window = np.hanning(n)
    power = np.abs(np.fft.rfft((y - y.mean()) * window)) ** 2
    return float(np.sqrt(quiet_power(power) / np.sum(window**2)))


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
    omega = 2 * np.pi * np.fft.rfftfreq(len(wave), dt)
    if derivative:
        lines = lines * _integral(omega, mean, noise, derivative)
        line = np.zeros(n)
    fine = np.fft.irfft(lines, _FINER * len(wave)) * _FINER
    t = dt / _FINER * np.arange(_FINER * (n - 1) + 1)
    ends = line if derivative else np.interp(t, dt * np.arange(n), line)
    spline = make_interp_spline(t, fine[: len(t)] + (0.0 if derivative else ends), k=5)
    at = grid.start + grid.step * np.arange(grid.n_steps + 1)
    inside = np.clip(grid.node_times(0, grid.n_steps), 0.0, t[-1])
    at = np.clip(at, 0.0, t[-1])
    return Trajectory(
        grid, spline(at)[:, None], spline(at, 1)[:, None], spline(inside, 2)[..., None]
    )


def _integral(omega: Array, power: Array, noise: float, times: int) -> Array:
    """Division of the lines of a spectrum by i omega, without those where noise would prevail."""
    heard = power > 3 * noise
    first = omega[np.argmax(heard)] if np.any(heard) else omega[-1]
    safe = np.maximum(omega, first / 2 + 1e-300)
    return np.where(omega >= first / 2, (1j * safe) ** -times, 0.0)
