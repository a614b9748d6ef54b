"""Stability of periodic orbits by their Floquet multipliers, from the variational equation.

    M delta'' + (dR/dq_dot) delta' + (dR/dq) delta = 0

along an orbit, with R the residual of the model. Its propagator over one period, the monodromy
matrix, is the product of exponentials of fourth-order Magnus steps with two Gauss points [1].

[1] S. Blanes, F. Casas, J. A. Oteo, J. Ros, "The Magnus expansion and some of its applications",
    Physics Reports 470 (2009).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from romsindy.orbits.harmonic_balance import FourierBasis
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

_STEPS_PER_HARMONIC = 16
_FEWEST_STEPS = 256


def floquet_multipliers(
    model: ReducedModel, coefficients: Array, omega: Array
) -> NDArray[np.complex128]:
    """Floquet multipliers of periodic orbits: an orbit is stable if both are below 1 in size.

    Parameters
    ----------
    model : ReducedModel
        Its forces must not jump.
    coefficients : (n, 2 H + 1) array
        Fourier coefficients a_0, a_1, b_1, ... of the orbits, unit of q.
    omega : (n,) array
        Angular frequencies, rad/s.

    Returns
    -------
    (n, 2) array of complex
        The larger one first.
    """
    n_harmonics = coefficients.shape[1] // 2
    n_steps = max(_FEWEST_STEPS, _STEPS_PER_HARMONIC * n_harmonics)
    step = 2 * np.pi / n_steps
    middle = step * (np.arange(n_steps) + 0.5)
    early, late = (
        _generator(model, coefficients, omega, middle + side * step / np.sqrt(12))
        for side in (-1, 1)
    )
    commutator = early @ late - late @ early
    propagators = _exponential(step / 2 * (early + late) - np.sqrt(3) / 12 * step**2 * commutator)
    multipliers = np.linalg.eigvals(_product(propagators)).astype(complex)
    order = np.argsort(-np.abs(multipliers), axis=1)
    return np.take_along_axis(multipliers, order, axis=1)


def _generator(model: ReducedModel, coefficients: Array, omega: Array, phase: Array) -> Array:
    """A of d(delta, delta')/d(phase) = A (delta, delta'), shape (n, n_phases, 2, 2)."""
    basis = FourierBasis.at(phase, coefficients.shape[1] // 2)
    w = omega[:, None]
    q, q_dot, q_ddot = (
        w**order * (coefficients @ matrix.T)
        for order, matrix in enumerate((basis.values, basis.first, basis.second))
    )
    _, by_q, by_q_dot, by_q_ddot = model.linearise(q, q_dot, q_ddot)
    generator = np.zeros((*q.shape, 2, 2))
    generator[..., 0, 1] = 1.0
    generator[..., 1, 0] = -by_q / (by_q_ddot * w**2)
    generator[..., 1, 1] = -by_q_dot / (by_q_ddot * w)
    return generator


def _exponential(matrices: Array) -> Array:
    """exp of matrices of shape (..., 2, 2): e^s (cosh d I + sinh d / d (B - s I)), s = tr B / 2."""
    half_trace = np.trace(matrices, axis1=-2, axis2=-1)[..., None, None] / 2
    identity = np.eye(2)
    deviator = matrices - half_trace * identity
    d = np.emath.sqrt(-np.linalg.det(deviator)[..., None, None]).astype(complex)
    d = np.where(np.abs(d) < 1e-8, 1e-8, d)  # sinh(d)/d is 1 to rounding there
    result = np.exp(half_trace) * (np.cosh(d) * identity + np.sinh(d) / d * deviator)
    return result.real


def _product(matrices: Array) -> Array:
    """Product along axis 1, later ones to the left, by halves."""
    while matrices.shape[1] > 1:
        last = matrices[:, -1:] if matrices.shape[1] % 2 else None
        even = matrices.shape[1] // 2 * 2
        matrices = matrices[:, 1:even:2] @ matrices[:, 0:even:2]
        if last is not None:
            matrices = np.concatenate([matrices, last], axis=1)
    return matrices[:, 0]
