"""The command ``romsindy identify``: one path, whose steps depend on what was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import click

from romsindy.commands.analysis import Asked, identified
from romsindy.commands.answers import FIGURE, SAVE, Telling, answer_options
from romsindy.commands.fits import (
    AskedDriven,
    Coordinates,
    coordinates_of,
    forced_options,
    of_coordinates,
    of_inputs,
)
from romsindy.commands.inputs import PARTS
from romsindy.commands.measurement import Choice
from romsindy.commands.one_mode import mode_options, of_one_mode
from romsindy.commands.options import (
    FILE,
    INPUTS,
    READING,
    fix_option,
    reading_options,
    refuse_beside,
)
from romsindy.commands.outputs import WritingCommand
from romsindy.commands.results import Result
from romsindy.fit.verdict import CURVATURE

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
    "What is looked for": "--mode --band --release --coordinates --fix --curvature --seed",
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
@fix_option("Known coefficient in SI units; may be repeated.")
@click.option(
    "--curvature",
    type=float,
    show_default=f"{CURVATURE:g}",
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
        choice = Choice(mode, band, release)
        one = partial(of_one_mode, choice=choice, analyse=analyse, seed=asked.seed)
    job = partial(one, reading=options, interactive=telling.interactive)
    telling.give(job, files, example, "report")
