"""Two vibrations so near in frequency that they ring as one: told apart by how they beat.

Cycle by cycle the channels show the sum of both. Where each is a damped wave with a shape of its
own, four numbers make the whole beat: a frequency and a damping of each. They follow from how the
space of these waves turns on by a cycle (ESPRIT, R. Roy, T. Kailath, IEEE Trans. Acoust. Speech
Signal Process. 37, 1989, 984), with all channels together, and need no window longer than a beat.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import make_interp_spline
from scipy.signal import fftconvolve

from romsindy.record.ridges import Ridge, refined
from romsindy.typing import Array

# Cycles of a window, which takes no notice of what is a quarter of the frequency away, and from one
# to the next: no beat is missed. At most so many windows turn on together.
_CYCLES, _STEP, _ROWS = 8, 2, 200
# Of what beats, two damped waves leave so much at most: more, and frequencies move too much.
_LEFT = 0.25
# Beats that must have been heard, and the least of a beat, in e-folds of the waves: closer ones
# ring as one.
_BEATS, _FOLDS = 1.5, 3.0
# E-folds by which each falls, at least, over the record: what is steady, as hum is, is no mode.
_FALLS = 0.1
# Of their distance: what is as near to one of them is the same vibration.
_SAME = 0.25
# How far from the middle they may lie.
REACH = 0.1
# Power of a line of what has another shape over the median of those round it: as of any vibration.
_OWN = 25.0


class Waves(NamedTuple):
    """Two damped waves in c channels: the sum of Re shapes exp(poles t).

    ``poles`` (2,) are complex, rad/s, the slower first; ``shapes`` (c, 2) complex, in the unit of
    the channels.
    """

    poles: Array
    shapes: Array

    @property
    def frequencies(self) -> Array:
        """Hz, (2,)."""
        return self.poles.imag / (2 * np.pi)

    def are_among(self, frequencies: Sequence[float]) -> bool:
        """Whether others, Hz, are as near to both as their distance tells: they were told apart."""
        off = np.abs(np.subtract.outer(self.frequencies, np.array([*frequencies, np.inf])))
        return bool(np.all(off.min(axis=1) < _SAME * np.ptp(self.frequencies)))

    def tones(self, channel: int, rest: Array, dt: float) -> list[Ridge]:
        """The two in one channel, fitted to it (n,): they may drift a little."""
        seconds, found = dt * (len(rest) - 1), []
        for pole, size in zip(self.poles, self.shapes[channel], strict=True):
            t = np.linspace(0, seconds, max(int(pole.imag * seconds / (2 * np.pi)), 4))
            z, frequency = size * np.exp(pole.real * t), np.full(len(t), pole.imag / (2 * np.pi))
            phase = make_interp_spline(t[[0, -1]], pole.imag * t[[0, -1]], k=1)
            track = (t, frequency, np.abs(z), 0.0, seconds)
            found.append(Ridge(*track, phase, make_interp_spline(t, z, k=3)))
        return [ridge.from_its_start() for ridge in refined(found, rest, dt)]


def beating(signals: Array, dt: float, frequency: float) -> Waves | None:
    """The two vibrations near a frequency, Hz, in channels (n, c); None where there is one.

    In one channel nothing tells whether both have a shape of their own: there it is None as well.
    """
    size = round(_CYCLES / frequency / dt)
    if signals.shape[1] < 2 or len(signals) < 4 * size:
        return None
    step = max(_STEP * size // _CYCLES, 1)
    z = _envelope(signals, dt, frequency, size)[::step]
    t = dt * (step * np.arange(len(z)) + (size - 1) / 2)
    rates = _rates(z) / (step * dt)
    waves = np.exp(np.outer(t, rates))
    shapes = np.linalg.lstsq(waves, z, rcond=None)[0].T
    left = np.linalg.norm(z - waves @ shapes.T) / np.linalg.norm(z)
    seconds, apart, falls = len(signals) * dt, float(np.ptp(rates.imag)), -rates.real
    near = float(np.max(np.abs(rates.imag))) < REACH * 2 * np.pi * frequency
    beats = apart * seconds > 2 * np.pi * _BEATS and apart > _FOLDS * falls.max()
    ring = near and beats and falls.min() * seconds > _FALLS
    if not (ring and left < _LEFT and _have_shapes(z)):
        return None
    order = np.argsort(rates.imag)
    return Waves(rates[order] + 2j * np.pi * frequency, shapes[:, order])


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
    power = power[np.abs(np.fft.fftfreq(len(z), _STEP)) < 2 * REACH]
    return bool(power.max() > _OWN * np.median(power))
