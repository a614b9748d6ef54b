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
