"""What rings in the channels of free decays, and may be a coordinate: harmonics by themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from romsindy.record.beating import REACH, Waves, beating
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.vibrations import Vibration, find_vibrations, vibrations_of
from romsindy.typing import Array

# In another decay it is the same vibration where its frequency is so near, as a ratio.
NEAR = 1.25

_Channel = tuple[list[Vibration], list[Vibration]]  # what rings, and harmonics of it


def tones_of(decay: Decay) -> list[list[Vibration]]:
    """All that rings in each channel, harmonics by themselves: one may be a mode in resonance.

    Strongest first, harmonics behind; nothing that is steady, as hum is.
    """
    return [
        [v for some in channel for v in sorted(some, key=lambda v: -v.share)]
        for channel in _heard(decay)
    ]


def _heard(decay: Decay) -> list[_Channel]:
    """What rings in each channel; where two vibrations ring as one they are told apart."""
    dt, signals = decay.dt, decay.signal.reshape(len(decay.t), -1)
    found = [_tones(x, dt, decay.derivative) for x in signals.T]
    strongest = sorted((v for alone, _ in found for v in alone), key=lambda v: -v.share)
    power = np.sum(np.abs(np.fft.rfft(signals, axis=0)) ** 2, axis=1)
    # Where they beat, no ridge may have been followed at all.
    places = [(1 + int(np.argmax(power[1:]))) / dt / len(signals)]
    for v in strongest:
        if all(_far(v, place) for place in places):
            places.append(v.mean_frequency)
    for waves in (w for place in places if (w := beating(signals, dt, place))):
        if not any(waves.are_among([v.small_frequency for v in alone]) for alone, _ in found):
            found = [
                _apart(waves, i, channel, signals[:, i], decay) for i, channel in enumerate(found)
            ]
    return found


def _apart(waves: Waves, i: int, channel: _Channel, x: Array, decay: Decay) -> _Channel:
    """The vibrations of a channel, with two that beat in the place of what was followed there."""
    middle, t = float(waves.frequencies.mean()), decay.dt * np.arange(len(x))
    alone, harmonics = ([v for v in some if _far(v, middle)] for some in channel)
    rest = x - sum((v(t) for v in (*alone, *harmonics)), np.zeros(len(x)))
    two = vibrations_of(waves.tones(i, rest, decay.dt), x, decay.dt, decay.derivative)
    return [*alone, *two], harmonics


def _far(vibration: Vibration, frequency: float) -> bool:
    """Whether it is another than those that beat about a frequency, Hz."""
    return abs(float(np.log(vibration.mean_frequency / frequency))) > REACH


def _tones(x: Array, dt: float, derivative: int) -> _Channel:
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
    several = [_heard(d) for d in decays]
    channels = [channel for found in several for channel in found]
    most = max(
        channels, key=lambda found: (len(found[0] + found[1]), sum(v.share for v in found[0]))
    )
    own = [v for some in most for v in some]
    heard = {v: np.zeros(len(decays)) for v in own}
    for i, found in enumerate(several):
        for v in (v for both in found for some in both for v in some):
            nearest = min(own, key=partial(_off, v))
            if _off(v, nearest) < np.log(NEAR):
                heard[nearest][i] = max(heard[nearest][i], v.share)
    ranks = {v: (-float(heard[v].min()), -v.share) for v in own}
    return [v for some in most for v in sorted(some, key=lambda v: ranks[v])]


def _off(one: Vibration, other: Vibration) -> float:
    """Logarithm of the ratio of their frequencies."""
    return abs(float(np.log(one.small_frequency / other.small_frequency)))


def names_of(vibrations: Sequence[Vibration]) -> str:
    """Such as "12.4 Hz, 24.7 Hz"."""
    return ", ".join(f"{v.small_frequency:.4g} Hz" for v in vibrations) or "nothing"


def require_channels(decays: Sequence[Decay | ForcedVibration], count: int) -> None:
    """All decays with so many channels.

    Raises
    ------
    ValueError
        If one has others.
    """
    for i, decay in enumerate(decays):
        if decay.n_channels != count:
            raise ValueError(
                f"decay {i} has {decay.n_channels} channels, others {count}: give the same of all"
            )
