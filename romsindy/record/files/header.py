"""What the lines above the numbers of a text file say: names, units, sampling rate."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence

import numpy as np

from romsindy.record.files.columns import Column, named
from romsindy.record.units import TIMES, UNITS, spelled

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
    for every column; below it may be a row of units.

    Parameters
    ----------
    above : sequence of str
        Lines above the numbers.
    delimiter : str or None
        Between the cells; None for spaces.
    width : int
        Number of columns.
    empty : sequence of int
        Columns without numbers; those at the end need no names.
    stamps : sequence of int
        Columns of dates and times of day, which may have one name together.

    Raises
    ------
    ValueError
        If the line above the numbers has names or units, but of another number of columns; or if
        something that looks like numbers is between names and numbers.
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
    timed = [k for k, (_, cells) in enumerate(rows) if _has_time(cells)]
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


def _has_time(cells: Sequence[str]) -> bool:
    return any(named(cell, _NONE).is_time for cell in cells)


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
