"""The command ``romsindy steady``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from romsindy.commands.main import OVERWRITES
from romsindy.commands.measurement import of_file
from romsindy.commands.options import FILE, fix_option, span
from romsindy.commands.outputs import WritingCommand
from romsindy.commands.results import SAVE, Result, Telling, answer_options
from romsindy.fit.steady.fit import SteadyFit, fit_steady
from romsindy.physics.model import ReducedModel
from romsindy.record.files.choose import conversion
from romsindy.record.files.columns import Column
from romsindy.record.files.load import reader_of
from romsindy.record.recording import QUANTITIES, Quantity
from romsindy.record.units import force_unit
from romsindy.show.identified import Identified
from romsindy.text import as_options, bar
from romsindy.typing import Array

# What remedies of Python are called here; arguments follow by `as_options`.
_WORDS = (
    (r"give response\.conj\(\)", "say --lag"),
    (r"look at measured=", "look at --quantity"),
    (r"give -force", "turn it by 180 degrees"),
    (r"\bstd (was not given|must be)", r"spread \1"),
)

_CONSTANT = (
    "a slope of the gain was looked for, and without one what takes no part is predicted as well:"
    " it is 0"
)
_EXPLAINED = "--save keeps the fit, and romsindy predict foretells another level of force by it."
_LACKS = (
    "leave out points that stand off their neighbours on the page, for they had not settled; name"
    " another --term; --slope fit lets the gain change with the force."
)


def _slope(_: click.Context, __: click.Parameter, value: str) -> float | None:
    try:
        return None if value == "fit" else float(value)
    except ValueError:
        raise click.BadParameter(f"{value!r} is neither a number nor fit") from None


_HEADINGS = {
    "The table": "--quantity --lag --sweep-rate --force",
    "What is looked for": "--term --fix --gain --slope --phase",
    "Output": "--full --report --interactive --json --model --save --overwrite",
}


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("file", type=FILE, metavar="POINTS")
@click.option(
    "--quantity",
    type=click.Choice(list(QUANTITIES)),
    help="What the response is.  [default: what unit or header say]",
)
@click.option(
    "--lag", is_flag=True, help="Phases of the response are lags: positive if it is late."
)
@click.option(
    "--force",
    "forces",
    callback=span("0.1:0.4", f"; {OVERWRITES}"),
    metavar="LOW:HIGH",
    help="Fit only points whose force has an amplitude in this range, in N, or in the unit of the"
    " table where that is none of forces; romsindy predict foretells the others.  [default: all]",
)
@click.option(
    "--sweep-rate",
    type=click.FloatRange(min=0, min_open=True),
    metavar="HZ/S",
    help="The rows are sweeps at this rate in the order of time, up or down as the frequency goes.",
)
@click.option(
    "--term",
    "terms",
    multiple=True,
    metavar="NAME",
    help="Term beside omega^2 and c_linear, such as gamma_3, Upsilon_3 or c_quadratic; may be"
    " repeated.  [default: chosen by levels of force that take no part]",
)
@fix_option("Known coefficient in SI units; may be repeated.")
@click.option(
    "--gain", type=float, help="Force per unit mass of an excitation of 1.  [default: fitted]"
)
@click.option(
    "--slope",
    default="0",
    callback=_slope,
    show_default=True,
    metavar="fit|NUMBER",
    help="By how much the gain grows for an excitation of 1.",
)
@click.option(
    "--phase",
    type=float,
    help="By how much the force leads the excitation, deg.  [default: fitted]",
)
@answer_options
@SAVE
def steady(
    file: Path,
    quantity: Quantity | None,
    lag: bool,
    forces: tuple[float, float] | None,
    sweep_rate: float | None,
    terms: tuple[str, ...],
    fix: Mapping[str, float],
    gain: float | None,
    slope: float | None,
    phase: float | None,
    **options: Any,
) -> None:
    """Fit an equation of motion to the steady states in the table POINTS.

    POINTS is CSV, or any file that romsindy reads, of a stepped sine or of phase resonance. It has
    a row for each steady state and a header: frequency [Hz], force [N], and the response by its
    name and unit, displacement [mm]; where they were measured, force phase [deg], displacement
    phase [deg], displacement 2 [mm] and so on for its harmonics, and spread [mm], the standard
    deviation of real and imaginary part. With --sweep-rate the rows are sweeps, up and down, that
    jump; sweep rate [Hz/s] may be a column, negative where the frequency falls.
    """
    telling = Telling.taken(options)
    turn = None if phase is None else float(np.radians(phase))

    def job(file: Path | None, page: Path) -> Result:
        assert file is not None  # a file is required
        with of_file(file):
            whole = SteadyTable.read(file, quantity, lag).swept(sweep_rate)
            table = whole if forces is None else whole.within(*forces)
            try:
                fit = _fitted(table, terms, fix, {"gain": gain, "slope": slope, "phase": turn})
            except ValueError as error:
                raise ValueError(_in_words(str(error))) from error
        notes = [*fit.notes, *([_CONSTANT] if slope is None and not fit.chain.slope else [])]
        test = replace(fit.test, unit=table.force_unit)
        told = replace(fit, notes=tuple(map(_in_words, notes)), test=test)
        picked = "" if forces is None else table.picked(whole, *forces)
        facts = {} if forces is None else {"left_out": len(whole.frequency) - len(table.frequency)}
        report = Identified(f"Steady states {file.name}", found=told, picked=picked)
        step = _EXPLAINED if fit.verdict.explained else _LACKS
        return Result.written(file, page, report, telling.interactive, facts=facts, step=step)

    telling.give(job, [file], False, "steady")


def _fitted(
    table: SteadyTable, terms: Sequence[str], fix: Mapping[str, float], chain: Mapping[str, Any]
) -> SteadyFit:
    measured = (table.frequency, table.force, table.response)
    given = {**chain, "measured": table.quantity, "std": table.spread, "sweep_rate": table.rate}
    with bar(None, "fitting"):
        if not terms:
            fit = fit_steady(None, *measured, unit=table.unit, **given)
            if not fix:
                return fit
            terms = tuple(fit.model.coefficients)
        names = dict.fromkeys(("omega^2", *terms, *fix, "c_linear"), 0.0)
        start = {"omega^2": float(np.median(table.frequency)) ** 2, **fix}
        model = ReducedModel.from_coefficients(names | start, table.unit)
        return fit_steady(model, *measured, fixed=tuple(fix), **given)


def _in_words(sentence: str) -> str:
    """A sentence of the fit with what its remedies are called on the command line."""
    for pattern, word in _WORDS:
        sentence = re.sub(pattern, word, sentence)
    return as_options(sentence)


# -- the table -------------------------------------------------------------------------------------


_UNDERSTOOD = (
    "a table of steady states has the columns frequency [Hz], force [N], in [V] where that is what"
    " drives, and displacement [m], or velocity, acceleration or response; besides force phase"
    " [deg], displacement phase [deg], displacement 2 [m] and displacement 2 phase [deg] for the"
    " second harmonic, and so on, and spread [m]; of sweeps, known by amplitude, sweep rate [Hz/s],"
    " negative where the frequency falls"
)
_NAME = re.compile(  # a frequency has no phase, and of a force one harmonic is known
    r"(?!(?:frequency|spread|sweep)\b.* phase|(?:frequency|spread|sweep rate|force) [1-9])"
    rf"(?P<what>frequency|force|spread|sweep rate|response|{'|'.join(QUANTITIES)})"
    r"(?P<number> [1-9]\d*)?(?: amplitude)?(?P<phase> phase)?"
)
# Where no word says of what, it is the response.
_ALSO = {"amplitude": "response", "phase": "response phase"}
_ROUNDING = 1e-9  # of a force
_COLUMNS = ("frequency", "force", "response", "spread", "rate")
_TURNS = {"Hz": 2 * np.pi, "rad/s": 1.0}
_RATES = {"Hz/s": 2 * np.pi, "rad/s^2": 1.0}
_ANGLES = {"deg": np.pi / 180, "rad": 1.0}
Key = tuple[str, int, bool]  # what, number of the harmonic, whether its phase


@dataclass(frozen=True, eq=False)
class SteadyTable:
    """Steady states as `romsindy.fit.steady.fit.fit_steady` takes them."""

    frequency: Array  # (n,), angular, rad/s
    # (n,), amplitude of the excitation in N, or in another unit as measured; complex with its phase
    force: NDArray
    response: NDArray  # (n,) or (n, H), harmonics in SI units, complex with their phases
    spread: Array | None  # (n,), standard deviation of real and imaginary part of the response
    quantity: Quantity  # "displacement", "velocity" or "acceleration"
    unit: str | None  # of q
    force_unit: str | None
    rate: Array | float | None  # of sweeps, rad/s^2; of every row with its sign

    def swept(self, hz: float | None) -> SteadyTable:
        """The same as sweeps of one rate, Hz/s, if there is one.

        Raises a ValueError if the table has rates of its own.
        """
        if hz is None:
            return self
        if self.rate is not None:
            raise ValueError(
                f"sweep_rate = {hz:g}, and there is a column 'sweep rate': leave out one of them"
            )
        return replace(self, rate=2 * np.pi * hz)

    @classmethod
    def read(cls, path: Path, quantity: Quantity | None = None, lag: bool = False) -> SteadyTable:
        """Read a table from a file; ``lag`` is whether a phase is positive where it is late.

        Raises a FileNotFoundError if there is no such file, and a ValueError if a column is not
        understood, stands twice, is missing, or has another unit.
        """
        if not path.is_file():
            raise FileNotFoundError(f"{path}: no such file")
        columns = _known(reader_of(path)(path).columns)
        what = _response(columns)
        name: Quantity = quantity or _quantity(what, columns[what, 1, False])
        unit, factor = conversion(columns[what, 1, False], None, name)
        spread = columns.get(("spread", 1, False))
        force, rate = columns["force", 1, False], ("sweep rate", 1, False)
        amplitude = force_unit(force.unit or "")
        harmonics = [
            _complex(columns, what, n, -1 if lag else 1)
            * conversion(columns[what, n, False], None, name)[1]
            for n in _numbers(columns, what)
        ]
        return cls(
            frequency=_scaled(columns["frequency", 1, False], _TURNS),
            force=_complex(columns, "force", 1, 1) * (amplitude[1] if amplitude else 1.0),
            response=harmonics[0] if len(harmonics) == 1 else np.stack(harmonics, axis=1),
            spread=None if spread is None else spread.values * _factor(spread, name, factor),
            quantity=name,
            unit=unit,
            force_unit=amplitude[0] if amplitude else force.unit,
            rate=_scaled(columns[rate], _RATES) if rate in columns else None,
        )

    def within(self, low: float, high: float) -> SteadyTable:
        """The points whose force has an amplitude from low to high.

        Raises a ValueError if there are none.
        """
        size = np.abs(self.force)
        some = (size >= low * (1 - _ROUNDING)) & (size <= high * (1 + _ROUNDING))
        if not np.any(some):
            raise ValueError(
                f"no point has a force from {low:g} to {high:g} {self.force_unit or ''}, for those"
                f" of the table are {size.min():.4g} to {size.max():.4g}: give another --force"
            )
        columns = {name: getattr(self, name) for name in _COLUMNS}
        return replace(self, **{n: x[some] for n, x in columns.items() if x is not None})

    def picked(self, whole: SteadyTable, low: float, high: float) -> str:
        """What was used of a table, in a sentence."""
        used, every = len(self.frequency), len(whole.frequency)
        return (
            f"{used} of {every} steady states are used, under {low:g} to {high:g}"
            f" {self.force_unit or 'of its unit'}; {every - used} are left out."
        )


def _parts(name: str) -> re.Match[str] | None:
    """What a name says, however its words are joined; None where it is not understood."""
    words = " ".join(re.split(r"[\s_]+", name.strip().lower()))
    return _NAME.fullmatch(_ALSO.get(words, words))


def _known(columns: list[Column]) -> Mapping[Key, Column]:
    """Columns by what they hold."""
    found: dict[Key, Column] = {}
    for given in columns:
        column, parts = given, _parts(given.name)
        if parts is None:  # names of MATLAB hold no brackets
            name, _, unit = given.name.strip().rpartition("_")
            column, parts = replace(given, name=name, unit=given.unit or unit), _parts(name)
        if parts is None:
            raise ValueError(f"the column {given.name!r} is not understood: {_UNDERSTOOD}")
        key = (parts["what"], int(parts["number"] or 1), bool(parts["phase"]))
        if key in found:
            raise ValueError(
                f"the columns {found[key].name!r} and {column.name!r} hold the same: leave out one"
            )
        found[key] = column
    for what in ("frequency", "force"):
        if (what, 1, False) not in found:
            raise ValueError(f"there is no column {what!r}: {_UNDERSTOOD}")
    return found


def _response(columns: Mapping[Key, Column]) -> str:
    """The name under which the response stands."""
    names = {what for what, _, _ in columns} - {"frequency", "force", "spread", "sweep rate"}
    if len(names) > 1:
        raise ValueError(f"{' and '.join(sorted(names))} are two responses: leave out one")
    name = next(iter(names), "response")
    if (name, 1, False) not in columns:
        raise ValueError(f"there is no column of the response, such as {name!r}: {_UNDERSTOOD}")
    return name


def _quantity(name: str, column: Column) -> Quantity:
    """What the response measures, as its unit or its name says it."""
    if column.quantity is None:
        raise ValueError(
            f"nothing says what the column {column.name!r} measures: call it displacement, velocity"
            " or acceleration, or give quantity="
        )
    return column.quantity


def _numbers(columns: Mapping[Key, Column], what: str) -> range:
    """Numbers of the harmonics, which stand without a gap."""
    numbers = sorted({n for name, n, _ in columns if name == what})
    if missing := [n for n in range(1, numbers[-1] + 1) if (what, n, False) not in columns]:
        raise ValueError(
            f"there is no column '{what} {missing[0]}' for that harmonic: {_UNDERSTOOD}"
        )
    return range(1, numbers[-1] + 1)


def _complex(columns: Mapping[Key, Column], what: str, n: int, sign: int) -> NDArray:
    """Amplitudes, with their phases where those stand beside them."""
    amplitude, phase = columns[what, n, False], columns.get((what, n, True))
    values = np.asarray(amplitude.values, float)
    if np.any(values < 0):
        least = f"the column {amplitude.name!r} holds {values.min():g}"
        raise ValueError(f"{least}: amplitudes are not negative, half a turn is a phase of 180 deg")
    return values if phase is None else values * np.exp(sign * 1j * _scaled(phase, _ANGLES))


def _scaled(column: Column, units: Mapping[str, float]) -> Array:
    unit = column.unit or "none"
    if unit not in units:
        known = " or ".join(f"[{u}]" for u in units)
        raise ValueError(f"the column {column.name!r} has the unit {unit}: give {known}")
    return np.asarray(column.values, float) * units[unit]


def _factor(column: Column, quantity: Quantity, usual: float) -> float:
    """To SI units, those of the response where the column names none."""
    return usual if column.unit is None else conversion(column, None, quantity)[1]
