"""Samples that no sensor meant: dropouts, spikes, clipping; and what belongs in their place.

Arrays are one channel (n,) with a uniform rate; ``cycle`` is the length of a cycle of the
vibration, in samples. Nothing here knows what was measured.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq, solve_toeplitz
from scipy.signal import lfilter

from romsindy.typing import Array

Mask = NDArray[np.bool_]

# Fewer equal samples in a row may be chance, or steps of an encoder.
_FEWEST = 4
# Of the run of equal samples that the resolution makes of a turning point: more is none.
_LONGER = 3.0
# Order of the autoregressions that predict a sample from its neighbours.
_ORDER = 24
# Of the samples, these set the range of usual ones.
_USUAL = 0.99
# Samples of a block of residuals, whose median is its scatter.
_BLOCK = 256
# Of that scatter: noise reaches as far once in 1e20. Encoders and rounding have no such tails.
_SPIKE = 10.0
# Samples of the longest spike: what is longer is a blow, or motion.
_LONGEST = 5
# Of the residual, what is left once the samples are interpolated: a blow leaves nearly all.
_LEFT = 0.3
# Samples a cycle of the autoregression that bridges missing ones, and cycles that it is fitted to.
_RATE, _CYCLES = 16, 6


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


def spikes(x: Array) -> Mask:
    """Up to a few samples that their neighbours on both sides do not foretell.

    A blow is none: the motion after it is not that before it.
    """
    marked = np.zeros(len(x), bool)
    clean = x - np.median(x)
    for _ in range(5):  # large spikes hide smaller ones
        a = _whitening(clean)
        new = np.zeros(len(x), bool)
        suspects, scatter = _unforetold(clean, a)
        for run in runs(suspects):
            if run.stop - run.start <= _LONGEST and _bridged(clean, run, a, scatter):
                new[run] = True
        if not np.any(new):
            break
        marked |= new
        clean = filled(np.where(marked, np.nan, clean))
    return marked


def _whitening(x: Array) -> Array:
    """Coefficients [1, a_1, ..., a_p] of the autoregression of the whole channel."""
    limit = np.quantile(np.abs(x), _USUAL)
    x = np.clip(x, -limit, limit)  # it must not learn the spikes
    order = min(_ORDER, len(x) // 10)
    spectrum = np.fft.rfft(x, 2 * len(x))
    lags = np.fft.irfft(np.abs(spectrum) ** 2)[: order + 1]
    lags[0] *= 1 + 1e-8  # a clean signal needs fewer values than there are
    return np.concatenate([[1.0], solve_toeplitz(lags[:-1], -lags[1:])])


def _unforetold(x: Array, a: Array) -> tuple[Mask, Array]:
    """Samples that neither the ones before nor the ones after foretell, and the usual error."""
    forward, backward = lfilter(a, [1.0], x), lfilter(a, [1.0], x[::-1])[::-1]
    error = np.minimum(np.abs(forward), np.abs(backward))
    order, n = len(a) - 1, len(x)
    error[:order] = error[n - order :] = 0.0
    blocks = [np.median(np.abs(b)) for b in np.array_split(forward, max(n // _BLOCK, 1))]
    loud = np.array([max(blocks[max(i - 1, 0) : i + 2]) for i in range(len(blocks))])
    lengths = [len(b) for b in np.array_split(forward, len(blocks))]
    scatter = np.repeat(loud / 0.6745, lengths)
    least = 1e-3 * np.sqrt(np.mean(x**2))
    high = error > np.maximum(_SPIKE * scatter, least)
    return _closed(high), scatter


def _closed(mask: Mask) -> Mask:
    """A single sample between two marked ones is marked too."""
    closed = mask.copy()
    closed[1:-1] |= mask[:-2] & mask[2:]
    return closed


def _bridged(x: Array, run: slice, a: Array, scatter: Array) -> bool:
    """Whether samples in place of a run make the motion before it go on after it."""
    order = len(a) - 1
    first = max(run.start - order, 0)
    segment = x[first : run.stop + order]
    missing = np.zeros(len(segment), bool)
    missing[run.start - first : run.stop - first] = True
    before = np.linalg.norm(np.convolve(segment, a, "valid"))
    after = np.linalg.norm(np.convolve(_interpolated(segment, missing, a), a, "valid"))
    level = np.sqrt(order) * scatter[run.start]
    return bool(after < max(_LEFT * before, 2 * level))


def _interpolated(x: Array, missing: Mask, a: Array) -> Array:
    """Least-squares interpolation by an autoregression (Janssen, Veldhuis and Vries, 1986)."""
    known = np.where(missing, 0.0, x)
    units = np.eye(len(x))[missing]
    columns = np.stack([np.convolve(unit, a, "valid") for unit in units], axis=1)
    known[missing] = lstsq(columns, -np.convolve(known, a, "valid"))[0]
    return known


def clipped(x: Array) -> Mask:
    """Samples that stick to the end of a sensor's range.

    A sensor that clips shows the very same extreme value for several samples, which it reaches
    and leaves with a slope: a parabola with these slopes rises above them. A turning point that
    rounding makes flat, and a hold before a release, have none.
    """
    marked, step = np.zeros(len(x), bool), resolution(x)
    for sign in (1, -1):
        y = sign * x
        top = np.nanmax(y)
        flat = top - y <= 1e-9 * np.nanmax(np.abs(np.diff(y[np.isfinite(y)])))
        tops = [r for r in runs(flat) if r.stop - r.start >= _FEWEST - 1]
        high = [r for r in tops if _rises(y, r) > 2 * step]
        for run in high:
            marked[run] = True
    return marked


def _rises(y: Array, run: slice) -> float:
    """Height over a run of a parabola with the slopes before and behind it; 0 for a hold."""
    width = run.stop - run.start
    reach = max(width // 2, 2)
    before, after = y[run.start - reach : run.start + 1], y[run.stop - 1 : run.stop + reach]
    if len(before) <= reach or len(after) <= reach:
        return 0.0
    return float(min(before[-1] - before[0], after[0] - after[-1])) / reach * width / 4


def restored(x: Array, cycle: float) -> Array:
    """Short runs of missing samples, up to a quarter of a cycle, interpolated; others stay.

    The autoregression is fitted to the cycles round them. It predicts from samples a sixteenth of
    a cycle apart, which noise disturbs far less than neighbours.
    """
    result, missing = x.copy(), ~np.isfinite(x)
    short = [r for r in runs(missing) if r.stop - r.start <= max(cycle / 4, _LONGEST)]
    stride = max(1, round(cycle / _RATE))
    reach = max(round(_CYCLES * cycle / 2), 3 * _ORDER * stride)
    for group in _groups(short, reach // 3):
        around = slice(max(group[0].start - reach, 0), min(group[-1].stop + reach, len(x)))
        segment = x[around]
        # Beyond a long gap nothing is known.
        gap = np.zeros(len(segment), bool)
        for run in group:
            gap[run.start - around.start : run.stop - around.start] = True
        live = _known_stretch(~np.isfinite(segment) & ~gap, int(np.flatnonzero(gap)[0]))
        if live.stop - live.start < 2 * _ORDER * stride + np.count_nonzero(gap[live]):
            continue
        segment, gap = segment[live], gap[live]
        mean = np.nanmean(segment)
        segment = segment - mean
        a = _fitted(segment, stride)
        for phase in range(stride):  # samples of one phase know nothing of the others
            every = slice(phase, None, stride)
            if np.any(gap[every]):
                segment[every] = _interpolated(segment[every], gap[every], a)
        start = around.start + live.start
        result[start : start + len(segment)][gap] = segment[gap] + mean
    return result


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


def _fitted(x: Array, stride: int) -> Array:
    """Autoregression over lags of so many samples, from the rows without a missing sample."""
    order = min(_ORDER, (len(x) // stride - 1) // 3)
    rows = np.stack(
        [x[(order - k) * stride : len(x) - k * stride] for k in range(order + 1)], axis=1
    )
    rows = rows[np.all(np.isfinite(rows), axis=1)]
    return np.concatenate([[1.0], -lstsq(rows[:, 1:], rows[:, 0], cond=1e-6)[0]])
