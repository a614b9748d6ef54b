"""Several coordinates on the command line: ``romsindy identify --coordinates``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from romsindy.commands.options import refuse_beside
from romsindy.commands.outputs import writing
from romsindy.commands.results import coefficients
from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.coupled_identify import identify_coupled
from romsindy.fit.fitted import Fit
from romsindy.fit.small_vibrations import small_vibrations
from romsindy.inspection.inspection import Inspection
from romsindy.inspection.page import picture
from romsindy.inspection.tables import picked_together
from romsindy.orbits.curves import BackboneCurve
from romsindy.physics.coupled import AnyModel
from romsindy.show.coupled_page import CoupledReport, pictures, write_coupled
from romsindy.show.page import Picture
from romsindy.text import as_text, bar, with_error

Coordinates = int | str  # "auto"

_STRONGEST = "the strongest vibrations are modelled, say how many"
# Options that are for one coordinate, and what to do without them.
_ALONE = {
    "mode": _STRONGEST,
    "band": _STRONGEST,
    "fix": "every coefficient is fitted; in Python, rs.refine keeps fixed ones",
    "amplitude": "cut the record with --start and --end",
    "curvature": "sensors are taken for straight, or for curved by what they show of products",
}


def coordinates_of(_: click.Context, __: click.Parameter, value: str | None) -> Coordinates | None:
    """How many coordinates are modelled together; None for one by itself."""
    if value is None or value == "auto":
        return value
    if not value.isdecimal() or int(value) < 1:
        raise click.BadParameter(
            f"{value!r} is neither auto nor a whole number of at least 1, such as 2"
        )
    return int(value) if int(value) > 1 else None


def refuse_others() -> None:
    """Refuse options that are for one coordinate.

    Raises
    ------
    click.UsageError
        If one was given.
    """
    refuse_beside("coordinates", "one coordinate", _ALONE)


@dataclass(frozen=True, eq=False)
class CoupledResult:
    """What was identified of several coordinates from one file.

    Attributes
    ----------
    file : str
    report : CoupledReport
    inspection : Inspection
    releases : sequence of int
        From 1.
    page : Path
    """

    file: str
    report: CoupledReport
    inspection: Inspection
    releases: Sequence[int]
    page: Path

    @property
    def found(self) -> Fit:
        """All that was identified."""
        return self.report.fit

    @property
    def model(self) -> AnyModel:
        """The equations that are printed."""
        return self.found.model

    @property
    def interrupted(self) -> bool:
        """Whether the user wished to stop."""
        return self.report.interrupted

    @property
    def explained(self) -> bool:
        """Whether the residual of the equations is down to the noise."""
        return self.found.verdict.explained

    def pictures(self) -> list[Picture]:
        """The figures of its page that are about the equations."""
        return pictures(self.report)

    def __str__(self) -> str:
        report = self.report
        decays = "\n".join(map(repr, report.decays))
        tables = map(as_text, report.tables())
        return "\n\n".join([report.picked, decays, str(self.found), *tables]) + "\n"

    def brief(self) -> tuple[list[str], list[str], str]:
        """What was found, what is doubtful of it, and what comes next: lines, lines, and a line."""
        fit, report = self.found, self.report
        modes = as_text(report.tables()[0]._replace(note="")).splitlines()
        found = [report.picked, *report.equations().splitlines(), str(fit.verdict), *modes]
        step = (
            "--full prints coefficients and mode shapes; in Python, .predict of the fit foretells"
            " another decay."
        )
        return found, fit.remarks(), step

    def content(self) -> dict[str, Any]:
        """All numbers by name, frequencies in Hz, the rest in SI units."""
        fit, report, model = self.found, self.report, self.model
        modes = [
            vars(m) | {"backbone": _backbone(report.backbones[m.number])} for m in report.modes
        ]
        return {
            "file": self.file,
            "channels": report.channels,
            "coordinates": fit.mode_shapes.shape[1],
            "modes": modes,
            "mode_shapes": dict(zip(report.channels, fit.mode_shapes.tolist(), strict=True)),
            "releases": self.releases,
            "warnings": self.inspection.warnings,
            "unit": model.unit,
            "explained": self.explained,
            "verdict": str(fit.verdict),
            "equation": model.equation(),
            "coefficients": coefficients(model, fit.standard_errors),
            "notes": [*fit.notes, *report.notes()],
            "report": str(self.page),
        }

    def rows(self) -> list[list[str]]:
        """Its rows in the table, one for each mode."""
        words = "yes" if self.explained else "no"
        structure = f"{self.found.mode_shapes.shape[1]} coordinates"
        return [
            [
                *(self.file, str(m.number), *with_error(m.frequency, m.frequency_std)),
                *with_error(100 * m.damping_ratio, 100 * m.damping_ratio_std),
                *(structure, words, str(self.page)),
            ]
            for m in self.report.modes
        ]


def _backbone(curve: BackboneCurve | str) -> dict[str, Any] | str:
    if isinstance(curve, str):
        return curve
    return {"frequency": curve.frequency / (2 * np.pi), "amplitude": curve.amplitude}


def identified_together(
    names: tuple[str, str],
    found: Inspection,
    coordinates: Coordinates,
    release: int | None,
    page: Path,
    interactive: bool,
) -> CoupledResult:
    """Identify equations of several coordinates, and write their page.

    Parameters
    ----------
    names : (str, str)
        Of the file, and of its page.
    found : Inspection
    coordinates : int or "auto"
    release : int, optional
        From 1; all in which they ring by default.
    page : Path
    interactive : bool

    Raises
    ------
    ValueError
        If there is no such release, or so many coordinates are not found in it.
    """
    modes = None if coordinates == "auto" else int(coordinates)
    decays = found.whole_decays(release, modes)
    releases = found.rings_together(release, modes)
    with bar(None, "identifying") as steps:
        try:
            fit = identify_coupled(decays, coordinates, progress=steps.set_postfix_str)
            seen = small_vibrations(fit)
        except (ValueError, TrajectoryError) as error:
            raise _refused(coordinates, error) from error
    file, title = names
    picked = picked_together(found, releases)
    report = CoupledReport(title, fit, seen, decays, found.together, picked)
    figures = [*pictures(report), picture(found)]
    with writing(page):
        write_coupled(report, page, bar(figures, "drawing"), interactive=interactive)
    return CoupledResult(file, report, found, tuple(i + 1 for i in releases), page)


def _refused(coordinates: Coordinates, error: Exception) -> ValueError:
    """The same error with the name of the option."""
    sentence, own = str(error), f"coordinates = {coordinates!r}, but "
    if not sentence.startswith(own):
        sentence += "; fewer coordinates, more channels (--column) or another --release may help"
    return ValueError(f"--coordinates {coordinates}: {sentence.removeprefix(own)}")
