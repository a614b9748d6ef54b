"""The command ``romsindy identify``: one path, whose steps depend on what was measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import click

from romsindy.commands.measurement import (
    USUAL,
    Asked,
    Selection,
    identified,
    inspected,
    mode_options,
    of_file,
    of_one_mode,
)
from romsindy.commands.options import (
    FILE,
    INPUTS,
    PARTS,
    READING,
    Inputs,
    damping_option,
    fix_option,
    grouped,
    input_options,
    jobs_option,
    reading_options,
    refuse_beside,
)
from romsindy.commands.outputs import WritingCommand
from romsindy.commands.results import FIGURE, SAVE, Result, Telling, answer_options
from romsindy.fit.forced.identify import stiffness_to
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.results.fitted import HeldOut, without_end
from romsindy.fit.verdict import CURVATURE
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

    Raises a ValueError if there is no such release, or so many coordinates are not found in it.
    """
    title, found = inspected(file, reading, asked.seed, together=True)
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

    Raises a ValueError if what is held out is too short, or the model has no motion near the
    record.
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


_STRONGEST = "the strongest vibrations are modelled, say how many"
# An option, what others are for that it excludes, and what to do without each of them.
EXCLUDED = (
    (
        "input",
        "free decays",
        {
            **PARTS,
            "example": "name a file; `romsindy example` writes one",
            "curvature": "the sensor is taken for straight",
        },
    ),
    ("coordinates", "one coordinate", dict.fromkeys(("mode", "band"), _STRONGEST)),
    (
        "select",
        "models whose terms are given",
        {"damping": "kinds of damping are among what is chosen from"},
    ),
)
_DRIVEN = ("select", "order", "damping", "held-out")
_HEADINGS = {
    "Reading": f"{READING} --example",
    "What is looked for": "--mode --band --release --coordinates --fix --curvature"
    " --damping-split --seed",
    "Measured inputs": f"{INPUTS} --select --order --damping --held-out",
    "Output": "--jobs --full --report --interactive --json --model --save --figure --overwrite",
}


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("files", nargs=-1, type=FILE, metavar="FILES...")
@click.option("--example", is_flag=True, help="Use a decay made on the spot instead of a file.")
@click.option(
    "--seed",
    default=0,
    show_default=True,
    help="Seed of the draws behind the bands, and of the example's noise.",
)
@reading_options
@forced_options
@mode_options
@click.option(
    "--coordinates",
    callback=coordinates_of,
    metavar="auto|N",
    help="Model so many vibrations together, or as many as the data need.  [default: 1]",
)
@fix_option("Known coefficient in SI units; may be repeated.")
@click.option(
    "--curvature",
    type=float,
    show_default=f"{CURVATURE:g}",
    help="How far the sensor may be off a straight line at the largest amplitude, as a part of it"
    " (one standard deviation); 0 of one that is straight.",
)
@click.option(
    "--damping-split/--no-damping-split",
    default=None,
    help="Tell apart how much of the damping of a decay is linear, how much quadratic.  [default:"
    " of angles]",
)
@jobs_option
@answer_options
@FIGURE
@SAVE
def identify(
    files: tuple[Path, ...],
    example: bool,
    mode: int | None,
    band: tuple[float, float] | None,
    coordinates: Coordinates | None,
    release: int | None,
    **options: Any,
) -> None:
    """Identify equations of motion from the free or driven vibrations in FILES.

    Of a free decay the mode that moves most is isolated, in all releases in which it rings, and its
    equation is printed in short, with 95 % bands, how sure it is and what is wrong with it. With
    --input the whole record is fitted. Functions with bands, coefficients beside those of plain
    regressions and figures are on one HTML page, the tables also printed with --full; of many files
    a table, one page for all, and one for each. An interruption (Ctrl-C) keeps what is done.
    """
    telling = Telling.taken(options)
    asked = Asked(**{f.name: options.pop(f.name) for f in fields(Asked)})
    driven = AskedDriven(**{f.name: options.pop(f.name) for f in fields(AskedDriven)})
    there = {"input": driven.inputs, "coordinates": coordinates, "select": driven.select}
    for option, what, others in EXCLUDED:
        if there[option]:
            refuse_beside(option, what, others)
    driven.refuse_alone(_DRIVEN)
    one: Callable[..., Result]
    if driven.inputs:
        one = partial(of_inputs, asked=asked, coordinates=coordinates or 1, driven=driven)
    elif coordinates is not None:
        one = partial(of_coordinates, asked=asked, coordinates=coordinates, release=release)
    else:
        analyse = partial(identified, asked=asked)
        choice = Selection(mode, band, release)
        one = partial(of_one_mode, choice=choice, analyse=analyse, seed=asked.seed)
    job = partial(one, reading=options, interactive=telling.interactive)
    telling.give(job, files, example, "report")
