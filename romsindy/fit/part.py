"""Effects in a hypothesis with their values, and the equation of motion and reading with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from romsindy.effects.base import Effect, Scales, Shape, State
from romsindy.fit.collocation import Linearisation
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array, Indices


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


def columns_of(parts: Sequence[Part], record: int) -> Indices:
    """Values, of all parts, that act in a record."""
    found, first = [], 0
    for part in parts:
        found += [first + c for c in part.columns(record)]
        first += part.size
    return np.array(found, int)


def prior_cost(parts: Sequence[Part]) -> float:
    cost = 0.0
    for part in parts:
        if part.tolerance is not None:
            cost += float(np.sum((part.strengths / part.tolerance) ** 2))
        for value, shape in zip(part.shape, part.shapes, strict=True):
            if shape.spread is not None:
                cost += float((value - shape.starts[0]) / shape.spread) ** 2
    return cost
