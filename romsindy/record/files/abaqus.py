"""XY reports of Abaqus (.rpt): tables of text below a line that begins with X, the time.

Source: files that Abaqus/CAE writes by Report > XY; a curve without a value at a time has NoValue.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from romsindy.record.files import text
from romsindy.record.files.columns import Table, named
from romsindy.typing import Array

_MISSING = "NoValue"


def read(path: Path) -> Table:
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
