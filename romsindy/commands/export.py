"""The command ``romsindy export``."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from romsindy.commands.main import INTERRUPTED
from romsindy.commands.measurement import Selection, decays_in
from romsindy.commands.options import READING, estimate_of, model_of, reading_options, text_of
from romsindy.commands.options import given as on_command_line
from romsindy.commands.outputs import Output, WritingCommand, keep_inputs, write_text
from romsindy.effects import CATALOGUE, ReadingEffect
from romsindy.fit.functions.identification import Identification
from romsindy.physics.equations import Equations
from romsindy.physics.export import FREEDOMS, auto_function, openfast_damping, python_script
from romsindy.physics.model import ReducedModel
from romsindy.physics.term_sum import read_json
from romsindy.physics.validation import several, table
from romsindy.physics.validation import text as entry
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.record.files.load import named
from romsindy.simulator.force import LawForce
from romsindy.structure.calculix import STOPPED, Released
from romsindy.structure.deck import Deck
from romsindy.structure.deck_file import DeckFile, sensor_of
from romsindy.structure.parts import Correction, PartValue, corrected_deck
from romsindy.structure.simulator import Damping
from romsindy.structure.structure import Structure
from romsindy.text import aligned, bar, listed, percent
from romsindy.typing import Array

_STDOUT = Path("-")
_MARK = "romsindy export"
_HEADINGS = {
    "What is written": "--to --deck --short --name --inertia --freedom --output --overwrite",
    "Both decks in time": "--dynamic --measured --cycles --steps",
    "Reading of the measurement": f"{READING} --release",
}
_COMMENT = {"matlab": "%", "c": "//", "sympy": "#", "text": "#", "auto": "!", "openfast": "!"}


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--to",
    "language",
    type=click.Choice(["matlab", "c", "sympy", "text", "auto", "openfast", "deck"]),
    required=True,
    help="A function for ode45, a C99 function, Python with sympy, the equation to be read, the"
    " equations of AUTO-07p, the damping of HydroDyn, or with --deck a corrected deck of CalculiX.",
)
@click.option(
    "--inertia",
    type=click.FloatRange(0, min_open=True),
    help="With --to openfast: the mass, kg, or the moment of inertia, kg m^2, with added mass.",
)
@click.option(
    "--freedom",
    type=click.Choice(FREEDOMS),
    help="With --to openfast: which of the platform q is.",
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
@click.option(
    "--dynamic",
    is_flag=True,
    help="Let the deck go in CalculiX's own time, as it was and corrected, and print how far it is"
    " from the measured decays.",
)
@click.option(
    "--measured",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Decay for it, with the columns of the deck's sensors; repeatable.",
)
@click.option(
    "--cycles", type=click.IntRange(4), default=10, show_default=True, help="Length of each run."
)
@click.option(
    "--steps", type=click.IntRange(20), default=200, show_default=True, help="In time, of a cycle."
)
@reading_options
@click.option("--release", type=int, help="Number of the measured release.  [default: all]")
def export(
    file: Path,
    language: str,
    deck_file: Path | None,
    output: Path,
    short: bool,
    name: str | None,
    inertia: float | None,
    freedom: str | None,
    dynamic: bool,
    measured: tuple[Path, ...],
    cycles: int,
    steps: int,
    release: int | None,
    **reading: Any,
) -> None:
    """Write the equation of motion in FILE for MATLAB, C, sympy, AUTO or OpenFAST, or as text.

    FILE is a model (JSON): identify --model, identify --save, Fit.save and diagnose --json write
    such.

    Measured inputs become arguments: functions of time in MATLAB and sympy, values in C. For
    OpenFAST the linear and quadratic damping are written that identify --damping-split told apart.
    """
    text = text_of(file)
    if {language == "openfast"} != {inertia is not None, freedom is not None}:
        raise click.UsageError(
            "--to openfast, --inertia and --freedom go together, such as --to openfast --inertia"
            " 1.2e10 --freedom roll"
        )
    if (language == "deck") != (deck_file is not None):
        raise click.UsageError("--to deck and --deck, the deck that was diagnosed, go together")
    if not dynamic and (alone := on_command_line([*_OF_TIME, *reading])):
        raise click.UsageError(f"--{alone[0]} is for --dynamic: leave it out, or give both")
    if dynamic and (deck_file is None or not measured):
        raise click.UsageError(
            "--dynamic lets a deck go as a measured decay was: give --to deck, --deck and"
            " --measured, such as --measured test.csv"
        )
    if deck_file is not None:
        given = DeckFile.load(deck_file)
        keep_inputs(given.inputs)
        with named(f"{file}"):
            found = _found(text, file, given)
        reading["column"], say = list(given.columns), partial(click.echo, err=True)
        choice = Selection(release=release, coordinates=len(given.columns))
        plans = {
            f"{path}" + f", release {i}" * (len(several) > 1): _Plan.of(decay, cycles, steps)
            for path in measured
            for several in [decays_in(path, reading, choice, say)]
            for i, decay in enumerate(several, 1)
        }
        write_text(output, f"{found.deck}** {_MARK}")  # whatever comes of the rest
        if dynamic:
            with named(f"{deck_file}"):
                _in_time(found, given, plans, steps, aside=output == _STDOUT)
        return
    if inertia is not None and freedom is not None:
        with named(f"{file}"):
            lines = _of_hydrodyn(text, inertia, freedom)
        write_text(output, lines + ("" if output == _STDOUT else f"\n! {_MARK}"))
        return
    with named(f"{file}"):
        model = _short(text) if short else _model(text)
    name = name or ("rhs" if output == _STDOUT else output.stem)
    with named(f"{file}"):
        code = _code(model, language, name)
    mark = "" if output == _STDOUT else f"\n{_COMMENT[language]} {_MARK}"
    write_text(output, code + mark)


def _of_hydrodyn(text: str, inertia: float, freedom: str) -> str:
    """The damping of a file for OpenFAST.

    Raises a ValueError if the file tells no linear and quadratic damping, or has another unit.
    """
    found, turns = estimate_of(text), freedom in FREEDOMS[3:]
    model = _model(text) if found is None else found.model
    asked, known = ("rad", "deg") if turns else ("m",), model.unit
    if known not in asked:
        raise ValueError(f"q is in {known or 'an unknown unit'}, and {freedom} in {asked[0]}")
    split = found.damping if isinstance(found, Identification) else None
    linear: tuple[float, ...]
    quadratic: tuple[float, ...]
    if split is not None:
        linear, quadratic = split.linear, split.quadratic
    else:
        damping = {t.key: v for t, v in model.pairs if t.has("damping")}
        if other := sorted({*damping} - {"c_linear", "c_quadratic"}):
            raise ValueError(
                f"its damping is not linear and quadratic alone ({', '.join(other)}): give what"
                " identify --damping-split --save wrote"
            )
        linear, quadratic = ((damping.get(n, 0.0),) for n in ("c_linear", "c_quadratic"))
    size = 180 / np.pi if known == "deg" else 1.0
    ends = [
        f"{name} = {values[0]:.6g} {unit}"
        + (" ({:.6g} to {:.6g}, 95 %)".format(*values[1:]) if split else "")
        for name, values, unit in (
            ("c_linear", linear, "1/s"),
            ("c_quadratic", np.multiply(size, quadratic), "1/rad" if turns else "1/m"),
        )
    ]
    doubt = ["These two alone do not explain the decays."] if split and not split.explained else []
    return openfast_damping(
        linear[0],
        float(size * quadratic[0]),
        inertia,
        freedom,
        f"Damping of {freedom}: {'; '.join(ends)}; times an inertia of {inertia:.6g}"
        f" {'kg m^2' if turns else 'kg'}, added mass included.",
        *doubt,
        "It is all of the damping: subtract what the model has already"
        " (radiation, Morison drag, moorings) before it is used.",
    )


def _code(model: Equations, language: str, name: str) -> str:
    if language == "text":
        return str(model)
    if language == "auto":
        return auto_function(model.pairs, str(model), model.coordinates)
    if language == "sympy":
        pairs = list(zip(model.terms, model.values, strict=True))
        return python_script(pairs, str(model), model.coordinates)
    return model.to_matlab(name) if language == "matlab" else model.to_c(name)


class _Export(NamedTuple):
    """What a diagnosis of a deck found."""

    deck: str  # the text of the corrected one
    force: LawForce | None
    damps: bool  # whether the force does
    point: str | None  # where it acts, and the mass, if not where the file of the deck says
    mass: float
    values: dict[str, float]


def _found(text: str, file: Path, given: DeckFile) -> _Export:
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
    damps = force is not None and any(
        force(0.0, x, v) != force(0.0, x, 0.0) for x in (0.0, force.reach[0]) for v in force.reach
    )
    if force is not None:
        remarks.append(f"force on the node, N, of x (m) and v (m/s): {force}")
        if damps:
            remarks.append("its part that damps has no element in *DYNAMIC: it is not in this deck")
    deck, (node, direction) = Deck.load(given.file), given.point or given.sensors[0]
    point = None if place is None else entry("place point", table("place", place)["point"])
    if point is not None:
        node, direction = sensor_of("place", point)
    if mass:
        remarks.append(f"mass at the node: {mass:.6g} kg")
    holds = force is not None and any(force(0.0, x, 0.0) for x in (-1e-3, 1e-3))
    correction = Correction(
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
    corrected = corrected_deck(deck, correction, given.units)
    return _Export(corrected, force, damps, point, mass, {n: float(v) for n, v in values.items()})


# -- both decks in time ----------------------------------------------------------------------------

_OF_TIME = ("measured", "cycles", "steps", "release")
_SEEN = ("deck", "corrected deck", "simulator", "corrected simulator")
_WHAT = ("frequency, largest", "frequency, median", "damping, largest", "damping, median")


class _Plan(NamedTuple):
    """How decks are let go as a decay was."""

    decay: Decay
    step: float  # s
    n: int  # steps
    release: float  # m

    @classmethod
    def of(cls, decay: Decay, cycles: int, steps: int) -> _Plan:
        """From its first extreme, so many cycles."""
        first = decay.channel(0)
        frequency = extract_backbone(first).frequency
        step = 2 * np.pi / float(frequency.max()) / steps
        count = int(np.sum(2 * np.pi / frequency[:cycles]) / step)
        swing = (first.q - first.q.mean())[: int(steps * step / first.dt) + 1]
        release = float(swing[np.argmax(np.abs(swing))])
        return cls(decay.between(end=decay.t[0] + count * step), step, count, release)

    @property
    def t(self) -> Array:
        return self.step * np.arange(self.n + 1)


def _in_time(
    found: _Export, given: DeckFile, plans: Mapping[str, _Plan], steps: int, aside: bool
) -> None:
    """Let both decks go as each decay was, and print the gaps, ``aside`` on the error stream.

    What an interruption leaves is printed, and ends the command.
    """
    own = {n: v for n, v in found.values.items() if n in Damping._fields}
    dampings = given.damping, given.damping._replace(**own)
    acts: dict[str, Any] = {"force": found.force, "point": found.point, "mass": found.mass}
    simulator = given.simulator()
    beside = {}
    for name, (_, _, _, release) in plans.items():  # what is beyond the range is refused at once
        try:
            beside[name] = [
                simulator.simulate(release, plans[name].t, **more)
                for more in ({}, acts | found.values)
            ]
        except ValueError as error:
            raise ValueError(f"{error} ([deck] range), or leave {name} out") from error
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"corrected_{given.file.name}"
        path.write_text(found.deck, encoding="utf-8")
        decks = [
            Structure.from_calculix(file, ccx=given.ccx, store=store, progress=False)
            for file, store in ((given.file, given.store), (path, None))
        ]
        for name, plan in plans.items():
            runs = _runs(decks, dampings, given, plan)
            moved = [(run.t, given.units.length * run.moved, run) for run in runs]
            lost = [None] * (len(decks) - len(runs))
            seen = [*moved, *lost, *((plan.t, x, None) for x in beside[name])]
            head = f"{name}, let go at {plan.release:.4g} m: off at equal amplitude, % (-: none)"
            rows = _gaps(given.columns, plan.decay, seen, found.damps)
            notes = _notes(found, dampings, runs, plan, steps)
            click.echo("\n".join([head, aligned(rows, "  "), *notes]), err=aside)
            if lost or runs[-1].ended == STOPPED:
                click.echo("Interrupted: what is above was computed before.", err=True)
                raise click.exceptions.Exit(INTERRUPTED)


def _runs(
    decks: Sequence[Structure], dampings: Sequence[Damping], given: DeckFile, plan: _Plan
) -> list[Released]:
    """The decks in time, as far as an interruption lets them."""
    runs: list[Released] = []
    start = given.sensors, plan.release / given.units.length, plan.step, plan.n, given.mode
    with bar(None, f"letting {given.file.name} go", 2 * plan.n, unit="step") as progress:

        def told(n: int) -> None:
            progress.update(len(runs) * plan.n + n - progress.n)

        try:
            for deck, damping in zip(decks, dampings, strict=True):
                how = {"held_by": given.held_by, "damping": damping, "told": told}
                runs.append(deck.released(*start, **how))  # type: ignore[arg-type]
                if runs[-1].ended == STOPPED:
                    break
        except KeyboardInterrupt:
            pass
    return runs


def _gaps(
    columns: Sequence[str],
    measured: Decay,
    seen: Sequence[tuple[Array, Array, Released | None] | None],
    damps: bool,
) -> list[list[str]]:
    """A table of how far all are from what was measured."""
    table = [["", "", *_SEEN]]
    for i, name in enumerate(columns):
        true = _cycles((measured.t, measured.q, None), i)
        cells = []
        for k, signal in enumerate(seen):
            cycles = None if signal is None else _cycles(signal, i)
            gap = cycles.beside(true) if cycles and true else None
            if gap is None:
                cells.append(["-"] * 5)
                continue
            low, high = gap.amplitude
            off = [f"{100 * x:+.3f}" for x in (*gap.frequency, *gap.damping)]
            if damps and k == 1:  # *DYNAMIC has nothing of what damps
                off[2:] = ["-", "-"]
            cells.append([f"{1e3 * low:.3g} to {1e3 * high:.3g}", *off])
        names = [name, "", "", "", ""]
        table += map(list, zip(names, ("amplitudes, mm", *_WHAT), *cells, strict=True))
    return table


def _cycles(signal: tuple[Array, Array, Released | None], sensor: int) -> Backbone | None:
    """Cycles at a sensor; None where there are none."""
    t, x, run = signal
    try:
        column = x.reshape(len(t), -1)[:, sensor]
        cycles = extract_backbone(Decay(t, column, unit="m", stage="free"))
    except ValueError:
        return None
    return cycles if run is None else replace(cycles, frequency=run.true(cycles.frequency))


def _notes(
    found: _Export, dampings: Sequence[Damping], runs: Sequence[Released], plan: _Plan, steps: int
) -> list[str]:
    """What is to be said of runs in time."""
    end, lost = plan.t[-1], (2 * np.pi / steps) ** 2 / 12
    notes = [
        f"{end:.4g} s of CalculiX's *DYNAMIC, and of the simulator of the reduction; {steps} steps"
        f" a cycle cost {percent(lost)} of the frequency, which was added"
    ]
    for name, (ratio, *_), run in zip(_SEEN, dampings, runs, strict=False):
        if run.ended:
            finer = "" if run.ended == STOPPED else f": try --steps {2 * steps}"
            went = f"The {name} went {run.t[-1]:.4g} s, and that is what was compared"
            notes.append(f"{went}: {run.ended}{finer}")
        if ratio:
            alpha, beta = run.rayleigh
            notes.append(
                f"*DYNAMIC takes no damping ratio: {ratio:.4g} of the {name} is ALPHA={alpha:.4g},"
                f" BETA={beta:.4g} there, the same at small amplitude"
            )
    if found.damps:
        notes.append(
            "The decay of the corrected deck has nothing of the force that damps: compared are its"
            " frequencies at equal amplitude only. Damping is judged by the simulator of the"
            " reduction, with the same force"
        )
    elif found.force is not None or found.mass:
        notes.append(
            "ALPHA and BETA damp an added mass and spring too; in the simulator they do not"
        )
    return notes


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
