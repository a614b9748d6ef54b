"""Decays that cannot be those of the beam and its sensors are refused, with a remedy."""

from __future__ import annotations

import numpy as np

from romsindy.beam.sensors import SensorArray
from romsindy.fit.record import Record
from romsindy.fit.verdict import MOVING
from romsindy.record.decay import Decay
from romsindy.record.units import parse_unit


def checked_readings(decay: Decay, i: int, sensors: SensorArray, length: float) -> Decay:
    """Return a decay, number ``i`` in messages, with one column per sensor, in m.

    Raises
    ------
    ValueError
        For another number of channels, another quantity, or another unit than m.
    """
    channels, n = decay.n_channels, len(sensors.sensors)
    if channels != n:
        are = "is" if n == 1 else "are"
        raise ValueError(
            f"decay {i} has {_count(channels, 'channel')}, but there {are} {_count(n, 'sensor')}:"
            " give one channel per sensor, in the order of the sensors"
        )
    if decay.measured != "displacement":
        raise ValueError(
            f"decay {i} holds {decay.measured}: displacements are needed; integrate it first"
        )
    if decay.unit not in (None, "m"):
        raise ValueError(f"decay {i} is in {decay.unit}, the beam in m: {_conversion(decay.unit)}")
    largest = float(np.abs(decay.q).max())
    if largest > length:
        raise ValueError(
            f"decay {i} reaches {largest:.3g} m, the beam is {length:.3g} m long: if it is in mm,"
            " give Decay(t, 0.001 * q, unit='m')"
        )
    return Decay(decay.t, decay.q.reshape(len(decay.t), -1), unit="m")


def check_release(record: Record, i: int) -> None:
    """Raise a ValueError for a record that does not start from rest."""
    q_dot = record.motion.q_dot[:, 0]
    speed = np.abs(q_dot)
    if speed[0] > MOVING * speed.max():
        turns = np.flatnonzero(np.diff(np.sign(q_dot)))
        start = record.decay.t[0] + turns[turns > 0][0] * record.motion.grid.step
        raise ValueError(
            f"decay {i} starts at {speed[0] / speed.max():.0%} of its largest speed, and a beam is"
            f" let go from rest: start at a turning point, such as decay.between({start:.4g})"
        )


def _count(n: int, thing: str) -> str:
    return f"{n} {thing}" if n == 1 else f"{n} {thing}s"


def _conversion(unit: str) -> str:
    """What a user does with a decay in another unit."""
    try:
        known = parse_unit(unit)
    except ValueError:
        known = None
    if known is None or known.base != "m" or known.quantity != "displacement":
        return "give the displacements of the sensors, Decay(t, q, unit='m')"
    return f"give Decay(t, {known.factor:g} * q, unit='m')"
