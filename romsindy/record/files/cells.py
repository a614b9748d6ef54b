"""Cells of text: rows that lost some of their digits, and stamps of date and time."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import date
from functools import lru_cache

FEW = 3  # rows that do not agree and are taken for damaged; if more, the format varies
_ENOUGH = 8  # rows for one that may be damaged


def pattern_of(rows: Sequence[str], decimal: str) -> re.Pattern[str] | None:
    """What rows match whose numbers all have the same three or more decimals; None if not so.

    A few of them may not, for they are damaged.

    Fewer decimals, and numbers without any, are those of counters or of a sensor at rest.

    >>> pattern = pattern_of(["0.001, -1.2500", "0.002, 11.2500"] * 25, ".")
    >>> [bool(pattern.fullmatch(row)) for row in ("0.003, 9.1234", "0.003, NaN", "0.003, 9.12")]
    [True, True, False]
    """
    sign = re.escape(decimal)
    number = re.compile(rf"[-+]?\d+{sign}(\d{{3,}})(?:e[-+]?(\d+))?", re.IGNORECASE)
    example = rows[len(rows) // 2].strip() if rows else ""
    found = list(number.finditer(example))
    if not found or len(rows) < _ENOUGH:
        return None
    text, end = "", 0
    for match in found:
        exponent = r"e[-+]?\d{2,3}" if match[2] else ""
        text += _between(example[end : match.start()], decimal)
        text += rf"(?:[-+]?\d+{sign}\d{{{len(match[1])}}}{exponent}|[-+]?(?:nan|inf))"
        end = match.end()
    pattern = re.compile(text + _between(example[end:], decimal), re.IGNORECASE)
    odd = sum(not pattern.fullmatch(row.strip()) for row in rows)
    return pattern if odd <= min(FEW, len(rows) // _ENOUGH) else None


def _between(text: str, decimal: str) -> str:
    """Pattern of what is not judged: separators as they are, any other digits between them."""
    apart = r"[\s;]" if decimal == "," else r"[\s,;]"
    cells = re.split(rf"({apart}+)", text)
    return "".join(
        rf"{apart.replace('[', '[^')}*"
        if any(c.isdigit() for c in cell)
        else r"\s*".join(map(re.escape, re.split(r"\s+", cell)))
        for cell in cells
    )


_DATE = r"(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[./]\d{1,2}[./]\d{4})"
_CLOCK = (
    r"(?P<clock>\d{1,2}:\d{2}(?::\d{2})?(?:[.,]\d*)?) ?(?P<half>[AaPp][Mm])?(?:Z|[+-]\d\d:?\d\d)?"
)
_STAMP = re.compile(rf"(?:{_DATE}[T ]*)?(?:{_CLOCK})?")


def is_stamp(cell: str) -> bool:
    """Whether a cell is a date, a time of day, or both.

    >>> [is_stamp(c) for c in ("2024-05-01T12:00:00.5", "1.5.2024", "12:00:00,5", "1.5", "")]
    [True, True, True, False, False]
    """
    return bool(cell.strip()) and _STAMP.fullmatch(cell.strip()) is not None


def reader(first: str) -> Callable[[str], float]:
    """A function from stamps to seconds since midnight of the first one's day.

    Seconds since year 1 would keep no microseconds in a float.

    Raises
    ------
    ValueError
        By that function, if a cell is no stamp, or its day cannot be told from the first one's.

    >>> read = reader("31.12.2023 23:59:59")
    >>> read("01.01.2024 00:00:00,25"), read("31.12.2023 11:59:59 PM"), read("00:01.5")
    (86400.25, 86399.0, 1.5)
    """
    start = _match(first)["date"]

    @lru_cache
    def slowly(cell: str) -> float:
        found = _match(cell)
        days = _days(start, found["date"]) if found["date"] else 0
        return 86400.0 * days + _of_day(found["clock"] or "0:00", (found["half"] or "").lower())

    def seconds(cell: str) -> float:
        minute, _, tail = cell.strip().rpartition(":")
        if ":" in minute and tail[:2].isdigit() and tail[2:3] == "." and tail[3:].isdigit():
            return slowly(f"{minute}:00") + float(tail)  # once a minute, thousands of samples
        return slowly(cell)

    return seconds


def _match(cell: str) -> re.Match[str]:
    found = _STAMP.fullmatch(cell.strip())
    if found is None or not cell.strip():
        raise ValueError(f"{cell.strip()!r} is no date or time of day")
    return found


def _of_day(clock: str, half: str) -> float:
    parts = [float(part) for part in clock.replace(",", ".").split(":")]
    if len(parts) == 2:  # minutes and seconds if there is a fraction, else hours and minutes
        parts = [0.0, *parts] if "." in clock or "," in clock else [*parts, 0.0]
    hours = parts[0] % 12 + 12 * (half == "pm") if half else parts[0]
    return 3600 * hours + 60 * parts[1] + parts[2]


@lru_cache
def _days(start: str | None, day: str) -> int:
    if start is None:
        raise ValueError(f"{day!r} has a date, and the first row has none")
    return 0 if start == day else _ordinal(day) - _ordinal(start)


def _ordinal(day: str) -> int:
    numbers = [int(part) for part in re.split(r"[-/.]", day)]
    if numbers[0] > 31:
        return date(*numbers).toordinal()
    if "/" in day:
        raise ValueError(f"{day!r}: the day changes, and this may be day/month or month/day")
    return date(*numbers[::-1]).toordinal()
