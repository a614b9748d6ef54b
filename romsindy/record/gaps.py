"""What belongs in place of samples that are missing: Janssen's interpolation.

Arrays are one channel (n,) with a uniform rate; ``cycle`` is the length of a cycle of the
vibration, in samples.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from romsindy.record.autoregression import interpolated, predictor
from romsindy.record.faults import LONGEST_SPIKE, Mask, runs
from romsindy.typing import Array

# Order of the autoregression that bridges missing samples.
_ORDER = 24
# Samples of a cycle that it uses, and cycles that it is fitted to.
_RATE, _CYCLES = 16, 6
# Of the samples that it reaches: more holes leave too little to go by.
_HOLES = 0.2
# Times that autoregression and missing samples are found in turn.
_ROUNDS = 4


def restored(x: Array, cycle: float) -> Array:
    """Short runs of missing samples, up to a quarter of a cycle, interpolated; others stay.

    The autoregression is fitted to the cycles round them. It predicts from samples a sixteenth of
    a cycle apart, which noise disturbs far less than neighbours.
    """
    result, missing = x.copy(), ~np.isfinite(x)
    longest = max(cycle / 4, LONGEST_SPIKE)
    short = [
        r for r in runs(missing) if r.stop - r.start <= longest and 0 < r.start and r.stop < len(x)
    ]
    brief = np.zeros(len(x), bool)
    for run in short:
        brief[run] = True
    stride = max(1, round(cycle / _RATE))
    reach = max(round(_CYCLES * cycle / 2), 3 * _ORDER * stride)
    for group in _groups(short, reach // 3):
        first = max(group[0].start - reach, 0)
        around = slice(first, group[-1].stop + reach)
        segment, gap = result[around], brief[around] & ~np.isfinite(result[around])
        live = _known_stretch(~np.isfinite(segment) & ~gap, group[0].start - first)
        if np.count_nonzero(~gap[live]) < 3 * cycle:
            continue
        gap, start, stop = gap[live], first + live.start, first + live.stop
        mean = np.nanmean(segment[live])
        whole = _bridged_over(segment[live] - mean, gap, stride) + mean
        # Where the ends of the known stretch are full of holes, these are guesses for the others.
        for end in (gap[: _ORDER * stride], gap[::-1][: _ORDER * stride]):
            if np.mean(end) > _HOLES:
                end[:] = False
        gap[group[-1].stop - start :] = False  # the next group is in the middle of its own
        result[start:stop][gap] = whole[gap]
    return result


def _bridged_over(x: Array, gap: Mask, stride: int) -> Array:
    """Autoregression and missing samples in turn, a first guess for these by a spline."""
    at = np.arange(len(x))
    guess = make_interp_spline(at[~gap], x[~gap], k=3)(at)
    x = np.where(gap, guess, x)
    for _ in range(_ROUNDS):
        a = predictor(x, _ORDER, stride)
        for phase in range(stride):  # samples of one phase know nothing of the others
            every = slice(phase, None, stride)
            if np.any(gap[every]):
                x[every] = interpolated(x[every], gap[every], a)
    return x


def _groups(found: list[slice], distance: int) -> list[list[slice]]:
    groups: list[list[slice]] = []
    for run in found:
        if groups and run.start - groups[-1][-1].stop < distance and len(groups[-1]) < 8:
            groups[-1].append(run)
        else:
            groups.append([run])
    return groups


def _known_stretch(unknown: Mask, at: int) -> slice:
    before, after = np.flatnonzero(unknown[:at]), np.flatnonzero(unknown[at:])
    return slice(
        int(before[-1]) + 1 if len(before) else 0,
        at + int(after[0]) if len(after) else len(unknown),
    )
