"""What a sensor makes of a motion, as far as nobody knows it: a curvature, and its zero.

It shows y = x + e x^2 / x_max + offset of the quantity x that it measures. A curvature e is no
inertia and no stiffness, but makes a second harmonic as these do: it is fitted beside them, with
what is expected of such a sensor as its prior. A cube is not tried: of one coordinate q read as
y = r(q) nothing tells (dq/dy)^2 - 1 from inertia (`curvature_for`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from romsindy.typing import Array

_OFFSET = 0.1  # of the largest reading: no record is so far off its zero


class SensorCurvature(NamedTuple):
    """What is not known of the sensor.

    Attributes
    ----------
    curvature : float
        Standard deviation of e: what the sensor is expected to be off a straight line at the
        largest amplitude, as a part of that; 0 of one that is straight.
    n_records : int
        Each has an offset of its own.
    """

    curvature: float
    n_records: int

    @property
    def size(self) -> int:
        """Number of its values: e, then the offset of each record."""
        return 1 + self.n_records

    @property
    def spread(self) -> list[float]:
        """Standard deviations of its values."""
        return [self.curvature, *[_OFFSET] * self.n_records]

    def shown(self, values: Array, x: Array, largest: float, record: int) -> tuple[Array, Array]:
        """What it shows of a motion x (n,), and the slope of that, (n,)."""
        e, offset = values[0], values[1 + record]
        return x + e * x * x / largest + offset * largest, 1 + 2 * e * x / largest

    def by_value(self, x: Array, largest: float, record: int) -> Array:
        """Derivatives of what is shown by its values, (n, size)."""
        slopes = np.zeros((len(x), self.size))
        slopes[:, 0], slopes[:, 1 + record] = x * x / largest, largest
        return slopes


STRAIGHT = SensorCurvature(0.0, 1)


def curvature_for(q: Array, h: Array) -> float:
    """How much less than q a sensor must show at the end of a range to look like inertia h there.

    Parameters
    ----------
    q, h : (n,) arrays
        From 0 to the end of the range.

    Returns
    -------
    float
        As a part of the last q: a straight sensor of an oscillator without inertia shows
        int sqrt(1 + h) dq where this one shows q.
    """
    straight = np.trapezoid(np.sqrt(1 + h), q)
    return float((straight - q[-1]) / straight)
