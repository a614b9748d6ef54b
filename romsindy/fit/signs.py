"""Damping with a sign that no damping has: what another law left behind."""

from __future__ import annotations

from collections.abc import Iterable

from romsindy.fit.estimate import Estimate
from romsindy.text import listed

_SURE = 3.0  # standard errors off zero


def supplying(found: Estimate) -> list[str]:
    """Names of nonlinear laws of damping that are surely negative: they would supply energy."""
    errors, values = found.standard_errors, found.model.coefficients
    names = [n for n in errors if n.startswith("c_") and not n.startswith("c_linear")]
    return [n for n in names if errors[n] and values[n] < -_SURE * errors[n]]


def stand_ins(found: Estimate) -> Iterable[str]:
    """A sentence on them."""
    names = supplying(found)
    if not names:
        return
    errors, values = found.standard_errors, found.model.coefficients
    least = min(abs(values[n]) / errors[n] for n in names)
    yield (
        f"{listed(names)} came out negative, by {least:.3g} standard errors: by itself it would"
        " supply energy, as a flow does; or it stands for a law that is not among those that were"
        " chosen from"
    )
