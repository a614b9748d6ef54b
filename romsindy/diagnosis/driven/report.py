"""A diagnosis from forced vibrations, in words, tables and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from romsindy.diagnosis import words
from romsindy.diagnosis.driven.gap import HELD_OUT, ForcedGap, noise_std
from romsindy.diagnosis.driven.next_test import Level, most_apart
from romsindy.diagnosis.driven.tolerance import beyond_noise
from romsindy.diagnosis.explained import Explained, notes_of
from romsindy.diagnosis.tolerance import DEFAULT, Tolerance
from romsindy.diagnosis.verdict import Left
from romsindy.fit.any_record import AnyRecord
from romsindy.text import percent, quantity

if TYPE_CHECKING:
    from romsindy.show.page import Picture


@dataclass(frozen=True, kw_only=True, repr=False)
class ForcedReport(Explained):
    """What a simulation lacks against driven records.

    Attributes
    ----------
    verdict, nominal, model, best, rivals, compared, scales, added, interrupted, notes
        As those of a `DiagnosisReport`.
    base : Hypothesis
        The simulation as it was.
    gap : ForcedGap
        Before and after, on what was held out, or else on the records that were fitted.
    tolerance : Tolerance
        What does not matter; where it is the default, what is noise.
    remainder : ForcedAdequacy
        Whether what is left is white.
    records : tuple of AnyRecord
    """

    gap: ForcedGap
    tolerance: Tolerance
    records: tuple[AnyRecord, ...]

    @property
    def left(self) -> Left:
        """Noise, what does not matter, next to nothing of the gap, or a further effect."""
        if self.remainder.explained:
            return "noise"
        if self.verdict == "unknown":
            return "effect"
        within = beyond_noise(self.gap.records, self.gap.residuals_after) <= self.tolerance.signal
        return "tolerance" if self.tolerance.source != DEFAULT and within else "little"

    # -- words ---------------------------------------------------------------------------------

    @property
    def sentence(self) -> str:
        """The finding, a line for each question: do they differ, what is missing, left, next?"""
        lines = [
            *self._interrupted,
            self._difference,
            f"Missing: {self._missing}",
            f"Left: {self._left}",
            *(f"Note: {note}" for note in (*words.undetermined(self.tolerance), *self.notes)),
            *self._next,
        ]
        return "\n".join(lines)

    @property
    def _difference(self) -> str:
        if not np.isfinite(self.gap.rms_before):
            return "They differ: the simulation has no motion that follows the records."
        size = quantity(self.gap.rms_before, self.gap.unit)
        share = percent(self.gap.before)
        differ = "They agree" if self.verdict == "none" else "They differ"
        line = f"{differ}: the simulation leaves {size} rms, {share} of the response"
        on = f" on {HELD_OUT}" if self.gap.where == HELD_OUT else ""
        asked = self.tolerance.source != DEFAULT
        known = f" ({words.tolerated(self.tolerance)})" if asked else ""
        return f"{line}{on}{known}."

    @property
    def _nothing(self) -> str:
        return "nothing that matters."

    @property
    def _gap_closed(self) -> float:
        return self.gap.closed

    def _closing(self, closes: str) -> str:
        share = percent(self.gap.closed)
        if round(100 * self.gap.closed, 1) == 100:
            share = "all"
        return f"{closes} {share} of the squared gap on {self.gap.where}."

    @property
    def _left(self) -> str:
        size = quantity(self.gap.rms_after, self.gap.unit)
        share = f"{size} rms, {percent(self.gap.after)} of the response"
        if self.remainder.explained:
            return f"{share}, as noise."
        if self.left == "tolerance":
            return f"{share}, which does not matter."
        return f"{share}; {self._more_than_noise}."

    @property
    def _more_than_noise(self) -> str:
        predicted = percent(1 - 1 / self.remainder.structure)
        return f"{predicted} of its power is no noise, for its past predicts it"

    @property
    def _next(self) -> list[str]:
        """What would confirm the one that is left, or tell apart the first two of several."""
        if self.verdict == "named" and self.effects:
            return [f"Next: {words.confirming(self.effects)}"]
        if self.verdict != "ambiguous":
            return []
        advice = {e.advice: None for h in self.rivals for e in self._found(h)}
        beside = f"what may tell them apart is {', or '.join(advice)}."
        level = self.level
        if level is None:
            return [f"Next: {beside}"]
        low, high = level.band
        where = f"record {level.record + 1} with inputs {level.level:g} times as large"
        how_far = f"{level.apart:.2g} times the noise, most between {low:.3g} and {high:.3g} Hz"
        if not level.enough:
            return [
                f"Next: at no level that was simulated they differ enough (at most {how_far},"
                f" in {where}); {beside}"
            ]
        return [f"Next: in {where} the first two, as they were fitted, differ by {how_far}."]

    @cached_property
    def level(self) -> Level | None:
        """At which the first two rivals differ most; None where there is but one."""
        if len(self.rivals) < 2:
            return None
        return most_apart(self.nominal, self.rivals[:2], self.records)

    # -- tables and files ------------------------------------------------------------------------

    def _content(self) -> dict[str, Any]:
        gap = self.gap
        return {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "interrupted": self.interrupted,
            **self._explanations(),
            "structure": self.remainder.structure,
            "gap": {
                "on": gap.where,
                "before": gap.before,
                "after": gap.after,
                "closed": gap.closed,
                "rms_before": gap.rms_before,
                "rms_after": gap.rms_after,
            },
            "left": self.left,
            "notes": list(self.notes),
        }

    def pictures(self) -> dict[str, Picture]:
        """Pictures by name: "time" and "spectrum", of the record of which most is left."""
        from romsindy.show import diagnosis_plots as show  # draws: only where a picture is asked
        from romsindy.show.page import Picture

        worst = int(np.argmax([np.std(e) for e in self.gap.residuals_after]))
        record, n = self.gap.records[worst], len(self.gap.records[worst].t)
        found = self.gap.residuals_before[worst], self.gap.residuals_after[worst]
        every = np.reshape([record.signal, *found], (3, -1, n))
        channel = int(np.argmax(np.std(every[2], axis=1)))
        signal, before, after = every[:, channel]
        before = np.where(np.isfinite(before), before, np.nan)  # nan where there is no motion
        name, unit = record.decay.measured, self.gap.unit
        both = f"{percent(self.gap.before)} of the response before, "
        both += f"{percent(self.gap.after)} after"
        of = "Of the held-out record" if self.gap.where == HELD_OUT else f"Of record {worst + 1}"
        of += f", channel {channel + 1}" if every.shape[1] > 1 else ""
        given = (signal, before, after, name, unit)
        spectra = (record.decay.dt, noise_std(record), *given)
        return {
            p.name: p
            for p in (
                Picture(
                    "time",
                    "The records and what is missed",
                    f"{of}; of all records {both}.",
                    partial(show.draw_errors_in_time, record.t, *given),
                ),
                Picture(
                    "spectrum",
                    "At which frequencies it is missed",
                    f"{of}, and the noise where the spectrum is quietest.",
                    partial(show.draw_error_spectra, *spectra),
                ),
            )
        }

    def page(self) -> dict[str, Any]:
        """What the page shows beside the pictures."""
        return self._page(self.gap.table(), notes_of(self.records))
