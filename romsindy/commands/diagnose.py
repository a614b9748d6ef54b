"""The command ``romsindy diagnose``."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from romsindy.beam.beam import load_beam
from romsindy.commands.main import INTERRUPTED
from romsindy.commands.measurement import Selection, decays_in
from romsindy.commands.options import (
    INPUTS,
    READING,
    Inputs,
    estimate_of,
    full_option,
    input_options,
    interactive_option,
    jobs_option,
    model_of,
    reading_options,
    text_of,
)
from romsindy.commands.outputs import (
    JSON,
    PAGE,
    Output,
    WritingCommand,
    default_page,
    keep_inputs,
    told,
    write_json,
    writing,
)
from romsindy.diagnosis.diagnose import diagnose as run_diagnosis
from romsindy.diagnosis.difference import DEFAULT, KINDS, Tolerance
from romsindy.diagnosis.structure_report import StructureReport
from romsindy.fit.results.estimate import Estimate
from romsindy.fit.verdict import SAME_DAMPING, SAME_FREQUENCY, SAME_SIGNAL
from romsindy.physics.equations import Equations, inputs_of
from romsindy.physics.term_sum import read_json
from romsindy.physics.validation import table
from romsindy.record.decay import Decay
from romsindy.record.files.load import named
from romsindy.simulator import Program
from romsindy.structure.deck_file import DeckFile
from romsindy.structure.simulator import StructureSimulator
from romsindy.text import aligned, bar

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
_TABLE = "explanation,variant,value,"  # how a CSV begins
# What a script is told with --exit-code; a refusal is 2, an interruption 130.
_CODES = {"none": 0, "named": 10, "ambiguous": 11, "unknown": 12}
# Arguments of Python at the start of a message, and the options that stand for them.
_OPTIONS = {
    "n_jobs": "jobs",
    "held_out": "held-out",
    "parameters": "parameter",
    "time_limit": "time-limit",
}
_ARGUMENTS = (
    "free|parameters|time_limit|simulator|tolerances|tolerance|floor|repeats|reference|n_jobs"
    "|held_out|budget"
)
_ARGUMENT = re.compile(rf"^(?:the )?({_ARGUMENTS})(?: ==?)?(?= )")
# Options that are for free decays, and what to do without them.
_DECAYS = {
    "simulated": "a series has no input: give the equation, --model",
    "simulator": "a simulator is asked for decays: give the equation, --model",
    "deck": "reduce it to an equation: romsindy reduce, and give that, --model",
    "beam": "in Python, beam.reduce(...) makes a model: give that, --model",
    "whole": "the whole record is taken",
    "reference": "what repeats of the test differ by, --repeats, is asked instead",
}


def _sizes(_: click.Context, option: click.Parameter, values: tuple[str, ...]) -> dict[str, float]:
    sizes = {}
    alone = "frequency" if option.name == "tolerance" else ""  # what a size without a name is of
    for value in values:
        name, _sep, number = value.rpartition("=")
        try:
            size = float(number)
        except ValueError:
            size = -1.0
        name = name.strip() or alone
        if not (name and size >= 0):
            raise click.BadParameter(
                f"{value!r} is not NAME=SIZE with a relative size, such as"
                f" {'damping' if alone else 'gamma_3'}=0.05"
            )
        if alone and name not in KINDS:
            raise click.BadParameter(f"{name!r} in {value!r} is none of {', '.join(KINDS)}")
        sizes[name] = size
    return sizes


def _values(_: click.Context, option: click.Parameter, given: tuple[str, ...]) -> dict[str, Any]:
    """Values of a simulator, NAME=VALUE or NAME=VALUE:TOLERANCE."""
    values: dict[str, Any] = {}
    for text in given:
        name, _sep, numbers = text.partition("=")
        value, within, tolerance = numbers.partition(":")
        try:
            values[name.strip()] = (float(value), float(tolerance)) if within else float(value)
        except ValueError:
            raise click.BadParameter(
                f"{text!r} is not NAME=VALUE, or NAME=VALUE:TOLERANCE with a relative tolerance,"
                " such as k=1000:0.05"
            ) from None
    return values


_HEADINGS = {
    "What is compared": "--measured --simulated --simulated-column --model --beam --deck"
    " --held-out",
    "Your own simulator": "--simulator --parameter --runs --time-limit",
    "Reading": f"{READING} --mode --band --release --whole",
    "Measured inputs": INPUTS,
    "What does not matter": "--tolerance --repeats --reference --floor",
    "What the simulation is unsure of": "--free --tolerances",
    "Output": "--budget --full --exit-code --report --interactive --json --csv --overwrite",
}


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.option(
    "--measured",
    "measured",
    multiple=True,
    required=True,
    type=_FILE,
    help="Decay, or with --input a vibration that it drives; repeatable.",
)
@click.option("--simulated", type=_FILE, help="The simulation as a decay in a file.")
@click.option(
    "--simulated-column",
    metavar="NAME",
    help="Its column there; without --simulated one of the first measured file.",
)
@click.option(
    "--model",
    "model_file",
    type=_FILE,
    help="The simulation as a model (JSON), as identify --model or --save writes it.",
)
@click.option("--beam", "beam_file", type=_FILE, help="The simulation as a beam (TOML).")
@click.option(
    "--deck",
    "deck_file",
    type=_FILE,
    help="The simulation as a deck of CalculiX, with its sensors and tolerances (TOML).",
)
@click.option(
    "--simulator",
    metavar="COMMAND",
    help="The simulation as a program, run once for every release, such as 'octave-cli model.m"
    " {release} {out}'; also {duration}, {step}, {times}, {force.m}, and names of parameters.",
)
@click.option(
    "--parameter",
    "parameters",
    multiple=True,
    callback=_values,
    metavar="NAME=VALUE[:TOLERANCE]",
    help="A value that the program takes as {NAME}, with its relative standard deviation;"
    " without one it is looked for like an effect; repeatable.",
)
@click.option(
    "--runs",
    default="simulations",
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder in which runs of the program are kept.",
)
@click.option("--time-limit", default=600.0, show_default=True, help="Of one run, s.")
@click.option("--held-out", type=_FILE, help="Record to judge by, which takes no part otherwise.")
@reading_options
@input_options
@click.option("--mode", type=int, help="Isolate this mode, by its number, see inspect.")
@click.option("--band", nargs=2, type=float, help="Isolate the mode in these limits, Hz.")
@click.option("--release", type=int, help="Number of the release, see inspect.  [default: all]")
@click.option(
    "--whole", is_flag=True, help="Take files as they are, whatever rings in them: one decay each."
)
@click.option(
    "--tolerance",
    multiple=True,
    callback=_sizes,
    metavar="[NAME=]SIZE",
    help="Relative difference that does not matter, of frequency, damping or signal; repeatable."
    f"  [default: frequency={SAME_FREQUENCY:g}, damping={SAME_DAMPING:g}, signal={SAME_SIGNAL:g} or"
    " --floor]",
)
@click.option(
    "--repeats",
    multiple=True,
    type=_FILE,
    help="The same test measured again, two files or more, or what romsindy repeat saved of them:"
    " their spread does not matter.",
)
@click.option(
    "--reference",
    multiple=True,
    type=_FILE,
    help="Decay that the model was identified from: what it leaves there does not matter.",
)
@click.option(
    "--free",
    multiple=True,
    type=click.Choice(["omega^2", "c_linear", "nothing"]),
    help="What the simulation is unsure of; repeatable."
    " [default: omega^2 and c_linear of a model, nothing of a beam]",
)
@click.option(
    "--tolerances",
    multiple=True,
    callback=_sizes,
    metavar="NAME=SIZE",
    help="Relative standard deviation of a coefficient of the model, or of a parameter of the beam;"
    " repeatable.",
)
@click.option("--floor", type=float, help="Disagreement that does not matter, per amplitude.")
@click.option(
    "--exit-code",
    is_flag=True,
    help="End with 0 for none, 10 named, 11 ambiguous, 12 unknown; without it with 0 for all.",
)
@full_option
@jobs_option
@click.option("--budget", type=float, help="For how long candidates are tried, s.")
@click.option("--report", type=Output(PAGE), help="Name of the HTML report.")
@interactive_option
@click.option("--json", "json_file", type=Output(JSON), help="Write the result.")
@click.option("--csv", "csv_file", type=Output(_TABLE), help="Write the table.")
def diagnose(
    measured: tuple[Path, ...],
    simulated: Path | None,
    simulated_column: str | None,
    model_file: Path | None,
    beam_file: Path | None,
    deck_file: Path | None,
    simulator: str | None,
    parameters: dict[str, Any],
    runs: Path,
    time_limit: float,
    held_out: Path | None,
    repeats: tuple[Path, ...],
    reference: tuple[Path, ...],
    mode: int | None,
    band: tuple[float, float] | None,
    release: int | None,
    whole: bool,
    tolerance: dict[str, float],
    tolerances: dict[str, float],
    free: tuple[str, ...],
    floor: float | None,
    exit_code: bool,
    full: bool,
    jobs: int,
    budget: float | None,
    report: Path | None,
    interactive: bool,
    json_file: Path | None,
    csv_file: Path | None,
    **reading: Any,
) -> None:
    """Name what a simulation lacks, from measured vibrations, free or driven.

    The simulation is a model (--model), a simulated decay (--simulated), a program that simulates
    one after a release (--simulator), or a beam (--beam) or a finite-element deck (--deck) with a
    measured column for each sensor. A model of several coordinates is compared with all that rings
    in one column or more. Of a beam, omega^2 and c_linear stand for bending stiffness and
    damping by the mass.
    Measured files are read as identify reads them, one decay of every release: level, hold and
    tail are taken off, but nothing is filtered, and no mode isolated unless --mode or --band asks
    for it. With --input the records of a model are vibrations that measured inputs drive. The
    exit code is 2 where something is refused, and 130 after an interruption (Ctrl-C), which keeps
    what was compared, as the end of --budget does.
    """
    driven = Inputs(**{f.name: reading.pop(f.name) for f in fields(Inputs)})
    driven.check(_DECAYS)
    if simulated_column is not None:
        simulated = simulated or measured[0]
    if sum(f is not None for f in (simulated, model_file, beam_file, deck_file, simulator)) != 1:
        raise click.UsageError("name one of --simulated, --model, --simulator, --beam and --deck")
    if parameters and simulator is None:
        raise click.UsageError("--parameter is a value of a program: give it, --simulator")
    page = report or default_page(f"{measured[0].stem}_diagnosis.html")
    choice = Selection(mode, band, release, whole)
    simulation: dict[str, Any] = {}
    if beam_file is not None:
        if choice != Selection():
            raise click.UsageError("--mode, --band, --release and --whole belong to one column")
        beam, sensors, columns = load_beam(beam_file)
        simulation = {"model": beam, "sensors": sensors}
        reading["column"], choice = columns, Selection(whole=True)
    elif deck_file is not None:
        deck = DeckFile.load(deck_file)
        keep_inputs(deck.inputs)
        simulation = {"model": deck.simulator(n_jobs=jobs), "parameters": deck.parameters or None}
        reading["column"] = list(deck.columns)
        choice = choice._replace(coordinates=len(deck.columns))
    elif simulator is not None:
        simulation = {"model": Program(simulator, runs, time_limit), "parameters": parameters}
        choice = choice._replace(coordinates=max(len(reading["column"] or ()), 1))
    elif simulated is not None:
        simulation = {"model": _series(simulated, reading["unit"], simulated_column)}
    elif model_file is not None:
        text = text_of(model_file)
        with named(f"{model_file}"):
            simulation = {"model": estimate_of(text) or model_of(text)}
        choice = choice._replace(coordinates=_equation(simulation["model"]).n_coordinates)
        if choice.coordinates > 1 and choice.isolates:
            raise click.UsageError("--mode and --band isolate one mode: the model is of several")
        if not driven.inputs:
            _note_inputs(simulation["model"])
    tabled = beam_file or deck_file
    own = None if tabled is None else f"[sensors] columns in {tabled}:"
    load = partial(_records_in, driven=driven, reading=reading, choice=choice)
    with bar(None, "reading the records"), _columns_by(own):
        stored = tuple(file for file in repeats if file.suffix == ".json")
        repeats = tuple(file for file in repeats if file not in stored)
        learnt, again, known = (_loaded(load, of) for of in (measured, repeats, reference))
        tests = _loaded(load, [held_out] if held_out is not None else [])
    if len(tests) > 1:
        raise click.UsageError(f"--held-out {held_out} holds {len(tests)} decays: choose --release")
    # What was not given stays as the simulation has it; 0 and nothing are given values.
    asked: dict[str, Any] = {"floor": floor, "tolerance": tolerance or None, "budget": budget}
    asked["free"] = [name for name in free if name != "nothing"] if free else None
    asked["tolerances"] = tolerances or None
    asked["repeats"] = [d for _, d in again] if again else None
    if stored:
        asked["tolerance"] = _repeats_in(stored, tolerance or again)
    asked["held_out"] = tests[0][1] if tests else None
    asked["reference"] = [d for _, d in known] or None
    series = [] if simulated is None else [f"{simulated}"]
    names = {
        "decay": [name for name, _ in (*learnt, *tests)],
        "record": [name for name, _ in (*learnt, *tests)],
        "repeat": [name for name, _ in again],
        "reference": [*series, *(name for name, _ in known)],
    }
    result = _run(simulation | asked, [d for _, d in learnt], jobs, names)
    with writing(page):  # files come first: who reads a pipe may stop
        result.to_html(page, interactive=interactive)
    if json_file is not None:
        write_json(json_file, result.to_json())
    if csv_file is not None:
        with writing(csv_file):
            result.to_csv(csv_file)
    _tell(result, full)
    click.echo(told("Report", page))
    if result.interrupted and budget is None:
        raise click.exceptions.Exit(INTERRUPTED)
    if exit_code:
        raise click.exceptions.Exit(_CODES[result.verdict])


def _run(
    given: Mapping[str, Any], measured: Sequence[Any], jobs: int, names: Mapping[str, Sequence[str]]
) -> Any:
    """The diagnosis; what it refuses is told with the names of files and options."""
    settings = {name: value for name, value in given.items() if value is not None}
    n = len(measured)
    with bar(None, f"comparing candidates with {n} measured record{'s' * (n > 1)}") as steps:

        def progress(candidate: str) -> None:
            steps.set_postfix_str(candidate)
            steps.update()

        try:
            return run_diagnosis(measured=measured, n_jobs=jobs, progress=progress, **settings)
        except ValueError as error:
            told = _on_command_line(str(error), names)
            a_deck = isinstance(given["model"], StructureSimulator)
            raise ValueError(told.replace("--simulator", "--deck") if a_deck else told) from error


def _repeats_in(files: Sequence[Path], beside: object) -> Tolerance:
    """The tolerance that romsindy repeat wrote, alone."""
    if len(files) > 1 or beside:
        raise click.UsageError(f"--repeats {files[0]} is a tolerance: leave out any other")
    with named(f"{files[0]}"):
        content = table("the JSON text", read_json(text_of(files[0])), ("tolerance",))
        kept = table("its tolerance", content["tolerance"], (*KINDS, "source", "undetermined"))
        wide = tuple(map(tuple, kept["undetermined"]))
        own = {name: kept[name] for name in (*KINDS, "source")} | {"undetermined": wide}
        return Tolerance().or_more(Tolerance(**own, sources={k: DEFAULT for k, *_ in wide}))


def _equation(simulation: Equations | Estimate) -> Equations:
    """The equations of a model, without what else is known of it."""
    return simulation.model if isinstance(simulation, Estimate) else simulation


def _series(path: Path, unit: str | None, column: str | None) -> Decay:
    """The largest of the simulated decays in a file."""
    others = dict.fromkeys(("quantity", "lever", "time", "rate", "start", "end"))
    reading = {"unit": unit, "column": column, **others}
    with _columns_by("--simulated-column"):
        decays = decays_in(path, reading, Selection(), _note)
    return max(decays, key=lambda decay: float(np.ptp(decay.q)))


def _note_inputs(simulation: Equations | Estimate) -> None:
    """Say that inputs of a model stand still in records that are taken for free decays."""
    for term in inputs_of(_equation(simulation)):
        kind = term.source.split()[0]
        warnings.warn(
            f"the model has {term.key!r}, and records are taken for free decays, which nothing"
            f" drives: if something does, say --input {kind}",
            stacklevel=2,
        )


def _records_in(
    file: Path, driven: Inputs, reading: Mapping[str, Any], choice: Selection
) -> Sequence[Any]:
    """The decays of a file, or the vibration in it that inputs drive."""
    if driven.inputs:
        return [driven.load(file, reading)]
    return decays_in(file, reading, choice, _note)


@contextmanager
def _columns_by(chosen: str | None) -> Iterator[None]:
    """Messages on columns name what chose them, where --column did not."""
    try:
        yield
    except ValueError as error:
        if chosen is None:
            raise
        raise ValueError(re.sub(r"\bcolumn ?=", lambda _: chosen, str(error))) from error


def _note(line: str) -> None:
    """Say on the error stream how a file was read."""
    click.echo(f"Note: {line}", err=True)


def _loaded(load: Callable[[Path], Sequence[Any]], files: Sequence[Path]) -> list[tuple[str, Any]]:
    """Records with the names of their files, numbered where one holds several."""
    found = []
    for file in files:
        records = load(file)
        for i, record in enumerate(records, 1):
            found.append((f"{file}" if len(records) == 1 else f"{file}, release {i}", record))
    return found


def _on_command_line(message: str, names: Mapping[str, Sequence[str]]) -> str:
    """Files and options in the place of numbers and arguments of Python."""

    def file(found: re.Match[str]) -> str:
        known, i = names[found[1]], int(found[2])
        return known[i] if i < len(known) else found[0]

    message = re.sub(rf"\b({'|'.join(names)}) (\d+)\b", file, message)
    return _ARGUMENT.sub(lambda found: f"--{_OPTIONS.get(found[1], found[1])}", message)


def _tell(result: Any, full: bool) -> None:
    """The finding; tables are on the page, and here where they are asked for."""
    click.echo(f"{result.verdict}\n{result}\n")
    if not full:
        return
    of_sensors = [result.sensor_table()] if isinstance(result, StructureReport) else []
    for rows in (result.gap.table(), *of_sensors, result.table()):
        if len(rows) > 1:
            click.echo(f"{aligned(rows)}\n")
