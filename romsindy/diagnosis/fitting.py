"""Fits by simulation that start from the measured motion.

A hypothesis is a model and the effects added to it. Gauss-Newton's method finds strengths, shapes
and initial states together with the motion itself: every step solves the equation linearised about
the present motion (see `romsindy.quasilinear`), which at first is the smoothed measurement.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from romsindy.diagnosis.effects import Effect, Scales, Shape, State
from romsindy.diagnosis.normal import NormalEquations
from romsindy.diagnosis.records import Measured
from romsindy.model import ReducedModel
from romsindy.quasilinear import Response, nodes, respond, sampled
from romsindy.trajectory import Linearisation, Trajectory
from romsindy.typing import Array, Indices

_ITERATIONS = 16
_LEASH = 0.3  # largest change of the motion in one step, in amplitudes
_WORSE, _SHORTEST = 1.5, 0.02  # a step that makes the misfit worse is shortened
_LOST = 1e4  # a linearised motion that goes further than this leads nowhere


@dataclass(frozen=True)
class Part:
    """One effect in a hypothesis, with its values: strengths (n_sets, k) and shape (s,)."""

    effect: Effect
    shapes: tuple[Shape, ...]
    strengths: Array
    shape: Array
    tolerance: float | None = None  # standard deviation of a strength known beforehand to be near 0

    @classmethod
    def of(cls, effect: Effect, scales: Scales, n_records: int, start: Sequence[float]) -> Part:
        """A part with no strength yet; an effect may name a strength to start from."""
        sets = n_records if effect.per_record else 1
        first = float(getattr(effect, "start", 0.0))
        strengths = np.full((sets, effect.n_strengths), first)
        shapes = tuple(s.from_start(v) for s, v in zip(effect.shapes(scales), start, strict=True))
        return cls(effect, shapes, strengths, np.array(start, float))

    @property
    def size(self) -> int:
        """Number of values."""
        return self.strengths.size + self.shape.size

    def own(self, record: int) -> Array:
        """Strengths in one record, (k,)."""
        return self.strengths[record if self.effect.per_record else 0]

    def columns(self, record: int) -> list[int]:
        """Which of the values act in a record."""
        k = self.effect.n_strengths
        first = k * record if self.effect.per_record else 0
        n = self.strengths.size
        return [*range(first, first + k), *range(n, n + self.shape.size)]

    def moved(self, change: Array) -> Part:
        """Values plus a change, within limits but for rounding."""
        n = self.strengths.size
        values = np.clip(self.values + change, *self.limits())
        return replace(self, strengths=values[:n].reshape(self.strengths.shape), shape=values[n:])

    def limits(self) -> tuple[Array, Array]:
        """Least and largest of all values."""
        least = np.full(self.strengths.size, 0.0 if self.effect.sign else -np.inf)
        low = np.array([*least, *(s.low for s in self.shapes)])
        high = np.array([*np.full(len(least), np.inf), *(s.high for s in self.shapes)])
        return low, high

    @property
    def values(self) -> Array:
        """Strengths, then shape."""
        return np.concatenate([self.strengths.ravel(), self.shape])

    def steps(self) -> Array:
        """Small changes of the shape for differences."""
        return np.array([1e-6 * max(abs(s.high - s.low), abs(s.high)) for s in self.shapes])

    def by_value(self, of: str, arguments: tuple, record: int) -> Array:
        """Derivatives of force or reading with respect to the values in `columns`, (m, n)."""
        function = getattr(self.effect, of)
        unit = function(*arguments, self.shape)
        own = self.own(record)
        rows: list[Array] = [unit]
        for i, h in enumerate(self.steps()):
            there = self.shape.copy()
            there[i] += h if self.shape[i] + h <= self.shapes[i].high else -h
            change = function(*arguments, there) - unit
            rows.append((own @ change / (there[i] - self.shape[i]))[None])
        return np.concatenate(rows)


@dataclass(frozen=True)
class ExtendedEquation:
    """The model with its parts, in one record."""

    model: ReducedModel
    parts: tuple[Part, ...]
    record: int
    step: float

    def linearise(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Linearisation:
        """Residual and its derivatives, (n,) each."""
        residual, *slopes = self.model.linearise(q, q_dot, q_ddot)
        state = State(t, q, q_dot, q_ddot, self.step)
        for part in self.parts:
            own = part.own(self.record)
            forces = part.effect.forces(state, part.shape) if np.any(own) else None
            if forces is not None:
                residual = residual + own @ forces
                added = part.effect.slopes(state, part.shape, own)
                slopes = [a + b for a, b in zip(slopes, added, strict=True)]
        return Linearisation(residual, *(np.broadcast_to(s, q.shape) for s in slopes))

    def by_parameter(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """Derivatives of the residual with respect to the values that act in the record."""
        state = State(t, q, q_dot, q_ddot, self.step)
        rows: list[Array] = []
        for part in self.parts:
            if part.effect.forces(state, part.shape) is None:
                rows.append(np.zeros((len(part.columns(self.record)), len(q))))
            else:
                rows.append(part.by_value("forces", (state,), self.record))
        return np.concatenate(rows) if rows else np.zeros((0, len(q)))


@dataclass(frozen=True)
class Solution:
    """A hypothesis fitted.

    Attributes
    ----------
    parts : tuple of Part
    motions : tuple of Trajectory
        One for each record.
    residuals : tuple of (n,) arrays
        Measured minus simulated, of each record, not whitened.
    chi_squared : float
        Sum of squares of the whitened residuals, plus what the priors of the shapes cost.
    covariance : (n_values, n_values) array
        Of the values of all parts, in their order.
    converged : bool
    """

    parts: tuple[Part, ...]
    motions: tuple[Trajectory, ...]
    residuals: tuple[Array, ...]
    chi_squared: float
    covariance: Array
    converged: bool

    def slices(self) -> list[slice]:
        """Where the values of each part are."""
        ends = np.cumsum([0, *(p.size for p in self.parts)])
        return [slice(a, b) for a, b in itertools.pairwise(ends)]


def read(parts: Sequence[Part], record: int, t: Array, x: Array) -> tuple[Array, Array, Array]:
    """What the sensor shows of a motion x, (n,): reading, its slope in x, and by values (m, n)."""
    shown, slope = x, np.ones_like(x)
    rows: list[Array] = []
    for part in parts:
        added = part.effect.readings(t, x, part.shape)
        if added is None:
            rows.append(np.zeros((len(part.columns(record)), len(x))))
            continue
        own = part.own(record)
        shown = shown + own @ added
        slope = slope + own @ part.effect.reading_slopes(t, x, part.shape)
        rows.append(part.by_value("readings", (t, x), record))
    return shown, slope, np.concatenate(rows) if rows else np.zeros((0, len(x)))


def fit(
    model: ReducedModel,
    parts: Sequence[Part],
    records: Sequence[Measured],
    motions: Sequence[Trajectory] | None = None,
    *,
    fixed: bool = False,
    iterations: int = _ITERATIONS,
) -> Solution:
    """Fit the values of all parts, and the initial states, to all records.

    Parameters
    ----------
    model : ReducedModel
    parts : sequence of Part
        With their starting values.
    records : sequence of Measured
    motions : sequence of Trajectory, optional
        To start from; by default the smoothed measurement.
    fixed : bool
        Fit initial states and strengths that differ between records only.
    """
    parts = tuple(parts)
    motions = list(motions or [r.motion for r in records])
    n_values = sum(p.size for p in parts)
    last, converged = np.inf, False
    kept: _Stage | None = None
    for iteration in range(iterations):
        with np.errstate(all="ignore"):
            system, responses = _linearised(model, parts, records, motions)
            if kept is not None and not system.power <= _WORSE * kept.power:
                if kept.short < _SHORTEST:
                    parts, system = kept.parts, kept.system
                    motions = [r.motion for r in kept.responses]
                    break
                kept = replace(kept, short=0.3 * kept.short)  # a step too far: go back
                parts, motions = kept.moved()
                system = kept.system  # should this be the last step
                continue
            if not system.finite:
                return _failed(parts, motions, n_values)
            step = system.bounded_step(_held(parts, fixed, first=iteration == 0), *_limits(parts))
            weights = tuple(
                np.concatenate([[1.0], step[columns_of(parts, i)], step[n_values + 2 * i :][:2]])
                for i in range(len(records))
            )
            largest = max(
                float(np.abs(r.q @ w).max()) / record.amplitude
                for r, w, record in zip(responses, weights, records, strict=True)
            )
            if not np.isfinite(largest) or largest > _LOST:
                return _failed(parts, motions, n_values)
            short = min(1.0, _LEASH / max(largest, 1e-300))
            kept = _Stage(parts, tuple(responses), weights, step[:n_values], short, system)
            parts, motions = kept.moved()
        chi_squared = system.chi_squared(step)
        converged = short == 1.0 and abs(last - chi_squared) < 0.02 + 1e-6 * chi_squared
        if converged:
            break
        last = chi_squared
    residuals = tuple(
        r.signal - read(parts, i, r.t, sampled(m, r.derivative))[0]
        for i, (r, m) in enumerate(zip(records, motions, strict=True))
    )
    total = sum(float(np.sum(r.noise(e) ** 2)) for r, e in zip(records, residuals, strict=True))
    return Solution(
        parts,
        tuple(motions),
        residuals,
        total + prior_cost(parts),
        system.covariance()[:n_values, :n_values],
        converged,
    )


@dataclass(frozen=True)
class _Stage:
    """Where a step started, and the step."""

    parts: tuple[Part, ...]
    responses: tuple[Response, ...]
    weights: tuple[Array, ...]
    step: Array
    short: float
    system: NormalEquations

    @property
    def power(self) -> float:
        """Misfit before the step."""
        return self.system.power

    def moved(self) -> tuple[tuple[Part, ...], list[Trajectory]]:
        """Values and motions after the step."""
        motions = [
            r.moved(self.short * w) for r, w in zip(self.responses, self.weights, strict=True)
        ]
        return _moved(self.parts, self.short * self.step), motions


def _linearised(
    model: ReducedModel,
    parts: tuple[Part, ...],
    records: Sequence[Measured],
    motions: Sequence[Trajectory],
) -> tuple[NormalEquations, list[Response]]:
    """Normal equations about the present motions, and the responses that they combine."""
    system = NormalEquations(sum(p.size for p in parts), len(records))
    responses = []
    for i, (record, motion) in enumerate(zip(records, motions, strict=True)):
        equation = ExtendedEquation(model, parts, i, motion.grid.step)
        response = respond(equation, motion, equation.by_parameter(*nodes(motion)))
        change = response.samples(record.derivative)
        x = sampled(motion, record.derivative) + change[:, 0]
        shown, slope, by_value = read(parts, i, record.t, x)
        jacobian = slope[:, None] * change[:, 1:]
        jacobian[:, :-2] += by_value.T
        whitened = record.noise(np.column_stack([record.signal - shown, jacobian]))
        system.add(i, columns_of(parts, i), whitened)
        responses.append(response)
    system.add_priors(parts)
    return system, responses


def _failed(parts: tuple[Part, ...], motions: Sequence[Trajectory], n_values: int) -> Solution:
    """A hypothesis whose motion goes astray: nothing could be worse."""
    residuals = tuple(np.full(len(m.grid.fraction), np.inf) for m in motions)
    nothing = np.zeros((n_values, n_values))
    return Solution(parts, tuple(motions), residuals, np.inf, nothing, False)


def columns_of(parts: Sequence[Part], record: int) -> Indices:
    """Values, of all parts, that act in a record."""
    found, first = [], 0
    for part in parts:
        found += [first + c for c in part.columns(record)]
        first += part.size
    return np.array(found, int)


def _held(parts: Sequence[Part], fixed: bool, first: bool) -> NDArray[np.bool_]:
    """Values that stay: with no strength there is no telling a shape."""
    held: list[NDArray[np.bool_]] = [np.zeros(0, bool)]
    for p in parts:
        held.append(np.full(p.strengths.size, fixed and not p.effect.per_record))
        held.append(np.full(p.shape.size, fixed or (first and not np.any(p.strengths))))
    return np.concatenate(held)


def _limits(parts: Sequence[Part]) -> tuple[Array, Array]:
    """Least and largest changes of all values."""
    lows, highs = [np.zeros(0)], [np.zeros(0)]
    for part in parts:
        low, high = part.limits()
        lows.append(low - part.values)
        highs.append(high - part.values)
    return np.concatenate(lows), np.concatenate(highs)


def _moved(parts: tuple[Part, ...], change: Array) -> tuple[Part, ...]:
    moved, first = [], 0
    for part in parts:
        moved.append(part.moved(change[first : first + part.size]))
        first += part.size
    return tuple(moved)


def prior_cost(parts: Sequence[Part]) -> float:
    cost = 0.0
    for part in parts:
        if part.tolerance is not None:
            cost += float(np.sum((part.strengths / part.tolerance) ** 2))
        for value, shape in zip(part.shape, part.shapes, strict=True):
            if shape.spread is not None:
                cost += float((value - shape.starts[0]) / shape.spread) ** 2
    return cost
