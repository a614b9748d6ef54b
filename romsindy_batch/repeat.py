"""Say how well a structure repeats, from two or more runs of the same test."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click

from romsindy.commands.measurement import Selection, decays_in, mode_options
from romsindy.commands.options import FILE, READING, interactive_option, reading_options
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
from romsindy.diagnosis.arguments import of_repeats
from romsindy.diagnosis.difference import KINDS, Difference, Tolerance
from romsindy.diagnosis.words import undetermined
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import FLOOR
from romsindy.physics.term_sum import json_text
from romsindy.record.backbone import extract_backbone
from romsindy.record.decay import Decay
from romsindy.show.page import Picture, draw_backbones, write_page
from romsindy.text import TextTable, bar, listed, percent, quantity, with_error

_WORDS = {"frequency": "in frequency", "damping": "in damping ratio", "signal": "in waveform"}
_NOTHING = Tolerance(0.0, 0.0, 0.0)
_HEADINGS = {
    "Reading": READING,
    "What is compared": "--mode --band --release",
    "Output": "--save --report --interactive --overwrite",
}


class Pair(NamedTuple):
    """Two runs, by their names, and how they differ at equal amplitude."""

    one: str
    other: str
    difference: Difference


class Repeatability(NamedTuple):
    """How well runs of one test repeat."""

    pairs: Sequence[Pair]
    tolerance: Tolerance  # what does not matter, as `romsindy.diagnose` takes it
    unit: str

    @classmethod
    def of(cls, runs: dict[str, Decay]) -> Repeatability:
        """That of decays by their names.

        Raises a ValueError for fewer than two, one that is there twice, or two that share no
        amplitudes.
        """
        tolerance = of_repeats(list(runs.values()), FLOOR)
        records = {name: Record.loud(decay, FLOOR) for name, decay in runs.items()}
        pairs = itertools.combinations(records.items(), 2)
        found = [Pair(a, b, Difference.between(x, y)) for (a, x), (b, y) in pairs]
        return cls(found, tolerance, next(iter(runs.values())).unit or "[q]")

    def sentences(self) -> list[str]:
        """How well they repeat, which two do so least, what is too wide to be a tolerance."""
        within = [f"{percent(getattr(self.tolerance, k))} {_WORDS[k]}" for k in KINDS]
        low = min(p.difference.amplitude[0] for p in self.pairs)
        high = max(p.difference.amplitude[1] for p in self.pairs)
        over = f"{quantity(low, self.unit)} to {quantity(high, self.unit)}"
        found = [f"At equal amplitude the runs repeat within {listed(within)}, over {over}."]
        if len(self.pairs) > 1:
            worst = max(self.pairs, key=lambda pair: pair.difference.excess(_NOTHING))
            found.append(f"Least alike: {worst.one} and {worst.other}.")
        return [*found, *undetermined(self.tolerance)]

    def table(self) -> TextTable:
        """The differences of all pairs, in per cent."""
        rows = [["runs", "over", *(f"{_WORDS[kind].removeprefix('in ')} [%]" for kind in KINDS)]]
        for one, other, d in self.pairs:
            over = " to ".join(quantity(a, self.unit) for a in d.amplitude)
            sizes = ((100 * getattr(d, kind), 100 * getattr(d, f"{kind}_std")) for kind in KINDS)
            rows.append([f"{one}, {other}", over, *(" +- ".join(with_error(*x)) for x in sizes)])
        note = "The second less the first, as a part of the measured value; one standard error."
        return TextTable("Differences", rows, note)

    def to_json(self) -> str:
        """JSON text that ``romsindy diagnose --repeats`` takes in the place of the records."""
        kept = {k: v for k, v in vars(self.tolerance).items() if k not in ("bands", "sources")}
        each = [{"runs": (a, b), **vars(d), "parts": len(d.parts)} for a, b, d in self.pairs]
        return json_text({"tolerance": kept, "pairs": each})


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("files", nargs=-1, required=True, type=FILE, metavar="FILES...")
@reading_options
@mode_options
@click.option("--save", type=Output(JSON), help="Write the tolerance, for diagnose --repeats.")
@click.option("--report", type=Output(PAGE), help="Name of the HTML page.")
@interactive_option
def repeat(
    files: tuple[Path, ...],
    mode: int | None,
    band: tuple[float, float] | None,
    release: int | None,
    save: Path | None,
    report: Path | None,
    interactive: bool,
    **reading: Any,
) -> None:
    """Say how well a structure repeats, from two or more runs of the same test.

    Frequency, damping ratio and waveform are compared at equal amplitude, each run with each other;
    every release in a file is a run. What runs differ by does not matter to a diagnosis: --save
    writes it for romsindy diagnose --repeats.
    """
    page = report or default_page(f"{files[0].stem}_repeat.html")
    choice = Selection(mode, band, release)
    runs: dict[str, Decay] = {}
    with bar(None, "reading the records"):
        for file in files:
            found = decays_in(file, reading, choice, _note)
            names = [f"{file}, release {i}" for i in range(1, len(found) + 1)]
            runs |= zip(names if len(found) > 1 else [f"{file}"], found, strict=True)
    with bar(None, "comparing runs"):
        result = Repeatability.of(runs)
        backbones = {name: extract_backbone(decay.single().free()) for name, decay in runs.items()}
    draw = partial(draw_backbones, backbones)
    title = "Frequency and damping ratio against amplitude"
    caption = "Every dot is a cycle whose own frequency is known well enough."
    with writing(page):
        write_page(
            page,
            "report",
            "repeat",
            title=f"How well {len(runs)} runs repeat",
            sentence="\n".join(result.sentences()),
            tables=[result.table()],
            pictures=[Picture("backbones", title, caption, draw, (7.0, 4.2))],
            interactive=interactive,
        )
    lines = [*result.sentences(), told("Report", page)]
    if save is not None:
        write_json(save, result.to_json())
        lines += [told("Saved", save)]
        lines.insert(-2, f"Next: romsindy diagnose --repeats {save}, with what is to be compared.")
    else:
        lines.insert(-1, "Next: --save keeps it as the tolerance of romsindy diagnose.")
    click.echo("\n".join(lines))


def _note(line: str) -> None:
    click.echo(f"Note: {line}", err=True)
