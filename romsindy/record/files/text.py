"""CSV and other text in its many dresses: separators, decimal commas, headers, time stamps."""

from __future__ import annotations

import codecs
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from romsindy.record.files.columns import Column, Table
from romsindy.record.files.header import (
    COMMENTS,
    FEW,
    columns_of,
    is_stamp,
    pattern_of,
    rate_in,
    reader,
    split,
)
from romsindy.typing import Array

_HEAD = 500  # lines that are looked at to find the layout
_LONGEST = 100_000  # characters of a line; no table of text has more
_NUMBER = re.compile(r"[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?|nan|inf)", re.IGNORECASE)
# Separator and decimal sign, the better one first where both fit.
_DIALECTS = ((";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (None, "."), (None, ","))


@dataclass(frozen=True)
class Layout:
    """How the numbers of a text file are laid out."""

    delimiter: str | None  # between the cells; None for spaces
    decimal: str  # "." or ","
    first: int  # lines before the first row of numbers
    example: tuple[str, ...]  # cells of that row
    # Columns without anything: an unused channel, a separator at the end of every row
    empty: tuple[int, ...]
    rows: int  # rows that fit, among the first lines of the file
    halves: bool  # whether the separator parts numbers too: commas are decimal signs as well
    pattern: re.Pattern[str] | None  # what every row looks like, where all have the same digits

    @property
    def stamps(self) -> list[int]:
        """Columns of dates and times of day."""
        return [i for i, cell in enumerate(self.example) if is_stamp(cell)]

    @property
    def fortran(self) -> bool:
        """Whether exponents follow a D, as in 1.5D-03."""
        return any("d" in cell.lower() for cell in self.example)

    def plain(self, line: str) -> str:
        """A row with decimal points, and e before the exponent."""
        if self.fortran:
            line = line.replace("D", "e").replace("d", "e")
        if self.decimal == ",":
            if "." in line and not self.stamps:
                raise ValueError("decimal commas and decimal points")
            line = line.replace(",", ".")
        return line


def read(path: Path) -> Table:
    """Columns of a text file.

    Raises a ValueError if it cannot be understood; the message names line, column and remedy.
    """
    with path.open(encoding=_encoding(path), errors="replace") as stream:
        return parse(path, stream)


def parse(source: Path, stream: TextIO) -> Table:
    """Columns of a stream of text that can be rewound.

    Raises a ValueError as `read`.
    """
    head = _head(source, stream)
    layouts = [found for dialect in _DIALECTS if (found := _layout(head, *dialect))]
    if not layouts:
        raise ValueError(
            f"{source}: no line starts with a number: a table is needed, with a time or frequency"
            " and what was measured in every line"
        )
    most = max(layout.rows for layout in layouts)
    layouts = [layout for layout in layouts if layout.rows == most]
    # A single cell may be two numbers that another separator would part.
    layouts.sort(key=lambda layout: (layout.halves, len(layout.example) == 1))
    refusals = []
    for layout in layouts:
        try:
            return _table(layout, head[: layout.first], stream)
        except ValueError as refusal:
            refusals.append(refusal)
    raise ValueError(f"{source}, {refusals[0]}") from refusals[0]


# -- layout -------------------------------------------------------------------------------------


def _encoding(path: Path) -> str:
    with path.open("rb") as file:
        start = file.read(1 << 16)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if start.startswith(b"\xef\xbb\xbf"):
        return "utf-8-sig"
    zeros = [start[k::2].count(0) > 0.3 * len(start) / 2 for k in (0, 1)]
    if any(zeros) and not all(zeros):
        return "utf-16-be" if zeros[0] else "utf-16-le"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return "cp1252"  # Latin-1 as Windows writes it
    return "utf-8"


def _head(source: Path, stream: TextIO) -> list[str]:
    head: list[str] = []
    while len(head) < _HEAD and (line := stream.readline(_LONGEST)):
        if len(line) == _LONGEST or "\0" in line:
            raise ValueError(f"{source}: the content is no table of text: export it as CSV")
        head.append(line)
    if not any(map(_is_content, head)):
        raise ValueError(f"{source}: the file has no lines of data")
    return head


def _is_content(line: str) -> bool:
    start = line.lstrip()
    return start != "" and not start.startswith(COMMENTS)


def _layout(head: list[str], delimiter: str | None, decimal: str) -> Layout | None:
    """The layout by which most lines are rows of numbers, if any are."""
    rows = {}
    for i, line in enumerate(head):
        cells = split(line, delimiter) if _is_content(line) else []
        if any(cells) and all(not c or _is_value(c, decimal) for c in cells):
            rows[i] = cells
    if not rows:
        return None
    width = Counter(map(len, rows.values())).most_common(1)[0][0]
    rows = {i: cells for i, cells in rows.items() if len(cells) == width}
    halves = (delimiter, decimal) == (",", ".") and _are_halves(rows.values())
    first = min(rows)
    empty = tuple(i for i in range(width) if not any(cells[i] for cells in rows.values()))
    pattern = pattern_of([head[i] for i in rows], decimal)
    return Layout(delimiter, decimal, first, tuple(rows[first]), empty, len(rows), halves, pattern)


def _is_value(cell: str, decimal: str) -> bool:
    if is_stamp(cell):
        return True
    if decimal == ",":
        cell = "." if "." in cell else cell.replace(",", ".")
    return _NUMBER.fullmatch(cell) is not None


def _are_halves(rows: Collection[list[str]]) -> bool:
    """Whether a comma parts a number, as in 0,05: no whole number starts with a zero."""
    cells = [cell for row in rows for cell in row]
    after = [cell for row in rows for cell in row[1:]]
    return all(c.lstrip("-").isdigit() for c in cells) and any(
        len(c) > 1 and c.startswith("0") for c in after
    )


# -- numbers ------------------------------------------------------------------------------------


class _DataRows:
    """Rows of numbers of a stream, which remember where they are."""

    def __init__(self, stream: TextIO, layout: Layout) -> None:
        self.stream, self.layout = stream, layout
        self.number, self.line = layout.first, ""
        self.odd: list[tuple[int, str]] = []  # rows of other digits than the rest
        self.holes: dict[int, int] = {}  # first line of every column in which a cell is empty

    def __iter__(self) -> Iterator[str]:
        first, plain, pattern = self.layout.first, self.layout.plain, self.layout.pattern
        for self.number, self.line in enumerate(islice(self.stream, first, None), first + 1):  # noqa: B020
            if pattern and pattern.fullmatch(self.line.strip()):
                yield plain(self.line)
            elif _is_content(self.line):
                lacks = self._lacks()
                if pattern and not lacks and "nan" not in self.line.lower():
                    self.odd.append((self.number, self.line))
                    pattern = pattern if len(self.odd) <= FEW else None
                yield plain(self.line)

    def _lacks(self) -> bool:
        """Whether the row has an empty cell in a column that has numbers."""
        cells = split(self.line.rstrip("\r\n"), self.layout.delimiter)
        if all(cells) or len(cells) != len(self.layout.example):
            return False
        found = [i for i, c in enumerate(cells) if not c and i not in self.layout.empty]
        for i in found:
            self.holes.setdefault(i, self.number)
        return bool(found)


def _table(layout: Layout, above: list[str], stream: TextIO) -> Table:
    if layout.halves:
        raise ValueError(
            f"line {layout.first + 1}: commas part the cells and the numbers within them: save with"
            " decimal points, or with semicolons between the cells"
        )
    width = len(layout.example)
    columns = columns_of(above, layout.delimiter, width, layout.empty, layout.stamps)
    rows, values = _rows_and_values(layout, columns, stream)
    notes = []
    if rows.odd[-1:] == [(rows.number, rows.line.rstrip("\r\n"))]:  # without a line break
        values = values[:-1]
        notes = [f"the last line, {rows.odd.pop()[1][-60:]!r}, is cut off: left out"]
    damage = {i: _empty(columns[i], line) for i, line in rows.holes.items()}
    columns = [
        replace(c, values=v, damage=damage.get(i, ""))
        for i, (c, v) in enumerate(zip(columns, values.T, strict=True))
    ]
    unused = {i for i in layout.empty if np.isnan(values[:, i]).all()}
    others = [c for i, c in enumerate(columns) if i not in {*layout.stamps, *unused}]
    if layout.stamps:
        t = values[:, layout.stamps].sum(axis=1)
        others = [Column(columns[layout.stamps[0]].name, t - t[0], "s"), *others]
        first = " ".join(layout.example[i] for i in layout.stamps)
        notes = [*notes, f"time counted from {first}"]
    return Table(others, rate_in(above), tuple(notes), _doubt(rows))


def _rows_and_values(
    layout: Layout, columns: list[Column], stream: TextIO
) -> tuple[_DataRows, Array]:
    """All rows; where cells are empty nan, once it is clear that some are: that is slower."""
    for empty in (layout.empty, range(len(columns))):
        stream.seek(0)
        rows = _DataRows(stream, layout)
        try:
            return rows, _values(rows, empty)
        except ValueError as error:
            stamped = not rows.holes.keys().isdisjoint(layout.stamps)
            if not rows.holes or stamped or len(empty) == len(columns):
                raise _refusal(rows, columns, error) from None
    raise AssertionError


def _values(rows: _DataRows, empty: Collection[int]) -> Array:
    layout = rows.layout
    converters: dict[int | str, Callable[[str], float]] = {}
    converters |= dict.fromkeys(empty, number_or_nothing)
    converters |= {i: reader(layout.example[i]) for i in layout.stamps}
    return np.loadtxt(
        iter(rows),
        delimiter=layout.delimiter,
        converters=converters or None,
        ndmin=2,
        comments=None,
        quotechar='"',
    )


def _doubt(rows: _DataRows) -> str:
    """What is odd about a row that has other digits than nearly all."""
    if not 0 < len(rows.odd) <= FEW:  # none, or the format changes with the numbers
        return ""
    number, line = rows.odd[0]
    return (
        f"line {number}: {line.strip()[-60:]!r} has other digits than the lines around it, as if"
        " some of them were lost; mend or remove the line"
    )


def number_or_nothing(cell: str) -> float:
    """What a cell holds; nan where it is empty."""
    return float(cell) if cell.strip() else np.nan


def _named(column: Column) -> str:
    return column.name if column.name.isdigit() else repr(column.name)


def _empty(column: Column, line: int) -> str:
    return (
        f"line {line}, column {_named(column)}: the cell is empty; mend the cell or remove the line"
    )


def _refusal(rows: _DataRows, columns: list[Column], found: ValueError) -> ValueError:
    """What is wrong with the line at which reading stopped."""
    layout, line = rows.layout, f"line {rows.number}"
    try:
        cells = split(layout.plain(rows.line), layout.delimiter)
    except ValueError as error:
        return ValueError(f"{line}: {error}; mend the line")
    if len(cells) != len(columns):
        return ValueError(f"{line}: {len(cells)} columns where {len(columns)} are usual")
    for i, (cell, column) in enumerate(zip(cells, columns, strict=True)):
        wanted = "a time stamp like those above" if i in layout.stamps else "a number"
        fits = is_stamp if i in layout.stamps else _NUMBER.fullmatch
        if not fits(cell) and not (i in layout.empty and not cell):
            if not cell:
                return ValueError(_empty(column, rows.number))
            return ValueError(
                f"{line}, column {_named(column)}: {cell!r} is not {wanted}; mend the cell or"
                " remove the line"
            )
    for i in layout.stamps:
        try:
            reader(layout.example[i])(cells[i])
        except ValueError as error:
            return ValueError(f"{line}: {error}")
    return ValueError(f"{line}: {found}")
