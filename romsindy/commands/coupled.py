"""Several coordinates on the command line: ``romsindy identify --coordinates``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from romsindy.commands.analysis import Asked
from romsindy.commands.one_mode import inspected, of_file
from romsindy.commands.outputs import writing
from romsindy.commands.results import Brief, Result, Small
from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.small_vibrations import small_vibrations
from romsindy.inspection.inspection import Inspection
from romsindy.inspection.page import picture
from romsindy.inspection.tables import picked_together
from romsindy.orbits.curves import BackboneCurve
from romsindy.show.coupled_page import CoupledReport, pictures, write_coupled
from romsindy.text import as_text, bar

Coordinates = int | str  # "auto"

_REMEDY = "fewer coordinates, more channels (--column) or another --release may help"


def coordinates_of(_: click.Context, __: click.Parameter, value: str | None) -> Coordinates | None:
    """How many coordinates are modelled together; None for one by itself."""
    if value is None or value == "auto":
        return value
    if not value.isdecimal() or int(value) < 1:
        raise click.BadParameter(
            f"{value!r} is neither auto nor a whole number of at least 1, such as 2"
        )
    return int(value) if int(value) > 1 else None


def of_coordinates(
    file: Path | None,
    page: Path,
    reading: Mapping[str, Any],
    asked: Asked,
    coordinates: Coordinates,
    release: int | None,
    interactive: bool,
) -> Result:
    """Identify equations of several coordinates of a file, and write their page.

    Parameters
    ----------
    file : Path or None
        None is the example.
    page : Path
    reading : mapping
        How the file is read.
    asked : Asked
    coordinates : int or "auto"
    release : int or None
        From 1; all in which they ring by default.
    interactive : bool

    Raises
    ------
    ValueError
        If there is no such release, or so many coordinates are not found in it.
    """
    title, found = inspected(file, reading, asked.seed)
    modes = None if coordinates == "auto" else int(coordinates)
    with of_file(file, found.warnings if release is None else ()):
        decays = found.whole_decays(release, modes)
        releases = found.rings_together(release, modes)
        with bar(None, "identifying") as steps:
            try:
                fit = asked.fit(decays, coordinates, steps.set_postfix_str)
                seen = small_vibrations(fit)
            except (ValueError, TrajectoryError) as error:
                raise _refused(coordinates, error) from error
    picked = picked_together(found, releases)
    report = CoupledReport(title, fit, seen, decays, found.together, picked)
    figures = [*pictures(report), picture(found)]
    with writing(page):
        write_coupled(report, page, bar(figures, "drawing"), interactive=interactive)
    return _result(str(file or "example"), report, found, releases, page)


def _result(
    file: str,
    report: CoupledReport,
    inspection: Inspection,
    releases: Sequence[int],
    page: Path,
) -> Result:
    fit = report.fit
    coordinates = fit.mode_shapes.shape[1]
    modes = [vars(m) | {"backbone": _backbone(report.backbones[m.number])} for m in report.modes]
    decays, tables = "\n".join(map(repr, report.decays)), map(as_text, report.tables())
    facts = {
        "channels": report.channels,
        "coordinates": coordinates,
        "modes": modes,
        "mode_shapes": dict(zip(report.channels, fit.mode_shapes.tolist(), strict=True)),
        "releases": tuple(i + 1 for i in releases),
        "warnings": inspection.warnings,
    }
    return Result(
        file=file,
        page=page,
        model=fit.model,
        found=fit,
        small=[Small.of_mode(m) for m in report.modes],
        structure=f"{coordinates} coordinates",
        facts=facts,
        notes=[*fit.notes, *report.notes()],
        pictures=pictures(report),
        full="\n\n".join([report.picked, decays, str(fit), *tables]) + "\n",
        brief=_brief(report),
        interrupted=report.interrupted,
    )


def _brief(report: CoupledReport) -> Brief:
    modes = as_text(report.tables()[0]._replace(note="")).splitlines()
    found = [report.picked, *report.equations().splitlines(), str(report.fit.verdict), *modes]
    step = (
        "--full prints coefficients and mode shapes; in Python, .predict of the fit foretells"
        " another decay."
    )
    return Brief(found, report.fit.remarks(), step)


def _backbone(curve: BackboneCurve | str) -> dict[str, Any] | str:
    if isinstance(curve, str):
        return curve
    return {"frequency": curve.frequency / (2 * np.pi), "amplitude": curve.amplitude}


def _refused(coordinates: Coordinates, error: Exception) -> ValueError:
    """The same error with the name of the option."""
    sentence, own = str(error), f"coordinates = {coordinates!r}, but "
    if sentence.startswith(("fixed", "curvature")):
        return ValueError(sentence)
    if not sentence.startswith(own):
        sentence += f"; {_REMEDY}"
    return ValueError(f"--coordinates {coordinates}: {sentence.removeprefix(own)}")
