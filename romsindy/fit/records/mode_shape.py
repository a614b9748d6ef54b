"""What channels show: mode shapes of several coordinates, straight and curved, and offsets.

Modes that follow show as well: y = Phi q + sum of C_p q^p, with products q^p of two coordinates or
more (slaved modes, and the arc on which a sensor moves).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np

from romsindy.effects.base import ReadingEffect
from romsindy.effects.outside import Bias
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.prepared import Prepared
from romsindy.typing import Array


@dataclass(frozen=True)
class ModeShape(ReadingEffect):
    """What one channel shows of one coordinate, beyond what was read off the record."""

    channel: int = 0
    coordinate: int = 0

    name, label = "mode_shape", "another mode shape at a sensor"

    @property
    def variant(self) -> str:
        """Channel and coordinate, from 1."""
        return f"channel {self.channel + 1}, q{self.coordinate + 1}"

    def readings(self, t: Array, q: Array) -> Array:
        """Of its channel, (1, n), by a motion (n, R) in the measured quantity."""
        return q[:, self.coordinate][None]


@dataclass(frozen=True)
class Offset(Bias):
    """A zero of the sensor of one channel that differs from record to record."""

    channel: int = 0

    per_record = True


def free_offsets(records: Sequence[Prepared], channel: int = 0) -> Part:
    """An offset of the sensor of a channel in each record, 0 at first."""
    return Part(Offset(channel), (), np.zeros((len(records), 1)))


@dataclass(frozen=True)
class CurvedShape(ReadingEffect):
    """What one channel shows of a product of coordinates: their powers, one for each."""

    channel: int = 0
    powers: tuple[int, ...] = (2,)

    name, label = "curved_shape", "a sensor that shows products of coordinates"

    @property
    def variant(self) -> str:
        """Channel, from 1, and product."""
        return f"channel {self.channel + 1}, {self.product}"

    @property
    def sentence(self) -> str:
        """That the sensors show the product, whichever does."""
        return f"sensors show {self.product}"

    @property
    def product(self) -> str:
        """Such as "q1^2 q2"."""
        powers = [(i + 1, p) for i, p in enumerate(self.powers) if p]
        return " ".join(f"q{i}^{p}" if p > 1 else f"q{i}" for i, p in powers)

    def readings(self, t: Array, q: Array) -> Array:
        """Of its channel, (1, n), by a motion and its derivatives, (n, k R): see `shown_slopes`."""
        series = self._series(q)
        return factorial(len(series) - 1) * _product(series, self.powers)[-1][None]

    def shown_slopes(self, q: Array) -> Array:
        """Derivatives of the reading by q, q_dot, ... up to the measured quantity, (n, k R)."""
        series, last = self._series(q), len(q[0]) // len(self.powers) - 1
        found = np.zeros((last + 1, *series.shape[1:]))
        for i, p in enumerate(self.powers):
            if p:
                fewer = tuple(n - (j == i) for j, n in enumerate(self.powers))
                rest = p * _product(series, fewer)
                for order in range(last + 1):
                    found[order, :, i] = factorial(last) / factorial(order) * rest[last - order]
        return np.concatenate(found, axis=1)

    def _series(self, q: Array) -> Array:
        """Taylor coefficients in time of all coordinates, (k, n, R)."""
        orders = np.split(q, q.shape[1] // len(self.powers), axis=1)
        return np.stack([x / factorial(order) for order, x in enumerate(orders)])


def _product(series: Array, powers: tuple[int, ...]) -> Array:
    """Taylor coefficients of a product of powers, (k, n)."""
    found = np.zeros(series.shape[:2])
    found[0] = 1.0
    for i, p in enumerate(powers):
        for _ in range(p):
            factor = series[..., i]
            found = np.stack(
                [sum(found[j] * factor[m - j] for j in range(m + 1)) for m in range(len(found))]
            )
    return found
