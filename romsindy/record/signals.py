"""What is read off uniformly sampled signals: frequency, noise, crossings, rest, steady waves."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline, make_lsq_spline
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, detrend, periodogram, resample_poly, sosfiltfilt

from romsindy.typing import Array, Indices

Mask = NDArray[np.bool_]
# Fundamental frequencies of mains and how far they stray, Hz.
MAINS, STRAY = (50.0, 60.0), 0.2


def runs(mask: Mask) -> list[slice]:
    """The stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


# Lines of a spectrum below this one hold fewer cycles.
_CYCLES_AT_LEAST = 3
# Of the power of the first half of a record: less in the second is the quiet after a decay.
_QUIET = 0.1
# Turning points without which no midline tells where a vibration rests; part of the rms of a few
# cycles from which a level matters.
_FEW, _MATTERS = 6, 0.07


def fundamental_frequency(x: Array, dt: float) -> float:
    """Frequency of the spectral peak of one channel, in Hz.

    Raises a ValueError if the signal is constant, holds fewer than three cycles, or drifts more
    than it vibrates.
    """
    if not np.ptp(x) > 0:
        raise ValueError(f"the signal is constant ({x[0]:.6g}): nothing vibrates in this record")
    loud = x
    while (found := _highest_line(loud, dt)) is None:
        # The window looks at the middle, where a decay may be over long since.
        half = len(loud) // 2
        if half < _CYCLES_AT_LEAST or loud[half:].var() >= _QUIET * loud[:half].var():
            raise ValueError(
                f"the record of {len(x)} samples holds fewer than three cycles, or drifts by"
                " more than it vibrates: record longer, remove the drift, or check the time unit"
            )
        loud = loud[:half]
    return found


def _highest_line(x: Array, dt: float) -> float | None:
    """Frequency of the highest line of a spectrum, in Hz; None if drift has the greater power."""
    frequencies, power = periodogram(detrend(x), 1 / dt, window="hann")
    drift, swing = np.split(power, [_CYCLES_AT_LEAST])
    # The line of a frequency that changes with amplitude is broad and low: drift is judged by its
    # power. White noise is no vibration; the median of its lines is ln 2 of their mean.
    if drift.sum() >= swing.sum() - len(swing) * np.median(power) / np.log(2):
        return None
    return float(frequencies[_CYCLES_AT_LEAST + np.argmax(swing)])


def moving_mean(x: Array, width: int) -> Array:
    """Mean of the ``width`` samples round each of one channel, which goes on straight at its ends.

    A reflection would turn a drift round there, and leave a kink as large as it.
    """
    margin = min(width, len(x) - 1)
    return np.asarray(uniform_filter1d(_continued(x, margin), width))[margin : margin + len(x)]


def vertex(before: Array | float, here: Array | float, after: Array | float) -> Array:
    """Where a parabola through three samples is greatest, in samples from the middle one.

    0 where it has no top. For a peak of a spectrum the logarithms are given, which fit it better.
    """
    bend = np.subtract(before, here) + np.subtract(after, here)
    top = np.subtract(before, after) / (2 * np.where(bend < 0, bend, 1.0))
    return np.where(bend < 0, top, 0.0)


def with_noise(x: Array, snr_db: float, seed: int | None) -> Array:
    """Add white noise to every channel of x, (n,) or (n, n_channels).

    The ratio ``snr_db`` is that of the rms of a channel over the whole record to that of its noise,
    in dB. Without a seed other noise is drawn every time.

    Raises a ValueError if the ratio is not finite.
    """
    if not np.isfinite(snr_db):
        raise ValueError(f"snr_db = {snr_db!r} must be a finite number of decibels")
    rms = np.sqrt(np.mean(np.square(x), axis=0))
    noise = np.random.default_rng(seed).standard_normal(np.shape(x))
    return x + 10 ** (-snr_db / 20) * rms * noise


def lowpass(x: Array, dt: float, cutoff: float, order: int = 4) -> Array:
    """Zero-phase Butterworth low-pass; the signal itself where the cut-off is beyond Nyquist.

    Of (n,) or (n, n_channels) arrays; ``cutoff`` in Hz. The order is that of one pass, which
    forward and backward double.
    """
    if cutoff >= 0.45 / dt:
        return np.array(x, float)
    sos = butter(order, cutoff, fs=1 / dt, output="sos")
    return sosfiltfilt(sos, x, axis=0, padlen=min(len(x) - 1, int(3 / (cutoff * dt))))


def upsample(x: Array, factor: int) -> Array:
    """Band-limited interpolation of (n,) or (n, n_channels) arrays to ``factor`` times the rate.

    Of the factor (n - 1) + 1 samples that are returned every ``factor``-th is a sample of x.
    """
    margin = min(len(x) - 1, 20)
    fine = resample_poly(_continued(x, margin), factor, 1, axis=0, window=("kaiser", 8.0))
    return fine[factor * margin : factor * (margin + len(x) - 1) + 1]


def downsample(x: Array, factor: int) -> Array:
    """Every ``factor``-th sample of (n,) or (n, n_channels) arrays, low-passed before."""
    if factor == 1:
        return x
    margin = min((len(x) - 1) // factor, 20)
    coarse = resample_poly(_continued(x, margin * factor), 1, factor, window=("kaiser", 8.0))
    return coarse[margin : margin + (len(x) - 1) // factor + 1]


def _continued(x: Array, margin: int) -> Array:
    """With a margin beyond its ends, where a filter would ring otherwise."""
    # Odd reflection continues value and slope.
    widths = [(margin, margin)] + [(0, 0)] * (x.ndim - 1)
    return np.pad(x, widths, mode="reflect", reflect_type="odd")


def crossings(x: Array, dt: float) -> tuple[Indices, Indices]:
    """Last samples before the up- and the down-crossings of zero, one each a cycle.

    They are found on the signal below three times its fundamental, so that noise and higher modes
    add none; the frequency may change by a factor of three along the decay.

    They come as two integer arrays: ``down[k]`` lies between ``up[k]`` and ``up[k + 1]``.

    Raises a ValueError if the record holds fewer than three cycles.
    """
    smooth = lowpass(x, dt, 3 * fundamental_frequency(x, dt))
    below = smooth < 0
    up = np.flatnonzero(below[:-1] & ~below[1:])
    down = np.flatnonzero(~below[:-1] & below[1:])
    if (times := len(up) + len(down)) < 6:
        raise ValueError(
            f"the record of {len(x) * dt:.4g} s crosses zero {times} times, so it holds fewer than"
            " three cycles: record longer, or remove the offset of the signal"
        )
    return up, down[down > up[0]]


def rest_level(x: Array, dt: float) -> float:
    """Where a decaying vibration comes to rest; 0 where it cannot be told from 0.

    The midline between the turning points, which an asymmetric vibration shifts in proportion to
    amplitude^2, is extrapolated to no amplitude. Less than 1 % of the largest amplitude, or less
    than four standard errors, counts as 0.
    """
    cycle = 1 / fundamental_frequency(x, dt)
    _, midline, swing = _midline(x, dt, cycle)
    if len(swing) < _FEW:
        return level_of_few(x, cycle / dt)
    # The later half; at the very end a half-cycle may be cut short.
    quiet = np.arange(len(swing))[len(swing) // 2 : max(len(swing) - 3, len(swing) // 2 + 3)]
    if swing[quiet].min() > 0.7 * swing.max():
        return 0.0  # a steady asymmetric vibration looks the same as an offset
    basis = np.stack([np.ones(len(quiet)), swing[quiet] ** 2 / np.max(swing) ** 2], axis=1)
    inverse = np.linalg.pinv(basis.T @ basis)
    level, slope = inverse @ (basis.T @ midline[quiet])
    misfit = midline[quiet] - basis @ [level, slope]
    error = np.sqrt(misfit @ misfit / max(len(quiet) - 2, 1) * inverse[0, 0])
    return float(level) if abs(level) > max(0.01 * swing.max(), 4 * error) else 0.0


def level_of_few(x: Array, cycle: float) -> float:
    """Level of rest of a few cycles, of so many samples each; 0 where it matters little.

    They would bend all that is slow: it is fitted beside two harmonics, of which the first fades.
    """
    turn = 2j * np.pi * np.arange(len(x)) / cycle
    slow = np.polynomial.legendre.legvander(np.linspace(-1, 1, len(x)), 2)
    waves = np.column_stack([slow * np.exp(turn)[:, None], np.exp(2 * turn)])
    table = np.column_stack([np.ones(len(x)), waves.real, waves.imag])
    level = float(np.linalg.lstsq(table, x, rcond=None)[0][0])
    return level if abs(level) > _MATTERS * float(np.std(x)) else 0.0


def _midline(x: Array, dt: float, cycle: float) -> tuple[Array, Array, Array]:
    """Times of turning points, the middle of the vibration there, and its size."""
    t = dt * np.arange(len(x))
    turning = _turning_points(t, x - _smooth_curve(t, x, t, 3 * cycle), dt)
    levels = make_interp_spline(t, x, k=5)(turning)
    # (previous + 2 this + next)/4 cancels the vibration and its linear decay.
    midline = (levels[:-2] + 2 * levels[1:-1] + levels[2:]) / 4
    swing = np.abs(levels[:-2] - 2 * levels[1:-1] + levels[2:]) / 4
    return turning[1:-1], midline, swing


def _turning_points(t: Array, q: Array, dt: float) -> Array:
    """Times of the largest deflections between the zero crossings, by parabolas."""
    bounds = np.sort(np.concatenate(crossings(q, dt)))
    largest = np.array([i + np.argmax(np.abs(q[i:j])) for i, j in itertools.pairwise(bounds)])
    largest = np.clip(largest, 1, len(q) - 2)
    way = np.sign(q[largest])
    top = vertex(*(way * q[largest + k] for k in (-1, 0, 1)))
    return t[largest] + dt * np.clip(top, -0.5, 0.5)


def _smooth_curve(t: Array, x: Array, at: Array, spacing: float) -> Array:
    """Least-squares cubic spline with knots ``spacing`` apart, constant beyond its ends."""
    n_inner = int((t[-1] - t[0]) / spacing)
    inner = np.quantile(t, np.linspace(0, 1, min(n_inner, len(t) // 4) + 2)[1:-1])
    degree = min(3, len(t) - 1)
    knots = np.concatenate([[t[0]] * (degree + 1), inner, [t[-1]] * (degree + 1)])
    return make_lsq_spline(t, x, knots, k=degree)(np.clip(at, t[0], t[-1]))


def without_hum(x: Array, dt: float) -> Array:
    """A stretch (n,) without the fundamental of the mains, where that is most of it."""
    t = dt * (np.arange(len(x)) - len(x) / 2)
    strays = np.linspace(-STRAY, STRAY, int(STRAY * len(x) * dt * 16) + 3)
    tones = (f + stray for f in MAINS for stray in strays)
    f = max(tones, key=lambda f: abs(x @ np.exp(-2j * np.pi * f * t)))
    wave = np.exp(2j * np.pi * f * t)
    # Between two of these frequencies it turns and changes a little.
    waves = np.stack([wave.real, wave.imag, t * wave.real, t * wave.imag], axis=1)
    left = x - waves @ np.linalg.lstsq(waves, x - x.mean())[0]
    return left if np.var(left) < 0.5 * np.var(x) else x
