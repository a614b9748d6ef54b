"""One mode of a file by itself: found, isolated, analysed, and told on a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from romsindy.commands.measurement import Choice
from romsindy.commands.options import read
from romsindy.commands.outputs import writing
from romsindy.commands.results import Result
from romsindy.inspection.inspect import inspect
from romsindy.inspection.inspection import Inspection
from romsindy.inspection.page import picture
from romsindy.inspection.tables import picked
from romsindy.physics.example import example_decay
from romsindy.record.decay import Decay
from romsindy.record.recording import Recording
from romsindy.show.identification_page import (
    IdentificationReport,
    pictures,
    write_identification,
)
from romsindy.text import bar

Analysis = Callable[[str, Sequence[Decay], str], IdentificationReport]

_OPTIONS = (
    click.option(
        "--mode", type=int, help="Number of the mode, see inspect.  [default: moves most]"
    ),
    click.option(
        "--band", nargs=2, type=float, help="Lowest and highest frequency of the mode, Hz."
    ),
    click.option("--release", type=int, help="Number of the release, see inspect.  [default: all]"),
)


def mode_options(command: Callable) -> Callable:
    """The options that choose a mode, and releases."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def inspected(file: Path | None, reading: Mapping[str, Any], seed: int) -> tuple[str, Inspection]:
    """Title of a file, or of the example, and what is in it."""
    title = f"Free decay {file.name}" if file else "Example: synthetic decay, 35 dB"
    with bar(None, "inspecting") as steps:
        record = _clear(file, reading) if file else example_decay(35.0, seed)
        return title, inspect(record, progress=steps.set_postfix_str)


def _clear(file: Path, reading: Mapping[str, Any]) -> Recording:
    """What is in a file, where it is clear which column is meant."""
    recording = read(file, reading)
    names = list(recording.names)
    if len(names) > 1 and not reading["column"]:
        raise ValueError(
            f"{file}: {len(names)} columns could be the measured one, {names}: choose with column="
        )
    return recording


def of_file(file: Path | None, error: ValueError, warnings: Sequence[str]) -> ValueError:
    """The same error with the name of the file, and what is wrong with its samples."""
    sentence = str(error).removeprefix(f"{file}: ")
    return ValueError("; ".join([f"{file or 'example'}: {sentence}", *warnings]))


def of_one_mode(
    file: Path | None,
    page: Path,
    reading: Mapping[str, Any],
    choice: Choice,
    analyse: Analysis,
    seed: int,
    interactive: bool,
) -> Result:
    """Analyse one mode of a file, or of the example, and write its page.

    Raises
    ------
    ValueError
        If the file cannot be understood, or does not hold what was chosen; as ``analyse``.
    """
    title, found = inspected(file, reading, seed)
    try:
        mode = found.mode(choice.mode, choice.band)
        releases = found.rings_in(mode, choice.release)
    except ValueError as error:
        # What is wrong with samples is no news for a choice that does not exist.
        raise of_file(file, error, found.warnings if choice == Choice() else ()) from error
    used = picked(found, mode, releases)
    try:
        report = analyse(title, found.decays(mode.number, release=choice.release), used)
    except ValueError as error:
        raise of_file(file, error, found.warnings) from error
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(f"{error}, after the inspection. {used.rstrip('.')}") from None
    figures = pictures(report)
    if len(found.modes) > 1 or len(found.releases) > 1:
        figures.append(picture(found))
    command = str(click.get_current_context().info_name)
    with writing(page):
        write_identification(
            report, page, bar(figures, "drawing"), interactive=interactive, command=command
        )
    numbers = tuple(i + 1 for i in releases)
    return Result(str(file or "example"), report, found, mode, numbers, page)
