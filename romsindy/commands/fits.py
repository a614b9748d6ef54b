"""Fits of whole records on the command line: ``romsindy identify --coordinates, --input``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from romsindy.commands.analysis import USUAL, Asked
from romsindy.commands.inputs import Inputs, input_options
from romsindy.commands.one_mode import inspected, of_file
from romsindy.commands.options import damping_option, grouped
from romsindy.commands.results import Result
from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.forced.held_out import HeldOut, without_end
from romsindy.fit.forced.terms import stiffness_to
from romsindy.inspection.page import picture
from romsindy.inspection.tables import picked_together
from romsindy.physics.damping import DAMPING
from romsindy.physics.term import Term
from romsindy.record.forced import ForcedVibration
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
    """Identify equations of several coordinates of a file, or the example, and write their page.

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
    facts = {"releases": tuple(i + 1 for i in releases), "warnings": found.warnings}
    step = (
        "--full prints coefficients and mode shapes; in Python, .predict of the fit foretells"
        " another decay."
    )
    return Result.written(file, page, report, interactive, [picture(found)], facts=facts, step=step)


def _refused(coordinates: Coordinates, error: Exception) -> ValueError:
    """The same error with the name of the option."""
    sentence, own = str(error), f"coordinates = {coordinates!r}, but "
    if sentence.startswith(("fixed", "curvature")):
        return ValueError(sentence)
    if not sentence.startswith(own):
        sentence += f"; {_REMEDY}"
    return ValueError(f"--coordinates {coordinates}: {sentence.removeprefix(own)}")


# The options of records with inputs.
forced_options = grouped(
    input_options,
    click.option(
        "--select",
        is_flag=True,
        help="Terms are chosen by the data, up to --order; else the model has stiffness up to"
        " --order, and --damping.",
    ),
    click.option(
        "--order",
        default=USUAL[0],
        show_default=True,
        help="Highest order of stiffness and inertia with --input.",
    ),
    damping_option(USUAL[1], "Kind of damping with --input; may be repeated."),
    click.option(
        "--held-out",
        type=click.FloatRange(0, 1, min_open=True, max_open=True),
        help="Share of a record with inputs, at its end, that is not fitted but predicted: 0.2.",
    ),
)


@dataclass(frozen=True)
class AskedDriven(Inputs):
    """What the command line says of records with inputs, and of their model."""

    select: bool
    order: int
    damping: tuple[str, ...]
    held_out: float | None

    @property
    def terms(self) -> list[Term] | None:
        """Of the model; None has them chosen."""
        if self.select:
            return None
        return [*stiffness_to(self.order), *(DAMPING[kind] for kind in self.damping)]

    def parts(self, file: Path, reading: Mapping[str, Any]) -> tuple[ForcedVibration, Any]:
        """The record in a file, and the end of it that is held out, or None."""
        vibration = self.load(file, reading)
        if self.held_out is None:
            return vibration, None
        try:
            return without_end(vibration, self.held_out)
        except ValueError as error:
            raise ValueError(f"--held-out {error}") from error


def of_inputs(
    file: Path,
    page: Path,
    reading: Mapping[str, Any],
    asked: Asked,
    coordinates: int | str,
    driven: AskedDriven,
    interactive: bool,
) -> Result:
    """Identify the equations of a record with inputs, and write their page.

    Raises
    ------
    ValueError
        If what is held out is too short, or the model has no motion near the record.
    """
    with of_file(file):
        terms, order = driven.terms if coordinates == 1 else None, driven.order
        vibration, rest = driven.parts(file, reading)
        with bar(None, "identifying") as steps:
            try:
                say = steps.set_postfix_str
                fit = asked.fit([vibration], coordinates, say, terms=terms, order=order)
            except TrajectoryError as error:
                raise ValueError(f"{error}; a lower --order, or --select, may help") from error
    held_out = None if rest is None else HeldOut.of(fit, rest)
    report = Identified(
        f"Forced vibration {file.name}",
        [vibration],
        fit,
        channels=[f"channel {i + 1}" for i in range(vibration.n_channels)],
        held_out=held_out,
        interrupted=fit.solution.interrupted,
    )
    step = (
        "delays of the inputs with --full; in Python, .predict of the fit foretells a record of"
        " another level."
    )
    return Result.written(file, page, report, interactive, facts={}, step=step)
