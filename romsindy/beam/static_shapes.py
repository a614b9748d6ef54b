"""The shapes that a beam takes under modal forces: along one mode, or over several.

Held by the sum of f_i M phi_i, the beam takes a shape x(r) at r_i = phi_i^T M (x - x_eq). Moving
along this surface is the motion of R coordinates ([1]):

    M_ij = dx/dr_i^T M dx/dr_j         inertia, the identity at r = 0
    f_i = dV/dr_i                      restoring forces, V the potential energy

Of one mode it is a curve, and r is q:

    x'^T M x' = 1 + h(q)               inertia
    K(q) = f = dV/dq                   restoring force
    S(q) = integral of e'^T C e'       damping by the material, for eta = 1; e' = de/dq, strains e

The tangents dx/dr_i are exact: the tangent stiffness K_t of each shape gives them. Where all forces
but one are zero, the surface holds the static curve of that mode.

[1] E. Nicolaidou, T. L. Hill, S. A. Neild, "Indirect reduced-order modelling: using nonlinear
    manifolds to conserve kinetic energy", Proc. R. Soc. A 476 (2020), doi 10.1098/rspa.2020.0589.

Direct reduced-order modelling: the "true" parameters of modes from static load cases.

Of one mode, the beam is held by the modal force f M phi at many q = phi^T M (x - x_eq), in both
directions, and reduced as any structure is (`romsindy.structure.held`).

Of several modes, with their static surface x(r):

    V(r) = sum_i omega_i^2 r_i^2 / 2 + sum_a V_a r^a    fitted to the forces f = dV/dr
    g(r) = x - x_eq - sum_i phi_i r_i = sum_a g_a r^a   fitted to the tangents dx/dr - phi
    M(r) = 1 + J^T M J,  J = dg/dr                      from the products g_a^T M g_b

over powers a = (a_1, ..., a_R). One potential gives the forces of all equations, so they are
reciprocal. It is g that is cut, at the power order - 1: M is complete up to that power, holds some
products of higher powers as well, and is positive definite everywhere.

[2] Ahmadi, Hill, Jiang, Neild, Nonlinear Dynamics (2023), doi 10.1007/s11071-023-08813-z.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement, product
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from romsindy.beam.assembly import Assembly, factorise, solve
from romsindy.beam.equilibrium import ModalBasis, Shape, find_displaced, solve_modes, work
from romsindy.beam.structure import BeamStructure
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import Along, CoupledTerm, MixedStiffness, Powers, SlavedInertia
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.validation import require_positive
from romsindy.structure.held import coefficients
from romsindy.text import bar


@dataclass(frozen=True, eq=False)
class StaticCurve:
    """Shapes of a beam along one mode, and what a motion along them feels."""

    beam: BeamStructure
    basis: ModalBasis  # about the equilibrium
    mode: int  # number of the one that is forced
    reach: float  # largest coordinate of interest, kg^0.5 m
    q: np.ndarray  # (n,), ascending and with 0 among them, kg^0.5 m
    force: np.ndarray  # (n,), K(q), kg^0.5 m/s^2
    shapes: np.ndarray  # (n, n_nodes, 3), (u, w, theta) from the straight rest, m, m, rad
    tangents: np.ndarray  # (n, n_nodes, 3), their derivatives by q

    def __repr__(self) -> str:
        return (
            f"StaticCurve(mode {self.mode}, {len(self.q)} shapes, "
            f"q = {self.q[0]:.4g} to {self.q[-1]:.4g} kg^0.5 m)"
        )

    @property
    def omega2(self) -> float:
        """Square of the linear frequency, 1/s^2."""
        return float(self.basis.omega[self.basis.index(self.mode)] ** 2)

    @property
    def point(self) -> float | None:
        """Where the mode moves most, m; None is the right end."""
        return self.basis.point(self.mode)

    @property
    def rest(self) -> np.ndarray:
        """Equilibrium displacement, (n_nodes, 3), m, m, rad."""
        return self.basis.equilibrium.displacement

    @property
    def following(self) -> np.ndarray:
        """x - x_eq - phi q, what follows the mode, (n, 3 n_nodes)."""
        moved = np.multiply.outer(self.q, self.basis.shape(self.mode))
        return (self.shapes - self.rest - moved).reshape(len(self.q), -1)

    def mass_product(self, field: np.ndarray) -> float:
        """field^T M field of a field (3 n_nodes,)."""
        return 2.0 * self.assembly.kinetic(field.reshape(-1, 3))

    def within(self, q: np.ndarray) -> np.ndarray:
        """Coordinates, those beyond the curve at its ends."""
        return np.clip(q, self.q[0], self.q[-1])

    @cached_property
    def assembly(self) -> Assembly:
        """The discretised beam."""
        return Assembly(self.beam)

    @property
    def inertia(self) -> np.ndarray:
        """1 + h(q) = x'^T M x', shape (n,)."""
        return np.array([2.0 * self.assembly.kinetic(v) for v in self.tangents])

    def resistance(self, effect: Any, rate: float) -> CubicSpline:
        """Return what an effect adds to the left side of the equation of motion, over q.

        The effect is a load or a change of the beam, ``rate`` is q_dot, kg^0.5 m/s.
        """
        changed, own = Assembly(effect.applied_to(self.beam)), self.assembly
        work = [
            np.vdot(v, changed.residual(x, rate * v)[0] - own.residual(x, rate * v)[0])
            for x, v in zip(self.shapes, self.tangents, strict=True)
        ]
        return CubicSpline(self.q, work)

    def read_by(
        self, coordinate: Callable[[np.ndarray], np.ndarray], reach: float, n: int
    ) -> StaticCurve:
        """Return the curve over another coordinate, at `n` even steps.

        The coordinate is linear and takes displacements from the equilibrium, (n, n_nodes, 3), to
        (n,) values; ``reach`` is the largest of interest, kg^0.5 m.
        """
        q = coordinate(self.shapes - self.rest)
        slope = coordinate(self.tangents)  # d(new q)/dq
        spline = CubicHermiteSpline(q, self.shapes, self.tangents / slope[:, None, None])
        grid = np.linspace(q[0], q[-1], n)
        force = CubicSpline(q, self.force / slope)(grid)
        return replace(
            self, reach=reach, q=grid, force=force, shapes=spline(grid), tangents=spline(grid, 1)
        )


def follow_static_curve(
    assembly: Assembly, equilibrium: Shape, mode: int, amplitude: float, cases: int
) -> StaticCurve:
    """Hold the beam by a modal force at `cases` values of q beside 0 in [-amplitude, amplitude].

    The values are evenly spaced; each direction is walked outwards from the equilibrium.

    Raises a ValueError for an amplitude that is not positive, no cases, or a mode that does not
    exist, and a NoEquilibriumError if the beam cannot be held that far.
    """
    require_positive("amplitude", amplitude)
    require_positive("cases", cases)
    if mode < 1:
        raise ValueError(f"mode = {mode} does not exist; modes count from 1")
    basis = solve_modes(assembly, equilibrium, max(mode, 3))
    half = (cases + 1) // 2
    steps = amplitude * np.arange(1, half + 1) / half
    q = np.concatenate([[0.0], np.stack([-steps, steps], axis=1).ravel()])
    outwards = _held(assembly, basis, [mode], q[:, None], q[:, None] / amplitude)
    order = np.argsort(q)
    force, shapes, tangents = (x[order] for x in outwards)
    return StaticCurve(
        assembly.structure, basis, mode, amplitude, q[order], force[:, 0], shapes, tangents[:, 0]
    )


def _held(
    assembly: Assembly,
    basis: ModalBasis,
    modes: Sequence[int],
    r: np.ndarray,
    points: np.ndarray,
    progress: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces (n, R), shapes and tangents of a `StaticSurface`, from the equilibrium r[0] outwards.

    Each case starts from the one solved before that is nearest among ``points``, (n, R).
    """
    momenta = basis.momenta[[basis.index(mode) for mode in modes]]
    rest = basis.equilibrium.displacement
    origin = np.tensordot(momenta, rest, axes=2)
    shapes, force = [rest], [np.zeros(len(modes))]
    later = range(1, len(r))
    for i in bar(later, "static cases", unit="case") if progress else later:
        near = int(np.argmin(np.linalg.norm(points[:i] - points[i], axis=1)))
        goal = origin + r[i]
        x, factors = find_displaced(assembly, shapes[near], momenta, momenta, goal, force[near])
        shapes.append(x)
        force.append(factors)
    tangents = [_tangents(assembly, x, momenta) for x in shapes]
    return np.array(force), np.array(shapes), np.array(tangents)


def _tangents(assembly: Assembly, x: np.ndarray, momenta: np.ndarray) -> np.ndarray:
    """Return dx/dr_j, (R, n_nodes, 3), of a shape held by modal forces, from momenta M phi_j.

    K_t dx/dr_j is a sum of the M phi_i, and phi_i^T M dx/dr_j is 1 for i = j, else 0.
    """
    stiffness, _ = assembly.tangents(x)
    factorised = factorise(stiffness, assembly.fixed)
    free = np.where(assembly.fixed, 0.0, momenta)
    moved = np.array([solve(factorised, load) for load in free])
    return np.tensordot(np.linalg.inv(work(momenta, moved)).T, moved, axes=1)


@dataclass(frozen=True, eq=False)
class StaticSurface:
    """Static cases of a beam over the coordinates of several modes."""

    basis: ModalBasis  # the modes about the equilibrium
    modes: tuple[int, ...]  # numbers of the R modes that are forced
    reach: np.ndarray  # (R,), half axes of the ellipsoid that holds the cases, kg^0.5 m
    r: np.ndarray  # (n, R), coordinates, from the equilibrium outwards, kg^0.5 m
    force: np.ndarray  # (n, R), dV/dr, kg^0.5 m/s^2
    # (n, n_nodes, 3), displacements (u, w, theta) from the straight rest, m, m, rad
    shapes: np.ndarray
    tangents: np.ndarray  # (n, R, n_nodes, 3), their derivatives with respect to r

    @property
    def rows(self) -> list[int]:
        """Rows of the modes in the basis."""
        return [self.basis.index(mode) for mode in self.modes]


def find_static_surface(
    assembly: Assembly,
    equilibrium: Shape,
    modes: Sequence[int],
    amplitudes: Sequence[float],
    cases: int,
    *,
    progress: bool = True,
) -> StaticSurface:
    """Hold the beam by forces of several modes, at `cases` points of an ellipsoid or some more.

    The points are on shells around the equilibrium, see `shells`. Each case starts from the one
    solved before that is nearest.

    Raises a NoEquilibriumError if the beam cannot be held somewhere in the ellipsoid.
    """
    basis = solve_modes(assembly, equilibrium, max(modes))
    points = shells(len(modes), cases)
    r = points * amplitudes
    force, shapes, tangents = _held(assembly, basis, modes, r, points, progress)
    reach = np.array(amplitudes, float)
    return StaticSurface(basis, tuple(modes), reach, r, force, shapes, tangents)


def shells(dimensions: int, cases: int) -> np.ndarray:
    """Return at least `cases` points of the unit ball, (n, dimensions), from its centre outwards.

    They are those of a cubic lattice with an odd number along each axis, its cubes blown up to
    spheres. The shells draw together towards the last one, as Chebyshev points do, so that a
    polynomial fitted there does not sway at the edge.
    """
    half = next(h for h in range(1, cases + 1) if (2 * h + 1) ** dimensions >= cases)
    axis = np.arange(-half, half + 1)
    lattice = np.stack(np.meshgrid(*[axis] * dimensions, indexing="ij"), axis=-1)
    lattice = lattice.reshape(-1, dimensions)
    shell = np.max(np.abs(lattice), axis=1)
    order = np.argsort(shell, kind="stable")
    lattice, shell = lattice[order], shell[order]
    length = np.maximum(np.linalg.norm(lattice, axis=1), 1.0)  # the centre stays where it is
    radius = np.sin(np.pi / 2 * shell / half)
    return np.asarray(lattice * (radius / length)[:, None])


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
