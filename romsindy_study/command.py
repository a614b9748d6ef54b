"""Run the study of the method's paper on the default beam."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click
from joblib import parallel_config

from romsindy.commands.options import interactive_option
from romsindy.commands.outputs import WritingCommand, claim_folder, told, writing
from romsindy.text import bar, on_terminal
from romsindy_study.content import Check
from romsindy_study.pages import Written, checks_table, write_chapter, write_story
from romsindy_study.story import tell

QUICK: dict[str, Any] = {"elements": 20, "duration": 20.0, "orbits": 3, "both_releases": False}
_QUICK_SEEDS, _SEEDS = 10, 100


@click.command(cls=WritingCommand)
@click.option(
    "--out",
    default="study",
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for report.html, tables (CSV) and figures (PNG, SVG).",
)
@click.option("--quick", is_flag=True, help="Coarser beam, shorter decay, ten seeds.")
@click.option(
    "--seeds", type=click.IntRange(2), help="Noisy experiments.  [default: 100, quick 10]"
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="First seed.")
@interactive_option
@click.option("--jobs", type=int, help="Processes.  [default: all processors, quick: 1]")
def study(
    out: Path, quick: bool, seeds: int | None, seed: int, interactive: bool, jobs: int | None
) -> None:
    """Run the study of the method's paper on the default beam.

    Simulates the decay, identifies stiffness polynomials, beam theory and IC-ROM, repeats the noisy
    experiment over seeds, and writes the report. An interruption (Ctrl-C) writes the report of what
    is finished.
    """
    started = time.perf_counter()
    claim_folder(out, "report.html")
    out.mkdir(parents=True, exist_ok=True)
    size = QUICK if quick else {}
    seeds = seeds or (_QUICK_SEEDS if quick else _SEEDS)
    jobs = jobs or (1 if quick else -1)  # starting processes takes longer than ten seeds
    settings = f"romsindy study --seed {seed} --seeds {seeds}{' --quick' * quick}"
    written: list[Written] = []
    checks: list[Check] = []
    ending = "stopped early: chapters are missing"
    try:
        with parallel_config(n_jobs=jobs):
            for chapter in tell(bar, seeds=seeds, seed=seed, **size):
                written.append(write_chapter(chapter, out, interactive))
                checks += chapter.checks
                _say(chapter.title, started)
        ending = f"{time.perf_counter() - started:.0f} s"
    finally:  # what is finished is not lost
        page = out / "report.html"
        with writing(page):
            write_story(written, checks, out, f"{settings}; {ending}", interactive)
        _print(checks)
        click.echo(told("Report", page))


def _print(checks: list[Check]) -> None:
    if not checks:
        return
    click.echo("What the method is expected to reach on this beam, and what it reached:")
    for what, measured, unit, expected, verdict in checks_table(checks).formatted():
        click.echo(f"{verdict:<5} {what}: {measured} {unit}, expected {expected}")
    failed = sum(not c.passed for c in checks)
    unexpected = f"; FAIL marks the other {failed}, the run itself is complete" * bool(failed)
    click.echo(f"{len(checks) - failed} of {len(checks)} numbers are as expected{unexpected}.")


def _say(title: str, started: float) -> None:
    if on_terminal():
        click.echo(f"{time.perf_counter() - started:5.0f} s  {title}", err=True)
