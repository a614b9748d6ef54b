"""The command ``romsindy inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from romsindy.commands.options import (
    FILE,
    command_line,
    full_option,
    interactive_option,
    reading_options,
)
from romsindy.commands.outputs import (
    JSON,
    PAGE,
    Output,
    WritingCommand,
    default_page,
    told,
    write_json,
    writing,
)
from romsindy.inspection import tables
from romsindy.inspection.inspection import inspect as look
from romsindy.record.files import load_recording
from romsindy.text import bar


@click.command(cls=WritingCommand)
@click.argument("file", type=FILE)
@reading_options
@click.option("--report", type=Output(PAGE), help="Name of the HTML page.")
@interactive_option
@full_option
@click.option(
    "--json",
    "json_file",
    type=Output(JSON, allow_dash=True),
    help="Write the numbers to this file; - prints them and nothing else.",
)
def inspect(
    file: Path,
    report: Path | None,
    interactive: bool,
    full: bool,
    json_file: Path | None,
    **reading: Any,
) -> None:
    """Say what is in the record in FILE, what would be used, and what comes next.

    What was found, how sure that is, what is wrong with it and what comes next; the page has all
    tables and figures.
    """
    alone = str(json_file) == "-"
    if report is None and not alone:
        report = default_page(f"{file.stem}_inspection.html")
    with bar(None, "inspecting") as progress:
        found = look(load_recording(file, **reading), progress=progress.set_postfix_str)
    command = command_line(file, reading)
    # Files come first: who reads a pipe may stop.
    if report is not None:
        with writing(report):
            found.to_html(report, command, interactive=interactive)
    if json_file is not None:
        write_json(json_file, found.to_json())
    if not alone:
        click.echo(tables.report(found, command) if full else found.short(command))
    if report is not None:
        click.echo(told("Report", report), err=alone)
