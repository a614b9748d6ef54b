"""Radau IIA collocation for the second-order equation of motion M a + r(x, v) = 0.

A step from (x0, v0) of length h finds the accelerations a_i at the times c_i h, with

    x_i = x0 + c_i h v0 + h^2 sum_j (A^2)_ij a_j,     v_i = v0 + h sum_j A_ij a_j,
    M a_i + r(x_i, v_i) = 0.

The order is 2 s - 1, and the last stage is the end of the step: its acceleration is consistent
with its displacement, and what the step cannot resolve (the axial vibration of a thin beam) dies
within it, as it does in reality.  Symplectic Gauss methods were tried and left: the axial
vibration that they keep spoils both Newton's convergence and the acceleration.

Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (2nd ed., 1996), IV.8.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Polynomial, legendre

Part = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class RadauIIA:
    """The method with `stages` stages, of order 2 * stages - 1.

    Attributes
    ----------
    c : (stages,) array
        Times of the stages as parts of the step; the last is 1.
    A : (stages, stages) array
        The Butcher matrix; its last row holds the weights b.
    """

    stages: int = 3
    c: np.ndarray = field(init=False, repr=False)
    A: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.stages < 2:
            raise ValueError(f"stages must be 2 or more, got {self.stages}; 3 gives order 5")
        c = _nodes(self.stages)
        integrals = [p.integ() for p in lagrange(c)]
        A = np.array([[p(ci) for p in integrals] for ci in c])
        object.__setattr__(self, "c", c)
        object.__setattr__(self, "A", A)

    def parts(self) -> tuple[Part, Part]:
        """Return A = T diag(eigenvalues) T^-1 as (eigenvalues, columns of T, rows of T^-1).

        The real eigenvalues come first, then one of each complex pair.  They split the Newton
        system of all stages into one real and a few complex systems of the size of the beam.
        """
        values, T = np.linalg.eig(self.A)
        inverse = np.linalg.inv(T)
        real, upper = values.imag == 0.0, values.imag > 0.0
        columns = np.ascontiguousarray
        return (
            (values[real].real, columns(T[:, real].real), inverse[real].real.copy()),
            (values[upper], columns(T[:, upper]), inverse[upper]),
        )

    @property
    def order(self) -> int:
        """The classical order."""
        return 2 * self.stages - 1

    def extrapolation(self, ratio: float) -> np.ndarray:
        """Return E: stages of a next step, `ratio` times as long, are about E @ stages."""
        return np.array([[p(1.0 + ratio * c) for p in lagrange(self.c)] for c in self.c])


def lagrange(nodes: np.ndarray) -> list[Polynomial]:
    """Return the Lagrange polynomials of the nodes."""
    basis = [Polynomial.fromroots(np.delete(nodes, i)) for i in range(len(nodes))]
    return [p / p(node) for p, node in zip(basis, nodes, strict=True)]


def _nodes(stages: int) -> np.ndarray:
    """Return the zeros of P_s(2c - 1) - P_(s-1)(2c - 1), P the Legendre polynomials."""
    series = np.zeros(stages + 1)
    series[[stages, stages - 1]] = 1.0, -1.0
    c = 0.5 * (1.0 + np.sort(legendre.legroots(series).real))
    c[-1] = 1.0
    return c
