"""Are the sensors right? Each against the others, through the curve of the simulated beam.

Combinations of the channels that a motion of the first modes does not reach (parity relations)
vanish but for noise and for what curves with the amplitude, which the simulation tells. A faulty
channel drives them along a direction of its own.

[1] J. Gertler, Fault Detection and Diagnosis in Engineering Systems, Marcel Dekker (1998), ch. 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from romsindy.typing import Array

# A fault is named above this part of the channel's rms, and where one channel explains this part
# of what does not fit: a beam that bends otherwise than simulated is no fault of a sensor.
_FAULT, _EXPLAINED = 0.01, 0.8
# Swings that end at exactly the same value are clipped: those of a decay differ.
_SAME, _SWINGS = 1e-9, 4
_FOLDS = 40  # parts of a channel's range over which what repeats is told from noise


@dataclass(frozen=True)
class SensorFault:
    """A channel that disagrees with the others."""

    channel: int
    label: str
    kind: str  # "gain", "offset" or "saturation"
    value: float  # relative error of the gain; offset, m; limit, m

    def __str__(self) -> str:
        unit = "" if self.kind == "gain" else " m"
        return f"sensor {self.label} is faulty ({self.kind} {self.value:.3g}{unit})"


def find_fault(
    measured: Array, simulated: Array, shapes: Array, labels: list[str]
) -> SensorFault | None:
    """Find the channel that is faulty, if there is one.

    ``measured`` (n, n_sensors) and ``simulated`` (m, n_sensors) are displacements from equilibrium,
    m, over the same amplitudes; ``shapes`` (n_sensors, n_modes) are those of the modes. Two sensors
    more than modes are needed to say which is wrong.
    """
    for channel, y in enumerate(measured.T):
        if _clips(y):
            return SensorFault(channel, labels[channel], "saturation", float(np.abs(y).max()))
    parity = null_space(shapes.T).T
    if len(parity) < 2:
        return None
    project = np.linalg.pinv(shapes)[0]
    curve, *_ = np.linalg.lstsq(_powers(simulated @ project), simulated @ parity.T, rcond=None)
    left = measured @ parity.T - _powers(measured @ project) @ curve
    found = []
    for channel, y in enumerate(measured.T):
        # A fault of the channel drives the relations, and the coordinate that the curve uses.
        column = parity[:, channel]
        f = left @ column / (column @ column)
        for kind, value, part in _explanations(y, f):
            rest = left - np.outer(part, column)
            found.append((float(np.sum(_repeated(rest, y) ** 2)), channel, kind, value, part))
    best = min(found, key=lambda row: row[0])
    cost, channel, kind, value, part = best
    all_of_it = float(np.sum(_repeated(left, measured[:, channel]) ** 2))
    worst = float(np.mean(np.abs(part[np.abs(part) > 0]))) if np.any(part) else 0.0
    small = worst < _FAULT * np.std(measured[:, channel])
    if small or cost > (1 - _EXPLAINED) * all_of_it:
        return None
    return SensorFault(channel, labels[channel], kind, value)


def _clips(y: Array) -> bool:
    """Whether a channel comes back to one and the same largest value, swing after swing."""
    top = np.abs(y) >= (1 - _SAME) * np.abs(y).max()
    return int(np.count_nonzero(np.diff(np.flatnonzero(top)) > 1)) >= _SWINGS - 1


def _powers(q: Array) -> Array:
    return np.stack([q, q**2, q**3], axis=1)


def _explanations(y: Array, f: Array) -> list[tuple[str, float, Array]]:
    """Kinds of fault of a channel with their least-squares values and what they add to it."""
    shown = float(f @ y / (y @ y))
    kinds = [
        ("gain", shown / (1 - shown), shown * y),  # y is (1 + gain) of the true displacement
        ("offset", float(np.mean(f)), np.full_like(y, np.mean(f))),
    ]
    # A channel that clips stays within a hair of its limit for a good part of its largest swings.
    limit = float(np.abs(y).max())
    clipped = np.abs(y) > 0.98 * limit
    missing = np.where(clipped, np.minimum(f * np.sign(y), 0.0) * np.sign(y), 0.0)
    if np.count_nonzero(clipped) > 1e-3 * len(y):
        kinds.append(("saturation", limit, missing))
    return kinds


def _repeated(left: Array, y: Array) -> Array:
    """Parts of the relations that follow the channel: means over its size, one row per bin."""
    edges = np.linspace(y.min(), y.max(), _FOLDS + 1)[1:-1]
    bins = np.digitize(y, edges)
    counts = np.maximum(np.bincount(bins, minlength=_FOLDS), 1)
    sums = np.stack([np.bincount(bins, x, minlength=_FOLDS) for x in left.T], axis=1)
    return sums / np.sqrt(counts)[:, None]
