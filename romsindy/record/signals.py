"""Signal conditioning on plain arrays: fundamental, noise, cycles, integration, upsampling.

Arrays have time on axis 0. Nothing here knows what was measured.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline, make_lsq_spline
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, detrend, periodogram, resample_poly, sosfiltfilt, welch

from romsindy.typing import Array, Indices

# Equal samples in a row at the very extreme: fewer may be chance, or steps of an encoder.
_CLIPPED_RUN = 4


def fundamental_frequency(x: Array, dt: float) -> float:
    """Frequency of the spectral peak of one channel, in Hz.

    Parameters
    ----------
    x : (n,) array
    dt : float
        Sampling interval in s.

    Raises
    ------
    ValueError
        If the signal is constant, or holds fewer than three cycles.
    """
    if not np.ptp(x) > 0:
        raise ValueError(f"the signal is constant ({x[0]:.6g}): nothing vibrates in this record")
    frequencies, power = periodogram(detrend(x), 1 / dt, window="hann")
    line = int(np.argmax(power))
    if line < 3:
        raise ValueError(
            f"the record of {len(x) * dt:.4g} s holds fewer than three cycles, or drifts by more"
            " than it vibrates: record longer, remove the drift, or check the time unit"
        )
    return float(frequencies[line])


def noise_std(x: Array) -> float:
    """Standard deviation of white noise in one channel, from the median of its spectrum.

    Vibration fills few lines of the spectrum, white noise all of them; the median sees the noise.
    Coloured or low-passed noise is underestimated.
    """
    pieces = max(len(x) // 1024, 1)
    # Half overlapping, these are an odd number of segments. The median of a line over them is
    # distributed about ln 2 of its mean, but was divided by its expectation there, an alternating
    # harmonic sum (Allen et al., FINDCHIRP, Phys. Rev. D 85 (2012), appendix B).
    _, power = welch(x, 1.0, nperseg=len(x) // pieces, average="median")
    expected = 1 + sum(1 / (k + 1) - 1 / k for k in range(2, 2 * pieces - 1, 2))
    return float(np.sqrt(np.median(power) * expected / np.log(2) / 2))


def with_noise(x: Array, snr_db: float, seed: int | None) -> Array:
    """Add white noise to every channel.

    Parameters
    ----------
    x : (n,) or (n, n_channels) array
    snr_db : float
        Ratio of the rms of a channel over the whole record to that of its noise, in dB.
    seed : int, optional
        None draws other noise every time.

    Raises
    ------
    ValueError
        If the ratio is not finite.
    """
    if not np.isfinite(snr_db):
        raise ValueError(f"snr_db = {snr_db!r} must be a finite number of decibels")
    rms = np.sqrt(np.mean(np.square(x), axis=0))
    noise = np.random.default_rng(seed).standard_normal(np.shape(x))
    return x + 10 ** (-snr_db / 20) * rms * noise


def lowpass(x: Array, dt: float, cutoff: float, order: int = 4) -> Array:
    """Zero-phase Butterworth low-pass; the signal itself where the cut-off is beyond Nyquist.

    Parameters
    ----------
    x : (n,) or (n, n_channels) array
    dt : float
        Sampling interval in s.
    cutoff : float
        Hz.
    order : int
        Order of one pass; forward and backward double it.
    """
    if cutoff >= 0.45 / dt:
        return np.array(x, float)
    sos = butter(order, cutoff, fs=1 / dt, output="sos")
    return sosfiltfilt(sos, x, axis=0, padlen=min(len(x) - 1, int(3 / (cutoff * dt))))


def crossings(x: Array, dt: float) -> tuple[Indices, Indices]:
    """Last samples before the up- and the down-crossings of zero, one each a cycle.

    They are found on the signal below three times its fundamental, so that noise and higher modes
    add none; the frequency may change by a factor of three along the decay.

    Parameters
    ----------
    x : (n,) array
    dt : float
        Sampling interval in s.

    Returns
    -------
    up, down : integer arrays
        ``down[k]`` lies between ``up[k]`` and ``up[k + 1]``.

    Raises
    ------
    ValueError
        If the record holds fewer than three cycles.
    """
    smooth = lowpass(x, dt, 3 * fundamental_frequency(x, dt))
    below = smooth < 0
    up = np.flatnonzero(below[:-1] & ~below[1:])
    down = np.flatnonzero(~below[:-1] & below[1:])
    down = down[down > up[0]] if len(up) else down
    if len(up) < 4:
        raise ValueError(
            f"the record of {len(x) * dt:.4g} s crosses zero upwards {len(up)} times, so it holds"
            " fewer than three full cycles: record longer, or remove the offset of the signal"
        )
    return up, down[: len(up)]


def integrate(x: Array, dt: float) -> Array:
    """Integrate one channel over time and remove the drift.

    The integration constant, an offset and slow noise of the sensor leave a wandering midline.
    The midline between the turning points is drawn through the record and subtracted: at the
    ends this is far better than a high-pass filter. The cost: the mean of an asymmetric
    vibration, which a velocity cannot show, is set to zero too.

    Parameters
    ----------
    x : (n,) array
        Rate of the wanted quantity.
    dt : float
        Sampling interval in s.
    """
    t = dt * np.arange(len(x))
    q = make_interp_spline(t, x, k=5).antiderivative()
    cycle = 1 / fundamental_frequency(x, dt)
    turning, midline, _ = _midline(q(t), dt, cycle)
    return q(t) - _smooth_curve(turning, midline, t, 2 * cycle)


def rest_level(x: Array, dt: float) -> float:
    """Where a decaying vibration comes to rest; 0 where it cannot be told from 0.

    The midline between the turning points, which an asymmetric vibration shifts in proportion to
    amplitude^2, is extrapolated to no amplitude. Less than 1 % of the largest amplitude, or less
    than four standard errors, counts as 0.

    Parameters
    ----------
    x : (n,) array
        Displacement.
    dt : float
        Sampling interval in s.
    """
    _, midline, swing = _midline(x, dt, 1 / fundamental_frequency(x, dt))
    # The later half; at the very end a half-cycle may be cut short.
    quiet = np.arange(len(swing) // 2, max(len(swing) - 3, len(swing) // 2 + 3))
    if swing[quiet].min() > 0.7 * swing.max():
        return 0.0  # a steady asymmetric vibration looks the same as an offset
    basis = np.stack([np.ones(len(quiet)), swing[quiet] ** 2 / np.max(swing) ** 2], axis=1)
    inverse = np.linalg.pinv(basis.T @ basis)
    level, slope = inverse @ (basis.T @ midline[quiet])
    misfit = midline[quiet] - basis @ [level, slope]
    error = np.sqrt(misfit @ misfit / max(len(quiet) - 2, 1) * inverse[0, 0])
    return float(level) if abs(level) > max(0.01 * swing.max(), 4 * error) else 0.0


def _midline(x: Array, dt: float, cycle: float) -> tuple[Array, Array, Array]:
    """Times of turning points, the middle of the vibration there, and its size."""
    t = dt * np.arange(len(x))
    rough = x - _smooth_curve(t, x, t, 3 * cycle)
    turning = _turning_points(t, rough, dt)
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
    before, at, after = q[largest - 1], q[largest], q[largest + 1]
    bend = before - 2 * at + after
    offset = np.where(bend != 0, (before - after) / (2 * np.where(bend != 0, bend, 1.0)), 0.0)
    return t[largest] + dt * np.clip(offset, -0.5, 0.5)


def _smooth_curve(t: Array, x: Array, at: Array, spacing: float) -> Array:
    """Least-squares cubic spline with knots ``spacing`` apart, constant beyond its ends."""
    n_inner = int((t[-1] - t[0]) / spacing)
    inner = np.quantile(t, np.linspace(0, 1, min(n_inner, len(t) // 4) + 2)[1:-1])
    degree = min(3, len(t) - 1)
    knots = np.concatenate([[t[0]] * (degree + 1), inner, [t[-1]] * (degree + 1)])
    return make_lsq_spline(t, x, knots, k=degree)(np.clip(at, t[0], t[-1]))


def upsample(x: Array, factor: int) -> Array:
    """Band-limited interpolation to ``factor`` times the rate.

    Parameters
    ----------
    x : (n,) or (n, n_channels) array

    Returns
    -------
    (factor (n - 1) + 1, ...) array
        Every ``factor``-th sample is a sample of x.
    """
    # Odd reflection continues value and slope beyond the ends, which would ring otherwise.
    margin = min(len(x) - 1, 20)
    widths = [(margin, margin)] + [(0, 0)] * (x.ndim - 1)
    padded = np.pad(x, widths, mode="reflect", reflect_type="odd")
    fine = resample_poly(padded, factor, 1, axis=0, window=("kaiser", 8.0))
    return fine[factor * margin : factor * (margin + len(x) - 1) + 1]


def free_part(x: Array, dt: float) -> tuple[int, int, float]:
    """Samples [start, end) of the free decay within a record, and the level of rest.

    The start is the first turning point that comes within 10 % of the largest one: a hold before
    the release, or a blow from rest, is left out. The end is where the amplitude falls for good
    below three times the noise.

    Parameters
    ----------
    x : (n,) array
    dt : float
        Sampling interval in s.

    Raises
    ------
    ValueError
        If fewer than three cycles follow the start, or the amplitude grows.
    """
    noise = noise_std(x)
    size = np.abs(x)
    high = int(np.argmax(size >= 0.9 * size.max()))
    change = np.flatnonzero(np.signbit(x[high:]) != np.signbit(x[high]))
    stroke = size[high : high + int(change[0])] if len(change) else size[high:]
    # The last of the largest samples: where a hold at the release position ends.
    start = high + int(
        np.flatnonzero(stroke >= stroke.max() - max(1e-3 * stroke.max(), 3 * noise))[-1]
    )
    _refuse_late_start(x, start, dt)
    # The period comes from the swing alone: a hold before it would drown it in the spectrum.
    period = round(1 / (fundamental_frequency(x[start:], dt) * dt))
    rest = rest_level(x[start:], dt)
    power = uniform_filter1d(np.square(x - rest), min(period, len(x)))
    amplitude = np.sqrt(2 * np.clip(power - noise**2, 0, None))
    loud = np.flatnonzero(amplitude >= 3 * noise)
    end = int(loud[-1]) + 1 if len(loud) else 0
    # Less than a cycle is not worth a cut: so a record that was cut before stays as it is.
    start = start if start > period / 4 else 0
    end = end if len(x) - end > period else len(x)
    if end - start < 3 * period:
        raise ValueError(
            f"only {max(end - start, 0) / period:.1f} cycles after the release (at {start * dt:.4g}"
            " s of the record) stand out of the noise, fewer than three cycles: record longer, or"
            " filter the record first"
        )
    _refuse_growth(amplitude[start:end], period)
    return start, end, rest


def _refuse_late_start(x: Array, start: int, dt: float) -> None:
    """Many large strokes before the largest one, and fewer after it, are no free decay."""
    large = np.flatnonzero(np.abs(x) > 0.3 * np.abs(x).max())
    reversals = large[1:][np.diff(np.sign(x[large])) != 0]
    before = int(np.searchsorted(reversals, start))
    if before >= 6 and before > len(reversals) - before:
        raise ValueError(
            f"{before // 2} cycles come before the largest amplitude (at {start * dt:.4g} s of"
            f" the record), {(len(reversals) - before) // 2} after it: the record grows, so it is"
            " forced or not a free decay; cut it with start= and end="
        )


def _refuse_growth(amplitude: Array, period: int) -> None:
    ends = slice(period, -period) if len(amplitude) > 4 * period else slice(None)
    floor = 1e-6 * amplitude.max()  # where noise was taken off, nothing may be left
    growth = np.polyfit(
        np.linspace(0, 1, len(amplitude[ends])), np.log(np.maximum(amplitude[ends], floor)), 1
    )[0]
    if growth > 0.05:
        raise ValueError(
            f"the amplitude grows by {np.expm1(growth):.0%} over the record: it is forced or not a"
            " free decay; cut it with start= and end="
        )


def clipped(x: Array) -> NDArray[np.bool_]:
    """Samples that stick to the end of a sensor's range.

    A sensor that clips shows the very same extreme value for several samples in several cycles,
    while the turning points of a decay differ. No sample is marked unless two cycles do so.

    Parameters
    ----------
    x : (n,) array
        One channel.

    Returns
    -------
    (n,) array of bool
    """
    marked = np.zeros(len(x), bool)
    for extreme in (x.max(), x.min()):
        flat = np.abs(x - extreme) <= 1e-9 * np.ptp(x)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], flat.astype(int), [0]])))
        starts, ends = edges[::2], edges[1::2]
        runs = [(a, b) for a, b in zip(starts, ends, strict=True) if b - a >= _CLIPPED_RUN]
        # One run may be a hold before the release; later ones come after a reversal.
        if len(runs) > 1 and np.any(np.signbit(x[runs[0][1] : runs[-1][0]]) != np.signbit(extreme)):
            marked |= flat
    return marked
