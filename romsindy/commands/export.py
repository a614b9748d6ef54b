"""The command ``romsindy export``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from romsindy.commands.options import estimate_of, model_of, text_of
from romsindy.commands.outputs import Output, WritingCommand, write_text
from romsindy.effects import CATALOGUE, ReadingEffect
from romsindy.fit.functions.identification import Identification
from romsindy.physics.equations import Equations
from romsindy.physics.export import python_script
from romsindy.physics.model import ReducedModel
from romsindy.physics.term_sum import read_json
from romsindy.physics.validation import several, table
from romsindy.physics.validation import text as entry
from romsindy.record.files.load import named
from romsindy.text import listed

_STDOUT = Path("-")
_MARK = "romsindy export"
_COMMENT = {"matlab": "%", "c": "//", "sympy": "#", "text": "#"}


@click.command(cls=WritingCommand)
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--to",
    "language",
    type=click.Choice(["matlab", "c", "sympy", "text"]),
    required=True,
    help="A function for ode45, a C99 function, Python with sympy, or the equation to be read.",
)
@click.option(
    "--output",
    "-o",
    type=Output(_MARK, allow_dash=True),
    default=_STDOUT,
    help="File to write.  [default: print it]",
)
@click.option(
    "--short", is_flag=True, help="The few terms that identify shows, of what it wrote by --save."
)
@click.option("--name", help="Name of the function.  [default: that of the output, or rhs]")
def export(file: Path, language: str, output: Path, short: bool, name: str | None) -> None:
    """Write the equation of motion in FILE for MATLAB, C or sympy, or as text.

    FILE is a model (JSON) as identify --model or --save, Fit.save or diagnose --json writes it.

    Measured inputs become arguments: functions of time in MATLAB and sympy, values in C.
    """
    text = text_of(file)
    with named(f"{file}"):
        model = _short(text) if short else _model(text)
    name = name or ("rhs" if output == _STDOUT else output.stem)
    with named(f"{file}"):
        code = _code(model, language, name)
    mark = "" if output == _STDOUT else f"\n{_COMMENT[language]} {_MARK}"
    write_text(output, code + mark)


def _code(model: Equations, language: str, name: str) -> str:
    if language == "text":
        return str(model)
    if language == "sympy":
        pairs = list(zip(model.terms, model.values, strict=True))
        return python_script(pairs, str(model), model.coordinates)
    return model.to_matlab(name) if language == "matlab" else model.to_c(name)


def _model(text: str) -> Equations:
    """The model of a file, also of a diagnosis.

    Raises a ValueError if the text holds no model, or a diagnosis whose model lacks what it found.
    """
    content = read_json(text)
    if not (isinstance(content, dict) and {"model", "effects"} <= {*content}):
        return model_of(text)
    outside = _outside(content["effects"])
    if outside:
        raise ValueError(
            f"this diagnosis found {listed(outside)}, which depends on more than q and q_dot and is"
            " no term of the equation of motion; to export the equation without it, put the entry"
            ' "model" into a file of its own'
        )
    return model_of(json.dumps(content["model"]))


def _short(text: str) -> ReducedModel:
    """The few terms that follow what was identified.

    Raises a ValueError if the text holds no identification, or no few terms follow.
    """
    found = estimate_of(text)
    if not isinstance(found, Identification):
        raise ValueError(
            "--short is of what identify --save wrote: leave it out for any other file"
        )
    if not found.short.follows:
        raise ValueError(f"{found.off()}: leave out --short, and all terms are written")
    return found.short.model


def _outside(effects: Any) -> list[str]:
    """Labels of effects on the motion that are no terms: those with a memory, or of time."""
    beyond = {e.name for e in CATALOGUE if e.term() is None and not isinstance(e, ReadingEffect)}
    found = several(_named)("effects", effects)
    return [label for name, label in found if name in beyond]


def _named(name: str, value: Any) -> tuple[str, str]:
    """Name and label of an effect."""
    effect = table(name, value, ("name", "label"))
    return (entry(f"{name}.name", effect["name"]), entry(f"{name}.label", effect["label"]))
