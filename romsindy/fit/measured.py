"""Measured decays, ready to be compared with a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from romsindy.effects.base import Scales
from romsindy.fit.collocation import Grid, Trajectory
from romsindy.record.decay import Decay
from romsindy.record.signals import noise_std
from romsindy.record.smoothing import HarmonicSpline, Whitener, swing
from romsindy.typing import Array

_DERIVATIVE = {"displacement": 0, "velocity": 1, "acceleration": 2}
_STEPS_PER_CYCLE = 30
# What vibrates below this part of the largest amplitude is not looked at.
_QUIET = 0.01
# A record starts with its decay if its first cycle is this large a part of the largest.
_RELEASED = 0.8


@dataclass(frozen=True)
class Measured:
    """One decay: what was measured, its noise, and the smooth motion behind it.

    Attributes
    ----------
    decay : Decay
    signal : (n,) array
        The measured quantity.
    derivative : int
        0, 1, 2 for displacement, velocity, acceleration.
    noise : Whitener
    spline : HarmonicSpline
        Of the signal.
    motion : Trajectory
        Smooth displacement on the steps of the simulation; times from the start of the record.
    """

    decay: Decay
    signal: Array
    derivative: int
    noise: Whitener
    spline: HarmonicSpline
    motion: Trajectory

    @classmethod
    def of(cls, decay: Decay, floor: float) -> Measured:
        """Look at a decay; ``floor`` is the least noise, as a part of the largest amplitude."""
        decay = _loud(decay.single())
        t = decay.t - decay.t[0]
        derivative = _DERIVATIVE[decay.measured]
        signal = np.asarray((decay.q, decay.q_dot, decay.q_ddot)[derivative], float)
        spline = HarmonicSpline.fit(t, signal)
        n_cycles = (spline.phase(t[-1]) - spline.phase(0.0)) / (2 * np.pi)
        rest = signal - spline(t)[0]
        noise = Whitener.of(rest, len(t) / n_cycles, floor * float(np.abs(signal).max()))
        displacement = spline if derivative == 0 else HarmonicSpline.fit(t, decay.q)
        fastest = float(spline.phase(t, 1).max())
        grid = Grid.over(t, 2 * np.pi / fastest, _STEPS_PER_CYCLE)
        return cls(decay, signal, derivative, noise, spline, _motion(grid, displacement))

    @property
    def t(self) -> Array:
        """Times from the start of the record, s."""
        return self.decay.t - self.decay.t[0]

    def early(self, part: float) -> Measured:
        """The first part of the record, such as 0.4 of it."""
        end = part * self.t[-1]
        grid = self.motion.grid.until(end)
        n, m = len(grid.fraction), self.motion
        motion = Trajectory(
            grid, m.q[: grid.n_steps + 1], m.q_dot[: grid.n_steps + 1], m.q_ddot[: grid.n_steps]
        )
        decay = self.decay.between(end=self.decay.t[n - 1])
        return replace(self, decay=decay, signal=self.signal[:n], motion=motion)

    @property
    def amplitude(self) -> float:
        """Largest displacement."""
        return float(np.abs(self.motion.q).max())


def _loud(decay: Decay) -> Decay:
    """The part between the release and where the vibration is too small to matter."""
    x = np.asarray((decay.q, decay.q_dot, decay.q_ddot)[_DERIVATIVE[decay.measured]])
    centred, cycle = swing(x)
    envelope = np.sqrt(np.maximum(uniform_filter1d(centred**2, cycle, mode="mirror"), 0.0))
    top = int(np.argmax(envelope))
    first = 0
    if envelope[:cycle].max() < _RELEASED * envelope[top]:  # held, or pushed, before the release
        near = slice(max(top - cycle, 0), top + cycle)
        first = near.start + int(np.argmax(np.abs(centred[near])))
    quiet = max(_QUIET * envelope[top], 2 * noise_std(x))
    loud = np.flatnonzero(envelope > quiet)
    if len(loud) == 0 or loud[-1] - first < 3 * cycle:
        raise ValueError(
            f"the vibration stands out of the noise (rms {noise_std(x):.2g}) for less than three"
            " cycles: it is noise, or another channel vibrates"
        )
    return decay.between(decay.t[first], decay.t[loud[-1]])


def _motion(grid: Grid, spline: HarmonicSpline) -> Trajectory:
    ends = spline(grid.start + grid.step * np.arange(grid.n_steps + 1))
    inside = spline(grid.node_times(0, grid.n_steps).ravel())[2]
    return Trajectory(grid, ends[0], ends[1], inside.reshape(-1, 3))


def scales(records: Sequence[Measured]) -> Scales:
    """Scales of all records together, with the strongest lines beside the harmonics."""
    longest = max(records, key=lambda r: r.t[-1])
    n_turns = longest.spline.phase(longest.t[-1]) - longest.spline.phase(0.0)
    return Scales(
        max(r.amplitude for r in records), float(n_turns / longest.t[-1]), float(longest.t[-1])
    )


def strongest_tones(t: Array, x: Array, count: int, apart: float) -> list[float]:
    """Angular frequencies of the strongest lines of a signal, rad/s.

    Parameters
    ----------
    t : array
        Uniform times, s.
    x : (n,) array
        Tapered.
    count : int
    apart : float
        Least distance of two lines, rad/s.
    """
    n = 8 * len(x)
    step = 2 * np.pi / (n * (t[1] - t[0]))
    power = np.abs(np.fft.rfft(x, n)) ** 2
    power[: 8 * 2] = power[-1] = 0.0  # two cycles a record at least
    found = []
    for _ in range(count):
        k = int(np.argmax(power))
        if not 0 < k < len(power) - 1 or power[k] <= 0:
            break
        a, b, c = np.log(power[k - 1 : k + 2] + 1e-300)
        shift = 0.5 * (a - c) / (a - 2 * b + c) if a - 2 * b + c < 0 else 0.0
        found.append(float(step * (k + np.clip(shift, -1, 1))))
        width = max(int(apart / step), 16)
        power[max(k - width, 0) : k + width] = 0.0
    return found
