"""What came of a file, by parts: numbers by name, rows of a table, words in short or full."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from romsindy.commands.outputs import writing
from romsindy.fit.estimate import Band, Estimate
from romsindy.fit.small_vibrations import SmallVibration
from romsindy.physics.coupled import AnyModel
from romsindy.show.identified import Identified
from romsindy.show.page import Picture
from romsindy.show.panels import pictures, write_result
from romsindy.text import TextTable, aligned, as_text, bar, with_error

_FEW = 9  # rows of a table that is printed without --full
_WORDS = {True: "yes", False: "no", None: "not refined"}
HEADER = ["file", "mode", "frequency [Hz]", "+-", "damping ratio [%]", "+-"]
HEADER += ["structure", "explained", "report"]


@dataclass(frozen=True)
class Refused:
    """A file of which nothing came, and why, in a sentence."""

    file: str
    sentence: str

    def content(self) -> dict[str, Any]:
        """As of a `Result`."""
        return {"file": self.file, "error": self.sentence}

    def rows(self) -> list[list[str]]:
        """As of a `Result`."""
        return [[self.file, *["-"] * (len(HEADER) - 3), "refused", "-"]]


class Small(NamedTuple):
    """A small vibration: Hz, and damping ratio, with standard errors, nan where not known."""

    mode: str
    frequency: float
    frequency_std: float
    damping_ratio: float
    damping_ratio_std: float

    @classmethod
    def of(cls, mode: str, band: Band) -> Small:
        """That at the first amplitude of a band."""
        turn, ratio, error = 2 * np.pi, band.damping_ratio[0], band.damping_ratio_std[0]
        hertz, off = float(band.frequency[0]) / turn, float(band.frequency_std[0]) / turn
        return cls(mode, hertz, off, float(ratio), float(error))

    @classmethod
    def of_mode(cls, found: SmallVibration) -> Small:
        """That of a mode of several."""
        frequency, ratio = found.frequency, found.damping_ratio
        return cls(
            str(found.number), frequency, found.frequency_std, ratio, found.damping_ratio_std
        )

    def cells(self) -> list[str]:
        """Of the table."""
        ratio = _cells(100 * self.damping_ratio, 100 * self.damping_ratio_std)
        return [self.mode, *_cells(self.frequency, self.frequency_std), *ratio]


@dataclass(frozen=True, eq=False)
class Result:
    """What came of one file, however that was done.

    Attributes
    ----------
    file : str
    page : Path
    report : Identified
    pictures : sequence of Picture
        Figures of its page.
    small : sequence of Small
        Its small vibrations, one for each mode.
    structure : str
        Of the model, in a word.
    facts : mapping of str to Any
        What else is known, by name, frequencies in Hz, the rest in SI units.
    step : str
        What comes next.
    """

    file: str
    page: Path
    report: Identified
    pictures: Sequence[Picture]
    small: Sequence[Small]
    structure: str
    facts: Mapping[str, Any]
    step: str

    @classmethod
    def written(
        cls,
        file: Path | None,
        page: Path,
        report: Identified,
        interactive: bool,
        more: Sequence[Picture] = (),
        **told: Any,
    ) -> Result:
        """Draw a report on its page, with ``more`` figures; what else is ``told`` are fields."""
        figures = [*pictures(report), *more]
        command = str(click.get_current_context().info_name)
        drawn = bar(figures, "drawing")
        with writing(page):
            write_result(report, page, drawn, interactive=interactive, command=command)
        return cls(str(file or "example"), page, report, figures, **told)

    @property
    def found(self) -> Estimate | None:
        """All that was identified; None after regressions."""
        return self.report.found

    @property
    def model(self) -> AnyModel:
        """The equation that is printed."""
        return self.report.model

    @property
    def explained(self) -> bool | None:
        """Whether the equation leaves noise alone; None where that was not tested."""
        return None if self.found is None else bool(self.found.verdict.explained)

    def content(self) -> dict[str, Any]:
        """All numbers by name."""
        found = self.found
        errors = {} if found is None else found.standard_errors
        return {
            "file": self.file,
            **self.facts,
            "unit": self.model.unit,
            "explained": self.explained,
            "verdict": self.report.trouble if found is None else str(found.verdict),
            "equation": self.model.equation(),
            "coefficients": {
                term.key: {
                    "value": value,
                    "standard_error": errors.get(term.key),
                    "unit": term.unit(self.model.unit),
                }
                for term, value in zip(self.model.terms, self.model.values, strict=True)
            },
            "notes": [*(() if found is None else found.notes), *self.report.notes()],
            "report": str(self.page),
        }

    def rows(self) -> list[list[str]]:
        """Its rows in the table."""
        end = [self.structure, _WORDS[self.explained], str(self.page)]
        return [[self.file, *vibration.cells(), *end] for vibration in self.small]

    def brief(self) -> list[str]:
        """What was found and how sure that is, then what is doubtful of it."""
        r, series, beside = self.report, self.report.series, self.report.beside
        lines = [r.picked] if r.picked else []
        lines += r.equations() if series is None else series.in_short()
        lines += _if_short(r.coefficients()) if r.found is not None and not r.modes else []
        lines += [] if series is None else series.ends()
        lines += r.findings(alone=True)
        for table in r.few_tables():
            lines += as_text(table._replace(note="")).splitlines()
        doubts = beside.impossible() if beside is not None and r.found is None else r.remarks()
        return [*lines, *doubts]

    def full(self) -> str:
        """All of it, tables included."""
        r, whole = self.report, [repr(record) for record in self.report.measured]
        if r.beside is not None:
            pairs = zip(r.beside.decays, r.beside.backbones, strict=True)
            whole = [f"{decay!r}\n{backbone!r}" for decay, backbone in pairs]
        parts = [r.picked, *(whole or r.notes()), str(r.found or r.model)]
        more = [*map(as_text, r.more_tables()), *r.findings()[0 if r.found is None else 1 :]]
        return "\n\n".join(filter(None, [*parts, *more])) + "\n"


def _cells(value: float, error: float) -> list[str]:
    return with_error(value, error) if np.isfinite(error) else [f"{value:.5g}", "-"]


def _if_short(table: TextTable) -> list[str]:
    """Lines of a table of few rows; none of a longer one, which leaves a verdict no room."""
    return aligned(table.rows, "  ").splitlines() if len(table.rows) <= _FEW else []
