"""What several columns tell together of that which a fit leaves: an F test of least squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from romsindy.typing import Array, Indices

_RANK = 1e-7  # of scaled products: columns below it are told by others


class Together(NamedTuple):
    """What columns that are tried tell, beside those that were fitted."""

    # Probability that noise alone goes with them as much: F tests of all of them together, and of
    # the one that tells most, by Bonferroni's inequality
    p_value: float
    most: int  # which of those tried tells most alone
    values: Array  # by which all columns, fitted and tried, tell most
    # Chi-square of what is left over its freedom, where it would be 1 without what they tell
    excess: float


def tell_together(products: Array, n_fitted: int, n: int) -> Together:
    """Of n rows in which noise is white, by their products.

    ``products``, (m + 1, m + 1), are those of the fitted columns, which come first, of the columns
    that are tried, and of what is left, which is the last one.
    """
    fitted, tried = np.arange(n_fitted), np.arange(n_fitted, len(products) - 1)
    every, power = np.concatenate([fitted, tried]), products[-1, -1]
    alone, rank = _explained(products, fitted)
    both, full = _explained(products, every)
    new, freedom, left = full - rank, n - full, power - both
    gain = (both - alone) / new / (left / freedom) if left > 0 else 0.0
    singles = [_explained(products, np.append(fitted, k))[0] - alone for k in tried]
    rest = max(power - alone - max(singles), 0.0) / (n - rank - 1)
    best = fdtrc(1, n - rank - 1, max(singles) / rest) if rest > 0 else 1.0
    vectors, sizes = _directions(products, every)
    return Together(
        p_value=min(2 * float(min(fdtrc(new, freedom, gain), len(tried) * best)), 1.0),
        most=int(np.argmax(singles)),
        values=vectors @ (vectors.T @ products[every, -1] / sizes),
        excess=float((power - alone) / (n - rank) / (left / freedom)) if left > 0 else 1.0,
    )


def _explained(products: Array, some: Indices) -> tuple[float, int]:
    """How much of the last column some others tell, and how many of them differ."""
    vectors, sizes = _directions(products, some)
    told = vectors.T @ products[some, -1]
    return float(np.sum(told**2 / sizes)), len(sizes)


def _directions(products: Array, some: Indices) -> tuple[Array, Array]:
    """Directions that are told apart, among columns of unit size, and their powers."""
    own = products[np.ix_(some, some)]
    power = np.diag(own)
    scale = np.where(power > 0, 1 / np.sqrt(np.where(power > 0, power, 1.0)), 0.0)
    sizes, vectors = np.linalg.eigh(own * scale * scale[:, None])
    told = sizes > _RANK * sizes[-1]
    return scale[:, None] * vectors[:, told], sizes[told]
