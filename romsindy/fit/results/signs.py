"""Signs that physics refuses: damping that supplies energy, and fast modes of less than no mass."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from romsindy.fit.results.estimate import Estimate
from romsindy.fit.verdict import REFUSED
from romsindy.physics.coupling import SlavedInertia
from romsindy.physics.term import Term
from romsindy.text import listed

_SURE = 3.0  # standard errors off zero


def massless(found: Estimate) -> float:
    """Standard errors by which the fast modes that follow have less than no mass; 0 with mass.

    Their products of inertia over the powers that they follow, such as q1^2 and q1 q2, are sums of
    squares: a positive semidefinite matrix, see `SlavedInertia`. Its least eigenvalue is judged,
    which changes with each product by those of the entries of its vector.
    """
    laws = {t.key: t for t in found.model.terms if isinstance(t, SlavedInertia)}
    shapes = sorted({shape for t in laws.values() for shape in (t.first, t.second)})
    if not shapes:
        return 0.0
    matrix, values = np.zeros((len(shapes), len(shapes))), found.model.coefficients
    places = {name: (shapes.index(t.first), shapes.index(t.second)) for name, t in laws.items()}
    for name, (i, j) in places.items():
        matrix[i, j] = matrix[j, i] = values[name]
    least, vectors = np.linalg.eigh(matrix)
    own = {n: (1 + (i != j)) * vectors[i, 0] * vectors[j, 0] for n, (i, j) in places.items()}
    slope = np.array([own.get(name, 0.0) for name in found.free])
    variance = float(slope @ found.covariance @ slope)
    return max(-float(least[0]), 0.0) / np.sqrt(variance) if variance > 0 else 0.0


def possible(found: Estimate, laws: Sequence[Term]) -> list[Term]:
    """Laws of an equation without those of a sign that they cannot have, unless surely so."""
    values, errors = found.model.coefficients, found.standard_errors

    def may_be(law: Term) -> bool:
        value, error = values[law.key], errors.get(law.key, 0.0)
        return value > law.least or not value > law.least - REFUSED * error

    return [law for law in laws if may_be(law)]


def supplying(found: Estimate) -> list[str]:
    """Names of nonlinear laws of damping that are surely negative: they would supply energy."""
    errors, values = found.standard_errors, found.model.coefficients
    names = [n for n in errors if n.startswith("c_") and not n.startswith("c_linear")]
    return [n for n in names if errors[n] and values[n] < -_SURE * errors[n]]


def stand_ins(found: Estimate) -> Iterable[str]:
    """Sentences on what has a sign that it cannot have, and so stands for another law."""
    if (errors_off := massless(found)) > _SURE:
        yield (
            "the products of inertia g(...) came out as of fast modes with less than no mass, by"
            f" {errors_off:.3g} standard errors: one that is missing, or another law, is among them"
        )
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
