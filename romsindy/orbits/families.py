"""One-parameter families of periodic orbits as equations F(u, p) = 0, and the walk along them.

The unknowns u begin with a Fourier series, scaled to order one; harmonics are added on the way.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from romsindy.orbits.continuation import Branch, Steps, Verdict, continue_branch
from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.typing import Array, Indices

# Numbers of harmonics that are tried in turn, and the force left over at which the next one is:
# what is missing in q is (H + 1)^2 times smaller.
LADDER = (5, 9, 15, 23, 35, 50)
_RESOLVED = 1e-8
_LOST = 0.01  # what is left over where even the last number of harmonics gives no orbit
_UNRESOLVED = "the orbit needs more harmonics"
_SINGULAR = 1e-3  # of 1 + h(q), as in `ReducedModel.acceleration`

# Of the linear frequency. A frequency falls with the logarithm of the distance to a position of
# rest: no orbit is so slow, but truncated series go on into that position.
_CREEP = 0.02


@dataclass(eq=False)
class Family(ABC):
    """Equations of a family with one number of harmonics, that of its `HarmonicBalance`."""

    n_other: ClassVar[int]  # unknowns beyond the Fourier series
    balance: HarmonicBalance

    @abstractmethod
    def orbit(self, u: Array, p: float) -> tuple[Array, float]:
        """Fourier coefficients (2 H + 1,), unit of q, and angular frequency, rad/s."""

    @abstractmethod
    def residual(self, u: Array, p: float) -> Array:
        """F(u, p), shape of u."""

    @abstractmethod
    def jacobian(self, u: Array, p: float) -> Array:
        """Derivatives of F by u and, in the last column, by p."""

    def objection(self, u: Array, p: float) -> str:
        """Why there is no such orbit; empty if there is."""
        q = self.balance.basis.values @ self.orbit(u, p)[0]
        inertia = self.balance.model.inertia(q)
        if np.min(inertia) <= _SINGULAR:
            at = q[np.argmin(inertia)]
            return f"1 + h(q) = {np.min(inertia):.3g} is not positive at q = {at:.6g}"
        return ""

    def until_left(self, share: float, reason: str) -> Verdict:
        """Verdict that ends a branch where harmonics leave more than a share of the force."""
        return lambda u, p: reason if self.balance.leftover(*self.orbit(u, p)) > share else ""


@dataclass(eq=False)
class FreeFamily(Family):
    """Orbits that a force mu q_dot sustains; u = (q / A, omega / omega_0, mu / omega_0).

    The parameter is A / A_top, with A = (q(0) - q(pi)) / 2: the orbits start at rest at phase 0,
    conservative ones rest again at phase pi, and A is half of peak to peak. Divided by A, the
    equations are regular down to A = 0.
    """

    n_other = 2
    omega_0: float
    amplitude_top: float

    def orbit(self, u: Array, p: float) -> tuple[Array, float]:
        return p * self.amplitude_top * u[:-2], self.omega_0 * u[-2]

    def residual(self, u: Array, p: float) -> Array:
        c, omega = self.orbit(u, p)
        sustained = u[-1] * self.omega_0 * omega * (self.balance.basis.rate @ c)
        force = self.balance.residual(c, omega) - sustained
        shape = u[:-2]
        size = p * self.amplitude_top * self.omega_0**2
        odd = np.sum(shape[1::4])  # a_1, a_3, ...
        return np.append(force / size, [self.balance.basis.first[0] @ shape, odd - 1])

    def jacobian(self, u: Array, p: float) -> Array:
        c, omega = self.orbit(u, p)
        rate, mu = self.balance.basis.rate, u[-1] * self.omega_0
        force, by_c, by_omega = self.balance.linearise(c, omega)
        force, by_c = force - mu * omega * (rate @ c), by_c - mu * omega * rate
        size = p * self.amplitude_top * self.omega_0**2
        n = len(c)
        matrix = np.zeros((n + 2, n + 3))
        matrix[:n, :n] = by_c / self.omega_0**2
        matrix[:n, n] = (by_omega - mu * (rate @ c)) * self.omega_0 / size
        matrix[:n, n + 1] = -omega * (rate @ c) * self.omega_0 / size
        matrix[:n, n + 2] = (by_c @ c - force) / size / p
        matrix[n, :n], matrix[n + 1, 1:n:4] = self.balance.basis.first[0], 1.0
        return matrix

    def objection(self, u: Array, p: float) -> str:
        c, omega = self.orbit(u, p)
        if omega <= _CREEP * self.omega_0:
            return "the frequency falls to zero: the orbit comes upon another position of rest"
        turning = self.balance.basis.values[[0, len(self.balance.basis.values) // 2]] @ c
        restoring = self.balance.model.stiffness(turning) * [1, -1]
        if np.min(restoring) <= 0:
            at = turning[np.argmin(restoring)]
            return f"the restoring force is not positive at the turning point q = {at:.6g}"
        return super().objection(u, p)


class Path(NamedTuple):
    """Straight line in angular frequency (rad/s) and force (unit of q per s^2)."""

    omega: tuple[float, float]
    force: tuple[float, float]


@dataclass(eq=False)
class ForcedFamily(Family):
    """Orbits under force cos(omega t); u = q / size, and p runs along a path from 0 to 1."""

    n_other = 0
    path: Path
    size: float

    def orbit(self, u: Array, p: float) -> tuple[Array, float]:
        first, last = self.path.omega
        return self.size * u, first + p * (last - first)

    def residual(self, u: Array, p: float) -> Array:
        first, last = self.path.force
        result = self.balance.residual(*self.orbit(u, p)) / self._unit
        result[1] -= (first + p * (last - first)) / self._unit
        return result

    def jacobian(self, u: Array, p: float) -> Array:
        _, by_c, by_omega = self.balance.linearise(*self.orbit(u, p))
        by_p = by_omega * np.subtract(*self.path.omega[::-1])
        by_p[1] -= np.subtract(*self.path.force[::-1])
        return np.column_stack([by_c * self.size, by_p]) / self._unit

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

    Shapes: c (n, 2 H + 1), omega and leftover (n,), other (n, n_other), folds (k,).
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
        if len(start.u) > 2 * n_harmonics + 1 + member.n_other:
            continue  # the start has more harmonics already
        u = _padded(start.u, n_harmonics, member.n_other)
        direction = start.direction
        if np.ndim(direction):
            direction = _padded(np.asarray(direction), n_harmonics, member.n_other + 1)
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


def _until(member: Family, ladder: Sequence[int]) -> Verdict | None:
    n_harmonics = member.balance.n_harmonics
    if n_harmonics < ladder[-1]:
        return member.until_left(_RESOLVED, _UNRESOLVED)
    if len(ladder) == 1:
        return None  # as many as the user wants, with the error that they imply
    reason = (
        f"{n_harmonics} harmonics leave more than {_LOST:.0%} of the force, as where the motion"
        " comes upon a position of rest or 1 + h(q) = 0, or friction jumps: give n_harmonics to go"
        " on, or a larger velocity_scale"
    )
    return member.until_left(_LOST, reason)


def _padded(u: Array, n_harmonics: int, n_other: int) -> Array:
    """Vector with zeros for new harmonics, before its last ``n_other`` entries."""
    at = len(u) - n_other
    return np.concatenate([u[:at], np.zeros(max(0, 2 * n_harmonics + 1 - at)), u[at:]])


def _joined(pieces: list[tuple[Family, Branch]], end: Start) -> OrbitBranch:
    """Orbits of all pieces, and folds with the numbers that they have among them."""
    n_harmonics, last = pieces[-1][0].balance.n_harmonics, pieces[-1][1]
    orbits: list[tuple[Array, float, Array, float]] = []
    folds: list[int] = []
    for family, branch in pieces:
        # Where harmonics are added, the next piece starts with the same orbit, better resolved.
        n = len(branch) - (branch is not last)
        folds += [len(orbits) + k for k in branch.folds if k < n]
        for u, p in zip(branch.u[:n], branch.p[:n], strict=True):
            orbit, beyond = family.orbit(u, p), u[len(u) - family.n_other :]
            left = family.balance.leftover(*orbit)
            orbits.append((_padded(orbit[0], n_harmonics, 0), orbit[1], beyond, left))
    c, omega, other, leftover = (np.array(column) for column in zip(*orbits, strict=True))
    return OrbitBranch(c, omega, other, leftover, np.array(folds, int), last.stop_reason, end)
