"""What `romsindy identify` prints and writes when it is done."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import click

from romsindy.commands.coupled import CoupledResult
from romsindy.commands.forced import ForcedResult
from romsindy.commands.outputs import told, write_json, writing
from romsindy.commands.results import HEADER, Refusal, Result
from romsindy.show.overview import write_overview
from romsindy.text import aligned, at_most

AnyResult = Result | CoupledResult | ForcedResult


_LINES = 20  # that are read at once; the tables are on the page


def tell_one(
    result: AnyResult,
    say: Callable,
    model: Path | None,
    save: Path | None,
    figure: Path | None,
    full: bool = False,
) -> None:
    """Print a result, in short or in ``full``, and write what was asked for beside its page."""
    written = [told("Report", result.page)]
    # Files come first: who reads a pipe may stop.
    if model is not None:
        write_json(model, result.model.to_json())
        written.append(told("Model", model))
    if save is not None and result.found is not None:
        write_json(save, result.found.to_json())
        written.append(told("Saved", save))
    if figure is not None:
        with writing(figure):
            next(p for p in result.pictures() if p.name == "backbone").write(figure)
        written.append(told("Figure", figure))
    answer = [str(result)] if full else in_brief(result, _LINES - len(written))
    say("\n".join([*answer, *written]))
    if save is not None and result.found is None:
        raise click.ClickException(result.report.trouble)


def in_brief(result: AnyResult, room: int) -> list[str]:
    """What was found and how sure, what is wrong with it, what next: so many lines at most."""
    found, doubts, step = result.brief()
    more = "with --full, and on the page."
    return [*at_most([*found, *doubts], room - 1, more), f"Next: {step}"]


def tell_all(
    results: Sequence[AnyResult | Refusal], overview: Path, interactive: bool, say: Callable
) -> None:
    """Print the table, and write the page of all files."""
    done = [r for r in results if not isinstance(r, Refusal)]
    refused = [r.sentence for r in results if isinstance(r, Refusal)]
    explained = sum(r.explained for r in done)
    sentence = f"Identified: {len(done)} files, {explained} of them explained to the noise."
    rows = [HEADER, *(row for r in results for row in r.rows())]
    backbones = {r.file: r.report.backbone for r in done if isinstance(r, Result)}
    with writing(overview):
        write_overview(overview, sentence, rows, backbones, refused, interactive=interactive)
    say("\n".join([aligned(rows), "", *refused, sentence, told("Overview", overview)]))
