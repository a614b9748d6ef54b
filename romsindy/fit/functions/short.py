"""The few terms that follow the functions of an identification over the range of its data.

Coefficients of a series go together: leave one out, and the others are wrong. So a few terms are
fitted anew, to frequency, K(q)/q and h(q), then to the damping ratio, each weighed by what the data
leave open there. Draws of the functions are fitted in the same way, with the same terms and
weights: that is the band of each coefficient. The fewest terms that follow are taken; where no few
do, what can be said in short is the linear equation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from romsindy.fit.verdict import FOLLOWED, HARDLY
from romsindy.physics.damping import AmplitudeDamping, PositionDamping, PowerDamping
from romsindy.physics.inertia import Inertia
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.typing import Array

# Candidates: the linear term first, then others, of which so many at most are few.
_STIFFNESS: list[Term] = [Stiffness(i) for i in (1, 2, 3, 4, 5)]
_INERTIA: list[Term] = [Inertia(i) for i in (3, 4, 5)]
_DAMPING: list[Term] = [AmplitudeDamping(1), PositionDamping(2), PositionDamping(4)]
_MOST = 5
_TRIED = 3  # choices of each size that are looked at exactly
_PLACES = np.linspace(0.05, 0.95, 13)  # of the reach
# Errors that the weights count beside those of the functions, as a part of what a departure may be:
# to follow better than so serves nobody, and where there is no noise nothing else weighs.
_ENOUGH = 0.3
_CORRECTIONS = 2  # of the linearised frequency
_STEP = 1e-4  # of stiffness and inertia, for the slope of the frequency
_ROUNDING = 1e-9
_INSIDE = (2.5, 97.5)  # percentiles of a 95 % interval
_SIGMAS = 1.96


class Followed(NamedTuple):
    """How far a curve is off the one that it should follow, and how much that one changes."""

    off: float
    change: float


@dataclass(frozen=True, eq=False)
class Short:
    """An equation of few terms, or the linear one."""

    model: ReducedModel
    bands: dict[str, tuple[float, float]]  # 95 %, of each coefficient that was fitted, by its name
    follows: bool  # whether few terms follow the functions; else the model is linear
    # Of the few terms that come nearest, as parts of the largest frequency and damping ratio
    frequency: Followed
    damping: Followed
    amplitude: float  # up to which they were compared, unit of q


class _Target(NamedTuple):
    """A curve (m,) to be followed, draws of it (n_draws, m), and how far off one may be (m,)."""

    value: Array
    drawn: Array
    limit: Array

    @classmethod
    def of(cls, value: Array, drawn: Array, strict: bool) -> _Target:
        """Off by a tenth of its change, or its own error; ``strict``: if that hides the change."""
        error = _SIGMAS * np.std(drawn, axis=0)
        change = float(np.ptp(value))
        counts = not strict or change < HARDLY * float(error.max())
        least = _ROUNDING * float(np.abs(value).max()) + 1e-300
        return cls(value, drawn, np.maximum(max(FOLLOWED * change, least), error * counts))

    @property
    def weight(self) -> Array:
        """One over what is left open, (m,)."""
        return np.asarray(1 / np.hypot(np.std(self.drawn, axis=0), _ENOUGH * self.limit))


class _Chosen(NamedTuple):
    """Terms with their values (n,) and those of the draws (n_draws, n)."""

    terms: list[Term]
    values: Array
    drawn: Array
    off: float  # at most, over what it may be: up to 1 they follow


@dataclass(frozen=True, eq=False)
class _Shortening:
    """Terms whose sum should follow a curve: near ``base + table @ values``, and exactly `read`."""

    terms: list[Term]
    always: set[int]
    fixed: Mapping[str, float]
    target: _Target
    base: Array
    table: Array
    read: Callable[[Sequence[Term], Array], Array]

    def fewest(self) -> _Chosen:
        """The fewest terms that follow, or else those that come nearest."""
        others = [i for i in range(len(self.terms)) if i not in self.always]
        found: list[_Chosen] = []
        for size in range(min(_MOST, len(others)) + 1):
            choices = [sorted([*self.always, *more]) for more in combinations(others, size)]
            near = sorted(choices, key=lambda at: self._off(self._linear(at)))[:_TRIED]
            found += sorted(map(self._exact, near), key=lambda chosen: chosen.off)
            if found[-len(near)].off <= 1:
                return found[-len(near)]
        return min(found, key=lambda chosen: chosen.off)

    def _off(self, curve: Array) -> float:
        off = np.max(np.abs(curve - self.target.value) / self.target.limit)
        return float(off) if np.isfinite(off) else np.inf

    def _linear(self, at: list[int]) -> Array:
        return np.asarray(self.base + self.table[:, at] @ self._solved(at)[0])

    def _solved(self, at: list[int]) -> tuple[Array, Array]:
        """Values by weighted least squares, and their slopes by the curve, (n, m)."""
        known = np.array([self.fixed.get(self.terms[i].key, np.nan) for i in at])
        free, weight = np.isnan(known), self.target.weight
        table = self.table[:, at]
        size = np.linalg.norm(weight[:, None] * table, axis=0)
        slopes = np.zeros(table.T.shape)
        rows = np.linalg.pinv((weight[:, None] * table / size)[:, free])
        slopes[free] = rows * weight / size[free, None]
        values = np.where(free, 0.0, known)
        return values + slopes @ (self.target.value - self.base - table @ values), slopes

    def _exact(self, at: list[int]) -> _Chosen:
        terms = [self.terms[i] for i in at]
        values, slopes = self._solved(at)
        for _ in range(_CORRECTIONS):
            left = self.target.value - self.read(terms, values)
            values = values + slopes @ np.nan_to_num(left)
        drawn = values + (self.target.drawn - self.target.value) @ slopes.T
        return _Chosen(terms, values, drawn, self._off(self.read(terms, values)))


def shortened(
    model: ReducedModel,
    draws: Sequence[ReducedModel],
    reach: tuple[float, float],
    fixed: Mapping[str, float],
) -> Short:
    """Few terms that follow a model with as many as its functions need.

    ``draws`` may be true as well, ``reach`` is the least and the largest q of the data, ``fixed``
    coefficients are known.
    """
    a = _PLACES * min(map(abs, reach))
    q = np.concatenate([_PLACES[1::2] * end for end in reach])
    a = a[np.isfinite(model.backbone(a))]  # over a bump of the potential there is no motion
    frequency, damping, *functions = _targets(model, draws, a, q)
    undamped = _undamped(model, [frequency, *functions], a, q, reach, fixed).fewest()
    damped = _damped(model, damping, undamped, a, fixed).fewest()
    follows = max(undamped.off, damped.off) <= 1
    terms = (*undamped.terms, *damped.terms)
    values = (*undamped.values.tolist(), *damped.values.tolist())
    short = ReducedModel(terms, values, model.unit, model.amplitude_range)
    drawn = np.column_stack([undamped.drawn, damped.drawn])
    off, lost = _compared(short.frequency_and_damping(a), (frequency.value, damping.value))
    if not follows:
        short = _linear(model)
        drawn = np.array([[m.coefficients[t.key] for t in short.terms] for m in draws])
    low, high = np.percentile(drawn, _INSIDE, axis=0).tolist()
    ends = zip(short.terms, low, high, strict=True)
    bands = {t.key: (least, most) for t, least, most in ends if t.key not in fixed}
    return Short(short, bands, follows, off, lost, float(a[-1]))


def _compared(own: Array, values: Sequence[Array]) -> list[Followed]:
    """Frequency and damping ratio with those that they follow, over the largest of these."""
    return [
        Followed(float(np.max(np.abs(x - value)) / size), float(np.ptp(value)) / size)
        for x, value in zip(own, values, strict=True)
        for size in [float(np.abs(value).max())]
    ]


def _linear(model: ReducedModel) -> ReducedModel:
    """Its linear terms, and damping that no smooth function of q is."""
    kept = [(t, v) for t, v in zip(model.terms, model.values, strict=True) if _always(t)]
    terms, values = zip(*kept, strict=True)
    return ReducedModel(terms, values, model.unit, model.amplitude_range)


def _always(term: Term) -> bool:
    """Whether a term is in every short equation: the linear ones, and forces that the data need."""
    other = isinstance(term, PowerDamping) and term != PowerDamping(1)
    return term in (Stiffness(1), PowerDamping(1)) or other or not term.smooth


def _targets(
    model: ReducedModel, draws: Sequence[ReducedModel], a: Array, q: Array
) -> list[_Target]:
    """Frequency and damping ratio at amplitudes, K(q)/q and h(q), as far as the model has it."""

    def read(m: ReducedModel) -> Array:
        curves = [*m.frequency_and_damping(a), m.stiffness(q) / q, m.inertia(q) - 1]
        return np.concatenate(curves)

    drawn = np.array([read(m) for m in draws])
    drawn = drawn[np.all(np.isfinite(drawn), axis=1)]
    ends = np.cumsum([len(a), len(a), len(q)])
    pairs = zip(np.split(read(model), ends), np.split(drawn, ends, axis=1), strict=True)
    found = [_Target.of(*pair, strict=i == 0) for i, pair in enumerate(pairs)]
    return found if _INERTIA[0].key in model.coefficients else found[:-1]


def _undamped(
    model: ReducedModel,
    targets: Sequence[_Target],
    a: Array,
    q: Array,
    reach: tuple[float, float],
    fixed: Mapping[str, float],
) -> _Shortening:
    """Stiffness and inertia: linear in K(q)/q and h(q), and nearly so in the frequency."""
    terms = [t for t in [*_STIFFNESS, *_INERTIA] if t.key in model.coefficients]
    target = _Target(*(np.concatenate(x, axis=-1) for x in zip(*targets, strict=True)))
    everywhere = np.linspace(*reach, 101)

    def read(some: Sequence[Term], values: Array) -> Array:
        m = ReducedModel(tuple(some), tuple(values.tolist()))
        possible = np.all(m.inertia(everywhere) >= 1 - _ROUNDING)
        curves = [m.backbone(a), m.stiffness(q) / q, m.inertia(q) - 1][: len(targets)]
        return np.concatenate(curves) if possible else np.full(len(target.value), np.nan)

    unit = np.eye(len(terms))
    # Of the terms themselves: beside the 1 of an inertia, q^4 of a micrometre in m is rounded away.
    at_rest = np.zeros_like(q)
    functions = [
        np.concatenate([t.stiffness(q) / q + at_rest, t.inertia(q) + at_rest]) for t in terms
    ]
    table = np.zeros((len(target.value), len(terms)))
    table[len(a) :] = np.array(functions).T[: len(target.value) - len(a)]
    # About the model itself, as near as so many terms come to its functions.
    weighed = target.weight[len(a) :, None] * np.column_stack([table, target.value])[len(a) :]
    size = np.linalg.norm(weighed, axis=0)
    at = np.linalg.lstsq(weighed[:, :-1] / size[:-1], weighed[:, -1], rcond=None)[0] / size[:-1]
    steps = _STEP / np.abs(table[len(a) :]).max(axis=0)
    steps[[isinstance(t, Stiffness) for t in terms]] *= abs(at[0])

    def backbone(values: Array) -> Array:
        return ReducedModel(tuple(terms), tuple(values.tolist())).backbone(a)

    here = backbone(at)
    slopes = [(backbone(at + s * e) - here) / s for s, e in zip(steps, unit, strict=True)]
    table[: len(a)] = np.array(slopes).T
    base = np.zeros(len(target.value))
    base[: len(a)] = here - table[: len(a)] @ at
    always = {i for i, t in enumerate(terms) if i == 0 or t.key in fixed}
    return _Shortening(terms, always, fixed, target, base, table, read)


def _damped(
    model: ReducedModel, target: _Target, undamped: _Chosen, a: Array, fixed: Mapping[str, float]
) -> _Shortening:
    """Damping of an equation whose stiffness and inertia are known: linear in its ratio."""
    own = [t for t in model.terms if t.has("damping") and (_always(t) or t.key in fixed)]
    terms = own + [t for t in _DAMPING if t not in own]

    def read(some: Sequence[Term], values: Array) -> Array:
        together = (*undamped.terms, *some), (*undamped.values.tolist(), *values.tolist())
        return ReducedModel(*together).damping_ratio(a)

    table = np.stack([read([t], np.ones(1)) for t in terms], axis=1)
    known = {t.key: fixed[t.key] for t in terms if t.key in fixed}
    return _Shortening(terms, set(range(len(own))), known, target, np.zeros(len(a)), table, read)
