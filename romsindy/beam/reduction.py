"""Direct reduced-order modelling: the "true" parameters of modes from static load cases.

Of one mode, the beam is held by the modal force f M phi at many q = phi^T M (x - x_eq), in both
directions, and reduced as any structure is (`romsindy.structure.coefficients`).

Of several modes, with their static surface x(r):

    V(r) = sum_i omega_i^2 r_i^2 / 2 + sum_a V_a r^a    fitted to the forces f = dV/dr
    g(r) = x - x_eq - sum_i phi_i r_i = sum_a g_a r^a   fitted to the tangents dx/dr - phi
    M(r) = 1 + J^T M J,  J = dg/dr                      from the products g_a^T M g_b

over powers a = (a_1, ..., a_R). One potential gives the forces of all equations, so they are
reciprocal. It is g that is cut, at the power order - 1: M is complete up to that power, holds some
products of higher powers as well, and is positive definite everywhere.

[1] Ahmadi, Hill, Jiang, Neild, Nonlinear Dynamics (2023), doi 10.1007/s11071-023-08813-z.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations_with_replacement, product

import numpy as np

from romsindy.beam.assembly import Assembly
from romsindy.beam.equilibrium import Shape
from romsindy.beam.static_shapes import (
    StaticSurface,
    find_static_surface,
    follow_static_curve,
)
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import Along, CoupledTerm, MixedStiffness, Powers, SlavedInertia
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.validation import require_positive
from romsindy.structure.coefficients import coefficients


def reduce(
    assembly: Assembly, equilibrium: Shape, mode: int, order: int, amplitude: float, cases: int
) -> ReducedModel:
    """Return the inertially compensated model of one mode from static cases.

    omega^2 is the mode's; gamma_2 ... gamma_order and Upsilon_3 ... Upsilon_order are least squares
    over the amplitude range. On a wide range they are the best polynomial, not the Taylor series:
    an order well above the one of interest comes close to that. Arguments and errors are those of
    `Beam.reduce`.
    """
    if order < 3:
        raise ValueError(f"order = {order} leaves no inertia term; give 3 or more")
    if cases < 2 * order:
        raise ValueError(
            f"cases = {cases} static cases are too few for order {order}; give {2 * order} or more"
        )
    curve = follow_static_curve(assembly, equilibrium, mode, amplitude, cases)
    return ReducedModel.from_coefficients(
        coefficients(curve, order), unit="kg^0.5 m", amplitude_range=(0.0, amplitude)
    )


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


Terms = dict[CoupledTerm, float]


def reduce_modes(
    assembly: Assembly,
    equilibrium: Shape,
    modes: Sequence[int],
    order: int,
    amplitudes: Sequence[float],
    cases: int | None,
    *,
    progress: bool = True,
) -> CoupledModel:
    """Return the model of several modes from static cases.

    Arguments and errors are those of `Beam.reduce`.
    """
    if cases is None:
        cases = (2 * order + 1) ** len(modes)
    _check_modes(assembly, modes)
    _check_cases(len(modes), order, amplitudes, cases)
    surface = find_static_surface(
        assembly, equilibrium, modes, amplitudes, cases, progress=progress
    )
    terms = potential_terms(surface, order) | inertia_terms(assembly, surface, order)
    reach = (0.0, float(max(amplitudes)))
    return CoupledModel(tuple(terms), tuple(terms.values()), "kg^0.5 m", reach)


def _check_modes(assembly: Assembly, modes: Sequence[int]) -> None:
    if len(set(modes)) < len(modes):
        raise ValueError(f"modes = {tuple(modes)} holds a mode twice; give each once")
    most = int(np.count_nonzero(~assembly.fixed)) - 2
    for mode in modes:
        if mode < 1:
            raise ValueError(f"mode = {mode} does not exist; modes count from 1")
        if mode > most:
            raise ValueError(
                f"mode = {mode} does not exist on this mesh, which has {most}; use more elements"
            )


def _check_cases(dimensions: int, order: int, amplitudes: Sequence[float], cases: int) -> None:
    if order < 3:
        raise ValueError(f"order = {order} leaves no inertia term; give 3 or more")
    for amplitude in amplitudes:
        require_positive("amplitude", amplitude)
    # Along a line through the equilibrium, forces of this order need order + 1 points.
    least = (order + 2) ** dimensions
    if cases < least:
        raise ValueError(
            f"cases = {cases} static cases are too few for order {order} of {dimensions} modes;"
            f" give {least} or more"
        )


def potential_terms(surface: StaticSurface, order: int) -> Terms:
    """Return the terms of V: omega^2 of the modes, and powers up to order + 1."""
    omega2 = surface.basis.omega[surface.rows] ** 2
    numbers = range(1, len(omega2) + 1)
    terms: Terms = {
        Along.coordinate(Stiffness(1), i): float(w) for i, w in zip(numbers, omega2, strict=True)
    }
    powers = powers_between(3, order + 1, len(omega2))
    force = (surface.force - omega2 * surface.r)[..., None]
    for power, value in zip(powers, _fit_gradient(surface, force, powers)[:, 0], strict=True):
        terms |= _stiffness(power, float(value))
    return terms


def _stiffness(powers: Powers, value: float) -> Terms:
    """Return the term of a power in V, called gamma where it is one of a single coordinate."""
    moved = [i for i, p in enumerate(powers, 1) if p]
    if len(moved) > 1:
        return {MixedStiffness(powers): value}
    degree = sum(powers)
    return {Along.coordinate(Stiffness(degree - 1), moved[0]): degree * value}


def inertia_terms(assembly: Assembly, surface: StaticSurface, order: int) -> Terms:
    """Return the products of the slaved shapes of all powers up to order - 1."""
    powers = powers_between(2, order - 1, len(surface.modes))
    slopes = surface.tangents - surface.basis.shapes[surface.rows]
    shapes = _fit_gradient(surface, slopes.reshape(*surface.r.shape, -1), powers)
    fields = shapes.reshape(len(powers), -1, 3)
    gram = shapes @ np.array([assembly.mass_times(g).ravel() for g in fields]).T
    pairs = combinations_with_replacement(range(len(powers)), 2)
    return {SlavedInertia(powers[i], powers[j]): float(gram[i, j]) for i, j in pairs}


def powers_between(least: int, most: int, dimensions: int) -> list[Powers]:
    """Return all powers of so many coordinates whose sum is from `least` to `most`."""
    found = product(range(most + 1), repeat=dimensions)
    kept = [powers for powers in found if least <= sum(powers) <= most]
    return sorted(kept, key=lambda p: (sum(p), [-x for x in p]))


def _fit_gradient(surface: StaticSurface, slopes: np.ndarray, powers: list[Powers]) -> np.ndarray:
    """Return coefficients (n_powers, k) of the r^a whose gradients are best `slopes`, (n, R, k).

    Each derivative counts with the reach of its coordinate: all columns are then changes of what
    is differentiated, over the reach.
    """
    p, scaled = np.array(powers), surface.r / surface.reach
    columns = []
    for j in range(p.shape[1]):
        lowered = np.maximum(p - np.eye(p.shape[1], dtype=int)[j], 0)
        columns.append(p[:, j] * np.prod(scaled[:, None] ** lowered, axis=2))
    design = np.stack(columns, axis=1).reshape(-1, len(powers))
    values = (slopes * surface.reach[:, None]).reshape(len(design), -1)
    solution, *_ = np.linalg.lstsq(design, values, rcond=None)
    return np.asarray(solution / np.prod(surface.reach**p, axis=1)[:, None])
