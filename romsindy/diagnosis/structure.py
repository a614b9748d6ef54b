"""A structure that a diagnosis simulates beside its equation: a beam, or a user's own simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from romsindy.effects import LinearFrequency, Viscous
from romsindy.fit.kernel.collocation import integrate
from romsindy.fit.kernel.equation import ExtendedEquation, equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.linear_response import sampled
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record, scales
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import SIGNALS, Decay
from romsindy.record.noise import Noise
from romsindy.record.smoothing import HarmonicSpline
from romsindy.typing import Array

# A cycle is left out that differs by so many times the median of so many later ones.
_RESTLESS, _NEXT = 1.3, 8
_FLOOR = 1e-6  # of the largest reading: the least noise
_SLOW = 3  # cycles from knot to knot of what is no noise of a sensor
_UNSURE = 0.015  # of what the modes above the first do, as it is simulated


class AskedMotion(NamedTuple):
    """A motion over a record, from a state of the coordinate on."""

    equation: ExtendedEquation  # of the coordinate, with the same parts
    parts: Sequence[Part]
    record: Record
    start: tuple[float, float]
    release: Any  # what was found before, or None


class Moved(NamedTuple):
    """A simulated motion over a record."""

    readings: Sequence[Array]  # displacements, velocities, accelerations, (n, n_sensors) each
    start: tuple[float, float]  # coordinate and its rate, as they were simulated
    release: Any  # what is known of the start from now on


class Corrected(NamedTuple):
    """A decay without the defect, what the sensors of the structure in it read, and its release."""

    decay: Decay
    readings: Array  # (n, n_sensors), in what was measured
    start: tuple[float, float]  # coordinate and its rate
    release: Any


class SimulatedStructure(Protocol):
    """What is simulated beside its equation of one coordinate."""

    @property
    def what(self) -> str:
        """What progress calls it."""

    @property
    def failures(self) -> tuple[type[Exception], ...]:
        """What is raised where it cannot be simulated."""

    @property
    def apart(self) -> bool:
        """Whether records may be simulated in processes of their own."""

    def coordinate(self, displacements: Array) -> Array:
        """The coordinate of its equation, (...,), from sensors (..., n_sensors)."""

    def with_effects(self, parts: Sequence[Part]) -> tuple[Part, ...]:
        """Parts that can be on it, and are there."""

    def start(
        self, model: ReducedModel, parts: Sequence[Part], record: Record
    ) -> tuple[float, float]:
        """Coordinate and its rate at the start of a record."""

    def moved(self, asked: AskedMotion, decay: Decay) -> Moved:
        """Simulate it; the decay is what all sensors measured in the record."""


def corrected(
    structure: SimulatedStructure,
    model: ReducedModel,
    parts: Sequence[Part],
    record: Record,
    decay: Decay,
    release: Any,
    smooth: Record,
    needed: Sequence[Part] | None = None,
) -> Corrected:
    """Simulate a structure and its equation, both with the parts that it can have.

    The equation has those that are ``needed``, if it needs others for the same motion.

    Only the coordinate and its rate at the start are fitted: to the record of the coordinate, or to
    one that was corrected before, ``smooth``, from which higher modes are gone. The decay holds
    what all sensors measured, as fast as they did.
    """
    parts = structure.with_effects(parts)
    needed = parts if needed is None else needed
    equation = equation_of(model, needed, 0, record)
    start = structure.start(model, needed, smooth)
    asked = AskedMotion(equation, parts, record, start, release)
    moved, start, release = structure.moved(asked, decay)
    reduced = integrate(equation, np.array(start), record.motion.grid)
    changed: dict[str, Any] = {}
    for name, measured in record.decay.signals.items():
        order = SIGNALS.index(name)
        beside = structure.coordinate(moved[order]) - sampled(reduced, order)[:, 0]
        changed[name] = measured - beside
        if order == record.derivative:
            left = _UNSURE * float(np.std(beside))
            changed["leftover"] = np.hypot(record.decay.leftover, left)
    return Corrected(replace(record.decay, **changed), moved[record.derivative], start, release)


def channel_noises(record: Record, decay: Decay, floor: float) -> tuple[Noise, ...]:
    """Noise of every sensor that measured a decay, whose coordinate is a record.

    ``floor`` is the least, as a part of the largest reading.
    """
    clock = decay.t - decay.t[0]
    amplitude, cycle = np.abs(record.spline.amplitudes(clock)[:, 1]), 2 * np.pi / record.rate
    found = []
    for x in decay.signal.reshape(len(clock), -1).T:
        smooth = HarmonicSpline.along(record.spline.phase, clock, x, _SLOW)
        rest, least = x - smooth(clock)[0], floor * float(np.abs(x).max())
        found.append(Noise.of(rest, smooth.midline(clock), amplitude, cycle, decay.dt, least))
    return tuple(found)


def key_of(part: Part) -> tuple[str, str]:
    """What tells parts of a hypothesis apart."""
    return part.effect.name, part.effect.variant


def start_of(
    model: ReducedModel, parts: Sequence[Part], record: Record, *, fixed: bool = True
) -> tuple[float, float]:
    """Coordinate and its rate at the start of a record, which the equation follows.

    Unless they are ``fixed``, values of the parts follow the record as well.
    """
    solution = fit(model, parts, [record], fixed=fixed, iterations=25)
    q, q_dot = (solution.motions[0] if solution.finite else record.motion).start
    return float(q), float(q_dot)


def linear_parts(record: Record) -> list[Part]:
    """Linear stiffness and damping as what is missing beside a record."""
    return [Part.of(e, scales([record]), 1) for e in (LinearFrequency(), Viscous())]


def calm_from(record: Record, readings: Array) -> float:
    """Time from which on a simulated beam, seen in the coordinate, follows a record well.

    Modes that are too fast to be read from the sensors ring in the first cycles.
    """
    cycles = np.split(readings - record.signal, record.cycles)
    rms = np.array([np.std(x) for x in cycles[1:-1]])
    first = 0
    while first < len(rms) // 4 and rms[first] > _RESTLESS * np.median(rms[first + 1 :][:_NEXT]):
        first += 1
    return float(record.decay.t[record.cycles[first] if first else 0])


@dataclass(frozen=True)
class SensorError:
    """Rms of measured minus simulated displacement, over the noise, of one sensor."""

    label: str
    before: float
    after: float
    part: float  # the rms afterwards, as a part of that of the response
    noise: float  # standard deviation, unit of what it reads


def sensor_errors(
    labels: Sequence[str], decay: Decay, both: Sequence[Corrected]
) -> tuple[SensorError, ...]:
    """Every sensor against the structure before and after, in one record."""
    decay = decay.between(end=both[0].decay.t[-1])
    readings = decay.signal.reshape(-1, len(labels))
    record = Record.of(both[-1].decay.between(decay.t[0]), _FLOOR)
    noise = np.array([n.std for n in channel_noises(record, decay, _FLOOR)])
    left = [readings - c.readings[-len(readings) :] for c in both]
    before, after = (np.sqrt(np.mean(x**2, axis=0)) for x in left)
    told = before / noise, after / noise, after / np.std(readings, axis=0), noise
    return tuple(SensorError(*row) for row in zip(labels, *told, strict=True))


def with_signal(decay: Decay, signal: Array) -> Decay:
    """The same with another signal (n,) in the place of what its sensor gave."""
    given: dict[str, Any] = {SIGNALS[decay.derivative]: signal}
    return replace(decay, **given)


def as_measured(record: Record, simulated: Array) -> Record:
    """A record of a simulated signal (n,), with the noise of a measured one: as much is learnt."""
    own = Record.of(with_signal(record.decay, simulated), 1e-4)
    return replace(own, noise=record.noise, doubts=record.doubts, first=record.first)
