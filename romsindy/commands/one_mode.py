"""One mode of a file by itself: found, isolated, analysed, and told on a page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np

from romsindy.commands.measurement import Choice
from romsindy.commands.options import grouped, read
from romsindy.commands.results import Result, Small
from romsindy.inspection.inspect import inspect
from romsindy.inspection.inspection import Inspection
from romsindy.inspection.modes import Mode
from romsindy.inspection.page import picture
from romsindy.inspection.tables import picked
from romsindy.physics.example import example_decay
from romsindy.record.decay import Decay
from romsindy.record.recording import Recording
from romsindy.show.identified import Identified
from romsindy.text import bar

Analysis = Callable[[str, Sequence[Decay], str], Identified]

_LOW = 0.1  # of the largest amplitude of the data: there the linear frequency is read
# The options that choose a mode, and releases.
mode_options = grouped(
    click.option(
        "--mode", type=int, help="Number of the mode, see inspect.  [default: moves most]"
    ),
    click.option(
        "--band", nargs=2, type=float, help="Lowest and highest frequency of the mode, Hz."
    ),
    click.option("--release", type=int, help="Number of the release, see inspect.  [default: all]"),
)


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


@contextmanager
def of_file(file: Path | None, warnings: Sequence[str] = ()) -> Iterator[None]:
    """What is refused is told with the name of the file, and what is wrong with its samples."""
    try:
        yield
    except ValueError as error:
        sentence = str(error).removeprefix(f"{file}: ")
        words = "; ".join([f"{file or 'example'}: {sentence}", *warnings])
        raise ValueError(words) from error


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
    # What is wrong with samples is no news for a choice that does not exist.
    with of_file(file, found.warnings if choice == Choice() else ()):
        mode = found.mode(choice.mode, choice.band)
        releases = found.rings_in(mode, choice.release)
    used = picked(found, mode, releases)
    with of_file(file, found.warnings):
        try:
            report = analyse(title, found.decays(mode.number, release=choice.release), used)
        except KeyboardInterrupt as error:
            reached = f"{error}, after the inspection. {used.rstrip('.')}"
            raise KeyboardInterrupt(reached) from None
    more = [picture(found)] if len(found.modes) > 1 or len(found.releases) > 1 else []
    return Result.written(
        file, page, report, interactive, more, **_told(report, file, found, mode, releases)
    )


def _told(
    report: Identified,
    file: Path | None,
    found: Inspection,
    mode: Mode,
    releases: Sequence[int],
) -> dict[str, Any]:
    """What the command line says of it beside the report."""
    assert report.beside is not None  # of one mode
    b, small = report.beside.backbone, _small(report, str(mode.number))
    structure = None if report.series is None else str(report.series.structure)
    per_cycle = {"amplitude": 1.0, "frequency": 2 * np.pi, "damping_ratio": 1.0}
    linear = {name: value for name, value in small._asdict().items() if name != "mode"}
    facts = {
        "channel": found.channel,
        "mode": mode.number,
        "modes": [m.mean_frequency for m in found.modes],
        "releases": tuple(i + 1 for i in releases),
        "warnings": found.warnings,
        "linear": {"amplitude": _LOW * float(b.amplitude.max()), **linear},
        "structure": structure,
        "backbone": {
            name + end: getattr(b, name + end) / unit
            for name, unit in per_cycle.items()
            for end in ("", "_std")
        },
    }
    step = _next(str(file or "example"), report, found)
    return {"small": [small], "structure": structure or "-", "facts": facts, "step": step}


def _small(report: Identified, mode: str) -> Small:
    """Frequency and damping ratio at low amplitude, with standard errors where known."""
    assert report.beside is not None
    amplitude = [_LOW * float(report.beside.backbone.amplitude.max())]
    if report.found is not None:
        return Small.of(mode, report.found.band(amplitude))
    model, nan = report.beside.main.model, float("nan")
    frequency, ratio = model.backbone(amplitude)[0], model.damping_ratio(amplitude)[0]
    return Small(mode, float(frequency) / (2 * np.pi), nan, float(ratio), nan)


def _next(file: str, report: Identified, inspection: Inspection) -> str:
    ringing = [m for m in inspection.modes if not m.steady]
    if report.found is None:
        return "the coefficients of all regressions with --full."
    if report.found.verdict.explained:
        return "--full prints the functions; romsindy diagnose asks what a simulation lacks."
    if len(ringing) > 1:
        return (
            f"{len(ringing)} modes ring: --coordinates auto models them together; --full prints"
            " all tables."
        )
    return f"romsindy inspect {file} shows what else is in it; --full prints all tables."
