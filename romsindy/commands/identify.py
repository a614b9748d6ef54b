"""The command ``romsindy identify``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import click

from romsindy.commands.analysis import USUAL, Settings, identified
from romsindy.commands.answers import FIGURE, SAVE, Telling, answer_options
from romsindy.commands.coupled import (
    Coordinates,
    coordinates_of,
    identified_together,
    refuse_others,
)
from romsindy.commands.forced import Driven, forced_options, identified_driven
from romsindy.commands.measurement import Choice
from romsindy.commands.one_mode import inspected, mode_options, of_file, of_one_mode
from romsindy.commands.options import FILE, INPUTS, READING, fix_option, reading_options
from romsindy.commands.outputs import WritingCommand
from romsindy.commands.results import Result
from romsindy.fit.verdict import CURVATURE
from romsindy.physics.damping import DAMPING

_HEADINGS = {
    "Reading": f"{READING} --example",
    "What is looked for": "--mode --band --release --amplitude --coordinates --fix --curvature"
    " --seed",
    "Measured inputs": f"{INPUTS} --select --order --damping --held-out",
    "Output": "--full --report --interactive --json --model --save --figure --force",
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
@click.option(
    "--order",
    default=USUAL[0],
    show_default=True,
    help="Highest order of stiffness and inertia with --input.",
)
@click.option(
    "--damping",
    multiple=True,
    default=USUAL[1],
    show_default=True,
    type=click.Choice(list(DAMPING)),
    help="Kind of damping with --input; may be repeated.",
)
@fix_option("Known coefficient in SI units; may be repeated.")
@click.option(
    "--amplitude",
    nargs=2,
    type=float,
    help="Least and largest amplitude of the cycles that are used.",
)
@click.option(
    "--curvature",
    default=CURVATURE,
    show_default=True,
    help="How far the sensor may be off a straight line at the largest amplitude, as a part of it"
    " (one standard deviation); 0 of one that is straight.",
)
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
    order: int,
    damping: tuple[str, ...],
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
    settings = Settings(**{f.name: options.pop(f.name) for f in fields(Settings)})
    driven = Driven(**{f.name: options.pop(f.name) for f in fields(Driven)})
    driven.refuse()
    one: Callable[..., Result]
    if coordinates is not None:
        refuse_others()
        one = partial(_together, coordinates=coordinates, release=release, seed=settings.seed)
    elif driven.inputs:
        one = partial(_driven, driven=driven, model=(order, damping))
    else:
        analyse = partial(identified, settings=settings)
        choice = Choice(mode, band, release)
        one = partial(of_one_mode, choice=choice, analyse=analyse, seed=settings.seed)
    job = partial(one, reading=options, interactive=telling.interactive)
    telling.give(job, files, example, "report")


def _together(
    file: Path | None,
    page: Path,
    reading: Mapping[str, Any],
    coordinates: Coordinates,
    release: int | None,
    seed: int,
    interactive: bool,
) -> Result:
    """Identify several coordinates of a file together."""
    title, found = inspected(file, reading, seed)
    names = (str(file or "example"), title)
    try:
        return identified_together(names, found, coordinates, release, page, interactive)
    except ValueError as error:
        raise of_file(file, error, found.warnings if release is None else ()) from error


def _driven(
    file: Path,
    page: Path,
    reading: Mapping[str, Any],
    driven: Driven,
    model: tuple[int, tuple[str, ...]],
    interactive: bool,
) -> Result:
    """Identify the equation of a record with inputs."""
    vibration = driven.load(file, reading)
    try:
        return identified_driven(file, vibration, driven, model, page, interactive)
    except ValueError as error:
        raise of_file(file, error, ()) from error
