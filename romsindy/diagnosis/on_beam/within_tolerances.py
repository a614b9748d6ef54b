"""What a beam is known to within tolerances, in as few directions as the data can tell apart.

Many parameters of a beam do the same to one mode: a stiffer material, less density, less length.
Their changes x, over their standard deviations, have the prior N(0, 1) and move the readings, over
the noise, by J x. The singular vectors of J are the combinations that the data see; those that move
nothing stay at zero. A fit knows one strength z for each vector v that is kept, and x = V z.

What the first mode leaves open of these, and of what is missing, higher modes tell: they have
frequencies and rates that other combinations move. The first mode is then the prior.

A clamp that gives way lowers the frequency of the first mode, as a softer material does, so that
values may hide it. To first order their changes x move this frequency and the rate of decay with
the covariance S, and a unit of what is missing moves them by g. Where the measurement asks for the
change d, it has the strength (g' S^-1 d) / (g' S^-1 g), with the variance 1 / (g' S^-1 g).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any, cast

import numpy as np
from scipy.linalg import block_diag

from romsindy.beam.beam import Beam
from romsindy.beam.equilibrium import NoEquilibriumError
from romsindy.diagnosis.evidence import FAR, Hypothesis
from romsindy.diagnosis.on_beam.all_sensors import OpenValues
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam, ModesAtRest
from romsindy.diagnosis.on_beam.mounted import BeamEffect, DampingEffect
from romsindy.diagnosis.on_beam.parameters import PLACED_MASS, TOLD, ParameterEffect
from romsindy.diagnosis.search import screen
from romsindy.diagnosis.structure import key_of
from romsindy.effects import Gain, Viscous
from romsindy.effects.base import TermEffect
from romsindy.effects.mounting import Mounting
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Combination
from romsindy.text import listed, two_digits
from romsindy.typing import Array

_FELT = 0.3  # a combination that moves the readings by less, in standard deviations, is left out
_CHANGE = 0.3  # standard errors, for what a change of a value does to higher modes
_SHIFT = 1e-4  # of a sensor, for a difference, as a part of the length
# Linear effects that a beam can have and that nobody thought of; values are known to tolerances.
_LINEAR = ("clamp_compliance", PLACED_MASS, Viscous.name)
# What a record tells of the frequency and the rate of the first mode at the best, relative; and of
# a rate that is nearly none, over the frequency.
_FREQUENCY, _RATE, _LEAST_RATE = 1e-5, 2e-3, 1e-6
_SMALL = 1e-3  # changes of the logarithm of the frequency, for a difference
_DAMPER = 1e-3  # N s/m: rates are linear in it


@dataclass(frozen=True, eq=False)
class ParameterDirection(TermEffect, BeamEffect):
    """A combination of parameters; its strength is in standard deviations.

    ``vector`` are the changes of its parameters for a unit of strength, over ``deviations``; it
    moves the readings by ``felt`` standard deviations of their noise.
    """

    of: tuple[ParameterEffect, ...]
    deviations: Array
    vector: Array
    felt: float
    name: str  # type: ignore[misc]

    label = "parameters that are off together"
    family = "beam"
    tolerance = 1.0
    fixed_unit = "standard deviations"
    advice = "a second mode, or the deflection under a known weight"

    @property
    def seen(self) -> bool:
        """Whether the records see it."""
        return self.felt > _FELT

    @cached_property
    def direction(self) -> Combination:
        """What a unit of strength does to the coefficients."""
        directions = [p.direction for p in self.of]
        weights = self.vector * self.deviations @ np.array([d.weights for d in directions])
        return Combination(self.name, directions[0].terms, tuple(weights.tolist()))

    def term(self) -> Combination:
        return self.direction

    def on_beam(self, strength: float, mounting: Mounting | None = None) -> Any:
        """One change of the beam for every parameter: see `changes_of`."""
        return _changes(self, strength * self.vector)


@dataclass(frozen=True)
class PositionError(Gain):
    """Sensors that are a little off their places read another size of the one coordinate."""

    tolerance: float = 0.0  # type: ignore[misc]

    name = "sensor_positions"
    label = "sensors off their places"
    advice = "measure where the sensors are"


@dataclass(frozen=True)
class Adjusted:
    """A parameter that followed the data within its tolerance."""

    name: str
    unit: str
    tolerance: float  # the standard deviation that was given
    # What became of it, beside all others
    change: float
    std: float
    alone: float  # what it would have to be, were it the only one that is wrong
    left: float  # by how much chi-square would rise then

    def __str__(self) -> str:
        way = "up" if self.alone > 0 else "down"
        scale, unit = (100.0, "%") if self.unit.startswith("of ") else (1.0, self.unit)
        size, known = (f"{two_digits(scale * x)} {unit}" for x in (abs(self.alone), self.tolerance))
        return f"{self.name.replace('_', ' ')} {way} {size} (tolerance {known})"

    @property
    def enough(self) -> bool:
        """Whether it, alone and within its tolerance, would explain what was measured."""
        return self.left < EQUIVALENT and abs(self.alone) <= FAR * self.tolerance


def position_error(seen: InstrumentedBeam, deviation: float) -> PositionError:
    """Sensors that are each off by a standard deviation, m."""
    of_each = np.linalg.pinv(seen.shapes)[0] * seen.shapes[:, 0] * position_gains(seen, deviation)
    return PositionError(float(np.linalg.norm(of_each)))


def position_gains(seen: InstrumentedBeam, deviation: float) -> Array:
    """Errors of the gains of sensors that are each off by a standard deviation, m, (n_sensors,)."""
    return np.asarray(np.abs(deviation * slopes(seen)[:, 0] / seen.shapes[:, 0]))


def slopes(seen: InstrumentedBeam) -> Array:
    """Of the mode shapes at the sensors, per m along the beam, (n_sensors, n_modes)."""
    modes = seen.shapes.shape[1]
    step = _SHIFT * seen.beam.length
    at = np.array([s.at for s in seen.sensors.sensors])
    steps = np.where(at + step < seen.beam.length, step, -step)
    inwards = [replace(s, at=s.at + x) for s, x in zip(seen.sensors.sensors, steps, strict=True)]
    there = seen.beam.sensors(inwards).mode_shapes(seen.basis, modes)
    return np.asarray((there - seen.shapes) / steps[:, None])


def directions(
    model: ReducedModel,
    records: Sequence[Record],
    parameters: Sequence[ParameterEffect],
    deviations: Array,
) -> tuple[ParameterDirection, ...]:
    """The combinations of parameters, those that the records see best first.

    ``deviations`` (n_parameters,) are their standard deviations.
    """
    seen = _information(model, records, parameters) * np.multiply.outer(deviations, deviations)
    squares, vectors = np.linalg.eigh(seen)
    known, felt = tuple(parameters), np.sqrt(np.clip(squares, 0.0, None))
    return tuple(
        ParameterDirection(known, deviations, vectors[:, i], float(felt[i]), f"tolerances_{n}")
        for n, i in enumerate(np.argsort(-squares), 1)
    )


def _information(
    model: ReducedModel, records: Sequence[Record], parameters: Sequence[ParameterEffect]
) -> Array:
    """J'J of the whitened readings by the parameters, initial states marginalised."""
    system = screen(model, (), parameters, records).system
    n = system.size - len(parameters)
    states, cross = system.matrix[:n, :n], system.matrix[:n, n:]
    left = system.matrix[n:, n:] - cross.T @ np.linalg.pinv(states, hermitian=True) @ cross
    return np.asarray((left + left.T) / 2)


def changes_of(parts: Sequence[Part]) -> list[Any]:
    """What `Beam.with_effect` takes, of all directions: one change for every parameter."""
    found = [p for p in parts if isinstance(p.effect, ParameterDirection)]
    if not found:
        return []
    effects = [cast(ParameterDirection, p.effect) for p in found]
    together = sum(float(p.strengths[0, 0]) * e.vector for p, e in zip(found, effects, strict=True))
    return list(_changes(effects[0], np.asarray(together)))


def _changes(one: ParameterDirection, x: Array) -> tuple[Any, ...]:
    pairs = zip(one.of, (x * one.deviations).tolist(), strict=True)
    return tuple(p.on_beam(change) for p, change in pairs)


def adjusted(found: Hypothesis) -> tuple[Adjusted, ...]:
    """What the parameters within tolerances became: x = V z, and its covariance.

    Empty where the data did not move them.
    """
    chosen = [i for i, p in enumerate(found.parts) if isinstance(p.effect, ParameterDirection)]
    at = [found.solution.slices()[i].start for i in chosen]
    z = np.array([found.parts[i].strengths[0, 0] for i in chosen])
    effects = [cast(ParameterDirection, found.parts[i].effect) for i in chosen]
    felt = np.array([e.felt for e in effects])
    if not np.sum((felt * z) ** 2) > EQUIVALENT:
        return ()
    of, deviations = effects[0].of, effects[0].deviations
    vectors = np.array([e.vector for e in effects]).T
    learned = vectors @ (np.eye(len(z)) - found.covariance[np.ix_(at, at)]) @ vectors.T
    std = np.sqrt(np.clip(1.0 - np.diag(learned), 0.0, 1.0))
    shown, own = vectors @ (felt**2 * z), vectors**2 @ felt**2
    alone = shown / np.maximum(own, 1e-300)
    left = np.sum((felt * z) ** 2) - shown * alone
    columns = np.stack([vectors @ z, std, alone]) * deviations
    rows = zip(of, deviations, *columns, left, strict=True)
    return tuple(Adjusted(p.name, p.fixed_unit, *map(float, values)) for p, *values in rows)


def in_words(found: Sequence[Adjusted]) -> list[str]:
    """One finding for what the data do not tell apart; empty where nothing moved."""
    if not found:
        return []
    either = sorted((a for a in found if a.enough), key=lambda a: abs(a.alone / a.tolerance))
    asked = f"Within the tolerances the data ask for {' or '.join(map(str, either))}"
    if len(either) == 1:
        return [f"{asked}."]
    if either:
        shown = "and show but one combination of them"
        return [f"{asked}, {shown}. To separate them: {ParameterDirection.advice}."]
    most = sorted(found, key=lambda a: -abs(a.change / a.tolerance))[:3]
    moved = [str(replace(a, alone=a.change)) for a in most]
    told = f"{', '.join(moved)}, most of all"
    return [f"Of the values with tolerances several moved together: {told}."]


def effects_of(parts: Sequence[Part]) -> list[Any]:
    """What `Beam.with_effect` takes, of some parts."""
    there = on_the_beam(parts)
    own = [p for p in there if not isinstance(p.effect, ParameterDirection)]
    return changes_of(there) + [p.effect.on_beam(float(p.strengths[0, 0])) for p in own]


def beam_with(beam: Beam, parts: Sequence[Part]) -> Beam:
    """The beam with the effects of some parts.

    Raises a NoEquilibriumError if there can be no such beam.
    """
    try:
        return reduce(Beam.with_effect, effects_of(parts), beam)
    except ValueError as error:
        raise NoEquilibriumError(f"there is no such beam: {error}") from error


def on_the_beam(parts: Sequence[Part]) -> tuple[Part, ...]:
    """Parts that exist on a beam and are there."""
    return tuple(p for p in parts if isinstance(p.effect, BeamEffect) and np.any(p.strengths))


def linear(parts: Sequence[Part]) -> bool:
    """Whether effects change a beam at all amplitudes alike."""
    kinds = (DampingEffect, ParameterEffect, ParameterDirection)
    return all(isinstance(p.effect, kinds) or p.effect.name == Viscous.name for p in parts)


@dataclass(frozen=True, eq=False)
class Opened:
    """Parts on a beam, and how far their strengths may be from what its first mode says."""

    parts: tuple[Part, ...]
    units: Array  # (n,), of the strengths: their standard errors
    known: Array  # (m, n), see `OpenValues`
    off: Array  # (n,), how far they were moved, in their units

    @classmethod
    def of(cls, h: Hypothesis, unseen: Sequence[Part]) -> Opened:
        """Of what was fitted to the first mode, and of parts that move it by nothing.

        Shape values stay as they are.
        """
        pairs = zip(h.parts, h.solution.slices(), strict=True)
        rows = [(p, own) for p, own in pairs if isinstance(p.effect, BeamEffect)]
        values = [i for _, own in rows for i in range(own.start, own.stop)]
        first = np.cumsum([0, *(p.size for p, _ in rows)])[:-1]
        covariance = h.covariance[np.ix_(values, values)]
        errors = np.sqrt(np.diag(covariance))
        size = np.where(errors > 0, errors, 1.0)
        information = np.linalg.pinv(covariance / np.outer(size, size), hermitian=True)
        squares, vectors = np.linalg.eigh(information[np.ix_(first, first)])
        root = np.sqrt(np.clip(squares, 0.0, None))[:, None] * vectors.T
        parts = (*(p for p, _ in rows), *unseen)
        units = np.append(errors[first], np.ones(len(unseen)))
        return cls(parts, units, block_diag(root, np.eye(len(unseen))), np.zeros(len(units)))

    def moved(self, step: Array) -> Opened:
        """The same with strengths moved by a step, in their units, as far as they can be."""
        parts = tuple(
            p.moved(np.append(x, np.zeros(p.size - 1)))
            for p, x in zip(self.parts, step * self.units, strict=True)
        )
        gone = [
            (q.values - p.values)[0] / unit if unit else 0.0
            for p, q, unit in zip(self.parts, parts, self.units, strict=True)
        ]
        return replace(self, parts=parts, off=self.off + gone)

    def with_part(self, before: Part, after: Part) -> Opened:
        """The same with one of the parts elsewhere on the beam."""
        larger = abs(float(after.values[0] / before.values[0]))
        parts = tuple(after if p is before else p for p in self.parts)
        units = self.units * [larger if p is before else 1.0 for p in self.parts]
        return replace(self, parts=parts, units=units)

    def changes(self, since: Opened) -> dict[tuple[str, str], Array]:
        """By how much values changed, by the keys of their parts."""
        pairs = zip(since.parts, self.parts, strict=True)
        return {key_of(after): after.values - before.values for before, after in pairs}

    def values(self, seen: InstrumentedBeam) -> OpenValues:
        """What they do to the higher modes of the beam about its equilibrium."""
        count = seen.shapes.shape[1]

        def modes(parts: Sequence[Part]) -> Array:
            # Forces that are no springs and dampers have no rate there.
            found = ModesAtRest.of(beam_with(seen.beam, [p for p in parts if linear([p])]), count)
            return np.stack([np.log(found.omega), found.rates], axis=1)[1:].ravel()

        here, slopes = modes(self.parts), np.zeros((2 * (count - 1), len(self.parts)))
        for i, e in enumerate(np.eye(len(self.parts))):
            for step in (_CHANGE, -_CHANGE):  # one that is at its limit can but go back
                if there := float((tried := self.moved(step * e)).off[i] - self.off[i]):
                    slopes[:, i] = (modes(tried.parts) - here) / there
                    break
        return OpenValues(slopes, self.known, self.off)


@dataclass(frozen=True)
class Masked:
    """An effect that may be there although values within tolerances explain the measurement."""

    name: str
    label: str
    most: float  # its strength is less, at 95 %
    unit: str

    def __str__(self) -> str:
        return f"{self.label}, up to {two_digits(self.most)} {self.unit}"


def masked(
    seen: InstrumentedBeam,
    found: Hypothesis,
    unsure: Sequence[Part],
    effects: Sequence[BeamEffect],
    known: Collection[str],
) -> tuple[Masked, ...]:
    """What values within their tolerances may hide, the first of ``effects`` of each kind.

    ``found`` explains the measurement by values alone, whether or not these had to move; those that
    are ``unsure``, of the names ``known``, have tolerances.
    """
    beam, there = seen.beam, beam_with(seen.beam, found.parts)
    usual = _first_mode(beam)
    asked = _first_mode(there) - usual
    off = np.reshape([_first_mode(x) - usual for x in _one_off(beam, unsure)], (-1, 2))
    noise = np.array([_FREQUENCY, _RATE * usual[1] + _LEAST_RATE * np.exp(usual[0])])
    weight = np.linalg.inv(off.T @ off + np.diag(noise**2))
    first = {e.name: e for e in reversed(effects) if e.name in _LINEAR and e.name not in known}
    hidden = []
    for name in (n for n in _LINEAR if n in first):
        effect = first[name]
        step = _step(effect, beam)
        by = (_first_mode(beam.with_effect(effect.on_beam(step))) - usual) / step
        precision = float(by @ weight @ by)
        most = float(by @ weight @ asked) / precision + TOLD * precision**-0.5
        if most > 0:
            hidden.append(Masked(name, effect.label, most, effect.strength_unit(None)))
    return tuple(hidden)


def hidden_in_words(hidden: Sequence[Masked]) -> list[str]:
    """A sentence; empty where there is nothing to tell."""
    if not hidden:
        return []
    told = listed(hidden, "or")
    return [f"Values within tolerances may hide from the first mode: {told}."]


def _first_mode(beam: Beam) -> Array:
    """Logarithm of its angular frequency, and its rate of decay, 1/s."""
    found = ModesAtRest.of(beam, 1)
    return np.array([np.log(found.omega[0]), found.rates[0]])


def _one_off(beam: Beam, unsure: Sequence[Part]) -> Iterator[Beam]:
    """The beam with each of the values a standard deviation off."""
    for part in unsure:
        if isinstance(part.effect, BeamEffect) and part.tolerance is not None:
            yield beam_with(beam, [replace(part, strengths=np.array([[part.tolerance]]))])


def _step(effect: BeamEffect, beam: Beam) -> float:
    """A strength for a difference: it changes the frequency, or the rate, by little."""
    if not isinstance(effect, ParameterEffect):
        return _DAMPER
    omega2 = float(beam.modes(count=1).omega[0]) ** 2
    return 2 * _SMALL * omega2 / abs(effect.linear_shift(omega2))
