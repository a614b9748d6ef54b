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
# Of forces and torques; an input that was not calibrated is in volts, whatever it is.
_FORCES = {
    **{"N": ("N", 1.0), "kN": ("N", 1e3), "mN": ("N", 1e-3), "lbf": ("N", 4.4482216152605)},
    **{"N m": ("N m", 1.0), "kN m": ("N m", 1e3)},
}
_VOLTS = {"V": ("V", 1.0), "mV": ("V", 1e-3)}


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

    Raises a ValueError if it is not known; the message lists those that are.
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


def force_unit(text: str) -> tuple[str, float] | None:
    """SI unit, and factor, of a unit of forces or volts; None for any other."""
    return (_FORCES | _VOLTS).get(text.strip().strip("[]()"))


def require_unit_of_q(unit: str | None) -> None:
    """Refuse a unit of a velocity or an acceleration as that of the displacement."""
    known = None if unit is None else UNITS.get(spelled(unit))
    if known is not None and known.quantity != "displacement":
        raise ValueError(
            f"unit = {unit!r} is a unit of {known.quantity}, and unit is that of q, the"
            f" displacement: multiply the samples by {known.factor:g}, give unit={known.base!r},"
            f" and say what was measured: by Decay.from_{known.quantity}(...), or of a"
            f" ForcedVibration by measured={known.quantity!r}"
        )


def require_unit_of_input(name: str, unit: str | None, base: bool) -> None:
    """Refuse a force in the unit of an acceleration, and a base that moves in that of a force."""
    motion, force = UNITS.get(spelled(unit or "")), force_unit(unit or "")
    if base and force is not None and force[0] != "V":
        wanted = "an acceleration, such as m/s^2; of a force give inputs='force'"
    elif not base and motion is not None and motion.quantity == "acceleration":
        wanted = "a force, such as N; of the acceleration of a base give inputs='base'"
    else:
        return
    raise ValueError(f"input_unit = {unit!r} of the input {name!r} must be that of {wanted}")


def parse_input_unit(text: str, base: bool) -> tuple[str, float]:
    """SI unit of an input, and the factor to it.

    >>> parse_input_unit("kN", base=False), parse_input_unit("g", base=True)
    (('N', 1000.0), ('m/s^2', 9.80665))

    Raises a ValueError if it is no unit of a force, or, of a base that moves, none of an
    acceleration.
    """
    motion = UNITS.get(spelled(text))
    known = force_unit(text)
    if base and motion is not None and motion.quantity == "acceleration":
        return f"{motion.base}/s^2", motion.factor
    if known is not None and (not base or known[0] == "V"):
        return known
    wanted = "m/s^2, mm/s^2, g" if base else ", ".join(_FORCES)
    raise ValueError(
        f"input_unit={text!r} is no unit of {'the acceleration of a base' if base else 'a force'}:"
        f" use {wanted} or V, or convert the samples"
    )
