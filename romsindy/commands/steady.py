"""The command ``romsindy steady``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from romsindy.commands.answers import SAVE, Telling, answer_options
from romsindy.commands.one_mode import of_file
from romsindy.commands.options import FILE, fix_option
from romsindy.commands.outputs import WritingCommand
from romsindy.commands.results import Result
from romsindy.commands.steady_table import SteadyTable
from romsindy.fit.steady.fit import SteadyFit, fit_steady
from romsindy.physics.model import ReducedModel
from romsindy.record.recording import QUANTITIES, Quantity
from romsindy.show.identified import Identified
from romsindy.text import as_options, bar

# What remedies of Python are called here; arguments follow by `as_options`.
_WORDS = (
    (r"give response\.conj\(\)", "say --lag"),
    (r"look at measured=", "look at --quantity"),
    (r"give -force", "turn it by 180 degrees"),
    (r"\bstd (was not given|must be)", r"spread \1"),
    (r"give model\.regularised\(.*", "leave it out; in Python, model.regularised makes it smooth"),
)

_CONSTANT = (
    "a slope of the gain was looked for, and without one what takes no part is predicted as well:"
    " it is 0"
)
_EXPLAINED = (
    "--save keeps the fit; in Python, .forced_response of it foretells another level of force."
)
_LACKS = (
    "leave out points that stand off their neighbours on the page, for they had not settled; name"
    " another --term; --slope fit lets the gain change with the force."
)


def _slope(_: click.Context, __: click.Parameter, value: str) -> float | None:
    try:
        return None if value == "fit" else float(value)
    except ValueError:
        raise click.BadParameter(f"{value!r} is neither a number nor fit") from None


_HEADINGS = {
    "The table": "--quantity --lag",
    "What is looked for": "--term --fix --gain --slope --phase",
    "Output": "--full --report --interactive --json --model --save --force",
}


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("file", type=FILE, metavar="POINTS")
@click.option(
    "--quantity",
    type=click.Choice(list(QUANTITIES)),
    help="What the response is.  [default: what unit or header say]",
)
@click.option(
    "--lag", is_flag=True, help="Phases of the response are lags: positive if it is late."
)
@click.option(
    "--term",
    "terms",
    multiple=True,
    metavar="NAME",
    help="Term beside omega^2 and c_linear, such as gamma_3, Upsilon_3 or c_quadratic; may be"
    " repeated.  [default: chosen by levels of force that take no part]",
)
@fix_option("Known coefficient in SI units; may be repeated.")
@click.option(
    "--gain", type=float, help="Force per unit mass of an excitation of 1.  [default: fitted]"
)
@click.option(
    "--slope",
    default="0",
    callback=_slope,
    show_default=True,
    metavar="fit|NUMBER",
    help="By how much the gain grows for an excitation of 1.",
)
@click.option(
    "--phase",
    type=float,
    help="By how much the force leads the excitation, deg.  [default: fitted]",
)
@answer_options
@SAVE
def steady(
    file: Path,
    quantity: Quantity | None,
    lag: bool,
    terms: tuple[str, ...],
    fix: Mapping[str, float],
    gain: float | None,
    slope: float | None,
    phase: float | None,
    **options: Any,
) -> None:
    """Fit an equation of motion to the steady states in the table POINTS.

    POINTS is CSV, or any file that romsindy reads, of a stepped sine or of phase resonance. It has
    a row for each steady state and a header: frequency [Hz], force [N], and the response by its
    name and unit, displacement [mm]; where they were measured, force phase [deg], displacement
    phase [deg], displacement 2 [mm] and so on for its harmonics, and spread [mm], the standard
    deviation of real and imaginary part.
    """
    telling = Telling.taken(options)
    turn = None if phase is None else float(np.radians(phase))

    def job(file: Path | None, page: Path) -> Result:
        assert file is not None  # a file is required
        with of_file(file):
            table = SteadyTable.read(file, quantity, lag)
            try:
                fit = _fitted(table, terms, fix, {"gain": gain, "slope": slope, "phase": turn})
            except ValueError as error:
                raise ValueError(_in_words(str(error))) from error
        notes = [*fit.notes, *([_CONSTANT] if slope is None and not fit.chain.slope else [])]
        told = replace(fit, notes=tuple(map(_in_words, notes)))
        return _told(file, table, told, page, telling.interactive)

    telling.give(job, [file], False, "steady")


def _fitted(
    table: SteadyTable, terms: Sequence[str], fix: Mapping[str, float], chain: Mapping[str, Any]
) -> SteadyFit:
    measured = (table.frequency, table.force, table.response)
    given = {**chain, "measured": table.quantity, "std": table.spread}
    with bar(None, "fitting"):
        if not terms:
            fit = fit_steady(None, *measured, unit=table.unit, **given)
            if not fix:
                return fit
            terms = tuple(fit.model.coefficients)
        names = dict.fromkeys(("omega^2", *terms, *fix, "c_linear"), 0.0)
        start = {"omega^2": float(np.median(table.frequency)) ** 2, **fix}
        model = ReducedModel.from_coefficients(names | start, table.unit)
        return fit_steady(model, *measured, fixed=tuple(fix), **given)


def _in_words(sentence: str) -> str:
    """A sentence of the fit with what its remedies are called on the command line."""
    for pattern, word in _WORDS:
        sentence = re.sub(pattern, word, sentence)
    return as_options(sentence)


def _told(file: Path, table: SteadyTable, fit: SteadyFit, page: Path, interactive: bool) -> Result:
    """What is said of a fit, with its page."""
    report = Identified(f"Steady states {file.name}", found=fit, force_unit=table.force_unit)
    step = _EXPLAINED if fit.verdict.explained else _LACKS
    return Result.written(file, page, report, interactive, facts={}, step=step)
