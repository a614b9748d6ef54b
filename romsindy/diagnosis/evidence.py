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
from dataclasses import dataclass

import numpy as np

from romsindy.fit.gauss_newton import Solution
from romsindy.fit.part import Part, prior_cost
from romsindy.typing import Array


@dataclass(frozen=True)
class Hypothesis:
    """A fitted hypothesis and what it is worth; the first ``n_free`` parts are the unsure ones.

    Differences of misfit are divided by the excess: structure that stays unexplained is as large by
    chance.
    """

    solution: Solution
    n_free: int
    moved: tuple[str, ...]  # names of the unsure values that moved
    misfit: float  # chi-square of the whitened residual
    price: float  # of all values, and of their distance from what was known
    excess: float  # structure left in the residual, over that of noise, at least 1

    @classmethod
    def of(cls, solution: Solution, n_free: int, n_samples: float, structure: float) -> Hypothesis:
        """Weigh a solution; one that did not converge still counts for what it reached."""
        if not solution.finite:
            return cls(solution, n_free, (), np.inf, 0.0, np.inf)
        excess = max(structure, 1.0)
        slices = solution.slices()
        rise, price, moved = _price_of_free(solution, slices[:n_free], n_samples, excess)
        for part, where in zip(solution.parts[n_free:], slices[n_free:], strict=True):
            n = part.strengths.size
            price += n * np.log(n_samples / len(part.strengths))
            price += _price_of_shape(part, solution.covariance[where, where][n:, n:])
        known = prior_cost(solution.parts)
        misfit = solution.chi_squared - known + rise
        return cls(solution, n_free, moved, misfit, price + known, excess)

    def score(self, excess: float = 1.0) -> float:
        """Misfit over an excess, plus price: the least is the best."""
        return self.misfit / excess + self.price

    @property
    def effects(self) -> tuple[Part, ...]:
        """Parts beside the unsure ones."""
        return self.solution.parts[self.n_free :]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects; of the values that moved where there are none."""
        return tuple(p.effect.name for p in self.effects) or self.moved


def _price_of_free(
    solution: Solution, slices: Sequence[slice], n_samples: float, excess: float
) -> tuple[float, float, tuple[str, ...]]:
    """Cheapest choice of which unsure values to free.

    Each costs log n, or the rise of the misfit when it is fixed. Returns rise, price and names.
    """
    judged = [i for i, p in enumerate(solution.parts[: len(slices)]) if p.tolerance is None]
    at = np.array([slices[i].start for i in judged], int)
    values = np.array([solution.parts[i].strengths[0, 0] for i in judged])
    names = [solution.parts[i].effect.name for i in judged]
    choices = []
    for freed in itertools.product((False, True), repeat=len(judged)):
        fixed = ~np.array(freed, bool)
        block = solution.covariance[np.ix_(at[fixed], at[fixed])]
        rise = float(values[fixed] @ np.linalg.pinv(block, hermitian=True) @ values[fixed])
        moved = tuple(n for n, f in zip(names, freed, strict=True) if f)
        choices.append((rise, sum(freed) * float(np.log(n_samples)), moved))
    return min(choices, key=lambda c: c[0] / excess + c[1])


def _price_of_shape(part: Part, covariance: Array) -> float:
    price = 0.0
    for p, variance in zip(part.parameters, np.diag(covariance), strict=True):
        prior = p.spread or (p.high - p.low) / np.sqrt(2 * np.pi)
        price += max(float(np.log(prior**2 / max(variance, 1e-300))), 0.0)
    return price


def ranked(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Best first, with the excess of the one that explains most."""
    excess = min((h.excess for h in hypotheses), default=1.0)
    return sorted(hypotheses, key=lambda h: h.score(excess) if np.isfinite(excess) else np.inf)


def weights(hypotheses: Sequence[Hypothesis]) -> Array:
    """Posterior probabilities among hypotheses, all alike beforehand; the best comes first."""
    scores = np.array([h.score(hypotheses[0].excess) for h in hypotheses])
    weight = np.exp(-0.5 * (scores - scores.min()))
    return weight / weight.sum()
