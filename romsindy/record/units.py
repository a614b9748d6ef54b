"""Units of what was measured, converted to SI where a record enters."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from romsindy.record.recording import Quantity

_LENGTHS = {
    **{"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9},
    **{"in": 0.0254, "ft": 0.3048, "mil": 2.54e-5},
}
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180}
_MODAL = {"kg^0.5 m": 1.0, "sqrt(kg) m": 1.0}
_GRAVITY = 9.80665  # m/s^2, the standard value
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}  # in s
# After the unit of q.
RATES: dict[Quantity, str] = {"displacement": "", "velocity": "/s", "acceleration": "/s^2"}
# Spellings of files and of people, made one of those above; in this order.
_SPELLINGS = (
    (r"^[\[(](.*)[\])]$", r"\1"),
    (r"[µμ]", "u"),
    (r"\*\*", "^"),
    (r"⁻¹", "^-1"),
    (r"⁻²", "^-2"),
    (r"²", "^2"),
    (r"°|\bdegrees?\b", "deg"),
    (r"\bsec(onds?)?\b", "s"),
    (r"\b(metres?|meters?)\b", "m"),
    (r"\binch(es)?\b", "in"),
    (r"/\(s\^?2\)$|/s\^?2$|/s/s$|[ .·*]?s\^?-2$", "/s^2"),
    (r"[ .·*]?s\^?-1$", "/s"),
    (r"^gn$|^g's$", "g"),
)


@dataclass(frozen=True)
class Unit:
    """What a unit measures: ``factor`` converts it to SI, ``base`` is the SI unit of q."""

    base: str
    quantity: Quantity
    factor: float


UNITS = {
    "g": Unit("m", "acceleration", _GRAVITY),
    "mg": Unit("m", "acceleration", 1e-3 * _GRAVITY),
} | {
    name + suffix: Unit(base, quantity, factor)
    for base, family in (("m", _LENGTHS), ("rad", _ANGLES), ("kg^0.5 m", _MODAL))
    for name, factor in family.items()
    for quantity, suffix in RATES.items()
}


def spelled(text: str) -> str:
    """The spelling of `UNITS` and `TIMES` for a unit that they have; any other is only stripped.

    >>> spelled("[mm/sec]"), spelled("m s⁻²"), spelled("MM"), spelled(" kN ")
    ('mm/s', 'm/s^2', 'mm', 'kN')
    """
    found = text = text.strip()
    for pattern, plain in _SPELLINGS:
        found = re.sub(pattern, plain, found).strip()
    if found.isupper() and found not in UNITS:
        found = found.lower()
    return found if found in UNITS or found in TIMES else text


def parse_unit(text: str) -> Unit:
    """Look up a unit such as "mm", "m/s", "g" or "deg", in any common spelling.

    Raises
    ------
    ValueError
        If it is not known; the message lists those that are.
    """
    unit = spelled(str(text))
    if unit not in UNITS:
        lengths = ", ".join([*_LENGTHS, *_ANGLES, "kg^0.5 m"])
        raise ValueError(
            f"unit {text!r} is not known: use {lengths}, each alone, with /s or /s^2, or g; of"
            " anything else, such as V, multiply the samples by what one of it stands for, or leave"
            " out unit= to keep the numbers as they are"
        )
    return UNITS[unit]
