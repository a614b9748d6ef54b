"""What rings in the channels of free decays, and may be a coordinate: harmonics by themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.vibrations import Vibration, find_vibrations
from romsindy.typing import Array

# In another decay it is the same vibration where its frequency is so near, as a ratio.
NEAR = 1.25


def tones_of(x: Array, dt: float, derivative: int) -> list[Vibration]:
    """All that rings in a channel (n,), harmonics by themselves: one may be a mode in resonance.

    Strongest first, harmonics behind; nothing that is steady, as hum is.
    """
    alone, harmonics = _tones(x, dt, derivative)
    return [v for some in (alone, harmonics) for v in sorted(some, key=lambda v: -v.share)]


def _tones(x: Array, dt: float, derivative: int) -> tuple[list[Vibration], list[Vibration]]:
    """Vibrations of a channel, and their harmonics by themselves."""
    t = dt * np.arange(len(x))
    found = [v for v in find_vibrations(x, dt, derivative) if not v.steady]
    harmonics = []
    for v in found:
        for _, ridge in v.harmonics:
            share = min(dt * float(np.sum(ridge(t) ** 2)) / v.signal, 1.0)
            moved = ridge.amplitude / (2 * np.pi * ridge.frequency) ** derivative
            energy = v.energy * float(np.sum(moved**2) / np.sum(v.displacement**2))
            harmonics.append(Vibration(ridge, (), energy, share, derivative))
    alone = [v for w in found for v in (w, *(other for _, other in w.carried))]
    return [replace(v, harmonics=(), carried=()) for v in alone], harmonics


def ringing_in(decays: Sequence[Decay]) -> list[Vibration]:
    """What rings in the channel in which most does, strongest first, harmonics behind.

    What is weak in one of the decays is weak: a coordinate rings in all, ghosts do not.
    """
    require_channels(decays, decays[0].n_channels)
    several = [
        [_tones(x, d.dt, d.derivative) for x in d.signal.reshape(len(d.t), -1).T] for d in decays
    ]
    channels = [channel for found in several for channel in found]
    most = max(
        channels, key=lambda found: (len(found[0] + found[1]), sum(v.share for v in found[0]))
    )
    own = [v for some in most for v in some]
    heard = {v: np.zeros(len(decays)) for v in own}
    for i, found in enumerate(several):
        for v in (v for both in found for some in both for v in some):
            nearest = min(own, key=partial(_apart, v))
            if _apart(v, nearest) < np.log(NEAR):
                heard[nearest][i] = max(heard[nearest][i], v.share)
    ranks = {v: (-float(heard[v].min()), -v.share) for v in own}
    return [v for some in most for v in sorted(some, key=lambda v: ranks[v])]


def _apart(one: Vibration, other: Vibration) -> float:
    """Logarithm of the ratio of their frequencies."""
    return abs(float(np.log(one.small_frequency / other.small_frequency)))


def names_of(vibrations: Sequence[Vibration]) -> str:
    """Such as "12.4 Hz, 24.7 Hz"."""
    return ", ".join(f"{v.small_frequency:.4g} Hz" for v in vibrations) or "nothing"


def require_channels(decays: Sequence[Decay | ForcedVibration], count: int) -> None:
    """All decays with so many channels.

    Raises a ValueError if one has others.
    """
    for i, decay in enumerate(decays):
        if decay.n_channels != count:
            raise ValueError(
                f"decay {i} has {decay.n_channels} channels, others {count}: give the same of all"
            )
