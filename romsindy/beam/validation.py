"""Checks of the beam's arguments: every message names the argument, the value and the remedy."""

from __future__ import annotations

import math


def require_finite(name: str, value: float) -> None:
    """Raise ValueError unless `value` is a finite number."""
    if not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number, got {value}")


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
