"""Filters that turn a measured signal into a consistent (q, q_dot, q_ddot).

The three agree with one another: the derivatives are those of the smoothed signal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import savgol_filter

from romsindy.record.signals import fundamental_frequency, lowpass
from romsindy.typing import Array

Derivatives = tuple[Array, Array, Array]


class Filter(Protocol):
    """Anything that smooths one channel and differentiates it twice."""

    def __call__(self, q: Array, dt: float) -> Derivatives:
        """Return smoothed q, q_dot, q_ddot, each (n,), from q (n,) sampled every dt seconds."""
        ...


@dataclass(frozen=True)
class Butterworth:
    """Zero-phase Butterworth low-pass, forward and backward, then a quintic spline.

    Parameters
    ----------
    cutoff : float, optional
        Hz; ten times the fundamental by default. At or above 0.45 of the sampling rate nothing
        is filtered.
    order : int
        Order of one pass, 4 in the method's paper.

    Raises
    ------
    ValueError
        If the cut-off or the order is not positive.
    """

    cutoff: float | None = None
    order: int = 4

    def __post_init__(self) -> None:
        if self.cutoff is not None and not self.cutoff > 0:
            raise ValueError(f"cutoff = {self.cutoff!r} must be a positive frequency in Hz")
        if self.order < 1:
            raise ValueError(f"order = {self.order!r} must be at least 1")

    def __call__(self, q: Array, dt: float) -> Derivatives:
        cutoff = self.cutoff or 10 * fundamental_frequency(q, dt)
        smooth = lowpass(q, dt, cutoff, self.order)
        t = dt * np.arange(len(q))
        spline = make_interp_spline(t, smooth, k=5)
        return smooth, spline(t, 1), spline(t, 2)


@dataclass(frozen=True)
class SavitzkyGolay:
    """Local polynomials over a window of samples.

    Parameters
    ----------
    window : int
        Number of samples, odd.
    order : int
        Degree of the polynomials, below the window.
    """

    window: int = 31
    order: int = 5

    def __call__(self, q: Array, dt: float) -> Derivatives:
        if self.window > len(q):
            raise ValueError(
                f"window = {self.window} is longer than the record of {len(q)} samples"
            )
        q0, q1, q2 = (
            savgol_filter(q, self.window, self.order, deriv=d, delta=dt) for d in range(3)
        )
        return q0, q1, q2
