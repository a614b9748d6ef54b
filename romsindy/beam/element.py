"""Shape functions and mass matrix of the quadratic, planar, geometrically exact beam element.

The beam is straight at rest along x.  A node has the degrees of freedom (u, w, theta): axial and
transverse displacement [m] and rotation [rad] of the cross-section.  `kernel.py` holds strains and
forces.
"""

from __future__ import annotations

import numpy as np

from romsindy.beam.section import Section


def shape_functions(xi: float) -> np.ndarray:
    """Return the three quadratic shape functions at xi in [-1, 1]."""
    return np.array([0.5 * xi * (xi - 1.0), 1.0 - xi * xi, 0.5 * xi * (xi + 1.0)])


def mass(length: float, section: Section) -> np.ndarray:
    """Return the consistent mass matrix, shape (9, 9); constant, since the motion is planar.

    Integrated with three Gauss points, which is exact.
    """
    density = np.diag([section.mass, section.mass, section.rotary_inertia])
    M = np.zeros((9, 9))
    for xi, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        N = shape_functions(xi)
        M += 0.5 * length * weight * np.kron(np.outer(N, N), density)
    return M
