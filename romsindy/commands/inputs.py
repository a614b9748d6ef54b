"""Measured inputs on the command line: the options that say what drives a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from romsindy.commands.options import given, grouped, refuse_beside
from romsindy.record.files import load_forced
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import INTERPOLATIONS, Interpolation

# Options that choose a part of a free decay, and what to do without them.
PARTS = dict.fromkeys(
    ("mode", "band", "release"), "the whole record is taken; cut it with --start and --end"
)
# The options with which the inputs of a record are read.
input_options = grouped(
    click.option(
        "--input",
        "inputs",
        multiple=True,
        type=click.Choice(["force", "base"]),
        help="The record is driven by a measured force, or by the acceleration of its base; may be"
        " repeated.",
    ),
    click.option(
        "--input-column",
        multiple=True,
        help="Name of the column of each input.  [default: as names and units of columns say]",
    ),
    click.option(
        "--unit-input",
        multiple=True,
        help='Unit of each input, or of all: "N", "kN", "lbf", "m/s^2", "g", "V", ...',
    ),
    click.option(
        "--interpolation",
        type=click.Choice(["auto", *INTERPOLATIONS]),
        default="auto",
        callback=lambda _, __, value: None if value == "auto" else value,
        show_default=True,
        help="What inputs do between their samples; auto lets the record decide.",
    ),
)
_ALONE = ("input-column", "unit-input", "interpolation")


@dataclass(frozen=True)
class Inputs:
    """What the command line says of inputs; see `romsindy identify --help`."""

    inputs: tuple[str, ...]
    input_column: tuple[str, ...]
    unit_input: tuple[str, ...]
    interpolation: Interpolation | None

    def check(self, decays: Mapping[str, str], driven: Sequence[str] = ()) -> None:
        """Refuse options for free decays alone, what to do without each, and for driven records.

        Raises a UsageError if there are such.
        """
        if self.inputs:
            refuse_beside("input", "free decays", {**PARTS, **decays})
        else:
            self.refuse_alone(driven)

    def refuse_alone(self, driven: Sequence[str] = ()) -> None:
        """Refuse options of inputs, and further ones, where there are no inputs."""
        for name in () if self.inputs else given((*_ALONE, *driven)):
            raise click.UsageError(
                f"--{name} is for records with inputs: say --input force or --input base, or leave"
                f" out --{name}"
            )

    def load(self, file: Path, reading: Mapping[str, Any]) -> ForcedVibration:
        """The record in a file.

        Raises a ValueError if the file cannot be understood, or does not hold these inputs.
        """
        counts = [self.inputs[: i + 1].count(kind) for i, kind in enumerate(self.inputs)]
        pairs = zip(self.inputs, counts, strict=True)
        names = [kind if count == 1 else f"{kind} {count}" for kind, count in pairs]
        return load_forced(
            file,
            names,
            input_column=self.input_column or None,
            input_unit=self.unit_input or None,
            interpolation=self.interpolation,
            **{**reading, "column": list(reading["column"]) or None},
        )
