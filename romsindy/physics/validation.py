"""Checks of arguments and of entries of files: a message names what, the value and the remedy."""

from __future__ import annotations

import difflib
import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, TypeVar

import numpy as np

from romsindy.text import listed
from romsindy.typing import Array


def require_finite(name: str, *values: float) -> None:
    """Raise ValueError unless every value is a finite number."""
    for value in values:
        if not math.isfinite(value):
            raise ValueError(f"{name} must be a finite number, got {value}")


def refuse_unknown(where: str, names: Iterable[str], known: Sequence[str]) -> None:
    """Raise ValueError for a name that is not known; the message says which one is nearest."""
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else "leave it out."
            raise ValueError(f"{where} takes no {name!r:.60}: {hint} It takes {', '.join(known)}")


def unit_vector(direction: tuple[float, float]) -> tuple[float, float]:
    """Return a direction of length one; raise ValueError where it has none."""
    norm = math.hypot(*direction)
    if not 0.0 < norm < math.inf:
        raise ValueError(
            f"direction = {direction} points nowhere; (0, 1) is transverse, (1, 0) axial"
        )
    return direction[0] / norm, direction[1] / norm


def require_positive(name: str, value: float, *, zero_allowed: bool = False) -> None:
    """Raise ValueError unless `value` is finite and positive (or zero, where allowed)."""
    require_finite(name, value)
    if value < 0.0 or (value == 0.0 and not zero_allowed):
        bound = "zero or positive" if zero_allowed else "positive"
        raise ValueError(f"{name} must be {bound} (SI units), got {value}; give a value above zero")


def require_position(name: str, value: float, length: float) -> None:
    """Raise ValueError unless `value` lies on the beam, 0 <= value <= length."""
    require_finite(name, value)
    if not 0.0 <= value <= length:
        raise ValueError(
            f"{name} = {value} m is off the beam; give a position between 0 and {length} m"
        )


T = TypeVar("T")
Reader = Callable[[str, Any], Any]

_NOT_FINITE = {"Infinity": math.inf, "-Infinity": -math.inf, "NaN": math.nan}


def number(name: str, value: Any) -> Any:
    """A number, also one of the strings that stand for those that are not finite."""
    if isinstance(value, str):
        value = _NOT_FINITE.get(value, value)
    if isinstance(value, float) or _is_whole(value):
        return value
    raise _refusal(name, value, "a number")


def finite(name: str, value: Any) -> Any:
    """A number that is finite."""
    if _is_whole(value) or (isinstance(value, float) and math.isfinite(value)):
        return value
    raise _refusal(name, value, "a finite number")


def whole(name: str, value: Any) -> int:
    """A whole number."""
    if not _is_whole(value):
        raise _refusal(name, value, "a whole number")
    return int(value)


def _is_whole(value: Any) -> bool:
    """Whether it is a whole number, and none that arrays cannot hold."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    return whole and abs(value) <= sys.float_info.max


def flag(name: str, value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise _refusal(name, value, "true or false")
    return value


def text(name: str, value: Any) -> str:
    """A text."""
    if not isinstance(value, str):
        raise _refusal(name, value, 'a text in quotes, such as "m"')
    return value


def optional_text(name: str, value: Any) -> str | None:
    """A text, or null."""
    return None if value is None else text(name, value)


def items(name: str, value: Any) -> list[Any]:
    """A list."""
    if not isinstance(value, list):
        raise _refusal(name, value, "a list [...]")
    return value


def table(name: str, value: Any, keys: Iterable[str] = ()) -> dict[str, Any]:
    """Named entries, all of those that must be there."""
    if not isinstance(value, dict):
        raise _refusal(name, value, "a table {...}")
    missing = [repr(key) for key in keys if key not in value]
    if missing:
        raise ValueError(f"{name} has no {listed(missing)}: add what is missing, or write it again")
    return value


def several(read: Reader) -> Reader:
    """A reader of lists, by that of their items."""
    return lambda name, value: tuple(
        read(f"{name}[{i}]", item) for i, item in enumerate(items(name, value))
    )


def array(name: str, value: Any) -> Array:
    """Numbers in a list, or in a list of lists of one length."""
    nested = any(isinstance(item, list) for item in items(name, value))
    rows = several(several(number) if nested else number)(name, value)
    if nested and len(set(map(len, rows))) > 1:
        raise ValueError(f"{name} must be a table of numbers: its rows differ in length")
    return np.array(rows, float)


_FIELD_READERS: dict[str, Reader] = {
    "float": number,
    "int": whole,
    "bool": flag,
    "str": text,
    "str | None": optional_text,
    "tuple[float, ...]": several(number),
    "tuple[str, ...]": several(text),
    "Array": array,
}


def made(
    kind: Callable[..., T], name: str, value: Any, readers: Mapping[str, Reader] | None = None
) -> T:
    """A dataclass by its fields: all of those without a default, each of the kind it states.

    ``name`` is where the entry stands, as messages tell it. Fields of further kinds are read by
    ``readers``, by their annotation; "" is for any other.
    """
    known = {f.name: f for f in fields(kind)}  # type: ignore[arg-type]
    needed = [n for n, f in known.items() if f.default is MISSING]
    refuse_unknown(name, table(name, value, needed), list(known))
    by_kind = _FIELD_READERS | dict(readers or {})
    given = {}
    for field, entry in value.items():
        stated = getattr(known[field].type, "__name__", str(known[field].type))
        given[field] = by_kind[stated if stated in by_kind else ""](f"{name}.{field}", entry)
    try:
        return kind(**given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: {error}") from error


def _refusal(name: str, value: Any, wanted: str) -> ValueError:
    # What is in brackets may be large, and deep.
    brackets: dict[type, str] = {list: "[...]", dict: "{...}"}
    shown = brackets.get(type(value)) or f"{json.dumps(value, default=str):.60}"
    return ValueError(f"{name} = {shown} must be {wanted}: correct it, or write the file again")
