"""A diagnosis that ends with another mode: the model lacks a coordinate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from romsindy.diagnosis import words
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.found import FoundEffect
from romsindy.diagnosis.interaction import Interaction
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.verdict import Left
from romsindy.fit.fitted import Fit
from romsindy.text import TextTable

if TYPE_CHECKING:
    from romsindy.show.page import Picture


@dataclass(frozen=True, kw_only=True, repr=False)
class InteractionReport(DiagnosisReport):
    """What a simulation of one coordinate lacks, where another mode takes part.

    ``model`` is the `CoupledModel` of both: the simulation along q1, the other mode as q2, and what
    couples them, with all values fitted. ``best``, ``rivals`` and ``compared`` are those of one
    coordinate, which explained nothing; ``effects`` is empty. The gap is that of the records in
    which both modes ring, none of which was held out; after, they are followed in pieces of
    ``interaction.longest.cycles`` cycles.

    Attributes
    ----------
    interaction : Interaction
        What one coordinate and two leave.
    fit : Fit
        Of the model, with the errors of its coefficients.
    """

    interaction: Interaction
    fit: Fit

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """None: no effect of one coordinate explains the records."""
        return ()

    @property
    def moved(self) -> tuple[FoundEffect, ...]:
        """None: all values of the model were fitted anew."""
        return ()

    @property
    def next_best(self) -> Hypothesis | None:
        """None: one coordinate alone is what it was compared with."""
        return None

    @property
    def equivalent(self) -> tuple[tuple[str, ...], ...]:
        """None."""
        return ()

    @property
    def left(self) -> Left:
        """Noise, or a further effect."""
        return "noise" if self.remainder.explained else "effect"

    @property
    def _missing(self) -> str:
        found = words.takes_part(self.interaction, self.fit)
        moved = words.values_that_moved(self.nominal, self.fit)
        return f"{found}. {self._closing('It closes')} {words.footing(self.interaction)}{moved}"

    # -- tables and files ------------------------------------------------------------------------

    def table(self) -> list[list[str]]:
        """Rows of text: what couples the modes, with its values."""
        head, ratio = super().table()[0], words.ratio(self.interaction.resonance)
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
        return [head, *rows]

    def _content(self) -> dict[str, Any]:
        found, resonance = self.interaction, self.interaction.resonance
        return {
            **super()._content(),
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

    def _equation(self) -> dict[str, Any]:
        return {"equation_title": "The simulation and the other mode", "equation": str(self.model)}

    def _tables(self) -> list[TextTable]:
        return [
            *super()._tables(),
            TextTable("One coordinate and two", words.footing_table(self.interaction)),
            TextTable("Coefficients", self.fit.table()),
        ]
