"""Columns and tables: what every reader of a kind of file hands over."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romsindy.record.recording import Quantity
from romsindy.record.units import TIMES, UNITS, spelled
from romsindy.typing import Array

_TIME_WORDS = {"time", "times", "timestamp", "zeit", "temps", "tiempo", "tempo", "seconds"}
_TIME_WORDS |= {"tout"}  # of Simulink
_TIME_NAMES = {
    **dict.fromkeys(("millis", "milliseconds", "msec"), "ms"),
    **dict.fromkeys(("micros", "microseconds", "usec"), "us"),
}
# Alone they name a column; among other words they name anything.
_LETTERS: dict[str, Quantity] = {"v": "velocity", "a": "acceleration"}
_WORDS: dict[str, Quantity] = {
    **dict.fromkeys(("vel", "velo", "velocity", "speed", "xdot", "qdot"), "velocity"),
    **dict.fromkeys(("acc", "accel", "acceleration", "xddot", "qddot"), "acceleration"),
    **dict.fromkeys(("disp", "displacement", "deflection", "position"), "displacement"),
    **dict.fromkeys(("geschwindigkeit", "vitesse"), "velocity"),
    **dict.fromkeys(("beschleunigung",), "acceleration"),
    **dict.fromkeys(("weg", "auslenkung"), "displacement"),
}
_UNSAFE_SUFFIXES = {"in"}  # of "sensor_in": an input rather than inches


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a file."""

    name: str  # without its unit
    values: NDArray  # (n,), numbers of any real type, as they are in the file
    # What the file says, in the spelling of `UNITS` where it is one of them
    unit: str | None = None
    # "displacement", "velocity" or "acceleration", optional: the quantity, where the kind of file
    # has a code for it
    said: Quantity | None = None
    t: Array | None = None  # (n,), times in s, where the kind of file gives every channel its own
    counted: bool = False  # whether a letter counts columns, such as "a" beside "b"
    damage: str = ""  # where a value is missing in the file, and the remedy

    @property
    def is_time(self) -> bool:
        """Whether name or unit say that it holds times."""
        if self.unit in TIMES or self.unit in UNITS:
            return self.unit in TIMES
        return _last(self.name).lower() == "t" or any(w in _TIME_WORDS for w in _words(self.name))

    @property
    def is_motion(self) -> bool:
        """Whether its unit, if it has one, is one of motion."""
        return self.unit is None or self.unit in UNITS

    @property
    def quantity(self) -> Quantity | None:
        """What it measures as unit, code or name have it; None where nothing says it."""
        if self.unit in UNITS:
            return UNITS[self.unit].quantity
        return self.said or (None if self.counted else _quantity_of_name(self.name))

    @property
    def basis(self) -> str:
        """What quantity and unit rest on."""
        if self.unit is not None:
            return f"header '{self.name} [{self.unit}]'"
        if self.said:
            return f"the file's code for {self.said}"
        return (
            f"name {self.name!r}" if self.quantity else "assumed, for nothing in the file says it"
        )


@dataclass(frozen=True, eq=False)
class Table:
    """What a file holds."""

    columns: list[Column]  # not always of one length
    # Samples per second, where the file names them outside of its columns
    rate: float | None = None
    notes: tuple[str, ...] = ()  # what was done to read it
    doubt: str = ""  # why its numbers may be wrong, which is said unless the times already show it


def _last(name: str) -> str:
    """Of the path to an array in a struct or a group."""
    return re.split(r"\.(?=\w)", name)[-1]


def _words(name: str) -> list[str]:
    return re.findall(r"[^\W\d_]+", name.lower())


def _quantity_of_name(name: str) -> Quantity | None:
    words = _words(_last(name).replace("_dot", "dot").replace("_ddot", "ddot"))
    if words and words[0] in _LETTERS and len(words) == 1:
        return _LETTERS[words[0]]
    return next((_WORDS[word] for word in words if word in _WORDS), None)


def named(header: str, values: NDArray, unit: str | None = None, **more: Any) -> Column:
    """The column under a header such as "q [mm]", "tip (mm)" or "acc_g".

    >>> import numpy as np
    >>> [named(h, np.zeros(1)).unit for h in ("q [mm/sec]", "tip (mm)", "acc_g", "F_N", "q")]
    ['mm/s', 'mm', 'g', None, None]
    """
    header = header.strip()
    bracket = re.fullmatch(r"(.*?)\s*(\[(?!\d+\])[^\]]*\]|\((?!\d+\))[^)]*\))", header)
    if not unit and bracket and bracket[1]:
        header, unit = bracket[1], bracket[2][1:-1]
    unit = (
        spelled(re.sub(r"^\s*[\[(](.*)[\])]\s*$", r"\1", unit)) if unit and unit.strip() else None
    )
    unit = unit or _TIME_NAMES.get(header.lower())
    suffix = re.fullmatch(r"(.+?)[_ ]([^_ ]+)", header)
    if unit is None and suffix:
        end = spelled(suffix[2])
        is_time = end in TIMES and Column(suffix[1], values).is_time
        unit = end if is_time or (end in UNITS and end not in _UNSAFE_SUFFIXES) else None
    return Column(header, values, unit, **more)


@contextmanager
def refused(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library says of a broken file into one sentence: it may raise anything."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except Exception as error:
        what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise ValueError(f"{path}: not a {kind} file, or a broken one ({what})") from error


def library(module: str, path: Path) -> Any:
    """A library of the extra ``formats``.

    Raises a ValueError if it is not installed; the message says how.
    """
    try:
        return import_module(module)
    except ImportError:
        raise ValueError(
            f"{path}: to read it needs {module}, which is not installed: python -m pip install"
            ' "romsindy[formats]"'
        ) from None


FEW = 3  # rows that do not agree and are taken for damaged; if more, the format varies
_ENOUGH = 8  # rows for one that may be damaged


def pattern_of(rows: Sequence[str], decimal: str) -> re.Pattern[str] | None:
    """What rows match whose numbers all have the same three or more decimals; None if not so.

    A few of them may not, for they are damaged.

    Fewer decimals, and numbers without any, are those of counters or of a sensor at rest.

    >>> pattern = pattern_of(["0.001, -1.2500", "0.002, 11.2500"] * 25, ".")
    >>> [bool(pattern.fullmatch(row)) for row in ("0.003, 9.1234", "0.003, NaN", "0.003, 9.12")]
    [True, True, False]
    """
    sign = re.escape(decimal)
    number = re.compile(rf"[-+]?\d+{sign}(\d{{3,}})(?:e[-+]?(\d+))?", re.IGNORECASE)
    example = rows[len(rows) // 2].strip() if rows else ""
    found = list(number.finditer(example))
    if not found or len(rows) < _ENOUGH:
        return None
    text, end = "", 0
    for match in found:
        exponent = r"e[-+]?\d{2,3}" if match[2] else ""
        text += _between(example[end : match.start()], decimal)
        text += rf"(?:[-+]?\d+{sign}\d{{{len(match[1])}}}{exponent}|[-+]?(?:nan|inf))"
        end = match.end()
    pattern = re.compile(text + _between(example[end:], decimal), re.IGNORECASE)
    odd = sum(not pattern.fullmatch(row.strip()) for row in rows)
    return pattern if odd <= min(FEW, len(rows) // _ENOUGH) else None


def _between(text: str, decimal: str) -> str:
    """Pattern of what is not judged: separators as they are, any other digits between them."""
    apart = r"[\s;]" if decimal == "," else r"[\s,;]"
    cells = re.split(rf"({apart}+)", text)
    return "".join(
        rf"{apart.replace('[', '[^')}*"
        if any(c.isdigit() for c in cell)
        else r"\s*".join(map(re.escape, re.split(r"\s+", cell)))
        for cell in cells
    )


_DATE = r"(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[./]\d{1,2}[./]\d{4})"
_CLOCK = (
    r"(?P<clock>\d{1,2}:\d{2}(?::\d{2})?(?:[.,]\d*)?) ?(?P<half>[AaPp][Mm])?(?:Z|[+-]\d\d:?\d\d)?"
)
_STAMP = re.compile(rf"(?:{_DATE}[T ]*)?(?:{_CLOCK})?")


def is_stamp(cell: str) -> bool:
    """Whether a cell is a date, a time of day, or both.

    >>> [is_stamp(c) for c in ("2024-05-01T12:00:00.5", "1.5.2024", "12:00:00,5", "1.5", "")]
    [True, True, True, False, False]
    """
    return bool(cell.strip()) and _STAMP.fullmatch(cell.strip()) is not None


def reader(first: str) -> Callable[[str], float]:
    """A function from stamps to seconds since midnight of the first one's day.

    Seconds since year 1 would keep no microseconds in a float.

    Raises a ValueError by that function, if a cell is no stamp, or its day cannot be told from the
    first one's.

    >>> read = reader("31.12.2023 23:59:59")
    >>> read("01.01.2024 00:00:00,25"), read("31.12.2023 11:59:59 PM"), read("00:01.5")
    (86400.25, 86399.0, 1.5)
    """
    start = _match(first)["date"]

    @lru_cache
    def slowly(cell: str) -> float:
        found = _match(cell)
        days = _days(start, found["date"]) if found["date"] else 0
        return 86400.0 * days + _of_day(found["clock"] or "0:00", (found["half"] or "").lower())

    def seconds(cell: str) -> float:
        minute, _, tail = cell.strip().rpartition(":")
        if ":" in minute and tail[:2].isdigit() and tail[2:3] == "." and tail[3:].isdigit():
            return slowly(f"{minute}:00") + float(tail)  # once a minute, thousands of samples
        return slowly(cell)

    return seconds


def _match(cell: str) -> re.Match[str]:
    found = _STAMP.fullmatch(cell.strip())
    if found is None or not cell.strip():
        raise ValueError(f"{cell.strip()!r} is no date or time of day")
    return found


def _of_day(clock: str, half: str) -> float:
    parts = [float(part) for part in clock.replace(",", ".").split(":")]
    if len(parts) == 2:  # minutes and seconds if there is a fraction, else hours and minutes
        parts = [0.0, *parts] if "." in clock or "," in clock else [*parts, 0.0]
    hours = parts[0] % 12 + 12 * (half == "pm") if half else parts[0]
    return 3600 * hours + 60 * parts[1] + parts[2]


@lru_cache
def _days(start: str | None, day: str) -> int:
    if start is None:
        raise ValueError(f"{day!r} has a date, and the first row has none")
    return 0 if start == day else _ordinal(day) - _ordinal(start)


def _ordinal(day: str) -> int:
    numbers = [int(part) for part in re.split(r"[-/.]", day)]
    if numbers[0] > 31:
        return date(*numbers).toordinal()
    if "/" in day:
        raise ValueError(f"{day!r}: the day changes, and this may be day/month or month/day")
    return date(*numbers[::-1]).toordinal()


COMMENTS = ("#", "%", "//")
_NONE = np.empty(0)
_NUMBER = r"([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)"
_BETWEEN = r"[\s\"':;=,\t\[\]()]*"
_RATE = re.compile(
    r"(?:^\W*rate|\bsampl\w*[\s_-]*(?:rate|freq\w*)|\babtast(?:rate|frequenz)|\bfs|\bsr)\b"
    + _BETWEEN + r"(k?hz|1/s|s/s)?" + _BETWEEN + _NUMBER + r"\s*(k?hz)?",
    re.IGNORECASE | re.MULTILINE,
)  # fmt: skip
_STEP = re.compile(
    r"(?:\bdt|\bdelta[\s_-]*[tx]|\bsampl\w*[\s_-]*(?:interval|period|time|step)|\btime[\s_-]*step)\b"
    + _BETWEEN + r"(sec|[mun]?s)?" + _BETWEEN + _NUMBER + r"\s*(sec|[mun]?s)?\b",
    re.IGNORECASE,
)  # fmt: skip


def split(line: str, delimiter: str | None) -> list[str]:
    """Cells of a line; None separates by spaces."""
    if delimiter is None:
        return line.split()
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    return [cell.strip() for cell in line.split(delimiter)]


def columns_of(
    above: Sequence[str],
    delimiter: str | None,
    width: int,
    empty: Sequence[int] = (),
    stamps: Sequence[int] = (),
) -> list[Column]:
    """Columns without values, named by the lines above the numbers.

    The names are in the last line that names a time, or else in the last one, of those with a cell
    for every column; below it may be a row of units. Columns that are ``empty``, without numbers,
    need no names at the end; those of ``stamps``, dates and times of day, may share one.

    Raises a ValueError if the line above the numbers has names or units, but of another number of
    columns; or if something that looks like numbers is between names and numbers.
    """
    used = 1 + max(set(range(width)) - set(empty), default=width - 1)

    def fitted(cells: list[str]) -> list[str] | None:
        while len(cells) > width and not cells[-1]:
            cells = cells[:-1]
        if len(cells) < used and len(cells) + len(stamps) - 1 == width:
            cells = cells[: stamps[0] + 1] + [""] * (len(stamps) - 1) + cells[stamps[0] + 1 :]
        return cells + [""] * (width - len(cells)) if used <= len(cells) <= width else None

    rows = []  # of names and units: number of the line, cells
    for i, line in enumerate(above):
        cells = next(filter(None, map(fitted, _splits(line, delimiter))), None)
        if cells and (not _is_comment(line) or any(_says_something(c) for c in cells)):
            rows.append((i, cells))
    _refuse_other_width(above, rows, delimiter, width)
    if not rows:
        return [named(str(k + 1), _NONE) for k in range(width)]
    timed = [k for k, (_, cells) in enumerate(rows) if any(named(c, _NONE).is_time for c in cells)]
    at = timed[-1] if timed else len(rows) - 1
    if not timed and at > 0 and any(map(_is_unit, rows[at][1])):
        at -= 1
    units = rows[at + 1][1] if at + 1 < len(rows) else []
    units = units if any(map(_is_unit, units)) else []
    for i in range(rows[at + bool(units)][0] + 1, len(above)):
        _refuse_broken_row(i, above[i])
    return [
        named(name or str(k + 1), _NONE, unit)
        for k, (name, unit) in enumerate(zip(rows[at][1], units or [""] * width, strict=True))
    ]


def rate_in(above: Sequence[str]) -> float | None:
    """Samples per second that a line such as "Sampling rate: 2 kHz" or "dt = 0.5 ms" names.

    >>> rate_in(["run 7", "Sampling rate [Hz];2000"]), rate_in(["dt = 0,5 ms"])
    (2000.0, 2000.0)
    """
    text = "\n".join(above)
    if found := _RATE.search(text):
        unit = (found[1] or found[3] or "hz").lower()
        value = _number(found[2]) * (1e3 if unit == "khz" else 1.0)
        return value if value > 0 else None
    if found := _STEP.search(text):
        step = _number(found[2]) * TIMES[spelled((found[1] or found[3] or "s").lower())]
        return 1 / step if step > 0 else None
    return None


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def _splits(line: str, delimiter: str | None) -> Iterator[list[str]]:
    """Ways to cut a header, which need not be the way of the numbers."""
    text = re.sub(rf"^\s*({'|'.join(COMMENTS)})+", "", line).strip(" \r\n")
    if delimiter is not None:
        yield split(text, delimiter)
    if delimiter is None or _is_comment(line):
        yield re.findall(r"\S+(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?", text)
        yield [cell.strip() for cell in re.split(r"\s{2,}|\t|[,;]", text)]


def _is_unit(cell: str) -> bool:
    return spelled(cell) in UNITS or spelled(cell) in TIMES


def _says_something(cell: str) -> bool:
    column = named(cell, _NONE)
    return column.is_time or column.unit in UNITS or _is_unit(cell)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _refuse_other_width(
    above: Sequence[str], rows: list[tuple[int, list[str]]], delimiter: str | None, width: int
) -> None:
    """Refuse names right above the numbers that are not as many as those."""
    last = max((i for i, line in enumerate(above) if line.strip()), default=-1)
    if last < 0 or _is_comment(above[last]) or any(i == last for i, _ in rows):
        return
    cells = next(_splits(above[last], delimiter))
    several = len(cells) > 1 and any(map(_says_something, cells))
    if several or any(named(c, _NONE).unit in UNITS for c in cells):
        raise ValueError(
            f"line {last + 1}: names {len(cells)} columns, but the rows below have {width} cells:"
            " mend this line, or the separators and decimal commas of the rows"
        )


def _refuse_broken_row(i: int, line: str) -> None:
    digits, signs = sum(c.isdigit() for c in line), len("".join(line.split()))
    if digits > 0.4 * signs and not _is_comment(line):
        raise ValueError(
            f"line {i + 1}: {line.strip()[:60]!r} is no row of numbers; mend or remove the line"
        )
