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
from scipy.stats import chi2

from romsindy.fit.verdict import ONE_SENSOR, SENSOR_FAULT
from romsindy.typing import Array

# Swings that end at exactly the same value are clipped: those of a decay differ.
_SAME, _SWINGS = 1e-9, 4
_CHANCE = 0.01  # that sensors within their tolerances disagree by more
_CUT = 30.0  # of chi-square, for independent samples, over some hundred limits that are tried
_LIMITS = np.linspace(0.6, 1.0, 41)  # of a channel, over its largest reading
_MEMORY = 20  # samples after which noise is not alike any more
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
    measured: Array, simulated: Array, shapes: Array, labels: list[str], gains: Array | None = None
) -> SensorFault | None:
    """Find the channel that is faulty, if there is one.

    Two sensors more than modes are needed to say which is wrong. Displacements from equilibrium
    over the same amplitudes, ``measured`` and ``simulated``, are (n, n_sensors), m, the ``shapes``
    of the modes (n_sensors, n_modes). Where places of sensors are known to a tolerance, ``gains``
    are the standard deviations of their gains, (n_sensors,).
    """
    for channel, y in enumerate(measured.T):
        if _clips(y):
            return SensorFault(channel, labels[channel], "saturation", float(np.abs(y).max()))
    parity = null_space(shapes.T).T
    if len(parity) < 2:
        return None
    project = np.linalg.pinv(shapes)[0]
    curve, *_ = np.linalg.lstsq(_powers(simulated @ project), simulated @ parity.T, rcond=None)
    q = measured @ project
    left = measured @ parity.T - _powers(q) @ curve
    allowed = gains is not None and _places_explain(left, q, parity * shapes[:, 0], gains)
    fault = _worst(measured, parity, left, labels, without=q if allowed else None)
    return fault or _cut(measured, parity, left, q, labels)


def _places_explain(left: Array, q: Array, drives: Array, gains: Array) -> bool:
    """Whether gains within their standard deviations make the relations follow the coordinate."""
    follows = q @ left / (q @ q)
    spread = drives * gains
    chi_squared = follows @ np.linalg.solve(spread @ spread.T, follows)
    return bool(chi_squared < chi2.isf(_CHANCE, len(follows)))


def _worst(
    measured: Array, parity: Array, left: Array, labels: list[str], without: Array | None = None
) -> SensorFault | None:
    """The channel that explains what is left of the relations, if one explains it.

    What follows ``without`` (n,) is no fault.
    """

    def seen(relations: Array, y: Array) -> float:
        if without is not None:
            follows = without @ relations / (without @ without)
            relations = relations - np.outer(without, follows)
        return float(np.sum(_repeated(relations, y) ** 2))

    found = []
    for channel, y in enumerate(measured.T):
        # A fault of the channel drives the relations, and the coordinate that the curve uses.
        column = parity[:, channel]
        f = left @ column / (column @ column)
        for kind, value, part in _explanations(y, f):
            if kind == "gain" and without is not None:
                continue
            rest = left - np.outer(part, column)
            found.append((seen(rest, y), channel, kind, value, part))
    best = min(found, key=lambda row: row[0])
    cost, channel, kind, value, part = best
    all_of_it = seen(left, measured[:, channel])
    worst = float(np.mean(np.abs(part[np.abs(part) > 0]))) if np.any(part) else 0.0
    small = worst < SENSOR_FAULT * np.std(measured[:, channel])
    if small or cost > (1 - ONE_SENSOR) * all_of_it:
        return None
    return SensorFault(channel, labels[channel], kind, value)


def _cut(
    measured: Array, parity: Array, left: Array, q: Array, labels: list[str]
) -> SensorFault | None:
    """The channel that stays below a limit in a few swings, under the noise, if there is one.

    What follows the coordinate smoothly is no limit of a sensor.
    """
    smooth = np.linalg.qr(_powers(q))[0]

    def rest(x: Array) -> Array:
        return np.asarray(x - smooth @ (smooth.T @ x))

    left = rest(left)
    noise = np.cov(left.T)
    found = []
    for channel, y in enumerate(measured.T):
        weight = np.linalg.solve(noise, parity[:, channel])
        precision = float(weight @ parity[:, channel])
        f = left @ weight / precision
        true = smooth @ (smooth.T @ y)
        for limit in np.abs(true).max() * _LIMITS:
            part = rest(np.clip(true, -limit, limit) - true)
            found.append((precision * float(part @ (2 * f - part)), channel, float(limit)))
    gain, channel, limit = max(found)
    if gain < _CUT * _correlated(left):
        return None
    return SensorFault(channel, labels[channel], "saturation", limit)


def _correlated(x: Array) -> float:
    """Samples that tell as much as one that is independent, of the worst column; at least 1."""
    x = x - x.mean(axis=0)
    power = np.sum(x**2, axis=0)
    rho = [np.sum(x[k:] * x[:-k], axis=0) / power for k in range(1, _MEMORY)]
    return float(np.max(1 + 2 * np.maximum(np.sum(rho, axis=0), 0.0)))


def _clips(y: Array) -> bool:
    """Whether a channel comes back to one and the same largest value, swing after swing."""
    top = np.abs(y) >= (1 - _SAME) * np.abs(y).max()
    return int(np.count_nonzero(np.diff(np.flatnonzero(top)) > 1)) >= _SWINGS - 1


def _powers(q: Array) -> Array:
    return np.stack([q, q**2, q**3], axis=1)


def _explanations(y: Array, f: Array) -> list[tuple[str, float, Array]]:
    """Kinds of fault of a channel with their least-squares values and what they add to it."""
    shown = float(f @ y / (y @ y))
    return [
        ("gain", shown / (1 - shown), shown * y),  # y is (1 + gain) of the true displacement
        ("offset", float(np.mean(f)), np.full_like(y, np.mean(f))),
    ]


def _repeated(left: Array, y: Array) -> Array:
    """Parts of the relations that follow the channel: means over its size, one row per bin."""
    edges = np.linspace(y.min(), y.max(), _FOLDS + 1)[1:-1]
    bins = np.digitize(y, edges)
    counts = np.maximum(np.bincount(bins, minlength=_FOLDS), 1)
    sums = np.stack([np.bincount(bins, x, minlength=_FOLDS) for x in left.T], axis=1)
    return sums / np.sqrt(counts)[:, None]
