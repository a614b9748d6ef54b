"""A diagnosis that ends with another mode: the model lacks a coordinate."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from romsindy.diagnosis import words
from romsindy.diagnosis.explained import TABLE_HEAD, notes_of
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.interaction import Interaction
from romsindy.diagnosis.report import BesideDecays, DiagnosisReport
from romsindy.diagnosis.verdict import Left, Verdict
from romsindy.diagnosis.written import Written
from romsindy.fit.adequacy import Adequacy
from romsindy.fit.fitted import Fit
from romsindy.physics.coupled import AnyModel
from romsindy.physics.model import ReducedModel
from romsindy.text import TextTable

if TYPE_CHECKING:
    from romsindy.show.page import Picture


@dataclass(frozen=True, kw_only=True, repr=False)
class InteractionReport(BesideDecays, Written):
    """What a simulation of one coordinate lacks, where another mode takes part.

    The gap is that of the records in which both modes ring, none of which was held out; after, they
    are followed in pieces of ``interaction.longest.cycles`` cycles. ``effects`` is empty: values of
    the simulation were all fitted anew, and nothing but the other mode is missing.

    Attributes
    ----------
    one_coordinate : DiagnosisReport
        What was found by effects of one coordinate, which was not enough.
    interaction : Interaction
        What one coordinate and two leave.
    fit : Fit
        Of the model, with the errors of its coefficients.
    gap, differences, tolerance, records
        As those of a `DiagnosisReport`.
    notes : tuple of str
        What else was found, a sentence each.
    """

    one_coordinate: DiagnosisReport
    interaction: Interaction
    fit: Fit
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, report: DiagnosisReport, interaction: Interaction, fit: Fit, gap: Gap
    ) -> InteractionReport:
        """Of a mode that takes part in some records, beside what one coordinate said."""
        return cls(
            gap=gap,
            differences=report.differences,
            tolerance=report.tolerance,
            records=report.records,
            one_coordinate=report,
            interaction=interaction,
            fit=fit,
            notes=report.notes,
        )

    @property
    def verdict(self) -> Verdict:
        """Always "named": the other mode."""
        return "named"

    @property
    def interrupted(self) -> bool:
        """Whether the search was stopped before its end."""
        return self.one_coordinate.interrupted

    @property
    def nominal(self) -> ReducedModel:
        """The simulation."""
        return self.one_coordinate.nominal

    @property
    def model(self) -> AnyModel:
        """Of both modes: the simulation along q1, the other as q2, and what couples them."""
        return self.fit.model

    @property
    def remainder(self) -> Adequacy:
        """What the model of both leaves."""
        return self.fit.verdict

    @property
    def left(self) -> Left:
        """Noise, or a further effect."""
        return "noise" if self.remainder.explained else "effect"

    @property
    def sentence(self) -> str:
        """The finding, a line for each question: do they differ, what is missing, what is left?"""
        found = words.takes_part(self.interaction, self.fit)
        moved = words.values_that_moved(self.nominal, self.fit)
        missing = f"{found}. {self._closing('It closes')} {words.footing(self.interaction)}{moved}"
        return "\n".join(
            [
                self.one_coordinate.opening,
                f"Missing: {missing}",
                f"Left: {words.remainder(self.gap, self.left)}",
                *self._noted(self.notes),
            ]
        )

    # -- tables and files ------------------------------------------------------------------------

    def table(self) -> list[list[str]]:
        """Rows of text: what couples the modes, with its values."""
        ratio = words.ratio(self.interaction.resonance)
        values, errors = self.fit.model.coefficients, self.fit.standard_errors
        rows = [
            [
                "another mode",
                ratio,
                t.key,
                f"{values[t.key]:.6g}",
                f"{errors[t.key]:.2g}",
                t.unit(self.nominal.unit),
                "",
            ]
            for t in self.interaction.couplings
        ]
        return [list(TABLE_HEAD), *rows]

    def _content(self) -> dict[str, Any]:
        found, resonance = self.interaction, self.interaction.resonance
        return {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "interrupted": self.interrupted,
            **self._sizes(self.remainder),
            "effects": [],
            "moved": [],
            "equivalent": [],
            "odds": None,
            "left": self.left,
            "next": None,
            "model": json.loads(self.model.to_json()),
            "interaction": {
                "frequency": found.frequency,
                "resonance": resonance and vars(resonance),
                "couplings": [t.key for t in found.couplings],
                "cycles": found.together.cycles,
                "one_coordinate": found.before,
                "two_coordinates": found.after,
            },
        }

    def pictures(self) -> dict[str, Picture]:
        """Pictures by name: "gap", "amplitude" and "time" as elsewhere, and "coordinates"."""
        from romsindy.diagnosis.pictures import pictures_of_two

        return {p.name: p for p in pictures_of_two(self.gap, self.interaction)}

    def page(self) -> dict[str, Any]:
        """What the page shows beside the pictures."""
        rows = self.table()
        explanations = TextTable("Explanations that the data allow", rows)
        return {
            "title": "What the simulation lacks",
            "verdict": self.verdict,
            "sentence": self.sentence,
            "equation_title": "The simulation and the other mode",
            "equation": str(self.model),
            "tables": [
                TextTable("The gap, before and after", self.gap.table()),
                *([explanations] if rows[1:] else []),
                TextTable("One coordinate and two", words.footing_table(self.interaction)),
                TextTable("Coefficients", self.fit.table()),
            ],
            "notes": notes_of(self.records),
        }
