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
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from romsindy.beam.assembly import Assembly, factorise, solve
from romsindy.beam.equilibrium import ModalBasis, Shape, find_displaced, solve_modes, work
from romsindy.beam.structure import BeamStructure
from romsindy.physics.validation import require_positive
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

    @property
    def material_damping(self) -> np.ndarray:
        """S(q), shape (n,), 1/s^2: the damping force is eta S(q) q_dot."""
        pairs = zip(self.shapes, self.tangents, strict=True)
        return np.array([self.assembly.material_stiffness(x, v) for x, v in pairs])

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
        tangents = self.tangents / slope[:, None, None]
        spline = CubicHermiteSpline(q, self.shapes, tangents)
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
