"""Which terms steady states need: those that best predict a level of force that took no part."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from romsindy.effects.choices import sought
from romsindy.fit.steady.balance import CHAIN, Rows, linearised
from romsindy.fit.steady.points import SteadyPoints
from romsindy.fit.steady.solve import Solution, solve
from romsindy.fit.verdict import TERM
from romsindy.physics.damping import PowerDamping
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array, Indices

_LAWS = sought("steady")
STIFFNESS = tuple(law.key for law in _LAWS if not law.has("damping"))
DAMPING = (PowerDamping(1).key, *(law.key for law in _LAWS if law.has("damping")))
_MOST = 2  # of each
_ROUNDS = 5  # of a choice about the orbits of the model that was chosen last
_BLOCKS = 5


def choose(
    points: SteadyPoints,
    unit: str | None,
    gain: float | None,
    slope: float | None,
    phase: float | None,
) -> tuple[ReducedModel, float | None]:
    """Terms to fit, and the slope of the chain: None where it is to be fitted.

    Every level of force is left out in turn; where there are fewer than three, every fifth of the
    points by amplitude. Of the models whose squared misfit there is the least, to 2 % or to its
    standard error, the one with the fewest coefficients is taken.
    """
    every = ("omega^2", *STIFFNESS, *DAMPING)
    chosen: tuple[str, ...] = ("c_linear",)
    for _ in range(_ROUNDS):
        terms = [name for name in every if name in ("omega^2", *chosen)]
        start = dict.fromkeys(terms, 0.0) | {"omega^2": float(np.median(points.frequency) ** 2)}
        model = ReducedModel.from_coefficients(start, unit)
        now = 0.0 if slope is None and "slope" not in chosen else slope
        best = _best(points, solve(points, model, tuple(terms), gain, now, phase), every, slope)
        if best == chosen:
            break
        chosen = best
    return model, now


def _best(
    points: SteadyPoints, found: Solution, every: tuple[str, ...], slope: float | None
) -> tuple[str, ...]:
    """The terms, and "slope", that predict best about the orbits of a solution."""
    coefficients = dict.fromkeys(every, 0.0) | found.model.coefficients
    rich = ReducedModel.from_coefficients(coefficients)
    rows = linearised(points, rich, every, found.chain, found.c)
    chain = [name for name in CHAIN if name in found.free or (name == "slope" and slope is None)]
    names = [*every, *chain]
    columns = [*range(len(every)), *(len(every) + CHAIN.index(name) for name in chain)]
    rows = replace(rows, by_parameter=rows.by_parameter[..., columns])
    values = coefficients | vars(found.chain)
    at = np.array([values[name] for name in names])
    optional = [*STIFFNESS, *DAMPING, *(["slope"] if slope is None else [])]
    folds = _folds(points)
    losses = {}
    for some in _subsets(slope is None):
        dropped = [names.index(name) for name in optional if name not in some]
        losses[some] = _missed(rows, found.floor, at, dropped, folds)
    least = min(losses.values(), key=np.sum)
    chance = np.sqrt(len(least)) * np.std(least)
    as_good = np.sum(least) + max(TERM * np.sum(least), chance)
    good = [some for some, loss in losses.items() if np.sum(loss) <= as_good]
    return min(good, key=lambda some: (len(some), np.sum(losses[some])))


def _subsets(with_slope: bool) -> list[tuple[str, ...]]:
    """Terms beside omega^2, with and without the slope of the chain."""

    def some(names: tuple[str, ...], least: int) -> list[tuple[str, ...]]:
        counts = range(least, _MOST + 1)
        return [found for n in counts for found in itertools.combinations(names, n)]

    slopes: list[tuple[str, ...]] = [(), ("slope",)] if with_slope else [()]
    parts = itertools.product(some(STIFFNESS, 0), some(DAMPING, 1), slopes)
    return [(*stiffness, *damping, *slope) for stiffness, damping, slope in parts]


def _folds(points: SteadyPoints) -> list[NDArray[np.bool_]]:
    """Which points are left out in turn."""
    number: Indices = points.level
    if number.max() < 2:
        order = np.argsort(np.argsort(points.amplitude))
        number = order * _BLOCKS // len(points)
    return [number == i for i in np.unique(number)]


def _missed(
    rows: Rows, unexplained: float, values: Array, dropped: list[int], folds: list[NDArray]
) -> Array:
    """Squares of the whitened misfits of points that took no part, (n,).

    Coefficients that are ``dropped``, by their columns, are put to 0.
    """
    a, b = rows.whitened(unexplained)
    b = b - a[:, dropped] @ values[dropped]
    a = np.delete(a, dropped, axis=1)
    a /= np.linalg.norm(a, axis=0)
    missed = np.empty_like(b)
    for left_out in folds:
        out = np.repeat(left_out, rows.misfit.shape[1])
        step = np.linalg.lstsq(a[~out], -b[~out], rcond=1e-12)[0]
        missed[out] = a[out] @ step + b[out]
    return np.sum(missed.reshape(len(rows.misfit), -1) ** 2, axis=1)
