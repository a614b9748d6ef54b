"""The table of a batch as files: CSV, and XLSX and Parquet where what writes them is installed."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from romsindy.record.files.save import whole

Rows = Sequence[Mapping[str, Any]]


def _csv(rows: Rows, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _xlsx(rows: Rows, path: Path) -> None:
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    sheet = book.create_sheet("batch")
    sheet.append(list(rows[0]))
    for row in rows:
        sheet.append(list(row.values()))
    book.save(path)


def _parquet(rows: Rows, path: Path) -> None:
    from pyarrow import Table, parquet

    parquet.write_table(Table.from_pylist([dict(row) for row in rows]), path)


_KINDS: dict[str, tuple[str, Callable[[Rows, Path], None]]] = {
    ".csv": ("csv", _csv),
    ".xlsx": ("openpyxl", _xlsx),
    ".parquet": ("pyarrow", _parquet),
}


def write_tables(rows: Rows, folder: Path) -> list[Path]:
    """Write ``table`` of each kind whose package is installed; return the paths.

    Raises an OSError if one cannot be written.
    """
    paths = []
    for ending, (package, write) in _KINDS.items():
        if find_spec(package) is not None:
            path = folder / f"table{ending}"
            with whole(path) as new:
                write(rows, new)
            paths.append(path)
    return paths
