"""Excel workbooks, read by openpyxl as the text that Excel would save them as."""

from __future__ import annotations

import datetime
from io import StringIO
from pathlib import Path
from typing import Any

from romsindy.record.files.columns import Table, library, refused
from romsindy.record.files.text import parse


def read(path: Path) -> Table:
    """Columns of the longest sheet of a workbook.

    Raises
    ------
    ValueError
        If it is broken, or openpyxl is not installed; or as for text, the line being the row.
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
