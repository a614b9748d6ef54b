"""What came of a file: numbers by name, rows of a table, and words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from romsindy.fit.estimate import Band, Estimate
from romsindy.fit.small_vibrations import SmallVibration
from romsindy.physics.coupled import AnyModel
from romsindy.record.backbone import Backbone
from romsindy.show.page import Picture
from romsindy.text import aligned, with_error

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


class Brief(NamedTuple):
    """The answer in short: what was found, what is doubtful of it, and what comes next."""

    found: list[str]
    doubts: list[str]
    step: str


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
    """What was identified from one file, however that was done.

    Attributes
    ----------
    file : str
    page : Path
    model : ReducedModel or CoupledModel
        The equation that is printed.
    found : Estimate or None
        All that was identified; None after regressions.
    small : sequence of Small
        Its small vibrations, one for each mode.
    structure : str
        Of the model, in a word.
    facts : mapping of str to Any
        What else is known, by name, frequencies in Hz, the rest in SI units.
    notes : sequence of str
        On the record, and on the model.
    pictures : sequence of Picture
        Figures of its page that are about the equation.
    full : str
        All tables.
    brief : Brief
    trouble : str
        Why nothing was found but regressions.
    interrupted : bool
        Whether the user wished to stop.
    backbone : Backbone or None
        As measured.
    """

    file: str
    page: Path
    model: AnyModel
    found: Estimate | None
    small: Sequence[Small]
    structure: str
    facts: Mapping[str, Any]
    notes: Sequence[str]
    pictures: Sequence[Picture]
    full: str
    brief: Brief
    trouble: str = ""
    interrupted: bool = False
    backbone: Backbone | None = None

    @property
    def explained(self) -> bool | None:
        """Whether the equation leaves noise alone; None where that was not tested."""
        return None if self.found is None else bool(self.found.verdict.explained)

    def content(self) -> dict[str, Any]:
        """All numbers by name."""
        errors = {} if self.found is None else self.found.standard_errors
        return {
            "file": self.file,
            **self.facts,
            "unit": self.model.unit,
            "explained": self.explained,
            "verdict": self.trouble if self.found is None else str(self.found.verdict),
            "equation": self.model.equation(),
            "coefficients": {
                term.key: {
                    "value": value,
                    "standard_error": errors.get(term.key),
                    "unit": term.unit(self.model.unit),
                }
                for term, value in zip(self.model.terms, self.model.values, strict=True)
            },
            "notes": self.notes,
            "report": str(self.page),
        }

    def rows(self) -> list[list[str]]:
        """Its rows in the table."""
        end = [self.structure, _WORDS[self.explained], str(self.page)]
        return [[self.file, *vibration.cells(), *end] for vibration in self.small]


def _cells(value: float, error: float) -> list[str]:
    return with_error(value, error) if np.isfinite(error) else [f"{value:.5g}", "-"]


def if_short(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table of few rows; none of a longer one, which leaves a verdict no room."""
    return aligned(rows, "  ").splitlines() if len(rows) <= _FEW else []
