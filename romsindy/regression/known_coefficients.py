"""Coefficients that are known: their columns, and those that contradict the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from romsindy.physics.term import Term
from romsindy.physics.term_sum import term_from_key
from romsindy.regression.coupled_motion import WindowRows
from romsindy.regression.projection import Rows
from romsindy.regression.scaled_optimizer import rms

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
    fixed: Mapping[int, float], terms: Sequence[Term], rows: Rows | WindowRows
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
