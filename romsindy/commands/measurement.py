"""What of a file is meant: decays with all that is in them, or one mode by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import click

from romsindy.commands.options import grouped
from romsindy.commands.results import Result
from romsindy.inspection.inspection import Inspection, inspect
from romsindy.inspection.page import picture
from romsindy.inspection.tables import picked
from romsindy.physics.example import example_decay
from romsindy.record.decay import Decay
from romsindy.record.files import load_decay, load_recording
from romsindy.record.files.load import named
from romsindy.record.recording import Recording
from romsindy.show.identified import Identified
from romsindy.show.page import Picture
from romsindy.text import bar, listed


class Selection(NamedTuple):
    """What of a file is meant."""

    mode: int | None = None
    band: tuple[float, float] | None = None
    release: int | None = None
    whole: bool = False  # the file as it is
    coordinates: int = 1  # that ring together

    @property
    def isolates(self) -> bool:
        """Whether one mode is wanted by itself."""
        return self.mode is not None or self.band is not None


def decays_in(
    file: Path, reading: Mapping[str, Any], choice: Selection, say: Callable[[str], object]
) -> list[Decay]:
    """Decays of a file, one of every release, found as `identify` finds them.

    A filter would take away what a diagnosis is to name: hum, an offset, a second mode that is
    faint. A mode is isolated only where it is asked for; ``say`` is told what was chosen.

    Raises a ValueError if the file cannot be understood, or does not hold what was chosen.
    """
    if choice.whole:
        return [load_decay(file, **reading)]
    named_ones = choice.isolates and bool(reading["column"])
    recording = _clear(file, reading, named_ones or choice.coordinates > 1)
    with named(f"{file}"):
        with bar(None, "inspecting") as steps:
            found = inspect(recording, progress=steps.set_postfix_str)
        if choice.coordinates > 1:
            return list(found.whole_decays(choice.release, choice.coordinates))
        return _chosen(found, choice, lambda line: say(f"{file}: {line}"))


def _chosen(found: Inspection, choice: Selection, say: Callable[[str], object]) -> list[Decay]:
    try:
        mode = found.mode(choice.mode, choice.band)
    except ValueError as error:
        if choice.isolates:
            raise
        source = f"{found.recording.source}: "
        remedy = "--whole takes it as it is"
        raise ValueError(f"{str(error).removeprefix(source)}; {remedy}") from error
    releases = found.rings_in(mode, choice.release)
    if choice.isolates:
        say(picked(found, mode, releases))
        return list(found.decays(mode.number, release=choice.release))
    beside = [m for m in found.modes if m is not mode and not m.steady]
    if beside:
        modes = listed([f"mode {m.number} at {m.mean_frequency:.4g} Hz" for m in beside])
        say(
            f"beside mode {mode.number} at {mode.mean_frequency:.4g} Hz rings {modes}, which stays"
            f" in, for it may be what is missing; --mode {mode.number} takes it off."
        )
    decays = list(found.measured_decays(choice.release))
    for notes in filter(None, (d.notes for d in decays)):
        say("; ".join(notes))
    return decays


# -- one mode by itself: found, isolated, analysed, and told on a page -----------------------------


Analysis = Callable[[str, Sequence[Decay], str], Identified]

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


def inspected(
    file: Path | None, reading: Mapping[str, Any], seed: int, together: bool = False
) -> tuple[str, Inspection]:
    """Title of a file, or of the example, and what is in it, in all channels ``together``."""
    title = f"Free decay {file.name}" if file else "Example: synthetic decay, 35 dB"
    with bar(None, "inspecting") as steps:
        several = together or bool(reading["column"])
        record = _clear(file, reading, several) if file else example_decay(35.0, seed)
        return title, inspect(record, progress=steps.set_postfix_str)


def _clear(file: Path, reading: Mapping[str, Any], several: bool) -> Recording:
    """What is in a file, where it is clear which column is meant, or ``several`` may be."""
    recording = load_recording(file, **reading)
    names = list(recording.names)
    if len(names) > 1 and not several:
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


def analysed(
    file: Path | None, reading: Mapping[str, Any], choice: Selection, analyse: Analysis, seed: int
) -> tuple[Identified, list[Picture], dict[str, Any], str]:
    """Analyse one mode of a file, or of the example: report, more figures, facts, what comes next.

    Raises a ValueError if the file cannot be understood, or does not hold what was chosen; as
    ``analyse``.
    """
    title, found = inspected(file, reading, seed)
    # What is wrong with samples is no news for a choice that does not exist.
    with of_file(file, found.warnings if choice == Selection() else ()):
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
    facts = {
        "channel": found.channel,
        "mode": mode.number,
        "modes": [m.mean_frequency for m in found.modes],
        "releases": tuple(i + 1 for i in releases),
        "warnings": found.warnings,
    }
    return report, more, facts, _next(str(file or "example"), report, found)


def of_one_mode(file: Path | None, page: Path, interactive: bool, **asked: Any) -> Result:
    """Analyse one mode of a file, or of the example, as `analysed`, and write its page."""
    report, more, facts, step = analysed(file, **asked)
    return Result.written(file, page, report, interactive, more, facts=facts, step=step)


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
