"""Static equilibria: Newton's method, with load stepping, under a load or a displacement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from romsindy.beam.assembly import Assembly, factorise, solve

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
class _State:
    """Displacements, and the factors (n_patterns,) of the loads that hold them."""

    x: np.ndarray
    factors: np.ndarray


def _newton(
    assembly: Assembly,
    start: _State,
    patterns: np.ndarray,
    weight_share: float,
    readings: np.ndarray | None = None,
    targets: np.ndarray | None = None,
) -> _State | None:
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
            return _State(x, factors)
    return None


def work(loads: np.ndarray, displacements: np.ndarray) -> np.ndarray:
    """Return sum(loads[i] * displacements[j]), (n, m), of nodal fields (n or m, n_nodes, 3)."""
    return np.tensordot(loads, displacements, axes=([1, 2], [1, 2]))


def _march(solve_at: Callable[[float, _State], _State | None], start: _State) -> _State | None:
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
            guess = _State(
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

    Raises
    ------
    NoEquilibriumError
        If no equilibrium is found, however small the load step.
    """
    load = np.zeros_like(assembly.weight) if load is None else load
    pattern = _free(assembly, load)

    def solve_at(share: float, guess: _State) -> _State | None:
        return _newton(assembly, _State(guess.x, np.array([share])), pattern[None], share)

    found = _march(solve_at, _State(np.zeros_like(pattern), np.zeros(1)))
    if found is None:
        raise NoEquilibriumError(
            f"no equilibrium found under a load of {np.abs(pattern).max():.4g} N (largest nodal "
            "value), even in steps of 1/1024 of it; reduce the load, or check the springs and "
            "supports (a beam without support has no equilibrium)"
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

    Raises
    ------
    NoEquilibriumError
        If there is no such equilibrium on the path.
    """
    patterns = _free(assembly, patterns)
    first = np.tensordot(readings, start, axes=2)

    def solve_at(share: float, guess: _State) -> _State | None:
        goal = first + share * (targets - first)
        return _newton(assembly, guess, patterns, 1.0, readings, goal)

    found = _march(solve_at, _State(start, factors))
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

    Raises
    ------
    NoEquilibriumError
        If there is no such equilibrium on the path.
    """
    goal = np.array([np.vdot(reading, rest.displacement) + distance])
    x, factors = find_displaced(
        assembly, rest.displacement, pattern[None], reading[None], goal, np.zeros(1)
    )
    return Shape(assembly.s, x, factors[0] * pattern)


def _free(assembly: Assembly, load: np.ndarray) -> np.ndarray:
    return np.where(assembly.fixed, 0.0, load)
