"""The harmonic balance at measured steady states, linearised about an orbit for each of them.

Every point has an orbit of its own, which is unknown too: its measured harmonics, within their
noise, and the others, which follow from the balance. So nothing is divided by the slope of a
response at a given frequency, which a fold does not have, and stability plays no part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from romsindy.fit.steady.points import SteadyPoints
from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array, Indices

_ROUNDING = 1e-12  # of a covariance


@dataclass(frozen=True)
class Chain:
    """How an excitation F becomes a force per unit mass: (gain + slope |F|) exp(i phase) F."""

    gain: float
    slope: float
    phase: float

    def force(self, measured: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Complex amplitudes per unit mass."""
        gain = self.gain + self.slope * np.abs(measured)
        return gain * np.exp(1j * self.phase) * measured


CHAIN = ("gain", "slope", "phase")


@dataclass(frozen=True, eq=False)
class Rows:
    """First-order balance of n points, k equations each, in p parameters."""

    misfit: Array  # (n, k), force left over were the orbit as measured, unit of q per s^2
    # (n, k, p), its derivatives by the free coefficients and by those of the `CHAIN`
    by_parameter: Array
    by_q: Array  # (n, k, k), its derivatives by the measured quantities
    noise: Array  # (n, k, k), covariance of the misfit from the noise of the response
    size: Array  # (n,), amplitude of the force per unit mass
    # (n, j, 1 + k + p), what to take from the other Fourier coefficients: at once, and for changes
    # of the measured quantities and of the parameters
    others: Array

    def whitened(self, unexplained: float) -> tuple[Array, Array]:
        """By parameter (n k, p) and misfit (n k,), of unit variance.

        ``unexplained`` is the part of the force that the model leaves over: its standard deviation.
        """
        root = np.linalg.cholesky(self.covariance(unexplained))
        joined = np.concatenate([self.by_parameter, self.misfit[..., None]], axis=2)
        table = np.linalg.solve(root, joined).reshape(-1, joined.shape[2])
        return table[:, :-1], table[:, -1]

    def covariance(self, unexplained: float) -> Array:
        """Of the misfit, (n, k, k)."""
        slack = (unexplained * self.size) ** 2
        slack = slack + _ROUNDING * np.trace(self.noise, axis1=1, axis2=2)  # singular at folds
        return self.noise + slack[:, None, None] * np.eye(self.misfit.shape[1])


def known(points: SteadyPoints) -> slice:
    """Fourier coefficients of q that are measured; without phases, q is largest at phase 0."""
    return slice(1, 2 if not points.phased else 1 + 2 * points.q.shape[1])


def _first(points: SteadyPoints) -> slice:
    """Equations in which the excitation stands, or a measured harmonic."""
    return known(points) if points.phased else slice(1, 3)


def others_of(points: SteadyPoints, c: Array) -> Indices:
    """Fourier coefficients of c, (n, 2 H + 1), that follow from their own equations."""
    return np.delete(np.arange(c.shape[1]), _first(points))


def measured(points: SteadyPoints) -> tuple[Array, Array]:
    """Measured Fourier coefficients of q, (n, k), and their standard deviations."""
    if not points.phased:
        return points.amplitude[:, None], points.std[:, :1]
    parts = np.stack([points.q.real, -points.q.imag], axis=2)
    return parts.reshape(len(points), -1), np.repeat(points.std, 2, axis=1)


def linearised(
    points: SteadyPoints, model: ReducedModel, free: tuple[str, ...], chain: Chain, c: Array
) -> Rows:
    """Balance about orbits with Fourier coefficients c, (n, 2 H + 1), by all parameters."""
    force, by_c, by_p = _balance(points, model, free, c)
    own = known(points)
    equations, other = _first(points), others_of(points, c)
    # The other harmonics follow from their own equations: Schur's complement.
    right = np.concatenate([force[..., None], by_c[:, :, own], by_p], axis=2)
    others = np.linalg.solve(by_c[:, other[:, None], other], right[:, other])
    reduced = right[:, equations] - by_c[:, equations, other] @ others
    if not points.phased:
        size = np.linalg.norm(reduced[:, :2, 0], axis=1)[:, None, None]
        # The size of the force that the orbit needs: its phase is free.
        reduced = np.concatenate([size, *_along(reduced)], axis=2)
    k = own.stop - own.start
    q, std = measured(points)
    given, by_chain = _given(points, chain, k)
    by_q = reduced[..., 1 : k + 1]
    off = (by_q @ (q - c[:, own])[..., None])[..., 0]
    return Rows(
        misfit=reduced[..., 0] - given + off,
        by_parameter=np.concatenate([reduced[..., k + 1 :], -by_chain], axis=2),
        by_q=by_q,
        noise=(by_q * std[:, None] ** 2) @ by_q.swapaxes(1, 2),
        size=np.abs(chain.force(points.force)),
        others=others,
    )


def _along(reduced: Array) -> list[Array]:
    """Derivatives of the size of a force, from those of its two parts."""
    direction = reduced[..., 0] / np.linalg.norm(reduced[..., 0], axis=1)[:, None]
    return [direction[:, None] @ reduced[..., 1:]]


def _balance(
    points: SteadyPoints, model: ReducedModel, free: tuple[str, ...], c: Array
) -> tuple[Array, Array, Array]:
    """Forces without the excitation (n, m), and their derivatives by c and by coefficients."""
    balance = HarmonicBalance(model, c.shape[1] // 2)
    terms = {term.key: term for term in model.terms}
    chosen = [terms[name] for name in free]
    found = []
    for orbit, omega in zip(c[..., None], points.frequency.tolist(), strict=True):
        force, by_c, _ = balance.linearise(orbit, omega)
        found.append((force, by_c, balance.by_coefficient(chosen, orbit, omega)))
    force, by_c, by_p = (np.array(x) for x in zip(*found, strict=True))
    return force, by_c, by_p


def _given(points: SteadyPoints, chain: Chain, k: int) -> tuple[Array, Array]:
    """Fourier coefficients of the excitation (n, k), and their derivatives by the `CHAIN`."""
    force, size = chain.force(points.force), np.abs(points.force)
    by_chain = np.zeros((len(points), k, 3))
    if not points.phased:
        by_chain[:, 0, :2] = np.stack([size, size**2], axis=1)
        return np.abs(force)[:, None], by_chain
    turned = np.exp(1j * chain.phase) * points.force
    for column, change in enumerate((turned, size * turned, 1j * force)):
        by_chain[:, :2, column] = _parts(change)
    given = np.zeros((len(points), k))
    given[:, :2] = _parts(force)
    return given, by_chain


def _parts(z: NDArray[np.complex128]) -> Array:
    """Cosine and sine coefficient of Re(z exp(i omega t))."""
    return np.stack([z.real, -z.imag], axis=1)
