"""Harmonic balance and stability: a model's equations for a truncated Fourier series.

q(t) = a_0 + sum_k a_k cos(k omega t) + b_k sin(k omega t), k = 1 ... H, is kept as the array
c = (a_0, a_1, b_1, ..., a_H, b_H), (2 H + 1, R), with one column for each of R coordinates. Where c
and the equations are a vector, of m = (2 H + 1) R, coordinates of one harmonic stand together.
Forces are evaluated at samples of one period and projected back (alternating frequency and time,
[1]).

An orbit is stable by its Floquet multipliers, from the variational equation along it,

    M delta'' + (dR/dq_dot) delta' + (dR/dq) delta = 0,

with R the residual of the model. The propagator over one period, the monodromy matrix, is the
product of exponentials of fourth-order Magnus steps with two Gauss points [2].

[1] M. Krack, J. Gross, "Harmonic Balance for Nonlinear Vibration Problems", Springer (2019).
[2] S. Blanes, F. Casas, J. A. Oteo, J. Ros, "The Magnus expansion and some of its applications",
    Physics Reports 470 (2009).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romsindy.physics.equations import Equations
from romsindy.physics.term import Term
from romsindy.typing import Array

# Samples for every harmonic: products of up to ten factors, q^9 q_ddot, do not fold back onto the
# harmonics 0 ... H, so that the truncated equation inherits the model's symmetries exactly.
_SAMPLES_PER_HARMONIC = 12
_FEWEST_SAMPLES = 64


@dataclass(frozen=True, eq=False)
class FourierBasis:
    """Matrices between Fourier coefficients and samples at phases omega t of one period."""

    # (n_samples, 2 H + 1), from coefficients to samples of q and of its derivatives by the phase
    values: Array
    first: Array
    second: Array
    projection: Array  # (2 H + 1, n_samples), from samples to coefficients, for uniform phases
    rate: Array  # (2 H + 1, 2 H + 1), from coefficients to those of the derivative by the phase

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

    def __init__(self, model: Equations, n_harmonics: int) -> None:
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


_STEPS_PER_HARMONIC = 16
_FEWEST_STEPS = 256
_MOST_MATRICES = 8192  # at a time: they stay in the cache of a processor

# Taylor's series of exp to the power 9 is exact to rounding for matrices of this norm.
_PAIRS, _NORM = 5, 0.1


def floquet_multipliers(
    model: Equations, coefficients: Array, omega: Array
) -> NDArray[np.complex128]:
    """Floquet multipliers of forced orbits: an orbit is stable if all are below 1 in size.

    Forces of the model must not jump. ``coefficients`` (n, 2 H + 1) or (n, 2 H + 1, R) are those of
    Fourier, a_0, a_1, b_1, ..., unit of q; ``omega`` (n,) in rad/s. (n, 2 R) complex, the largest
    one first.
    """
    return _sorted(np.linalg.eigvals(monodromy(model, coefficients, omega)))


def free_multipliers(
    model: Equations, coefficients: Array, omega: Array, negative_damping: Array, conservative: bool
) -> NDArray[np.complex128]:
    """Floquet multipliers of orbits that forces mu q_dot sustain, without those known to be 1.

    One is 1, because a motion may start at any phase, and of conservative orbits another one,
    because there is a family of them. The directions that belong to them are known, and taken out:
    as an eigenvalue, a double one would be good to the root of the error only.

    Arguments as those of `floquet_multipliers`, and mu, ``negative_damping`` (n,), 1/s;
    conservative orbits rest at phase 0. (n, 2 R - 1), of conservative ones (n, 2 R - 2), the
    largest one first.
    """
    series = coefficients.reshape(len(omega), -1, model.n_coordinates)
    start = FourierBasis.at(np.zeros(1), series.shape[1] // 2)
    rate, bend = (np.einsum("k,nkr->nr", x[0], series) for x in (start.first, start.second))
    known = [np.concatenate([rate, bend], axis=1)]
    if conservative:  # the gradient of the energy, in which the velocities are zero
        q = np.einsum("k,nkr->nr", start.values[0], series)
        force = model.residual(q, np.zeros_like(q), np.zeros_like(q))
        known.append(np.concatenate([force, np.zeros_like(q)], axis=1))
    directions = np.stack(known, axis=2)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    basis = np.linalg.qr(directions, mode="complete")[0][..., len(known) :]
    propagator = monodromy(model, coefficients, omega, negative_damping)
    return _sorted(np.linalg.eigvals(basis.swapaxes(1, 2) @ propagator @ basis))


def monodromy(
    model: Equations, coefficients: Array, omega: Array, negative_damping: Array | float = 0.0
) -> Array:
    """From deviations (delta, d delta / d phase) at phase 0 to those one period later.

    Parameters are those of `free_multipliers`; the result is (n, 2 R, 2 R).
    """
    series = coefficients.reshape(len(omega), -1, model.n_coordinates)
    mu = np.broadcast_to(negative_damping, omega.shape)
    n_steps = max(_FEWEST_STEPS, _STEPS_PER_HARMONIC * (series.shape[1] // 2))
    parts = np.array_split(np.arange(len(omega)), len(omega) * n_steps // _MOST_MATRICES + 1)
    return np.concatenate([_propagators(model, series[i], omega[i], mu[i], n_steps) for i in parts])


def _propagators(model: Equations, series: Array, omega: Array, mu: Array, n_steps: int) -> Array:
    """Products of the exponentials of all steps, (n, 2 R, 2 R)."""
    step = 2 * np.pi / n_steps
    middle = step * (np.arange(n_steps) + 0.5)
    early, late = (
        _generator(model, series, omega, mu, middle + side * step / np.sqrt(12)) for side in (-1, 1)
    )
    commutator = early @ late - late @ early
    return _product(
        _exponential(step / 2 * (early + late) - np.sqrt(3) / 12 * step**2 * commutator)
    )


def _sorted(multipliers: NDArray[Any]) -> NDArray[np.complex128]:
    order = np.argsort(-np.abs(multipliers), axis=1)
    return np.take_along_axis(multipliers.astype(complex), order, axis=1)


def _generator(model: Equations, series: Array, omega: Array, mu: Array, phase: Array) -> Array:
    """A of d(delta, delta')/d(phase) = A (delta, delta'), shape (n, n_phases, 2 R, 2 R)."""
    basis = FourierBasis.at(phase, series.shape[1] // 2)
    r = series.shape[2]
    w = omega[:, None, None]
    motion = (
        w**order * (matrix @ series)
        for order, matrix in enumerate((basis.values, basis.first, basis.second))
    )
    _, by_q, by_q_dot, inertia = model.residual_and_slopes(*motion)
    w = w[..., None]
    by_q_dot = by_q_dot - mu[:, None, None, None] * np.eye(r)
    generator = np.zeros((*by_q.shape[:2], 2 * r, 2 * r))
    generator[..., :r, r:] = np.eye(r)
    slopes = np.concatenate([by_q / w**2, by_q_dot / w], axis=-1)
    # One by one, a division takes a fifth of the time.
    generator[..., r:, :] = -(slopes / inertia if r == 1 else np.linalg.solve(inertia, slopes))
    return generator


def _exponential(matrices: Array) -> Array:
    """exp of small matrices (..., m, m): Taylor's series of a half, a quarter, ..., squared."""
    norm = np.max(np.sum(np.abs(matrices), axis=-1), initial=0.0)
    halvings = max(0, int(np.ceil(np.log2(max(norm, _NORM) / _NORM))))
    part = matrices / 2**halvings
    identity, square = np.eye(part.shape[-1]), part @ part
    result = np.zeros_like(part)
    for k in range(2 * _PAIRS - 2, -1, -2):  # an even and an odd power together
        result = result @ square + (identity + part / (k + 1)) / factorial(k)
    for _ in range(halvings):
        result = result @ result
    return result


def _product(matrices: Array) -> Array:
    """Product along axis 1, later ones to the left, by halves."""
    while matrices.shape[1] > 1:
        last = matrices[:, -1:] if matrices.shape[1] % 2 else None
        even = matrices.shape[1] // 2 * 2
        matrices = matrices[:, 1:even:2] @ matrices[:, 0:even:2]
        if last is not None:
            matrices = np.concatenate([matrices, last], axis=1)
    return matrices[:, 0]
