"""Inertia and stiffness as functions of q: how they are read off a model, and their bands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from romsindy.physics.coupled import AnyModel, CoupledModel
from romsindy.typing import Array

# At q = 0 a secant takes the place of the slope, this part of the range off.
_SECANT = 1e-6
_OUTSIDE = 1.001  # of the range of the data, by rounding
Function = Callable[[AnyModel, Array], Array]


@dataclass(frozen=True, eq=False)
class Curve:
    """A function of q as the model has it, with the 95 % band of all that may be true; (n,) each.

    The band holds pointwise.
    """

    q: Array
    value: Array
    low: Array
    high: Array


def inertia_of(coordinate: int) -> Function:
    """h(q): inertia of a coordinate, from 1, beside its unit mass, all others at rest."""

    def h(model: AnyModel, q: Array) -> Array:
        if isinstance(model, CoupledModel):
            at = coordinate - 1
            return np.asarray(model.inertia(_along(model, coordinate, q))[:, at, at] - 1)
        return model.inertia(q) - 1

    return h


def secant_of(coordinate: int, size: float) -> Function:
    """K(q) / q of a coordinate, all others at rest; at 0 its limit. ``size`` is the range of q."""
    step = _SECANT * size

    def secant(model: AnyModel, q: Array) -> Array:
        away = np.where(np.abs(q) < step, step, q)
        if isinstance(model, CoupledModel):
            force = model.stiffness(_along(model, coordinate, away))[:, coordinate - 1]
        else:
            force = model.stiffness(away)
        return np.asarray(force / away)

    return secant


def _along(model: CoupledModel, coordinate: int, q: Array) -> Array:
    """Positions (n, R) at which one coordinate is displaced."""
    return q[:, None] * np.eye(model.n_coordinates)[coordinate - 1]


def checked_range(q: ArrayLike, reach: tuple[float, float], unit: str | None) -> Array:
    """Displacements (n,) within the range of the data.

    Raises
    ------
    ValueError
        If one is outside.
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


def checked_coordinate(coordinate: int, model: AnyModel) -> int:
    """The number of a coordinate of a model, from 1.

    Raises
    ------
    ValueError
        If it has no such coordinate.
    """
    whole = isinstance(coordinate, (int, np.integer)) and not isinstance(coordinate, bool)
    if not (whole and 1 <= coordinate <= model.n_coordinates):
        raise ValueError(
            f"coordinate = {coordinate!r} must be a whole number from 1 to"
            f" {model.n_coordinates}: the model has no other"
        )
    return int(coordinate)
