"""Measured decays of a file for a diagnosis: with all that is in them, unless a mode is chosen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from romsindy.commands.options import read
from romsindy.inspection.inspection import Inspection, inspect
from romsindy.inspection.tables import picked
from romsindy.record.decay import Decay
from romsindy.record.files import load_decay
from romsindy.record.files.load import named
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
        return [load_decay(file, **{**reading, "column": list(reading["column"]) or None})]
    recording = read(file, reading)
    with named(f"{file}"):
        together = choice.isolates or choice.coordinates > 1
        if len(recording.names) > 1 and not (reading["column"] and together):
            raise ValueError(
                f"{len(recording.names)} columns could be the measured one,"
                f" {list(recording.names)}: choose with column="
            )
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
