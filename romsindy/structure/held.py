"""Shapes that a structure takes under the force of one mode, and what a motion along them feels.

Held by lambda M phi the structure takes a shape x, at q = phi^T M x. With s = x - phi q, what
follows ([1], [2]):

    K(q) = lambda                        restoring force, exactly
    1 + h(q) = x'^T M x' = 1 + s'^T M s'     inertia, x' = dx/dq

Between the cases K - omega^2 q and s are q^2 times Chebyshev polynomials, fitted by least squares:
value and slope at rest are those of the mode. Cases are added until what they foretell in between
no longer changes.

The equation of any structure along one mode has the coefficients

    K(q) = omega^2 q + sum_m gamma_m q^m
    1 + h(q) = 1 + Upsilon_3 q^2 + 2 Upsilon_4 q^3 + Upsilon_5 q^4 + ...

of [2], eqs. (10)-(17). Upsilon_3 = 4 beta_2^T M beta_2 of s(q) = sum_k beta_k q^k. The higher ones
of [2] are sums of such products as well, but a sum that is cut at some power is wrong at the edge
of the range: they are fitted to h itself.

[1] E. Nicolaidou, T. L. Hill, S. A. Neild, "Indirect reduced-order modelling: using nonlinear
    manifolds to conserve kinetic energy", Proc. R. Soc. A 476 (2020), doi 10.1098/rspa.2020.0589.
[2] Ahmadi, Hill, Jiang, Neild, Nonlinear Dynamics (2023), doi 10.1007/s11071-023-08813-z.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.polynomial import chebyshev

from romsindy.structure.linear import HeldCases, LinearMode
from romsindy.typing import Array

_GRID = 101  # points at which functions of q are compared, and fitted
_LEVELS = (4, 8, 16, 32)  # Chebyshev intervals over the range
_FIRST = 0.25  # of the range: the first case, taken from the linear stiffness
_DOUBLE, _MOST_LOAD = 2.0, 4.0  # times the last displacement, and force: a step outwards, at most
_JUMP = 2.5  # times the last displacement: no step outwards, but to another branch
_THERE = 0.98  # of the range is as good as all
_BACK = 3  # times that a step outwards which fails is halved
_KNOWN = 0.05  # of the change of K: a curve that is known worse is none
_NEAR = 0.25  # of the distance of two points: a case so near to a point stands for it
# Of omega^2 q, or of the mass: a structure that changes less is as good as linear.
_NO_CHANGE = 0.01
_FEWEST, _HIGHEST = 4, 16  # cases that are given, and powers of q through them
_HALF = 0.5  # of the linear stiffness, or twice, is that of the smallest case
_AS_WELL, _ROUNDING = 1.5, 1e-9
_BESIDE = 0.1  # of a tolerance is enough for the inertia, as a part of the mass

Hold = Callable[[Sequence[Sequence[float]]], list[HeldCases]]


@dataclass(frozen=True, eq=False)
class HeldCurve:
    """Shapes along one mode, known at some cases and interpolated between them."""

    mode: LinearMode
    cases: HeldCases  # without the rest
    order: int  # highest power of q

    def __repr__(self) -> str:
        return (
            f"HeldCurve(mode {self.mode.number}, {len(self.cases.factors)} static cases, "
            f"q = {self.range[0]:.4g} to {self.range[1]:.4g})"
        )

    @property
    def omega2(self) -> float:
        """Square of the linear frequency, 1/s^2."""
        return self.mode.omega2

    @cached_property
    def at(self) -> Array:
        """Coordinates of the cases, (m,)."""
        return np.asarray(self.cases.shapes @ self.mode.momentum)

    @cached_property
    def range(self) -> tuple[float, float]:
        """Least and largest coordinate that was held; the rest is within."""
        return min(0.0, float(self.at.min())), max(0.0, float(self.at.max()))

    @cached_property
    def amplitude(self) -> float:
        """Half of peak to peak of the largest motion whose ends are both within the range."""
        well = np.concatenate([[0.0], np.cumsum((self.force[1:] + self.force[:-1]) / 2)])
        rest = int(np.argmin(well))
        level = min(well[0], well[-1])
        left = np.interp(-level, -well[: rest + 1], self.q[: rest + 1])
        right = np.interp(level, well[rest:], self.q[rest:])
        return float(right - left) / 2

    @cached_property
    def q(self) -> Array:
        """Coordinates at even steps, (n,)."""
        return np.linspace(*self.range, _GRID)

    def evenly(self, count: int) -> Array:
        """Coordinates over the range between which a polynomial is known best, (count,)."""
        low, high = self.range
        x = np.cos(np.pi * (np.arange(count) + 0.5) / count)
        return (low + high) / 2 + (high - low) / 2 * x

    def chebyshev_at(self, q: Array, power: int, count: int, slope: bool = False) -> Array:
        """A power of q times T_k over the range, or their derivatives, (len(q), count)."""
        low, high = self.range
        x, unit, q = (2 * q - low - high) / (high - low), np.eye(count), q[:, None]
        values = chebyshev.chebval(x, unit).T
        if not slope:
            return np.asarray(q**power * values)
        slopes = chebyshev.chebval(x, chebyshev.chebder(unit)).T * (2 / (high - low))
        return np.asarray(power * q ** (power - 1) * values + q**power * slopes)

    def powers_at(self, q: Array, slope: bool = False) -> Array:
        """q^2 T_k, or their derivatives, (len(q), order - 1), over the square of the range."""
        low, high = self.range
        return self.chebyshev_at(q, 2, self.order - 1, slope) / max(-low, high) ** 2

    @cached_property
    def _solve(self) -> Array:
        return np.linalg.pinv(self.powers_at(self.at))

    @cached_property
    def _force(self) -> Array:
        return np.asarray(self._solve @ (self.cases.factors - self.omega2 * self.at))

    @cached_property
    def follows(self) -> Array:
        """s of each of `powers_at`, (order - 1, n)."""
        return np.asarray(self._solve @ (self.cases.shapes - np.outer(self.at, self.mode.shape)))

    @cached_property
    def _products(self) -> Array:
        return np.asarray(self.follows @ (self.mode.mass @ self.follows.T))

    def force_at(self, q: Array) -> Array:
        """K(q), (len(q),)."""
        return np.asarray(self.omega2 * q + self.powers_at(q) @ self._force)

    def inertia_at(self, q: Array) -> Array:
        """1 + h(q), (len(q),)."""
        slopes = self.powers_at(q, slope=True)
        return np.asarray(1.0 + np.einsum("ij,jk,ik->i", slopes, self._products, slopes))

    def following_at(self, q: Array, slope: bool = False, rows: Any = slice(None)) -> Array:
        """s(q), or its derivative, of all freedoms, or of some, (len(q), n)."""
        return np.asarray(self.powers_at(q, slope) @ self.follows[:, rows])

    def shapes_at(self, q: Array, rows: Any = slice(None)) -> Array:
        """x(q) of all freedoms, or of some, (len(q), n)."""
        return np.outer(q, self.mode.shape[rows]) + self.following_at(q, rows=rows)

    @cached_property
    def force(self) -> Array:
        """K(q) at even steps, (n,)."""
        return self.force_at(self.q)

    @cached_property
    def inertia(self) -> Array:
        """1 + h(q) at even steps, (n,)."""
        return self.inertia_at(self.q)

    @property
    def following(self) -> Array:
        """s(q) at even steps, (n, m)."""
        return self.following_at(self.q)

    def mass_product(self, field: Array) -> float:
        """field^T M field."""
        return float(field @ (self.mode.mass @ field))

    @cached_property
    def changes(self) -> CurveError:
        """Largest changes of K and of h; of a structure that hardly changes, what would count."""
        linear = self.omega2 * self.q
        bent = max(_largest(self.force - linear), _NO_CHANGE * _largest(linear))
        return CurveError(bent, max(_largest(self.inertia - 1), _NO_CHANGE))

    def close(self, error: CurveError, part: float) -> bool:
        """Whether errors are less than a part of the largest changes; h stands beside 1."""
        slight = error.inertia * self.changes.inertia < _BESIDE * part
        return error.force < part and (error.inertia < part or slight)

    def as_parts(self, force: Array, inertia: Array) -> CurveError:
        """Errors of K and of 1 + h over q as parts of their largest change."""
        return CurveError(
            _largest(force) / self.changes.force, _largest(inertia) / self.changes.inertia
        )

    def left_out(self) -> CurveError:
        """How far K and s are from cases that take no part, as parts of their largest change."""
        free = 1 - np.einsum("ij,ji->i", self.powers_at(self.at), self._solve)
        off = self.cases.factors - self.force_at(self.at)
        lost = self.cases.shapes - self.shapes_at(self.at)
        changes = self.cases.shapes - np.outer(self.at, self.mode.shape)
        size = _largest(np.linalg.norm(changes, axis=1))
        floor = _NO_CHANGE * _largest(np.linalg.norm(self.cases.shapes, axis=1))
        return CurveError(
            _largest(off / free) / self.changes.force,
            _largest(np.linalg.norm(lost, axis=1) / free) / max(size, floor),
        )

    def change_from(self, other: HeldCurve) -> CurveError:
        """How far K and h are from those of another curve."""
        force = self.force - other.force_at(self.q)
        return self.as_parts(force, self.inertia - other.inertia_at(self.q))


class CurveError(NamedTuple):
    """Errors, or changes, of K and of h."""

    force: float
    inertia: float


def _largest(x: Array) -> float:
    return float(np.abs(x).max())


class Found(NamedTuple):
    """A curve, its error, and what is to be said of it."""

    curve: HeldCurve
    error: CurveError
    notes: tuple[str, ...]


def of_cases(mode: LinearMode, cases: HeldCases) -> Found:
    """A curve through cases that are given; its error is what it lacks at a case that is left out.

    The order is the lowest that foretells such a case nearly as well as any.

    Raises a ValueError for fewer than 4 cases.
    """
    count = len(cases.factors)
    if count < _FEWEST:
        raise ValueError(
            f"cases of mode {mode.number} are {count}: give {_FEWEST} static cases or more"
        )
    at = cases.shapes @ mode.momentum
    least = int(np.argmin(np.abs(at)))
    if not _HALF < cases.factors[least] / (mode.omega2 * at[least]) < 1 / _HALF:
        raise ValueError(
            f"cases of mode {mode.number}: the factor {cases.factors[least]:.4g} is said to hold q"
            f" = {at[least]:.4g}, where omega^2 q is {mode.omega2 * at[least]:.4g}: loads are"
            " factor * mass @ shape, with shape @ mass @ shape = 1; give small ones too"
        )
    curves = [HeldCurve(mode, cases, n) for n in range(3, min(count, _HIGHEST + 1))]
    missed = [curve.left_out() for curve in curves]
    scores = [max(m) for m in missed]
    best = next(i for i, s in enumerate(scores) if s <= _AS_WELL * min(scores) + _ROUNDING)
    _require_known(curves[best], missed[best])
    return Found(curves[best], missed[best], ())


def _require_known(curve: HeldCurve, error: CurveError) -> None:
    """Raise a ValueError where cases lie on no smooth curve."""
    if not error.force < _KNOWN:
        raise ValueError(
            f"the shapes of mode {curve.mode.number} are no smooth curve over the range: K between"
            f" the cases is not known to {100 * _KNOWN:g} % of its change with"
            f" {len(curve.cases.factors)} of them; take a smaller range, or more cases"
        )


def follow(hold: Hold, mode: LinearMode, reach: float, tolerance: float, most: int) -> Found:
    """Hold a structure along a mode until its loudest freedom was moved by ``reach`` either way.

    ``hold`` takes factors of M phi, a row for each direction, and gives the shapes. Cases are added
    until K and h change by less than ``tolerance`` of their largest change, or there are ``most``.

    Raises a ValueError where too few cases, or no smooth curve, could be held.
    """
    sides = [_Side(mode, sign, reach) for sign in (-1.0, 1.0)]
    while going := [s for s in sides if not s.ended]:
        asked = [[s.next()] for s in going]
        for side, held in zip(going, hold(asked), strict=True):
            side.take(held)
    cases = joined([s.cases for s in sides])
    notes = tuple(note for s in sides for note in s.notes)
    if len(cases.factors) < _FEWEST:
        raise ValueError(
            f"mode {mode.number} could be held at {len(cases.factors)} static cases only: ask for"
            " a smaller range, and look at the deck in CalculiX"
        )
    curve = HeldCurve(mode, cases, _LEVELS[0] // 2 + 1)
    error = CurveError(np.inf, np.inf)
    for level in _LEVELS:
        wanted = _between(curve, level)
        if len(curve.cases.factors) + len(wanted) > most:
            break
        rows = [sorted(wanted[wanted < 0], reverse=True), sorted(wanted[wanted > 0])]
        cases = joined([curve.cases, *hold([row for row in rows if row])])
        finer = HeldCurve(mode, cases, min(level + 1, len(cases.factors)))
        error, curve = finer.change_from(curve), finer
        if curve.close(error, tolerance):
            break
    _require_known(curve, error)
    if not curve.close(error, tolerance):
        notes += (
            f"K and h between the cases are not known to {100 * tolerance:g} % yet, with"
            f" {len(curve.cases.factors)} cases: a smaller range is known better",
        )
    return Found(curve, error, notes)


def joined(several: Sequence[HeldCases]) -> HeldCases:
    """All cases, by their factors."""
    factors = np.concatenate([h.factors for h in several])
    order = np.argsort(factors)
    return HeldCases(factors[order], np.concatenate([h.shapes for h in several])[order])


def _between(curve: HeldCurve, intervals: int) -> Array:
    """Factors of the Chebyshev points of the range near which there is no case yet."""
    low, high = curve.range
    x = np.cos(np.pi * np.arange(intervals + 1) / intervals)
    q = (low + high) / 2 + (high - low) / 2 * x
    room = _NEAR * np.minimum(np.abs(np.gradient(q)), np.abs(q))
    known = np.append(curve.at, 0.0)
    free = np.min(np.abs(q[:, None] - known), axis=1) > np.maximum(room, 1e-3 * (high - low))
    return curve.force_at(q[free])


@dataclass(eq=False)
class _Side:
    """The walk outwards in one direction."""

    mode: LinearMode
    sign: float
    reach: float

    def __post_init__(self) -> None:
        self.cases = HeldCases(np.zeros(0), np.zeros((0, len(self.mode.shape))))
        self.ended, self.failed = False, 0
        self.notes: list[str] = []

    @property
    def moved(self) -> Array:
        """Displacements of the loudest freedom, (m,), positive outwards."""
        sign = self.sign * np.sign(self.mode.shape[self.mode.loudest])
        return np.asarray(sign * self.cases.shapes[:, self.mode.loudest])

    def take(self, held: HeldCases) -> None:
        """Keep the case that was asked for, if there is one on this branch."""
        before = len(self.cases.factors)
        outwards = [np.concatenate(pair) for pair in zip(self.cases, held, strict=True)]
        self.cases = HeldCases(*outwards)
        self._drop_jump()
        self.failed = 0 if len(self.cases.factors) > before else self.failed + 1
        far = float(self.moved.max(initial=0.0))
        if far >= _THERE * self.reach:
            self.ended = True
        elif self.failed > _BACK:
            self.ended = True
            direction = "positive" if self.sign > 0 else "negative"
            self.notes.append(
                f"CalculiX finds no shape beyond {far:.4g} in the {direction} direction of mode"
                f" {self.mode.number} ({self.reach:.4g} was asked for): a limit point, where it"
                " snaps through, or elements that turn inside out; what was held is used"
            )

    def _drop_jump(self) -> None:
        """Leave out what is on another branch: no step outwards goes so far."""
        moved, first = self.moved, _FIRST * self.reach
        before = np.maximum(np.append(first, moved[:-1]), first)
        kept = min([len(moved), *np.flatnonzero(moved > _JUMP * before)])
        self.cases = HeldCases(*(x[:kept] for x in self.cases))

    def next(self) -> float:
        """The factor of the next case outwards."""
        omega2, phi = self.mode.omega2, abs(self.mode.shape[self.mode.loudest])
        if not len(self.cases.factors):
            goal = _FIRST * self.reach * 0.5**self.failed
            return float(self.sign * omega2 * goal / phi)
        q = self.sign * (self.cases.shapes @ self.mode.momentum)
        force = self.sign * self.cases.factors
        goal = min(_DOUBLE * self.moved[-1], self.reach)
        there = q[-1] * goal / self.moved[-1]
        powers = np.arange(2, 2 + min(len(q), 2))
        bent, *_ = np.linalg.lstsq(q[-3:, None] ** powers, (force - omega2 * q)[-3:])
        wanted = omega2 * there + float(there**powers @ bent)
        step = np.clip(wanted / force[-1], 1.05, _MOST_LOAD) - 1
        return float(self.sign * force[-1] * (1 + step * 0.5**self.failed))


class HeldShapes(Protocol):
    """What a reduction asks of a structure along one mode."""

    @property
    def omega2(self) -> float:
        """Square of the linear frequency, 1/s^2."""

    @property
    def q(self) -> Array:
        """Coordinates, (n,)."""

    @property
    def force(self) -> Array:
        """K(q), (n,)."""

    @property
    def inertia(self) -> Array:
        """1 + h(q), (n,)."""

    @property
    def following(self) -> Array:
        """x - x_eq - phi q of all freedoms, (n, m)."""

    def mass_product(self, field: Array) -> float:
        """field^T M field of a field (m,)."""


def coefficients(curve: HeldShapes, order: int) -> dict[str, float]:
    """omega^2, gamma_2 ... gamma_order and Upsilon_3 ... Upsilon_order of a curve of shapes."""
    return (
        {"omega^2": curve.omega2}
        | stiffness_coefficients(curve, order)
        | inertia_coefficients(curve, order)
    )


def stiffness_coefficients(curve: HeldShapes, order: int) -> dict[str, float]:
    """gamma_2 ... gamma_order from the static force."""
    powers = range(2, order + 1)
    gamma = _fit(curve.q, (curve.force - curve.omega2 * curve.q)[:, None], powers)[:, 0]
    return {f"gamma_{m}": float(value) for m, value in zip(powers, gamma, strict=True)}


def inertia_coefficients(curve: HeldShapes, order: int) -> dict[str, float]:
    """Upsilon_3 ... Upsilon_order: the first from the shapes, the others from h(q)."""
    beta_2 = _fit(curve.q, curve.following, range(2, order))[0]
    first = 4.0 * curve.mass_product(beta_2)
    left = curve.inertia - 1.0 - first * curve.q**2
    powers = range(3, order)
    found = {"Upsilon_3": first}
    for power, value in zip(powers, _fit(curve.q, left[:, None], powers), strict=True):
        # odd powers carry 2 Upsilon, as in [2]
        found[f"Upsilon_{power + 1}"] = float(value[0]) / (2.0 if power % 2 else 1.0)
    return found


def _fit(q: Array, values: Array, powers: range) -> Array:
    """Least-squares coefficients, (n_powers, n_columns), of the powers of q."""
    scale = np.abs(q).max()
    solution, *_ = np.linalg.lstsq(np.power.outer(q / scale, np.array(powers)), values, rcond=None)
    return np.asarray(solution / scale ** np.array(powers)[:, None])
