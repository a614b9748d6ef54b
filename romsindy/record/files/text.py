"""CSV and other text in its many dresses: separators, decimal commas, headers, time stamps.

Tables that one program writes: workbooks of Excel, XY reports of Abaqus (.rpt), LVM of LabVIEW.

A workbook is read as the text that Excel would save it as. In a report, tables follow a line that
begins with X, the time; a curve without a value there has NoValue. LVM is text: a header, then
segments with headers of their own.
"""

from __future__ import annotations

import codecs
import datetime
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from itertools import islice, takewhile
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np

from romsindy.record.files.columns import (
    COMMENTS,
    FEW,
    Column,
    Table,
    columns_of,
    is_stamp,
    library,
    named,
    pattern_of,
    rate_in,
    reader,
    refused,
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

    def plain(self, line: str) -> str:
        """A row with decimal points, and e before the exponent."""
        if any("d" in cell.lower() for cell in self.example):  # exponents, as in 1.5D-03
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


def read_xlsx(path: Path) -> Table:
    """Columns of the longest sheet of a workbook.

    Raises a ValueError if it is broken, or openpyxl is not installed; or as for text, the line
    being the row.
    """
    openpyxl = library("openpyxl", path)
    with refused(path, "XLSX"):
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        sheets = {
            sheet.title: ["\t".join(map(_text, row)) for row in sheet.iter_rows(values_only=True)]
            for sheet in book.worksheets
        }
        book.close()
        name = max(sheets, key=lambda title: len(sheets[title]))
    table = parse(path, StringIO("\n".join(sheets[name])))
    return Table(table.columns, table.rate, (*table.notes, f"sheet {name!r}"))


def _text(cell: Any) -> str:
    if isinstance(cell, datetime.timedelta):
        return repr(cell.total_seconds())
    if isinstance(cell, (datetime.datetime, datetime.date, datetime.time)):
        return cell.isoformat()
    return "" if cell is None else " ".join(str(cell).split())


_MISSING = "NoValue"


def read_abaqus(path: Path) -> Table:
    """The curves of all tables, each with the times of its table; of any other .rpt as of text.

    Abaqus writes the end of one step and the beginning of the next: the same row twice. It is taken
    once.
    """
    with path.open(encoding="utf-8", errors="replace") as stream:
        tables = list(_tables(stream))
    if not tables:
        return read(path)
    columns, repeated = [], 0
    for names, values in tables:
        once = np.concatenate([[True], np.any(values[1:] != values[:-1], axis=1)])
        repeated += int(np.count_nonzero(~once))
        t, *curves = values[once].T
        columns += [named(n, x, t=t) for n, x in zip(names[1:], curves, strict=True)]
    note = f"{repeated} rows that repeat the one before are left out: ends of steps"
    return Table(columns, notes=(note,) if repeated else ())


def _tables(lines: Iterable[str]) -> Iterator[tuple[list[str], Array]]:
    """Names and numbers, X first, of every table with a row at least."""
    head: list[str] = []
    rows: list[list[float]] = []
    for line in (*lines, "X"):  # the last one ends the table before
        cells = line.split()
        if cells[:1] == ["X"]:
            if rows:
                yield _names(head, len(rows[0])), np.array(rows)
            head, rows = [line], []
        elif head and (numbers := _numbers(cells)):
            if not rows or len(numbers) == len(rows[0]):
                rows.append(numbers)
        elif head and cells and not rows:
            head.append(line)


def _numbers(cells: list[str]) -> list[float]:
    """A row of numbers; empty where it is none, such as the least and largest below a table."""
    try:
        return [np.nan if cell == _MISSING else float(cell) for cell in cells]
    except ValueError:
        return []


def _names(head: list[str], width: int) -> list[str]:
    """Of the columns: what stands below a name, at its place, goes on with it."""
    found = [(m.start(), m[0]) for m in re.finditer(r"\S+(?: \S+)*", head[0])]
    for line in head[1:]:
        for m in re.finditer(r"\S+(?: \S+)*", line):
            i = int(np.argmin([abs(start - m.start()) for start, _ in found]))
            found[i] = (found[i][0], f"{found[i][1]} {m[0]}")
    names = [name for _, name in found]
    return names if len(names) == width else [str(i + 1) for i in range(width)]


_Keys = dict[str, list[str]]  # of a header: what it says of every channel


class _Segment(NamedTuple):
    """One channel in one segment; it began at a time of day."""

    name: str
    unit: str
    t: Array
    values: Array
    begin: str


def read_lvm(path: Path) -> Table:
    """Channels of an LVM file; segments follow each other in time.

    Raises a ValueError if it is broken or cut off, or its segments have different channels or no
    order in time.
    """
    with refused(path, "LVM"), path.open(encoding="utf-8-sig", errors="replace") as lines:
        start = list(takewhile(_is_header, lines))
        separator = next((line[9] for line in start if line.startswith("Separator")), "\t")
        segments = list(_segments(lines, _keys(start, separator), separator))
        if len({tuple(part.name for part in parts) for parts in segments}) != 1:
            raise ValueError(f"{len(segments)} segments, not of the same channels: split the file")
        return Table([_joined(parts) for parts in zip(*segments, strict=True)])


def _is_header(line: str) -> bool:
    return not line.startswith("***End_of_Header***")


def _keys(header: Sequence[str], separator: str) -> _Keys:
    rows = [line.rstrip("\r\n").split(separator) for line in header]
    return {cells[0].strip(): cells[1:] for cells in rows if len(cells) > 1}


class _SegmentRows:
    """Rows of one segment; ``after`` is the first line of the next header."""

    def __init__(self, lines: Iterator[str], decimal: str) -> None:
        self.lines, self.decimal, self.after = lines, decimal, ""

    def __iter__(self) -> Iterator[str]:
        for line in self.lines:
            if line.startswith("Channels"):
                self.after = line
                return
            if line.strip():
                yield line.replace(self.decimal, ".")


def _segments(lines: Iterator[str], file: _Keys, separator: str) -> Iterator[list[_Segment]]:
    decimal = file.get("Decimal_Separator", ["."])[0] or "."
    kind = file.get("X_Columns", ["One"])[0]
    head = next((line for line in lines if line.startswith("Channels")), "")
    while head:
        header = [head, *takewhile(_is_header, lines)]
        keys = _keys(header, separator)
        keys |= {k: [v.replace(decimal, ".") for v in keys[k]] for k in ("X0", "Delta_X")}
        names = next(lines).rstrip("\r\n").split(separator)
        rows, n = _SegmentRows(lines, decimal), int(keys["Channels"][0])
        used = range(1, n + 1) if kind == "No" else range(2 * n if kind == "Multi" else n + 1)
        values = np.loadtxt(
            iter(rows),
            delimiter=separator,
            usecols=used,
            converters=number_or_nothing,
            comments=None,
            ndmin=2,
        )
        table = dict(zip(used, values.T, strict=True))
        pairs = [(2 * k, 2 * k + 1) if kind == "Multi" else (0, k + 1) for k in range(n)]
        yield [_part(k, names[y], keys, table.get(x), table[y]) for k, (x, y) in enumerate(pairs)]
        head = rows.after


def _part(k: int, name: str, keys: _Keys, x: Array | None, values: Array) -> _Segment:
    said = {key: cells[k].strip() for key, cells in keys.items() if k < len(cells)}
    values = values[: np.flatnonzero(np.isfinite(values)).max(initial=-1) + 1]
    samples = int(said.get("Samples") or 0)  # of a packet; several may follow one header
    if samples and len(values) % samples:
        raise ValueError(f"damaged: {len(values)} samples in packets of {samples}")
    step = float(said["Delta_X"])
    t = float(said["X0"]) + step * np.arange(len(values))
    if x is not None and not (step > 0 and np.allclose(x[: len(t)], t, rtol=0, atol=step / 2)):
        t = x[: len(t)]  # else those are the same times, rounded
    begin = f"{said.get('Date', '')} {said.get('Time', '')}".strip()
    return _Segment(name, said.get("Y_Unit_Label", ""), t, values, begin)


def _joined(parts: Sequence[_Segment]) -> Column:
    """One channel over all segments, whose times may begin at zero again."""
    t = [parts[0].t]
    for part in parts[1:]:
        later = 0.0
        if part.t[0] <= t[-1][-1] and part.begin:
            clock = reader(parts[0].begin)
            later = clock(part.begin) - clock(parts[0].begin)
        if part.t[0] + later <= t[-1][-1]:
            raise ValueError("a segment begins before the end of the one above: split the file")
        t.append(part.t + later)
    values = np.concatenate([part.values for part in parts])
    return named(parts[0].name, values, parts[0].unit, t=np.concatenate(t))
