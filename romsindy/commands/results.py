"""What was identified from each file: numbers, one table, one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from romsindy.fit.functions.identification import Identification
from romsindy.inspection.inspection import Inspection
from romsindy.inspection.modes import Mode
from romsindy.physics.coupled import AnyModel
from romsindy.physics.model import ReducedModel
from romsindy.show.identification_page import IdentificationReport, pictures
from romsindy.show.page import Picture
from romsindy.text import aligned, with_error

_LOW = 0.1  # of the largest amplitude of the data: there the linear frequency is read
_FEW = 9  # rows of a table that is printed without --full
HEADER = ["file", "mode", "frequency [Hz]", "+-", "damping ratio [%]", "+-"]
HEADER += ["structure", "explained", "report"]


@dataclass(frozen=True)
class Refused:
    """A file from which nothing was identified, and why, in a sentence."""

    file: str
    sentence: str

    def content(self) -> dict[str, Any]:
        """As of a `Result`."""
        return {"file": self.file, "error": self.sentence}

    def rows(self) -> list[list[str]]:
        """As of a `Result`."""
        return [[self.file, *["-"] * (len(HEADER) - 3), "refused", "-"]]


@dataclass(frozen=True, eq=False)
class Result:
    """What was identified from one file.

    Attributes
    ----------
    file : str
    report : IdentificationReport
    inspection : Inspection
    mode : Mode
    releases : sequence of int
        From 1.
    page : Path
    """

    file: str
    report: IdentificationReport
    inspection: Inspection
    mode: Mode
    releases: Sequence[int]
    page: Path

    @property
    def model(self) -> ReducedModel:
        """The equation that is printed."""
        return self.report.main.model

    @property
    def found(self) -> Identification | None:
        """All that was identified, bands included."""
        return self.report.found

    @property
    def interrupted(self) -> bool:
        """Whether the user wished to stop."""
        return self.report.interrupted

    @property
    def explained(self) -> bool:
        """Whether the residual of the identified equation is down to the noise."""
        return self.report.found is not None and self.report.found.verdict.explained

    @cached_property
    def linear(self) -> dict[str, float]:
        """Frequency (Hz) and damping ratio at low amplitude, with standard errors where known."""
        found, b = self.report.found, self.report.backbone
        amplitude = _LOW * float(b.amplitude.max())
        nan = float("nan")
        if found is None:
            model = self.report.main.model
            frequency, ratio = model.backbone([amplitude])[0], model.damping_ratio([amplitude])[0]
            errors = (nan, nan)
        else:
            band = found.band([amplitude])
            frequency, ratio = band.frequency[0], band.damping_ratio[0]
            errors = (float(band.frequency_std[0]) / (2 * np.pi), float(band.damping_ratio_std[0]))
        return {
            "amplitude": amplitude,
            "frequency": float(frequency) / (2 * np.pi),
            "frequency_std": errors[0],
            "damping_ratio": float(ratio),
            "damping_ratio_std": errors[1],
        }

    def pictures(self) -> list[Picture]:
        """The figures of its page that are about the equation."""
        return pictures(self.report)

    def __str__(self) -> str:
        report = self.report
        measured = [
            f"{decay!r}\n{backbone!r}"
            for decay, backbone in zip(report.decays, report.backbones, strict=True)
        ]
        table = f"{aligned(report.table())}\n\n{report.errors()}\n{report.note()}"
        return "\n\n".join([report.picked, *measured, report.equation, table])

    def brief(self) -> tuple[list[str], list[str], str]:
        """What was found, what is doubtful of it, and what comes next: lines, lines, and a line."""
        report, found = self.report, self.report.found
        if found is None:
            lines = [report.picked, str(report.equation).splitlines()[0], report.errors()]
            return lines, report.impossible(), "the coefficients of all regressions with --full."
        table = if_short(found.coefficients().rows)
        explained, *notes = found.conclusions()
        lines = [report.picked, *found.in_short(), *table, *found.ends(), explained]
        return [*lines, report.missed()], notes, self._next()

    def _next(self) -> str:
        ringing = [m for m in self.inspection.modes if not m.steady]
        if self.explained:
            return "--full prints the functions; romsindy diagnose asks what a simulation lacks."
        if len(ringing) > 1:
            return (
                f"{len(ringing)} modes ring: --coordinates auto models them together; --full prints"
                " all tables."
            )
        return f"romsindy inspect {self.file} shows what else is in it; --full prints all tables."

    def content(self) -> dict[str, Any]:
        """All numbers by name, frequencies in Hz, the rest in SI units."""
        b = self.report.backbone
        per_cycle = {"amplitude": 1.0, "frequency": 2 * np.pi, "damping_ratio": 1.0}
        return {
            "file": self.file,
            "channel": self.inspection.channel,
            "mode": self.mode.number,
            "modes": [m.mean_frequency for m in self.inspection.modes],
            "releases": self.releases,
            "warnings": self.inspection.warnings,
            "unit": b.unit,
            "linear": self.linear,
            **_verdict(self.report),
            "coefficients": coefficients(self.model, self.report.main.standard_errors),
            "backbone": {
                name + end: getattr(b, name + end) / unit
                for name, unit in per_cycle.items()
                for end in ("", "_std")
            },
            "notes": self.report.notes(),
            "report": str(self.page),
        }

    def rows(self) -> list[list[str]]:
        """Its rows in the table."""
        at_low, verdict = self.linear, _verdict(self.report)
        frequency = _cells(at_low["frequency"], at_low["frequency_std"])
        damping = _cells(100 * at_low["damping_ratio"], 100 * at_low["damping_ratio_std"])
        words = {True: "yes", False: "no", None: "not refined"}[verdict["explained"]]
        structure = verdict["structure"] or "-"
        row = [self.file, str(self.mode.number), *frequency, *damping]
        return [[*row, structure, words, str(self.page)]]


def _cells(value: float, error: float) -> list[str]:
    return with_error(value, error) if np.isfinite(error) else [f"{value:.5g}", "-"]


def _verdict(report: IdentificationReport) -> dict[str, Any]:
    found: Identification | None = report.found
    if found is None:
        return {"structure": None, "explained": None, "verdict": report.trouble}
    explained = bool(found.verdict.explained)
    words = {"structure": str(found.structure), "explained": explained}
    return {**words, "verdict": str(found.verdict), "equation": str(found.model.equation())}


def if_short(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table of few rows; none of a longer one, which leaves a verdict no room."""
    return aligned(rows, "  ").splitlines() if len(rows) <= _FEW else []


def coefficients(model: AnyModel, errors: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Value, standard error and unit of every coefficient, by name."""
    return {
        term.key: {
            "value": value,
            "standard_error": errors.get(term.key),
            "unit": term.unit(model.unit),
        }
        for term, value in zip(model.terms, model.values, strict=True)
    }
