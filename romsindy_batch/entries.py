"""Which records a batch has: those of a folder, or those that a table names."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from romsindy.record.files.load import ENDINGS
from romsindy.text import listed

_FILE = "file"  # the column of a table that names records


@dataclass(frozen=True)
class Entry:
    """A record of a batch: its ``name`` in tables, the file, and what a table says of it."""

    name: str
    file: Path
    values: Mapping[str, str] = field(default_factory=dict)  # date, temperature, specimen, ...


@dataclass(frozen=True)
class Entries:
    """All records of a batch, and a sentence on what was left out of a folder."""

    records: Sequence[Entry]
    left_out: str = ""

    @property
    def columns(self) -> list[str]:
        """What the table says of records."""
        return list(dict.fromkeys(name for e in self.records for name in e.values))


def entries_of(source: Path, out: Path) -> Entries:
    """The records of a folder and of those in it, or of a table with a column "file".

    Files in a table are meant from the folder of the table on. What stands in ``out`` is no record.

    Raises a ValueError if there is no record, or the table has no such column.
    """
    return _in_folder(source, out) if source.is_dir() else _in_table(source)


def _in_folder(folder: Path, out: Path) -> Entries:
    files = sorted(f for f in folder.rglob("*") if f.is_file() and not _hidden(f, folder))
    files = [f for f in files if out.resolve() not in f.resolve().parents]
    records = [f for f in files if f.suffix.lower() in ENDINGS]
    others = Counter(f.suffix.lower() or f.name for f in files if f not in set(records))
    if not records:
        raise ValueError(f"{folder} holds no record: name a folder with {', '.join(ENDINGS)} files")
    kinds = listed([f"{n} {kind}" for kind, n in others.most_common()]) if others else ""
    found = [Entry(str(f.relative_to(folder)), f) for f in records]
    return Entries(found, f"Left out, for they are no records: {kinds}." if kinds else "")


def _hidden(file: Path, folder: Path) -> bool:
    return any(part.startswith(".") for part in file.relative_to(folder).parts)


def _in_table(table: Path) -> Entries:
    header, *rows = _rows(table)
    if _FILE not in header:
        raise ValueError(
            f"{table}: no column is called {_FILE!r}, there are {', '.join(header)}: name the"
            f" column of the records so, or analyse one record with romsindy identify {table}"
        )
    records = []
    for number, row in enumerate(rows, 2):
        values = dict(zip(header, row, strict=False))
        name = values.pop(_FILE, "")
        if not name:
            raise ValueError(f"{table}: row {number} names no file: fill it in, or delete the row")
        records.append(Entry(name, table.parent / name, values))
    twice = [name for name, n in Counter(e.name for e in records).items() if n > 1]
    if twice:
        raise ValueError(f"{table} names {listed(twice)} twice: give each record one row")
    if not records:
        raise ValueError(f"{table} names no record: write one file in each row below the header")
    return Entries(records)


def _rows(table: Path) -> list[list[str]]:
    """Rows of text; of a sheet, the first one."""
    if table.suffix.lower() in (".xlsx", ".xlsm"):
        from openpyxl import load_workbook  # an extra, as to read records in such files

        sheet = load_workbook(table, read_only=True, data_only=True).worksheets[0]
        cells = ([_text(value) for value in row] for row in sheet.iter_rows(values_only=True))
    else:
        text = table.read_text(encoding="utf-8-sig")
        first = text.partition("\n")[0]
        delimiter = max(",;\t", key=first.count)
        cells = (
            [x.strip() for x in row] for row in csv.reader(text.splitlines(), delimiter=delimiter)
        )
    rows = [row for row in cells if any(row)]
    if not rows:
        raise ValueError(f"{table} is empty: write a header with {_FILE!r}, then a row a record")
    return rows


def _text(value: object) -> str:
    return "" if value is None else str(value).removesuffix(" 00:00:00").strip()
