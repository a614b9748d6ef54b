"""Exponents held at whole numbers, that of the textbook first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from romsindy.effects.base import Parameter
from romsindy.fit.part import Part


def with_textbook_exponent(part: Part) -> Part:
    """The same with its exponent held at that of the textbook."""
    return _at_exponent(part, lambda p: p.starts[0])


def with_whole_exponent(part: Part) -> Part:
    """The same with its exponent held at the next whole number."""
    return _at_exponent(part, lambda p: float(round(part.effect.value(p.name))))


def _at_exponent(part: Part, value: Callable[[Parameter], float]) -> Part:
    held = [
        replace(p, low=value(p), high=value(p)) if p.name == "exponent" else p
        for p in part.parameters
    ]
    if held == list(part.parameters):
        return part
    shape = np.clip(part.shape, [p.low for p in held], [p.high for p in held])
    return replace(part.shaped(shape), parameters=tuple(held))
