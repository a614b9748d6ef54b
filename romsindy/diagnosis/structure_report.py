"""What reports on structures share: a beam, or a user's own simulator, seen through sensors."""

from __future__ import annotations

import json
from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from romsindy.diagnosis import words
from romsindy.diagnosis.found import EffectFamily, FoundEffect
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.next_test import Advice, MoreOfIt
from romsindy.diagnosis.report import Written, in_json
from romsindy.diagnosis.structure import SensorError
from romsindy.fit.kernel.part import Part
from romsindy.text import TextTable

if TYPE_CHECKING:
    from romsindy.show.page import Picture

_SIDES = ("before", "after", "part")


@dataclass(frozen=True, repr=False, kw_only=True)
class StructureReport(Written):
    """What a structure lacks: in its coordinate, and on the structure itself.

    Attributes
    ----------
    reduced : DiagnosisReport
        In the coordinate of the first mode, after what the structure does beside its equation was
        taken off.
    parts : tuple of Part
        Effects that were simulated on the structure.
    sensor_errors : tuple of SensorError
        On the record that was held out, or the last: the structure before and after.
    trouble : str
        Why the structure could not be simulated with what was found; empty where it could.
    """

    reduced: Any
    parts: tuple[Part, ...]
    sensor_errors: tuple[SensorError, ...]
    trouble: str = ""

    @property
    def verdict(self) -> str:
        """As of the equation; "unknown" where it could not be simulated with what was found."""
        return "unknown" if self.trouble else self.reduced.verdict

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """Effects of the best hypothesis; strengths are those on the structure."""
        return self.reduced.effects

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is missing."""
        return self.reduced.best.names

    @property
    def equivalent(self) -> tuple[tuple[str, ...], ...]:
        return self.reduced.equivalent

    @property
    def family(self) -> EffectFamily | None:
        """What the data do not tell apart, as one answer, where all of it does the same."""
        return self.reduced.family

    @property
    @abstractmethod
    def next_test(self) -> Advice | MoreOfIt | None:
        """The test that would best tell apart what these data do not; None where none is needed."""

    @property
    @abstractmethod
    def recipe(self) -> str:
        """What makes the improved structure of the one that was."""

    @property
    def not_there(self) -> tuple[str, ...]:
        """Effects of the best hypothesis that nothing on the structure stands for.

        Of what explains nothing, none is told.
        """
        if self.reduced.refused:
            return ()
        there = {p.effect.name for p in self.parts}
        return tuple(e.label for e in self.effects if e.name not in there)

    @property
    def gap(self) -> Gap:
        """Before and after, in the coordinate of the first mode, on what took no part."""
        return self.reduced.gap

    @property
    def interrupted(self) -> bool:
        """Whether the search was stopped before its end."""
        return self.reduced.interrupted

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
        content["next"] = None if self.next_test is None else in_json(self.next_test)
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
        own = {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "formulas": [],
            "equation": self.recipe,
            "equation_note": "",
            "tables": [gap, TextTable("Sensors", self.sensor_table()), *explanations],
        }
        return page | own
