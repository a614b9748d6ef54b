"""What a hypothesis is worth: fit, less the price of its values.

The score of a hypothesis is minus twice the logarithm of its evidence, up to a constant: the
chi-square of the whitened residual, plus log n for every strength (as in the Bayesian information
criterion [1]), plus, for every shape value, how much the data narrow down its prior (Laplace's
method, [2]). Values that the simulation itself is unsure of stay at their nominal ones unless
freeing them pays. Whitening makes samples of correlated noise count for what they are worth.

[1] G. Schwarz, Annals of Statistics 6 (1978).  [2] D. MacKay, Neural Computation 4 (1992).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from romsindy.effects.drive import InputDistortion
from romsindy.fit.gauss_newton import Solution, limits
from romsindy.fit.normal_equations import NormalEquations
from romsindy.fit.part import Part
from romsindy.fit.verdict import RARER
from romsindy.typing import Array


class Solved(NamedTuple):
    """The normal equations of a fit, by noise of one kind, and what they say of its values."""

    system: NormalEquations
    misfit: float  # of the best values, their priors included
    parts: tuple[Part, ...]  # with these values
    covariance: Array


class Worth(NamedTuple):
    """What the score of a hypothesis is made of."""

    misfit: float
    price: float
    moved: tuple[str, ...]
    parts: tuple[Part, ...]
    covariance: Array

    @classmethod
    def of(
        cls, solution: Solution, solved: Solved, n_unsure: int, n_free: int, n_samples: float
    ) -> Worth:
        """Of a fit whose first parts are unsure values, and up to ``n_free`` no effects."""
        system, misfit, parts, covariance = solved
        rise, price, moved = _price_of_unsure(system, solution.parts, n_unsure, n_samples)
        for part, where in list(zip(parts, solution.slices(), strict=True))[n_free:]:
            price += _price_of(part, covariance[where, where], n_samples)
        return cls(misfit + rise, price, moved, parts, covariance)

    @classmethod
    def of_none(cls, solution: Solution) -> Worth:
        """Of a fit that has no motion."""
        return cls(np.inf, 0.0, (), solution.parts, solution.covariance)


def _price_of_unsure(
    system: NormalEquations, parts: Sequence[Part], n_unsure: int, n_samples: float
) -> tuple[float, float, tuple[str, ...]]:
    """Cheapest choice of which unsure values to free.

    Each costs log n, or the rise of the misfit when it is fixed: effects take its place as far as
    their limits let them. Returns rise, price and names.
    """
    first = np.cumsum([0, *(p.size for p in parts)])
    unknown = [i for i in range(n_unsure) if parts[i].tolerance is None]
    names = [parts[i].effect.name for i in unknown]
    low, high = limits(parts)
    choices = []
    for freed in itertools.product((False, True), repeat=len(unknown)):
        for i, free in zip(unknown, freed, strict=True):
            own = parts[i].limits() if free else (np.zeros(1), np.zeros(1))
            low[first[i]], high[first[i]] = (x[0] - parts[i].values[0] for x in own)
        there = system.bounded_step(np.zeros(0, bool), low, high)
        moved = tuple(n for n, f in zip(names, freed, strict=True) if f)
        choices.append((system.chi_squared(there), sum(freed) * float(np.log(n_samples)), moved))
    least = min(misfit for misfit, _, _ in choices)
    misfit, price, moved = min(choices, key=lambda c: c[0] + c[1])
    return misfit - least, price, moved


def _price_of(part: Part, covariance: Array, n_samples: float) -> float:
    """Of the values of an effect, with their covariance."""
    k, sets = part.strengths.size, len(part.strengths)
    shared = int(np.sum(part.shared))
    price = shared * float(np.log(n_samples))
    price += (k - sets * shared) * float(np.log(n_samples / sets))
    price += RARER * isinstance(part.effect, InputDistortion)
    return price + _price_of_shape(part, covariance[k:, k:])


def _price_of_shape(part: Part, covariance: Array) -> float:
    price = 0.0
    for p, variance in zip(part.parameters, np.diag(covariance), strict=True):
        prior = p.spread or (p.high - p.low) / np.sqrt(2 * np.pi)
        if p.low < p.high:  # one that is rounded to the textbook's costs nothing
            price += max(float(np.log(prior**2 / max(variance, 1e-300))), 0.0)
    return price
