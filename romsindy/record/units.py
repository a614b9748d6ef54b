"""Units of what was measured, converted to SI where a record enters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.record.recording import Quantity

_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "in": 0.0254}
_ANGLES = {"rad": 1.0, "deg": np.pi / 180, "°": np.pi / 180}
_MODAL = {"kg^0.5 m": 1.0, "sqrt(kg) m": 1.0}
TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}  # in s
_RATES: dict[Quantity, tuple[str, ...]] = {
    "displacement": ("",),
    "velocity": ("/s",),
    "acceleration": ("/s^2", "/s2", "/s²", "/s/s"),
}


@dataclass(frozen=True)
class Unit:
    """What a unit measures: ``factor`` converts it to SI, ``base`` is the SI unit of q."""

    base: str
    quantity: Quantity
    factor: float


UNITS = {"g": Unit("m", "acceleration", 9.80665)} | {
    name + suffix: Unit(base, quantity, factor)
    for base, family in (("m", _LENGTHS), ("rad", _ANGLES), ("kg^0.5 m", _MODAL))
    for name, factor in family.items()
    for quantity, suffixes in _RATES.items()
    for suffix in suffixes
}


def parse_unit(text: str) -> Unit:
    """Look up a unit such as "mm", "m/s", "g" or "deg".

    Raises
    ------
    ValueError
        If it is not known; the message lists those that are.
    """
    if text not in UNITS:
        lengths = ", ".join([*_LENGTHS, *_ANGLES, "kg^0.5 m"])
        raise ValueError(
            f"unit {text!r} is not known: use {lengths}, each alone, with /s or /s^2, or g"
        )
    return UNITS[text]
