"""What many records say together: values at common amplitudes, trends, outliers, two groups."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import siegelslopes
from scipy.stats import t as student

from romsindy.text import quantity, with_error
from romsindy.typing import Array
from romsindy_batch.entries import Entry

KINDS = {"frequency": "Hz", "damping_ratio": "%"}
WORDS = {"frequency": "frequency", "damping_ratio": "damping ratio"}
_AMPLITUDES = 3  # at which records are compared, unless they are given
_SHARES = 1.0, 0.9, 0.8, 0.5  # of the most records that reach an amplitude: it is a common one
_WIDE = 2.0  # the largest common amplitude over the smallest, where one need not ask for less
_GRID = 60  # amplitudes among which common ones are sought
_CHANCE = 0.01  # that one of all records is taken for an outlier by chance
_EFFICIENT = 0.37  # a median distance tells a scatter as well as so many of its values squared
_SURE = 0.05  # of a trend by chance, before it is told
_LEAST = 4  # records of a trend
_NORMAL = 1.4826  # standard deviation over the median distance, of a normal distribution


class Values(NamedTuple):
    """Values of each record at one amplitude with standard errors, (n,); nan where not reached."""

    value: Array
    std: Array


@dataclass(frozen=True)
class Batch:
    """Records in the order of the batch, with what was found of each."""

    entries: Sequence[Entry]
    found: Sequence[Mapping[str, Any]]
    asked: Sequence[float] = ()  # amplitudes, unit of q

    @cached_property
    def curves(self) -> list[dict[str, Array] | None]:
        """Frequency, Hz, and damping ratio, %, against amplitude; None of what was refused."""
        return [
            {k: np.array(x, float) for k, x in f["curve"].items()} if f.get("curve") else None
            for f in self.found
        ]

    @cached_property
    def unit(self) -> str:
        """Of the amplitudes."""
        units = dict.fromkeys(f.get("unit") or "[q]" for f in self.found if f.get("curve"))
        return ", ".join(units) or "[q]"

    @cached_property
    def amplitudes(self) -> Array:
        """At which records are compared: those that were asked for, or that most records reach."""
        curves = [c for c in self.curves if c is not None]
        if len(self.asked) or not curves:
            return np.array(self.asked, float)
        ends = np.array([[c["amplitude"][0], c["amplitude"][-1]] for c in curves])
        grid = np.geomspace(ends.min(), ends.max(), _GRID)
        reach = np.sum((ends[:, :1] <= grid) & (grid <= ends[:, 1:]), axis=0)
        for share in _SHARES:
            common = grid[reach >= share * reach.max()]
            if common[-1] > _WIDE * common[0]:
                break
        return np.geomspace(common[0], common[-1], _AMPLITUDES)

    @property
    def middle(self) -> float:
        """The amplitude at which trends are told."""
        return float(self.amplitudes[len(self.amplitudes) // 2])

    def at(self, amplitude: float, kind: str) -> Values:
        """Values of one of `KINDS` at an amplitude."""
        pairs = [_read(c, amplitude, kind) for c in self.curves]
        return Values(*np.array(pairs, float).T)

    def texts(self, column: str) -> list[str]:
        """What the table says of each record in a column."""
        return [e.values.get(column, "") for e in self.entries]

    @property
    def alike(self) -> list[tuple[str, ...]]:
        """All that the table says of each record: repeats have it in common."""
        return [tuple(e.values.values()) for e in self.entries]

    def rows(self) -> list[dict[str, Any]]:
        """The table, a row for each record: numbers as numbers, empty where there is none."""
        columns = {
            f"{kind} at {a:.4g} {self.unit} [{unit}]": self.at(a, kind)
            for a in self.amplitudes
            for kind, unit in KINDS.items()
        }
        return [
            {
                "file": entry.name,
                **entry.values,
                "explained": found.get("explained"),
                **{
                    name + end: None if np.isnan(x[i]) else float(x[i])
                    for name, values in columns.items()
                    for end, x in zip(("", " +-"), values, strict=True)
                },
                "equation": found.get("short"),
                "refused": found.get("error"),
            }
            for i, (entry, found) in enumerate(zip(self.entries, self.found, strict=True))
        ]


def _read(curve: Mapping[str, Array] | None, amplitude: float, kind: str) -> tuple[float, float]:
    if curve is None:
        return np.nan, np.nan
    a = np.log(curve["amplitude"])
    end = {"left": np.nan, "right": np.nan}
    value, std = (np.interp(np.log(amplitude), a, curve[k], **end) for k in (kind, f"{kind}_std"))
    return float(value), float(std)


# -- scatter --------------------------------------------------------------------------------------


def _robust(off: Array) -> float:
    """Standard deviation that outliers do not change."""
    return float(_NORMAL * np.median(np.abs(off - np.median(off))))


def _far(count: int, fitted: int) -> float:
    """Robust standard deviations from which on one of so many records is an outlier."""
    freedom = max(_EFFICIENT * (count - fitted), 1.0)
    return float(student.isf(_CHANCE / (2 * count), freedom))


@dataclass(frozen=True)
class Trend:
    """A straight line of values over a column, fitted to all but the outliers.

    Records differ by more than their own errors: how much is read off what they do about the line.
    """

    column: str
    kind: str
    x: Array  # (n,) numbers, or days since the first date; nan where the table says nothing
    values: Values
    line: Array  # slope, and value at the mean of x
    covariance: Array  # (2, 2)
    mean: float  # of x
    outliers: tuple[int, ...]
    p_value: float  # that there is no slope
    dates: bool

    def band(self, x: Array) -> tuple[Array, Array]:
        """The line, and half the width of its 95 % band."""
        design = np.column_stack([x - self.mean, np.ones(len(x))])
        used = np.isfinite(self.x + self.values.value).sum() - len(self.outliers)
        variance = np.sum(design @ self.covariance * design, axis=1)
        return design @ self.line, student.isf(0.025, used - 2) * np.sqrt(variance)

    def sentence(self, unit: str) -> str:
        """How much the value changes along the column."""
        slope, error = self.line[0], np.sqrt(self.covariance[0, 0])
        change = " +- ".join(with_error(slope, error))
        per = f"{unit} per {'day' if self.dates else 'unit'}"
        if self.p_value > _SURE:
            return f"{WORDS[self.kind]} shows no change with {self.column}: {change} {per}."
        return f"{WORDS[self.kind]} changes with {self.column} by {change} {per}."


def numbers(texts: Sequence[str]) -> tuple[Array, bool] | None:
    """A column as numbers, or as days since the first of its dates; None of words."""
    for read, dates in ((float, False), (datetime.fromisoformat, True)):
        try:
            found = [read(text) if text else None for text in texts]
            known = [x for x in found if x is not None]
            first: Any = min(known, default=None) if dates else 0.0
        except (ValueError, TypeError):  # times with and without a zone have no order
            continue
        if len(set(known)) < 2:
            return None
        days = [np.nan if x is None else (x - first) for x in found]
        plain = [x.total_seconds() / 86400 if hasattr(x, "total_seconds") else x for x in days]
        return np.array(plain, float), dates
    return None


def trends(batch: Batch) -> Iterator[Trend]:
    """Those of frequency and damping ratio at the middle amplitude over columns of numbers."""
    for column in dict.fromkeys(name for e in batch.entries for name in e.values):
        known = numbers(batch.texts(column))
        if known is None or not len(batch.amplitudes):
            continue
        for kind in KINDS:
            found = _line(column, kind, *known, batch.at(batch.middle, kind))
            if found is not None:
                yield found


def _line(column: str, kind: str, x: Array, dates: bool, values: Values) -> Trend | None:
    y, std = values
    there = np.isfinite(x + y + std)
    if np.sum(there) < _LEAST or np.ptp(x[there]) == 0:
        return None
    slope, at_zero = siegelslopes(y[there], x[there])  # no outlier moves it
    off = y - at_zero - slope * x
    error = np.hypot(std, _robust(off[there]))
    used = there & (np.abs(off) <= _far(int(np.sum(there)), 2) * error)
    if np.sum(used) < _LEAST or np.ptp(x[used]) == 0:
        return None
    mean, weight = float(x[used].mean()), 1 / np.maximum(error[used], 1e-300)
    line, covariance = np.polyfit(x[used] - mean, y[used], 1, w=weight, cov="unscaled")
    # Records may lie farther from the line than that: something else changes, too.
    left = weight * (y[used] - np.polyval(line, x[used] - mean))
    freedom = int(np.sum(used)) - 2
    covariance *= max(float(np.sum(left**2)) / freedom, 1.0)
    p_value = float(2 * student.sf(abs(line[0]) / np.sqrt(covariance[0, 0]), freedom))
    far = tuple(np.flatnonzero(there & ~used).tolist())
    return Trend(column, kind, x, values, line, covariance, mean, far, p_value, dates)


def outliers(batch: Batch) -> dict[int, str]:
    """Records that lie far from the others, by their place in the batch, and in what.

    From the lines of trends where there are any, else from the middle of their repeats, of which
    the table says the same, or of all.
    """
    found: dict[int, list[str]] = {}
    lines = list(trends(batch))
    for trend in lines:
        for i in trend.outliers:
            found.setdefault(i, []).append(f"{WORDS[trend.kind]} over {trend.column}")
    for kind in () if lines or not len(batch.amplitudes) else KINDS:
        for i in _off_their_repeats(batch.at(batch.middle, kind), batch.alike):
            found.setdefault(i, []).append(WORDS[kind])
    return {i: " and ".join(dict.fromkeys(words)) for i, words in sorted(found.items())}


def _off_their_repeats(values: Values, alike: Sequence[tuple[str, ...]]) -> list[int]:
    """Places of those that lie far from the median of their group, of three at least."""
    y, std = values
    groups = [
        np.array([other == group for other in alike]) & np.isfinite(y + std) for group in set(alike)
    ]
    groups = [group for group in groups if np.sum(group) > 2] or [np.isfinite(y + std)]
    off = np.full(len(y), np.nan)
    for group in groups:
        off[group] = y[group] - np.median(y[group])
    there = np.isfinite(off)
    if np.sum(there) < _LEAST:
        return []
    error = np.hypot(std, _robust(off[there]))
    far = there & (np.abs(off) > _far(int(np.sum(there)), len(groups)) * error)
    return np.flatnonzero(far).tolist()


# -- two groups -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Comparison:
    """How the second of two groups of records differs from the first, at one amplitude."""

    kind: str
    amplitude: float
    means: tuple[float, float]
    counts: tuple[int, int]
    low: float  # of the difference, 95 %, in per cent of the first
    high: float

    @property
    def change(self) -> float:
        """In per cent of the first."""
        return 100 * (self.means[1] / self.means[0] - 1)


def compared(batch: Batch, column: str, names: tuple[str, str]) -> list[Comparison]:
    """Two groups of records, by what the table says in a column (Welch's interval).

    Nothing at amplitudes that fewer than two of a group reach.
    """
    texts = np.array(batch.texts(column))
    found = []
    for a in batch.amplitudes:
        for kind in KINDS:
            values = batch.at(float(a), kind).value
            groups = [values[(texts == name) & np.isfinite(values)] for name in names]
            if min(map(len, groups)) < 2:
                continue
            one, other = groups
            parts = [np.var(g, ddof=1) / len(g) for g in groups]
            error = float(np.sqrt(sum(parts)))
            below = sum(p**2 / (len(g) - 1) for p, g in zip(parts, groups, strict=True))
            half = student.isf(0.025, error**4 / below) * error if below > 0 else 0.0
            difference, scale = other.mean() - one.mean(), 100 / one.mean()
            ends = scale * (difference - half), scale * (difference + half)
            means, counts = (float(one.mean()), float(other.mean())), (len(one), len(other))
            found.append(Comparison(kind, float(a), means, counts, *map(float, ends)))
    return found


def told(comparisons: Sequence[Comparison], column: str, names: tuple[str, str], unit: str) -> str:
    """A sentence for the amplitude in the middle."""
    if not comparisons:
        return f"{column} {names[1]} and {names[0]}: no amplitude is reached by two of each."
    a = sorted({c.amplitude for c in comparisons})
    middle = a[len(a) // 2]
    each = [
        f"{WORDS[c.kind]} {c.change:+.2g} % ({c.low:+.2g} to {c.high:+.2g} %)"
        for c in comparisons
        if c.amplitude == middle
    ]
    return (
        f"{column} {names[1]} against {names[0]}, at {quantity(middle, unit)}: {', '.join(each)}."
    )
