"""Decays that cannot be those of the beam and its sensors are refused, with a remedy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from romsindy.beam.motion import SensorArray
from romsindy.diagnosis.on_beam.instrumented import signals_of
from romsindy.record.decay import Decay
from romsindy.record.units import parse_unit


def checked_readings(decay: Decay, i: int, sensors: SensorArray, length: float) -> Decay:
    """Return a decay, number ``i`` in messages, with one column per sensor, in m and s.

    Raises
    ------
    ValueError
        For another number of channels, or another unit than m.
    """
    channels, n = decay.n_channels, len(sensors.sensors)
    if channels != n:
        are = "is" if n == 1 else "are"
        raise ValueError(
            f"decay {i} has {_count(channels, 'channel')}, but there {are} {_count(n, 'sensor')}:"
            " give one channel per sensor, in the order of the sensors"
        )
    if decay.unit not in (None, "m"):
        raise ValueError(f"decay {i} is in {decay.unit}, the beam in m: {_conversion(decay.unit)}")
    largest = float(np.abs(decay.q).max())
    if largest > length:
        raise ValueError(
            f"decay {i} reaches {largest:.3g} m, the beam is {length:.3g} m long: if it is in mm,"
            " give Decay(t, 0.001 * q, unit='m')"
        )
    signals = {n: x.reshape(len(decay.t), -1) for n, x in signals_of(decay).items()}
    return replace(decay, unit="m", **signals)


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
