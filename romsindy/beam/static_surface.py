"""The static surface of several modes: the shapes that the beam takes under their modal forces.

Held by the sum of f_i M phi_i, the beam takes a shape x(r) at r_i = phi_i^T M (x - x_eq). Moving
along this surface is the motion of R coordinates ([1]):

    M_ij = dx/dr_i^T M dx/dr_j         inertia, the identity at r = 0
    f_i = dV/dr_i                      restoring forces, V the potential energy

The tangents dx/dr_i are exact, as those of a `StaticCurve`. Where all forces but one are zero, the
surface holds the static curve of that mode.

[1] E. Nicolaidou, T. L. Hill, S. A. Neild, "Indirect reduced-order modelling: using nonlinear
    manifolds to conserve kinetic energy", Proc. R. Soc. A 476 (2020), doi 10.1098/rspa.2020.0589.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.beam.assembly import Assembly
from romsindy.beam.modes import ModalBasis, solve_modes
from romsindy.beam.static_curve import find_tangents
from romsindy.beam.statics import Shape, find_displaced
from romsindy.text import bar


@dataclass(frozen=True, eq=False)
class StaticSurface:
    """Static cases of a beam over the coordinates of several modes.

    Attributes
    ----------
    basis : ModalBasis
        The modes about the equilibrium.
    modes : tuple of int
        Numbers of the R modes that are forced.
    reach : (R,) array
        Half axes of the ellipsoid that holds the cases, kg^0.5 m.
    r : (n, R) array
        Coordinates, from the equilibrium outwards, kg^0.5 m.
    force : (n, R) array
        dV/dr, kg^0.5 m/s^2.
    shapes : (n, n_nodes, 3) array
        Displacements (u, w, theta) from the straight rest, m, m, rad.
    tangents : (n, R, n_nodes, 3) array
        Their derivatives with respect to r.
    """

    basis: ModalBasis
    modes: tuple[int, ...]
    reach: np.ndarray
    r: np.ndarray
    force: np.ndarray
    shapes: np.ndarray
    tangents: np.ndarray

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

    Raises
    ------
    NoEquilibriumError
        If the beam cannot be held somewhere in the ellipsoid.
    """
    basis = solve_modes(assembly, equilibrium, max(modes))
    momenta = basis.momenta[[basis.index(mode) for mode in modes]]
    points = shells(len(modes), cases)
    r = points * amplitudes
    origin = np.tensordot(momenta, equilibrium.displacement, axes=2)
    shapes, force = [equilibrium.displacement], [np.zeros(len(modes))]
    later = range(1, len(points))
    for i in bar(later, "static cases", unit="case") if progress else later:
        near = int(np.argmin(np.linalg.norm(points[:i] - points[i], axis=1)))
        x, factors = find_displaced(
            assembly, shapes[near], momenta, momenta, origin + r[i], force[near]
        )
        shapes.append(x)
        force.append(factors)
    tangents = np.array([find_tangents(assembly, x, momenta) for x in shapes])
    return StaticSurface(
        basis,
        tuple(modes),
        np.array(amplitudes, float),
        r,
        np.array(force),
        np.array(shapes),
        tangents,
    )


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
