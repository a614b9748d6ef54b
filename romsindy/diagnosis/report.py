"""What a diagnosis found, in words, tables and files: what reports share, and that of decays."""

from __future__ import annotations

import csv
import json
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from romsindy.diagnosis import words
from romsindy.diagnosis.difference import Difference, Tolerance, over_all
from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError, Hypothesis, weights
from romsindy.diagnosis.found import (
    EffectFamily,
    FoundEffect,
    effects_of,
    of_the_measurement,
    titles,
)
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.next_test import (
    EXPERIMENTS,
    Advice,
    Experiment,
    MoreOfIt,
    more_of_it,
    next_test,
)
from romsindy.diagnosis.verdict import Left, Verdict, left_over
from romsindy.effects.base import Scales
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import EQUIVALENT, NAMED_ABOVE
from romsindy.notebook import shown
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel
from romsindy.physics.term_sum import json_text
from romsindy.record.files.save import whole
from romsindy.text import TextTable, listed

if TYPE_CHECKING:
    from romsindy.show.page import Picture


class Written(ABC):
    """A finding as a sentence, a table, JSON, CSV and a page."""

    if TYPE_CHECKING:  # a field of some reports, found by others

        @property
        def verdict(self) -> str:
            """One word: "none", "named", "ambiguous" or "unknown"."""

        @property
        def interrupted(self) -> bool:
            """Whether the search was stopped before its end."""

    @property
    @abstractmethod
    def sentence(self) -> str:
        """The finding, a line for each question: do they differ, what is missing, left, next?"""

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """Effects that are missing, of the best explanation; empty where something else is."""
        return ()

    @property
    def equivalent(self) -> tuple[tuple[str, ...], ...]:
        """Names of the explanations that the data do not tell apart, best first."""
        return ()

    @abstractmethod
    def table(self) -> list[list[str]]:
        """Rows of text: every explanation that the data allow, with its values."""

    @abstractmethod
    def pictures(self) -> dict[str, Picture]:
        """Pictures by name; ``draw(figure)`` draws one, its caption is what its numbers say."""

    @abstractmethod
    def page(self) -> dict[str, Any]:
        """What the page shows beside the pictures."""

    def _content(self) -> dict[str, Any]:
        """What JSON holds."""
        names = ("verdict", "sentence", "interrupted")
        return {name: getattr(self, name) for name in names}

    def to_json(self) -> str:
        """All that was found as JSON text."""
        return json_text(self._content())

    def to_csv(self, path: str | Path) -> None:
        """Write the table of explanations."""
        with whole(path) as new, open(new, "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(self.table())

    def to_html(self, path: str | Path, *, interactive: bool = False) -> None:
        """Write one self-contained page with figures.

        Parameters
        ----------
        path : str or Path
        interactive : bool
            Whether figures zoom and show what is under the pointer; needs plotly:
            ``pip install "romsindy[interactive]"``.
        """
        from romsindy.show.page import write_page  # draws: only where a page is asked for

        pictures = self.pictures().values()
        write_page(
            path, "report", "diagnose", pictures=pictures, interactive=interactive, **self.page()
        )

    def __str__(self) -> str:
        return self.sentence

    def _repr_html_(self) -> str:
        page = self.page()
        return shown(page["formulas"], page["tables"], [f"{self.verdict}: {self.sentence}"])

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.verdict}: {' '.join(self.sentence.splitlines())}>"


_ADVICE = ("action", "odds", "cost", "rivals")
_FAMILY = ("name", "size", "assumed", "found", "error", "members")
_MEMBERS = ("one of the family", "the others")  # as a test tells them apart


@dataclass(frozen=True, kw_only=True, repr=False)
class Explained(Written):
    """What a simulation lacks, by effects of a catalogue: see `DiagnosisReport`."""

    verdict: Verdict
    nominal: Equations
    model: Equations
    best: Hypothesis
    rivals: tuple[Hypothesis, ...]
    compared: tuple[Hypothesis, ...]
    base: Hypothesis
    remainder: Adequacy
    scales: Scales
    added: tuple[Part, ...]
    gap: Any  # with the part of it that ``closed``
    records: tuple[Any, ...]
    interrupted: bool = False
    notes: tuple[str, ...] = ()

    @cached_property
    def effects(self) -> tuple[FoundEffect, ...]:
        """Effects of the best hypothesis; values that moved where nothing else is needed."""
        return self._found(self.best)

    @property
    def family(self) -> EffectFamily | None:
        """What the data do not tell apart, as one answer; None where that is more than one."""
        return None

    @property
    def moved(self) -> tuple[FoundEffect, ...]:
        """Values that the simulation was unsure of and that moved, beside the effects."""
        beside = [i for i in self.best.changed if i not in self.best.blamed]
        return self._found(self.best, beside)

    @property
    def within(self) -> tuple[FoundEffect, ...]:
        """Values that surely moved within their tolerances."""
        best = self.best
        told = {*best.blamed, *best.changed, *best.of_measurement}
        free = best.parts[: best.n_free]
        known = [i for i, p in enumerate(free) if p.tolerance is not None and i not in told]
        return tuple(e for e in self._found(best, known) if e.sure)

    def _found(
        self, hypothesis: Hypothesis, which: Sequence[int] | None = None
    ) -> tuple[FoundEffect, ...]:
        return effects_of(hypothesis, self.rivals, self.remainder.ratio, self.nominal, which)

    @property
    def next_best(self) -> Hypothesis | None:
        """The best of what was compared that says something else than the best."""
        # More, beside all that the best says, is no alternative to it, nor is what does the same.
        alike = {(name,) for name in self.family.members} if self.family else set()
        others = (
            h
            for h in self.compared
            if h.names and h.names not in alike and not self.best.said <= h.said
        )
        return next(others, None) if self.best.names else None

    @property
    def odds(self) -> float:
        """Of the best hypothesis against the next; infinite where nothing else was compared."""
        other = self.next_best
        return float(np.exp(self._log_odds(other))) if other is not None else float("inf")

    def _log_odds(self, other: Hypothesis) -> float:
        return min((other.score - self.best.score) / 2, np.log(np.finfo(float).max))

    @property
    def equivalent(self) -> tuple[tuple[str, ...], ...]:
        return tuple(h.names for h in self.rivals if h.names)

    # -- words ---------------------------------------------------------------------------------

    @property
    def _nothing(self) -> str:
        """What is said where nothing is missing."""
        return "nothing that matters."

    @abstractmethod
    def _closing(self, closes: str) -> str:
        """How much of the gap closes, in words."""

    def _nearer(self, closes: str) -> str:
        """How much nearer the nearest is although it does not explain; nothing where it is not."""
        return self._closing(closes) if self.gap.closed > 0 else ""

    @property
    def _small(self) -> str:
        """That what is named changes less than matters, if so."""
        return ""

    @property
    def _missing(self) -> str:
        if self.verdict == "none":
            return self._nothing
        found = " and ".join(map(str, self.effects)) or titles(self.best)
        also = "".join(f" Fitted beside it: {e}." for e in self.moved)
        closes = "They close" if len(self.effects) > 1 else "It closes"
        if self.verdict == "unknown":
            nothing = "nothing in the catalogue explains it"
            if self.refused:
                return f"{nothing}."
            return f"{nothing}; the nearest is {found}. {self._nearer(closes)}{also}"
        other = self.next_best
        odds = ""
        if other is not None and self._log_odds(other) > 0:  # values come first, likelier or not
            odds = f" ({words.odds(self._log_odds(other), titles(other))})"
        if self.family is not None:
            return f"{self.family.in_words(odds[2:-1])}. {self._closing(closes)}{also}"
        others = ", or ".join(titles(h) for h in self.rivals[1:])
        if others and self.verdict == "named":  # values of the simulation come first
            also += f" {others[0].upper()}{others[1:]} would do as well."
        elif others:
            if odds and self._log_odds(self.rivals[1]) > EQUIVALENT / 2:
                odds = f"{odds[:-1]}, by the fitted records alone)"
            closing = self._closing("The first closes") + self._small
            return f"{found}, or {others}; these data do not tell them apart{odds}. {closing}{also}"
        if len(self.effects) > 1 and not self.best.effects:
            also += (
                " One cause may stand behind both, such as a viscoelastic support or a small mass"
                " that vibrates along; decays at another frequency would tell."
            )
        elif self.verdict == "ambiguous" and self.best.pliable:
            also += " Another law, which is on no list, may do what they do together."
        return f"{found}{odds}. {self._closing(closes)}{self._small}{also}"

    @property
    def refused(self) -> bool:
        """Whether nothing explains the data, and nothing surely comes nearer to them."""
        if self.verdict != "unknown":
            return False
        best, ratio = self.best, self.remainder.ratio
        sure = bool(self.effects) and best.sureness >= NAMED_ABOVE * best.growth(ratio)
        return not (sure and self._nearer(""))

    @property
    def _interrupted(self) -> list[str]:
        if not self.interrupted:
            return []
        n = len(self.compared)
        return [f"Stopped when {n} explanations were compared: not the last word."]

    # -- tables and files ------------------------------------------------------------------------

    def table(self) -> list[list[str]]:
        rows = [list(TABLE_HEAD)]
        if self.refused:
            return rows
        for h, share in zip(self.rivals, weights(self.rivals), strict=True):
            for effect in self._found(h):
                for key, value in effect.values.items():
                    error = effect.standard_errors[key]
                    numbers = [f"{value:.6g}", f"{error:.2g}", effect.units[key], f"{share:.3f}"]
                    rows.append([effect.name, effect.variant, key, *numbers])
        return rows

    def _explanations(self) -> dict[str, Any]:
        """What JSON says of them."""
        other = self.next_best
        return {
            "effects": [vars(e) for e in self.effects],
            "moved": [vars(e) for e in self.moved],
            "equivalent": [list(names) for names in self.equivalent],
            "odds": {"against": list(other.names), "odds": self.odds} if other else None,
            "model": json.loads(self.model.to_json()),
        }

    def page(self) -> dict[str, Any]:
        parts = self.added
        terms = {p.effect.name for p in parts if p.effect.term() is not None}
        outside = ", ".join(e.label for e in self.effects if parts and e.name not in terms)
        note = "Not a term of the equation of motion, so not in it: "
        title = f"The simulation{' with it added' if parts else ', unchanged'}"
        page = page_of(self, title, self.records)
        return {**page, "equation_note": f"{note}{outside}." if outside else ""}


def page_of(report: Any, equation_title: str, records: Sequence[Prepared]) -> dict[str, Any]:
    """What the pages of all reports but those of beams show: verdict, equation, gap, notes."""
    rows = report.table()
    explained = report.verdict in ("named", "ambiguous")
    found = "Explanations that the data allow" if explained else "What comes nearest"
    return {
        "title": "What the simulation lacks",
        "verdict": report.verdict,
        "sentence": report.sentence,
        "equation_title": equation_title,
        "equation": str(report.model),
        "formulas": report.model.formulas(),
        "tables": [
            TextTable("The gap, before and after", report.gap.table()),
            *([TextTable(found, rows)] if rows[1:] else []),
        ],
        "notes": notes_of(records),
    }


def notes_of(records: Sequence[Prepared]) -> list[str]:
    """What each record is, and what was done to it."""
    found = []
    for record in records:
        head, *done = repr(record.decay).splitlines()
        found += [head.strip("<>"), *(line.removeprefix("  - ") for line in done)]
    return found


TABLE_HEAD = ("explanation", "variant", "value", "estimate", "standard error", "unit", "posterior")


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
                **closing(gap),
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

    Examples
    --------
    >>> from romsindy import diagnose, effects
    >>> linear, t = {"omega^2": 36.0, "c_linear": 0.1}, np.arange(0.0, 10.0, 0.05)
    >>> decay = ReducedModel.from_coefficients({**linear, "gamma_3": 9.0}).simulate(0.3, 0.0, t)
    >>> model, catalogue = ReducedModel.from_coefficients(linear), [effects.CubicStiffness()]
    >>> report = diagnose(model, decay, catalogue=catalogue)
    >>> report.verdict, f"{report.effects[0].name} {report.effects[0].values['strength']:.1f}"
    ('named', 'cubic_stiffness 9.0')
    """

    nominal: ReducedModel
    model: ReducedModel
    form: FormError = NO_FORM_ERROR
    small: bool = False
    whole: tuple[Difference, ...] = ()

    @cached_property
    def family(self) -> EffectFamily | None:
        """What the data do not tell apart, as one answer, where all of it does the same."""
        if self.verdict != "ambiguous":
            return None
        growth = self.best.growth(self.remainder.ratio)
        return EffectFamily.of(self.rivals, self.nominal, self.records[0], growth)

    @property
    def left(self) -> Left:
        """What is left: noise, what does not matter, the form of the model, or more than that."""
        given = (self.remainder, self.gap, self.whole, self.tolerance, self.form)
        return left_over(self.best, *given)

    @cached_property
    def next_test(self) -> Advice | MoreOfIt | None:
        """The test that would best tell apart what these data do not; None where none is needed.

        Where nothing explains the data, that which shows more of what is missing.
        """
        if self.verdict == "unknown":
            largest = max(r.amplitude for r in self.records)
            return more_of_it(self.gap.loud_and_quiet, largest, self.gap.shown)
        return self.advised()

    def advised(self, tests: Sequence[Experiment] = EXPERIMENTS) -> Advice | None:
        """Of the tests that can be made, that which would best tell explanations apart."""
        if self.verdict != "ambiguous":
            return None
        return next_test(self.rivals, self.nominal, self.records, self.tolerance, tests)

    # -- words ---------------------------------------------------------------------------------

    @property
    def sentence(self) -> str:
        lines = self.lines(words.remainder(self.gap, self.left), self.next_test)
        return "\n".join([*lines, *words.within(self.within)])

    def lines(self, left: str, advice: Advice | MoreOfIt | None) -> list[str]:
        """The lines of the finding, with what is left, and what to do next, of one's own."""
        lines = [
            *self._interrupted,
            self.opening,
            f"Missing: {self._missing}",
            f"Left: {left}",
            *self._noted(self.notes),
        ]
        if advice is not None:
            told = advice if self.family is None else replace(advice, rivals=_MEMBERS)
            lines.append(f"Next: {told.sentence}")
        elif self.verdict in ("named", "ambiguous") and self.effects:
            lines.append(f"Next: {words.confirming(self.effects)}")
        return lines

    @property
    def opening(self) -> str:
        """Whether simulation and records differ, and by how much: the first line."""
        line = words.difference(self.differences, self.tolerance, self.gap.shown)
        told = self.best.names and self.verdict != "none" and not self.refused
        if told and not (self._differ or self.small):
            line += words.single_swings(self._log_odds(self.base))
        return line

    @property
    def _differ(self) -> bool:
        return any(d.exceeds(self.tolerance) for d in self.differences)

    def _nearer(self, closes: str) -> str:
        nearer, (before, after) = super()._nearer(closes), (self.differences, self.whole)
        if nearer or not any(d.apart for d in before) or any(d.apart for d in after):
            return nearer
        told = words.difference(after, self.tolerance, self.gap.shown)
        told = told[0].lower() + told[1:]
        return f"With it, cycle by cycle, {told} {self._closing(closes)}"

    @property
    def _small(self) -> str:
        return " It is small: less than what tests repeat to." if self.small else ""

    @property
    def _nothing(self) -> str:
        if not self._differ:
            return super()._nothing
        added = of_the_measurement(self.best, self.remainder.ratio, self.nominal)
        if not added and self.within:
            return "nothing: values that moved within their tolerances may be what differs."
        if not added:
            return "nothing that these data show."
        return f"nothing: a measurement may add what differs ({listed([str(e) for e in added])})."

    # -- tables and files ------------------------------------------------------------------------

    def _content(self) -> dict[str, Any]:
        advice, family = self.next_test, self.family
        return {
            **super()._content(),
            **self._sizes(self.remainder),
            **self._explanations(),
            "left": self.left,
            "family": None if family is None else {k: getattr(family, k) for k in _FAMILY},
            "next": None if advice is None else in_json(advice),
        }

    def pictures(self) -> dict[str, Picture]:
        """Pictures by name; ``draw(figure)`` draws one, its caption is what its numbers say.

        "gap", "amplitude", "phase", "harmonic", "time" and "record".
        """
        from romsindy.diagnosis.pictures import pictures

        return {p.name: p for p in pictures(self.nominal, self.added, self.records, self.gap)}


def closing(gap: Any, *more: str) -> dict[str, Any]:
    """What JSON says of a gap: on what it was measured, before and after, and ``more`` of it."""
    return {"on": gap.where} | {k: getattr(gap, k) for k in ("before", "after", "closed", *more)}


def in_json(advice: Advice | MoreOfIt) -> dict[str, Any]:
    """What JSON says of the next test."""
    return {k: getattr(advice, k) for k in _ADVICE}


def _without_parts(difference: Difference) -> dict[str, Any]:
    return {k: v for k, v in vars(difference).items() if k != "parts"}
