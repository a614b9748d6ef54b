"""Of the columns of a file: the times, and those that were measured."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile

import numpy as np

from romsindy.record.files.columns import Column, Table
from romsindy.record.recording import Quantity
from romsindy.record.units import TIMES, UNITS, parse_unit
from romsindy.text import counted
from romsindy.typing import Array

# Times beyond this are those of a calendar; a float of them keeps no microseconds.
_CALENDAR = 1e8  # s
_DATES = {"ns": 1e17, "us": 1e14, "ms": 1e11}
_COARSE = 0.02  # share of times that repeat the one before


def unique(columns: Sequence[Column]) -> list[Column]:
    """The same columns with names that differ: "acc", "acc (2)"."""
    counts: Counter[str] = Counter()
    found = []
    for column in columns:
        counts[column.name] += 1
        n = counts[column.name]
        found.append(column if n == 1 else replace(column, name=f"{column.name} ({n})"))
    return found


def find(columns: Sequence[Column], name: str, argument: str) -> Column:
    """The column of a name, which may come with its unit as in the header.

    Raises
    ------
    ValueError
        If there is none.
    """
    for column in columns:
        if name in (column.name, f"{column.name} [{column.unit}]"):
            return column
    raise ValueError(f"{argument} = {name!r} is none of {[c.name for c in columns]}")


def signals_of(table: Table, names: Sequence[str] | None) -> list[Column]:
    """The columns of these names; without names all but those of times."""
    others = [c for c in table.columns if not _is_clock(c, table)]
    if names is None:
        return others
    known = {c.name for c in table.columns}
    return [find(table.columns if name in known else others, name, "column") for name in names]


def times_of(
    table: Table, signals: Sequence[Column], time: str | None, rate: float | None
) -> tuple[Array, list[Column], str]:
    """Times in s, the signals sampled at them, and a note on where they come from.

    From the column ``time``; or ``rate``; or the times that channels have themselves; or the one
    column of times; or a rate that the file names: the first of these that there is.

    Raises
    ------
    ValueError
        If there are no times, or several.
    """
    others = [c for c in signals if c.name != time]
    if time is not None:
        clock: Column | None = find(table.columns, time, "time")
    elif rate is not None:
        if not 0 < rate < np.inf:
            raise ValueError(f"rate = {rate!r} must be a positive number of samples per second")
        others = [c for c in others if not _is_clock(c, table)] or others
        return *_regular(others, rate), f"times from rate={rate:g}"
    elif any(c.t is not None for c in others):
        return *_own(others), ""
    else:
        clock = _clock(table, others)
    if clock is None and table.rate:
        return *_regular(others, table.rate), f"times from the file's rate, {table.rate:g} Hz"
    if clock is None:
        raise ValueError(_no_clock(table))
    others = [c for c in others if c is not clock and len(c.values) == len(clock.values)]
    return _seconds(clock), others, ""


def _no_clock(table: Table) -> str:
    names = [c.name for c in table.columns]
    if len(names) < 2:
        return (
            "a time column and a measured column are needed, but the file has"
            f" {len(names)} column; add the times, or give the samples per second with rate="
        )
    return f"no time column among {names}; name it with time=, or give rate="


def _regular(columns: Sequence[Column], rate: float) -> tuple[Array, list[Column]]:
    n = max((len(c.values) for c in columns), default=0)
    return np.arange(n) / rate, [c for c in columns if len(c.values) == n]


def _own(columns: Sequence[Column]) -> tuple[Array, list[Column]]:
    """The times that most channels share, and those channels."""
    groups: dict[tuple[float, ...], list[Column]] = {}
    for c in columns:
        if c.t is not None and len(c.t):
            groups.setdefault((len(c.t), c.t[0], c.t[-1]), []).append(c)
    most = max(groups.values(), key=len, default=[])
    return (most[0].t if most and most[0].t is not None else np.empty(0)), most


def _is_clock(column: Column, table: Table) -> bool:
    if column.is_time:
        return True
    # A name such as "run1_t", or a first column without a name, is that of times if it never
    # falls, which no vibration does; but 0, 1, 2, ... count samples.
    first = column is table.columns[0] and len(table.columns) > 1
    nameless = column.name.isdigit() or column.name.endswith("[0]")
    if not (first and nameless) and not re.search(r"[_.]t$", column.name):
        return False
    steps = np.diff(column.values)
    return bool(np.all(steps >= 0) and np.any(steps > 0) and not np.all(steps == 1))


def _clock(table: Table, signals: Sequence[Column]) -> Column | None:
    lengths = {len(c.values) for c in signals if not c.is_time}
    clocks = [c for c in table.columns if len(c.values) in lengths and _is_clock(c, table)]
    if all(np.array_equal(c.values, clocks[0].values) for c in clocks[1:]):
        return clocks[0] if clocks else None
    # Of several, the one whose name begins as those of all signals do: run1_t and run1_x.
    alike = [min(_alike(clock.name, signal.name) for signal in signals) for clock in clocks]
    if alike.count(max(alike)) == 1:
        return clocks[int(np.argmax(alike))]
    raise ValueError(
        f"more than one time column among {[c.name for c in clocks]};"
        " choose one column with column=, name it with time=, or give rate="
    )


def _alike(one: str, other: str) -> int:
    """Characters with which both names begin."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))


def _seconds(clock: Column) -> Array:
    """Times of a column in s, those of a calendar from its first sample on."""
    values, unit = clock.values, clock.unit
    if unit is not None and unit not in TIMES:
        raise ValueError(
            f"column {clock.name!r} is in {unit!r}, which is no unit of time: use"
            f" {', '.join(TIMES)}, or give rate="
        )
    start = abs(float(values[0])) if len(values) else 0.0
    if unit is None:  # a date in s has 10 digits, in ms 13, and so on
        unit = next((u for u, low in _DATES.items() if low < start < np.inf), "s")
    if _CALENDAR < start * TIMES[unit] < np.inf:
        values = values - values[0]
    return values.astype(float, copy=False) * TIMES[unit]


def checked_times(t: Array) -> None:
    """Refuse times that are missing or do not increase.

    Raises
    ------
    ValueError
        The message names the row, and the remedy.
    """
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        what = counted(len(bad), "value that is", "values that are")
        raise ValueError(
            f"the time has {what} NaN or infinite, the first in row"
            f" {bad[0] + 1} of the data: mend them, or give the samples per second with rate="
        )
    steps = np.diff(t)
    if steps.size == 0 or steps.min() > 0:
        return
    i = int(np.argmax(steps <= 0))
    repeats = np.count_nonzero(steps == 0)
    remedy = "sort the samples, remove the repeated ones, or give the samples per second with rate="
    if steps.min() == 0 and repeats > _COARSE * len(steps):
        remedy = (
            f"{repeats} of {len(t)} times repeat the one before: coarser than the sampling; give"
            " the samples per second with rate=, about"
            f" {len(steps) / max(t[-1] - t[0], 1e-300):.4g}"
        )
    raise ValueError(
        f"t must increase, but it {'repeats' if steps[i] == 0 else 'decreases'} at sample"
        f" {i + 1} ({t[i]:.9g} -> {t[i + 1]:.9g} s): {remedy}"
    )


def measured(signals: Sequence[Column], quantity: Quantity | None) -> list[Column]:
    """Columns that measure one quantity in one unit: the one that most of them do.

    A column without a number, one that never falls, as a counter or a dead channel, or one in a
    unit of something else than motion comes last.
    """
    left = list(signals)
    for fits in (
        lambda c: np.any(np.isfinite(c.values)),
        lambda c: c.is_motion,
        lambda c: np.any(c.values[1:] < c.values[:-1]),
        lambda c: quantity is None or c.quantity == quantity,
        lambda c: quantity is None or c.quantity in (None, quantity),
    ):
        left = [c for c in left if fits(c)] or left
    kinds = Counter(map(_kind, left))
    most = max(kinds, key=kinds.__getitem__, default=None)  # the first of equals
    return [c for c in left if _kind(c) == most]


def _kind(column: Column) -> tuple[Quantity, str]:
    base = UNITS[column.unit].base if column.unit in UNITS else ""
    return column.quantity or "displacement", base


def conversion(column: Column, unit: str | None, quantity: Quantity) -> tuple[str | None, float]:
    """SI unit of q and factor; (None, 1) where the unit is not one of motion.

    Raises
    ------
    ValueError
        If the unit is not known, or belongs to another quantity.
    """
    text = unit or (column.unit if column.unit in UNITS else None)
    if text is None:
        return None, 1.0
    found = parse_unit(text)
    if found.quantity != quantity:
        raise ValueError(
            f"unit {text!r} is one of {found.quantity}, but quantity = {quantity!r}:"
            " give the unit that belongs to what was measured"
        )
    return found.base, found.factor
