"""A record of several coordinates, ready to be compared with a simulation.

The vibrations of a decay are followed in the channels (`romsindy.record.vibrations`). As they were
followed they are the motion from which a fit starts; what they leave of a channel is noise. Where
inputs drive them, their linear modes tell the motion (`romsindy.fit.records.modes`).

What channels show: mode shapes of several coordinates, straight and curved, and offsets.

Modes that follow show as well: y = Phi q + sum of C_p q^p, with products q^p of two coordinates or
more (slaved modes, and the arc on which a sensor moves).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import factorial
from typing import cast

import numpy as np
from scipy.interpolate import BSpline

from romsindy.effects.base import ReadingEffect, SampledInput
from romsindy.effects.outside import Bias
from romsindy.fit.kernel.collocation import Grid, Trajectory
from romsindy.fit.kernel.part import Part, Reading
from romsindy.fit.kernel.prepared import CREEPS, SHARP, Prepared
from romsindy.fit.records.driven import AFFORDABLE, inputs_of_record, quiet_noise, steps_for
from romsindy.fit.records.modes import Modes, motion_behind
from romsindy.fit.records.record import NUMERICS, Record
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import Along
from romsindy.physics.damping import Friction
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.noise import Noise
from romsindy.record.recording import Measurement
from romsindy.record.ridges import Ridge
from romsindy.record.ringing import NEAR, tones_of
from romsindy.record.smoothing import HarmonicSpline
from romsindy.record.vibrations import Vibration
from romsindy.typing import Array, Indices


@dataclass(frozen=True)
class ModeShape(ReadingEffect):
    """What one channel shows of one coordinate, beyond what was read off the record."""

    channel: int = 0
    coordinate: int = 0

    name, label = "mode_shape", "another mode shape at a sensor"

    @property
    def variant(self) -> str:
        """Channel and coordinate, from 1."""
        return f"channel {self.channel + 1}, q{self.coordinate + 1}"

    def readings(self, t: Array, q: Array) -> Array:
        """Of its channel, (1, n), by a motion (n, R) in the measured quantity."""
        return q[:, self.coordinate][None]


@dataclass(frozen=True)
class Offset(Bias):
    """A zero of the sensor of one channel that differs from record to record."""

    channel: int = 0

    per_record = True


def free_offsets(records: Sequence[Prepared], channel: int = 0) -> Part:
    """An offset of the sensor of a channel in each record, 0 at first."""
    return Part(Offset(channel), (), np.zeros((len(records), 1)))


@dataclass(frozen=True)
class CurvedShape(ReadingEffect):
    """What one channel shows of a product of coordinates: their powers, one for each."""

    channel: int = 0
    powers: tuple[int, ...] = (2,)

    name, label = "curved_shape", "a sensor that shows products of coordinates"

    @property
    def variant(self) -> str:
        """Channel, from 1, and product."""
        return f"channel {self.channel + 1}, {self.product}"

    @property
    def sentence(self) -> str:
        """That the sensors show the product, whichever does."""
        return f"sensors show {self.product}"

    @property
    def product(self) -> str:
        """Such as "q1^2 q2"."""
        powers = [(i + 1, p) for i, p in enumerate(self.powers) if p]
        return " ".join(f"q{i}^{p}" if p > 1 else f"q{i}" for i, p in powers)

    def readings(self, t: Array, q: Array) -> Array:
        """Of its channel, (1, n), by a motion and its derivatives, (n, k R): see `shown_slopes`."""
        series = self._series(q)
        return factorial(len(series) - 1) * _product(series, self.powers)[-1][None]

    def shown_slopes(self, q: Array) -> Array:
        """Derivatives of the reading by q, q_dot, ... up to the measured quantity, (n, k R)."""
        series, last = self._series(q), len(q[0]) // len(self.powers) - 1
        found = np.zeros((last + 1, *series.shape[1:]))
        for i, p in enumerate(self.powers):
            if p:
                fewer = tuple(n - (j == i) for j, n in enumerate(self.powers))
                rest = p * _product(series, fewer)
                for order in range(last + 1):
                    found[order, :, i] = factorial(last) / factorial(order) * rest[last - order]
        return np.concatenate(found, axis=1)

    def _series(self, q: Array) -> Array:
        """Taylor coefficients in time of all coordinates, (k, n, R)."""
        orders = np.split(q, q.shape[1] // len(self.powers), axis=1)
        return np.stack([x / factorial(order) for order, x in enumerate(orders)])


def _product(series: Array, powers: tuple[int, ...]) -> Array:
    """Taylor coefficients of a product of powers, (k, n)."""
    found = np.zeros(series.shape[:2])
    found[0] = 1.0
    for i, p in enumerate(powers):
        for _ in range(p):
            factor = series[..., i]
            found = np.stack(
                [sum(found[j] * factor[m - j] for j in range(m + 1)) for m in range(len(found))]
            )
    return found


# Steps of the integration in a cycle of the fastest coordinate: its error, of order six, stays
# below a hundredth of a noise of 40 dB.
# Steps need not be whole samples: few samples in a cycle are no reason for short steps.
_STEPS, _PARTS = 12, 4
# In channels where its logarithm differs by less, a frequency is that of the same vibration, if no
# other one is nearer: vibrations that beat pull at what is followed of each.
_SAME = 0.06
# Noise is measured where the coordinates ring, and where it is about as loud: a filter may have
# taken what lies beyond.
_BELOW, _ABOVE, _ALIKE = 0.5, 1.5, 4.0
_CYCLES = 3.0  # between knots of the amplitudes of a tone
# Noise is measured again where a fit leaves less, by this factor.
_QUIETER = 0.97


class CoupledReading(Reading):
    """What c channels show of R coordinates, one channel after the other.

    ``slope`` is (c, R), or (c, n, k R) where derivatives of the motion show as well.
    """

    def by_motion(self, change: Array) -> Array:
        """Changes of the reading, (c n, m), by changes (n, k R, m) of the motion."""
        rule = "cr,nrk->cnk" if self.slope.ndim == 2 else "cnr,nrk->cnk"
        return np.einsum(rule, self.slope, change).reshape(-1, change.shape[2])


@dataclass(frozen=True)
class CoupledRecord(Prepared):
    """A record of several coordinates: what was measured, its noise, and the motion behind it."""

    decay: Decay | ForcedVibration  # of one channel or several
    signal: Array  # (c n,), the measured channels, one after the other
    noise: tuple[Noise, ...]  # of each channel
    # (c, R), what each channel shows of each coordinate; 1 in the main channel of the coordinate
    shapes: Array
    # Smooth displacement of the R coordinates; times from the start of the record
    motion: Trajectory
    # The fundamentals of the coordinates, as followed in their main channels; of those that ring
    tones: tuple[Ridge, ...] = ()
    # Where it starts in the record that it is a piece of, s: tones have the times of that
    since: float = 0.0
    creep: float = 0.0
    held_from: tuple[float, ...] = ()
    # The measured inputs by name, where any drive it
    inputs: Mapping[str, SampledInput] = field(default_factory=dict)

    @classmethod
    def of(
        cls, decay: Decay, frequencies: Array, floor: float, main: Sequence[int] = ()
    ) -> CoupledRecord:
        """Look at a free decay for vibrations near some frequencies, Hz, one for each coordinate.

        ``floor`` is the least noise, as a part of the largest sample; ``main`` the channel of each
        coordinate, by default that in which it moves most.

        Raises a ValueError if no vibration stands out of the noise.
        """
        t, signals = decay.t - decay.t[0], decay.signal.reshape(len(decay.t), -1)
        found = tones_of(decay)
        if not any(found):
            raise ValueError("nothing rings in a decay: leave it out, or give a longer part of it")
        everywhere = list(range(len(found)))
        wanted = [[channel] for channel in main] or [everywhere] * len(frequencies)
        main, own = zip(*_told_apart(found, frequencies, wanted), strict=True)
        tones = tuple(v.tone for v in own)
        waves = np.stack([_wave(tone, t, 0) for tone in tones], axis=1)
        shapes = np.linalg.lstsq(waves, signals, rcond=None)[0].T
        size = shapes[list(main), range(len(main))]
        shapes = shapes / np.where(size != 0, size, np.nan)  # nothing is known of what is silent
        heard = [v for v in own if v.energy] or [v for several in found for v in several]
        loudest = [v.tone for v in sorted(heard, key=lambda v: -v.energy)]
        noise = tuple(
            _noise(x - sum(v(t) for v in several), loudest, decay.dt, floor * np.abs(x).max())
            for x, several in zip(signals.T, found, strict=True)
        )
        fastest = max(float(tone.frequency.max()) for tone in tones)
        grid = Grid.over(t, 1 / fastest, _STEPS, _PARTS)
        motion = _motion(grid, tones, decay.derivative)
        # A coordinate that friction stops is moved by the others.
        creep = CREEPS[SHARP - 1] * float(np.abs(motion.q_dot).max())
        return cls(decay, signals.T.ravel(), noise, shapes, motion, tones, creep=creep)

    @cached_property
    def frequencies(self) -> Array:
        """Of the coordinates, Hz, (R,): of their tones, or rms velocity over rms displacement."""
        if not self.driven:
            return np.array([np.median(tone.frequency) for tone in self.tones])
        return self.motion.q_dot.std(axis=0) / self.motion.q.std(axis=0) / (2 * np.pi)

    @property
    def rate(self) -> float:
        """Angular frequency of the slowest coordinate, rad/s."""
        return float(2 * np.pi * self.frequencies.min())

    @property
    def main(self) -> list[int]:
        """The channel of each coordinate whose reading says how large it is."""
        return [int(np.argmin(np.abs(column - 1))) for column in self.shapes.T]

    def mode_shapes(self, parts: Sequence[Part]) -> Array:
        shapes = self.shapes.copy()
        for effect, part in ((p.effect, p) for p in parts):
            if isinstance(effect, ModeShape):
                shapes[effect.channel, effect.coordinate] += part.own(0)[0]
        return shapes

    def orders(self, parts: Sequence[Part]) -> tuple[int, ...]:
        """Which derivatives of the motion the reading needs: all, where sensors are curved."""
        curved = any(isinstance(part.effect, CurvedShape) for part in parts)
        return tuple(range(self.derivative + 1)) if curved else (self.derivative,)

    def read(self, parts: Sequence[Part], number: int, x: Array) -> CoupledReading:
        """What the channels show of a motion in its `orders`, (n, k R)."""
        shapes, curved = self.mode_shapes(parts), []
        last = x[:, -shapes.shape[1] :]
        shown, rows = shapes @ last.T, [np.zeros((0, shapes.shape[0], len(x)))]
        for part in parts:
            effect, row = part.effect, np.zeros((len(part.columns(number)), *shown.shape))
            if isinstance(effect, ModeShape):
                row[0, effect.channel] = effect.readings(self.t, last)[0]
            elif isinstance(effect, CurvedShape | Offset):
                own, row[0, effect.channel] = part.own(number)[0], effect.readings(self.t, x)[0]
                shown[effect.channel] += own * row[0, effect.channel]
                if own and isinstance(effect, CurvedShape):
                    curved.append((own, effect))
            rows.append(row)
        by_value = np.concatenate(rows).reshape(-1, shown.size)
        slope = shapes
        if curved:
            slope = np.zeros((len(shapes), *x.shape))
            slope[..., -shapes.shape[1] :] = shapes[:, None]
            for own, effect in curved:
                slope[effect.channel] += own * effect.shown_slopes(x)
        return CoupledReading(shown.ravel(), slope, by_value)

    def with_coordinates(self, order: Indices) -> CoupledRecord:
        """The same with its coordinates in another order."""
        m = self.motion
        motion = Trajectory(m.grid, m.q[:, order], m.q_dot[:, order], m.q_ddot[..., order])
        tones = tuple(self.tones[i] for i in order)
        return replace(self, shapes=self.shapes[:, order], motion=motion, tones=tones)

    def until(self, end: float) -> CoupledRecord:
        """The first seconds of every channel, with the noise of all of it."""
        return self.between_steps(0, self.motion.grid.until(end).n_steps)

    def at_rest(self, model: CoupledModel) -> CoupledRecord:
        """The same, with the times from which on dry friction of the model holds coordinates.

        It does once a vibration, as it was followed, is smaller than what friction holds; of one
        that was not followed the motion tells.
        """
        held, ends = [np.inf] * len(self.tones), self.motion.grid.ends
        for i, (tone, rate) in enumerate(
            zip(self.tones, 2 * np.pi * self.frequencies, strict=True)
        ):
            friction = model.coefficients.get(Along.coordinate(Friction(), i + 1).key, 0.0)
            size = np.abs(tone.z(ends)) / rate**self.derivative * tone.inside(ends)
            size = size if size.any() else np.abs(self.motion.q_dot[:, i]) / rate
            last = np.flatnonzero(size > friction / rate**2).max(initial=-1)
            if friction > 0 and 0 <= last < len(ends) - 1:
                held[i] = float(ends[last + 1])
        return replace(self, held_from=tuple(held) if min(held) < np.inf else ())

    def louder(self, by: float) -> CoupledRecord:
        """The same with so many times the noise."""
        return replace(self, noise=tuple(replace(n, std=by * n.std) for n in self.noise))

    def heard_again(self, residual: Array) -> CoupledRecord:
        """With the noise in what a fit leaves, where that is less than what was heard at first.

        Vibrations that beat are not followed as well as they are fitted.
        """
        tones = sorted(self.tones, key=lambda tone: -float(np.abs(tone.z(tone.t)).max()))
        again = [
            _noise(rest, tones, self.decay.dt, noise.floor)
            for rest, noise in zip(residual.reshape(len(self.noise), -1), self.noise, strict=True)
        ]
        pairs = list(zip(self.noise, again, strict=True))
        if not any(b.std < _QUIETER * a.std for a, b in pairs):
            return self
        return replace(self, noise=tuple(min(pair, key=lambda noise: noise.std) for pair in pairs))

    def alone(self, residual: Array) -> list[tuple[Record, Array]]:
        """Each channel as the record of each coordinate, with a residual of it whitened.

        They are looked at for what is left at the harmonics of the coordinate.
        """
        t = self.since + self.t
        signals, white = (
            x.reshape(len(self.noise), -1) for x in (self.signal, self.whitened(residual))
        )
        found = []
        for signal, noise, left in zip(signals, self.noise, white, strict=True):
            for tone in self.tones:
                clock = np.clip(t, tone.start, tone.end)
                q = np.real(_displaced(tone, clock, -self.derivative))
                if np.all(q == q[0]):  # it has died before, or was not heard
                    continue
                decay = Decay(self.decay.t, q, unit=self.decay.unit, stage="free")
                spline = HarmonicSpline.along(tone.phase, clock, q, _CYCLES, 1)
                record = Record(decay, signal, np.ones(len(t), bool), noise, spline, self.motion)
                found.append((record, left))
        return found


def coupled_records(
    decays: Sequence[Decay], frequencies: Array, floor: float
) -> tuple[CoupledRecord, ...]:
    """Free decays of one structure, with the mode shapes that they have in the mean.

    Arguments and errors as those of `CoupledRecord.of`; an error as well where no decay shows a
    vibration of its own near every frequency.
    """
    alone = (CoupledRecord.of(d, frequencies, floor) for d in decays)
    first = next((r for r in alone if not np.any(np.isnan(r.shapes))), None)
    if first is None:
        raise ValueError(_not_told_apart(decays, frequencies))
    records = [CoupledRecord.of(d, frequencies, floor, first.main) for d in decays]
    shapes = np.nanmean([r.shapes for r in records], axis=0)
    return tuple(replace(r, shapes=shapes) for r in records)


def _not_told_apart(decays: Sequence[Decay], frequencies: Array) -> str:
    """Why no decay shows a vibration of its own near every frequency."""
    heard = [v for d in decays for channel in tones_of(d) for v in channel]
    for frequency in frequencies:
        if not _near(heard, frequency):
            holds = ", ".join(sorted({f"{v.mean_frequency:.4g} Hz" for v in heard}))
            return (
                f"the model has a mode of {frequency:.4g} Hz, but nothing near it rings in the"
                f" record, which holds {holds or 'no vibration'}: start from a model whose omega^2"
                " are those of the vibrations, or leave the coordinate out"
            )
    return (
        f"vibrations at {', '.join(f'{f:.4g} Hz' for f in frequencies)} ring as one, or not all, in"
        " every decay: model fewer coordinates, or give longer decays"
    )


def free_shapes(records: Sequence[CoupledRecord]) -> tuple[Part, ...]:
    """What channels show of coordinates beyond their main channels, as values to be fitted."""
    main = records[0].main
    return tuple(
        Part(ModeShape(channel, j), (), np.zeros((1, 1)))
        for channel, j in np.ndindex(records[0].shapes.shape)
        if channel != main[j]
    )


def curved_shapes(record: CoupledRecord) -> list[tuple[Part, ...]]:
    """What channels may show of products of coordinates: for each product, the channels together.

    None with as many channels as coordinates: there a curved visibility is another choice of
    coordinates. So it is for cubes in main channels, where inertia does the same.
    """
    n_channels, r = record.shapes.shape
    if n_channels <= r:
        return []
    unit = np.eye(r, dtype=int)
    pairs = [a + b for a, b in itertools.combinations_with_replacement(unit, 2)]
    every = range(n_channels)
    others = [c for c in every if c not in record.main]
    seen = [*((p, every) for p in pairs), *((3 * a, others) for a in unit)]
    return [
        tuple(Part(CurvedShape(c, tuple(p.tolist())), (), np.zeros((1, 1))) for c in channels)
        for p, channels in seen
    ]


def _told_apart(
    found: Sequence[Sequence[Vibration]], frequencies: Array, wanted: Sequence[Sequence[int]]
) -> list[tuple[int, Vibration]]:
    """The channel of each coordinate and the vibration there; no two are the same vibration.

    Where two coordinates ring as one, the further one is silent, as is one that does not ring: its
    motion starts from rest.
    """
    logs = np.log(frequencies)
    apart = np.abs(np.subtract.outer(logs, logs)) + np.diag(np.full(len(logs), np.inf))
    same = np.minimum(_SAME, apart.min(axis=1, initial=np.inf) / 2)
    given = list(zip(frequencies, wanted, same, strict=True))
    mains = [_main(found, *coordinate) for coordinate in given]
    off = [abs(np.log(v.small_frequency / f)) for (_, v), f in zip(mains, frequencies, strict=True)]
    chosen: dict[int, tuple[int, Vibration]] = {}
    for i in np.argsort(off):
        taken = [v for _, v in chosen.values()]
        others = [[v for v in several if v not in taken] for several in found]
        near = any(_near(others[channel], frequencies[i]) for channel in wanted[i])
        channel, vibration = _main(others if near else found, *given[i])
        chosen[i] = channel, vibration if near else _silent(vibration)
    return [chosen[i] for i in range(len(mains))]


def _silent(vibration: Vibration) -> Vibration:
    """The same, of no size."""
    z = vibration.tone.z
    tone = replace(vibration.tone, z=BSpline(z.t, 0 * z.c, z.k))
    return replace(vibration, tone=tone, energy=0.0)


def _near(several: Sequence[Vibration], frequency: float) -> list[Vibration]:
    """Those whose small vibrations are about so fast, Hz."""
    return [v for v in several if 1 / NEAR < v.small_frequency / frequency < NEAR]


def _main(
    found: Sequence[Sequence[Vibration]], frequency: float, channels: Sequence[int], same: float
) -> tuple[int, Vibration]:
    """The channel in which the vibration nearest to a frequency moves most, and that vibration.

    Where logarithms of frequencies differ by less than ``same`` it is one vibration.
    """
    several = [(channel, v) for channel in channels for v in found[channel]]
    if not several:  # of other channels, to be silent
        several = [(channels[0], v) for others in found for v in others]
    off = [abs(np.log(v.small_frequency / frequency)) for _, v in several]
    alike = [cv for cv, x in zip(several, off, strict=True) if x < min(off) + same]
    return max(alike, key=lambda cv: cv[1].energy)


def _displaced(tone: Ridge, t: Array, times: int) -> Array:
    """A tone differentiated so often, or integrated if that is negative; complex, (n,)."""
    return tone.z(t) * np.exp(1j * tone.phase(t)) * (1j * tone.phase(t, 1)) ** times


def _wave(tone: Ridge, t: Array, times: int) -> Array:
    """The same, real, beyond the ends of the tone as well: there it dies as it did before."""
    inside = np.clip(t, tone.start, tone.end)
    log = np.log(np.maximum(tone.amplitude, 1e-300))
    fall = max(-float(np.polyfit(tone.t, log, 1)[0]), 0.0) if len(log) > 1 else 0.0
    late = t - inside
    turned = np.exp((1j * tone.phase(inside, 1) - fall * np.sign(late)) * late)
    return np.real(_displaced(tone, inside, times) * turned)


def _motion(grid: Grid, tones: Sequence[Ridge], derivative: int) -> Trajectory:
    inside = grid.node_times(0, grid.n_steps).ravel()
    q, q_dot, q_ddot = (
        np.stack([_wave(tone, t, d - derivative) for tone in tones], axis=1)
        for d, t in enumerate((grid.ends, grid.ends, inside))
    )
    return Trajectory(grid, q, q_dot, q_ddot.reshape(-1, 3, len(tones)))


def _noise(rest: Array, tones: Sequence[Ridge], dt: float, floor: float) -> Noise:
    """Noise in what a motion leaves of a channel, alike for all samples.

    ``tones`` are those of the coordinates, the one that moves most first; ``floor`` is in the unit
    of the channel.
    """
    t, tone = dt * np.arange(len(rest)), tones[0]
    size = np.abs(tone.z(np.clip(t, tone.start, tone.end)))
    frequency = [float(np.median(tone.frequency)) for tone in tones]
    noise = Noise.of(rest, np.zeros(len(rest)), size, 1 / max(frequency), dt, floor)
    every = np.fft.rfftfreq(len(rest), dt)
    power = noise.spectrum(every)
    ringing = (every > _BELOW * min(frequency)) & (every < _ABOVE * max(frequency))
    level = float(np.mean(power[ringing]))
    alike = (power > level / _ALIKE) & (power < _ALIKE * level)
    std = float(np.sqrt(np.mean(power[alike | ringing])))
    return replace(noise, std=std, level=std, alike=True, drift=None)


def record_along(measured: Measurement, modes: Modes) -> CoupledRecord:
    """A record of several coordinates whose linear modes are known from driven ones."""
    if measured.driven:
        return driven_record(cast(ForcedVibration, measured), modes, NUMERICS)
    hertz = modes.omega / (2 * np.pi)
    record = CoupledRecord.of(cast(Decay, measured), hertz, NUMERICS, modes.main)
    return replace(record, shapes=modes.shapes)


def driven_record(
    vibration: ForcedVibration, modes: Modes, floor: float, affordable: int = AFFORDABLE
) -> CoupledRecord:
    """A forced vibration of several coordinates, whose linear modes are known; see `ForcedRecord`.

    What a channel shows of a mode is what is read off, as far as no part changes it.
    """
    channels = vibration.y.reshape(len(vibration.t), -1).T
    noise = tuple(quiet_noise(y, vibration, floor) for y in channels)
    grid = steps_for(vibration, affordable, float(modes.omega.max()) / (2 * np.pi))
    motion = motion_behind(vibration, modes, np.array([n.std for n in noise]), grid)
    given = (vibration, channels.ravel(), noise, modes.shapes, motion)
    return CoupledRecord(*given, inputs=inputs_of_record(vibration, grid))
