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
from romsindy.commands.outputs import writing
from romsindy.commands.results import Brief, Result, Small, if_short
from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.fitted import Fit
from romsindy.fit.forced.held_out import HeldOut, without_end
from romsindy.fit.forced.terms import stiffness_to
from romsindy.fit.small_vibrations import small_vibrations
from romsindy.physics.damping import DAMPING
from romsindy.physics.driven import inputs_of
from romsindy.physics.term import Term
from romsindy.record.forced import ForcedVibration
from romsindy.show.coupled_page import CoupledReport, write_coupled
from romsindy.show.coupled_page import pictures as coupled_pictures
from romsindy.show.forced_page import ForcedReport, pictures, write_forced
from romsindy.text import as_text, bar

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
        Of several the terms are chosen.
    driven : Driven
    interactive : bool

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
    if fit.model.numbered:
        return _of_several(file, page, fit, vibration, held_out, interactive)
    report = ForcedReport(f"Forced vibration {file.name}", fit, vibration, held_out)
    with writing(page):
        write_forced(report, page, bar(pictures(report), "drawing"), interactive=interactive)
    return _result(str(file), report, page)


def _of_several(
    file: Path,
    page: Path,
    fit: Fit,
    vibration: ForcedVibration,
    held_out: HeldOut | None,
    interactive: bool,
) -> Result:
    """The page of several coordinates, and what is printed of them."""
    names = [f"channel {i + 1}" for i in range(vibration.n_channels)]
    title, seen = f"Forced vibration {file.name}", small_vibrations(fit)
    report = CoupledReport(title, fit, seen, [vibration], names)
    with writing(page):
        figures = bar(coupled_pictures(report), "drawing")
        write_coupled(report, page, figures, interactive=interactive)
    said = [str(held_out)] if held_out else []
    modes, shapes = map(as_text, report.tables())
    found = [*report.equations().splitlines(), str(fit.verdict), *modes.splitlines(), *said]
    delays = {name: {"delay": late, "delay_std": std} for name, (late, std) in fit.delays.items()}
    return Result(
        file=str(file),
        page=page,
        model=fit.model,
        found=fit,
        small=[Small.of_mode(m) for m in seen],
        structure=f"{fit.model.n_coordinates} coordinates, driven",
        facts={"delays": delays, "mode_shapes": fit.mode_shapes.tolist()},
        notes=[*fit.notes, *report.notes()],
        pictures=coupled_pictures(report),
        full="\n\n".join([repr(vibration), str(fit), modes, shapes, *said]) + "\n",
        brief=Brief(found, fit.remarks(), "mode shapes at the channels with --full."),
        interrupted=fit.solution.interrupted,
    )


def _result(file: str, report: ForcedReport, page: Path) -> Result:
    fit, held = report.fit, report.held_out
    left = np.concatenate(fit.residuals)
    facts = {
        "inputs": _inputs(report),
        "residual": None if report.piece else float(np.sqrt(np.mean(left**2))),
        "held_out": held and {"start": held.vibration.t[0], "error": held.error},
    }
    said = [str(held)] if held else []
    tables = [repr(report.vibration), str(fit), as_text(report.inputs()), *said]
    step = (
        "delays of the inputs with --full; in Python, .predict of the fit foretells a record of"
        " another level."
    )
    found = [report.equation(), *if_short(fit.table()), str(fit.verdict), *said]
    return Result(
        file=file,
        page=page,
        model=fit.model,
        found=fit,
        small=[Small.of("-", report.band)],
        structure="driven",
        facts=facts,
        notes=[*fit.notes, *report.measured()],
        pictures=pictures(report),
        full="\n\n".join(tables) + "\n",
        brief=Brief(found, fit.remarks(), step),
        interrupted=fit.solution.interrupted,
    )


def _inputs(report: ForcedReport) -> dict[str, dict[str, Any]]:
    fit, dt = report.fit, report.vibration.dt
    return {
        term.signal: {
            "gain": fit.model.coefficients[term.key],
            "gain_std": fit.standard_errors[term.key],
            "delay": delay,
            "delay_std": error,
            "delay_in_samples": delay / dt,
            "unit": term.input_unit,
            "interpolation": term.interpolation,
        }
        for term in inputs_of(fit.single_model)
        for delay, error in [fit.delays[term.signal]]
    }
