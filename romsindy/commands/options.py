"""Options that several commands share: how files are read, what drives them, where results go."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from click.core import ParameterSource

from romsindy.fit.functions.identification import Identification
from romsindy.fit.results.estimate import Estimate
from romsindy.fit.steady.fit import SteadyEstimate
from romsindy.physics.coupled import model_from_json
from romsindy.physics.damping import DAMPING
from romsindy.physics.equations import Equations
from romsindy.physics.term_sum import read_json
from romsindy.physics.validation import table
from romsindy.record.files import load_forced
from romsindy.record.forced import ForcedVibration, input_names
from romsindy.record.interpolation import INTERPOLATIONS, Interpolation
from romsindy.record.recording import QUANTITIES

FILE = click.Path(path_type=Path)
# Options of the reading of a file and of measured inputs, for the headings of --help.
READING = "--unit --quantity --column --lever --time --rate --start --end"
INPUTS = "--input --input-column --unit-input --interpolation"
full_option = click.option(
    "--full", is_flag=True, help="Print all tables; without it they are on the page alone."
)


def _processes(_: click.Context, __: click.Parameter, value: int) -> int:
    if not value:
        raise click.UsageError("--jobs 0 must be a number of processes; -1 uses all cores")
    return value


jobs_option = click.option(
    "--jobs",
    default=1,
    show_default=True,
    callback=_processes,
    help="Processes, each of which does one at a time; -1 uses all cores.",
)
# Options that choose a part of a free decay, and what to do without them.
PARTS = dict.fromkeys(
    ("mode", "band", "release"), "the whole record is taken; cut it with --start and --end"
)
_ALONE = ("input-column", "unit-input", "interpolation")


def grouped(*options: Callable) -> Callable[[Callable], Callable]:
    """A decorator with options that several commands have, in the order of their help."""

    def add(command: Callable) -> Callable:
        for option in reversed(options):
            command = option(command)
        return command

    return add


# The options with which a file is read, named as the arguments of `load_recording`.
reading_options = grouped(
    click.option("--unit", help='Unit of the measured column: "mm", "m/s", "g", "deg", ...'),
    click.option(
        "--quantity",
        type=click.Choice(list(QUANTITIES)),
        help="What was measured.  [default: what unit or header say]",
    ),
    click.option(
        "--column",
        multiple=True,
        callback=lambda _, __, names: list(names) or None,
        help="Name of a measured column; several are used together.",
    ),
    click.option(
        "--lever",
        type=float,
        help="Lever arm, m, at which angles count beside lengths.  [default: both vibrate alike]",
    ),
    click.option("--time", help="Name of the time column."),
    click.option("--rate", type=float, help="Samples per second, for files without times."),
    click.option("--start", type=float, help="Use the record from this time on, s."),
    click.option("--end", type=float, help="Use the record up to this time, s."),
)


def _needs_plotly(_: click.Context, __: click.Parameter, asked: bool) -> bool:
    if asked:
        from romsindy.show.interactive import check_plotly  # figures are for those who ask

        check_plotly()
    return asked


interactive_option = click.option(
    "--interactive",
    is_flag=True,
    callback=_needs_plotly,
    help="Figures of pages zoom and show what is under the pointer (needs romsindy[interactive]).",
)


def _coefficients(
    _: click.Context, __: click.Parameter, values: tuple[str, ...]
) -> dict[str, float]:
    fixed = {}
    for value in values:
        name, _sep, number = value.partition("=")
        try:
            fixed[name.strip()] = float(number)
        except ValueError:
            raise click.BadParameter(
                f"{value!r} is not NAME=NUMBER, such as omega^2=1482.2"
            ) from None
    return fixed


def fix_option(words: str) -> Callable:
    """The option that states coefficients which are known."""
    return click.option(
        "--fix", multiple=True, callback=_coefficients, metavar="NAME=VALUE", help=words
    )


def damping_option(usual: Sequence[str], words: str) -> Callable:
    """The option that names kinds of damping."""
    kinds = click.Choice(list(DAMPING))
    return click.option(
        "--damping", multiple=True, default=usual, show_default=True, type=kinds, help=words
    )


def command_line(file: Path, reading: Mapping[str, Any]) -> str:
    """The command that identifies a file read in this way, ready to be pasted.

    Several columns are left out: which of them are used is what the steps that come next differ in.
    """
    words = ["romsindy", "identify", f"./{file}" if str(file).startswith("-") else str(file)]
    columns = reading["column"] or []
    alone = {"column": columns[0] if len(columns) == 1 else None}
    for name, value in {**reading, **alone}.items():
        if value is not None:
            words += [f"--{name}", f"{value:.12g}" if isinstance(value, float) else str(value)]
    return shlex.join(words)


def refuse_beside(option: str, what: str, others: Mapping[str, str]) -> None:
    """Refuse ``others``, what to do without each by its name, which are for ``what``, beside one.

    Raises a UsageError if one was given.
    """
    for name in given(others):
        raise click.UsageError(
            f"--{name} is for {what}: leave it out beside --{option} ({others[name]}), or leave"
            f" out --{option}"
        )


def span(example: str, more: str = "") -> Callable[..., tuple[float, float] | None]:
    """A callback that reads two positive numbers LOW:HIGH.

    Where another option took the place of its value, ``more`` is said.
    """

    def read(_: click.Context, __: click.Parameter, value: str | None) -> Any:
        if value is None:
            return None
        try:
            low, high = map(float, value.split(":"))
        except ValueError:
            low, high = np.nan, np.nan
        if not 0 < low < high < np.inf:
            raise click.BadParameter(
                f"{value!r} is not LOW:HIGH, two positive numbers, the smaller first, such as"
                f" {example}{more if value.startswith('--') else ''}"
            )
        return low, high

    return read


def given(names: Iterable[str]) -> list[str]:
    """Those of several options that were written on the command line."""
    context = click.get_current_context()
    parameters = {o: p.name or "" for p in context.command.params for o in p.opts}
    sources = {n: context.get_parameter_source(parameters[f"--{n}"]) for n in names}
    return [n for n, source in sources.items() if source is ParameterSource.COMMANDLINE]


def model_of(text: str) -> Equations:
    """The model in a JSON text, as commands take it: one that vibrates about its rest.

    Raises a ValueError if it is none, or pushed away from its rest.
    """
    model = model_from_json(text)
    for name, value in model.coefficients.items():
        if name.startswith("omega^2") and value <= 0:
            raise ValueError(
                f"{name} = {value:g} must be positive: the square of the angular frequency of small"
                " vibrations, 1/s^2"
            )
    if not any(term.has("stiffness") for term in model.terms):
        raise ValueError("the model has no stiffness: give omega^2 at least")
    return model


def estimate_of(text: str) -> Estimate | None:
    """What is known of the model in a JSON text; None of a model alone.

    Raises a ValueError if entries are missing, or do not belong together.
    """
    content = table("the JSON text", read_json(text))
    for mark, kind in (("structures", Identification), ("test", SteadyEstimate)):
        if mark in content:
            return kind.from_json(text)
    return Estimate.from_json(text) if "covariance" in content else None


def text_of(path: Path) -> str:
    """The text of a file.

    Raises a ValueError if it is none.
    """
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no text in UTF-8: name another file, or save it so") from error


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
        return load_forced(
            file,
            input_names(self.inputs),
            input_column=self.input_column or None,
            input_unit=self.unit_input or None,
            interpolation=self.interpolation,
            **reading,
        )
