"""Of the columns of a file: the inputs that drive the vibration."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from romsindy.record.files.choose import find, signals_of
from romsindy.record.files.columns import Column, Table
from romsindy.record.forced import ONE_CLOCK
from romsindy.record.interpolation import is_base, require_input
from romsindy.record.units import UNITS, force_unit, parse_input_unit
from romsindy.typing import Array

# In names of columns: of either kind, and of any input.
_WORDS = {"force": r"force|kraft|hammer", "base": r"base|ground|table"}
_ANY = r"input|excitation|drive|shaker"
_LETTERS = {"u", "f"}  # these as words of their own


def input_columns(
    table: Table,
    names: Sequence[str],
    columns: Sequence[str] | None,
    measured: Sequence[str] | None,
) -> list[Column]:
    """The column of each input: of these names, or else those that names or units say.

    Raises
    ------
    ValueError
        If there are no such columns, or it is not clear which are meant.
    """
    for name in names:
        require_input(name)
    response = [find(table.columns, name, "column") for name in measured or ()]
    if columns is not None:
        if len(columns) != len(names):
            raise ValueError(
                f"input_column={list(columns)} are {len(columns)} columns for the {len(names)}"
                f" inputs {list(names)}: name one for each, in their order"
            )
        chosen = [find(table.columns, name, "input_column") for name in columns]
        if len({*map(id, [*chosen, *response])}) < len(chosen) + len(response):
            raise ValueError(
                f"input_column={list(columns)} and the measured column are not all different: name"
                " each column once"
            )
        return chosen
    left = [c for c in signals_of(table, None) if c not in response]
    found: dict[str, list[Column]] = {}
    kinds = [name.split()[0] for name in names]  # of "force 2" it is a force
    for kind, count in Counter(kinds).items():
        found[kind] = _of_kind(kind, count, left, bool(response))
        left = [c for c in left if c not in found[kind]]
    return [found[kind].pop(0) for kind in kinds]


def inputs_among(columns: Sequence[Column]) -> list[tuple[str, Column]]:
    """Those of columns that names or units say are inputs, each with its kind.

    A base counts where it has an acceleration beside another quantity: it may be a sensor like
    others. "u" counts beside "y".
    """
    outputs = any("y" in _words(c) for c in columns)
    others = {c.quantity for c in columns if not re.search(_WORDS["base"], c.name.lower())}
    found = []
    for c in columns:
        name, (base, _) = c.name.lower(), force_unit(c.unit or "") or ("", 1.0)
        if re.search(rf"{_WORDS['force']}|{_ANY}", name) or base == "N":
            found.append(("force", c))
        elif outputs and "u" in _words(c):
            found.append(("force", c))
        elif re.search(_WORDS["base"], name) and c.quantity == "acceleration" not in others:
            found.append(("base", c))
    return found if len(found) < len(columns) else []


def _of_kind(kind: str, count: int, left: Sequence[Column], alone: bool) -> list[Column]:
    """So many inputs of a kind; where the response is known, what is left ``alone``."""
    rules: tuple[Callable[[Column], object], ...] = (
        lambda c: re.search(_WORDS[kind], c.name.lower()),
        lambda c: re.search(_ANY, c.name.lower()) or _LETTERS & {*_words(c)},
        lambda c: c.quantity == "acceleration" if kind == "base" else force_unit(c.unit or ""),
        lambda c: alone,
    )
    for rule in rules:
        columns = [c for c in left if rule(c)]
        if len(columns) == count:
            return columns
    raise ValueError(
        f"which {'column is' if count == 1 else f'{count} columns are'} the input {kind!r} is not"
        f" clear among {[c.name for c in left]}: choose with input_column="
    )


def _words(column: Column) -> list[str]:
    return re.findall(r"[^\W\d_]+", column.name.lower())


def samples_of(
    columns: Sequence[Column],
    names: Sequence[str],
    units: Sequence[str] | None,
    response: Column,
    t: Array,
) -> tuple[Array, list[str | None]]:
    """Inputs (n, n_inputs) in SI units, and these units.

    Raises
    ------
    ValueError
        For other times than those of the response, or a unit that is none of such an input.
    """
    given: list[str | None] = [*(units or (None,))]
    given = given * len(names) if len(given) == 1 else given
    if len(given) != len(names):
        raise ValueError(f"input_unit={given} must be one unit, or one for each of {list(names)}")
    x, found = np.empty((len(t), len(names))), []
    for k, (column, name, text) in enumerate(zip(columns, names, given, strict=True)):
        _require_clock(column, response, t)
        unit, factor = _unit(column, text, is_base(name))
        x[:, k] = np.asarray(column.values, float) * factor
        found.append(unit)
    return np.where(np.isfinite(x), x, np.nan), found


def _unit(column: Column, text: str | None, base: bool) -> tuple[str | None, float]:
    """Unit and factor; of a header that says nothing known, none, and numbers as in the file."""
    header = column.unit or ""
    known = header in UNITS or force_unit(header)
    text = text or (header if known else None)
    return (None, 1.0) if text is None else parse_input_unit(text, base)


def _require_clock(column: Column, response: Column, t: Array) -> None:
    if len(column.values) != len(t):
        raise ValueError(
            f"the input column {column.name!r} has {len(column.values)} samples, and"
            f" {response.name!r} {len(t)}: {ONE_CLOCK}"
        )
    both = column.t is not None and response.t is not None
    if both and not np.array_equal(np.array(column.t), np.array(response.t)):
        raise ValueError(
            f"the input column {column.name!r} has other times than {response.name!r}: {ONE_CLOCK}"
        )
