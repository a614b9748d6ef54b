"""The command ``romsindy regress``."""

from __future__ import annotations

from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import click

from romsindy.commands.measurement import (
    USUAL,
    Recipe,
    Selection,
    mode_options,
    of_one_mode,
    regressed,
)
from romsindy.commands.options import (
    FILE,
    READING,
    damping_option,
    fix_option,
    jobs_option,
    reading_options,
)
from romsindy.commands.outputs import WritingCommand
from romsindy.commands.results import FIGURE, Telling, answer_options


def _harmonics(_: click.Context, __: click.Parameter, value: str | None) -> tuple[int, ...] | None:
    if value is None:
        return None
    low, dash, high = value.partition("-")
    try:
        chosen = range(int(low), int(high) + 1) if dash else map(int, value.split(","))
        harmonics = tuple(chosen)
    except ValueError:
        harmonics = ()
    if not harmonics:
        raise click.BadParameter(
            f"{value!r} is neither a range such as 0-3 nor a list such as 1,2,3"
        )
    return harmonics


_HEADINGS = {
    "Reading": f"{READING} --example",
    "What is looked for": "--mode --band --release --amplitude --fix --seed",
    "The regression": "--weighted --plain --order --damping --harmonics --cutoff",
    "Output": "--jobs --full --report --interactive --json --model --figure --overwrite",
}


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("files", nargs=-1, type=FILE, metavar="FILES...")
@click.option("--example", is_flag=True, help="Use a decay made on the spot instead of a file.")
@click.option("--seed", default=0, show_default=True, help="Seed of the example's noise.")
@reading_options
@mode_options
@click.option("--weighted", is_flag=True, help="Weight rows by the noise expected in them: usual.")
@click.option("--plain", is_flag=True, help="Weight all rows alike, as the method's paper does.")
@click.option(
    "--order", default=USUAL[0], show_default=True, help="Highest order of stiffness and inertia."
)
@damping_option(USUAL[1], "Kind of damping; may be repeated.")
@fix_option(
    "Known coefficient in SI units; may be repeated. Models with fixed linear frequency take"
    " omega^2 from here, or else from the measured backbone."
)
@click.option(
    "--harmonics",
    callback=_harmonics,
    help="Harmonics of each cycle.  [default: 0-3, with --plain 0-5]",
)
@click.option(
    "--amplitude",
    nargs=2,
    type=float,
    help="Least and largest amplitude of the cycles that are used.",
)
@click.option(
    "--cutoff",
    type=float,
    help="Cut-off of the low-pass before, Hz.  [default: ten times the fundamental]",
)
@jobs_option
@answer_options
@FIGURE
def regress(
    files: tuple[Path, ...],
    example: bool,
    seed: int,
    mode: int | None,
    band: tuple[float, float] | None,
    release: int | None,
    weighted: bool,
    **options: Any,
) -> None:
    """Fit models of a given structure to the free decays in FILES, by regression.

    Of each file the mode that moves most is isolated. Two models are regressed, a stiffness
    polynomial and one with nonlinear inertia (IC-ROM), each with its linear frequency estimated and
    fixed, and held against the backbone. There are no error bars: romsindy identify has them, and
    finds the structure by itself.
    """
    if weighted and options["plain"]:
        raise click.UsageError("--plain and --weighted are two regressions: ask for one")
    telling = Telling.taken(options)
    recipe = Recipe(**{f.name: options.pop(f.name) for f in fields(Recipe)})

    asked: dict[str, Any] = {"analyse": partial(regressed, recipe=recipe), "seed": seed}
    asked |= {"choice": Selection(mode, band, release), "reading": options}
    job = partial(of_one_mode, interactive=telling.interactive, **asked)
    telling.give(job, files, example, "regression")
