"""Direct reduced-order modelling: the "true" single-mode parameters from static load cases.

The beam is held by the modal force f M phi at many q = phi^T M (x - x_eq), in both directions.
Notation as in [1], eqs. (10)-(17):

    f(q) = omega^2 q + sum_m gamma_m q^m                          stiffness, from the force
    s(q) = x - x_eq - phi q = sum_k beta_k q^k                    what follows quasi-statically
    1 + h(q) = 1 + ds/dq^T M ds/dq                                inertia
             = 1 + Upsilon_3 q^2 + 2 Upsilon_4 q^3 + Upsilon_5 q^4 + ...

Upsilon_3 = 4 beta_2^T M beta_2. The higher ones of [1] are sums of such products as well, but a
sum that is cut at some power is wrong at the edge of the range. They are fitted to h itself here.

[1] Ahmadi, Hill, Jiang, Neild, Nonlinear Dynamics (2023), doi 10.1007/s11071-023-08813-z.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from romsindy.beam.assembly import Assembly
from romsindy.beam.static_curve import StaticCurve, follow_static_curve
from romsindy.beam.statics import Shape
from romsindy.physics.model import ReducedModel


def reduce(
    assembly: Assembly, equilibrium: Shape, mode: int, order: int, amplitude: float, cases: int
) -> ReducedModel:
    """Return the inertially compensated single-mode model of a beam from static cases.

    omega^2 is the mode's; gamma_2 ... gamma_order and Upsilon_3 ... Upsilon_order are least squares
    over the amplitude range.  On a wide range they are the best polynomial, not the Taylor series:
    an order well above the one of interest comes close to that.

    Parameters
    ----------
    assembly : Assembly
        The beam; damping is left out.
    equilibrium : Shape
        Where it rests.
    mode : int
        The mode, counted from 1.
    order : int
        Highest power of q in the force; the inertia goes to q^(order - 1).
    amplitude : float
        Largest |q|, kg^0.5 m.
    cases : int
        Number of static cases, both directions together.

    Raises
    ------
    ValueError
        For an order below 3, too few cases, an amplitude that is not positive, or a
        mode that does not exist.
    NoEquilibriumError
        If the beam cannot be held that far.
    """
    if order < 3:
        raise ValueError(f"order = {order} leaves no inertia term; give 3 or more")
    if cases < 2 * order:
        raise ValueError(
            f"cases = {cases} static cases are too few for order {order}; give {2 * order} or more"
        )
    curve = follow_static_curve(assembly, equilibrium, mode, amplitude, cases)
    coefficients = {"omega^2": curve.omega2}
    coefficients |= stiffness_coefficients(curve, order)
    coefficients |= inertia_coefficients(assembly, curve, order)
    return ReducedModel.from_coefficients(
        coefficients, unit="kg^0.5 m", amplitude_range=(0.0, amplitude)
    )


def stiffness_coefficients(curve: StaticCurve, order: int) -> dict[str, float]:
    """Return gamma_2 ... gamma_order from the static force."""
    powers = range(2, order + 1)
    gamma = _fit(curve.q, (curve.force - curve.omega2 * curve.q)[:, None], powers)[:, 0]
    return {f"gamma_{m}": float(value) for m, value in zip(powers, gamma, strict=True)}


def inertia_coefficients(assembly: Assembly, curve: StaticCurve, order: int) -> dict[str, float]:
    """Return Upsilon_3 ... Upsilon_order: the first from the shapes, the others from h(q)."""
    away = curve.shapes - curve.basis.equilibrium.displacement
    slaves = away - np.multiply.outer(curve.q, curve.basis.shape(curve.mode))
    beta_2 = _fit(curve.q, slaves.reshape(len(curve.q), -1), range(2, order))[0].reshape(-1, 3)
    first = 4.0 * float(np.vdot(beta_2, assembly.mass_times(beta_2)))
    left = curve.inertia - 1.0 - first * curve.q**2
    powers = range(3, order)
    found = {"Upsilon_3": first}
    for power, value in zip(powers, _fit(curve.q, left[:, None], powers), strict=True):
        # odd powers carry 2 Upsilon, as in [1]
        found[f"Upsilon_{power + 1}"] = float(value[0]) / (2.0 if power % 2 else 1.0)
    return found


def _fit(q: np.ndarray, values: np.ndarray, powers: range) -> np.ndarray:
    """Return least-squares coefficients, (n_powers, n_columns), of the powers of q."""
    scale = np.abs(q).max()
    columns = np.power.outer(q / scale, np.array(powers))
    solution, *_ = np.linalg.lstsq(columns, values, rcond=None)
    return solution / scale ** np.array(powers)[:, None]


def relative_error(
    identified: Mapping[str, float] | ReducedModel, truth: Mapping[str, float] | ReducedModel
) -> dict[str, float]:
    """Return |identified - true| / |true| of every coefficient of `truth`, eq. (20) of [1].

    A coefficient that was not identified counts as zero, so its error is one; one that is truly
    zero has no relative error (nan).

    Examples
    --------
    >>> relative_error({"omega^2": 45.0}, {"omega^2": 36.0})
    {'omega^2': 0.25}
    """
    found, true = (m if isinstance(m, Mapping) else m.coefficients for m in (identified, truth))
    return {
        name: abs(found.get(name, 0.0) - value) / abs(value) if value else float("nan")
        for name, value in true.items()
    }
