"""Samples that show a faulty sensor (dropouts, clipping, spikes, steps), and what belongs there.

Arrays are one channel (n,) with a uniform rate; ``cycle`` is the length of a cycle of the
vibration, in samples. Nothing here knows what was measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter

from romsindy.record.prediction import autoregression, interpolated, predictor
from romsindy.record.signals import Mask, runs
from romsindy.typing import Array

# Fewer equal samples in a row may be chance, or steps of an encoder.
_FEWEST = 4
# Of the run of equal samples that the resolution makes of a turning point: more is none.
_LONGER = 3.0
# Of the resolution: rounding flattens a turning point by less.
_FLAT = 8.0
# A rail lies within this part of the range below the largest sample; noise that is added behind
# it may lift one sample in so many over it.
_NEAR_RAIL, _FEW_BEYOND = 0.02, 10
# Samples of the longest spike: what is longer is a blow, or motion.
LONGEST_SPIKE = 5


def resolution(x: Array) -> float:
    """Smallest difference between values, unit of x: the step of an encoder or a converter."""
    values = np.unique(x[np.isfinite(x)])
    steps = np.diff(values)
    steps = steps[steps > 1e-9 * np.ptp(values)]
    return float(steps.min()) if len(steps) else 0.0


def filled(x: Array) -> Array:
    """Straight lines across missing samples; the nearest value beyond the ends."""
    known = np.isfinite(x)
    if np.all(known):
        return x
    at = np.arange(len(x))
    return np.interp(at, at[known], x[known])


def dropouts(x: Array, cycle: float) -> Mask:
    """Runs of one value within a live signal, longer than a turning point can make them.

    A hold before a release, and friction that stops the motion, keep an extreme value of the next
    or the last cycle. Zeros before a blow follow no motion.
    """
    marked, step, size = np.zeros(len(x), bool), resolution(x), round(cycle)
    for run in runs(np.diff(x) == 0):
        a, b = run.start, run.stop + 1
        if b - a < _FEWEST or a < 2:
            continue
        sides = [x[max(a - size, 0) : a], x[b : b + size]]
        sides = [side[np.isfinite(side)] for side in sides]
        sides = [side for side in sides if len(side) > 1]
        swings = [float(np.ptp(side)) / 2 for side in sides]
        if not swings or min(swings) <= 4 * step:
            continue  # nothing lives before, or after
        natural = cycle / np.pi * np.sqrt(2 * step / min(swings))
        inside = all(
            side.min() + 0.1 * swing < x[a] < side.max() - 0.1 * swing
            for side, swing in zip(sides, swings, strict=True)
        )
        if inside and b - a > _LONGER * natural:
            marked[a:b] = True
    return marked


def clipped(x: Array) -> Mask:
    """Samples that stick to the end of a sensor's range.

    A sensor that clips shows the very same extreme value for several samples, which it reaches
    and leaves with a slope: a parabola with these slopes rises above them. A turning point that
    rounding makes flat, and a hold before a release, have none.
    """
    marked, step = np.zeros(len(x), bool), resolution(x)
    for y in (x, -x):
        flat = _rail(y) - y <= 1e-9 * np.nanmax(np.abs(np.diff(y[np.isfinite(y)])))
        for run in runs(flat):
            if run.stop - run.start > 1 and _rises(y, run) > _FLAT * step:
                marked[run] = True
    return marked


def _rail(y: Array) -> float:
    """The largest value, or the one below that the largest samples stick to but for a few."""
    high = y[y > np.nanmax(y) - _NEAR_RAIL * np.ptp(y[np.isfinite(y)])]
    values, counts = np.unique(high, return_counts=True)
    most = int(np.argmax(counts))
    beyond = int(counts[most + 1 :].sum())
    stuck = counts[most] >= _FEWEST and _FEW_BEYOND * beyond < counts[most]
    return float(values[most] if stuck else values[-1])


def _rises(y: Array, run: slice) -> float:
    """Height over a run of a parabola with the slopes before and behind it; 0 for a hold."""
    width = run.stop - run.start
    reach = max(width // 2, 2)
    before, after = y[: run.start + 1][-reach - 1 :], y[run.stop - 1 :][: reach + 1]
    if len(after) <= reach:
        return 0.0
    drops = [after[0] - after[-1]]
    if len(before) > reach:
        drops.append(before[-1] - before[0])
    elif run.start > 0 or _from_rest(y[run.stop - 1 :], min(max(width // 4, 2), 4)):
        return 0.0
    return float(min(drops)) / reach * width / 4


def _from_rest(y: Array, step: int) -> bool:
    """What is let go from rest drops by 1, then by 3; what comes back into the range by 1 and 1."""
    return len(y) <= 2 * step or bool(y[step] - y[2 * step] > 2 * (y[0] - y[step]))


# Order of the autoregression that bridges missing samples, or predicts one from one side.
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
    x = np.where(gap, make_interp_spline(at[~gap], x[~gap], k=3)(at), x)
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
