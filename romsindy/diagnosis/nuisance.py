"""What a measurement may add without being wrong: an offset, and gain and curvature to a limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from romsindy.effects.base import Effect
from romsindy.effects.outside import Bias, Gain, SensorNonlinearity
from romsindy.fit.measured import free_offsets
from romsindy.fit.part import Part
from romsindy.fit.record import Record
from romsindy.fit.verdict import KNOWN_CURVATURE, KNOWN_GAIN


def allowed(effect: Effect, reach: float) -> float:
    """Strength up to which an effect is none: what a measurement up to ``reach`` may add."""
    if isinstance(effect, Bias):
        return np.inf
    if isinstance(effect, Gain):
        return KNOWN_GAIN
    if isinstance(effect, SensorNonlinearity) and effect.power == 2 and reach:
        return KNOWN_CURVATURE / reach
    return 0.0


def largest_reading(records: Sequence[Record]) -> float:
    """In any record, unit of what was measured."""
    return max(float(np.abs(r.signal).max()) for r in records)


def offsets(records: Sequence[Record]) -> Part:
    """The zero of the sensor in each record: free."""
    return replace(free_offsets(records), tolerance=largest_reading(records))


def nuisances(records: Sequence[Record]) -> tuple[Part, ...]:
    """What the measurement may add: an offset, and gain and curvature as far as they are known."""
    reach, found = largest_reading(records), [offsets(records)]
    for effect in (Gain(), SensorNonlinearity(2)):
        most = allowed(effect, reach)
        found.append(Part(effect, (), np.zeros((1, 1)), tolerance=most, most=most))
    return tuple(found)
