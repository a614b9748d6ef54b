"""What a measured input does: a blow, a tone, a sweep or a broad band, and for how long."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import ShortTimeFFT, find_peaks, periodogram

from romsindy.record.signals import vertex
from romsindy.typing import Array

# An input acts where it reaches this part of its largest value, and drives a record where it acts
# in this part of it: a blow is over at once.
_ACTS, _DRIVES = 0.05, 0.3
_WINDOWS = 64  # windows of a record in which a tone is looked for
# Of the power of a window: so much near its strongest line is one tone, in most of the windows.
_TONE, _MOST = 0.7, 0.8
# From window to window a frequency that sweeps moves by its range over their number. One that is
# stepped moves by less than a part of that, so often. Less than so many lines tell neither.
_STILL, _HOLDS, _FAR = 0.1, 0.2, 8
_BAND = 0.01  # of the power: what lies beyond belongs to no band


@dataclass(frozen=True)
class Drive:
    """One measured input of a record.

    Attributes
    ----------
    name : str
        Of its column.
    kind : "force" or "base"
        What `romsindy identify --input` calls it.
    how : str
        What it does: "swept sine from 4 to 12 Hz".
    lasting : bool
        Whether it drives the record; what follows a blow is free.
    """

    name: str
    kind: str
    how: str
    lasting: bool

    def __str__(self) -> str:
        return f"{self.kind} in column {self.name!r}: {self.how}"

    @classmethod
    def of(cls, x: Array, dt: float, name: str, kind: str) -> Drive:
        """From samples (n,) of the input every ``dt`` seconds; NaN where one is missing."""
        x = np.where(np.isfinite(x), x, 0.0)
        x = x - np.median(x)
        size = np.array([np.max(np.abs(part), initial=0.0) for part in np.array_split(x, _WINDOWS)])
        if not np.any(size):
            return cls(name, kind, "nothing but a constant", False)
        acts = float(np.mean(size > _ACTS * size.max()))
        if acts < _DRIVES:
            return cls(name, kind, f"a blow or several, {100 * acts:.2g} % of the record", False)
        return cls(name, kind, _how(x, dt), True)


def _how(x: Array, dt: float) -> str:
    """Of an input that lasts: a tone that holds, steps or sweeps, or a broad band."""
    width = max(4 * len(x) // _WINDOWS, 16)
    window = ShortTimeFFT(np.hanning(width), max(width // 4, 1), 1 / dt)
    power = window.spectrogram(x)[:, window.lower_border_end[1] :]
    power = power[:, power.sum(axis=0) > _ACTS**2 * power.sum(axis=0).max()]
    top = np.argmax(power, axis=0)
    near = np.abs(np.arange(len(power))[:, None] - top) <= 3
    tones = np.sum(power * near, axis=0) > _TONE * power.sum(axis=0)
    line = 1 / (width * dt)
    if np.mean(tones) > _MOST:
        f = line * _tops(power[:, tones])
        low, high = float(f.min()), float(f.max())
        if high - low < 3 * line:
            return f"harmonic at {np.median(f):.4g} Hz"
        steady = np.mean(np.abs(np.diff(f)) < _STILL * (high - low) / len(f)) > _HOLDS
        kind = ("stepped " if steady else "swept ") if high - low > _FAR * line else ""
        return f"{kind}sine from {low:.3g} to {high:.3g} Hz"
    f, power = periodogram(x, 1 / dt)
    part = np.cumsum(power) / power.sum()
    low, high = (float(f[np.searchsorted(part, p)]) for p in (_BAND, 1 - _BAND))
    peaks = find_peaks(power, 1e-3 * power.max(), distance=2)[0]
    lines = len(peaks) > 2 and power[peaks].sum() > _TONE * power.sum()
    return f"{'many tones' if lines else 'random'} from {low:.3g} to {high:.3g} Hz"


def _tops(power: Array) -> Array:
    """Lines, not whole, at which each column is greatest: a parabola through three logarithms."""
    top = np.clip(np.argmax(power, axis=0), 1, len(power) - 2)
    log = np.log(np.maximum(power, 1e-300))
    return top + vertex(*(np.take_along_axis(log, top[None] + k, axis=0)[0] for k in (-1, 0, 1)))
