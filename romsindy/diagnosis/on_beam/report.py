"""What a diagnosis of a beam found, in words, tables and files."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from romsindy.beam import Beam
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.on_beam.defect import beam_with, effects_of
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.sensor_faults import SensorFault
from romsindy.diagnosis.report import DiagnosisReport, FoundEffect, Verdict
from romsindy.fit.part import Part

_SIDES = ("before", "after")


@dataclass(frozen=True)
class SensorError:
    """Rms of measured minus simulated displacement, over the noise, of one sensor."""

    label: str
    before: float
    after: float


@dataclass(frozen=True, repr=False)
class BeamReport:
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
    """

    reduced: DiagnosisReport
    faults: tuple[SensorFault, ...]
    seen: InstrumentedBeam
    parts: tuple[Part, ...]
    sensor_errors: tuple[SensorError, ...]

    @property
    def verdict(self) -> Verdict:
        """As of the reduced model; "named" where a sensor alone is to blame."""
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
        """Names of the explanations that the data do not tell apart, best first."""
        return self.reduced.equivalent

    @property
    def model(self) -> Beam:
        """The beam with the effects that were found, as far as they exist on a beam."""
        return beam_with(self.seen.beam, self.parts)

    @property
    def recipe(self) -> str:
        """The lines of Python that make `model` from the beam as it was."""
        lines = [f"beam = beam.with_effect({effect!r})" for effect in effects_of(self.parts)]
        return "\n".join(lines) or "# the beam as it was"

    @property
    def gap(self) -> Gap:
        """Before and after, in the coordinate of the first mode, on what took no part."""
        return self.reduced.gap

    @property
    def sentence(self) -> str:
        """The finding in words, sensors first."""
        left_out = "".join(f"The {fault} and was left out. " for fault in self.faults)
        return left_out + self.reduced.sentence.replace("The simulation", "The beam", 1)

    def __repr__(self) -> str:
        return f"<BeamReport: {self.verdict}: {self.sentence}>"

    def table(self) -> list[list[str]]:
        """Rows of text: every explanation that the data allow, with its values."""
        return self.reduced.table()

    def sensor_table(self) -> list[list[str]]:
        """Rows of text: error over noise of every sensor, before and after."""
        rows = [[e.label, f"{e.before:.3g}", f"{e.after:.3g}"] for e in self.sensor_errors]
        return [["sensor: error over noise", "before", "after"], *rows]

    def to_json(self) -> str:
        """Verdict, faults, effects, explanations and gaps as JSON text."""
        content = json.loads(self.reduced.to_json())
        content |= {"verdict": self.verdict, "sentence": self.sentence}
        content["faults"] = [vars(f) for f in self.faults]
        content["sensors"] = [vars(e) for e in self.sensor_errors]
        return json.dumps(content, indent=2)

    def to_csv(self, path: str | Path) -> None:
        """Write the table of explanations."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(self.table())

    def to_html(self, path: str | Path) -> None:
        """Write one self-contained page with figures."""
        from romsindy.diagnosis.pictures import by
        from romsindy.show.page import TextTable, write_report

        before, after = (np.array([getattr(e, k) for e in self.sensor_errors]) for k in _SIDES)
        page = self.reduced.page()
        gap, explanations = page["tables"]
        sensors = TextTable("Sensors of the beam", self.sensor_table())
        by_sensor = by("sensor", [e.label for e in self.sensor_errors], before, after)
        own = {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "equation": self.recipe,
            "equation_note": "",
            "tables": [gap, sensors, explanations],
            "pictures": (*page["pictures"], by_sensor),
        }
        write_report(path, **page | own)
