"""What rings in the channels of free decays, and may be a coordinate: harmonics by themselves.

Two vibrations so near in frequency that they ring as one are told apart by how they beat. Cycle by
cycle the channels show the sum of both. Where each is a damped wave with a shape of its own, two
poles make the whole beat: they follow from how the space of these waves turns on with time [1], of
all channels together, and need no window longer than a beat.

[1] R. Roy, T. Kailath, ESPRIT, IEEE Trans. Acoust. Speech Signal Process. 37 (1989) 984.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import fftconvolve

from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.ridges import Ridge, refined
from romsindy.record.vibrations import Vibration, find_vibrations, vibrations_of
from romsindy.typing import Array

# In another decay it is the same vibration where its frequency is so near, as a ratio.
NEAR = 1.25
# Cycles of a window, which takes no notice of what is a quarter of the frequency away, and from one
# to the next: no beat is missed. At most so many windows turn on together.
_CYCLES, _STEP, _ROWS = 8, 2, 200
# Of what beats, two damped waves leave so much at most: more, and frequencies move too much. Beats
# that must have been heard, and the least distance in e-folds of the waves in as much time: closer
# ones ring as one. The second numbers are for one channel, where no shapes tell them apart.
_LEFT, _BEATS, _FOLDS = (0.25, 0.12), 1.5, (3.0, 5.0)
# E-folds by which a wave falls, at least, over the record: what is steady, as hum is, is no mode.
_FALLS = 0.1
# Of their distance: what is as near to one of them is the same vibration.
_SAME = 0.25
# Of decays in which vibrations beat, so much is left out at their start, where nothing is followed.
LOUD = (0.25, 0.4)
# How far from the middle they may lie.
_REACH = 0.1
# Power of a line of what has another shape over the median of those round it: as of any vibration.
_OWN = 25.0
# Of what a channel shows: it rings there, whatever rings elsewhere.
_MOST = 0.5

_Channel = tuple[list[Vibration], list[Vibration]]  # what rings, and harmonics of it


def tones_of(decay: Decay) -> list[list[Vibration]]:
    """All that rings in each channel, harmonics by themselves: one may be a mode in resonance.

    Strongest first, harmonics behind; nothing that is steady, as hum is.
    """
    return [
        [v for some in channel for v in sorted(some, key=lambda v: -v.share)]
        for channel in _heard(decay)
    ]


@lru_cache(maxsize=16)  # every number of coordinates asks again
def _heard(decay: Decay) -> list[_Channel]:
    """What rings in each channel, or where nothing is followed while it is loud, what does later.

    Large, vibrations that beat move too much in frequency.
    """
    whole = _heard_in(decay)
    if any(alone for alone, _ in whole):
        return whole
    for part in LOUD:
        later = decay.between(decay.t[0] + part * (decay.t[-1] - decay.t[0]))
        late, found = float(later.t[0] - decay.t[0]), _heard_in(later)
        if any(alone for alone, _ in found):
            return [(_later(alone, late), _later(others, late)) for alone, others in found]
    return whole


def _later(several: Sequence[Vibration], seconds: float) -> list[Vibration]:
    return [replace(v, tone=v.tone.later(seconds)) for v in several]


def _heard_in(decay: Decay) -> list[_Channel]:
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
    for waves in (w for place in places if (w := _beating(signals, dt, place))):
        if not any(waves.are_among([v.small_frequency for v in alone]) for alone, _ in found):
            found = [
                _apart(waves, i, channel, signals[:, i], decay) for i, channel in enumerate(found)
            ]
    return found


def _apart(waves: _Waves, i: int, channel: _Channel, x: Array, decay: Decay) -> _Channel:
    """The vibrations of a channel, with two that beat in the place of what was followed there."""
    middle, t = float(waves.frequencies.mean()), decay.dt * np.arange(len(x))
    alone, harmonics = ([v for v in some if _far(v, middle)] for some in channel)
    rest = x - sum((v(t) for v in (*alone, *harmonics)), np.zeros(len(x)))
    two = vibrations_of(waves.tones(i, rest, decay.dt), x, decay.dt, decay.derivative)
    return [*alone, *two], harmonics


def _far(vibration: Vibration, frequency: float) -> bool:
    """Whether it is another than those that beat about a frequency, Hz."""
    return abs(float(np.log(vibration.mean_frequency / frequency))) > _REACH


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

    What is most of another channel is among them: a mode may ring there alone. What is weak in one
    of the decays is weak: a coordinate rings in all, ghosts do not.
    """
    require_channels(decays, decays[0].n_channels)
    several = [_heard(d) for d in decays]
    channels = [channel for found in several for channel in found]
    most = max(
        channels, key=lambda found: (len(found[0] + found[1]), sum(v.share for v in found[0]))
    )
    alone, behind = [*most[0]], most[1]
    for v in (v for rings, _ in channels for v in rings if v.share > _MOST):
        if all(_off(v, other) >= np.log(NEAR) for other in alone + behind):
            alone.append(v)
    own = alone + behind
    heard = {v: np.zeros(len(decays)) for v in own}
    for i, found in enumerate(several):
        for v in (v for both in found for some in both for v in some):
            nearest = min(own, key=partial(_off, v))
            if _off(v, nearest) < np.log(NEAR):
                heard[nearest][i] = max(heard[nearest][i], v.share)
    ranks = {v: (-float(heard[v].min()), -v.share) for v in own}
    return [v for some in (alone, behind) for v in sorted(some, key=lambda v: ranks[v])]


def beside(decay: Decay, frequencies: Array) -> float:
    """Largest acceleration of what rings beside some frequencies (Hz), over that of what has them.

    Of vibrations that were subtracted before as well. Harmonics do not count, nor what is faint.
    """
    own, others = 0.0, [0.0]
    for v in (v for channel in _heard(decay) for v in channel[0]):
        if np.min(np.abs(np.log(v.mean_frequency / frequencies))) < np.log(NEAR):
            own = max(own, v.acceleration)
        elif not v.faint:
            others.append(v.acceleration)
    return max(decay.beside, max(others) / own if own else 0.0)


def _off(one: Vibration, other: Vibration) -> float:
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


# -- two that beat ---------------------------------------------------------------------------------


class _Waves(NamedTuple):
    """Two damped waves in c channels: the sum of Re shapes exp(poles t).

    ``poles`` (2,) are complex, rad/s, the slower first; ``shapes`` (c, 2) complex, in the unit of
    the channels; ``falling`` (2,) says which are not steady.
    """

    poles: NDArray[np.complex128]
    shapes: NDArray[np.complex128]
    falling: NDArray[np.bool_]

    @property
    def frequencies(self) -> Array:
        """Hz, (2,)."""
        return self.poles.imag / (2 * np.pi)

    def are_among(self, frequencies: Sequence[float]) -> bool:
        """Whether both ring, and others, Hz, are near to both: they were told apart before."""
        off = np.abs(np.subtract.outer(self.frequencies, np.array([*frequencies, np.inf])))
        near = off.min(axis=1) < _SAME * np.ptp(self.frequencies)
        return bool(np.all(near & self.falling))

    def tones(self, channel: int, rest: Array, dt: float) -> list[Ridge]:
        """Those that ring in one channel, fitted to it (n,): they may drift a little."""
        seconds, found = dt * (len(rest) - 1), []
        for pole, size in zip(self.poles, self.shapes[channel], strict=True):
            t = np.linspace(0, seconds, max(int(pole.imag * seconds / (2 * np.pi)), 4))
            z, frequency = size * np.exp(pole.real * t), np.full(len(t), pole.imag / (2 * np.pi))
            phase = make_interp_spline(t[[0, -1]], pole.imag * t[[0, -1]], k=1)
            track = (t, frequency, np.abs(z), 0.0, seconds)
            found.append(Ridge(*track, phase, make_interp_spline(t, z, k=3)))
        pairs = zip(self.falling, refined(found, rest, dt), strict=True)
        return [ridge.from_its_start() for falls, ridge in pairs if falls]


def _beating(signals: Array, dt: float, frequency: float) -> _Waves | None:
    """The two vibrations near a frequency, Hz, in channels (n, c); None where there is one.

    In one channel, where no shapes tell them from one whose frequency moves, they must fit better.
    """
    size = round(_CYCLES / frequency / dt)
    if len(signals) < 4 * size:
        return None
    step = max(_STEP * size // _CYCLES, 1)
    z = _envelope(signals, dt, frequency, size)[::step]
    t = dt * (step * np.arange(len(z)) + (size - 1) / 2)
    rates = _rates(z) / (step * dt)
    waves = np.exp(np.outer(t, rates))
    shapes = np.linalg.lstsq(waves, z, rcond=None)[0].T
    left = np.linalg.norm(z - waves @ shapes.T) / np.linalg.norm(z)
    seconds, apart = len(signals) * dt, float(np.ptp(rates.imag))
    alone, falling = signals.shape[1] == 1, -rates.real * seconds > _FALLS
    near = float(np.max(np.abs(rates.imag))) < _REACH * 2 * np.pi * frequency
    beats = apart * seconds > 2 * np.pi * _BEATS and apart > -_FOLDS[alone] * rates.real.min()
    two = left < _LEFT[alone] and (alone or _have_shapes(z))
    if not (near and beats and two and np.any(falling)):
        return None
    order = np.argsort(rates.imag)
    poles = rates[order] + 2j * np.pi * frequency
    wide = np.asarray(shapes[:, order], complex)
    return _Waves(np.asarray(poles, complex), wide, falling[order])


def _envelope(signals: Array, dt: float, frequency: float, size: int) -> Array:
    """Complex amplitudes of channels (n, c) at a frequency, in all windows of so many samples."""
    window = np.hanning(size)
    turned = signals * np.exp(-2j * np.pi * frequency * dt * np.arange(len(signals)))[:, None]
    return fftconvolve(turned, (2 / window.sum() * window)[:, None], "valid", axes=0)


def _rates(z: Array) -> Array:
    """Exponents, a sample, of the two waves that make most of series (m, c)."""
    rows = min(len(z) // 3, _ROWS)
    turned = sliding_window_view(z, rows, axis=0).reshape(-1, rows).T
    space = np.linalg.svd(turned, full_matrices=False)[0][:, :2]
    return np.log(np.linalg.eigvals(np.linalg.lstsq(space[:-1], space[1:], rcond=None)[0]))


def _have_shapes(z: Array) -> bool:
    """Whether series (m, c) hold a line beside what goes with one shape alone."""
    u, s, _ = np.linalg.svd(z, full_matrices=False)
    other = u[:, 1:] * s[1:]
    power = np.sum(np.abs(np.fft.fft(other * np.hanning(len(z))[:, None], axis=0)) ** 2, axis=1)
    power = power[np.abs(np.fft.fftfreq(len(z), _STEP)) < 2 * _REACH]
    return bool(power.max() > _OWN * np.median(power))
