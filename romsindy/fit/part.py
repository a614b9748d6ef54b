"""Effects in a hypothesis with their values, and what sensors show with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from romsindy.effects.base import Effect, Parameter, Scales
from romsindy.typing import Array, Indices


@dataclass(frozen=True)
class Part:
    """One effect in a hypothesis: the effect with its shape values, and its strengths."""

    effect: Effect  # with its present shape values
    parameters: tuple[Parameter, ...]  # which of them a fit may change
    strengths: Array  # (n_sets, k), one set for all records, or one for each
    tolerance: float | None = None  # standard deviation of a strength known beforehand to be near 0
    most: float = np.inf  # largest strength to either side

    @classmethod
    def of(
        cls, effect: Effect, scales: Scales, n_records: int, start: Sequence[float] = ()
    ) -> Part:
        """A part with the strength that its effect starts from, zero for most."""
        sets = n_records if effect.per_record else 1
        strengths = np.full((sets, effect.n_strengths), effect.start)
        known = effect.parameters(scales)
        parameters = tuple(p.from_start(v) for p, v in zip(known, start, strict=True))
        return cls(_shaped(effect, parameters, start), parameters, strengths, effect.tolerance)

    @property
    def size(self) -> int:
        """Number of values."""
        return self.strengths.size + len(self.parameters)

    @property
    def shape(self) -> Array:
        """Values of the parameters, (s,)."""
        return np.array([self.effect.value(p.name) for p in self.parameters], float)

    @property
    def values(self) -> Array:
        """Strengths, then shape."""
        return np.concatenate([self.strengths.ravel(), self.shape])

    def own(self, record: int) -> Array:
        """Strengths in one record, (k,)."""
        if not self.effect.per_record:
            return self.strengths[0]
        return np.where(self.shared, self.strengths[0], self.strengths[record])

    def elsewhere(self, t: Array) -> Part:
        """As it may be in another record alone, with samples at ``t`` (s)."""
        effect = self.effect.elsewhere(t)
        same = effect.n_strengths == self.effect.n_strengths
        strengths = self.strengths[:1] if same else np.zeros((1, effect.n_strengths))
        return replace(self, effect=effect, strengths=strengths)

    @property
    def shared(self) -> NDArray[np.bool_]:
        """Which of the strengths (k,) are the same in all records."""
        k = self.effect.n_strengths
        return np.arange(k) < (self.effect.n_shared if self.effect.per_record else k)

    def columns(self, record: int) -> list[int]:
        """Which of the values act in a record."""
        k, n = self.effect.n_strengths, self.strengths.size
        first = np.where(self.shared, 0, k * record)
        return [*(first + np.arange(k)).tolist(), *range(n, self.size)]

    def shaped(self, shape: Sequence[float] | Array) -> Part:
        """The same with other values of the parameters."""
        return replace(self, effect=_shaped(self.effect, self.parameters, shape))

    def moved(self, change: Array) -> Part:
        """Values plus a change, within limits but for rounding."""
        n = self.strengths.size
        values = np.clip(self.values + change, *self.limits())
        strengths = values[:n].reshape(self.strengths.shape)
        return replace(self.shaped(values[n:]), strengths=strengths)

    def limits(self) -> tuple[Array, Array]:
        """Least and largest of all values."""
        signed = self.effect.sign * self.shared if self.effect.n_shared else self.effect.sign
        least = np.where(signed, 0.0, np.full(self.strengths.shape, -self.most)).ravel()
        low = np.array([*least, *(p.low for p in self.parameters)])
        high = np.array([*np.full(len(least), self.most), *(p.high for p in self.parameters)])
        return low, high

    def by_value(self, of: str, arguments: tuple, record: int) -> Array:
        """Derivatives of force or reading by the values in `columns`, (m, n) or (m, n, R)."""
        unit = getattr(self.effect, of)(*arguments)
        own, shape = self.own(record), self.shape
        rows: list[Array] = [unit]
        for i, p in enumerate(self.parameters):
            there = shape.copy()
            step = 1e-6 * max(abs(p.high - p.low), abs(p.high))
            there[i] += step if shape[i] + step <= p.high else -step
            change = getattr(self.shaped(there).effect, of)(*arguments) - unit
            rows.append((np.tensordot(own, change, 1) / (there[i] - shape[i]))[None])
        return np.concatenate(rows)


def _shaped(
    effect: Effect, parameters: Sequence[Parameter], shape: Sequence[float] | Array
) -> Effect:
    values = {p.name: float(v) for p, v in zip(parameters, shape, strict=True)}
    return effect.shaped(values)


class Reading(NamedTuple):
    """What sensors show of a motion: (n,) values, how they follow it and values of the parts.

    ``slope`` has (n,) for one coordinate, ``by_value`` (m, n).
    """

    shown: Array
    slope: Array
    by_value: Array

    def by_motion(self, change: Array) -> Array:
        """Changes of the reading, (n, k), by changes (n, 1, k) of the motion."""
        return self.slope[:, None] * change[:, 0]


def read(parts: Sequence[Part], record: int, t: Array, x: Array) -> Reading:
    """What the sensor shows of a motion x, (n, 1).

    Reading (n,), its slope in x (n,), and its derivatives by values (m, n).
    """
    x = x[:, 0]
    shown, slope = x, np.ones_like(x)
    rows: list[Array] = []
    for part in parts:
        added = part.effect.readings(t, x)
        if added is None:
            rows.append(np.zeros((len(part.columns(record)), len(x))))
            continue
        own = part.own(record)
        shown = shown + own @ added
        slope = slope + own @ part.effect.reading_slopes(t, x)
        rows.append(part.by_value("readings", (t, x), record))
    return Reading(shown, slope, np.concatenate(rows) if rows else np.zeros((0, len(x))))


def in_orders(orders: Sequence[int], of: Callable[[int], Array]) -> Array:
    """What a function gives for several derivatives, (n, R, ...) each, side by side."""
    found = [of(order) for order in orders]
    return found[0] if len(found) == 1 else np.concatenate(found, axis=1)


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
        for value, p in zip(part.shape, part.parameters, strict=True):
            if p.spread is not None:
                cost += float((value - p.starts[0]) / p.spread) ** 2
    return cost
