"""Harmonic balance: a model's equation for a truncated Fourier series, and its derivatives.

q(t) = a_0 + sum_k a_k cos(k omega t) + b_k sin(k omega t), k = 1 ... H, is kept as the vector
c = (a_0, a_1, b_1, ..., a_H, b_H). Forces are evaluated at samples of one period and projected back
(alternating frequency and time, [1]).

[1] M. Krack, J. Gross, "Harmonic Balance for Nonlinear Vibration Problems", Springer (2019).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from romsindy.physics.model import ReducedModel
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

    def __init__(self, model: ReducedModel, n_harmonics: int) -> None:
        self.model = model
        self.n_harmonics = n_harmonics
        self.basis = uniform_basis(n_harmonics)

    def motion(self, c: Array, omega: float) -> tuple[Array, Array, Array]:
        """q, q_dot and q_ddot at the samples; c of shape (2 H + 1,)."""
        b = self.basis
        return b.values @ c, omega * (b.first @ c), omega**2 * (b.second @ c)

    def residual(self, c: Array, omega: float) -> Array:
        """Coefficients of M q_ddot + N q_dot^2 + K + D, (2 H + 1,)."""
        return self.basis.projection @ self.model.residual(*self.motion(c, omega))

    def linearise(self, c: Array, omega: float) -> tuple[Array, Array, Array]:
        """`residual`, its derivatives by c, (2 H + 1, 2 H + 1), and by omega, (2 H + 1,)."""
        b = self.basis
        q, q_dot, q_ddot = self.motion(c, omega)
        force, by_q, by_q_dot, by_q_ddot = self.model.linearise(q, q_dot, q_ddot)
        by_c = (
            by_q[:, None] * b.values
            + (omega * by_q_dot)[:, None] * b.first
            + (omega**2 * by_q_ddot)[:, None] * b.second
        )
        by_omega = (by_q_dot * q_dot + 2 * by_q_ddot * q_ddot) / omega
        return b.projection @ force, b.projection @ by_c, b.projection @ by_omega

    def leftover(self, c: Array, omega: float) -> float:
        """Largest force that the harmonics beyond H leave in the equation, relative.

        The tail of the spectrum of the forces, in time, over the largest |M q_ddot|.
        """
        motion = self.motion(c, omega)
        force, _, _, inertia = self.model.linearise(*motion)
        beyond = force - self.basis.values @ (self.basis.projection @ force)
        inertial = np.max(np.abs(inertia * motion[2]))
        return float(np.max(np.abs(beyond)) / max(inertial, np.finfo(float).tiny))  # 0 at rest
