"""Sparse regression on columns of equal size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pysindy as ps
from pysindy.optimizers.base import BaseOptimizer
from sklearn.base import clone

from romsindy.typing import Array

# Drops terms below 1e-4 of the target: lightly damped modes keep their damping.
_DEFAULT_OPTIMIZER = ps.STLSQ(threshold=1e-4, alpha=1e-12)


class ScaledOptimizer(BaseOptimizer):
    """Any PySINDy optimizer or scikit-learn linear model on columns of equal size.

    Columns and target are divided by their rms (eq. 19 of the method's paper), and coefficients
    scaled back. A threshold then means a relative contribution, ``|c| rms(theta) / rms(target)``,
    whatever the units and the number of rows.

    Parameters
    ----------
    optimizer : estimator, optional
        `pysindy.STLSQ(threshold=1e-4, alpha=1e-12)` by default. It is cloned. Models of
        scikit-learn are fitted without intercept.
    fixed : mapping of int to float, optional
        Columns whose coefficients are known.
    """

    def __init__(self, optimizer: Any = None, fixed: Mapping[int, float] | None = None):
        # The optimizer inside removes its own bias; doing so here would free what is fixed.
        super().__init__(unbias=False)
        self.optimizer = optimizer
        self.fixed = fixed

    def set_params(self, **params: Any) -> ScaledOptimizer:
        """Set parameters and return self, which PySINDy's base class does not."""
        super().set_params(**params)
        return self

    def _reduce(self, x: Array, y: Array) -> None:
        fixed = dict(self.fixed or {})
        free = [j for j in range(x.shape[1]) if j not in fixed]
        coefficients = np.zeros((y.shape[1], x.shape[1]))
        coefficients[:, list(fixed)] = list(fixed.values())
        column_scale, target_scale = rms(x[:, free]), rms(y)
        if free:
            inner = clone(self.optimizer or _DEFAULT_OPTIMIZER)
            if "fit_intercept" in inner.get_params():
                inner.set_params(fit_intercept=False)
            rest = (y - x[:, list(fixed)] @ coefficients[:, list(fixed)].T) / target_scale
            # Some models of scikit-learn warn about, or refuse, a single target as a column.
            inner.fit(x[:, free] / column_scale, rest[:, 0] if rest.shape[1] == 1 else rest)
            scaled = np.reshape(inner.coef_, (y.shape[1], len(free)))
            coefficients[:, free] = scaled * target_scale[:, None] / column_scale
        self.coef_ = coefficients
        self.history_.append(coefficients)


def rms(x: Array) -> Array:
    """Of the columns of x; 1 where a column is 0."""
    found = np.sqrt(np.mean(np.square(x), axis=0))
    return np.where(found > 0, found, 1.0)
