"""Measured decays, ready to be compared with a simulation."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import prev_fast_len
from scipy.ndimage import uniform_filter1d

from romsindy.effects.base import SampledInput, Scales
from romsindy.fit.kernel.collocation import Grid, Trajectory
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.verdict import MIXED, QUIET, RELEASED
from romsindy.record.decay import Decay
from romsindy.record.faults import clipped
from romsindy.record.noise import Noise
from romsindy.record.ringing import beside
from romsindy.record.smoothing import HarmonicSpline, swing
from romsindy.record.spectrum import (
    HARMONICS,
    Line,
    Spectrum,
    distortion,
    noise_std,
    settling,
    steady_wave,
)
from romsindy.typing import Array, Indices

_LEAST_STEPS, _MOST_STEPS = 30, 60  # per cycle
# Of harmonics that a filter may have changed: the highest, cycles for each, cycles between knots
_DOUBTED, _TELLING, _SLOWLY = 12, 4.0, 3.0
_DEAF = 1e-4  # of noise below the floor
_LOUDER = 1.1  # so far the level of white noise is known
_LEAST_CYCLES, _MOST_WINDOWS = 3, 40  # of a window, of a record
# Cycles for which what goes on is heard, and how much louder the vibration is at least; logarithm
# of frequencies of one vibration; rms over what goes on from which it is heard beside it, where
# noise is by chance so many standard deviations louder.
_GOES_ON, _OWN, _DROWNED, _CHANCE = (8.0, 4.0), 0.1, 0.5, 4.0
_FEW = 16  # cycles: in fewer, too few lines for a median lie between two harmonics


@dataclass(frozen=True)
class Record(Prepared):
    """One decay: what was measured, its noise, and the smooth motion behind it."""

    decay: Decay
    signal: Array  # (n,), the measured quantity
    # (n,), false where the sensor was at the end of its range: such samples may be left out
    valid: NDArray[np.bool_]
    noise: Noise
    spline: HarmonicSpline  # of the signal
    # Smooth displacement on the steps of the simulation; times from the start of the record
    motion: Trajectory
    # (n,), which of the whitened samples take part in a fit or a comparison; all by default. The
    # motion goes through the others all the same.
    part: NDArray[np.bool_] | None = None
    # (n, m), what the measuring chain may have added, each by its standard deviation, unit of the
    # signal: see `romsindy.record.spectrum`
    doubts: Array | None = None
    first: int = 0  # first sample that takes part: before it the filter of a measuring chain rings
    inputs: Mapping[str, SampledInput] = field(default_factory=dict)  # nothing drives a decay

    @classmethod
    def of(cls, decay: Decay, floor: float, after: Array | None = None) -> Record:
        """Look at a decay; ``floor`` is the least noise, as a part of the largest amplitude.

        What other vibrations left in it counts beside that. The noise is read off what came
        ``after`` the decay, (m,), where that is given.
        """
        decay = decay.single()
        t = decay.t - decay.t[0]
        signal = decay.signal
        spline = HarmonicSpline.fit(t, signal)
        cycle = t[-1] * 2 * np.pi / float(spline.phase(t[-1]) - spline.phase(0.0))
        peak = float(np.abs(signal).max())
        least = float(np.hypot(floor * peak, decay.leftover))
        rest, envelope = signal - spline(t)[0], np.abs(spline.amplitudes(t)[:, 1])
        noise = Noise.of(rest, spline.midline(t), envelope, cycle, decay.dt, least, after)
        displacement = spline if decay.derivative == 0 else HarmonicSpline.fit(t, decay.q)
        shortest = 2 * np.pi / float(spline.phase(t, 1).max())
        grid = Grid.over(t, shortest, _steps_per_cycle(noise.std / peak))
        valid = np.ones(len(t), bool)
        motion = _motion(grid, displacement)
        power = noise.spectrum.power
        above = np.maximum(power - noise.floor**2, _DEAF * power)  # the floor
        heard = replace(noise.spectrum, power=above)
        doubts = _doubts(t, signal, spline, heard, cycle)
        first = min(settling(heard, decay.dt), cycle / 2) / decay.dt
        return cls(decay, signal, valid, noise, spline, motion, doubts=doubts, first=round(first))

    @classmethod
    def loud(cls, decay: Decay, floor: float) -> Record:
        """Look at the part of a decay between its release and where it is too small to matter.

        Unlike `Decay.free`, an offset stays, and growth is accepted: either may be an effect.

        Raises a ValueError if less than three cycles stand out of the noise.
        """
        decay = _until_another(decay.single())
        white = noise_std(decay.signal)
        record = cls.of(_loud(decay, white), floor)
        # Coloured noise is louder than it seems from its quietest part; a hum goes on.
        noise = record.noise.std
        lines = [line for line in record.noise.lines if line.rms > noise]
        if noise > _LOUDER * white or lines:
            record = cls.of(_loud(decay, noise, lines), floor)
        after = _after(decay, record)
        return record if after is None else cls.of(record.decay, floor, after)

    def phase(self, t: Array) -> Array:
        """Phase of the displacement at times from the start, rad; 0 where q crosses 0 upwards."""
        # q is a sine of its phase; each derivative leads by a quarter of a cycle.
        return np.asarray(self.spline.phase(t)) - self.derivative * np.pi / 2

    @cached_property
    def cycles(self) -> Indices:
        """First sample of every cycle, by the phase of the smooth motion."""
        return np.flatnonzero(np.diff(np.floor(self.phase(self.t) / (2 * np.pi))) > 0) + 1

    @property
    def window_steps(self) -> Indices:
        """Steps of the motion at which windows of a few cycles begin, and where the last one ends.

        Over each its state may depart a little from any equation: process noise.
        """
        size = max(_LEAST_CYCLES, int(np.ceil(len(self.cycles) / _MOST_WINDOWS)))
        # The first and the last window are no shorter than the others.
        last = max(len(self.cycles) - size, 0)
        inner = self.motion.grid.sample_step[self.cycles[size:last:size]]
        return np.unique([0, *inner, self.motion.grid.n_steps])

    @property
    def rate(self) -> float:
        """Mean angular frequency, rad/s."""
        return float(self.phase(self.t[-1:])[0] - self.phase(self.t[:1])[0]) / float(self.t[-1])

    @property
    def whole(self) -> bool:
        return bool(np.all(self.valid))

    @property
    def count(self) -> float:
        """Samples that tell anything; of noise beyond a filter, which is none, few do."""
        valid = self.valid if self.part is None else self.valid & self.part
        return float(np.sum(valid[self.first :])) * self.noise.share(len(self.signal))

    @cached_property
    def _doubtful(self) -> tuple[Array, Array] | None:
        """Orthonormal shapes (n, m) of the doubts, whitened, and the share of each that goes."""
        if self.doubts is None:
            return None
        white = self._taking_part(self.noise(self.doubts))
        modes, sizes, _ = np.linalg.svd(white, full_matrices=False)
        return modes, 1 - 1 / np.sqrt(1 + sizes**2)

    def _taking_part(self, white: Array) -> Array:
        """Whitened samples (n, ...), without those that a comparison leaves out.

        White samples are independent: those left out tell nothing about the others.
        """
        white[: self.first] = 0.0
        return white if self.part is None else _each(white, self.part)

    @property
    def remarks(self) -> list[str]:
        found = []
        lost = int(np.sum(~self.valid))
        if lost:
            found.append(f"{lost} samples stick to the end of the sensor's range and take no part")
        if self.noise.lines:
            line = self.noise.lines[0]
            found.append(
                f"another vibration at {line.frequency:.4g} Hz, rms {line.rms:.2g}, is counted as"
                " noise; it is no part of this model"
            )
        both = beside(self.decay, self.frequencies) if self.noise.lines else self.decay.beside
        return [*found, *mixture(both)]

    def alone(self, residual: Array) -> list[tuple[Record, Array]]:
        return [(self, self.whitened(residual))]

    def until(self, end: float) -> Record:
        first = super().until(end)
        n = len(first.signal)
        part = None if self.part is None else self.part[:n]
        doubts = None if self.doubts is None else self.doubts[:n]
        return replace(first, valid=self.valid[:n], part=part, doubts=doubts)

    def pieces(self, count: int) -> list[Record]:
        """It stays whole."""
        return [self]

    def without_faults(self, *, coloured: bool = False) -> Record:
        """The same for a fit that looks for none: clipped samples take no part, lines are noise."""
        known = replace(self, valid=~clipped(self.signal))
        return replace(known, noise=self.noise.with_lines()) if coloured else known.weighing_alike()

    def weighing_alike(self) -> Record:
        """The same for a fit that may be wrong: see `romsindy.record.noise.Noise.alike`."""
        return replace(self, noise=self.noise.weighing_alike())

    def over_noise(self, x: Array) -> Array:
        """Misfits or their derivatives (n, ...) over the noise, for a fit that may be wrong.

        White where not all samples weigh alike. Whatever a filter may have made of them counts:
        what that is is known but as a bound, which is no size of an error.
        """
        return x / self.noise.std if self.noise.alike else self.noise(x)

    def cosines(self, x: Array) -> Array:
        """The cosines of the same, (m, ...): sums of products are those of the samples.

        Without a few per cent of them at the end, where a decay is quietest, if the transform of
        all would take several times as long.
        """
        return self.noise.cosines(x[: prev_fast_len(len(x))])

    def whitened(self, x: Array) -> Array:
        """Misfits or their derivatives (n, ...) over the noise, white, for a comparison with it.

        Without what a filter may have made of the harmonics.
        """
        white = self._taking_part(self.noise(_each(x, self.valid)))
        if self._doubtful is None:
            return white
        modes, share = self._doubtful
        return np.asarray(white - modes @ (share * (modes.T @ white).T).T)


def _each(x: Array, taken: NDArray[np.bool_]) -> Array:
    """Samples (n, ...) that are taken; nothing of the others."""
    return x * (taken if x.ndim == 1 else taken[:, None])


def _doubts(
    t: Array, x: Array, spline: HarmonicSpline, noise: Spectrum, cycle: float
) -> Array | None:
    """What a filter may have made of the harmonics, (n, m); None where the noise shows none."""
    # Each takes some of what a record says, of which few cycles have little.
    highest = int(np.clip(t[-1] / cycle / _TELLING, HARMONICS, _DOUBTED))
    change = distortion(noise, float(t[1] - t[0]), 1 / cycle, highest)
    if not np.any(change):
        return None
    # A filter acts most on those that are too high for the smooth motion.
    waves = HarmonicSpline.along(spline.phase, t, x, _SLOWLY, highest).amplitudes(t)
    order = np.arange(waves.shape[1])
    # Harmonics follow the amplitude: what does not is noise, and may not be taken for theirs.
    a = np.abs(waves[:, 1])
    powers = (a / a.max())[:, None] ** np.arange(1, highest // 2 + 1)
    waves = powers @ np.linalg.lstsq(powers, waves, rcond=None)[0]
    waves = (waves * np.exp(1j * order * spline.phase(t)[:, None]))[:, 2:] * change[: order[-1] - 1]
    return np.concatenate([waves.real, waves.imag], axis=1)


def _steps_per_cycle(noise_share: float) -> int:
    """Steps that keep the error of the integration, of order six, at about 1 % of the noise."""
    steps = 20 * (0.01 / max(noise_share, 1e-12)) ** (1 / 6)
    return int(np.clip(steps, _LEAST_STEPS, _MOST_STEPS))


def _until_another(decay: Decay) -> Decay:
    """Without an end, longer than the vibration, in which something else goes on, such as a hum.

    Its cycles would be taken for those of the vibration.
    """
    wave = steady_wave(decay.signal, decay.dt, *_GOES_ON)
    if wave is None:
        return decay
    centred, cycle = swing(decay.signal - wave(decay.t - decay.t[0]))
    if abs(np.log(wave.frequency * cycle * decay.dt)) < _OWN:  # the vibration itself
        return decay
    envelope = np.sqrt(np.maximum(uniform_filter1d(centred**2, cycle, mode="mirror"), 0.0))
    noise = noise_std(decay.signal) * (1 + _CHANCE / np.sqrt(2 * cycle))  # rms of so few samples
    heard = np.hypot(_DROWNED * abs(wave.size), noise)
    last = int(np.flatnonzero(np.append(True, envelope[1:] > heard))[-1])
    return decay if 2 * last > len(centred) else decay.between(decay.t[0], decay.t[last])


def _loud(decay: Decay, noise: float, lines: Sequence[Line] = ()) -> Decay:
    x = decay.signal
    centred, cycle = swing(x)
    centred = centred - _steady(centred, decay.t, lines)
    envelope = np.sqrt(np.maximum(uniform_filter1d(centred**2, cycle, mode="mirror"), 0.0))
    top = int(np.argmax(envelope))
    first = 0
    if envelope[:cycle].max() < RELEASED * envelope[top]:  # held, or pushed, before the release
        near = slice(max(top - cycle, 0), top + cycle)
        first = near.start + int(np.argmax(np.abs(centred[near])))
    above = np.flatnonzero(envelope > max(QUIET * envelope[top], 2 * noise))
    if len(above) == 0 or above[-1] - first < 3 * cycle:
        raise ValueError(
            f"the vibration stands out of the noise (rms {noise:.2g}) for less than three"
            " cycles: start earlier, check the channel, or leave it out where friction stops it"
        )
    return decay.between(decay.t[first], decay.t[above[-1]])


def _steady(x: Array, t: Array, lines: Sequence[Line]) -> Array:
    """What lines add to a signal (n,) from end to end, their frequencies known to some 1 / T."""
    share = np.linspace(-1.0, 1.0, len(t))
    rotating = np.stack(
        [share**k * np.exp(2j * np.pi * line.frequency * t) for line in lines for k in range(4)]
        or [0j * t],
        axis=1,
    )
    columns = np.hstack([rotating.real, rotating.imag])
    return np.asarray(columns @ np.linalg.lstsq(columns, x)[0])


def _after(decay: Decay, record: Record) -> Array | None:
    """What follows a vibration of few cycles, (m,), if it is longer, and noise alone."""
    after = decay.signal[decay.t > record.decay.t[-1]]
    if record.t[-1] * record.rate > _FEW * 2 * np.pi or len(after) < len(record.signal):
        return None
    first, last = (np.var(half) for half in np.array_split(after, 2))
    return after - np.mean(after) if first < 2 * last else None  # a vibration goes on fading


def _motion(grid: Grid, spline: HarmonicSpline) -> Trajectory:
    ends = spline(grid.ends)
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


def sharing_drift(records: Sequence[Record]) -> list[Record]:
    """The same, each with a drift where any has one.

    One sensor measured them: a drift that looks like the mean of a vibration in one record shows in
    the others.
    """
    found = [r.noise.drift for r in records if r.noise.drift is not None]
    if not found:
        return list(records)
    frequency = max((d.frequency for d in found), key=len)
    usual = Spectrum(frequency, np.mean([d(frequency) for d in found], axis=0))
    return [
        r if r.noise.drift is not None else replace(r, noise=replace(r.noise, drift=usual))
        for r in records
    ]


# Errors of the integration, as a part of the largest amplitude.
NUMERICS = 1e-6


def mixture(both: float) -> list[str]:
    """What to know where other modes ring with so many times the acceleration of those modelled."""
    return [
        f"other modes ring with up to {both:.2g} times the acceleration of what is modelled: where"
        " a joint slips, frequency and damping hold for this mixture of modes alone; to know them"
        " without the others, drive it at its frequency, and record what follows without the drive"
    ] * (both > MIXED)
