"""What changes with time, comes from outside, or sits in the sensor."""

from __future__ import annotations

import math

import numpy as np
from hidden import Hidden


def _drift(name, at):
    k, p = 2 * at.frequency * at.sign(), at.rng.uniform(0.8, 1.25)
    begin, total = at.spans[0][0], at.duration
    force = lambda t, q, v, side, z: k * ((t - begin) / total) ** p * q  # noqa: E731
    return Hidden(name, {"strength": k, "exponent": p}, force)


def _sudden(name, at):
    k = 2 * at.frequency * at.sign()
    # not in the last record: it may be held out
    start, end = at.spans[at.rng.integers(max(len(at.spans) - 1, 1))]
    when = start + at.rng.uniform(0.1, 0.65) * (end - start)
    truth = {"strength": k, "time": when}
    force = lambda t, q, v, side, z: k * q if side[0] > 0 else 0.0  # noqa: E731
    return Hidden(name, truth, force, [lambda t, q, v: t - when])


def _base(name, at):
    w = at.rng.choice([at.rng.uniform(0.25, 0.85), at.rng.uniform(1.2, 2.7)])
    phase = at.rng.uniform(0, 2 * np.pi)
    f = at.reading * abs(1 - w**2)
    force = lambda t, q, v, side, z: f * math.cos(w * t + phase)  # noqa: E731
    return Hidden(name, {"strength": f, "frequency": w}, force)


def _hum(name, at):
    size, phase = at.reading, at.phases()
    line = lambda t, record: size * np.cos(at.mains * t + phase[record])  # noqa: E731
    truth = {"size": size, "frequency": at.mains}
    return Hidden(name, truth, reading=lambda t, q, record: q + line(t, record))


def _second_mode(name, at):
    w, zeta = at.rng.uniform(1.7, 6.8), at.rng.uniform(0.001, 0.02)
    size, phase = 2 * at.reading, at.phases()

    def reading(t, q, record):
        t = t - t[0]
        return q + size * np.exp(-zeta * w * t) * np.cos(w * t + phase[record])

    return Hidden(name, {"size": size, "frequency": w, "damping_ratio": zeta}, reading=reading)


def _bias(name, at):
    b = at.reading * at.sign()
    return Hidden(name, {"strength": b}, reading=lambda t, q, record: q + b)


def _gain(name, at):
    g = 1 + 2 * at.reading * at.sign()
    return Hidden(name, {"gain": g}, reading=lambda t, q, record: g * q)


def _saturation(name, at):
    limit = {"weak": 0.97, "medium": 0.9, "strong": 0.8}[at.strength] + at.rng.uniform(-0.02, 0.02)
    return Hidden(name, {"limit": limit}, reading=lambda t, q, record: np.clip(q, -limit, limit))


def _sensor(name, at):
    b, n = at.reading * at.sign(), int(at.rng.choice([2, 3]))
    return Hidden(name, {"strength": b, "power": n}, reading=lambda t, q, record: q + b * q**n)


MAKERS = {
    "drift": _drift,
    "sudden_change": _sudden,
    "base_excitation": _base,
    "mains_hum": _hum,
    "second_mode": _second_mode,
    "bias": _bias,
    "gain": _gain,
    "saturation": _saturation,
    "sensor_nonlinearity": _sensor,
}
# What only a displacement shows: a velocity has another zero, scale and limit.
OF_A_DISPLACEMENT = ("bias", "gain", "saturation", "sensor_nonlinearity", "constant_force")
