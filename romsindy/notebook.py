"""What a notebook shows: models and results as formula, table and sentences; curves as frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any, ClassVar

import numpy as np
from latex2mathml.converter import convert

from romsindy.text import TextTable, columns_of_numbers

_NAMESPACE = ' xmlns="http://www.w3.org/1998/Math/MathML"'


def mathml(latex: str) -> str:
    """A part of an equation; in HTML no name space is named, and a sign leans on what is before."""
    return convert(f"{{}}{latex}").replace(_NAMESPACE, "")


def shown(
    equations: Iterable[Iterable[str]], tables: Iterable[TextTable], sentences: Sequence[str]
) -> str:
    """HTML of equations in LaTeX, in parts between which a line may end, of tables and text."""
    formulas = (f"<p>{'<wbr>'.join(map(mathml, parts))}</p>" for parts in equations)
    lines = (escape(line) for sentence in sentences for line in sentence.splitlines())
    return "\n".join([*formulas, *map(_table, tables), f"<p>{'<br>'.join(lines)}</p>"])


def _table(table: TextTable) -> str:
    styles = [" style='text-align:right'" * number for number in columns_of_numbers(table.rows)]
    header, *body = (
        [f"{style}>{escape(cell)}" for style, cell in zip(styles, row, strict=True)]
        for row in table.rows
    )
    rows = ["".join(f"<th{cell}</th>" for cell in header)]
    rows += ["".join(f"<td{cell}</td>" for cell in row) for row in body]
    caption = f"<caption>{escape(table.title)}</caption>" if table.title else ""
    note = f"<p>{escape(table.note)}</p>" if table.note else ""
    return f"<table>{caption}{''.join(f'<tr>{row}</tr>' for row in rows)}</table>{note}"


# Of columns and of their errors; amplitudes and displacements have that of the coordinate.
_UNITS = {"t": "s", "frequency": "rad/s", "damping_ratio": "1", "residual": "1"}
_OF_Q = ("q", "amplitude", "positive_peak", "negative_peak")


class Framed:
    """Columns of one length, which pandas can take."""

    _columns: ClassVar[tuple[str, ...]]  # attributes, (n,) or (n, R)

    def to_frame(self) -> Any:
        """Its columns as a ``pandas.DataFrame``, with the names and units of the attributes.

        Of several coordinates each has its own, such as ``amplitude_2``. ``attrs["units"]`` says
        units by name: frequencies are in rad/s.

        Raises
        ------
        ValueError
            If pandas is not installed.
        """
        try:
            from pandas import DataFrame
        except ImportError as error:
            raise ValueError("to_frame needs pandas: run pip install pandas") from error
        columns: dict[str, Any] = {}
        for name in self._columns:
            value = np.asarray(getattr(self, name))
            parts = {f"{name}_{i}": part for i, part in enumerate(value.T, 1)}
            columns |= {name: value} if value.ndim == 1 else parts
        frame = DataFrame(columns)
        units = _UNITS | dict.fromkeys(_OF_Q, getattr(self, "unit", None) or "[q]")
        names = {name: name.removesuffix("_std") for name in self._columns}
        frame.attrs["units"] = {n: units[kind] for n, kind in names.items() if kind in units}
        return frame
