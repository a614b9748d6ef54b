"""How much more than the noise says do windows disagree on the values?

What a wrong model leaves does not average out like noise: within a window it pulls all values the
same way. The pulls of the windows on the values, summed, are nothing at the best fit; their squares
say how large the error of the values really is. This is the sandwich estimator with windows as
clusters [1], brought down to one number as in quasi-likelihood.

[1] H. White, "Maximum likelihood estimation of misspecified models", Econometrica 50 (1982) 1.
"""

from __future__ import annotations

import numpy as np

from romsindy.fit.functions.evidence import Fitted


def dispersion(found: Fitted) -> float:
    """Variance of the values by the scatter of the windows over that by the noise; 1 for noise."""
    p, rows = len(found.series.values), found.reduced
    # Directions in which the posterior is a standard normal.
    root, values = found.posterior().root, found.series.values
    pulls, expected = 0.0, 0.0
    for linear, starts in zip(found.linear, rows.starts, strict=True):
        # The best starts follow the values.
        changes = np.vstack([-starts, np.eye(p + 1)])
        wide = np.column_stack([changes[:, :p] @ root, changes @ np.append(values, -1.0)])
        for white in linear.whitened(wide / found.noise):
            jacobian, rest = white[:, :p], white[:, p]
            pull, own = jacobian.T @ rest, jacobian.T @ jacobian
            pulls += float(pull @ pull)
            expected += float(np.trace(own) - np.sum(own * own))
    return pulls / expected
