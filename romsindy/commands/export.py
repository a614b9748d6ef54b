"""The command ``romsindy export``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from romsindy.commands.options import estimate_of, model_of, text_of
from romsindy.commands.outputs import Output, WritingCommand, keep_inputs, write_text
from romsindy.effects import CATALOGUE, ReadingEffect
from romsindy.fit.functions.identification import Identification
from romsindy.physics.equations import Equations
from romsindy.physics.export import python_script
from romsindy.physics.model import ReducedModel
from romsindy.physics.term_sum import read_json
from romsindy.physics.validation import several, table
from romsindy.physics.validation import text as entry
from romsindy.record.files.load import named
from romsindy.simulator.force import LawForce
from romsindy.structure.corrected import Correction, corrected_deck
from romsindy.structure.deck import Deck
from romsindy.structure.deck_file import DeckFile, sensor_of
from romsindy.structure.parts import PartValue
from romsindy.text import listed

_STDOUT = Path("-")
_MARK = "romsindy export"
_COMMENT = {"matlab": "%", "c": "//", "sympy": "#", "text": "#"}


@click.command(cls=WritingCommand)
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--to",
    "language",
    type=click.Choice(["matlab", "c", "sympy", "text", "deck"]),
    required=True,
    help="A function for ode45, a C99 function, Python with sympy, the equation to be read, or with"
    " --deck a corrected deck of CalculiX.",
)
@click.option(
    "--deck",
    "deck_file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="The deck (TOML) that was diagnosed; FILE is what diagnose --json wrote.",
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
def export(
    file: Path,
    language: str,
    deck_file: Path | None,
    output: Path,
    short: bool,
    name: str | None,
) -> None:
    """Write the equation of motion in FILE for MATLAB, C or sympy, or as text.

    FILE is a model (JSON) as identify --model or --save, Fit.save or diagnose --json writes it.

    Measured inputs become arguments: functions of time in MATLAB and sympy, values in C.
    """
    text = text_of(file)
    if (language == "deck") != (deck_file is not None):
        raise click.UsageError("--to deck and --deck, the deck that was diagnosed, go together")
    if deck_file is not None:
        given = DeckFile.load(deck_file)
        keep_inputs(given.inputs)
        with named(f"{file}"):
            corrected = _deck(text, file, given)
        write_text(output, f"{corrected}** {_MARK}")
        return
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


def _deck(text: str, file: Path, given: DeckFile) -> str:
    """The deck with what a diagnosis of it found.

    Raises a ValueError if the text holds no diagnosis of a deck, or one that added nothing.
    """
    content = table("the JSON text", read_json(text))
    if not {"force_laws", "values", "verdict", "effects"} <= {*content}:
        raise ValueError("this is no diagnosis of a deck: give what diagnose --deck --json wrote")
    laws, values = content["force_laws"], table("values", content["values"])
    force = None if laws is None else LawForce.of_content("force_laws", laws)
    changed = {n: float(v) for n, v in values.items() if v != given.parameters.get(n, (v,))[0]}
    mass, place = float(content.get("mass", 0.0)), content.get("place")
    if force is None and not changed and not mass:
        raise ValueError(f"nothing was added to the deck: the verdict is {content['verdict']!r}")
    remarks = [f"found by a diagnosis, {file}: {content['verdict']}"]
    said = content.get("sentence", "").splitlines()
    remarks += [line for line in said if line.startswith(("Missing: ", "Place: "))]
    remarks += [f"{n} = {v:.6g}" for n, v in changed.items()]
    if force is not None:
        remarks.append(f"force on the node, N, of x (m) and v (m/s): {force}")
        if force(0.0, 0.0, 1e-3):
            remarks.append("its part that damps has no element in *DYNAMIC: it is not in this deck")
    deck, (node, direction) = Deck.load(given.file), given.point or given.sensors[0]
    if place is not None:
        node, direction = sensor_of("place", table("place", place)["point"])
    if mass:
        remarks.append(f"mass at the node: {mass:.6g} kg")
    holds = force is not None and any(force(0.0, x, 0.0) for x in (-1e-3, 1e-3))
    found = Correction(
        node=deck.node(node),
        direction=direction,
        spring=(lambda x: force(0.0, x, 0.0)) if holds and force is not None else None,
        reach=1.0 if force is None else force.reach[0],
        mass=mass,
        modulus=changed.get("modulus", 1.0),
        density=changed.get("density", 1.0),
        parts={n: v for n, v in changed.items() if PartValue.of_name(n)},
        remarks=remarks,
    )
    return corrected_deck(deck, found, given.units)


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
