"""Uniform sampling: how far times are from it, and the times that are."""

from __future__ import annotations

import numpy as np

from romsindy.typing import Array

# Deviation from uniform sampling, in sampling intervals: below it digits were merely rounded.
_ROUNDING = 1e-4


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

    Raises
    ------
    ValueError
        If they are fewer than eight.
    """
    low, high = t[0] if start is None else start, t[-1] if end is None else end
    slack = 1e-6 * float(t[1] - t[0])
    first, last = np.searchsorted(t, [low - slack, high + slack]).tolist()
    if last - first < 8:
        raise ValueError(
            f"start = {start}, end = {end} leave {max(last - first, 0)} samples of the record,"
            f" which runs from {t[0]:.6g} to {t[-1]:.6g} s"
        )
    return slice(first, last)
