"""Measured decays, ready to be compared with a simulation."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from romsindy.effects.base import Scales
from romsindy.fit.collocation import Grid, Trajectory
from romsindy.fit.verdict import QUIET, RELEASED
from romsindy.record.decay import Decay
from romsindy.record.faults import clipped
from romsindy.record.noise import Noise
from romsindy.record.signals import noise_std
from romsindy.record.smoothing import HarmonicSpline, swing
from romsindy.record.spectrum import Line
from romsindy.typing import Array, Indices

_LEAST_STEPS, _MOST_STEPS = 30, 60  # per cycle
# Of a comb of lines: which line may be its first harmonics, the highest, and combs to be tried.
_STRONGEST, _HIGHEST, _COMBS = 3, 6, 2
_LOUDER = 1.1  # so far the level of white noise is known


@dataclass(frozen=True)
class Record:
    """One decay: what was measured, its noise, and the smooth motion behind it.

    Attributes
    ----------
    decay : Decay
    signal : (n,) array
        The measured quantity.
    valid : (n,) array of bool
        False where the sensor was at the end of its range: such samples may be left out.
    noise : Noise
    spline : HarmonicSpline
        Of the signal.
    motion : Trajectory
        Smooth displacement on the steps of the simulation; times from the start of the record.
    part : (n,) array of bool, optional
        Which of the whitened samples take part in a fit or a comparison; all by default. The
        motion goes through the others all the same.
    """

    decay: Decay
    signal: Array
    valid: NDArray[np.bool_]
    noise: Noise
    spline: HarmonicSpline
    motion: Trajectory
    part: NDArray[np.bool_] | None = None

    @classmethod
    def of(cls, decay: Decay, floor: float) -> Record:
        """Look at a decay; ``floor`` is the least noise, as a part of the largest amplitude.

        What other vibrations left in it counts beside that.
        """
        decay = decay.single()
        t = decay.t - decay.t[0]
        signal = decay.signal
        spline = HarmonicSpline.fit(t, signal)
        cycle = t[-1] * 2 * np.pi / float(spline.phase(t[-1]) - spline.phase(0.0))
        peak = float(np.abs(signal).max())
        least = float(np.hypot(floor * peak, decay.leftover))
        rest, envelope = signal - spline(t)[0], np.abs(spline.amplitudes(t)[:, 1])
        noise = Noise.of(rest, spline.midline(t), envelope, cycle, decay.dt, least)
        displacement = spline if decay.derivative == 0 else HarmonicSpline.fit(t, decay.q)
        shortest = 2 * np.pi / float(spline.phase(t, 1).max())
        grid = Grid.over(t, shortest, _steps_per_cycle(noise.std / peak))
        valid = np.ones(len(t), bool)
        return cls(decay, signal, valid, noise, spline, _motion(grid, displacement))

    @classmethod
    def loud(cls, decay: Decay, floor: float) -> Record:
        """Look at the part of a decay between its release and where it is too small to matter.

        Unlike `Decay.free`, an offset stays, and growth is accepted: either may be an effect.

        Raises
        ------
        ValueError
            If less than three cycles stand out of the noise.
        """
        decay = decay.single()
        white = noise_std(decay.signal)
        record = cls.of(_loud(decay, white), floor)
        # Coloured noise is louder than it seems from its quietest part.
        loud = record.noise.std > _LOUDER * white
        return cls.of(_loud(decay, record.noise.std), floor) if loud else record

    @property
    def t(self) -> Array:
        """Times from the start of the record, s."""
        return self.decay.t - self.decay.t[0]

    @property
    def clock(self) -> float:
        """Time of the start of the record as it was recorded, s."""
        return float(self.decay.t[0])

    @property
    def derivative(self) -> int:
        """0, 1, 2 where displacement, velocity or acceleration was measured."""
        return self.decay.derivative

    def phase(self, t: Array) -> Array:
        """Phase of the displacement at times from the start, rad; 0 where q crosses 0 upwards."""
        # q is a sine of its phase; each derivative leads by a quarter of a cycle.
        return np.asarray(self.spline.phase(t)) - self.derivative * np.pi / 2

    @cached_property
    def cycles(self) -> Indices:
        """First sample of every cycle, by the phase of the smooth motion."""
        turn = np.floor(self.phase(self.t) / (2 * np.pi))
        return np.flatnonzero(np.diff(turn) > 0) + 1

    @property
    def amplitude(self) -> float:
        """Largest displacement."""
        return float(np.abs(self.motion.q).max())

    @property
    def rate(self) -> float:
        """Mean angular frequency, rad/s."""
        return float(self.phase(self.t[-1:])[0] - self.phase(self.t[:1])[0]) / float(self.t[-1])

    @property
    def count(self) -> float:
        """Samples that tell anything; of noise beyond a filter, which is none, few do."""
        valid = self.valid if self.part is None else self.valid & self.part
        return float(np.sum(valid)) * self.noise.share(len(self.signal))

    def until(self, end: float) -> Record:
        """The first seconds of the record, with the noise of all of it."""
        m, grid = self.motion, self.motion.grid.until(end)
        n, steps = len(grid.fraction), grid.n_steps
        motion = Trajectory(grid, m.q[: steps + 1], m.q_dot[: steps + 1], m.q_ddot[:steps])
        decay = self.decay.between(end=float(self.decay.t[n - 1]))
        return Record(decay, self.signal[:n], self.valid[:n], self.noise, self.spline, motion)

    def without_faults(self) -> Record:
        """The same for a fit that looks for none: clipped samples take no part, lines are noise."""
        return replace(self, valid=~clipped(self.signal), noise=self.noise.weighing_alike())

    def with_signal(self, signal: Array) -> Record:
        """The same with another measurement, such as a simulated one."""
        return replace(self, signal=signal)

    def whitened(self, x: Array) -> Array:
        """Misfits or their derivatives (n, ...) over the noise, made white."""
        valid = self.valid if x.ndim == 1 else self.valid[:, None]
        white = self.noise(x * valid)
        if self.part is None:
            return white
        # White samples are independent: those left out tell nothing about the others.
        return white * (self.part if x.ndim == 1 else self.part[:, None])


def _steps_per_cycle(noise_share: float) -> int:
    """Steps that keep the error of the integration, of order six, at about 1 % of the noise."""
    steps = 20 * (0.01 / max(noise_share, 1e-12)) ** (1 / 6)
    return int(np.clip(steps, _LEAST_STEPS, _MOST_STEPS))


def _loud(decay: Decay, noise: float) -> Decay:
    x = decay.signal
    centred, cycle = swing(x)
    envelope = np.sqrt(np.maximum(uniform_filter1d(centred**2, cycle, mode="mirror"), 0.0))
    top = int(np.argmax(envelope))
    first = 0
    if envelope[:cycle].max() < RELEASED * envelope[top]:  # held, or pushed, before the release
        near = slice(max(top - cycle, 0), top + cycle)
        first = near.start + int(np.argmax(np.abs(centred[near])))
    quiet = max(QUIET * envelope[top], 2 * noise)
    above = np.flatnonzero(envelope > quiet)
    if len(above) == 0 or above[-1] - first < 3 * cycle:
        raise ValueError(
            f"the vibration stands out of the noise (rms {noise:.2g}) for less than three"
            " cycles: it is noise, or another channel vibrates"
        )
    return decay.between(decay.t[first], decay.t[above[-1]])


def _motion(grid: Grid, spline: HarmonicSpline) -> Trajectory:
    ends = spline(grid.start + grid.step * np.arange(grid.n_steps + 1))
    inside = spline(grid.node_times(0, grid.n_steps).ravel())[2]
    # Real parts of complex arrays lie apart in memory, and are moved together on the way to another
    # process: sums would be rounded in another order there.
    q, q_dot, q_ddot = (np.ascontiguousarray(x) for x in (ends[0], ends[1], inside))
    return Trajectory(grid, q[:, None], q_dot[:, None], q_ddot.reshape(-1, 3, 1))


def scales(records: Sequence[Record]) -> Scales:
    """Scales of all records together, without lines."""
    longest = max(records, key=lambda r: r.t[-1])
    n_turns = longest.spline.phase(longest.t[-1]) - longest.spline.phase(0.0)
    spans = tuple((r.clock, r.clock + float(r.t[-1])) for r in records)
    in_turn = all(a[1] < b[0] for a, b in itertools.pairwise(sorted(spans)))
    return Scales(
        max(r.amplitude for r in records),
        float(n_turns / longest.t[-1]),
        float(longest.t[-1]),
        spans=spans if in_turn and len(spans) > 1 else (),
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


def combs(lines: Sequence[Line], t: Array) -> tuple[tuple[float, int], ...]:
    """Lines that are harmonics of one frequency: that in rad/s, and the number of the highest.

    Any of the strongest may be the first, second or third harmonic, whichever leaves fewest alone.
    """
    width = 1 / (t[-1] - t[0])  # Hz, of a line
    found: dict[tuple[int, ...], tuple[float, int]] = {}
    for line, number in itertools.product(lines[:_STRONGEST], (1, 2, 3)):
        first = line.frequency / number
        order = np.array([other.frequency / first for other in lines])
        nearest = np.round(order)
        at = (np.abs(order - nearest) * first < (1 + nearest / number) * width) & (nearest > 0)
        at &= nearest <= _HIGHEST
        if np.count_nonzero(at) > 1:
            members = tuple(map(int, np.flatnonzero(at)))
            found.setdefault(members, (2 * np.pi * first, int(nearest[at].max())))
    whole = [m for m in found if not any(set(m) < set(other) for other in found)]
    return tuple(found[m] for m in sorted(whole, key=len, reverse=True)[:_COMBS])
