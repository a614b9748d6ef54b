"""The command ``romsindy identify``."""

from __future__ import annotations

import sys
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from tqdm import tqdm

from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.functions.identification import Identification
from romsindy.fit.functions.identify import identify as fit
from romsindy.physics.damping import DAMPING
from romsindy.physics.example import example_decay
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.record.files import load_decay
from romsindy.record.filters import Butterworth
from romsindy.regression.comparison import (
    PAPER,
    WEIGHTED,
    Candidate,
    Judged,
    compare_models,
    judge,
)
from romsindy.show.identification_page import (
    IdentificationReport,
    pictures,
    write_identification,
)


def _coefficients(
    _: click.Context, __: click.Parameter, values: tuple[str, ...]
) -> dict[str, float]:
    fixed = {}
    for value in values:
        name, _sep, number = value.partition("=")
        try:
            fixed[name.strip()] = float(number)
        except ValueError:
            raise click.BadParameter(
                f"{value!r} is not NAME=NUMBER, such as omega^2=1482.2"
            ) from None
    return fixed


def _harmonics(_: click.Context, __: click.Parameter, value: str | None) -> tuple[int, ...] | None:
    if value is None:
        return None
    try:
        low, dash, high = value.partition("-")
        if dash:
            return tuple(range(int(low), int(high) + 1))
        return tuple(int(v) for v in value.split(","))
    except ValueError:
        raise click.BadParameter(
            f"{value!r} is neither a range such as 0-3 nor a list such as 1,2,3"
        ) from None


@click.command()
@click.argument("file", required=False, type=click.Path(path_type=Path))
@click.option("--example", is_flag=True, help="Use a decay made on the spot instead of a file.")
@click.option(
    "--seed",
    default=0,
    show_default=True,
    help="Seed of the draws behind the bands, and of the example's noise.",
)
@click.option("--unit", help='Unit of the measured column: "mm", "m/s", "g", "deg", ...')
@click.option(
    "--quantity",
    type=click.Choice(["displacement", "velocity", "acceleration"]),
    help="What was measured.  [default: what unit or header say]",
)
@click.option("--column", help="Name of the measured column.")
@click.option("--time", help="Name of the time column.")
@click.option("--rate", type=float, help="Samples per second, for files without times.")
@click.option("--start", type=float, help="Use the record from this time on, s.")
@click.option("--end", type=float, help="Use the record up to this time, s.")
@click.option(
    "--order",
    default=5,
    show_default=True,
    help="Highest order of stiffness and inertia in regressions; the identification finds its own.",
)
@click.option(
    "--damping",
    multiple=True,
    default=("linear",),
    show_default=True,
    type=click.Choice(list(DAMPING)),
    help="Kind of damping in regressions; may be repeated.",
)
@click.option(
    "--fix",
    multiple=True,
    callback=_coefficients,
    metavar="NAME=VALUE",
    help="Known coefficient in SI units; may be repeated. Regressions with fixed linear"
    " frequency take omega^2 from here, or else from the measured backbone.",
)
@click.option(
    "--harmonics",
    callback=_harmonics,
    help="Harmonics of each cycle in regressions.  [default: 0-5, weighted 0-3]",
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
    help="Cut-off of the low-pass before regressions, Hz.  [default: ten times the fundamental]",
)
@click.option(
    "--plain",
    is_flag=True,
    help="The regression of the method's paper instead: two models, linear frequency estimated and"
    " fixed, no error bars.",
)
@click.option(
    "--weighted",
    is_flag=True,
    help="As --plain, with rows weighted by the noise expected in them.",
)
@click.option("--report", type=click.Path(path_type=Path), help="Name of the HTML report.")
@click.option("--model", type=click.Path(path_type=Path), help="Write the equation as JSON.")
@click.option(
    "--save",
    type=click.Path(path_type=Path),
    help="Write all that was identified, bands included, as JSON.",
)
@click.option(
    "--figure", type=click.Path(path_type=Path), help="Write the backbone figure to this file."
)
def identify(
    file: Path | None,
    example: bool,
    seed: int,
    order: int,
    damping: tuple[str, ...],
    fix: dict[str, float],
    harmonics: tuple[int, ...] | None,
    amplitude: tuple[float, float] | None,
    cutoff: float | None,
    plain: bool,
    weighted: bool,
    report: Path | None,
    model: Path | None,
    save: Path | None,
    figure: Path | None,
    **reading: Any,
) -> None:
    """Identify an equation of motion from the free decay in FILE.

    Prints its functions with 95 % bands, its coefficients beside those of plain regressions, and
    writes one HTML page.
    """
    if example == (file is not None):
        raise click.UsageError("name one FILE, or ask for --example")
    if plain and weighted:
        raise click.UsageError("--plain and --weighted are two regressions: ask for one")
    if save is not None and (plain or weighted):
        raise click.UsageError("--save needs the bands, which no regression has: use --model")
    for option, path in (("report", report), ("model", model), ("save", save), ("figure", figure)):
        if path is not None and not path.parent.is_dir():
            raise click.UsageError(f"--{option} {path}: there is no folder {path.parent}")
    if file is not None:
        record = load_decay(file, **reading)
        title, report = f"Free decay {file.name}", report or Path(f"{file.stem}_report.html")
    else:
        record = example_decay(35.0, seed)
        title, report = "Example: synthetic decay, 35 dB", report or Path("example_report.html")
    free, backbone = _used(record, amplitude)
    decay = free.conditioned(Butterworth(cutoff))
    recipe = deepcopy(WEIGHTED if weighted else PAPER)
    if harmonics is not None:
        recipe.set_params(projection__harmonics=harmonics)
    four = {c.name: c for c in compare_models(decay, backbone, order, damping, fix, recipe)}
    found, trouble = None, ""
    main: Judged = four["IC-ROM"]
    columns: list[Judged] = list(four.values())
    if not (plain or weighted):
        found, trouble = _functions(free, fix, seed)
        if found is not None:
            main = judge("identified", found.model, backbone, fix, found.standard_errors)
            columns = [main, *_beside(four, "omega^2" in fix)]
        elif save is not None:
            raise click.ClickException(trouble)
    result = IdentificationReport(title, record, decay, backbone, columns, main, found, trouble)
    click.echo(f"\n{decay!r}\n{backbone!r}\n\n{result.equation}\n")
    click.echo(f"{_aligned(result.table())}\n\n{result.errors()}\n{result.note()}")
    figures = pictures(result)
    write_identification(result, report, _bar(figures, "drawing"))
    click.echo(f"Report: {report}")
    if model is not None:
        model.write_text(result.main.model.to_json() + "\n", encoding="utf-8")
        click.echo(f"Model: {model}")
    if found is not None and save is not None:
        found.save(save)
        click.echo(f"Saved: {save}")
    if figure is not None:
        next(p for p in figures if p.name == "backbone").write(figure)
        click.echo(f"Figure: {figure}")


def _functions(
    free: Decay, fixed: dict[str, float], seed: int
) -> tuple[Identification | None, str]:
    """The identification, or why there is none: regressions are left then."""
    with _bar(None, "identifying") as bar:
        try:
            return fit(free, fixed=fixed, seed=seed, progress=bar.set_postfix_str), ""
        except TrajectoryError as error:
            return None, f"Regressions alone, without functions and bands: {error}."


def _beside(four: dict[str, Candidate], fixed: bool) -> list[Candidate]:
    """Regressions to be held against an identification."""
    suffix = ", omega fixed" if fixed else ""
    names = ("IC-ROM", "stiffness")
    return [replace(four[name + suffix], name=f"plain {name}") for name in names]


def _used(record: Decay, amplitude: tuple[float, float] | None) -> tuple[Decay, Backbone]:
    """The free part of a record, or its cycles with these amplitudes, and their backbone."""
    free = record.single().free()
    backbone = extract_backbone(free)
    if amplitude is None:
        return free, backbone
    inside = (backbone.amplitude >= amplitude[0]) & (backbone.amplitude <= amplitude[1])
    if not np.any(inside):
        low, high = backbone.amplitude.min(), backbone.amplitude.max()
        raise ValueError(
            f"amplitude = {amplitude} holds no cycle: those of the decay have amplitudes from"
            f" {low:.3g} to {high:.3g} {free.unit or '[q]'}"
        )
    free = free.between(float(backbone.t[inside][0]), float(backbone.t[inside][-1]))
    return free, extract_backbone(free)


def _bar(steps: Any, what: str, total: int | None = None) -> Any:
    return tqdm(steps, desc=what, total=total, leave=False, disable=not sys.stderr.isatty())


def _aligned(rows: list[list[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        left = [cell.ljust(w) for cell, w in zip(row[:2], widths[:2], strict=True)]
        right = [cell.rjust(w) for cell, w in zip(row[2:], widths[2:], strict=True)]
        lines.append("  ".join(left + right).rstrip())
    return "\n".join(lines)
