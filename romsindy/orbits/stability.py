"""Stability of periodic orbits by their Floquet multipliers, from the variational equation.

    M delta'' + (dR/dq_dot) delta' + (dR/dq) delta = 0

along an orbit, with R the residual of the model. Its propagator over one period, the monodromy
matrix, is the product of exponentials of fourth-order Magnus steps with two Gauss points [1].

[1] S. Blanes, F. Casas, J. A. Oteo, J. Ros, "The Magnus expansion and some of its applications",
    Physics Reports 470 (2009).
"""

from __future__ import annotations

from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romsindy.orbits.harmonic_balance import FourierBasis
from romsindy.physics.equations import Equations
from romsindy.typing import Array

_STEPS_PER_HARMONIC = 16
_FEWEST_STEPS = 256
_MOST_MATRICES = 8192  # at a time: they stay in the cache of a processor

# Taylor's series of exp to the power 9 is exact to rounding for matrices of this norm.
_PAIRS, _NORM = 5, 0.1


def floquet_multipliers(
    model: Equations, coefficients: Array, omega: Array
) -> NDArray[np.complex128]:
    """Floquet multipliers of forced orbits: an orbit is stable if all are below 1 in size.

    Parameters
    ----------
    model : ReducedModel or CoupledModel
        Its forces must not jump.
    coefficients : (n, 2 H + 1) or (n, 2 H + 1, R) array
        Fourier coefficients a_0, a_1, b_1, ... of the orbits, unit of q.
    omega : (n,) array
        Angular frequencies, rad/s.

    Returns
    -------
    (n, 2 R) array of complex
        The largest one first.
    """
    return _sorted(np.linalg.eigvals(monodromy(model, coefficients, omega)))


def free_multipliers(
    model: Equations, coefficients: Array, omega: Array, negative_damping: Array, conservative: bool
) -> NDArray[np.complex128]:
    """Floquet multipliers of orbits that forces mu q_dot sustain, without those known to be 1.

    One is 1, because a motion may start at any phase, and of conservative orbits another one,
    because there is a family of them. The directions that belong to them are known, and taken out:
    as an eigenvalue, a double one would be good to the root of the error only.

    Parameters
    ----------
    model, coefficients, omega
        As those of `floquet_multipliers`; conservative orbits rest at phase 0.
    negative_damping : (n,) array
        mu, 1/s.
    conservative : bool
        Whether the model has an energy.

    Returns
    -------
    (n, 2 R - 1) or, of conservative orbits, (n, 2 R - 2) array of complex
        The largest one first.
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
