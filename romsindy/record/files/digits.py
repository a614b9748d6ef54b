"""Rows of one format, by which a row that lost some of its digits is known."""

from __future__ import annotations

import re
from collections.abc import Sequence

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
