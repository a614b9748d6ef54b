"""Measured decays of a file for a diagnosis: as they are, unless more than one motion is in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from romsindy.inspection.inspect import inspect
from romsindy.inspection.tables import picked
from romsindy.record.decay import Decay
from romsindy.record.files import load_decay
from romsindy.record.files.load import named


class Choice(NamedTuple):
    """What of a file is meant."""

    mode: int | None
    band: tuple[float, float] | None
    release: int | None
    whole: bool  # the file as it is


def decays_in(
    file: Path, reading: Mapping[str, Any], choice: Choice, say: Callable[[str], object]
) -> list[Decay]:
    """Decays of a file, one of every release.

    A filter would take away what a diagnosis is to name: hum, an offset, a second mode that is
    faint. A mode is isolated only where it is asked for, or where several ring; ``say`` is told.

    Raises
    ------
    ValueError
        If the file cannot be understood, or does not hold what was chosen.
    """
    decay = load_decay(file, **{**reading, "column": list(reading["column"]) or None})
    if choice.whole:
        return [decay]
    with named(f"{file}"):
        return _inspected(decay, choice, lambda line: say(f"{file}: {line}"))


def _inspected(decay: Decay, choice: Choice, say: Callable[[str], object]) -> list[Decay]:
    found = inspect(decay)
    ringing = [m for m in found.modes if not m.steady]
    if choice.mode is None and choice.band is None and len(ringing) < 2:
        n = len(found.releases)
        chosen = [i for i in range(max(n, 1)) if choice.release in (None, i + 1)]
        if not chosen:
            raise ValueError(f"release={choice.release} is none of 1 to {max(n, 1)}")
        if n < 2:
            return [decay]
        say(f"{n} releases; --release chooses one, --whole none.")
        return [decay.between(found.releases[i].start, found.releases[i].end) for i in chosen]
    mode = found.mode(choice.mode, choice.band)
    say(picked(found, mode, found.rings_in(mode, choice.release)))
    return list(found.decays(mode.number, release=choice.release))
