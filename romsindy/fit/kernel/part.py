"""What is fitted: effects in a hypothesis with their values, and what sensors show with them.

An effect may be another coefficient of a model, or act on one of several coordinates.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from romsindy.effects.base import Effect, Parameter, Scales, State, TermEffect
from romsindy.fit.kernel.collocation import Trajectory
from romsindy.physics.coupling import Along
from romsindy.physics.damping import PowerDamping
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.physics.term_sum import TermSum
from romsindy.typing import Array, Indices

Model = TypeVar("Model", bound=TermSum)
LINEAR: tuple[Term, ...] = (Stiffness(1), PowerDamping(1))


@dataclass(frozen=True)
class Part:
    """One effect in a hypothesis: the effect with its shape values, and its strengths."""

    effect: Effect  # with its present shape values
    parameters: tuple[Parameter, ...]  # which of them a fit may change
    strengths: Array  # (n_sets, k), one set for all records, or one for each
    tolerance: float | None = None  # standard deviation of a strength known beforehand to be `near`
    most: float = np.inf  # largest strength to either side
    near: float = 0.0

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
        least = np.full(self.strengths.shape, max(-self.most, self.effect.least))
        strengths = np.where(signed, 0.0, least).ravel()
        low = np.array([*strengths, *(p.low for p in self.parameters)])
        high = np.array([*np.full(len(strengths), self.most), *(p.high for p in self.parameters)])
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

    def by_all(self, change: Array) -> Array:
        """The same by values that act in a record, those of the parts first, and the state."""
        slopes = self.by_motion(change)
        slopes[:, : len(self.by_value)] += self.by_value.T
        return slopes


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


def columns_of(parts: Sequence[Part], record: int) -> Indices:
    """Values, of all parts, that act in a record."""
    found, first = [], 0
    for part in parts:
        found += [first + c for c in part.columns(record)]
        first += part.size
    return np.array(found, int)


def priors(parts: Sequence[Part]) -> list[tuple[int, float, float]]:
    """Values known beforehand: place among all, what is known minus the value, and its spread."""
    known, at = [], 0
    for part in parts:
        for value in part.strengths.ravel():
            if part.tolerance is not None:
                known.append((at, part.near - float(value), part.tolerance))
            at += 1
        for value, p in zip(part.shape, part.parameters, strict=True):
            if p.spread is not None:
                known.append((at, p.starts[0] - float(value), p.spread))
            at += 1
    return known


def prior_cost(parts: Sequence[Part]) -> float:
    """Chi-square of values, by what was known of them beforehand."""
    return sum((off / spread) ** 2 for _, off, spread in priors(parts))


@dataclass(frozen=True)
class Coefficient(TermEffect):
    """Another value of one coefficient; the strength is the change.

    It is ``called`` as the effect whose law the model has already, where it stands for that.
    """

    of: Term
    called: str = "coefficient"

    label = "another coefficient than assumed"
    name = property(lambda self: self.called)

    @property
    def family(self) -> str:  # type: ignore[override]
        """That of the law."""
        return next((f for f in ("damping", "inertia") if self.of.has(f)), "stiffness")

    @property
    def variant(self) -> str:
        """Name of the coefficient."""
        return self.of.key

    def term(self) -> Term:
        """The term of the model itself."""
        return self.of


def _own(name: str) -> Any:
    """What the effect has without its coordinate."""
    return property(lambda self: getattr(self.of, name))


@dataclass(frozen=True)
class OnCoordinate(Effect):
    """An effect on one of several coordinates, counted from 1, which has these scales.

    Its name ends in the coordinate, as the names of coefficients do: "dry_friction [q2]".
    """

    of: Effect
    number: int
    scales: Scales

    family, variant, sign, start, tolerance, advice = map(
        _own, ("family", "variant", "sign", "start", "tolerance", "advice")
    )
    n_strengths, per_record, n_shared = map(_own, ("n_strengths", "per_record", "n_shared"))
    value, remembered, strength_unit = map(_own, ("value", "remembered", "strength_unit"))

    @property
    def name(self) -> str:  # type: ignore[override]
        """Of the effect and its coordinate."""
        return self._called(self.of.name)

    @property
    def label(self) -> str:  # type: ignore[override]
        """As an engineer says it."""
        return f"{self.of.label} of mode {self.number}"

    @property
    def resembles(self) -> tuple[str, ...]:  # type: ignore[override]
        """Others on the same coordinate."""
        return tuple(map(self._called, self.of.resembles))

    def _called(self, name: str) -> str:
        return f"{name} [q{self.number}]"

    @property
    def acts_on(self) -> int:  # type: ignore[override]
        """The column of a motion (n, R)."""
        return self.number - 1

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        return self.of.parameters(self.scales)

    def forms(self, scales: Scales) -> tuple[Effect, ...]:
        return tuple(replace(self, of=form) for form in self.of.forms(self.scales))

    def elsewhere(self, t: Array) -> OnCoordinate:
        return replace(self, of=self.of.elsewhere(t))

    def shaped(self, values: Mapping[str, float]) -> OnCoordinate:
        return replace(self, of=self.of.shaped(values)) if values else self

    def forces(self, state: State) -> Array | None:
        """From the state of its coordinate."""
        return self.of.forces(state)

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        return self.of.slopes(state, strengths)

    def term(self) -> Along | None:
        """The law along the coordinate."""
        law = self.of.term()
        return None if law is None else Along.coordinate(law, self.number)


def free_coefficients(model: TermSum, names: Sequence[str]) -> tuple[Part, ...]:
    """Changes, 0 at first, of some coefficients of a model."""
    terms = {term.key: term for term in model.terms}
    return tuple(Part(Coefficient(terms[name]), (), np.zeros((1, 1))) for name in names)


def in_place(model: TermSum, catalogue: Iterable[Effect]) -> list[Coefficient]:
    """Wrong coefficients of what only adds to a model, but is in it already: it may be too much."""
    terms = {term.key: term for term in model.terms}
    laws = {e: e.term() for e in catalogue if e.sign}
    there = [(e, terms[law.key]) for e, law in laws.items() if law and law.key in terms]
    return [Coefficient(term, called=effect.name) for effect, term in there]


def extended(model: Model, parts: Sequence[Part]) -> Model:
    """The model with the terms of the parts added; parts that are no terms are left out."""
    terms = {t.key: t for t in model.terms}
    values = model.coefficients
    for part in parts:
        for term, strength in zip(part.effect.laws(), part.strengths[0].tolist(), strict=False):
            terms[term.key] = terms.get(term.key, term)
            values[term.key] = values.get(term.key, 0.0) + strength
    return replace(model, terms=tuple(terms.values()), values=tuple(values[k] for k in terms))


@dataclass(frozen=True)
class Solution:
    """A hypothesis fitted."""

    parts: tuple[Part, ...]
    motions: tuple[Trajectory, ...]  # one for each record
    # Tuple of (n,) arrays: measured minus simulated, of each record, not whitened
    residuals: tuple[Array, ...]
    # Sum of squares of the whitened residuals, plus what the priors of the shapes cost
    chi_squared: float
    covariance: Array  # (n_values, n_values), of the values of all parts, in their order
    converged: bool
    # Whether the user stopped it (Ctrl-C): then it is what had been reached
    interrupted: bool = False

    @property
    def finite(self) -> bool:
        """Whether there is a motion at all."""
        return bool(np.isfinite(self.chi_squared))

    @property
    def n_values(self) -> int:
        """Number of fitted values, with q and q_dot at the start of each record."""
        return sum(p.size for p in self.parts) + sum(len(m.start) for m in self.motions)

    def slices(self) -> list[slice]:
        """Where the values of each part are."""
        ends = np.cumsum([0, *(p.size for p in self.parts)])
        return [slice(a, b) for a, b in itertools.pairwise(ends)]


def held_values(parts: Sequence[Part], fixed: bool, first: bool) -> NDArray[np.bool_]:
    """Values that stay: with no strength there is no telling a shape."""
    held: list[NDArray[np.bool_]] = [np.zeros(0, bool)]
    for p in parts:
        held.append(np.tile(fixed & p.shared, len(p.strengths)))
        held.append(np.full(p.shape.size, fixed or (first and not np.any(p.strengths))))
    return np.concatenate(held)


def limits(parts: Sequence[Part]) -> tuple[Array, Array]:
    """Least and largest changes of all values."""
    lows, highs = [np.zeros(0)], [np.zeros(0)]
    for part in parts:
        low, high = part.limits()
        lows.append(low - part.values)
        highs.append(high - part.values)
    return np.concatenate(lows), np.concatenate(highs)


def moved_parts(parts: tuple[Part, ...], change: Array) -> tuple[Part, ...]:
    moved, first = [], 0
    for part in parts:
        moved.append(part.moved(change[first : first + part.size]))
        first += part.size
    return tuple(moved)
