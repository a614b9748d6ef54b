"""How much more than the noise says do windows disagree on the values?

What a wrong model leaves does not average out like noise: within a window it pulls all values the
same way. The pulls of the windows on the values, summed, are nothing at the best fit; their squares
say how large the error of the values really is. This is the sandwich estimator with windows as
clusters [1], brought down to one number as in quasi-likelihood.

[1] H. White, "Maximum likelihood estimation of misspecified models", Econometrica 50 (1982) 1.
"""

from __future__ import annotations

import numpy as np

from romsindy.fit.functions.evidence import Fitted, residuals
from romsindy.typing import Array


def dispersion(found: Fitted) -> float:
    """Variance of the values by the scatter of the windows over that by the noise; 1 for noise."""
    blocks, p = found.blocks, len(found.series.values)
    # Directions in which the posterior is a standard normal.
    rows, root = found.reduced, found.posterior().root
    values = found.series.values
    left = residuals(blocks, values, rows.states(values))
    follow = _following(found)
    pulls, expected = 0.0, 0.0
    for block, rest, states in zip(blocks, left, follow, strict=True):
        jacobian = (block.rows[:, :p] + block.rows[:, p : p + 2] @ states) @ root / found.noise
        # The last row of the triangle is what no values reach.
        pull = jacobian[:-1].T @ rest[:-1] / found.noise
        own = jacobian.T @ jacobian
        pulls += float(pull @ pull)
        expected += float(np.trace(own) - np.sum(own * own))
    return pulls / expected


def _following(found: Fitted) -> list[Array]:
    """How the best start of every window changes with the values, (2, p) each."""
    rows = found.reduced
    p = len(found.series.values)
    base = rows.states(np.zeros(p))
    columns = [rows.states(e) for e in np.eye(p)]
    return [
        np.stack([column[i] - start for column in columns], axis=1) for i, start in enumerate(base)
    ]
