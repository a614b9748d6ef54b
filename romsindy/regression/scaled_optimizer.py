"""Sparse regression on columns of equal size, some of whose coefficients are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pysindy as ps
from pysindy.optimizers.base import BaseOptimizer
from sklearn.base import clone

from romsindy.physics.term import Term
from romsindy.physics.term_sum import term_from_key
from romsindy.regression.projection import HarmonicRows
from romsindy.regression.window_motion import WindowRows
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

    Examples
    --------
    >>> x = np.random.default_rng(0).normal(size=(100, 2)) * [1.0, 1e6]
    >>> ScaledOptimizer().fit(x, x @ [[3.0], [2e-6]]).coef_.round(9).tolist()
    [[3.0, 2e-06]]
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


# A fixed coefficient that makes its term this many times larger than q_ddot is no physics.
_ABSURD = 10.0


def fixed_columns(
    fixed: Mapping[str, float], terms: Sequence[Term], unit_known: bool
) -> dict[int, float]:
    """Column number to value, after checks of the names."""
    keys = [term.key for term in terms]
    columns = {}
    for key, value in fixed.items():
        if key not in keys:
            term_from_key(key)  # a name that is no law at all is refused with the nearest one
            raise ValueError(f"fixed names {key!r}, but the library has only {keys}: add the term")
        term = terms[keys.index(key)]
        if not np.isfinite(value):
            raise ValueError(f"fixed[{key!r}] = {value!r} must be a finite number")
        if term.dimension[0] != 1 and not unit_known:
            raise ValueError(
                f"fixed[{key!r}] = {value:.6g} is in {term.unit('m')} or the like, but the unit of"
                " q is not known: load the decay with unit=, such as unit='mm'"
            )
        columns[keys.index(key)] = float(value)
    return columns


def refuse_absurd(
    fixed: Mapping[int, float], terms: Sequence[Term], rows: HarmonicRows | WindowRows
) -> None:
    """Known coefficients in other units than the data stand out by orders of magnitude."""
    target = float(rms(rows.target[:, None])[0])
    for column, value in fixed.items():
        share = abs(value) * float(rms(rows.theta[:, [column]])[0]) / target
        term = terms[column]
        if term.key == "omega^2" and (share < 1 / _ABSURD or share > _ABSURD):
            raise ValueError(
                f"fixed['omega^2'] = {value:.6g} 1/s^2 contradicts the data, which oscillate near"
                f" omega^2 = {abs(value) / share:.4g}: omega^2 is in (rad/s)^2, 39.5 times Hz^2,"
                " and t must be in s (a factor of 1e6 means milliseconds)"
            )
        if share > _ABSURD:
            length = term.dimension[0] - 1
            factor = share ** (1 / length) if length else share
            raise ValueError(
                f"fixed[{term.key!r}] = {value:.6g} makes its term {share:.3g} times the"
                f" acceleration: q and the coefficient have different units, q seems {factor:.2g}"
                " times too large (1000 means millimetres); load the decay with unit='mm', or"
                " convert the coefficient"
            )
