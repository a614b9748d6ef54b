"""Tables and numbers as text, alike on the command line, in pages and in what prints itself."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

from tqdm import tqdm

# Arguments of Python that are options of commands, and the names of those that differ.
_ARGUMENTS = (
    "start end unit quantity column lever channel time rate mode band release fixed amplitude name"
    " input_column input_unit curvature gain slope phase ccx store reach"
)
_OPTIONS = {"channel": "column", "fixed": "fix", "reach": "range"}
_OPTIONS |= {"input_column": "input-column", "input_unit": "unit-input"}
_ARGUMENT = re.compile(
    rf"""(?<![\w.=-])({_ARGUMENTS.replace(" ", "|")})(?:=|[ ]=[ ](?='))"""
    r"""(?:'([^']*)'|([^\s'",;:()]*[^\s'",;:().]))?"""
)
_FIXED = re.compile(r"\bfixed\['([^']+)'\] = ")  # as a message names a known coefficient
_LARGE = 1e7  # from here on numbers are written with an exponent
_LEAST_PERCENT = 1e-4  # a part in a million: no test tells less
_PREFIXES = {-1: "m", -2: "u", -3: "n", -4: "p"}


class TextTable(NamedTuple):
    """Rows of text, the first of them the header, under a title and above a note."""

    title: str
    rows: Sequence[Sequence[str]]
    note: str = ""


class Shown(NamedTuple):
    """How amplitudes of the coordinate are told: in its unit, or as what a sensor reads."""

    unit: str = "[q]"
    per_q: float = 1.0
    sensor: str = ""

    def told(self, *amplitudes: float) -> str:
        """One amplitude of the coordinate, or a range of them."""
        sizes = " to ".join(two_digits(self.per_q * a) for a in amplitudes)
        return f"{sizes} {self.unit}{self.at}"

    @property
    def at(self) -> str:
        """Which sensor, in words."""
        return f" at {self.sensor}" if self.sensor else ""


def aligned(rows: Sequence[Sequence[str]], indent: str = "") -> str:
    """A table as text, numbers to the right and words to the left; the first row is the header."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    numbers = columns_of_numbers(rows)
    lines = []
    for row in rows:
        cells = [
            cell.rjust(width) if number else cell.ljust(width)
            for cell, width, number in zip(row, widths, numbers, strict=True)
        ]
        lines.append((indent + "  ".join(cells)).rstrip())
    return "\n".join(lines)


def as_text(table: TextTable) -> str:
    """A table under its title and above its note, set in by two spaces."""
    lines = [f"{table.title}:", aligned(table.rows, "  "), f"  {table.note}" if table.note else ""]
    return "\n".join(filter(None, lines))


def columns_of_numbers(rows: Sequence[Sequence[str]]) -> list[bool]:
    """Which columns hold mostly numbers below the header: "0.1", "0.1 to 0.2", "36 (fixed)"."""
    columns = [
        [c for c in column[1:] if c not in ("", "-", "–")] for column in zip(*rows, strict=True)
    ]
    return [2 * sum(map(_starts_with_a_number, cells)) > len(cells) for cells in columns]


def _starts_with_a_number(cell: str) -> bool:
    try:
        float(cell.split(maxsplit=1)[0])
    except (IndexError, ValueError):
        return False
    return True


def percent(part: float) -> str:
    """A part of something in per cent, to two digits; what rounding leaves is no number."""
    size = 100 * part
    if not math.isfinite(size):
        return "no end of %"
    if 0 < abs(size) < _LEAST_PERCENT:
        return f"less than {_LEAST_PERCENT:g} %"
    return f"{two_digits(size)} %"


def left_over(part: float, times: float) -> str:
    """What is left: as a part of the response, and what that is over the noise."""
    return f"{percent(part)} of the response, {float(f'{times:.3g}'):.10g} times the noise"


def two_digits(value: float) -> str:
    """A number to two digits, without an exponent where it is not very small or large."""
    return f"{float(f'{value:.2g}'):.10g}" if math.isfinite(value) else "no end of"


def with_error(value: float, error: float) -> list[str]:
    """A value to the digits that its error leaves, and the error with two digits."""
    if not 1e-4 <= abs(value) < _LARGE:
        return [f"{value:.4g}", f"{error:.2g}"]
    return [f"{value:.{_decimals(error, value)}f}", f"{error:.2g}"]


def with_band(value: float, low: float, high: float) -> list[str]:
    """A value and its 95 % interval, to the digits that this leaves."""
    error = (high - low) / 4
    n = _decimals(error, value)
    if abs(value) >= _LARGE and error > 0:  # digits that the band does not leave would be shown
        digits = min(max(math.floor(math.log10(abs(value) / error)) + 2, 2), 9)
        return [f"{value:.{digits}g}", f"{low:.{digits}g} to {high:.{digits}g}"]
    return [f"{value:.{n}f}", f"{low:.{n}f} to {high:.{n}f}"]


def _decimals(error: float, value: float) -> int:
    """Decimals that show two digits of an error, but no more than nine of the value."""
    most = 8 - math.floor(math.log10(abs(value))) if value else 6
    wanted = 1 - math.floor(math.log10(error)) if 0 < error < math.inf else most
    return max(min(wanted, most, 12), 0)


def quantity(value: float, unit: str) -> str:
    """A number with its SI unit to three digits: "0.33 mm"; plain where the unit is not known."""
    size = abs(value)
    if not unit.startswith(("m", "rad")) or not 1e-12 <= size < 1:
        return f"{value:.3g} {unit}"
    step = math.floor(math.log10(size) / 3 + 1e-9)
    return f"{value / 1000.0**step:.3g} {_PREFIXES[step]}{unit}"


def span(first: float, last: float, digits: int) -> str:
    """Two numbers as "0.35 to 0.40", or one where they are alike; "?" for NaN."""
    ends = ["?" if math.isnan(x) else f"{x:#.{digits}g}".rstrip(".") for x in (first, last)]
    return " to ".join(dict.fromkeys(ends))


def counted(count: int, one: str, many: str) -> str:
    """A number of things: "1 sample is", "2 samples are"."""
    return f"{count} {one if count == 1 else many}"


def listed(words: Sequence[object], conjunction: str = "and") -> str:
    """Words as in a sentence: "1, 2 and 3"."""
    *most, last = map(str, words)
    return f"{', '.join(most)} {conjunction} {last}" if most else last


def on_terminal() -> bool:
    """Whether somebody watches the error stream: in a pipe, progress is a heap of lines."""
    return sys.stderr.isatty()


class _Bar(tqdm):
    """A progress bar that tells an interruption where it came, whether or not it is shown."""

    def __init__(self, steps: Any, what: str, **settings: Any) -> None:
        super().__init__(steps, desc=what, leave=False, disable=not on_terminal(), **settings)
        self.what, self.stage = what, ""

    def set_postfix_str(self, s: str = "", refresh: bool = True) -> None:
        self.stage = s
        super().set_postfix_str(s, refresh)

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, KeyboardInterrupt) and not error.args:
            error.args = (f"while {self.what}" + (f" ({self.stage})" if self.stage else ""),)
        super().__exit__(kind, error, trace)


def bar(steps: Any, what: str, total: int | None = None, *, unit: str = "it") -> Any:
    """A progress bar on the error stream; none where that is no terminal.

    As a context it tells a KeyboardInterrupt that comes within it what was done: "while `what`".
    """
    return _Bar(steps, what, total=total, unit=unit)


def as_options(sentence: str) -> str:
    """Arguments of Python as options: "cut it with start=1.25" becomes "with --start 1.25"."""

    def option(found: re.Match[str]) -> str:
        name, quoted, plain = found.groups()
        value = quoted if quoted is not None else plain
        words = f"'{value}'" if value and " " in value else value
        return f"--{_OPTIONS.get(name, name)}" + (f" {words}" if words else "")

    return _ARGUMENT.sub(option, _FIXED.sub(r"--fix \1=", sentence))
