"""A record of one channel that measured inputs drive, ready to be compared with a simulation.

And the inputs of a model in a fit: where their gains start, and which delays are free.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from romsindy.effects.outside import Drive, DriveAlong, Impulses
from romsindy.fit.kernel.collocation import Grid, Trajectory
from romsindy.fit.kernel.linear_response import nodes
from romsindy.fit.kernel.linear_steps import NODES
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.smooth import averaged, smooth_motion
from romsindy.physics.equations import Equations
from romsindy.physics.input import Input, input_in
from romsindy.physics.term import Term
from romsindy.record.forced import ForcedVibration, Hit
from romsindy.record.interpolation import Interpolation, of_steps
from romsindy.record.noise import Noise
from romsindy.record.spectrum import falling_power, quiet_power, quiet_std
from romsindy.typing import Array

# Between the places in a step where a simulation asks for it.
_BETWEEN = np.convolve([0.0, *NODES, 1.0], [0.5, 0.5], "valid")
_KEPT = 4  # tables: a fit asks for the same one again and again
# Steps in a mean cycle at least, and in the shortest one that matters: below its frequency lies
# this part of the power of the displacement. At eight steps a frequency is wrong by 2e-6 of itself.
# Short records can have more, as long as all their steps are no more than so many.
_STEPS, _LEAST_STEPS, _POWER = 8, 4, 0.999
_MOST_STEPS, AFFORDABLE = 40, 40_000
_IN_HIT = 16  # steps, in a hit with its feet


@dataclass(frozen=True, eq=False)
class Sampled:
    """Samples (n,) of an input, ``dt`` seconds apart from the start of the record, on a grid."""

    u: Array
    dt: float
    grid: Grid
    hits: tuple[Hit, ...] = ()  # that it consists of, if it does
    tables: dict[Input, Array] = field(default_factory=dict, repr=False)

    def at(self, t: Array, term: Input) -> Array:
        """What acts of it at times of the simulation, (n,).

        At Gauss points, those values that stand for their step, see `of_steps`.
        """
        table = self._table(term)
        place = (t - self.grid.start) / self.grid.step
        step = np.floor(place + 1e-6).astype(int)
        column = np.searchsorted(_BETWEEN, place - step)
        return table[step + column // 4, column % 4]

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Begin and end of each hit, s."""
        return [(hit.at.start * self.dt, hit.at.stop * self.dt) for hit in self.hits]

    def of_hits(self, t: Array, term: Input) -> Array:
        """The same of each hit alone, (n_hits, n): up to the middle of the rest beside it."""
        ends = [(a.at.stop + b.at.start) / 2 for a, b in itertools.pairwise(self.hits)]
        number = np.searchsorted(ends, (t - self.grid.start) / self.dt)
        return np.asarray((number == np.arange(len(self.hits))[:, None]) * self.at(t, term))

    def _table(self, term: Input) -> Array:
        """At the start and the Gauss points of each step, (n_steps + 1, 4)."""
        if term not in self.tables:
            grid, length = self.grid, self.grid.step / self.dt
            starts = (grid.start - term.delay) / self.dt + length * np.arange(grid.n_steps + 1)
            values = partial(term.at, self.u, dt=self.dt)
            inside = of_steps(values, starts, length, NODES, term.interpolation == "band-limited")
            while len(self.tables) >= _KEPT:
                self.tables.pop(next(iter(self.tables)))
            self.tables[term] = np.column_stack([values(starts), inside])
        return self.tables[term]


@dataclass(frozen=True, eq=False)
class ForcedRecord(Prepared):
    """One forced vibration: what was measured, its inputs, and the smooth motion behind it."""

    decay: ForcedVibration
    signal: Array  # (n,), the measured quantity
    noise: Noise  # white, as strong as the quietest part of the spectrum, or the floor
    # Smooth displacement on the steps of the simulation; times from the start of the record
    motion: Trajectory
    inputs: dict[str, Sampled]  # that were measured, by name
    since: float = 0.0  # where it starts in the record that it is a piece of, s
    creep: float = 0.0

    @classmethod
    def of(
        cls, vibration: ForcedVibration, floor: float, affordable: int = AFFORDABLE
    ) -> ForcedRecord:
        """Look at a record; ``floor`` is the least noise, as a part of the largest value.

        More than the least steps are taken as long as all are no more than is ``affordable``.
        """
        y = vibration.signal
        noise, grid = quiet_noise(y, vibration, floor), steps_for(vibration, affordable)
        motion = smooth_motion(y - y.mean(), vibration.dt, vibration.derivative, grid)
        return cls(vibration, y, noise, motion, inputs_of_record(vibration, grid))

    @cached_property
    def rate(self) -> float:
        """Angular frequency of the motion: rms velocity over rms displacement, rad/s."""
        return float(np.std(self.motion.q_dot) / np.std(self.motion.q))


def quiet_noise(y: Array, vibration: ForcedVibration, floor: float) -> Noise:
    """White, as strong as the quietest part of the spectrum of a channel."""
    least = floor * float(np.abs(y - y.mean()).max())
    return Noise.white(float(np.hypot(quiet_std(y), least)), vibration.dt, least)


def inputs_of_record(vibration: ForcedVibration, grid: Grid) -> dict[str, Sampled]:
    """Inputs by name; forces are 0 where they rest."""
    return {n: Sampled(w.u, vibration.dt, grid, w.hits) for n, w in vibration.windows.items()}


def steps_for(vibration: ForcedVibration, affordable: int, fastest: float = 0.0) -> Grid:
    """Steps short enough for all channels, and for a mode of a frequency, Hz."""
    t, channels = vibration.t - vibration.t[0], vibration.y.reshape(len(vibration.t), -1).T
    found = [_frequencies(y, vibration.dt, vibration.derivative) for y in channels]
    mean, highest = (max(several) for several in zip(*found, strict=True))
    cycle = min(1 / max(mean, fastest), _STEPS / _LEAST_STEPS / highest)
    steps = np.clip(affordable * cycle / t[-1], _STEPS, _MOST_STEPS)
    # A pulse must be seen to bend; what is affordable is so all the same.
    hits = [hit.at for w in vibration.windows.values() for hit in w.hits]
    shortest = min((hit.stop - hit.start for hit in hits), default=np.inf) * vibration.dt
    steps = np.clip(_IN_HIT * cycle / shortest, steps, max(steps, affordable * cycle / t[-1]))
    return Grid.over(t, cycle, int(steps))


def _frequencies(y: Array, dt: float, derivative: int) -> tuple[float, float]:
    """Mean frequency of the displacement, Hz, and that below which nearly all of it lies."""
    frequency = np.fft.rfftfreq(len(y), dt)[1:]
    power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(len(y)))[1:]) ** 2
    noise = falling_power(power, averaged(power)) if derivative else quiet_power(power)
    # The spectrum of a displacement falls: where noise of a rate is divided by it, none is left.
    heard = np.where(power > 10 * noise, power, 0.0) * frequency ** (-2.0 * derivative)
    mean = np.sqrt(np.sum(heard * frequency**2) / np.sum(heard))
    return float(mean), float(frequency[np.searchsorted(np.cumsum(heard), _POWER * heard.sum())])


# -- the inputs of a model in a fit ----------------------------------------------------------------

# Samples by which an input may act later, or sooner, than it was measured.
_LATE = 20
# Participation factors beyond are none: of the mode of a structure it is 1 to 2, and 0 to either
# side of that where the sensor is near a node.
_PARTICIPATION = 20.0


def inputs_in(
    vibrations: Sequence[ForcedVibration], interpolation: Interpolation
) -> tuple[Input, ...]:
    """Inputs of records, those of a name once.

    Raises a ValueError if one has two units.
    """
    found: dict[str, Input] = {}
    for v in vibrations:
        for name, unit in zip(v.names, v.units, strict=True):
            new = Input(name, interpolation, 0.0, unit)
            old = found.setdefault(name, new)
            if old.input_unit != new.input_unit:
                raise ValueError(
                    f"the input {name!r} is in {old.input_unit} and in {new.input_unit}: give both"
                    " records in one unit"
                )
    return tuple(found.values())


def drives_of(model: Equations, records: Sequence[Prepared]) -> tuple[Part, ...]:
    """Parts of the inputs of a model with free gains and delays, from its own on.

    Of several coordinates an input has one delay, and a gain along each of its directions.
    """
    most = latest(records)
    found: dict[Input, dict[tuple[float, ...], float]] = {}
    for term, gain in model.pairs:
        if (law := input_in(term)) is not None:
            weights = (*getattr(term, "weights", ()), *(0.0,) * model.n_coordinates)
            found.setdefault(law, {})[weights[: model.n_coordinates]] = gain
    parts = []
    for law, gains in found.items():
        given = replace(law, delay=0.0), law.delay, most
        drive = DriveAlong(*given, directions=(*gains,)) if model.numbered else Drive(*given)
        parts.append(Part(drive, drive.parameters(), np.array([[*gains.values()]])))
    return tuple(parts)


def impulses_of(drives: Sequence[Part], records: Sequence[Prepared]) -> tuple[Part, ...]:
    """What each hit may have been stronger than its samples say, from nothing on."""
    found = []
    for part in drives:
        if not isinstance(drive := part.effect, Drive):
            continue
        inputs = [r.inputs.get(drive.of.source) for r in records]
        several = [x.hits for x in inputs if isinstance(x, Sampled)]
        count = max(map(len, several), default=0)
        if not count:
            continue
        error = float(np.sqrt(np.mean([hit.error**2 for hits in several for hit in hits])))
        gains = np.asarray(part.strengths[0] @ np.array(drive.directions))
        effect = Impulses(drive.term(), tuple(gains.tolist()), count)
        found.append(Part(effect, (), np.zeros((len(records), count)), error))
    return tuple(found)


def freed(drive: Drive, gain: float) -> Part:
    """An input with its parameters free, and its gain, from this one on."""
    return Part(drive, drive.parameters(), np.array([[gain]]))


def latest(records: Sequence[Prepared]) -> float:
    """By how much an input may act later, or sooner, than it was measured, s."""
    return _LATE * max(r.decay.dt for r in records)


def regressed(
    terms: Sequence[Term],
    inputs: Sequence[Input],
    records: Sequence[Prepared],
    fixed: Mapping[str, float] | None = None,
) -> tuple[Array, Array]:
    """Coefficients of terms, and gains, by least squares on the smooth motions of the records.

    Coefficients that are ``fixed`` keep their value.
    """
    known = np.array([(fixed or {}).get(term.key, np.nan) for term in terms])
    free = np.concatenate([np.isnan(known), np.ones(len(inputs), bool)])
    rows, right = [], []
    for record in records:
        t, *motion = nodes(record.motion)
        q, q_dot, q_ddot = (x[:, 0] for x in motion)
        columns = [term.strong(q, q_dot, q_ddot) for term in terms]
        columns += [
            -term.sign * record.inputs[term.source].at(t, term)
            if term.source in record.inputs
            else np.zeros_like(q)
            for term in inputs
        ]
        rows.append(np.column_stack(columns))
        right.append(-q_ddot)
    table = np.concatenate(rows)
    found = np.concatenate([known, np.zeros(len(inputs))])
    left = np.concatenate(right) - table[:, ~free] @ found[~free]
    scale = np.maximum(np.std(table[:, free], axis=0), 1e-300)
    found[free] = np.linalg.lstsq(table[:, free] / scale, left, rcond=None)[0] / scale
    return found[: len(terms)], found[len(terms) :]


def refuse_displacement(inputs: Sequence[Input], gains: Sequence[float]) -> None:
    """Refuse a base motion that is no acceleration: its sign, and its size, are wrong."""
    for term, factor in zip(inputs, gains, strict=True):
        if term.sign < 0 and term.power == 1 and factor < -_PARTICIPATION:
            raise ValueError(
                f"the input {term.source!r} acts with a participation factor of {factor:.3g}: it"
                " looks like the displacement of the base, or has another unit; give its"
                " acceleration, in the unit of q per s^2"
            )
