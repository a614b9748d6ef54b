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

One-parameter families of periodic orbits as equations F(u, p) = 0, and the walk along them.

The unknowns u begin with a Fourier series, scaled to order one; harmonics are added on the way.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import factorial
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from romsindy.orbits.continuation import Branch, Steps, Verdict, continue_branch
from romsindy.physics.equations import Equations
from romsindy.physics.term import Term
from romsindy.typing import Array, Indices

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


_Key: TypeAlias = tuple[tuple[int, ...], bytes, bytes]  # of series and frequencies


class _Samples(NamedTuple):
    """A motion at the samples, and `Equations.residual_and_slopes` there."""

    motion: tuple[Array, Array, Array]
    force: Array
    by_q: Array
    by_q_dot: Array
    by_q_ddot: Array


class HarmonicBalance:
    """Fourier coefficients of a model's residual along periodic motions up to harmonic H.

    A friction force that jumps, of one coordinate, is averaged over the time from half a sample
    before to half a sample after.
    """

    def __init__(self, model: Equations, n_harmonics: int) -> None:
        model.refuse_memory("a response of harmonics")
        self.model = model
        self.n_harmonics = n_harmonics
        self.basis = uniform_basis(n_harmonics)
        jumping = [pair for pair in model.pairs if not pair[0].smooth]
        self._jumping = jumping if model.n_coordinates == 1 else []
        self._last: tuple[_Key, _Samples] | None = None

    @property
    def n_coordinates(self) -> int:
        """R."""
        return self.model.n_coordinates

    def series(self, vector: Array) -> Array:
        """Vector (m,) as an array (2 H + 1, R)."""
        return vector.reshape(-1, self.n_coordinates)

    def motion(self, c: Array, omega: float | Array) -> tuple[Array, Array, Array]:
        """q, q_dot and q_ddot at the samples, (..., n_samples, R), of series (..., 2 H + 1, R)."""
        b, w = self.basis, np.asarray(omega)[..., None, None]
        return b.values @ c, w * (b.first @ c), w**2 * (b.second @ c)

    def rate(self, c: Array) -> Array:
        """Vector (m,) of the derivative by the phase."""
        return (self.basis.rate @ c).ravel()

    @cached_property
    def rate_by_c(self) -> Array:
        """Derivatives of `rate` by c, (m, m)."""
        return np.kron(self.basis.rate, np.eye(self.n_coordinates))

    def residual(self, c: Array, omega: float) -> Array:
        """Coefficients of the left sides of the equations, (m,)."""
        return (self.basis.projection @ self._sampled(c, omega).force).ravel()

    def _sampled(self, c: Array, omega: float | Array) -> _Samples:
        """A motion and its `Equations.residual_and_slopes`; kept, for what else is asked of it."""
        key = c.shape, c.tobytes(), np.asarray(omega).tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        q, q_dot, q_ddot = motion = self.motion(c, omega)
        force, by_q, by_q_dot, by_q_ddot = self.model.residual_and_slopes(*motion)
        for law, value in self._jumping:
            cell = law.averaged(q, q_dot, 0.0, self._half(q_ddot, omega))  # type: ignore[attr-defined]
            force = force + value * (cell.force - law.damping(q, q_dot))
            by_q_dot = by_q_dot + value * cell.by_q_dot[..., None]
        found = _Samples(motion, force, by_q, by_q_dot, by_q_ddot)
        self._last = key, found
        return found

    def _half(self, rate: Array, omega: float | Array) -> Array:
        """By how much what changes at a rate (..., n_samples, R) does so in half a sample."""
        return np.abs(rate) * np.pi / len(self.basis.values) / np.asarray(omega)[..., None, None]

    def linearise(self, c: Array, omega: float | Array) -> tuple[Array, Array, Array]:
        """`residual`, (..., m), its derivatives by c, (..., m, m), and by omega, (..., m).

        Of series (..., 2 H + 1, R) at frequencies (...).
        """
        b, w = self.basis, np.asarray(omega)[..., None, None]
        (_, q_dot, q_ddot), force, by_q, by_q_dot, by_q_ddot = self._sampled(c, omega)
        # (..., n_samples, R equations, 2 H + 1, R coordinates)
        values, first, second = (x[:, None, :, None] for x in (b.values, b.first, b.second))
        by_c = (
            by_q[..., None, :] * values
            + (w[..., None] * by_q_dot)[..., None, :] * first
            + (w[..., None] ** 2 * by_q_ddot)[..., None, :] * second
        )
        changes = by_q_dot * q_dot[..., None, :] + 2 * by_q_ddot * q_ddot[..., None, :]
        lead = c.shape[:-2]
        projected = b.projection @ by_c.reshape(*lead, len(b.values), -1)
        m = c.shape[-2] * c.shape[-1]
        return (
            (b.projection @ force).reshape(*lead, m),
            projected.reshape(*lead, m, m),
            (b.projection @ np.sum(changes, axis=-1) / w).reshape(*lead, m),
        )

    def by_rate(self, c: Array, omega: float | Array) -> Array:
        """Derivatives of `residual` by the rate at which c changes, slowly, (..., m, m).

        q_dot changes as c does, and q_ddot by twice that of the derivative by time.
        """
        b, w = self.basis, np.asarray(omega)[..., None, None, None]
        _, _, _, by_q_dot, by_q_ddot = self._sampled(c, omega)
        values, first = (x[:, None, :, None] for x in (b.values, b.first))
        by_c = by_q_dot[..., None, :] * values + (2 * w * by_q_ddot)[..., None, :] * first
        lead, m = c.shape[:-2], c.shape[-2] * c.shape[-1]
        return (b.projection @ by_c.reshape(*lead, len(b.values), -1)).reshape(*lead, m, m)

    def by_coefficient(self, terms: Sequence[Term], c: Array, omega: float | Array) -> Array:
        """Derivatives of `residual` by coefficients, (..., m, n_terms)."""
        q, q_dot, q_ddot = self.motion(c, omega)
        half = self._half(q_ddot, omega)
        if not self.model.numbered:  # laws of one coordinate know of no axis R
            q, q_dot, q_ddot, half = (x[..., 0] for x in (q, q_dot, q_ddot, half))
        forces = [
            np.broadcast_to(
                term.strong(q, q_dot, q_ddot)
                if term.smooth
                else term.averaged(q, q_dot, 0.0, half).force,  # type: ignore[attr-defined]
                q.shape,
            )
            for term in terms
        ]
        by_sample = np.stack(forces, axis=-1).reshape(*c.shape[:-2], len(self.basis.values), -1)
        return (self.basis.projection @ by_sample).reshape(*c.shape[:-2], -1, len(terms))

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


# Numbers of harmonics that are tried in turn, and the force left over at which the next one is:
# what is missing in q is (H + 1)^2 times smaller.
LADDER = (5, 9, 15, 23, 35, 50)
_RESOLVED = 1e-8
_LOST = 0.01  # what is left over where even the last number of harmonics gives no orbit
_UNRESOLVED = "the orbit needs more harmonics"

# Of the linear frequency. A frequency falls with the logarithm of the distance to a position of
# rest: no orbit is so slow, but truncated series go on into that position.
_CREEP = 0.02

# Of the last amplitude: another coordinate that moves so far beyond it is not what was asked for.
_ELSEWHERE = 3.0


@dataclass(eq=False)
class Family(ABC):
    """Equations of a family with one number of harmonics, that of its `HarmonicBalance`."""

    n_other: ClassVar[int]  # unknowns beyond the Fourier series
    balance: HarmonicBalance

    @abstractmethod
    def orbit(self, u: Array, p: float) -> tuple[Array, float]:
        """Fourier coefficients (2 H + 1, R), unit of q, and angular frequency, rad/s."""

    @abstractmethod
    def residual(self, u: Array, p: float) -> Array:
        """F(u, p), shape of u."""

    @abstractmethod
    def jacobian(self, u: Array, p: float) -> Array:
        """Derivatives of F by u and, in the last column, by p."""

    def objection(self, u: Array, p: float) -> str:
        """Why there is no such orbit; empty if there is."""
        return self.balance.model.objection(self.balance.basis.values @ self.orbit(u, p)[0])

    def end(self, u: Array, p: float) -> str:
        """Why the branch is to end with this orbit; empty if it goes on."""
        return ""

    def until_left(self, share: float, reason: str) -> Verdict:
        """Verdict that ends a branch where harmonics leave more than a share of the force."""

        def until(u: Array, p: float) -> str:
            left = self.balance.leftover(*self.orbit(u, p)) > share
            return reason if left else self.end(u, p)

        return until


@dataclass(eq=False)
class FreeFamily(Family):
    """Orbits that forces mu q_dot sustain; u = (q / size, omega / omega_0, mu / omega_0).

    The parameter is A / A_top, with A = (q(0) - q(pi)) / 2 of one coordinate. It starts at rest at
    phase 0; conservative orbits rest there and at phase pi in all coordinates, and A is half of
    peak to peak. From rest, size is A: the equations, divided by it, are regular down to A = 0.
    Otherwise size is A_top, and A may pass through zero, where other coordinates alone move.
    """

    n_other = 2
    omega_0: float
    amplitude_top: float
    coordinate: int = 0
    from_rest: bool = True

    def orbit(self, u: Array, p: float) -> tuple[Array, float]:
        return self._size(p) * self.balance.series(u[:-2]), self.omega_0 * u[-2]

    def _size(self, p: float) -> float:
        return (p if self.from_rest else 1.0) * self.amplitude_top

    def residual(self, u: Array, p: float) -> Array:
        c, omega = self.orbit(u, p)
        force = self.balance.residual(c, omega) - u[-1] * self.omega_0 * omega * self.balance.rate(
            c
        )
        size = self._size(p)
        shape = u[self.coordinate : -2 : self.balance.n_coordinates]
        odd = np.sum(shape[1::4]) - p * self.amplitude_top / size  # a_1, a_3, ...
        return np.append(
            force / (size * self.omega_0**2), [self.balance.basis.first[0] @ shape, odd]
        )

    def jacobian(self, u: Array, p: float) -> Array:
        c, omega = self.orbit(u, p)
        rate, mu = self.balance.rate(c), u[-1] * self.omega_0
        force, by_c, by_omega = self.balance.linearise(c, omega)
        force, by_c = force - mu * omega * rate, by_c - mu * omega * self.balance.rate_by_c
        size = self._size(p) * self.omega_0**2
        n = c.size
        own = slice(self.coordinate, n, self.balance.n_coordinates)
        matrix = np.zeros((n + 2, n + 3))
        matrix[:n, :n] = by_c / self.omega_0**2
        matrix[:n, n] = (by_omega - mu * rate) * self.omega_0 / size
        matrix[:n, n + 1] = -omega * rate * self.omega_0 / size
        matrix[n, own] = self.balance.basis.first[0]
        matrix[n + 1, own][1::4] = 1.0
        if self.from_rest:
            matrix[:n, n + 2] = (by_c @ c.ravel() - force) / size / p
        else:
            matrix[n + 1, n + 2] = -1.0
        return matrix

    def objection(self, u: Array, p: float) -> str:
        c, omega = self.orbit(u, p)
        if omega <= _CREEP * self.omega_0:
            return "the frequency falls to zero: the orbit comes upon another position of rest"
        return self._no_turning(c) or super().objection(u, p)

    def _no_turning(self, c: Array) -> str:
        """Why the motion does not turn back at phases 0 and pi; empty if it does.

        Harmonics of several coordinates may turn one of them against its own force.
        """
        if self.balance.n_coordinates > 1:
            return ""
        turning = (self.balance.basis.values[[0, len(self.balance.basis.values) // 2]] @ c)[:, 0]
        restoring = self.balance.model.stiffness(turning[:, None])[:, 0] * [1, -1]
        if np.min(restoring) > 0:
            return ""
        at = turning[np.argmin(restoring)]
        return f"the restoring force is not positive at the turning point q = {at:.6g}"

    def end(self, u: Array, p: float) -> str:
        if self.from_rest:
            return ""
        c, _ = self.orbit(u, p)
        odd = c[(np.arange(len(c)) + 1) // 2 % 2 == 1]
        if p < 0 and np.linalg.norm(odd) < np.linalg.norm(c) / np.sqrt(2):
            return (
                "the branch ends on orbits of another mode, of an even multiple of its frequency:"
                " beyond them come the same orbits, half a period later"
            )
        reach = np.max(np.abs(self.balance.basis.values @ c), axis=0)
        reach[self.coordinate] = 0.0
        if np.max(reach) <= _ELSEWHERE * self.amplitude_top:
            return ""
        return (
            f"q{np.argmax(reach) + 1} moves {_ELSEWHERE:g} times as far as the last amplitude: the"
            " branch has gone over to another mode"
        )


class Sweep(NamedTuple):
    """Straight line in angular frequency (rad/s) and forces (unit of q per s^2), (R,) each."""

    omega: tuple[float, float]
    force: tuple[ArrayLike, ArrayLike]


@dataclass(eq=False)
class ForcedFamily(Family):
    """Orbits under force cos(omega t); u = q / size, and p runs along a path from 0 to 1."""

    n_other = 0
    path: Sweep
    size: float

    def orbit(self, u: Array, p: float) -> tuple[Array, float]:
        first, last = self.path.omega
        return self.size * self.balance.series(u), first + p * (last - first)

    def residual(self, u: Array, p: float) -> Array:
        first, last = (np.asarray(force) for force in self.path.force)
        result = self.balance.residual(*self.orbit(u, p))
        self._cosine(result)[:] -= first + p * (last - first)
        return result / self._unit

    def jacobian(self, u: Array, p: float) -> Array:
        _, by_c, by_omega = self.balance.linearise(*self.orbit(u, p))
        by_p = by_omega * np.subtract(*self.path.omega[::-1])
        self._cosine(by_p)[:] -= np.subtract(*self.path.force[::-1])
        return np.column_stack([by_c * self.size, by_p]) / self._unit

    def _cosine(self, vector: Array) -> Array:
        """The part of harmonic 1 in phase with the force, (R,)."""
        return vector[self.balance.n_coordinates : 2 * self.balance.n_coordinates]

    @property
    def _unit(self) -> float:
        return self.size * sum(self.path.omega) ** 2 / 4


class Start(NamedTuple):
    """Where a branch of orbits sets out, and in which direction (see `continue_branch`)."""

    u: Array
    p: float
    direction: ArrayLike = 1.0


@dataclass(frozen=True, eq=False)
class OrbitBranch:
    """A branch of orbits, all with the largest number of harmonics that one of them needed.

    Shapes: c (n, 2 H + 1, R), omega and leftover (n,), other (n, n_other), folds (k,).
    """

    c: Array
    omega: Array
    other: Array
    leftover: Array
    folds: Indices
    stop_reason: str
    end: Start


def follow(
    family: Callable[[int], Family],
    ladder: Sequence[int],
    start: Start,
    p_range: tuple[float, float],
    steps: Steps,
) -> OrbitBranch:
    """Follow a family with as many harmonics as its orbits need on the way.

    Numbers of harmonics on the ladder are tried in turn; the last one must do. The start may have
    fewer; `p_range` and `steps` are those of `continue_branch`.
    """
    pieces = []
    for n_harmonics in ladder:
        member = family(n_harmonics)
        size = (2 * n_harmonics + 1) * member.balance.n_coordinates
        if len(start.u) > size + member.n_other:
            continue  # the start has more harmonics already
        u = _padded(start.u, size, member.n_other)
        direction = start.direction
        if np.ndim(direction):
            direction = _padded(np.asarray(direction), size, member.n_other + 1)
        branch = continue_branch(
            member.residual,
            u,
            start.p,
            p_range=p_range,
            jacobian=member.jacobian,
            direction=direction,
            objection=member.objection,
            until=_until(member, ladder),
            steps=steps,
        )
        pieces.append((member, branch))
        start = Start(branch.u[-1], float(branch.p[-1]), branch.tangent[-1])
        if branch.stop_reason != _UNRESOLVED:
            break
    return _joined(pieces, start)


def _until(member: Family, ladder: Sequence[int]) -> Verdict:
    n_harmonics = member.balance.n_harmonics
    if n_harmonics < ladder[-1]:
        return member.until_left(_RESOLVED, _UNRESOLVED)
    if len(ladder) == 1:
        return member.end  # as many harmonics as the user wants, with the error that they imply
    reason = (
        f"{n_harmonics} harmonics leave more than {_LOST:.0%} of the force, as where the motion"
        " comes upon a position of rest or 1 + h(q) = 0, or friction jumps: give n_harmonics to go"
        " on, or a larger velocity_scale"
    )
    return member.until_left(_LOST, reason)


def _padded(u: Array, size: int, n_other: int) -> Array:
    """Vector with zeros for new harmonics, up to a size, before its last ``n_other`` entries."""
    at = len(u) - n_other
    return np.concatenate([u[:at], np.zeros(max(0, size - at)), u[at:]])


def _joined(pieces: list[tuple[Family, Branch]], end: Start) -> OrbitBranch:
    """Orbits of all pieces, and folds with the numbers that they have among them."""
    last = pieces[-1][1]
    shape = (2 * pieces[-1][0].balance.n_harmonics + 1, pieces[-1][0].balance.n_coordinates)
    orbits: list[tuple[Array, float, Array, float]] = []
    folds: list[int] = []
    for family, branch in pieces:
        # Where harmonics are added, the next piece starts with the same orbit, better resolved.
        n = len(branch) - (branch is not last)
        folds += [len(orbits) + k for k in branch.folds if k < n]
        for u, p in zip(branch.u[:n], branch.p[:n], strict=True):
            orbit, beyond = family.orbit(u, p), u[len(u) - family.n_other :]
            padded = np.zeros(shape)
            padded[: len(orbit[0])] = orbit[0]
            orbits.append((padded, orbit[1], beyond, family.balance.leftover(*orbit)))
    c, omega, other, leftover = (np.array(column) for column in zip(*orbits, strict=True))
    return OrbitBranch(c, omega, other, leftover, np.array(folds, int), last.stop_reason, end)
