"""Tables that one program writes: workbooks of Excel, XY reports of Abaqus (.rpt), LVM of LabVIEW.

A workbook is read as the text that Excel would save it as. In a report, tables follow a line that
begins with X, the time; a curve without a value there has NoValue. LVM is text: a header, then
segments with headers of their own.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Iterator, Sequence
from io import StringIO
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from romsindy.record.files import text
from romsindy.record.files.columns import Column, Table, library, named, refused
from romsindy.record.files.header import reader
from romsindy.typing import Array


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
    table = text.parse(path, StringIO("\n".join(sheets[name])))
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
        return text.read(path)
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
            converters=text.number_or_nothing,
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
