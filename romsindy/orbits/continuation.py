"""Curves of solutions of F(u, p) = 0 by pseudo-arclength continuation, for any residual F.

A step goes along the tangent (`predict`), returns to the curve at right angles to it (`correct`)
and chooses the length of the next one (`next_step`), so that it passes folds, where p turns back.
Lengths are measured in u and p as they are: scale them to be of order one.

Inside, z = (u, p). The method is that of [1], chapter 4.

[1] R. Seydel, "Practical Bifurcation and Stability Analysis", 3rd ed., Springer (2010).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from romsindy.typing import Array, Indices

Residual = Callable[[Array, float], Array]
Jacobian = Callable[[Array, float], Array]
Verdict = Callable[[Array, float], str]

_MOST_ITERATIONS = 8
_FEW_ITERATIONS = 3  # of Newton from a good prediction: the step may grow


class ContinuationError(RuntimeError):
    """No solution was found near the guess.

    Examples
    --------
    >>> continue_branch(lambda u, p: u**2 + 1, [1.0], 0.0, p_range=(-1, 1))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    romsindy.orbits.continuation.ContinuationError: the corrector does not converge near p = 0: ...
    """


@dataclass(frozen=True)
class Steps:
    """How a branch is walked.

    Parameters
    ----------
    first, least, most : float
        Lengths of steps in the space of (u, p). A branch ends where steps above ``least`` fail.
    turn : float
        Largest angle, rad, from the tangent at one end of a step to that at the other, and to the
        way between them.
    tolerance : float
        Last Newton update, relative to ``1 + |z|``. Newton squares the error: what is left after an
        update of 1e-8 is at rounding.
    max_points : int
        Length of the branch at which to stop.
    crossing : float, optional
        Longest step across a point where another branch may cross. A longer one could change over
        to a branch that only comes near; without this limit it is not looked for.

    Raises
    ------
    ValueError
        If 0 < least <= first <= most does not hold, or another number is not positive.

    Examples
    --------
    >>> steps = Steps(most=0.02)
    >>> fine = continue_branch(lambda u, p: u - p**2, [0.0], 0.0, p_range=(0, 1), steps=steps)
    >>> bool(np.diff(fine.p).max() <= 0.02)
    True
    """

    first: float = 0.01
    least: float = 1e-6
    most: float = 0.1
    turn: float = 0.3
    tolerance: float = 1e-8
    max_points: int = 1000
    crossing: float | None = None

    def __post_init__(self) -> None:
        if not 0 < self.least <= self.first <= self.most:
            raise ValueError(
                f"steps must satisfy 0 < least <= first <= most, got least = {self.least!r},"
                f" first = {self.first!r}, most = {self.most!r}"
            )
        if not (self.turn > 0 and self.tolerance > 0 and self.max_points > 0):
            raise ValueError("turn, tolerance and max_points must be positive")
        if self.crossing is not None and self.crossing < self.least:
            raise ValueError(
                f"crossing = {self.crossing!r} must be at least least = {self.least!r}"
            )


@dataclass(frozen=True, eq=False, repr=False)
class Branch:
    """Solutions along a curve, in the order of walking.

    Attributes
    ----------
    u, p, tangent : (n, m), (n,), (n, m + 1) arrays
        With unit tangents in the space of (u, p).
    residual : (n,) array
        Largest absolute component of F.
    folds : (k,) array of int
        Points at which p turns back; they are located, not merely enclosed.
    stop_reason : str
        Why the branch ends where it ends.
    """

    u: Array
    p: Array
    tangent: Array
    residual: Array
    folds: Indices
    stop_reason: str

    def __len__(self) -> int:
        return len(self.p)

    def __repr__(self) -> str:
        return (
            f"<Branch: {len(self)} points, p {self.p[0]:.4g} to {self.p[-1]:.4g},"
            f" {len(self.folds)} folds\n {self.stop_reason}>"
        )


def continue_branch(
    residual: Residual,
    u: ArrayLike,
    p: float,
    *,
    p_range: tuple[float, float],
    jacobian: Jacobian | None = None,
    direction: ArrayLike = 1.0,
    objection: Verdict | None = None,
    until: Verdict | None = None,
    steps: Steps | None = None,
) -> Branch:
    """Follow the solutions of F(u, p) = 0 from a first guess.

    Parameters
    ----------
    residual : callable
        F(u, p), (m,) array.
    u, p : (m,) array, float
        Guess of u at p, where the branch starts.
    p_range : (float, float)
        Where the branch ends; the last point lies on the limit.
    jacobian : callable, optional
        Derivatives of F at (u, p), (m, m + 1) array, by p in the last column; central differences
        if it is not given.
    direction : float or (m + 1,) array
        Sign of the first change of p, or a vector (u, p) towards which to set out.
    objection, until : callable, optional
        Say of a solution (u, p) why the branch must not go there, and why it may end there; an
        empty text lets it go on.
    steps : Steps, optional

    Returns
    -------
    Branch
        It ends at a limit of p, where it closes, as ``until`` says, at ``max_points``, where no
        further step is possible, or at an interruption from the keyboard, which keeps what was
        computed.

    Raises
    ------
    ValueError
        If u is not one-dimensional or finite, or p lies outside its range.
    ContinuationError
        If no solution is found near the first guess.

    Examples
    --------
    >>> circle = continue_branch(lambda u, p: u**2 + p**2 - 1, [1.0], 0.0, p_range=(-2, 2))
    >>> circle.stop_reason, circle.p[circle.folds].round(12).tolist()
    ('the branch is closed', [1.0, -1.0])
    """
    u = np.array(u, float)
    low, high = p_range
    if u.ndim != 1 or not np.all(np.isfinite(u)):
        raise ValueError(f"u must be one-dimensional and finite, got {u!r}")
    if not low <= p <= high:
        raise ValueError(f"p = {p!r} lies outside p_range = {p_range!r}: start within it")
    steps = steps or Steps()
    sided = steps.crossing is not None
    system = _System(residual, jacobian, objection, until, steps.tolerance, sided)
    with np.errstate(all="ignore"):  # steps that lead out of F's domain are taken back
        points = [_first_point(system, np.append(u, p), direction)]
        try:
            stop_reason = _walk(system, points, p_range, steps)
        except KeyboardInterrupt:
            stop_reason = "interrupted from the keyboard"
    z, tangents, residuals, _, _, folds = map(np.array, zip(*points, strict=True))
    return Branch(z[:, :-1], z[:, -1], tangents, residuals, np.flatnonzero(folds), stop_reason)


class _OnBranch(NamedTuple):
    z: Array
    tangent: Array
    residual: float
    iterations: int
    side: float  # sign of the determinant of Jacobian and tangent; 0 if it is not asked for
    fold: bool = False


@dataclass(frozen=True)
class _System:
    """F as a function of z = (u, p), with what goes with it."""

    F: Residual
    derivatives: Jacobian | None
    forbids: Verdict | None
    until: Verdict | None
    tolerance: float
    sided: bool = False  # whether points say on which side of crossing branches they are

    def residual(self, z: Array) -> Array:
        return self.F(z[:-1], float(z[-1]))

    def jacobian(self, z: Array) -> Array:
        if self.derivatives is not None:
            return self.derivatives(z[:-1], float(z[-1]))
        # Central differences: h ~ eps^(1/3) balances truncation against rounding.
        h = np.finfo(float).eps ** (1 / 3) * np.maximum(1, np.abs(z))
        columns = [
            (self.residual(z + step) - self.residual(z - step)) / (2 * size)
            for step, size in zip(np.diag(h), h, strict=True)
        ]
        return np.stack(columns, axis=1)

    def side(self, matrix: Array) -> float:
        """It changes where another branch crosses ([1], chapter 5), and from one to the next."""
        return float(np.linalg.slogdet(matrix)[0]) if self.sided else 0.0

    def objection(self, z: Array) -> str:
        return self.forbids(z[:-1], float(z[-1])) if self.forbids else ""

    def end(self, z: Array) -> str:
        return self.until(z[:-1], float(z[-1])) if self.until else ""


def predict(point: _OnBranch, step: float) -> Array:
    """Go along the tangent; the curve is missed by step^2 times half its curvature."""
    return point.z + step * point.tangent


def correct(system: _System, guess: Array, normal: Array) -> _OnBranch:
    """Solve F(z) = 0, normal . (z - guess) = 0 by Newton's method.

    The tangent comes with the last update: the same matrix, and 1 in place of the residual.

    Raises a ContinuationError if the updates do not become small.
    """
    z = guess
    right = np.zeros((len(z), 2))
    right[-1, 1] = 1.0
    for iteration in range(1, _MOST_ITERATIONS + 1):
        right[:-1, 0] = -system.residual(z)
        matrix = np.vstack([system.jacobian(z), normal])
        try:
            solution = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            break
        z = z + solution[:, 0]
        size = np.linalg.norm(solution[:, 0])
        if not np.isfinite(size):
            break
        if size <= system.tolerance * (1 + np.linalg.norm(z)):
            tangent = solution[:, 1] / np.linalg.norm(solution[:, 1])
            left = float(np.max(np.abs(system.residual(z))))
            return _OnBranch(z, tangent, left, iteration, system.side(matrix))
    raise ContinuationError(
        f"the corrector does not converge near p = {guess[-1]:.6g}: give a guess nearer to a"
        " solution, or scale u and p to order one"
    )


def next_step(step: float, turn: float, iterations: int, steps: Steps) -> float:
    """Grow by half after an easy step, shrink after a hard one, and keep the turn in bounds."""
    ease = 1.5 if iterations <= _FEW_ITERATIONS else _FEW_ITERATIONS / iterations
    bend = 0.7 * steps.turn / max(turn, 1e-12)  # 0.7: the next step may turn more than this one
    return float(np.clip(step * min(ease, bend), steps.least, steps.most))


def _first_point(system: _System, guess: Array, direction: ArrayLike) -> _OnBranch:
    along_p = np.eye(len(guess))[-1]
    point = correct(system, guess, along_p)
    # The null vector of the Jacobian is the tangent also where p stands still.
    jacobian = system.jacobian(point.z)
    tangent = np.linalg.svd(jacobian)[2][-1]
    wanted = along_p * direction if np.ndim(direction) == 0 else np.asarray(direction, float)
    tangent = tangent if tangent @ wanted >= 0 else -tangent
    return point._replace(tangent=tangent, side=system.side(np.vstack([jacobian, tangent])))


def _walk(
    system: _System, points: list[_OnBranch], p_range: tuple[float, float], steps: Steps
) -> str:
    """Append points until the branch ends, and say why it does."""
    step = steps.first
    while len(points) < steps.max_points:
        here = points[-1]
        limit = p_range[1] if here.tangent[-1] > 0 else p_range[0]
        if end := system.end(here.z) or (here.z[-1] == limit and f"p reached {limit:.6g}"):
            return end
        try:
            there = _accepted(system, here, step, steps)
            limit = float(np.clip(there.z[-1], *p_range))
            if limit != there.z[-1]:
                points.append(_on_limit(system, here, there, limit))
                continue
            passed = _fold(system, here, there, step)
        except ContinuationError as error:
            if step <= steps.least:
                return str(error)
            step = max(step / 2, steps.least)
            continue
        if _passes(points[0], here, there) and len(points) > 2:
            points += [*passed, points[0]]
            return "the branch is closed"
        points += [*passed, there]
        step = next_step(step, _angle(here, there), there.iterations, steps)
    return f"max_points = {steps.max_points} reached"


def _accepted(system: _System, here: _OnBranch, step: float, steps: Steps) -> _OnBranch:
    there = correct(system, predict(here, step), here.tangent)
    if _angle(here, there) > steps.turn:
        raise ContinuationError(
            f"the branch turns sharply at p = {here.z[-1]:.6g}: a corner, a cusp or another branch"
        )
    if steps.crossing is not None and step > steps.crossing and here.side != there.side:
        raise ContinuationError(f"another branch is near at p = {here.z[-1]:.6g}")
    objection = system.objection(there.z)
    if objection:
        raise ContinuationError(objection)
    return there


def _angle(here: _OnBranch, there: _OnBranch) -> float:
    """From the tangent here to that there, or to the way there, whichever is larger."""
    way = there.z - here.z
    cosines = here.tangent @ there.tangent, here.tangent @ way / np.linalg.norm(way)
    return float(np.arccos(np.clip(min(cosines), -1, 1)))


def _on_limit(system: _System, here: _OnBranch, there: _OnBranch, limit: float) -> _OnBranch:
    share = (limit - here.z[-1]) / (there.z[-1] - here.z[-1])
    guess = here.z + share * (there.z - here.z)
    guess[-1] = limit
    end = correct(system, guess, np.eye(len(guess))[-1])
    return end if end.tangent @ here.tangent > 0 else end._replace(tangent=-end.tangent)


def _fold(system: _System, here: _OnBranch, there: _OnBranch, step: float) -> list[_OnBranch]:
    """Point between the two at which the tangent has no component along p, if there is one."""
    if here.tangent[-1] * there.tangent[-1] >= 0:
        return []
    # The ends are as found: next to a fold, rounding may give them another sign.
    known = {0.0: here, step: there}

    def at(part: float) -> _OnBranch:
        return known.get(part) or correct(system, predict(here, part), here.tangent)

    part = brentq(lambda part: float(at(part).tangent[-1]), 0.0, step, xtol=1e-10 * step)
    return [correct(system, predict(here, part), here.tangent)._replace(fold=True)]


def _passes(start: _OnBranch, here: _OnBranch, there: _OnBranch) -> bool:
    """Whether the step from here to there goes through the start, in its direction."""
    chord = there.z - here.z
    along = (start.z - here.z) @ chord / (chord @ chord)
    beside = np.linalg.norm(start.z - here.z - along * chord)
    near = 0 < along <= 1 and beside < 0.1 * np.linalg.norm(chord)
    return bool(near and start.tangent @ there.tangent > 0)
