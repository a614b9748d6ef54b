"""What a diagnosis from decays found, in words, tables and files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from romsindy.diagnosis import words
from romsindy.diagnosis.difference import Difference, over_all
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.experiment import EXPERIMENTS, Advice, Experiment
from romsindy.diagnosis.explained import Explained, notes_of
from romsindy.diagnosis.found import of_the_measurement
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.next_test import next_test
from romsindy.diagnosis.tolerance import Tolerance
from romsindy.diagnosis.verdict import Left, left_over
from romsindy.diagnosis.weighing import NO_FORM_ERROR, FormError
from romsindy.fit.adequacy import Adequacy
from romsindy.fit.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.text import listed

if TYPE_CHECKING:
    from romsindy.show.page import Picture

_ADVICE = ("action", "odds", "cost", "rivals")


@dataclass(frozen=True, kw_only=True, repr=False)
class BesideDecays:
    """The part of a report that decays have: how far simulation and records are apart."""

    gap: Gap
    differences: tuple[Difference, ...]
    tolerance: Tolerance
    records: tuple[Record, ...]

    def _closing(self, closes: str) -> str:
        return words.closing(self.gap, self.tolerance, closes)

    def _noted(self, notes: Sequence[str]) -> list[str]:
        """Lines of notes, what records do not determine first."""
        tolerance = over_all(self.tolerance, self.differences)
        return [f"Note: {note}" for note in (*words.undetermined(tolerance), *notes)]

    def _sizes(self, remainder: Adequacy) -> dict[str, Any]:
        """What JSON says of differences, the gap and what is left."""
        tolerance = vars(over_all(self.tolerance, self.differences))
        gap = self.gap
        return {
            "differences": [_without_parts(d) for d in self.differences],
            "tolerance": {k: v for k, v in tolerance.items() if k != "bands"},
            "adequacy": remainder.ratio,
            "structure": remainder.structure,
            "gap": {
                "on": gap.where,
                "before": gap.before,
                "after": gap.after,
                "closed": gap.closed,
                "differences_before": [_without_parts(d) for d in gap.differences_before],
                "differences_after": [_without_parts(d) for d in gap.differences_after],
            },
        }


@dataclass(frozen=True, kw_only=True, repr=False)
class DiagnosisReport(BesideDecays, Explained):
    """What a simulation lacks.

    Attributes
    ----------
    verdict : "none", "named", "ambiguous" or "unknown"
        No gap; one explanation that closes it; several that do; none that does.
    nominal, model : ReducedModel
        Before, and with the effects added that are terms of the equation.
    best : Hypothesis
    rivals : tuple of Hypothesis
        What the data do not tell apart from the best, itself first.
    compared : tuple of Hypothesis
        All that were fitted, the best first.
    base : Hypothesis
        Only what the simulation is unsure of, fitted.
    remainder : Adequacy
        What the best leaves of the records it was fitted to.
    scales : Scales
    added : tuple of Part
        What stands behind "after": all parts of the best, or nothing where they explain nothing.
    interrupted : bool
        Whether the search was stopped before its end: what it had compared is all there is.
    notes : tuple of str
        What else was found, a sentence each.
    gap : Gap
        Before and after, on what took no part.
    differences : tuple of Difference
        Of the simulation as it was, from every record as a whole.
    tolerance : Tolerance
        What does not matter.
    records : tuple of Record
    whole : tuple of Difference
        Of what was found, from every record as a whole.
    form : FormError
        Of the model, as its reference record shows it.
    small : bool
        Whether what is named changes less than matters.
    """

    nominal: ReducedModel
    model: ReducedModel
    form: FormError = NO_FORM_ERROR
    small: bool = False
    whole: tuple[Difference, ...] = ()

    @property
    def left(self) -> Left:
        """What is left: noise, what does not matter, the form of the model, or more than that."""
        given = (self.remainder, self.gap, self.whole, self.tolerance, self.form)
        return left_over(self.best, *given)

    @cached_property
    def next_test(self) -> Advice | None:
        """The test that would best tell apart what these data do not; None where none is needed."""
        return self.advised()

    def advised(self, tests: Sequence[Experiment] = EXPERIMENTS) -> Advice | None:
        """The same, of the tests that can be made.

        Where nothing explains the data, what came nearest is to be told apart.
        """
        given = (self.nominal, self.records, tests)
        if self.verdict == "ambiguous":
            return next_test(self.rivals, *given)
        if self.verdict == "unknown":
            nearest: dict[tuple[str, ...], Hypothesis] = {}
            for h in (self.best, *self.compared):
                if h.names and len(h.effects) <= max(len(self.best.effects), 1):
                    nearest.setdefault(h.names, h)
            return next_test(list(nearest.values()), *given, explained=False)
        return None

    # -- words ---------------------------------------------------------------------------------

    @property
    def sentence(self) -> str:
        """The finding, a line for each question: do they differ, what is missing, left, next?"""
        return "\n".join(self.lines(words.remainder(self.gap, self.left)))

    def lines(self, left: str) -> list[str]:
        """The lines of the finding, with what is left in other words."""
        lines = [
            *self._interrupted,
            self.opening,
            f"Missing: {self._missing}",
            f"Left: {left}",
            *self._noted(self.notes),
        ]
        if self.next_test is not None:
            lines.append(f"Next: {self.next_test.sentence}")
        elif self.verdict == "named" and self.effects:
            lines.append(f"Next: {words.confirming(self.effects)}")
        return lines

    @property
    def opening(self) -> str:
        """Whether simulation and records differ, and by how much: the first line."""
        line = words.difference(self.differences, self.tolerance, self.nominal.unit)
        if self.best.names and self.verdict != "none" and not (self._differ or self.small):
            line += words.single_swings(self._log_odds(self.base))
        return line

    @property
    def _differ(self) -> bool:
        return any(d.exceeds(self.tolerance) for d in self.differences)

    @property
    def _gap_closed(self) -> float:
        return self.gap.closed

    @property
    def _small(self) -> str:
        return " It is small: less than what tests repeat to." if self.small else ""

    @property
    def _nothing(self) -> str:
        if not self._differ:
            return "nothing that matters."
        added = of_the_measurement(self.best, self.remainder.ratio, self.nominal)
        if not added:
            return "nothing that these data show."
        return f"nothing: a measurement may add what differs ({listed([str(e) for e in added])})."

    # -- tables and files ------------------------------------------------------------------------

    def _content(self) -> dict[str, Any]:
        advice = self.next_test
        return {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "interrupted": self.interrupted,
            **self._sizes(self.remainder),
            **self._explanations(),
            "left": self.left,
            "next": None if advice is None else {k: getattr(advice, k) for k in _ADVICE},
        }

    def pictures(self) -> dict[str, Picture]:
        """Pictures by name; ``draw(figure)`` draws one, its caption is what its numbers say.

        "gap", "amplitude", "phase", "harmonic", "time" and "record".
        """
        from romsindy.diagnosis.pictures import pictures

        return {p.name: p for p in pictures(self.nominal, self.added, self.records, self.gap)}

    def page(self) -> dict[str, Any]:
        """What the page shows beside the pictures."""
        page = self._page(self.gap.table(), notes_of(self.records))
        return {**page, "formula": self.model.latex_terms()}


def _without_parts(difference: Difference) -> dict[str, Any]:
    return {k: v for k, v in vars(difference).items() if k != "parts"}
