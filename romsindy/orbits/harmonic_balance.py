"""Harmonic balance: a model's equations for a truncated Fourier series, and their derivatives.

q(t) = a_0 + sum_k a_k cos(k omega t) + b_k sin(k omega t), k = 1 ... H, is kept as the array
c = (a_0, a_1, b_1, ..., a_H, b_H), (2 H + 1, R), with one column for each of R coordinates. Where c
and the equations are a vector, of m = (2 H + 1) R, coordinates of one harmonic stand together.
Forces are evaluated at samples of one period and projected back (alternating frequency and time,
[1]).

[1] M. Krack, J. Gross, "Harmonic Balance for Nonlinear Vibration Problems", Springer (2019).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from romsindy.physics.coupled import AnyModel
from romsindy.physics.term import Term
from romsindy.typing import Array

# Samples for every harmonic: products of up to ten factors, q^9 q_ddot, do not fold back onto the
# harmonics 0 ... H, so that the truncated equation inherits the model's symmetries exactly.
_SAMPLES_PER_HARMONIC = 12
_FEWEST_SAMPLES = 64


@dataclass(frozen=True, eq=False)
class FourierBasis:
    """Matrices between Fourier coefficients and samples at phases omega t of one period.

    Attributes
    ----------
    values, first, second : (n_samples, 2 H + 1) arrays
        From coefficients to samples of q and of its derivatives by the phase.
    projection : (2 H + 1, n_samples) array
        From samples to coefficients, for uniform phases.
    rate : (2 H + 1, 2 H + 1) array
        From coefficients to those of the derivative by the phase.
    """

    values: Array
    first: Array
    second: Array
    projection: Array
    rate: Array

    @classmethod
    def at(cls, phase: Array, n_harmonics: int) -> FourierBasis:
        k = np.arange(1, n_harmonics + 1)
        columns = (len(phase), 2 * n_harmonics + 1)
        values, first = np.ones(columns), np.zeros(columns)
        cos, sin = np.cos(np.outer(phase, k)), np.sin(np.outer(phase, k))
        values[:, 1::2], values[:, 2::2] = cos, sin
        first[:, 1::2], first[:, 2::2] = -k * sin, k * cos
        second = -(np.repeat(np.arange(n_harmonics + 1), 2)[1:] ** 2) * values
        projection = 2 / len(phase) * values.T
        projection[0] /= 2
        rate = np.zeros((columns[1], columns[1]))
        rate[2 * k - 1, 2 * k], rate[2 * k, 2 * k - 1] = k, -k
        return cls(values, first, second, projection, rate)


@lru_cache(maxsize=16)
def uniform_basis(n_harmonics: int) -> FourierBasis:
    """Basis at as many uniform phases as the products of a model need."""
    n = max(_FEWEST_SAMPLES, _SAMPLES_PER_HARMONIC * n_harmonics)
    return FourierBasis.at(2 * np.pi * np.arange(n) / n, n_harmonics)


class HarmonicBalance:
    """Fourier coefficients of a model's residual along periodic motions up to harmonic H.

    The model's forces must not jump.
    """

    def __init__(self, model: AnyModel, n_harmonics: int) -> None:
        model.refuse_memory("a response of harmonics")
        self.model = model
        self.n_harmonics = n_harmonics
        self.basis = uniform_basis(n_harmonics)

    @property
    def n_coordinates(self) -> int:
        """R."""
        return self.model.n_coordinates

    def series(self, vector: Array) -> Array:
        """Vector (m,) as an array (2 H + 1, R)."""
        return vector.reshape(-1, self.n_coordinates)

    def motion(self, c: Array, omega: float) -> tuple[Array, Array, Array]:
        """q, q_dot and q_ddot at the samples, (n_samples, R)."""
        b = self.basis
        return b.values @ c, omega * (b.first @ c), omega**2 * (b.second @ c)

    def rate(self, c: Array) -> Array:
        """Vector (m,) of the derivative by the phase."""
        return (self.basis.rate @ c).ravel()

    @cached_property
    def rate_by_c(self) -> Array:
        """Derivatives of `rate` by c, (m, m)."""
        return np.kron(self.basis.rate, np.eye(self.n_coordinates))

    def residual(self, c: Array, omega: float) -> Array:
        """Coefficients of the left sides of the equations, (m,)."""
        return (self.basis.projection @ self.model.residual(*self.motion(c, omega))).ravel()

    def linearise(self, c: Array, omega: float) -> tuple[Array, Array, Array]:
        """`residual`, its derivatives by c, (m, m), and by omega, (m,)."""
        b = self.basis
        q, q_dot, q_ddot = self.motion(c, omega)
        force, by_q, by_q_dot, by_q_ddot = self.model.residual_and_slopes(q, q_dot, q_ddot)
        # (n_samples, R equations, 2 H + 1, R coordinates)
        values, first, second = (x[:, None, :, None] for x in (b.values, b.first, b.second))
        by_c = (
            by_q[:, :, None] * values
            + (omega * by_q_dot)[:, :, None] * first
            + (omega**2 * by_q_ddot)[:, :, None] * second
        )
        changes = by_q_dot * q_dot[:, None] + 2 * by_q_ddot * q_ddot[:, None]
        projected = b.projection @ by_c.reshape(len(q), -1)
        return (
            (b.projection @ force).ravel(),
            projected.reshape(c.size, c.size),
            (b.projection @ np.sum(changes, axis=2)).ravel() / omega,
        )

    def by_coefficient(self, terms: Sequence[Term], c: Array, omega: float) -> Array:
        """Derivatives of `residual` by coefficients of one coordinate, (m, n_terms)."""
        q, q_dot, q_ddot = (x[:, 0] for x in self.motion(c, omega))
        forces = [np.broadcast_to(term.strong(q, q_dot, q_ddot), q.shape) for term in terms]
        return self.basis.projection @ np.array(forces).reshape(-1, len(q)).T

    def leftover(self, c: Array, omega: float) -> float:
        """Largest force that the harmonics beyond H leave in an equation, relative.

        The tail of the spectrum of the forces, in time, over the largest |M q_ddot|.
        """
        motion = self.motion(c, omega)
        force, _, _, inertia = self.model.residual_and_slopes(*motion)
        beyond = force - self.basis.values @ (self.basis.projection @ force)
        inertial = np.max(np.abs(inertia @ motion[2][..., None]))
        return float(np.max(np.abs(beyond)) / max(inertial, np.finfo(float).tiny))  # 0 at rest
