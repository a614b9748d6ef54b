"""The static curve of a mode: the shapes that the beam takes under the modal force.

Held by f M phi, the beam takes a shape x(q) at every q = phi^T M (x - x_eq). Moving along this
curve is the motion of one coordinate:

    x'^T M x' = 1 + h(q)                 inertia
    K(q) = f = dV/dq                     restoring force, V the potential energy
    S(q) = integral of e'^T C e'         damping by the material, for eta = 1; e' = de/dq, strains e

The tangent x' is exact: the tangent stiffness K_t of each shape gives K_t x' = f' M phi with
phi^T M x' = 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from romsindy.beam.assembly import Assembly, factorise, solve
from romsindy.beam.modes import ModalBasis, solve_modes
from romsindy.beam.statics import Shape, find_displaced, work
from romsindy.beam.structure import Structure
from romsindy.physics.validation import require_positive


@dataclass(frozen=True, eq=False)
class StaticCurve:
    """Shapes of a beam along one mode, and what a motion along them feels.

    Attributes
    ----------
    beam : Structure
    basis : ModalBasis
        The modes about the equilibrium.
    mode : int
        Number of the mode that is forced.
    reach : float
        Largest coordinate of interest, kg^0.5 m.
    q : (n,) array
        Coordinates, ascending and with 0 among them, kg^0.5 m.
    force : (n,) array
        K(q), kg^0.5 m/s^2.
    shapes : (n, n_nodes, 3) array
        Displacements (u, w, theta) from the straight rest, m, m, rad.
    tangents : (n, n_nodes, 3) array
        Their derivatives with respect to q.
    """

    beam: Structure
    basis: ModalBasis
    mode: int
    reach: float
    q: np.ndarray
    force: np.ndarray
    shapes: np.ndarray
    tangents: np.ndarray

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

    Raises
    ------
    ValueError
        For an amplitude that is not positive, no cases, or a mode that does not exist.
    NoEquilibriumError
        If the beam cannot be held that far.
    """
    require_positive("amplitude", amplitude)
    require_positive("cases", cases)
    if mode < 1:
        raise ValueError(f"mode = {mode} does not exist; modes count from 1")
    basis = solve_modes(assembly, equilibrium, max(mode, 3))
    half = (cases + 1) // 2
    steps = amplitude * np.arange(1, half + 1) / half
    up, down = (_held(assembly, basis, mode, sign * steps) for sign in (1.0, -1.0))
    q = np.concatenate([-steps[::-1], [0.0], steps])
    held = [*down[::-1], (equilibrium.displacement, 0.0), *up]
    shapes, force = (np.array(column) for column in zip(*held, strict=True))
    momenta = basis.momenta[basis.index(mode)][None]
    tangents = np.array([find_tangents(assembly, x, momenta)[0] for x in shapes])
    return StaticCurve(assembly.structure, basis, mode, amplitude, q, force, shapes, tangents)


def _held(
    assembly: Assembly, basis: ModalBasis, mode: int, values: np.ndarray
) -> list[tuple[np.ndarray, float]]:
    """Return shapes and factors of the modal force at coordinates that go outwards."""
    momenta = basis.momenta[basis.index(mode)][None]
    x, factors = basis.equilibrium.displacement, np.zeros(1)
    origin = np.tensordot(momenta, x, axes=2)
    found = []
    for value in values:
        x, factors = find_displaced(assembly, x, momenta, momenta, origin + value, factors)
        found.append((x, float(factors[0])))
    return found


def find_tangents(assembly: Assembly, x: np.ndarray, momenta: np.ndarray) -> np.ndarray:
    """Return dx/dr_j, (R, n_nodes, 3), of a shape held by modal forces, from momenta M phi_j.

    K_t dx/dr_j is a sum of the M phi_i, and phi_i^T M dx/dr_j is 1 for i = j, else 0.
    """
    stiffness, _ = assembly.tangents(x)
    factorised = factorise(stiffness, assembly.fixed)
    free = np.where(assembly.fixed, 0.0, momenta)
    moved = np.array([solve(factorised, load) for load in free])
    return np.tensordot(np.linalg.inv(work(momenta, moved)).T, moved, axes=1)
