"""Static equilibria, by Newton's method with load stepping, and the linear modes about them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.linalg import LinAlgError, eigh
from scipy.sparse import csc_array
from scipy.sparse.linalg import eigsh

from romsindy.beam.assembly import Assembly, factorise, solve
from romsindy.record.decay import Decay

_MAX_ITERATIONS = 25
_SMALLEST_STEP = 2.0**-10
# Newton converges quadratically, so an increment of this size (relative to the beam's length, or
# in radians) leaves an error at the level of rounding.
_TOLERANCE = 1e-9


class NoEquilibriumError(RuntimeError):
    """No static equilibrium was found under the load or displacement asked for."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A static state: nodal displacements and the load that holds them.

    Attributes
    ----------
    s : (n_nodes,) array
        Positions of the nodes on the undeformed axis, m.
    displacement : (n_nodes, 3) array
        (u, w, theta) from the straight rest, m, m, rad.
    load : (n_nodes, 3) array
        The dead nodal load (fx, fy, moment) beside weight and effects, N, N, N m.
    """

    s: np.ndarray
    displacement: np.ndarray
    load: np.ndarray

    @property
    def tip(self) -> np.ndarray:
        """(u, w, theta) of the right end."""
        return self.displacement[-1]

    def __repr__(self) -> str:
        u, w, theta = self.tip
        return (
            f"Shape(tip u = {u:.6g} m, w = {w:.6g} m, theta = {theta:.6g} rad,\n"
            f"      held by {np.linalg.norm(self.load[:, :2].sum(axis=0)):.6g} N)"
        )


@dataclass(frozen=True)
class _Held:
    """Displacements, and the factors (n_patterns,) of the loads that hold them."""

    x: np.ndarray
    factors: np.ndarray


def _newton(
    assembly: Assembly,
    start: _Held,
    patterns: np.ndarray,
    weight_share: float,
    readings: np.ndarray | None = None,
    targets: np.ndarray | None = None,
) -> _Held | None:
    """Solve r(x) = sum of factors * patterns.

    With `readings`, as many as patterns, find the factors where these are at their `targets`.
    """
    x, factors = start.x.copy(), start.factors
    length = assembly.structure.length
    for _ in range(_MAX_ITERATIONS):
        residual, _ = assembly.residual(x)
        residual += (1.0 - weight_share) * np.where(assembly.fixed, 0.0, assembly.weight)
        stiffness, _ = assembly.tangents(x)
        factorised = factorise(stiffness, assembly.fixed)
        increment = solve(factorised, np.tensordot(factors, patterns, axes=1) - residual)
        if readings is not None:
            units = np.array([solve(factorised, p) for p in patterns])
            missing = targets - np.tensordot(readings, x + increment, axes=2)
            try:
                change = np.linalg.solve(work(readings, units), missing)
            except np.linalg.LinAlgError:
                return None
            factors = factors + change
            increment += np.tensordot(change, units, axes=1)
        size = np.max(np.abs(increment) / [length, length, 1.0])
        if not size < 1e3:  # also catches what is not a number
            return None
        x += increment
        if size < _TOLERANCE:
            return _Held(x, factors)
    return None


def work(loads: np.ndarray, displacements: np.ndarray) -> np.ndarray:
    """Return sum(loads[i] * displacements[j]), (n, m), of nodal fields (n or m, n_nodes, 3)."""
    return np.tensordot(loads, displacements, axes=([1, 2], [1, 2]))


def _march(solve_at: Callable[[float, _Held], _Held | None], start: _Held) -> _Held | None:
    """Follow a path from 0 to 1, halving the step where Newton fails, doubling where it does not.

    Start each solve from the secant through the two states before.
    """
    done, step = 0.0, 1.0
    state, previous = start, None
    while done < 1.0:
        step = min(step, 1.0 - done)
        guess = state
        if previous is not None:
            ratio = step / previous[0]
            guess = _Held(
                state.x + ratio * (state.x - previous[1].x),
                state.factors + ratio * (state.factors - previous[1].factors),
            )
        found = solve_at(done + step, guess)
        if found is None:
            step *= 0.5
            if step < _SMALLEST_STEP:
                return None
            continue
        previous = (step, state)
        state, done, step = found, done + step, 2.0 * step
    return state


def find_equilibrium(assembly: Assembly, load: np.ndarray | None = None) -> Shape:
    """Return the equilibrium under weight, effects and a dead nodal load (n_nodes, 3), N and N m.

    Raises a NoEquilibriumError if no equilibrium is found, however small the load step.
    """
    load = np.zeros_like(assembly.weight) if load is None else load
    pattern = _free(assembly, load)

    def solve_at(share: float, guess: _Held) -> _Held | None:
        return _newton(assembly, _Held(guess.x, np.array([share])), pattern[None], share)

    found = _march(solve_at, _Held(np.zeros_like(pattern), np.zeros(1)))
    if found is None:
        raise NoEquilibriumError(
            f"no equilibrium found under a load of {np.abs(pattern).max():.4g} N (largest nodal "
            "value), even in steps of 1/1024 of it; reduce the load, or check the springs and "
            "supports (a beam without support has none; lengths are in m, and it is "
            f"{assembly.structure.length:g} m long)"
        )
    return Shape(assembly.s, found.x, load)


def find_displaced(
    assembly: Assembly,
    start: np.ndarray,
    patterns: np.ndarray,
    readings: np.ndarray,
    targets: np.ndarray,
    factors: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (x, factors): equilibrium under sum(factors * patterns) where readings are `targets`.

    Patterns are n nodal loads and readings the weights of n displacements, (n, n_nodes, 3); targets
    and factors are (n,). The path starts from the equilibrium `start` under the `factors`.

    Raises a NoEquilibriumError if there is no such equilibrium on the path.
    """
    patterns = _free(assembly, patterns)
    first = np.tensordot(readings, start, axes=2)

    def solve_at(share: float, guess: _Held) -> _Held | None:
        goal = first + share * (targets - first)
        return _newton(assembly, guess, patterns, 1.0, readings, goal)

    found = _march(solve_at, _Held(start, factors))
    if found is None:
        asked = ", ".join(f"{t:.4g}" for t in targets)
        raise NoEquilibriumError(
            f"no equilibrium found with the controlled displacement at {asked}; the beam "
            f"(length {assembly.structure.length:.4g} m) may not reach that far: ask for less"
        )
    return found.x, found.factors


def hold(
    assembly: Assembly, rest: Shape, pattern: np.ndarray, reading: np.ndarray, distance: float
) -> Shape:
    """Return the shape held by a multiple of `pattern` where `reading` has changed by `distance`.

    The path starts from the equilibrium ``rest``. ``pattern`` is a nodal load, ``reading`` holds
    the weights of the displacement that is prescribed, (n_nodes, 3) each.

    Raises a NoEquilibriumError if there is no such equilibrium on the path.
    """
    goal = np.array([np.vdot(reading, rest.displacement) + distance])
    x, factors = find_displaced(
        assembly, rest.displacement, pattern[None], reading[None], goal, np.zeros(1)
    )
    return Shape(assembly.s, x, factors[0] * pattern)


def _free(assembly: Assembly, load: np.ndarray) -> np.ndarray:
    return np.where(assembly.fixed, 0.0, load)


# up to this size a dense solve is quick, and it also serves meshes that are too small for Arnoldi
_DENSE = 120
_UNSTABLE = "the equilibrium is not stable; support the beam, or find another equilibrium"


class Recorded(Protocol):
    """A motion that modes and sensors can be asked about, such as a `Motion`."""

    @property
    def t(self) -> np.ndarray:
        """Time, s."""

    @property
    def basis(self) -> ModalBasis:
        """The modes in which it was recorded."""

    def modal(self, basis: ModalBasis) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, q_dot, q_ddot, (n_samples, n_modes) each."""

    def readings(self, rows: np.ndarray) -> np.ndarray:
        """Return what weights of the nodal displacements read, (n_samples, n_rows), m."""


@dataclass(frozen=True, eq=False)
class ModalBasis:
    """Mass-normalised modes about an equilibrium; the tip (right end) moves up in each.

    Attributes
    ----------
    omega : (n_modes,) array
        Angular frequencies, rad/s.
    shapes : (n_modes, n_nodes, 3) array
        (u, w, theta), kg^-0.5, kg^-0.5, rad m^-1 kg^-0.5.
    momenta : (n_modes, n_nodes, 3) array
        M phi; q = sum(momenta * (x - x_equilibrium)), kg^0.5 m.
    equilibrium : Shape
        The static state about which they are taken.
    axial : (n_modes,) array
        Share of the modal kinetic energy that is axial.
    """

    omega: np.ndarray
    shapes: np.ndarray
    momenta: np.ndarray
    equilibrium: Shape
    axial: np.ndarray

    def __repr__(self) -> str:
        first = ", ".join(f"{w:.6g}" for w in self.omega[:6])
        more = ", ..." if len(self.omega) > 6 else ""
        return f"ModalBasis({len(self.omega)} modes,\n           omega = {first}{more} rad/s)"

    def index(self, mode: int) -> int:
        """Return the row of mode 1, 2, ...

        Raises a ValueError for a mode that is not in the basis.
        """
        if not 1 <= mode <= len(self.omega):
            raise ValueError(
                f"mode = {mode} is not in the basis; modes 1 to {len(self.omega)} are: ask "
                "beam.modes for a larger count"
            )
        return mode - 1

    def shape(self, mode: int) -> np.ndarray:
        """Return the shape of mode 1, 2, ..., (n_nodes, 3)."""
        return self.shapes[self.index(mode)]

    def point(self, mode: int) -> float | None:
        """Return where mode 1, 2, ... moves most across the beam, m; None is the right end."""
        node = int(np.argmax(np.abs(self.shape(mode)[:, 1])))
        s = self.equilibrium.s
        return None if node == len(s) - 1 else float(s[node])

    def coordinates(self, displacement: np.ndarray) -> np.ndarray:
        """Return q of all modes for displacements from straight, (..., n_nodes, 3)."""
        return self.rates(displacement - self.equilibrium.displacement)

    def rates(self, field: np.ndarray) -> np.ndarray:
        """Return the modal components of a velocity or acceleration field (..., n_nodes, 3)."""
        return np.tensordot(field, self.momenta, axes=([-2, -1], [-2, -1]))

    def project(self, motion: Recorded, mode: int = 1) -> Decay:
        """Return q, q_dot, q_ddot of one mode of a motion.

        Raises a ValueError for a mode that does not exist, or a motion that was recorded in other
        modes and without its full field.
        """
        column = self.index(mode)
        q, q_dot, q_ddot = motion.modal(self)
        return Decay(motion.t, q[:, column], q_dot[:, column], q_ddot[:, column], unit="kg^0.5 m")


def assembled(assembly: Assembly, matrices: np.ndarray) -> tuple[csc_array, np.ndarray]:
    """Return the sparse matrix of the free degrees of freedom, and their flat numbers."""
    first = 6 * np.arange(assembly.n_elements)
    rows = (first[:, None] + np.arange(9))[:, :, None] + np.zeros(9, dtype=int)
    columns = rows.transpose(0, 2, 1)
    size = 3 * assembly.n_nodes
    full = csc_array((matrices.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
    free = np.flatnonzero(~assembly.fixed.ravel())
    return full[free][:, free], free


def solve_modes(assembly: Assembly, equilibrium: Shape, count: int) -> ModalBasis:
    """Return the lowest `count` modes about an equilibrium: K phi = omega^2 M phi.

    Raises a ValueError if `count` is not between 1 and what the mesh can carry, and a
    NoEquilibriumError if the equilibrium is unstable.
    """
    stiffness, _ = assembly.tangents(equilibrium.displacement)
    K, free = assembled(assembly, stiffness)
    M, _ = assembled(assembly, assembly.mass)
    if not 1 <= count < len(free) - 1:
        raise ValueError(
            f"count = {count} modes were asked for; this mesh has 1 to {len(free) - 2} of them: "
            "ask for fewer, or use more elements"
        )
    values, vectors = _eigenpairs(K, M, count)
    flat = np.zeros((count, assembly.n_nodes * 3))
    flat[:, free] = vectors.T[np.argsort(values)]
    shapes = flat.reshape(count, assembly.n_nodes, 3)
    momenta = np.array([assembly.mass_times(phi) for phi in shapes])
    scale = np.array([_sign(phi) for phi in shapes])
    scale /= np.sqrt(np.sum(shapes * momenta, axis=(1, 2)))
    shapes, momenta = shapes * scale[:, None, None], momenta * scale[:, None, None]
    axial = np.sum(shapes[..., 0] * momenta[..., 0], axis=1)
    # Rayleigh quotients: their error is the square of the shape's
    squares = [assembly.modal_stiffness(equilibrium.displacement, phi) for phi in shapes]
    if min(squares) <= 0.0:
        raise NoEquilibriumError(f"{_UNSTABLE} (omega^2 = {min(squares):.4g} 1/s^2)")
    return ModalBasis(np.sqrt(squares), shapes, momenta, equilibrium, axial)


def _eigenpairs(K: csc_array, M: csc_array, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the `count` smallest omega^2 and their shapes as columns, in any order."""
    size = K.shape[0]
    if size <= _DENSE:
        # M phi = phi K / omega^2: K may be inverted, M not if there is no rotary inertia
        try:
            inverses, vectors = eigh(
                M.toarray(), K.toarray(), subset_by_index=(size - count, size - 1)
            )
        except LinAlgError:
            raise NoEquilibriumError(_UNSTABLE) from None
        return 1.0 / inverses, vectors
    start = np.ones(size)  # a fixed start vector makes the result repeatable
    return eigsh(K, k=count, M=M, sigma=0.0, which="LM", v0=start)


def _sign(phi: np.ndarray) -> float:
    """Return the sign that makes the tip rise, or the largest deflection if the tip is held."""
    w = phi[:, 1]
    reference = w[-1] if abs(w[-1]) > 1e-3 * np.abs(w).max() else w[np.argmax(np.abs(w))]
    return 1.0 if reference >= 0.0 else -1.0
