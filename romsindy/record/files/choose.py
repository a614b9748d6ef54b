"""Of the columns of a file: the times, those that were measured, and the inputs that drive them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import takewhile

import numpy as np

from romsindy.record.files.columns import Column, Table
from romsindy.record.forced import ONE_CLOCK
from romsindy.record.interpolation import is_base, require_input
from romsindy.record.recording import Quantity, require_increasing
from romsindy.record.units import TIMES, UNITS, force_unit, parse_input_unit, parse_unit
from romsindy.text import counted
from romsindy.typing import Array

# Times beyond this are those of a calendar; a float of them keeps no microseconds.
_CALENDAR = 1e8  # s
_DATES = {"ns": 1e17, "us": 1e14, "ms": 1e11}
_COARSE = 0.02  # share of times that repeat the one before


def unique(columns: Sequence[Column]) -> list[Column]:
    """The same columns with names that differ: "acc", "acc (2)"; "a" beside "b" counts them."""
    counts: Counter[str] = Counter()
    found = []
    letters = {"a", "b"} <= {column.name.lower() for column in columns}
    for column in columns:
        if letters and column.name.lower() == "a":
            column = replace(column, counted=True)
        counts[column.name] += 1
        n = counts[column.name]
        found.append(column if n == 1 else replace(column, name=f"{column.name} ({n})"))
    return found


def find(columns: Sequence[Column], name: str, argument: str) -> Column:
    """The column of a name, which may come with its unit as in the header.

    Raises a ValueError if there is none.
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

    Raises a ValueError if there are no times, or several.
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
    steady = any("frequency" in name.lower() for name in names)
    other = "; a table of steady states is read by romsindy steady" if steady else ""
    return f"no time column among {names}; name it with time=, or give rate={other}"


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

    Raises a ValueError the message names the row, and the remedy.
    """
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        what = counted(len(bad), "value that is", "values that are")
        raise ValueError(
            f"the time has {what} NaN or infinite, the first in row"
            f" {bad[0] + 1} of the data: mend them, or give the samples per second with rate="
        )
    steps = np.diff(t)
    repeats = np.count_nonzero(steps == 0)
    remedy = "sort the samples, remove the repeated ones, or give the samples per second with rate="
    if np.min(steps, initial=0.0) == 0 and repeats > _COARSE * len(steps):
        remedy = (
            f"{repeats} of {len(t)} times repeat the one before: coarser than the sampling; give"
            " the samples per second with rate=, about"
            f" {len(steps) / max(t[-1] - t[0], 1e-300):.4g}"
        )
    require_increasing(t, remedy)


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

    Raises a ValueError if the unit is not known, or belongs to another quantity.
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


def in_one_unit(
    columns: Sequence[Column], unit: str | None, quantity: Quantity, lever: float | None
) -> tuple[str | None, list[float], float | None]:
    """SI unit of q of all columns, their factors, and the lever arm of angles beside lengths, m.

    Angles count as lengths at the ``lever`` arm; by default one at which both vibrate alike, of two
    digits.

    Raises a ValueError if other units differ, or a lever is given where it is not for.
    """
    names = [c.name for c in columns]
    bases, factors = zip(*(conversion(c, unit, quantity) for c in columns), strict=True)
    if {*bases} != {"m", "rad"}:
        if len({*bases}) > 1:
            raise ValueError(
                f"columns {names} are not in one unit: choose some of them with column="
            )
        if lever is not None:
            raise ValueError(
                f"lever = {lever:g} is for columns of lengths and of angles together, and {names}"
                " are not: leave it out"
            )
        return bases[0], list(factors), None
    turns = np.array([base == "rad" for base in bases])
    if lever is None:
        size = np.array([f * np.nanstd(c.values) for f, c in zip(factors, columns, strict=True)])
        with np.errstate(all="ignore"):
            lever = float(f"{np.linalg.norm(size[~turns]) / np.linalg.norm(size[turns]):.1e}")
    if not 0 < lever < np.inf:
        raise ValueError(
            f"lever = {lever:g} must be positive and finite: the lever arm, m, at which angles"
            " count beside lengths"
        )
    return "m", list(np.where(turns, lever, 1.0) * factors), lever


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

    Raises a ValueError if there are no such columns, or it is not clear which are meant.
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

    Raises a ValueError for other times than those of the response, or a unit that is none of such
    an input.
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
