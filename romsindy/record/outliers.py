"""Samples that their neighbours do not foretell: spikes, and steps of the level.

Arrays are one channel (n,) with a uniform rate and without missing samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from romsindy.record.autoregression import autoregression, interpolated
from romsindy.record.faults import LONGEST_SPIKE, Mask, filled
from romsindy.typing import Array

# Order of the autoregression that predicts a sample from those on one side.
_ORDER = 24
# Of the samples, these set the range of usual ones.
_USUAL = 0.99
# Samples of a block of errors, whose median is their scatter.
_BLOCK = 256
# Of that scatter: noise reaches as far once in 1e20. Encoders and rounding have no such tails.
_LARGE = 10.0
# Of the scatter, what may be left after mending: a blow leaves far more.
_LEFT = 3.0
# Of a step, how far the means before and after may contradict it.
_AGREE = 0.3


def spikes(x: Array) -> Mask:
    """Up to a few samples that their neighbours on both sides do not foretell.

    A blow is none: the motion after it is not that before it.
    """
    marked = np.zeros(len(x), bool)
    clean: Array = x - np.median(x)
    for _ in range(5):  # large spikes hide smaller ones
        a = _whitening(clean)
        new = np.zeros(len(x), bool)
        errors = _Errors.of(clean, a)
        for run in errors.short_runs():
            if _bridged(clean, run, a, errors.scatter):
                new[run] = True
        if not np.any(new):
            break
        marked |= new
        clean = filled(np.where(marked, np.nan, clean))
    return marked


def steps(x: Array, cycle: float) -> list[tuple[int, float]]:
    """Jumps of the level: first samples after them, and sizes. What vibrates goes on as before.

    Where two records were joined the samples jump, but not their mean over ``cycle`` samples.
    """
    clean: Array = x - np.median(x)
    a, span = _whitening(clean), 2 * round(cycle)
    errors, found = _Errors.of(clean, a), []
    shape = np.cumsum(a)  # what predicts forwards sees of a step of 1
    for at in np.flatnonzero(errors.forward_large[1:] & errors.backward_large[:-1]) + 1:
        seen = errors.forward[at : at + len(a)]
        size = float(shape @ seen / (shape @ shape))
        left = np.sqrt(np.mean((seen - size * shape) ** 2))
        if left > _LEFT * errors.scatter[at] or at < span or at + span > len(x):
            continue
        rise = np.mean(clean[at : at + span]) - np.mean(clean[at - span : at])
        if abs(rise - size) < _AGREE * abs(size):
            found.append((int(at), size))
    return found


def _whitening(x: Array) -> Array:
    """The autoregression of the whole channel, which must not learn the spikes."""
    limit = np.quantile(np.abs(x), _USUAL)
    return autoregression(np.clip(x, -limit, limit), _ORDER)


@dataclass(frozen=True)
class _Errors:
    """Errors of the predictions from the samples before (forward) and after (backward)."""

    forward: Array
    scatter: Array
    forward_large: Mask
    backward_large: Mask

    @classmethod
    def of(cls, x: Array, a: Array) -> _Errors:
        order, n = len(a) - 1, len(x)
        forward, backward = lfilter(a, [1.0], x), lfilter(a, [1.0], x[::-1])[::-1]
        blocks = np.array_split(np.abs(forward), max(n // _BLOCK, 1))
        usual = np.pad([np.median(block) for block in blocks], 1, mode="edge")
        loudest = np.max([usual[:-2], usual[1:-1], usual[2:]], axis=0) / 0.6745
        scatter = np.repeat(loudest, [len(block) for block in blocks])
        limit = np.maximum(_LARGE * scatter, 1e-3 * np.sqrt(np.mean(x**2)))
        # The first and the last samples have no such neighbours.
        limit[: order + 1] = limit[n - order - 1 :] = np.inf
        return cls(forward, scatter, np.abs(forward) > limit, np.abs(backward) > limit)

    def short_runs(self) -> list[slice]:
        """Runs that begin as no sample before foretells, and end as none after."""
        found = []
        for begin in np.flatnonzero(self.forward_large):
            last = np.flatnonzero(self.backward_large[begin : begin + LONGEST_SPIKE])
            if len(last):
                found.append(slice(int(begin), int(begin + last[-1]) + 1))
        return found


def _bridged(x: Array, run: slice, a: Array, scatter: Array) -> bool:
    """Whether samples in place of a run make the motion before it go on after it."""
    order = len(a) - 1
    first = max(run.start - order, 0)
    segment = x[first : run.stop + order]
    missing = np.zeros(len(segment), bool)
    missing[run.start - first : run.stop - first] = True
    left = np.convolve(interpolated(segment, missing, a), a, "valid")
    return bool(np.sqrt(np.mean(left**2)) < _LEFT * scatter[run.start])
