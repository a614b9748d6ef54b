"""Noise of a record, without any model of the vibration.

A free decay is periodic over a few cycles, with amplitudes and phase that drift slowly. In windows
of a few cycles it is fitted by harmonics of the local frequency whose complex amplitudes are
polynomials in time; what no such fit reaches is noise. The same windows serve to ask whether a
model leaves anything that repeats with the vibration.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legval, legvander
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from romsindy.signals import crossings
from romsindy.typing import Array, Indices

_DEGREE = 4  # of the polynomials in time: phase may bend, amplitude may fall
# Longer windows and fewer harmonics leave more of the noise to see, shorter ones follow faster
# changes, more harmonics strong nonlinearity: the quietest wins.
_CYCLES = (3, 6, 12, 24)
_HARMONICS = (5, 12)
_MAX_ORDER = 30


@dataclass(frozen=True)
class Window:
    """A few cycles of a record and the harmonics that fit them.

    Attributes
    ----------
    samples : slice
        Where in the record.
    basis : (n, m) array
        Orthonormal columns that span harmonics with slowly drifting amplitudes.
    frequency : float
        Local angular frequency, rad/s.
    smooth, rest : (n,) arrays
        Fitted part of the record, and what is left: noise.
    """

    samples: slice
    basis: Array
    frequency: float
    smooth: Array
    rest: Array


@dataclass(frozen=True)
class Noise:
    """Noise of one record.

    Attributes
    ----------
    std : float
        Standard deviation, unit of the record.
    windows : tuple of Window
    """

    std: float
    windows: tuple[Window, ...]


def estimate_noise(x: Array, dt: float) -> Noise:
    """Standard deviation of what does not repeat from cycle to cycle.

    Parameters
    ----------
    x : (n,) array
        One free decay.
    dt : float
        Sampling interval, s.

    Raises
    ------
    ValueError
        If the record is shorter than three cycles, or has fewer than six samples a cycle.
    """
    candidates = []
    up = crossings(x, dt)[0]
    for cycles, harmonics in itertools.product(_CYCLES, _HARMONICS):
        windows = tuple(_windows(x, dt, up, cycles, harmonics))
        freedom = sum(len(w.rest) - w.basis.shape[1] for w in windows)
        if windows and freedom > 0:
            power = sum(float(w.rest @ w.rest) for w in windows) / freedom
            candidates.append(Noise(float(np.sqrt(power)), windows))
    if not candidates:
        raise ValueError(
            f"{len(x)} samples hold too few cycles, or too few samples a cycle, to tell noise from"
            " vibration: record longer, or sample faster"
        )
    return min(candidates, key=lambda noise: noise.std)


def _windows(x: Array, dt: float, up: Indices, cycles: int, harmonics: int) -> Iterator[Window]:
    bounds = [0, *up[cycles::cycles], len(x)]
    if len(bounds) > 2 and bounds[-1] - bounds[-2] < 0.5 * (bounds[-2] - bounds[-3]):
        del bounds[-2]  # a short rest joins the last window
    for start, end in itertools.pairwise(bounds):
        window = _fit_window(x, dt, slice(start, end), up, harmonics)
        if window is None:
            return
        yield window


def _fit_window(x: Array, dt: float, samples: slice, up: Indices, most: int) -> Window | None:
    y = x[samples]
    tau = np.linspace(-1, 1, len(y))
    phase = _rough_phase(tau, samples, up)
    per_cycle = 2 * np.pi * len(y) / (phase[-1] - phase[0])
    harmonics = min(most, int(0.4 * per_cycle))
    if harmonics < 1 or len(y) < 2 * (2 * harmonics + 1) * (_DEGREE + 1):
        return None
    for _ in range(3):  # the phase that makes the amplitude of the fundamental real
        basis = _basis(tau, phase, 1)
        coefficients = np.linalg.lstsq(basis, y, rcond=None)[0].reshape(-1, _DEGREE + 1)
        carrier = legval(tau, coefficients[1] - 1j * coefficients[2])
        phase = phase + np.unwrap(np.angle(carrier))
    q, _ = np.linalg.qr(_basis(tau, phase, harmonics))
    smooth = q @ (q.T @ y)
    frequency = (phase[-1] - phase[0]) / ((len(y) - 1) * dt)
    return Window(samples, q, float(frequency), smooth, y - smooth)


def _rough_phase(tau: Array, samples: slice, up: Indices) -> Array:
    """A parabola through the crossings in and next to a window; the middle counts as 0."""
    near = np.flatnonzero((up >= samples.start) & (up <= samples.stop))
    first = int(np.clip(near[0] - 1 if len(near) else 0, 0, len(up) - 4))
    chosen = slice(first, max(first + 4, int(near[-1]) + 2 if len(near) else 0))
    place = (2 * up[chosen] - samples.start - samples.stop) / (samples.stop - samples.start)
    cycles = np.polyval(np.polyfit(place, np.arange(len(place)), 2), tau)
    return 2 * np.pi * (cycles - cycles[len(cycles) // 2])


def _basis(tau: Array, phase: Array, harmonics: int) -> Array:
    """1, cos, sin, cos 2, ... of the phase, times Legendre polynomials in tau."""
    angle = phase[:, None] * np.arange(1, harmonics + 1)
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(len(tau), -1)
    waves = np.column_stack([np.ones(len(tau)), waves])
    return (waves[:, :, None] * legvander(tau, _DEGREE)[:, None, :]).reshape(len(tau), -1)


def autoregression(x: Array) -> Array:
    """Coefficients [1, a_1, ..., a_p] that whiten a signal, p by the Bayesian criterion.

    Yule-Walker equations; p = 0, no filter at all, where the signal is white already.

    Parameters
    ----------
    x : (n,) array
    """
    n = len(x)
    highest = min(_MAX_ORDER, n // 10)
    lags = np.array([x[: n - k] @ x[k:] / n for k in range(highest + 1)])
    if not lags[0] > 0:
        return np.ones(1)
    best, choice = n * np.log(lags[0]), np.ones(1)
    for p in range(1, highest + 1):
        a = solve_toeplitz(lags[:p], -lags[1 : p + 1])
        power = lags[0] + a @ lags[1 : p + 1]
        criterion = n * np.log(power) + p * np.log(n) if power > 0 else np.inf
        if criterion < best:
            best, choice = criterion, np.concatenate([[1.0], a])
    return choice


def coloured_product(a: Array, x: Array, y: Array) -> Array:
    """x' S y for the covariance matrix S of an autoregression driven by noise of variance 1.

    Parameters
    ----------
    a : (p + 1,) array
        As `autoregression` returns it.
    x, y : (n, m), (n, k) arrays
    """
    # S = H H' with H the impulse response 1/A: filtering backwards in time applies H'.
    left = lfilter([1.0], a, x[::-1], axis=0)
    right = lfilter([1.0], a, y[::-1], axis=0)
    return left.T @ right
