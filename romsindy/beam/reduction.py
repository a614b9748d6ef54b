"""Direct reduced-order modelling: the "true" single-mode parameters from static load cases.

The beam is held by the modal force f M phi at many q = phi^T M (x - x_eq), in both directions.
Notation as in [1], eqs. (10)-(17):

    f(q) = omega^2 q + sum_m gamma_m q^m                          stiffness, from the force
    s(q) = x - x_eq - phi q = sum_k beta_k q^k                    what follows quasi-statically
    beta_bar_kl = beta_k^T M beta_l
    1 + ds/dq^T M ds/dq = 1 + sum_kl k l beta_bar_kl q^(k+l-2)
                        = 1 + Upsilon_3 q^2 + 2 Upsilon_4 q^3 + Upsilon_5 q^4 + ...

so Upsilon_3 = 4 beta_bar_22, Upsilon_4 = 6 beta_bar_23, Upsilon_5 = 9 beta_bar_33 + 16
beta_bar_24.

[1] Ahmadi, Hill, Jiang, Neild, Nonlinear Dynamics (2023), doi 10.1007/s11071-023-08813-z.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from romsindy.beam.assembly import Assembly
from romsindy.beam.modes import ModalBasis, solve_modes
from romsindy.beam.statics import Control, Shape, find_displaced
from romsindy.beam.validation import require_positive
from romsindy.physics.model import ReducedModel


@dataclass(frozen=True, eq=False)
class StaticCases:
    """Static shapes under a modal force.

    Attributes
    ----------
    mode
        Number of the mode that is forced.
    basis
        The modes about the equilibrium.
    q
        Modal displacement of each case [kg^0.5 m], shape (n_cases,).
    force
        F, so that f M phi is the load [kg^0.5 m/s^2], shape (n_cases,).
    displacement
        From the straight rest, shape (n_cases, n_nodes, 3).
    """

    mode: int
    basis: ModalBasis
    q: np.ndarray
    force: np.ndarray
    displacement: np.ndarray

    @property
    def slaves(self) -> np.ndarray:
        """x - x_eq - phi q of each case, shape (n_cases, n_nodes * 3)."""
        relative = self.displacement - self.basis.equilibrium.displacement
        relative = relative - np.multiply.outer(self.q, self.basis.shape(self.mode))
        return relative.reshape(len(self.q), -1)


def solve_static_cases(
    assembly: Assembly, equilibrium: Shape, mode: int, amplitude: float, cases: int
) -> StaticCases:
    """Hold the beam by a modal force at `cases` values of q in [-amplitude, amplitude].

    The values are evenly spaced; each direction is walked outwards from the equilibrium.

    Raises
    ------
    ValueError
        For an amplitude that is not positive, or a mode that does not exist.
    NoEquilibriumError
        If the beam cannot be held that far.
    """
    require_positive("amplitude", amplitude)
    if mode < 1:
        raise ValueError(f"mode = {mode} does not exist; modes count from 1")
    basis = solve_modes(assembly, equilibrium, max(mode, 3))
    half = (cases + 1) // 2  # the equilibrium itself needs no solve
    positive = amplitude * np.arange(1, half + 1) / half
    momentum = basis.momenta[basis.index(mode)]
    rest = basis.equilibrium.displacement
    origin = float(np.vdot(momentum, rest))
    q, force, shapes = [], [], []
    for direction in (1.0, -1.0):
        x, factor = rest, 0.0
        for value in direction * positive:
            x, factor = find_displaced(
                assembly, x, momentum, Control(momentum), origin + value, factor
            )
            q.append(value)
            force.append(factor)
            shapes.append(x)
    return StaticCases(mode, basis, np.array(q), np.array(force), np.array(shapes))


def reduce(
    assembly: Assembly, equilibrium: Shape, mode: int, order: int, amplitude: float, cases: int
) -> ReducedModel:
    """Return the inertially compensated single-mode model of a beam from static cases.

    omega^2 is the mode's; gamma_2 ... gamma_order and the beta_k are least squares over the
    amplitude range.  On a wide range they are the best polynomial, not the Taylor series: an
    order well above the one of interest comes close to that.

    Parameters
    ----------
    beam
        The beam; damping is left out.
    mode
        The mode, counted from 1.
    order
        Highest power of q in the force; the inertia goes to q^(order - 1).
    amplitude
        Largest |q| [kg^0.5 m].
    cases
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
    solved = solve_static_cases(assembly, equilibrium, mode, amplitude, cases)
    omega2 = float(solved.basis.omega[solved.basis.index(mode)] ** 2)
    coefficients = {"omega^2": omega2}
    coefficients |= stiffness_coefficients(solved, omega2, order)
    coefficients |= inertia_coefficients(beta_bar(assembly, solved, order), order)
    return ReducedModel.from_coefficients(
        coefficients, unit="kg^0.5 m", amplitude_range=(0.0, amplitude)
    )


def stiffness_coefficients(cases: StaticCases, omega2: float, order: int) -> dict[str, float]:
    """Return gamma_2 ... gamma_order from the static force."""
    powers = range(2, order + 1)
    gamma = _fit(cases.q, (cases.force - omega2 * cases.q)[:, None], powers)[:, 0]
    return {f"gamma_{m}": float(value) for m, value in zip(powers, gamma, strict=True)}


def beta_bar(assembly: Assembly, cases: StaticCases, order: int) -> np.ndarray:
    """Return beta_k^T M beta_l for k, l = 2 ... order - 1, shape (order - 2, order - 2)."""
    beta = _fit(cases.q, cases.slaves, range(2, order))
    fields = beta.reshape(len(beta), -1, 3)
    momenta = np.array([assembly.mass_times(field) for field in fields])
    return np.einsum("kni,lni->kl", fields, momenta)


def inertia_coefficients(beta_bar: np.ndarray, order: int) -> dict[str, float]:
    """Return Upsilon_3 ... Upsilon_order from beta_bar."""
    result = {}
    for m in range(3, order + 1):
        # k + l - 2 = m - 1; odd powers carry 2 Upsilon, so that no k l pair counts twice
        pairs = [(k, m + 1 - k) for k in range(2, m)]
        total = sum(k * j * beta_bar[k - 2, j - 2] for k, j in pairs)
        result[f"Upsilon_{m}"] = float(total) / (2.0 if m % 2 == 0 else 1.0)
    return result


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
    found, true = (
        m.coefficients if isinstance(m, ReducedModel) else m for m in (identified, truth)
    )
    return {
        name: abs(found.get(name, 0.0) - value) / abs(value) if value else float("nan")
        for name, value in true.items()
    }
