"""The one split of a record into cycles, and what follows from it.

Crossings, midline and level of rest. Arrays have time
on axis 0; unless another shape is named, ``x`` is one channel (n,), sampled every ``dt`` seconds.
Nothing here knows what was measured.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.interpolate import make_interp_spline, make_lsq_spline

from romsindy.record.signals import fundamental_frequency, lowpass, vertex
from romsindy.typing import Array, Indices


def crossings(x: Array, dt: float) -> tuple[Indices, Indices]:
    """Last samples before the up- and the down-crossings of zero, one each a cycle.

    They are found on the signal below three times its fundamental, so that noise and higher modes
    add none; the frequency may change by a factor of three along the decay.

    They come as two integer arrays: ``down[k]`` lies between ``up[k]`` and ``up[k + 1]``.

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


def rest_level(x: Array, dt: float) -> float:
    """Where a decaying vibration comes to rest; 0 where it cannot be told from 0.

    The midline between the turning points, which an asymmetric vibration shifts in proportion to
    amplitude^2, is extrapolated to no amplitude. Less than 1 % of the largest amplitude, or less
    than four standard errors, counts as 0.
    """
    _, midline, swing = _midline(x, dt, 1 / fundamental_frequency(x, dt))
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
