"""What a diagnosis of a beam found, in words, tables and files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from romsindy.beam.beam import Beam
from romsindy.diagnosis import words
from romsindy.diagnosis.found import FoundEffect
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.next_test import Advice
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.place import PlaceOnBeam
from romsindy.diagnosis.on_beam.sensor_faults import SensorFault
from romsindy.diagnosis.on_beam.within_tolerances import (
    Adjusted,
    adjusted,
    beam_with,
    effects_of,
    in_words,
)
from romsindy.diagnosis.report import DiagnosisReport, Written
from romsindy.diagnosis.verdict import Verdict
from romsindy.fit.kernel.part import Part
from romsindy.text import TextTable

if TYPE_CHECKING:
    from romsindy.show.page import Picture

_SIDES = ("before", "after", "part")


@dataclass(frozen=True)
class SensorError:
    """Rms of measured minus simulated displacement, over the noise, of one sensor."""

    label: str
    before: float
    after: float
    part: float  # the rms afterwards, as a part of that of the response


@dataclass(frozen=True, repr=False)
class BeamReport(Written):
    """What a beam and its sensors lack.

    Attributes
    ----------
    reduced : DiagnosisReport
        In the coordinate of the first mode, after what the beam does beside its reduced model was
        taken off.
    faults : tuple of SensorFault
        Sensors that were left out.
    seen : InstrumentedBeam
        The beam as it was, with the sensors that were used.
    parts : tuple of Part
        Effects that were simulated on the beam.
    sensor_errors : tuple of SensorError
        On the record that was held out, or the last: the beam before and after.
    trouble : str
        Why the beam could not be simulated with what was found; empty where it could.
    place : PlaceOnBeam or None
        Where the effect acts, if it is one that can be anywhere.
    """

    reduced: DiagnosisReport
    faults: tuple[SensorFault, ...]
    seen: InstrumentedBeam
    parts: tuple[Part, ...]
    sensor_errors: tuple[SensorError, ...]
    trouble: str = ""
    place: PlaceOnBeam | None = None

    @property
    def verdict(self) -> Verdict:
        """As of the reduced model; "named" where a sensor alone is to blame.

        It is "unknown" where the beam could not be simulated with what was found.
        """
        if self.trouble:
            return "unknown"
        if self.reduced.verdict == "none" and self.faults:
            return "named"
        return self.reduced.verdict

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """Effects of the best hypothesis; strengths are those on the beam."""
        return self.reduced.effects

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is missing: faults of sensors first, then effects."""
        return (*(f"sensor_{fault.kind}" for fault in self.faults), *self.reduced.best.names)

    @property
    def equivalent(self) -> tuple[tuple[str, ...], ...]:
        return self.reduced.equivalent

    @property
    def model(self) -> Beam:
        """The beam with the effects that were found, as far as they exist on a beam."""
        return beam_with(self.seen.beam, self.parts)

    @property
    def recipe(self) -> str:
        """The lines of Python that make `model` from `beam`, the beam as it was."""
        missing = (f"# not on the beam: {label}" for label in self.not_on_beam)
        return "\n".join([recipe_of(effects_of(self.parts)), *missing])

    @property
    def not_on_beam(self) -> tuple[str, ...]:
        """Effects of the best hypothesis that no force or parameter of a beam stands for."""
        there = {p.effect.name for p in self.parts}
        return tuple(e.label for e in self.effects if e.name not in there)

    @property
    def adjusted(self) -> tuple[Adjusted, ...]:
        """Parameters that followed the data within their tolerances; empty where none had to."""
        return adjusted(self.reduced.best)

    @property
    def gap(self) -> Gap:
        """Before and after, in the coordinate of the first mode, on what took no part."""
        return self.reduced.gap

    @cached_property
    def next_test(self) -> Advice | None:
        """The test that would best tell apart what these data do not; None where none is needed.

        Its amplitude is that of the sensor that moves most.
        """
        advice = self.reduced.next_test
        if advice is None:
            return None
        shape, labels = np.abs(self.seen.shapes[:, 0]), self.seen.sensors.labels
        largest = shape.max() * max(record.amplitude for record in self.reduced.records)
        where = labels[int(np.argmax(shape))]
        return replace(advice, action=advice.test.action(largest, f"m in {where}"))

    @property
    def interrupted(self) -> bool:
        """Whether the search was stopped before its end."""
        return self.reduced.interrupted

    @property
    def sentence(self) -> str:
        """The finding in words, sensors first."""
        lines = [f"The {fault} and was left out." for fault in self.faults]
        lines += self.reduced.lines(self._left)
        if self.trouble:
            lines.append(f"The beam could not be simulated with this: {self.trouble}.")
        elif self.not_on_beam:
            lines.append(f"Not on the improved beam: {', '.join(self.not_on_beam)}.")
        if self.place is not None and not self.trouble:
            lines.append(f"Place: {self.place}.")
        return "\n".join([*lines, *filter(None, [in_words(self.adjusted)])])

    @property
    def _left(self) -> str:
        """What is left over all sensors, the worst of them by name."""
        gap, kind = self.gap, self.reduced.left
        known = [e for e in self.sensor_errors if np.isfinite(e.after)]
        if not known:
            return words.remainder(gap, kind)
        worst = max(known, key=lambda e: e.after)
        return words.over_sensors(gap, kind, worst.label, worst.part, worst.after)

    def table(self) -> list[list[str]]:
        return self.reduced.table()

    def sensor_table(self) -> list[list[str]]:
        """Rows of text: error over noise of every sensor, before and after."""
        rows = [[e.label, f"{e.before:.3g}", f"{e.after:.3g}"] for e in self.sensor_errors]
        return [["sensor: error over noise", "before", "after"], *rows]

    def _content(self) -> dict[str, Any]:
        content = json.loads(self.reduced.to_json())
        content |= {"verdict": self.verdict, "sentence": self.sentence}
        content["faults"] = [vars(f) for f in self.faults]
        content["adjusted"] = [vars(a) for a in self.adjusted]
        content["place"] = None if self.place is None else vars(self.place)
        content["sensors"] = [vars(e) for e in self.sensor_errors]
        return content

    def pictures(self) -> dict[str, Picture]:
        """Pictures by name, as those of a `DiagnosisReport`, and "sensor"."""
        from romsindy.diagnosis.pictures import by

        errors = [np.array([getattr(e, k) for e in self.sensor_errors]) for k in _SIDES]
        sensors = by("sensor", [e.label for e in self.sensor_errors], *errors)
        return {**self.reduced.pictures(), sensors.name: sensors}

    def page(self) -> dict[str, Any]:
        """What the page shows beside the pictures, with a table of the sensors."""
        page = self.reduced.page()
        gap, *explanations = page["tables"]
        sensors = TextTable("Sensors of the beam", self.sensor_table())
        own = {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "formula": [],
            "equation": self.recipe,
            "equation_note": "",
            "tables": [gap, sensors, *explanations],
        }
        return page | own


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
