"""The command ``romsindy identify``."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from tqdm import tqdm

from romsindy.physics.damping import DAMPING
from romsindy.physics.example import example_decay
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.record.files import load_decay
from romsindy.record.filters import Butterworth
from romsindy.regression.projection import HarmonicProjection
from romsindy.selection.comparison import coefficient_table, compare_models
from romsindy.selection.select import Selection, select_model
from romsindy.show.identification_page import Identification, pictures, write_identification


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


def _harmonics(_: click.Context, __: click.Parameter, value: str) -> tuple[int, ...]:
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
@click.option("--seed", default=0, show_default=True, help="Seed of the example's noise (35 dB).")
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
    "--order", default=5, show_default=True, help="Highest order of stiffness and inertia."
)
@click.option(
    "--damping",
    multiple=True,
    default=("linear",),
    show_default=True,
    type=click.Choice(list(DAMPING)),
    help="Kind of damping; may be repeated.",
)
@click.option(
    "--fix",
    multiple=True,
    callback=_coefficients,
    metavar="NAME=VALUE",
    help="Known coefficient in SI units; may be repeated. The models with fixed linear"
    " frequency take omega^2 from here, or else from the measured backbone.",
)
@click.option(
    "--harmonics",
    default="0-3",
    show_default=True,
    callback=_harmonics,
    help="Harmonics of each cycle.",
)
@click.option("--amplitude", nargs=2, type=float, help="Least and largest amplitude to learn from.")
@click.option(
    "--cutoff",
    type=float,
    help="Cut-off of the low-pass filter, Hz.  [default: ten times the fundamental]",
)
@click.option(
    "--refine/--no-refine",
    "refined",
    default=True,
    help="Refine every model by simulation, with error bars and a verdict.  [default: refine]",
)
@click.option(
    "--select",
    is_flag=True,
    help="Let the data choose the terms: orders 3 to 13, dampings, subsets. Takes about 20 s.",
)
@click.option("--report", type=click.Path(path_type=Path), help="Name of the HTML report.")
@click.option(
    "--model", type=click.Path(path_type=Path), help="Write the IC-ROM as JSON to this file."
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
    harmonics: tuple[int, ...],
    amplitude: tuple[float, float] | None,
    cutoff: float | None,
    refined: bool,
    select: bool,
    report: Path | None,
    model: Path | None,
    figure: Path | None,
    **reading: Any,
) -> None:
    """Identify an equation of motion from the free decay in FILE.

    Prints the equation, compares the IC-ROM with a stiffness polynomial, and writes one HTML page.
    """
    if example == (file is not None):
        raise click.UsageError("name one FILE, or ask for --example")
    if file is not None:
        record = load_decay(file, **reading)
        title, report = f"Free decay {file.name}", report or Path(f"{file.stem}_report.html")
    else:
        record = example_decay(35.0, seed)
        title, report = "Example: synthetic decay, 35 dB", report or Path("example_report.html")
    projection = HarmonicProjection(harmonics, amplitude=amplitude or None)
    method = Butterworth(cutoff)
    result = _identified(title, record, order, damping, fix, projection, method, refined)
    best = result.named("IC-ROM")
    icrom = best.model
    click.echo(f"\n{result.decay!r}\n{result.backbone!r}\n\n{best.fit or icrom}\n")
    click.echo(_aligned(coefficient_table(result.candidates)))
    click.echo(f"\n{result.verdict()}\n{result.table_note()}")
    if select:
        selection = _selected(result, fix, projection)
        result, icrom = replace(result, selection=selection), selection.model
        click.echo(f"\n{selection}")
    write_identification(result, report, lambda steps: _bar(steps, "drawing"))
    click.echo(f"Report: {report}")
    if model is not None:
        model.write_text(icrom.to_json() + "\n", encoding="utf-8")
        click.echo(f"Model: {model}")
    if figure is not None:
        next(p for p in pictures(result) if p.name == "backbone").write(figure)
        click.echo(f"Figure: {figure}")


def _identified(
    title: str,
    record: Decay,
    order: int,
    damping: tuple[str, ...],
    fixed: dict[str, float],
    projection: HarmonicProjection,
    method: Butterworth,
    refined: bool,
) -> Identification:
    free = record.single().free()
    backbone = extract_backbone(free)
    decay = free.conditioned(method)
    measured = _within(free, backbone, projection.amplitude) if refined else None
    fits = compare_models(decay, backbone, order, damping, fixed, projection, measured)
    candidates = list(_bar(fits, "identifying", 4))
    return Identification(title, record, decay, backbone, candidates)


def _selected(
    result: Identification, fixed: dict[str, float], projection: HarmonicProjection
) -> Selection:
    measured = _within(result.record.single().free(), result.backbone, projection.amplitude)
    with _bar(None, "choosing terms") as bar:
        return select_model(measured, fixed=fixed or None, progress=bar.set_postfix_str)


def _within(decay: Decay, backbone: Backbone, amplitude: tuple[float, float] | None) -> Decay:
    """The cycles of a decay with these amplitudes."""
    if amplitude is None:
        return decay
    inside = (backbone.amplitude >= amplitude[0]) & (backbone.amplitude <= amplitude[1])
    if not np.any(inside):
        low, high = backbone.amplitude.min(), backbone.amplitude.max()
        raise ValueError(
            f"amplitude = {amplitude} holds no cycle: those of the decay have amplitudes from"
            f" {low:.3g} to {high:.3g} {decay.unit or '[q]'}"
        )
    return decay.between(float(backbone.t[inside][0]), float(backbone.t[inside][-1]))


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
