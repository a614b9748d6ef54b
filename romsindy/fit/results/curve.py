"""Inertia and stiffness as functions of q: how they are read off a model, and their bands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from romsindy.notebook import Framed
from romsindy.physics.equations import Equations
from romsindy.typing import Array

# At q = 0 a secant takes the place of the slope, this part of the range off.
_SECANT = 1e-6
_OUTSIDE = 1.001  # of the range of the data, by rounding
Function = Callable[[Equations, Array], Array]


@dataclass(frozen=True, eq=False)
class Curve(Framed):
    """A function of q as the model has it, with the 95 % band of all that may be true; (n,) each.

    The band holds pointwise.
    """

    q: Array
    value: Array
    low: Array
    high: Array

    _columns = ("q", "value", "low", "high")


def inertia_of(coordinate: int) -> Function:
    """h(q): inertia of a coordinate, from 1, beside its unit mass, all others at rest."""
    at = coordinate - 1
    return lambda model, q: np.asarray(_held(model, at, q)[3][:, at, at] - 1)


def secant_of(coordinate: int, size: float) -> Function:
    """K(q) / q of a coordinate, all others at rest; at 0 its limit. ``size`` is the range of q."""
    at, step = coordinate - 1, _SECANT * size

    def secant(model: Equations, q: Array) -> Array:
        away = np.where(np.abs(q) < step, step, q)
        return np.asarray(_held(model, at, away)[0][:, at] / away)

    return secant


def _held(model: Equations, at: int, q: Array) -> tuple[Array, ...]:
    """Forces (n, R) and their slopes (n, R, R) where one coordinate is displaced, and held."""
    positions = q[:, None] * np.eye(model.n_coordinates)[at]
    rest = np.zeros_like(positions)
    return model.residual_and_slopes(positions, rest, rest)


def checked_range(q: ArrayLike, reach: tuple[float, float], unit: str | None) -> Array:
    """Displacements (n,) within the range of the data.

    Raises a ValueError if one is outside.
    """
    q = np.atleast_1d(np.asarray(q, float))
    least, largest = reach
    if not np.all((q >= _OUTSIDE * least) & (q <= _OUTSIDE * largest)):
        raise ValueError(
            f"q = {q.min():.4g} to {q.max():.4g} leaves the range of the data,"
            f" {least:.4g} to {largest:.4g} {unit or '[q]'}: bands say nothing"
            " there; stay within reach"
        )
    return q


def checked_coordinate(coordinate: int, model: Equations) -> int:
    """The number of a coordinate of a model, from 1.

    Raises a ValueError if it has no such coordinate.
    """
    whole = isinstance(coordinate, (int, np.integer)) and not isinstance(coordinate, bool)
    if not (whole and 1 <= coordinate <= model.n_coordinates):
        raise ValueError(
            f"coordinate = {coordinate!r} must be a whole number from 1 to"
            f" {model.n_coordinates}: the model has no other"
        )
    return int(coordinate)
