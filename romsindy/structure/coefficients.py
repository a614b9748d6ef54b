"""Coefficients of the equation of one mode from the shapes that its force holds, of any structure.

    f(q) = omega^2 q + sum_m gamma_m q^m                      stiffness, from the force
    s(q) = x - x_eq - phi q = sum_k beta_k q^k                what follows quasi-statically
    1 + h(q) = 1 + ds/dq^T M ds/dq                            inertia
             = 1 + Upsilon_3 q^2 + 2 Upsilon_4 q^3 + Upsilon_5 q^4 + ...

([1], eqs. (10)-(17)). Upsilon_3 = 4 beta_2^T M beta_2. The higher ones of [1] are sums of such
products as well, but a sum that is cut at some power is wrong at the edge of the range. They are
fitted to h itself here.

[1] Ahmadi, Hill, Jiang, Neild, Nonlinear Dynamics (2023), doi 10.1007/s11071-023-08813-z.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from romsindy.typing import Array


class HeldShapes(Protocol):
    """What a reduction asks of a structure along one mode."""

    @property
    def omega2(self) -> float:
        """Square of the linear frequency, 1/s^2."""
        ...

    @property
    def q(self) -> Array:
        """Coordinates, (n,)."""
        ...

    @property
    def force(self) -> Array:
        """K(q), (n,)."""
        ...

    @property
    def inertia(self) -> Array:
        """1 + h(q), (n,)."""
        ...

    @property
    def following(self) -> Array:
        """x - x_eq - phi q of all freedoms, (n, m)."""
        ...

    def mass_product(self, field: Array) -> float:
        """field^T M field of a field (m,)."""
        ...


def coefficients(curve: HeldShapes, order: int) -> dict[str, float]:
    """omega^2, gamma_2 ... gamma_order and Upsilon_3 ... Upsilon_order of a curve of shapes."""
    return (
        {"omega^2": curve.omega2}
        | stiffness_coefficients(curve, order)
        | inertia_coefficients(curve, order)
    )


def stiffness_coefficients(curve: HeldShapes, order: int) -> dict[str, float]:
    """gamma_2 ... gamma_order from the static force."""
    powers = range(2, order + 1)
    gamma = _fit(curve.q, (curve.force - curve.omega2 * curve.q)[:, None], powers)[:, 0]
    return {f"gamma_{m}": float(value) for m, value in zip(powers, gamma, strict=True)}


def inertia_coefficients(curve: HeldShapes, order: int) -> dict[str, float]:
    """Upsilon_3 ... Upsilon_order: the first from the shapes, the others from h(q)."""
    beta_2 = _fit(curve.q, curve.following, range(2, order))[0]
    first = 4.0 * curve.mass_product(beta_2)
    left = curve.inertia - 1.0 - first * curve.q**2
    powers = range(3, order)
    found = {"Upsilon_3": first}
    for power, value in zip(powers, _fit(curve.q, left[:, None], powers), strict=True):
        # odd powers carry 2 Upsilon, as in [1]
        found[f"Upsilon_{power + 1}"] = float(value[0]) / (2.0 if power % 2 else 1.0)
    return found


def _fit(q: Array, values: Array, powers: range) -> Array:
    """Least-squares coefficients, (n_powers, n_columns), of the powers of q."""
    scale = np.abs(q).max()
    columns = np.power.outer(q / scale, np.array(powers))
    solution, *_ = np.linalg.lstsq(columns, values, rcond=None)
    return np.asarray(solution / scale ** np.array(powers)[:, None])
