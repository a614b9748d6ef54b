"""Does another vibration take part, where what one coordinate explains of records is in doubt?"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from romsindy.diagnosis import words
from romsindy.diagnosis.gap import Gap, Prediction, name_of, predict
from romsindy.diagnosis.interaction import (
    Interaction,
    footing,
    footing_table,
    interaction_of,
    not_followed,
    ratio,
    rings_along,
    takes_part,
    values_that_moved,
)
from romsindy.diagnosis.report import TABLE_HEAD, BesideDecays, DiagnosisReport, Written, page_of
from romsindy.diagnosis.search import Options
from romsindy.diagnosis.verdict import Left, Verdict
from romsindy.effects import CATALOGUE, look_alikes
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.records.record import Record
from romsindy.fit.results.fitted import Fit
from romsindy.fit.verdict import LEFT_OVER
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.signals import rest_level
from romsindy.record.vibrations import Vibration, find_vibrations
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
        same = {k: getattr(report, k) for k in ("differences", "tolerance", "records", "notes")}
        return cls(gap=gap, one_coordinate=report, interaction=interaction, fit=fit, **same)

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
    def model(self) -> Equations:
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
        found = takes_part(self.interaction, self.fit)
        moved = values_that_moved(self.nominal, self.fit)
        missing = f"{found}. {self._closing('It closes')} {footing(self.interaction)}{moved}"
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
        near = ratio(self.interaction.resonance)
        values, errors = self.fit.model.coefficients, self.fit.standard_errors
        rows = [
            [
                "another mode",
                near,
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
            **super()._content(),
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

        found = self.interaction
        alone, together = ((f.records, f.residuals) for f in (found.alone, found.together))
        pictures = pictures_of_two(self.gap, alone, together, footing(found))
        return {p.name: p for p in pictures}

    def page(self) -> dict[str, Any]:
        page = page_of(self, "The simulation and the other mode", self.records)
        more = [TextTable("One coordinate and two", footing_table(self.interaction))]
        more += [TextTable("Coefficients", self.fit.table())]
        return {**page, "tables": [*page["tables"], *more]}


# The same mode in two records: its small frequencies differ by less, as a ratio.
_SAME = 1.2
# So many other vibrations are tried, the loudest first: a faint one may be a combination of two.
_MOST = 2

_Heard = tuple[Vibration, list[Vibration]]  # that of the model, and those beside it


class _Ringing(NamedTuple):
    """The vibration of a model and another one, and the numbers of the records that hold both."""

    own: Vibration
    other: Vibration
    numbers: tuple[int, ...]


def with_other_mode(
    report: DiagnosisReport, options: Options
) -> DiagnosisReport | InteractionReport:
    """The report; or what another mode explains, where what one coordinate explains is in doubt."""
    unknown = report.verdict == "unknown"
    if report.interrupted or not (unknown or _in_doubt(report)):
        return report
    open_ = unknown or report.gap.after > LEFT_OVER
    model, notes = report.nominal if open_ else report.model, []
    for ringing in _ringing(report.records)[:_MOST]:
        decays = [_at_rest(report.records[i].decay) for i in ringing.numbers]
        own, other, _ = ringing
        found = interaction_of(model, decays, own, other, options.floor, options.progress)
        if found is None:
            notes.append(not_followed(other))
            continue
        if found.takes_part and found.fit is not None:
            gap = _gap(report.nominal, report.records, ringing.numbers, found)
            return InteractionReport.of(report, found, found.fit, gap)
        notes.append(rings_along(found))
    return replace(report, notes=tuple(notes)) if unknown else report


def _in_doubt(report: DiagnosisReport) -> bool:
    """Whether what stands for another vibration explains the records beside other effects alone.

    Or whether it leaves much, although that is tolerated: a mode in resonance comes and goes.
    """
    names = {part.effect.name for part in report.best.effects}
    beside = {"second_mode"} | look_alikes("second_mode", CATALOGUE)
    found = report.verdict in ("named", "ambiguous")
    much = len(names) > 1 or report.gap.after > LEFT_OVER
    return found and much and bool(names & beside)


def _ringing(records: Sequence[Record]) -> list[_Ringing]:
    """What rings beside the vibration of the model, the loudest first."""
    heard = [_heard(record) for record in records]
    pairs = [(own, other) for own, others in filter(None, heard) for other in others]
    found: list[_Ringing] = []
    for own, other in sorted(pairs, key=lambda pair: -pair[1].share):
        if not any(_same(other, known.other) for known in found):
            numbers = (i for i, of in enumerate(heard) if of and _holds(of, own, other))
            found.append(_Ringing(own, other, tuple(numbers)))
    return found


def _holds(heard: _Heard, own: Vibration, other: Vibration) -> bool:
    """Whether what was heard of a record has both vibrations."""
    return _same(own, heard[0]) and any(_same(other, v) for v in heard[1])


def _heard(record: Record) -> _Heard | None:
    """The vibration of the model, and those that decay beside it."""
    decay = _at_rest(record.decay)
    every = find_vibrations(decay.signal, decay.dt, decay.derivative)
    found = [v for v in every if not (v.steady or v.faint)]
    if not found:
        return None
    hz = record.rate / (2 * np.pi)
    own = min(found, key=lambda v: abs(np.log(v.mean_frequency / hz)))
    return own, [v for v in found if v is not own]


def _same(a: Vibration, b: Vibration) -> bool:
    return 1 / _SAME < a.small_frequency / b.small_frequency < _SAME


def _at_rest(decay: Decay) -> Decay:
    """Free of an offset, as all that rings is looked for."""
    if decay.measured != "displacement":
        return replace(decay, stage="free")
    return replace(decay, q=decay.q - rest_level(decay.q, decay.dt), stage="free")


def _gap(
    model: ReducedModel, records: Sequence[Record], numbers: Sequence[int], found: Interaction
) -> Gap:
    """Before and after, on the records in which both ring: nothing of them was held out."""
    predictions = []
    for i, left in zip(numbers, found.longest.residuals, strict=True):
        whole = replace(records[i], part=None)
        before = predict(model, (), whole, name_of(i)).before
        predictions.append(Prediction(whole, before, whole.signal - left, name_of(i)))
    return Gap(tuple(predictions), unseen=False)
