"""Several coordinates on the command line: ``romsindy identify --coordinates``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np

from romsindy.commands.analysis import Asked
from romsindy.commands.one_mode import inspected, of_file
from romsindy.commands.results import Result, Small
from romsindy.fit.collocation import TrajectoryError
from romsindy.inspection.page import picture
from romsindy.inspection.tables import picked_together
from romsindy.orbits.curves import BackboneCurve
from romsindy.show.identified import Identified
from romsindy.text import bar

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
            except (ValueError, TrajectoryError) as error:
                raise _refused(coordinates, error) from error
    picked = picked_together(found, releases)
    stopped = fit.solution.interrupted
    report = Identified(
        title, decays, fit, channels=found.together, picked=picked, interrupted=stopped
    )
    of_modes = [vars(m) | {"backbone": _backbone(report.backbones[m.number])} for m in report.modes]
    facts = {
        "channels": report.channels,
        "coordinates": len(of_modes),
        "modes": of_modes,
        "mode_shapes": dict(zip(report.channels, fit.mode_shapes.tolist(), strict=True)),
        "releases": tuple(i + 1 for i in releases),
        "warnings": found.warnings,
    }
    return Result.written(
        file,
        page,
        report,
        interactive,
        [picture(found)],
        small=[Small.of_mode(m) for m in report.modes],
        structure=f"{len(of_modes)} coordinates",
        facts=facts,
        step="--full prints coefficients and mode shapes; in Python, .predict of the fit foretells"
        " another decay.",
    )


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
