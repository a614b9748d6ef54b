"""What a diagnosis of a beam found, in words, tables and files.

Which release of a beam would tell apart what its first mode does not: one that rings others.

Rivals that are linear do the same to the first mode, and no amplitude of it tells them apart. Each
says a frequency and a damping of every mode about the equilibrium. How well a record shows these of
a mode that rings with an amplitude A and dies as exp(-r t) in white noise is closed form [1]: with
w = A^2 / (2 sigma^2 dt) and J_n = integral of t^n exp(-2 r t) over the record, the variance of its
frequency, and of r, is 1 / (w (J_2 - J_1^2 / J_0)).

[1] S. Kay, Fundamentals of Statistical Signal Processing: Estimation Theory (1993), ch. 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from romsindy.beam.beam import Beam
from romsindy.beam.structure import FREE
from romsindy.diagnosis import words
from romsindy.diagnosis.evidence import Hypothesis, weights
from romsindy.diagnosis.found import titles, value_with_error
from romsindy.diagnosis.next_test import MOST_ODDS, Advice, Experiment, MoreOfIt, WithoutMotion
from romsindy.diagnosis.on_beam.all_sensors import Latitude, SensorFault
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam, ModesAtRest
from romsindy.diagnosis.on_beam.mounted import PlaceOnBeam
from romsindy.diagnosis.on_beam.parameters import can_be_anywhere, that_do_the_same, where
from romsindy.diagnosis.on_beam.within_tolerances import (
    Adjusted,
    Masked,
    ParameterDirection,
    adjusted,
    beam_with,
    effects_of,
    hidden_in_words,
    in_words,
    linear,
    on_the_beam,
)
from romsindy.diagnosis.structure_report import StructureReport
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import PREDICTED
from romsindy.typing import Array


@dataclass(frozen=True)
class ReleaseWay:
    """A way to let a beam go that could be chosen: pulled, or struck, at a part of its length."""

    words: str
    at: float
    struck: bool = False
    cost: float = 1.0

    def amplitudes(self, beam: Beam, omega: Array, shapes: Array) -> Array:
        """Of the modes, over that of the first."""
        load = beam.point_load((0.0, 1.0), at=self.at * beam.length)
        moved = np.tensordot(shapes, load, axes=load.ndim) / omega ** (1 if self.struck else 2)
        return np.asarray(moved / moved[0])


WAYS = (
    ReleaseWay("a release from a pull at the end that is free", 1.0),
    ReleaseWay("a release from a pull in the middle", 0.5),
    ReleaseWay("a release from a pull at 0.7 of the length", 0.7),
    ReleaseWay("a hit in the middle", 0.5, struck=True),
    ReleaseWay("a hit at 0.7 of the length", 0.7, struck=True),
    ReleaseWay("a hit at the end that is free", 1.0, struck=True),
)


def next_release(
    seen: InstrumentedBeam,
    rivals: Sequence[Hypothesis],
    record: Record,
    noise: Array,
    slack: Latitude,
) -> Advice:
    """The release that would best tell rivals apart, as large as the ``record`` and as long.

    ``noise`` (n_sensors,) are the standard deviations of the sensors, m.
    """
    count, prior = seen.shapes.shape[1], weights(rivals)
    modes = [ModesAtRest.of(beam_with(seen.beam, h.parts), count) for h in rivals]
    basis = seen.beam.modes(count=count)
    releases = [r for r in WAYS if seen.beam.right == FREE or r.at < 1]
    # Of the modes, kg^0.5 m, where the first is as large as in the record.
    sizes = [r.amplitudes(seen.beam, basis.omega, basis.shapes) for r in releases]
    shown = [_told(seen, modes, record.amplitude * a, record, noise, slack) for a in sizes]
    sure = [float(prior @ _posterior(prior, x)) for x in shown]
    best = int(np.argmax(sure))
    odds = min(sure[best] / max(1 - sure[best], 1 / MOST_ODDS), MOST_ODDS)
    names = tuple(titles(h) for h in rivals)
    own = [p.effect.advice for h in rivals for p in h.effects]
    test = releases[best]
    return Advice(test, test.words, odds, names, tuple(dict.fromkeys(own)))


def _told(
    seen: InstrumentedBeam,
    modes: Sequence[ModesAtRest],
    amplitudes: Array,
    record: Record,
    noise: Array,
    slack: Latitude,
) -> Array:
    """Chi-square of each rival, were another the truth, (n, n), by modes beside the first."""
    n = len(modes)
    found = np.zeros((n, n))
    ratio = np.abs(amplitudes) * np.linalg.norm(seen.shapes / noise[:, None], axis=0)
    duration, dt = float(record.t[-1]), record.decay.dt
    for i, true in enumerate(modes):
        variance = [variance_of(a, r, duration, dt) for a, r in zip(ratio, true.rates, strict=True)]
        own = np.array(variance)[1:]
        for j, other in enumerate(modes):
            turned = (other.omega - true.omega)[1:] ** 2
            died = (other.rates - true.rates)[1:] ** 2
            by_frequency = turned / (own + (slack.frequencies * true.omega[1:]) ** 2)
            found[i, j] = np.sum(by_frequency + died / (own + slack.rates**2))
    return found


def variance_of(ratio: float, rate: float, duration: float, dt: float) -> float:
    """Of the frequency, and of the rate, (rad/s)^2, of a mode that dies in white noise.

    The ``ratio`` is that of its amplitude to the noise, ``rate`` (1/s) that at which it dies.
    """
    t = np.linspace(0.0, duration, max(int(duration / dt), 2))
    w = np.exp(-2 * rate * t) * (t[1] - t[0])
    j = [float(np.sum(t**n * w)) for n in range(3)]
    known = ratio**2 / (2 * dt) * (j[2] - j[1] ** 2 / j[0])
    return 1 / known if known > 0 else np.inf


def _posterior(prior: Array, chi_squared: Array) -> Array:
    """Probability of each rival that is expected were it the truth, (n,)."""
    against = prior[None, :] / prior[:, None] * np.exp(-0.5 * chi_squared)
    return np.asarray(1 / np.sum(against, axis=1))


_WEIGHED = Experiment("to weigh the beam", 1.0)


@dataclass(frozen=True, repr=False, kw_only=True)
class BeamReport(StructureReport):
    """What a beam and its sensors lack: a `StructureReport` with more.

    Attributes
    ----------
    faults : tuple of SensorFault
        Sensors that were left out.
    seen : InstrumentedBeam
        The beam as it was, with the sensors that were used.
    slack : Latitude
        What the sensors and the higher modes may do beside what is simulated.
    place : PlaceOnBeam or None
        Where the effect acts, if it is one that can be anywhere.
    loud : tuple of str
        Records in which other modes change the motion of the first: only all sensors tell of them.
    masked : tuple of Masked
        What may be there although values within tolerances alone explain the measurement.
    with_modes : float or None
        What all sensors are left with, over the noise, where higher modes have the frequencies and
        the damping that fit best within what is known of them; None where that was not asked.
    """

    faults: tuple[SensorFault, ...]
    seen: InstrumentedBeam
    slack: Latitude
    place: PlaceOnBeam | None = None
    loud: tuple[str, ...] = ()
    masked: tuple[Masked, ...] = ()
    with_modes: float | None = None

    @property
    def verdict(self) -> str:
        """As of every structure; "named" where a sensor alone is to blame."""
        return "named" if super().verdict == "none" and self.faults else super().verdict

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is missing: faults of sensors first, then effects."""
        return (*(f"sensor_{fault.kind}" for fault in self.faults), *self.reduced.best.names)

    @property
    def model(self) -> Beam:
        """The beam with the effects that were found, as far as they exist on a beam."""
        return beam_with(self.seen.beam, self._first)

    @property
    def recipe(self) -> str:
        """The lines of Python that make `model` from `beam`, the beam as it was."""
        missing = (f"# not on the beam: {label}" for label in self.not_there)
        return "\n".join([recipe_of(effects_of(self._first)), *missing])

    @property
    def _first(self) -> tuple[Part, ...]:
        """Effects of the improved beam; of a family that which an engineer tries first."""
        tried = () if self.trouble or self.family is None else self.family.rivals
        there = (on_the_beam(h.parts) for h in tried if on_the_beam(h.effects))
        return next(there, self.parts)

    @property
    def not_there(self) -> tuple[str, ...]:
        """Effects that nothing on the beam stands for; one of a family stands for all of it."""
        return () if self.family is not None and self._first else super().not_there

    @property
    def adjusted(self) -> tuple[Adjusted, ...]:
        """Parameters that followed the data within their tolerances; empty where none had to."""
        return adjusted(self.reduced.best)

    @cached_property
    def next_test(self) -> Advice | MoreOfIt | None:
        """The test that would best tell apart what these data do not; None where none is needed.

        What does the same to the first mode at any amplitude other modes tell apart: a release that
        rings them. Amplitudes are those of the sensor that moves most.
        """
        rivals, largest = self.reduced.rivals, max(self.reduced.records, key=lambda r: r.amplitude)
        noise = np.array([e.noise for e in self.sensor_errors])
        alike = all(h.effects and linear(h.effects) for h in rivals)
        names = {name for h in rivals for name in h.names}
        if len(rivals) > 1 and names <= that_do_the_same(self.seen.beam):
            return WithoutMotion(_WEIGHED, _WEIGHED.words, 1.0, tuple(titles(h) for h in rivals))
        if self.verdict == "ambiguous" and len(rivals) > 1 and alike and len(noise):
            return next_release(self.seen, rivals, largest, noise, self.slack)
        advice = self.reduced.next_test
        if advice is None:
            return None
        size = self.seen.shown.told(abs(advice.test.amplitude) * largest.amplitude)
        return replace(advice, action=advice.test.words.format(amplitude=size))

    @property
    def _left(self) -> str:
        """As of every structure, and whether higher modes may do that.

        They lose step by radians within what is known of them, and what is left is as large.
        """
        worst = max((e.after for e in self.sensor_errors), default=0.0)
        if self.with_modes is None or not self.with_modes <= PREDICTED < worst:
            return super()._left
        return (
            f"{super()._left} With higher modes that fit best within what is known of their"
            f" frequency and damping it is {self.with_modes:.2g} times the noise over all sensors."
        )

    @property
    def sentence(self) -> str:
        """The finding in words, sensors first."""
        lines = [f"The {fault} and was left out." for fault in self.faults]
        lines += [
            f"Other modes change the first by a tenth or more in {name}: it takes no part in what"
            " is said of the first, and below the records are numbered without it."
            for name in self.loud
        ]
        lines += map(self._placed, self.reduced.lines(self._left, self.next_test))
        if self.trouble:
            lines.append(f"The beam could not be simulated with this: {self.trouble}.")
        elif self.not_there:
            lines.append(f"Not on the improved beam: {', '.join(self.not_there)}.")
        untold = self.trouble or self.family or self.reduced.refused
        place = None if untold else self.place
        if place is not None and not (place.told or place.strengths):
            lines.append(f"Place: {place}.")
        moved = [e for e in self.reduced.within if e.label != ParameterDirection.label]
        hidden = hidden_in_words(self.masked)
        return "\n".join([*lines, *words.within(moved), *in_words(self.adjusted), *hidden])

    def _placed(self, line: str) -> str:
        """A line on what is missing with its place as closely as the data tell it."""
        movable = [p for p in self.reduced.best.effects if can_be_anywhere(p.effect)]
        if self.place is None or self.trouble or len(movable) != 1:
            return line
        if not line.startswith("Missing: "):
            return line
        usual = where(movable[0])
        if self.place.told:
            line = line.replace(usual, in_interval(self.place), 1)
        if not self.place.strengths:
            return line
        there = " to ".join(f"{x:.2g}" for x in self.place.strengths)
        if self.place.told:
            found = next(e for e in self.effects if e.name == movable[0].effect.name)
            value, error = (of["strength"] for of in (found.values, found.standard_errors))
            return line.replace(value_with_error(value, error), f"{value:.2g} ({there})", 1)
        unit = movable[0].effect.strength_unit(self.reduced.model.unit)
        there = f"{self.place}, {there} {unit} there; {usual} it would be "
        return line.replace(f"{usual}, ", there, 1)

    def _content(self) -> dict[str, Any]:
        return {
            **super()._content(),
            "faults": [vars(f) for f in self.faults],
            "adjusted": [vars(a) for a in self.adjusted],
            "place": None if self.place is None else vars(self.place),
            "loud": list(self.loud),
            "masked": [vars(m) for m in self.masked],
            "with_modes": self.with_modes,
        }


def in_interval(place: PlaceOnBeam) -> str:
    """A place and its interval, to the digit in which the interval's error lies."""
    decimals = max(-math.floor(math.log10((place.high - place.low) / 4)), 0)
    at, low, high = (f"{x:.{decimals}f}" for x in (place.at, place.low, place.high))
    return f"at {at} m ({low} to {high} m)"


def recipe_of(effects: Sequence[Any]) -> str:
    """Lines of Python, imports first, that add effects to `beam`."""
    kinds = {kind for effect in effects for kind in _kinds(effect)}
    imports = sorted(f"from {kind.__module__} import {kind.__name__}" for kind in kinds)
    with np.printoptions(legacy="1.25"):  # 0.2 and not np.float64(0.2)
        lines = [f"beam = beam.with_effect({effect!r})" for effect in effects]
    return "\n".join([*imports, *lines]) or "# the beam as it was"


def _kinds(value: Any) -> Iterator[type]:
    """Classes in the text of a value: its own, and those of its fields."""
    if is_dataclass(value):
        yield type(value)
        for field in fields(value):
            yield from _kinds(getattr(value, field.name))
