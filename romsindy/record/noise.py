"""Noise of a record, without any model of the vibration.

A free decay is periodic over a few cycles, with amplitudes and phase that drift slowly. In windows
of a few cycles it is fitted by harmonics of the local frequency whose complex amplitudes are
polynomials in time; what no such fit reaches is noise. The same windows serve to ask whether a
model leaves anything that repeats with the vibration.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legval, legvander
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter, welch

from romsindy.record.signals import crossings
from romsindy.typing import Array, Indices

_DEGREE = 4  # of the polynomials in time: phase may bend, amplitude may fall
# Longer windows and fewer harmonics leave more of the noise to see, shorter ones follow faster
# changes, more harmonics strong nonlinearity: the quietest wins.
_CYCLES = (3, 6, 12, 24)
_HARMONICS = (5, 12)
_MAX_ORDER = 30
# Power of a line over the median of its surroundings; averaged noise stays far below.
_LINE = 20.0


@dataclass(frozen=True)
class Window:
    """A few cycles of a record and the harmonics that fit them.

    Attributes
    ----------
    samples : slice
        Where in the record.
    phase : (n,) array
        Of the fundamental, rad; 0 in the middle.
    smooth, rest : (n,) arrays
        Fitted part of the record, and what is left: noise.
    n_columns : int
        Number of functions in the fit.
    """

    samples: slice
    phase: Array
    smooth: Array
    rest: Array
    n_columns: int


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
        windows = tuple(fit_windows(x, up, cycles, harmonics))
        freedom = sum(len(w.rest) - w.n_columns for w in windows)
        if sum(len(w.rest) for w in windows) == len(x):
            power = sum(float(w.rest @ w.rest) for w in windows) / freedom
            candidates.append(Noise(float(np.sqrt(power)), windows))
    if not candidates:
        raise ValueError(
            f"{len(x)} samples hold too few cycles, or too few samples a cycle, to tell noise from"
            " vibration: record longer, or sample faster"
        )
    return min(candidates, key=lambda noise: noise.std)


@dataclass(frozen=True)
class Line:
    """Another vibration in a record: frequency in Hz, rms in the unit of the record."""

    frequency: float
    rms: float


def find_line(noise: Noise, dt: float) -> Line | None:
    """The strongest line in what the harmonics leave, if it stands out as noise never does.

    Parameters
    ----------
    noise : Noise
    dt : float
        Sampling interval, s.
    """
    rest = np.concatenate([w.rest for w in noise.windows])
    frequencies, power = welch(rest, 1 / dt, nperseg=min(len(rest), 2048))
    # What lies close to a harmonic is the vibration itself, badly followed.
    cycles = sum(float(w.phase[-1] - w.phase[0]) for w in noise.windows) / (2 * np.pi)
    order = frequencies * len(rest) * dt / cycles
    own = (np.abs(order - np.round(order)) < 0.25) & (order < max(_HARMONICS) + 0.5)
    peak = int(np.argmax(np.where(own, 0.0, power)))
    # The floor near the peak, so that coloured noise is no line.
    near = power[max(peak - 40, 0) : peak + 41]
    if power[peak] < _LINE * np.median(near):
        return None
    around = slice(max(peak - 3, 0), peak + 4)
    rms = np.sqrt(np.sum(power[around]) * (frequencies[1] - frequencies[0]))
    return Line(float(frequencies[peak]), float(rms))


def fit_windows(x: Array, up: Indices, cycles: int, harmonics: int) -> Iterator[Window]:
    """Fit a record window by window; it ends where too few samples are left for the fit.

    Parameters
    ----------
    x : (n,) array
    up : integer array
        One sample in each cycle at the same phase, such as `signals.crossings` finds.
    cycles, harmonics : int
        Cycles in a window, and the highest harmonic (fewer where sampling is coarse).
    """
    bounds = [0, *up[cycles::cycles], len(x)]
    if len(bounds) > 2 and bounds[-1] - bounds[-2] < 0.5 * (bounds[-2] - bounds[-3]):
        del bounds[-2]  # a short rest joins the last window
    for start, end in itertools.pairwise(bounds):
        window = _fit_window(x, slice(start, end), up, harmonics)
        if window is None:
            return
        yield window


def _fit_window(x: Array, samples: slice, up: Indices, most: int) -> Window | None:
    y = x[samples]
    tau = np.linspace(-1, 1, len(y))
    phase = rough_phase(tau, samples, up)
    per_cycle = 2 * np.pi * len(y) / (phase[-1] - phase[0])
    harmonics = min(most, int(0.4 * per_cycle))
    if harmonics < 1 or len(y) < 2 * (2 * harmonics + 1) * (_DEGREE + 1):
        return None
    for _ in range(3):  # the phase that makes the amplitude of the fundamental real
        coefficients = _least_squares(drifting_harmonics(phase, (0, 1), _DEGREE), y)
        _, even, odd = coefficients.reshape(3, -1)
        phase = phase + np.unwrap(np.angle(legval(tau, even - 1j * odd)))
    basis = drifting_harmonics(phase, range(harmonics + 1), _DEGREE)
    smooth = basis @ _least_squares(basis, y)
    return Window(samples, phase, smooth, y - smooth, basis.shape[1])


def _least_squares(basis: Array, y: Array) -> Array:
    # Normal equations are fast; a second pass on the residual gives the digits back.
    normal = basis.T @ basis
    first = np.linalg.solve(normal, basis.T @ y)
    return first + np.linalg.solve(normal, basis.T @ (y - basis @ first))


def rough_phase(tau: Array, samples: slice, up: Indices) -> Array:
    """Phase of the fundamental from a parabola through the crossings in and next to a window.

    Parameters
    ----------
    tau : (n,) array
        Times in the window, from -1 to 1.
    samples : slice
        The window.
    up : integer array
        Samples at the same phase of every cycle of the record.

    Returns
    -------
    (n,) array
        rad, 0 in the middle.
    """
    near = np.flatnonzero((up >= samples.start) & (up <= samples.stop))
    first = int(np.clip(near[0] - 1 if len(near) else 0, 0, len(up) - 4))
    chosen = slice(first, max(first + 4, int(near[-1]) + 2 if len(near) else 0))
    place = (2 * up[chosen] - samples.start - samples.stop) / (samples.stop - samples.start)
    cycles = np.polyval(np.polyfit(place, np.arange(len(place)), 2), tau)
    return 2 * np.pi * (cycles - cycles[len(cycles) // 2])


def drifting_harmonics(phase: Array, orders: Iterable[float], degree: int) -> Array:
    """cos and sin of multiples of a phase, times Legendre polynomials in time.

    Parameters
    ----------
    phase : (n,) array
        rad, at uniform times.
    orders : numbers
        Multiples of the phase; 0 gives one function, all others two.
    degree : int
        Of the polynomials.

    Returns
    -------
    (n, m) array
        (degree + 1) columns for each function.
    """
    waves = []
    for order in orders:
        waves += [np.cos(order * phase), np.sin(order * phase)] if order else [np.ones_like(phase)]
    drift = legvander(np.linspace(-1, 1, len(phase)), degree)
    return (np.stack(waves, axis=1)[:, :, None] * drift[:, None, :]).reshape(len(phase), -1)


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
