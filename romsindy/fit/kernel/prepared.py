"""What a fit needs of a record, whatever was measured."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from romsindy.effects.base import SampledInput
from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.part import Part, Reading, read
from romsindy.record.noise import Noise
from romsindy.record.ridges import Ridge
from romsindy.typing import Array

R = TypeVar("R", bound="Prepared")
ACCELERATION = 2  # the derivative that an accelerometer shows
_SHORTEST = 4.0  # cycles of the slowest coordinate in a piece


class Prepared(ABC):
    """A record ready to be compared with a simulation, whatever the number of its coordinates."""

    decay: Any  # what was measured
    signal: Array  # (c n,), its channels, one after the other
    noise: Any
    motion: Trajectory  # smooth displacement of the coordinates, from which a fit starts
    tones: tuple[Ridge, ...] = ()  # the fundamentals of several coordinates that ring
    since: float = 0.0  # where it starts in the record that it is a piece of, s
    creep: float = 0.0  # velocity over which dry friction turns round in its motions
    # From when on friction holds each coordinate, s from the start of all of it; or none
    held_from: tuple[float, ...] = ()
    inputs: Mapping[str, SampledInput]  # what drives it, by name: nothing drives a decay

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

    @property
    def peak(self) -> float:
        """Largest displacement in any channel; of what inputs drive, of a coordinate."""
        return self.amplitude if self.driven else float(np.abs(self.decay.q).max())

    @property
    def noises(self) -> tuple[Noise, ...]:
        """Of every channel."""
        return self.noise if isinstance(self.noise, tuple) else (self.noise,)

    @property
    def white(self) -> Array:
        """Standard deviation of the noise of each sample, were it white, (c n,)."""
        return np.repeat([noise.std for noise in self.noises], len(self.decay.t))

    @property
    def driven(self) -> bool:
        """Whether inputs drive it."""
        return bool(self.inputs)

    @property
    def whole(self) -> bool:
        """Whether all samples take part."""
        return True

    @property
    def n_channels(self) -> int:
        """c."""
        return len(self.signal) // len(self.decay.t)

    @property
    def amplitude(self) -> float:
        """Largest displacement of a coordinate."""
        return float(np.abs(self.motion.q).max())

    @property
    @abstractmethod
    def rate(self) -> float:
        """Mean angular frequency, of the slowest coordinate, rad/s."""

    @property
    def frequencies(self) -> Array:
        """Of the coordinates, Hz, (R,)."""
        return np.array([self.rate / (2 * np.pi)])

    @property
    def turns(self) -> float:
        """Cycles of the slowest coordinate, in all."""
        return float(self.t[-1]) * float(self.frequencies.min())

    @property
    def compared(self) -> Array:
        """1 for the samples that a simulation is compared with, (c n,).

        0 in a hit where accelerations were measured: they show the noise of the force as well.
        """
        found = np.ones((self.n_channels, len(self.t)))
        spans = [span for force in self.inputs.values() for span in force.spans]
        for start, stop in spans if self.derivative == ACCELERATION else ():
            found[:, (self.since + self.t >= start) & (self.since + self.t <= stop)] = 0.0
        return found.ravel()

    @property
    def count(self) -> float:
        """Samples that tell anything, of all channels."""
        return float(len(self.signal))

    @property
    def power(self) -> float:
        """Sum of squares of what was measured, about the mean of each channel."""
        channels = self.by_channel(self.signal)
        return float(np.sum((channels - channels.mean(axis=1, keepdims=True)) ** 2))

    @property
    def remarks(self) -> list[str]:
        """What the reader of a fit must know of it."""
        return []

    def until(self: R, end: float) -> R:
        """The first seconds of the record, with the noise of all of it."""
        m, grid = self.motion, self.motion.grid.until(end)
        n, steps = len(grid.fraction), grid.n_steps
        return replace(  # type: ignore[type-var]
            self,
            decay=self.decay.between(end=float(self.decay.t[n - 1])),
            signal=self.signal[:n],
            motion=Trajectory(grid, m.q[: steps + 1], m.q_dot[: steps + 1], m.q_ddot[:steps]),
        )

    def beginning(self: R, samples: int) -> R:
        """So many samples, of every channel."""
        return self.until(float(self.t[samples - 1]))

    def pieces(self: R, count: int) -> list[R]:
        """In so many stretches, each with a state of its own at its start; some stay whole.

        Where friction begins to hold a coordinate there is one more: nothing tells how it stopped.
        """
        grid = self.motion.grid
        ends = np.linspace(0, grid.n_steps, count + 1)
        short = grid.n_steps * min(0.25 / count, _SHORTEST / self.turns)
        for stop in (np.array(self.held_from) - grid.start) / grid.step:
            if short < stop < grid.n_steps - short:
                ends = np.sort([*ends[np.abs(ends - stop) > short], stop])
        ends = ends.round().astype(int)
        return [self.between_steps(int(a), int(b)) for a, b in itertools.pairwise(ends)]

    def between_steps(self: R, first: int, last: int) -> R:
        """The samples in steps first to last - 1, with the noise of all of it."""
        at = self.motion.grid.sample_step
        inside = np.flatnonzero((at >= first) & (at < last))
        t = self.decay.t[inside]
        return replace(  # type: ignore[type-var]
            self,
            decay=self.decay.between(float(t[0]), float(t[-1])),
            signal=self.by_channel(self.signal)[:, inside].ravel(),
            motion=self.motion.between(first, last),
            since=self.since + float(t[0] - self.clock),
        )

    def read(self, parts: Sequence[Part], number: int, x: Array) -> Reading:
        """What the sensors show of a motion in its `orders`, with the parts of a hypothesis."""
        return read(parts, number, self.t, x)

    def whitened(self, x: Array) -> Array:
        """Misfits or their derivatives (c n, ...) over the noise of their channel."""
        pairs = zip(self.noises, self.by_channel(x), strict=True)
        return np.concatenate([noise(own) for noise, own in pairs])

    def by_channel(self, x: Array) -> Array:
        """Signals that stand one after the other, (c n, ...), apart: (c, n, ...)."""
        return x.reshape(self.n_channels, -1, *x.shape[1:])

    def mode_shapes(self, parts: Sequence[Part]) -> Array:
        """What each channel shows of each coordinate of small motions, (c, R)."""
        return np.ones((1, 1))

    def alone(self, residual: Array) -> Sequence[tuple[Any, Array]]:
        """Records of single coordinates, with a residual of this one whitened."""
        raise NotImplementedError

    def with_signal(self: R, signal: Array) -> R:
        """The same with another measurement, such as a simulated one."""
        return replace(self, signal=signal)  # type: ignore[type-var]

    def with_motion(self: R, motion: Trajectory) -> R:
        """The same with another motion behind it."""
        return replace(self, motion=motion)  # type: ignore[type-var]

    def drawn(self, rng: np.random.Generator) -> Array:
        """Noise like that of the record, (c n,)."""
        n = len(self.decay.t)
        return np.concatenate([noise.draw(n, self.decay.dt, rng) for noise in self.noises])

    def orders(self, parts: Sequence[Part]) -> tuple[int, ...]:
        """Which derivatives of the motion its reading needs."""
        return (self.derivative,)

    def in_orders(self, parts: Sequence[Part], of: Callable[[int], Array]) -> Array:
        """What a function gives for these derivatives, (n, R, ...) each, side by side."""
        found = [of(order) for order in self.orders(parts)]
        return found[0] if len(found) == 1 else np.concatenate(found, axis=1)

    def shown(self, parts: Sequence[Part], number: int, of: Callable[[int], Array]) -> Reading:
        """`read` of a motion that is given by its derivatives."""
        return self.read(parts, number, self.in_orders(parts, of))

    def missed(self, parts: Sequence[Part], number: int, of: Callable[[int], Array]) -> Array:
        """Measured minus that, (c n,)."""
        return self.compared * (self.signal - self.shown(parts, number, of).shown)

    def table(self, parts: Sequence[Part], number: int, x: Array, by_value: Array) -> Array:
        """Derivatives of the reading of a motion x, and its misfit, whitened: (c n, m + 1).

        ``by_value`` (n, k R, m) are those of the motion (n, k R), both in the `orders` of the
        record, by the values that act in it and the state.
        """
        reading = self.read(parts, number, x)
        jacobian = reading.by_all(by_value)
        rows = np.column_stack([jacobian, self.signal - reading.shown])
        return self.whitened(self.compared[:, None] * rows)


def chi_squared_of(records: Sequence[Prepared], residuals: Sequence[Array]) -> float:
    """Sum of squares of what is left of some records, over their noise."""
    pairs = zip(records, residuals, strict=True)
    return sum(float(np.sum(record.whitened(left) ** 2)) for record, left in pairs)


def part_of(records: Sequence[Prepared], residuals: Sequence[Array]) -> float:
    """Rms of what is left of some records, as a part of that of the response."""
    left = sum(float(e @ e) for e in residuals)
    return float(np.sqrt(left / sum(r.power for r in records)))


def one_a_decay(records: Sequence[Prepared]) -> list[Prepared]:
    """Those of several coordinates that ring; of records in pieces the first, with all tones."""
    return [r for r in records if r.tones and r.since == 0]


def record_notes(records: Sequence[Prepared]) -> list[str]:
    """What the reader must know of the records."""
    hits = [
        f"{name}: 0 beside its {len(x.spans)} hit{'s' * (len(x.spans) > 1)}, whatever it shows"
        for record in records
        if record.since == 0
        for name, x in record.inputs.items()
        if x.spans
    ]
    return [
        *hits,
        *(f"decay {i}: {text}" for i, record in enumerate(records) for text in record.remarks),
    ]


# Of the largest velocity, over which dry friction turns round, one after the other. Where friction
# holds what an input pulls at, a force averaged over a step jumps from fit to fit, and few settle.
CREEPS = (7e-3, 3e-3, 1e-3, 3e-4, 1e-4)
SHARP = 3  # so many of them where no input drives several coordinates: less no step resolves


def creeping(records: Sequence[R], part: float = CREEPS[0]) -> list[R]:
    """The same; in those that inputs drive, friction turns round over a part of the velocity."""
    largest = [float(np.abs(r.motion.q_dot).max()) for r in records]
    return [
        replace(r, creep=part * v) if r.driven or r.motion.q.shape[1] > 1 else r  # type: ignore[type-var]
        for r, v in zip(records, largest, strict=True)
    ]
