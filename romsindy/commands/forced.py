"""Records with measured inputs on the command line: ``romsindy identify --input``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from romsindy.commands.analysis import USUAL, Asked
from romsindy.commands.inputs import Inputs, input_options
from romsindy.commands.one_mode import of_file
from romsindy.commands.options import damping_option, grouped
from romsindy.commands.results import Result, Small
from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.forced.held_out import HeldOut, without_end
from romsindy.fit.forced.terms import stiffness_to
from romsindy.physics.damping import DAMPING
from romsindy.physics.term import Term
from romsindy.record.forced import ForcedVibration
from romsindy.show.identified import Identified
from romsindy.text import bar

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
class Driven(Inputs):
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
    driven: Driven,
    interactive: bool,
) -> Result:
    """Identify the equation of a record with inputs, and write its page.

    Parameters
    ----------
    file, page : Path
    reading : mapping
        How the file is read.
    asked : Asked
    coordinates : int or "auto"
        Refused unless it is 1.
    driven : Driven
    interactive : bool

    Raises
    ------
    ValueError
        If what is held out is too short, or the model has no motion near the record.
    """
    with of_file(file):
        terms, order = driven.terms, driven.order
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
        held_out=held_out,
        interrupted=fit.solution.interrupted,
    )
    left = None if report.piece else float(np.sqrt(np.mean(np.concatenate(fit.residuals) ** 2)))
    facts = {
        "inputs": report.inputs(),
        "residual": left,
        "held_out": held_out and {"start": rest.t[0], "error": held_out.error},
    }
    return Result.written(
        file,
        page,
        report,
        interactive,
        small=[Small.of("-", report.band)] if report.band is not None else [],
        structure="driven",
        facts=facts,
        step="delays of the inputs with --full; in Python, .predict of the fit foretells a record"
        " of another level.",
    )
