"""Checks of arguments: every message names the argument, the value and the remedy."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence


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
