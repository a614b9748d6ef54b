"""Samples and their times as they are given: numbers, dates, masks; and uniform sampling."""

from __future__ import annotations

from datetime import date, timedelta

import numpy as np
from numpy.typing import ArrayLike

from romsindy.text import counted
from romsindy.typing import Array

# Deviation from uniform sampling, in sampling intervals: below it digits were merely rounded.
_ROUNDING = 1e-4


def as_floats(name: str, x: ArrayLike) -> Array:
    """Real numbers as a new array of floats; nan where a sample is masked.

    Raises a ValueError if they are complex, dates or no numbers.
    """
    masked = x if isinstance(x, np.ma.MaskedArray) else None
    try:
        if np.iscomplexobj(x):
            raise TypeError("it is complex")
        if np.asarray(x).dtype.kind in "mM":
            raise TypeError("it holds dates or durations")
        found = np.array(x, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of real numbers: {error}") from None
    if masked is not None:
        found[np.ma.getmaskarray(masked)] = np.nan
    return found


def as_seconds(name: str, t: ArrayLike) -> Array:
    """Times in s as a new array of floats: dates count from the first one, durations from zero.

    Those of NumPy (``datetime64``, ``timedelta64``), of pandas and of Python's ``datetime`` are
    taken, exact to the last digit of a float; of masked ones nan.

    Raises
    ------
    ValueError
        As `as_floats`.
    """
    times = np.asarray(t)
    first = times.flat[0] if times.size else 0.0
    try:
        if times.dtype.kind == "M":
            times = times - first
        if times.dtype.kind == "O" and isinstance(first, date):
            times = np.array([x - first for x in times.flat]).reshape(times.shape)
            first = times.flat[0]
        if times.dtype.kind == "m":
            times = times / np.timedelta64(1, "s")
        if times.dtype.kind == "O" and isinstance(first, timedelta):
            times = np.array([x.total_seconds() for x in times.flat]).reshape(times.shape)
    except (TypeError, AttributeError) as error:  # months, or times of several kinds
        raise ValueError(f"{name} must be times in s, dates or durations: {error}") from None
    mask = np.ma.getmask(t) if isinstance(t, np.ma.MaskedArray) else np.ma.nomask
    return as_floats(name, np.ma.array(times, mask=mask))


def uniform_times(t: Array) -> tuple[Array, str]:
    """Uniform times over the same span, (n,), and what the jitter is in words.

    There are no words where digits of t were merely rounded; no samples need be changed then.
    """
    uniform = np.linspace(t[0], t[-1], len(t))
    jitter = np.abs(t - uniform) / (uniform[1] - uniform[0])
    if jitter.max() <= _ROUNDING:
        return uniform, ""
    rms = np.sqrt(np.mean(jitter**2))
    return uniform, (
        f"t is not uniform: it jitters by {rms:.2g} of the sampling interval in the rms,"
        f" at most {jitter.max():.2g}; resampled uniformly"
    )


def part_between(t: Array, start: float | None, end: float | None) -> slice:
    """Samples with start <= t <= end, in s; None leaves an end as it is.

    Raises a ValueError if they are fewer than eight, or a time is no finite number.
    """
    for name, value in (("start", start), ("end", end)):
        if value is not None and not np.isfinite(value):
            raise ValueError(f"{name}={value} is no time: give seconds, or leave it out")
    low, high = t[0] if start is None else start, t[-1] if end is None else end
    slack = 1e-6 * float(t[1] - t[0])
    first, last = np.searchsorted(t, [low - slack, high + slack]).tolist()
    if last - first < 8:
        raise ValueError(
            f"start = {start}, end = {end} leave {max(last - first, 0)} samples of the record,"
            f" which runs from {t[0]:.6g} to {t[-1]:.6g} s"
        )
    return slice(first, last)


def enough_times(t: ArrayLike) -> Array:
    """Times as `as_seconds` takes them, refused where they are not (n,) of at least 8."""
    t = as_seconds("t", t)
    if t.ndim != 1 or len(t) < 8:
        raise ValueError(
            f"t must be one-dimensional with at least 8 samples, got shape {t.shape}: give more of"
            " the record"
        )
    return t


def require_increasing(
    t: Array, remedy: str = "sort the samples or remove the repeated ones"
) -> None:
    """Refuse times (n,) of which one is not after the one before it."""
    bad = np.flatnonzero(~(np.diff(t) > 0))
    if len(bad):
        i = int(bad[0])
        what = "repeats" if t[i + 1] == t[i] else "decreases"
        raise ValueError(
            f"t must increase, but it {what} at sample {i + 1} ({t[i]:.9g} -> {t[i + 1]:.9g} s):"
            f" {remedy}"
        )


def checked_time(t: ArrayLike) -> Array:
    """Times of a record, (n,) in s.

    Raises
    ------
    ValueError
        Unless they are finite numbers that increase without a gap, at least 8 of them.
    """
    t = enough_times(t)
    _refuse_nan("t", t)
    require_increasing(t)
    steps = np.diff(t)
    usual = float(np.median(steps))
    if steps.max() > 1.5 * usual:
        i = int(np.argmax(steps))
        raise ValueError(
            f"t has a gap of {steps[i]:.6g} s after {t[i]:.9g} s (usual step {usual:.6g} s): split"
            " the record there and pass the pieces as a list, keep one with start= or end=, or"
            " interpolate"
        )
    return t


def checked_signal(name: str, x: ArrayLike, n: int) -> Array:
    x = as_floats(name, x)
    if x.ndim not in (1, 2) or len(x) != n:
        raise ValueError(
            f"{name} must have shape ({n},) or ({n}, n_channels) to go with t, got {x.shape}"
        )
    _refuse_nan(name, x)
    if name == "q" and not np.all(np.ptp(x, axis=0) > 0):
        raise ValueError(f"q is constant ({x.flat[0]:.6g}): nothing vibrates in this record")
    return x


def _refuse_nan(name: str, x: Array) -> None:
    bad = np.argwhere(~np.isfinite(x))
    if len(bad):
        what = counted(len(bad), "value that is", "values that are")
        raise ValueError(
            f"{name} has {what} NaN, infinite or masked, the first at sample"
            f" {int(bad[0][0])}: cut them off, or interpolate over them; rs.inspect takes a"
            " Recording in which samples are missing"
        )
