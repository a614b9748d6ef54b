"""How good a band is: does it hold the truth, how wide is it, and what is it worth in one number.

The bands that the plain regression gets from a bootstrap over cycles are here too, to compare.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

import romsindy as rs
from romsindy.physics.term import Term
from romsindy.regression.projection import HarmonicRows
from romsindy.typing import Array

LEVEL = 0.95
PLAIN = rs.ROMLibrary(inertia=(3, 4, 5), stiffness=(1, 2, 3, 4, 5), damping=("linear",))


def holds(low: Array, high: Array, truth: Array) -> Array:
    """Whether the truth lies in the band, at every point."""
    return (low <= truth) & (truth <= high)


def interval_score(low: Array, high: Array, truth: Array) -> float:
    """Mean width of a 95 % band, and a fine of 2/0.05 for every unit that the truth is outside.

    The lower the better; it is least in expectation for the true quantiles. Gneiting and Raftery,
    J. Am. Stat. Assoc. 102 (2007) 359, eq. 43.
    """
    outside = np.maximum(low - truth, 0.0) + np.maximum(truth - high, 0.0)
    return float(np.mean(high - low + 2 / (1 - LEVEL) * outside))


def half_width(low: ArrayLike, high: ArrayLike, truth: ArrayLike) -> Array:
    """Half the width of a band, per cent of the true value."""
    return 50 * np.subtract(high, low) / np.abs(truth)


def inertia_samples(terms: Sequence[Term], coefficients: Array, q: Array) -> Array:
    """h at coordinates (n,) for coefficients (..., n_terms): shape (..., n)."""
    by_term = np.array([np.broadcast_to(term.inertia(q), q.shape) for term in terms])
    return np.asarray(coefficients @ by_term)


def resampled(rows: HarmonicRows, repetitions: int = 200, seed: int = 0) -> Array:
    """Coefficients of regressions on cycles drawn with replacement, (repetitions, n_terms).

    Every cycle keeps its rows together, since errors within a cycle go together.
    """
    rng, n_cycles = np.random.default_rng(seed), len(rows.amplitude)
    of_cycle = np.arange(len(rows.target)).reshape(n_cycles, -1)
    found = []
    for _ in range(repetitions):
        drawn = of_cycle[rng.integers(n_cycles, size=n_cycles)].ravel()
        found.append(rs.ScaledOptimizer().fit(rows.theta[drawn], rows.target[drawn]).coef_[0])
    return np.array(found)


def plain_band(decay: rs.Decay, q: Array) -> tuple[Array, Array]:
    """Band of h by the plain regression of order 5 with bootstrap errors: low, high, (n,) each."""
    plain = rs.HarmonicSINDy(PLAIN, weighted=False).fit(decay)
    h = inertia_samples(plain.model_.terms, resampled(plain.rows_), q)
    low, high = np.quantile(h, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    return low, high
