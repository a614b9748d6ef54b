"""What the chapters of the study are made of: tables, pictures and checks."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from romsindy.record.files.save import whole
from romsindy.show.page import Picture

Cell = str | float | None


@dataclass(frozen=True)
class Table:
    """Numbers with a header: None for what does not exist, nan for a model without motion.

    The name is that of the CSV file; the note says what the numbers mean.
    """

    name: str
    title: str
    note: str
    header: Sequence[str]
    rows: Sequence[Sequence[Cell]]

    def formatted(self) -> list[list[str]]:
        """Rows of text for the report."""
        return [[_text(cell) for cell in row] for row in self.rows]

    def write_csv(self, folder: Path) -> Path:
        """Write full precision to ``folder/name.csv``."""
        path = folder / f"{self.name}.csv"
        with whole(path) as new, new.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([self.header, *self.rows])
        return path


def _text(cell: Cell) -> str:
    if cell is None:
        return "–"
    if isinstance(cell, str):
        return cell
    return "no motion" if math.isnan(cell) else f"{cell:.4g}"


@dataclass(frozen=True)
class Check:
    """A number with what is expected of it: at most, or above, its bound."""

    what: str
    measured: float
    bound: float
    unit: str = "%"
    at_most: bool = True

    @property
    def passed(self) -> bool:
        """Whether the number keeps its bound; nan does not."""
        return self.measured <= self.bound if self.at_most else self.measured > self.bound

    @property
    def expected(self) -> str:
        """The bound in words."""
        return f"{'at most' if self.at_most else 'above'} {self.bound:g} {self.unit}"


@dataclass(frozen=True)
class Chapter:
    """A part of the report."""

    title: str
    text: str
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    checks: Sequence[Check] = ()
