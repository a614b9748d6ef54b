"""The page of an inspection."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from romsindy.inspection import tables
from romsindy.inspection.findings import Findings
from romsindy.show import inspection_plots as show
from romsindy.show.inspection_plots import Tone
from romsindy.show.page import Picture, write_page
from romsindy.text import TextTable, as_options

_CAPTION = (
    "Top: the samples; what is used is blue, what is left out grey. Middle: level against time and"
    " frequency, with the ridges of the modes (harmonics dotted). Bottom: spectrum of release {},"
    " with the numbers of the modes; pale: as it was recorded."
)
_NO_RELEASE = (
    "Top: the samples. Middle: level against time and frequency. Bottom: spectrum; pale: as it was"
    " recorded."
)


def write(
    found: Findings, path: str | Path, command: str = "", *, interactive: bool = False
) -> None:
    """Write one self-contained page with figures."""
    steps = tables.next_steps(found, command)
    say = as_options if command else str
    in_words = [
        TextTable(t.title, [[say(cell) for cell in row] for row in t.rows], say(t.note))
        for t in tables.tables(found)
    ]
    write_page(
        path,
        "report",
        "inspect",
        title=f"What is in {found.recording.source or 'the record'}",
        sentence=say(tables.summary(found)),
        equation_title="What comes next",
        equation="\n".join(steps),
        tables=in_words,
        pictures=[picture(found)],
        interactive=interactive,
    )


def picture(found: Findings) -> Picture:
    """Time signal, spectrogram and spectrum, one above the other."""
    caption = _CAPTION.format(_loudest(found) + 1) if found.releases else _NO_RELEASE
    recording, cleaned = (r.channel(found.channel) for r in (found.recording, found.cleaned))
    parts = (recording, cleaned, found.releases, found.discarded, _tones(found))
    spectrum_of = found.releases[_loudest(found)] if found.releases else None
    draw = partial(show.draw_record, *parts, spectrum_of)
    return Picture("record", "The record", caption, draw, (10, 11))


def _tones(found: Findings) -> list[Tone]:
    return [
        Tone(mode.number, found.releases[i].start, vibration)
        for mode in found.modes
        for i, vibration in enumerate(mode.parts)
        if vibration is not None
    ]


def _loudest(found: Findings) -> int:
    """Number, from 0, of the release with the largest deflection."""
    return max(range(len(found.releases)), key=lambda i: found.releases[i].peak)
