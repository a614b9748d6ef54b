"""Samples that show a faulty sensor by their values: dropouts and clipping.

Arrays are one channel (n,) with a uniform rate; ``cycle`` is the length of a cycle of the
vibration, in samples. Nothing here knows what was measured.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from romsindy.typing import Array

Mask = NDArray[np.bool_]

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


def runs(mask: Mask) -> list[slice]:
    """The stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


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
