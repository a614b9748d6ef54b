"""The beam element written to be read: the oracle of the compiled kernel.

Strains as in `romsindy/beam/kernel.py`, with N = EA eps, Q = GA gamma, M = EI kappa.
"""

from __future__ import annotations

import numpy as np

from romsindy.beam import Section
from romsindy.beam.assembly import shape_functions

NODES = 3
DOFS = 9
STRAIN_POINTS, STRAIN_WEIGHTS = np.polynomial.legendre.leggauss(2)


def shape_slopes(xi: float, length: float) -> np.ndarray:
    """Return d/ds of the three shape functions at xi for an element of `length` [m]."""
    return np.array([xi - 0.5, -2.0 * xi, xi + 0.5]) * (2.0 / length)


def strains(x: np.ndarray, xi: float, length: float) -> np.ndarray:
    """Return (eps, gamma, kappa) at xi of an element with nodal displacements x, shape (3, 3)."""
    du, dw, dtheta = shape_slopes(xi, length) @ x
    theta = shape_functions(xi) @ x[:, 2]
    c, s = np.cos(theta), np.sin(theta)
    return np.array([(1 + du) * c + dw * s - 1.0, dw * c - (1 + du) * s, dtheta])


def strain_matrix(x: np.ndarray, xi: float, length: float) -> np.ndarray:
    """Return B, shape (3, 9): d(eps, gamma, kappa) = B dx; strain rates are B v."""
    N, dN = shape_functions(xi), shape_slopes(xi, length)
    theta = N @ x[:, 2]
    c, s = np.cos(theta), np.sin(theta)
    eps, gamma, _ = strains(x, xi, length)
    B = np.zeros((3, NODES, 3))
    B[0] = np.column_stack([c * dN, s * dN, gamma * N])
    B[1] = np.column_stack([-s * dN, c * dN, -(1 + eps) * N])
    B[2, :, 2] = dN
    return B.reshape(3, DOFS)


def geometric_stiffness(
    x: np.ndarray, xi: float, length: float, normal: float, shear: float
) -> np.ndarray:
    """Return the (9, 9) derivative of B^T at constant stress: normal and shear force in N."""
    N, dN = shape_functions(xi), shape_slopes(xi, length)
    theta = N @ x[:, 2]
    c, s = np.cos(theta), np.sin(theta)
    eps, gamma, _ = strains(x, xi, length)
    G = np.zeros((NODES, 3, NODES, 3))
    G[:, 0, :, 2] = np.outer(dN, N) * (-normal * s - shear * c)
    G[:, 1, :, 2] = np.outer(dN, N) * (normal * c - shear * s)
    G[:, 2, :, 0] = G[:, 0, :, 2].T
    G[:, 2, :, 1] = G[:, 1, :, 2].T
    G[:, 2, :, 2] = np.outer(N, N) * (-normal * (1 + eps) - shear * gamma)
    return G.reshape(DOFS, DOFS)


def internal_force(
    x: np.ndarray, v: np.ndarray, length: float, section: Section, eta: float = 0.0
) -> np.ndarray:
    """Return the element's internal force, shape (3, 3): integral of B^T C (e + eta e_dot).

    Damping acts on the strain rate, seen in the rotating section, so a rigid rotation is free.

    Parameters
    ----------
    x, v : (3, 3) array
        Nodal displacements (m, m, rad) and velocities.
    length : float
        Element length, m.
    section : Section
        The cross-section's stiffness.
    eta : float
        Stiffness-proportional damping, s.
    """
    C = np.array([section.EA, section.GA, section.EI])
    force = np.zeros(DOFS)
    for xi, weight in zip(STRAIN_POINTS, STRAIN_WEIGHTS, strict=True):
        B = strain_matrix(x, xi, length)
        stress = C * (strains(x, xi, length) + eta * (B @ v.ravel()))
        force += 0.5 * length * weight * (B.T @ stress)
    return force.reshape(NODES, 3)


def tangent(x: np.ndarray, length: float, section: Section) -> tuple[np.ndarray, np.ndarray]:
    """Return (K, D), shape (9, 9) each: the tangent stiffness and its material part B^T C B.

    K is the exact derivative of the undamped internal force; eta * D that of the damping force
    with respect to velocity.
    """
    C = np.array([section.EA, section.GA, section.EI])
    material, geometric = np.zeros((DOFS, DOFS)), np.zeros((DOFS, DOFS))
    for xi, weight in zip(STRAIN_POINTS, STRAIN_WEIGHTS, strict=True):
        B = strain_matrix(x, xi, length)
        normal, shear, _ = C * strains(x, xi, length)
        material += 0.5 * length * weight * (B.T * C @ B)
        geometric += 0.5 * length * weight * geometric_stiffness(x, xi, length, normal, shear)
    return material + geometric, material


def strain_energy(x: np.ndarray, length: float, section: Section) -> float:
    """Return the stored energy [J] of one element."""
    C = np.array([section.EA, section.GA, section.EI])
    return sum(
        0.25 * length * weight * float(C @ strains(x, xi, length) ** 2)
        for xi, weight in zip(STRAIN_POINTS, STRAIN_WEIGHTS, strict=True)
    )
