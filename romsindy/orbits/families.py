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
