"""What `identify` finds: functions with bands, the simplest equation, and what is determined.

The few terms that follow the functions of an identification over the range of its data.

Coefficients of a series go together: leave one out, and the others are wrong. So a few terms are
fitted anew, to frequency, K(q)/q and h(q), then to the damping ratio, each weighed by what the data
leave open there. Draws of the functions are fitted in the same way, with the same terms and
weights: that is the band of each coefficient. The fewest terms that follow are taken; where no few
do, what can be said in short is the linear equation.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from romsindy.fit.functions.series import ModelStructure
from romsindy.fit.process_noise import SIGMAS
from romsindy.fit.records.record import Record
from romsindy.fit.results.estimate import (
    Band,
    Curve,
    Estimate,
    Function,
    checked_coordinate,
    checked_range,
    inertia_of,
    secant_of,
)
from romsindy.fit.verdict import FOLLOWED, HARDLY, NEAR_ZERO
from romsindy.notebook import shown
from romsindy.orbits.curves import require_mode
from romsindy.physics.damping import AmplitudeDamping, PositionDamping, PowerDamping
from romsindy.physics.inertia import Inertia
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.physics.term_sum import content_of, json_text, term_of
from romsindy.physics.validation import array, finite, several, table, whole
from romsindy.text import TextTable, as_text, percent, with_band, with_error
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
        error = SIGMAS * np.std(drawn, axis=0)
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
    return model.with_terms((term, value) for term, value in model.pairs if _always(term))


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


class DampingSplit(NamedTuple):
    """How much of the damping is linear, and how much quadratic: c_linear and c_quadratic.

    Fitted with these two alone, beside the stiffness and inertia of the equation in short. Each has
    its value and the ends of its 95 % interval; beside them what the P-Q method reads off.
    """

    linear: tuple[float, float, float]  # 1/s
    quadratic: tuple[float, float, float]  # one over the unit of q
    explained: bool  # whether these two leave noise
    linear_by_p_q: tuple[float, float, float]
    quadratic_by_p_q: tuple[float, float, float]
    half_cycles: int  # that the P-Q method has

    def sentence(self, unit: str | None) -> str:
        """Both as fitted, with their intervals."""
        (one, ends), (other, more) = with_band(*self.linear), with_band(*self.quadratic)
        each = f"{one} ({ends}) 1/s linear, {other} ({more}) 1/{unit or '[q]'} quadratic"
        return f"Damping by these two alone: {each}{'' if self.explained else ', not explained'}."

    def table(self, unit: str | None) -> TextTable:
        """Both, by both ways."""
        head = ["", "linear [1/s]", "95 %", f"quadratic [1/{unit or '[q]'}]", "95 %"]
        fitted = [*with_band(*self.linear), *with_band(*self.quadratic)]
        read = [*with_band(*self.linear_by_p_q), *with_band(*self.quadratic_by_p_q)]
        rows = [head, ["fitted", *fitted], [f"P-Q, {self.half_cycles} half-cycles", *read]]
        note = "" if self.explained else "Damping is not these two alone: more than noise is left."
        return TextTable("Linear and quadratic damping", rows, note)


class LimitCycle(NamedTuple):
    """The amplitude at which the damping ratio, which falls with amplitude, is 0; 95 % interval.

    From larger ones the motion grows.
    """

    amplitude: float
    low: float
    high: float

    def sentence(self, unit: str | None) -> str:
        """That it is foretold, and where."""
        value, ends = with_band(self.amplitude, self.low, self.high)
        return (
            "The damping falls with amplitude: an unstable limit cycle is foretold at"
            f" {value} {unit or '[q]'} ({ends}), and from larger amplitudes the motion grows."
        )


_BAND_DRAWS = 100
_FEW = 0.1
_INSIDE = (2.5, 97.5)  # percentiles of a 95 % interval


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Estimate):
    """An identified equation of motion: functions with bands first, coefficients read off them.

    ``model`` is the equation of the simplest structure that predicts as well as any. Its terms are
    those of a series of high order: as a whole they are the functions, one by one most are not
    determined. The covariance is that of ``samples``.

    Attributes
    ----------
    structures : tuple of ModelStructure
        All that were compared, from the simplest on.
    structure : ModelStructure
        That of the model.
    terms : tuple of Term
        Of the richest structure, to which bands belong.
    samples : (n_samples, n_terms) array
        Their coefficients: half of them drawn from all structures by their evidence, half from
        the richest; 0 for terms that a structure has not.
    widest : (n, n_terms) array
        The same from the richest structure alone: limits of what the data do not ask for.
    reach : (float, float)
        Least and largest q of the data, unit of q.
    records : tuple of Record
        What was fitted; not saved.
    residuals : tuple of arrays
        Measured minus one simulation of each record by the equation, unit of the measured
        quantity; inf where it has no motion there. Not saved.
    damping : DampingSplit, optional
        How much of the damping is linear, how much quadratic, where that was asked.
    limit_cycle : LimitCycle, optional
        The unstable one that is foretold where the damping falls with amplitude, beyond the data.

    Examples
    --------
    >>> from romsindy import example_decay, identify
    >>> h = identify(example_decay(60, periods=10, samples=20)).inertia(1.0)
    >>> f"h(1 m) = {h.value[0]:.1f}, in a band {h.high[0] - h.low[0]:.1f} wide"
    'h(1 m) = 0.5, in a band 0.1 wide'
    """

    structures: tuple[ModelStructure, ...]
    structure: ModelStructure
    terms: tuple[Term, ...]
    samples: Array
    widest: Array
    reach: tuple[float, float]
    records: tuple[Record, ...] = ()
    residuals: tuple[Array, ...] = ()
    damping: DampingSplit | None = None
    limit_cycle: LimitCycle | None = None

    def _models_of(self, samples: Array) -> list[ReducedModel]:
        return [ReducedModel(self.terms, tuple(s), self.model.unit) for s in samples]

    def inertia(self, q: ArrayLike, coordinate: int = 1) -> Curve:
        """h(q), the inertia beside 1, within `reach` (unit of q).

        It is never negative, so that equal tails would leave out 0 always: the band starts there
        where 0 is hardly less likely than its middle. Where the data do not ask for inertia the
        band says how much of it they would allow.
        """
        h = inertia_of(checked_coordinate(coordinate, self.model))
        curve = self._drawn(q, h, self.samples)
        if any(s.equivalent and not s.sizes.inertia for s in self.structures):
            allowed = self._drawn(q, h, self.widest).high
            return replace(curve, low=0 * allowed, high=np.maximum(allowed, curve.high))
        return replace(curve, low=np.where(curve.low < NEAR_ZERO * curve.high, 0.0, curve.low))

    def stiffness(self, q: ArrayLike, coordinate: int = 1) -> Curve:
        """K(q) / q in 1/s^2, within `reach` (unit of q); omega^2 at q = 0."""
        checked_coordinate(coordinate, self.model)
        return self._drawn(q, self._secant, self.samples)

    def reach_of(self, coordinate: int = 1) -> tuple[float, float]:
        """`reach`: there is one coordinate."""
        checked_coordinate(coordinate, self.model)
        return self.reach

    def allowed_stiffness(self, q: ArrayLike) -> Curve:
        """K(q) / q as `stiffness`, from the richest structure alone: what the data would allow."""
        return self._drawn(q, self._secant, self.widest)

    @property
    def _secant(self) -> Function:
        return secant_of(1, max(map(abs, self.reach)))

    def _drawn(self, q: ArrayLike, function: Function, samples: Array) -> Curve:
        """With the shortest interval of the draws as its band: a sum of what each term adds."""
        q = checked_range(q, self.reach, self.model.unit)
        sizes = np.maximum(np.abs(samples).max(axis=0), np.finfo(float).tiny)
        each = np.array([function(m, q) for m in self._models_of(np.diag(sizes))])
        return Curve(q, function(self.model, q), *_shortest(samples / sizes @ each))

    def draws(self) -> tuple[ReducedModel, tuple[str, ...], Array]:
        """As those of an `Estimate`, of all terms: the samples, which no covariance says."""
        one, known = self.single_model, self.model.coefficients
        names = tuple(t.key for t in self.terms)
        values = tuple(known.get(name, 0.0) for name in names)
        return replace(one, terms=self.terms, values=values), names, self.samples - np.array(values)

    def band(self, amplitudes: ArrayLike, mode: int = 1) -> Band:
        """Backbone and damping ratio with their standard errors, over all that the data allow.

        Parameters
        ----------
        amplitudes : (n,) array
            Half peak to peak, positive, unit of q.
        mode : int
            The only one is 1.
        """
        require_mode(mode, self.model)
        a = np.atleast_1d(np.asarray(amplitudes, float))
        curves = np.array([m.frequency_and_damping(a) for m in self._some])
        # Where hardly a draw has no orbit, the others tell.
        few = np.mean(np.isnan(curves), axis=0) < _FEW
        (omega, zeta), (omega_std, zeta_std) = (
            np.where(few, f(np.where(few, curves, 0.0), axis=0), np.nan)
            for f in (np.nanmean, np.nanstd)
        )
        return Band(a, omega, zeta, omega_std, zeta_std, self.model.unit)

    def interval(self, name: str) -> tuple[float, float]:
        """95 % interval of a coefficient, such as "Upsilon_3".

        Raises
        ------
        ValueError
            If there is no such coefficient.
        """
        names = [term.key for term in self.terms]
        if name not in names:
            raise ValueError(f"name = {name!r} is no coefficient: there are {', '.join(names)}")
        low, high = np.percentile(self.samples[:, names.index(name)], _INSIDE)
        return float(low), float(high)

    def _repr_html_(self) -> str:
        sentences = [f"Of the equation: {self.off()}.", *self.ends(), *self.conclusions()]
        return shown(self.short.model.formulas(), [self.coefficients()], sentences)

    def __repr__(self) -> str:
        return f"<Identification: {self.structure}, adequacy {self.adequacy:.3f}>"

    # -- text ---------------------------------------------------------------------------------

    def __str__(self) -> str:
        return "\n".join([*self.opening(), *map(as_text, self.tables()), *self.conclusions()])

    def opening(self) -> list[str]:
        """Structure, what is not told apart from it, and the short equation, a line each."""
        return [
            f"{self.structure}: (1 + h(q)) q_ddot + h'(q)/2 q_dot^2 + D(q) q_dot + K(q) = 0"
            f"    (q in {self.model.unit or '[q]'}, t in s)",
            self._others(),
            *self.in_short(),
        ]

    def in_short(self) -> list[str]:
        """The equation of few terms and how well it follows, or the linear one and why."""
        equation, off = self.short.model.equation(), self.off()
        if self.short.follows:
            return [f"In short: {equation}", f"  ({off})"]
        return [f"{off[0].upper()}{off[1:]}.", f"For small amplitudes: {equation}"]

    def tables(self) -> list[TextTable]:
        """Functions with their bands, frequency and damping ratio, Taylor coefficients."""
        return [
            TextTable(
                "Functions with their 95 % bands",
                self._functions_table(),
                "Bands hold at each q, for an equation of one coordinate.",
            ),
            TextTable(
                "Undamped frequency, and damping ratio, +- one standard error",
                self._amplitude_table(),
                "Damping ratio: energy lost in a cycle / 2 pi a dE/da.",
            ),
            self.coefficients(),
            *([] if self.damping is None else [self.damping.table(self.model.unit)]),
        ]

    def conclusions(self) -> list[str]:
        """Whether the data are explained, and what of the functions they determine."""
        return [str(self.verdict), *(f"{note[0].upper()}{note[1:]}." for note in self.notes)]

    def ends(self) -> list[str]:
        """Structure, then frequency and damping ratio at a small and at a large amplitude."""
        unit = self.model.unit or "[q]"
        each = [
            f"{' +- '.join(with_error(f, df))} Hz and {' +- '.join(with_error(z, dz))} % at"
            f" {size:.3g} {unit}"
            if np.isfinite(f)
            else f"no motion at {size:.3g} {unit}"
            for size, f, df, z, dz in self._along(0.1, 0.95)
        ]
        more = [p.sentence(self.model.unit) for p in (self.damping, self.limit_cycle) if p]
        return [f"{self.structure}.", f"Frequency and damping ratio: {', '.join(each)}.", *more]

    def _others(self) -> str:
        equal = [str(s) for s in self.structures if s.equivalent and s is not self.structure]
        if not equal:
            return "No other structure that was compared predicts as well."
        return f"The simplest that predicts as well as any; not told apart: {'; '.join(equal)}."

    def _functions_table(self) -> list[list[str]]:
        least, largest = self.reach
        q = np.concatenate([least * np.array([0.95, 0.75, 0.5, 0.25]), [0.0]])
        q = np.concatenate([q, largest * np.array([0.25, 0.5, 0.75, 0.95])])
        h, k = self.inertia(q), self.stiffness(q)
        rows = [["q", "h(q)", "95 %", "K(q)/q [1/s^2]", "95 %"]]
        for i, x in enumerate(q):
            cells = [with_band(c.value[i], c.low[i], c.high[i]) for c in (h, k)]
            rows.append([f"{x:.4g}", *cells[0], *cells[1]])
        return rows

    def _amplitude_table(self) -> list[list[str]]:
        rows = [["amplitude", "frequency [Hz]", "+-", "damping ratio [%]", "+-"]]
        for x, f, df, z, dz in self._along(0.1, 0.25, 0.5, 0.75, 0.95):
            rows.append([f"{x:.4g}", *with_error(f, df), *with_error(z, dz)])
        return rows

    def _along(self, *parts: float) -> list[list[float]]:
        """Amplitudes, as parts of the largest; frequency, Hz, and damping ratio, %, with errors."""
        band = self.band(min(map(abs, self.reach)) * np.array(parts))
        frequency = np.stack([band.frequency, band.frequency_std]) / (2 * np.pi)
        ratio = 100 * np.stack([band.damping_ratio, band.damping_ratio_std])
        return np.column_stack([band.amplitude, *frequency, *ratio]).tolist()

    @cached_property
    def short(self) -> Short:
        """The few terms that follow the functions, or the linear equation."""
        model = self.single_model
        fixed = {k: v for k, v in model.coefficients.items() if k not in self.free}
        return shortened(model, self._some, self.reach, fixed)

    @property
    def _some(self) -> list[ReducedModel]:
        """Some of the draws, for what takes long of each."""
        return self._models_of(self.samples[:: max(len(self.samples) // _BAND_DRAWS, 1)])

    def off(self) -> str:
        """How far the few terms are off the functions, beside how much these change."""
        short = self.short
        reach = f"up to {short.amplitude:.3g} {self.model.unit or '[q]'}"
        curves = zip(("frequency", "damping ratio"), (short.frequency, short.damping), strict=True)
        each = " and ".join(
            f"{percent(c.off)} in {name}, of a change of {percent(c.change)}" for name, c in curves
        )
        if short.follows:
            return f"{reach} off the functions by at most {each}"
        if not np.isfinite(short.frequency.off):
            return f"no few terms follow the functions {reach}: read their table"
        return (
            f"no few terms follow the functions {reach}, read their table: the nearest are off by"
            f" up to {each}"
        )

    def coefficients(self) -> TextTable:
        """Those of the short equation, with their 95 % bands."""
        rows = [["coefficient", "value", "95 %", "unit"]]
        short = self.short
        for term, value in short.model.pairs:
            low, high = short.bands.get(term.key, (value, value))
            known = [f"{value:.6g}", "(fixed)"]
            number = with_band(value, low, high) if term.key in short.bands else known
            rows.append([term.key, *number, term.unit(self.model.unit)])
        note = "Fitted to the functions over the range, as is every draw behind the bands."
        return TextTable(
            "Coefficients of the equation " + ("in short" if short.follows else "of small motions"),
            rows,
            note if short.follows else "",
        )

    # -- JSON ---------------------------------------------------------------------------------

    def to_json(self) -> str:
        """JSON text of the `Estimate`, with structures, terms and samples."""
        content = json.loads(super().to_json()) | {
            "structures": [asdict(s) for s in self.structures],
            "structure": self.structures.index(self.structure),
            "richest": [content_of(t) for t in self.terms],
            "samples": self.samples,
            "widest": self.widest,
            "reach": self.reach,
        }
        for name in ("damping", "limit_cycle"):
            if (part := getattr(self, name)) is not None:
                content[name] = part._asdict()
        return json_text(content)

    @classmethod
    def from_json(cls, text: str) -> Identification:
        """Read what `to_json` wrote.

        Raises
        ------
        ValueError
            As `Estimate.from_json`, or if it is an estimate of another kind.
        """
        base = Estimate.from_json(text)
        content: dict[str, Any] = json.loads(text)
        missing = {"structures", "structure", "richest", "samples", "widest", "reach"} - set(
            content
        )
        if missing:
            raise ValueError(
                f"the JSON text holds no {', '.join(sorted(missing))}: write it again with identify"
                " --save (in Python, what Fit.save wrote is read by Estimate.load)"
            )
        structures = several(ModelStructure.from_content)("structures", content["structures"])
        chosen = whole("structure", content["structure"])
        if not 0 <= chosen < len(structures):
            raise ValueError(
                f"structure = {chosen} is none of the {len(structures)} structures: give the number"
                " of one, from 0 on"
            )
        terms = several(term_of)("richest", content["richest"])
        return cls(
            **vars(base),
            structures=structures,
            structure=structures[chosen],
            terms=terms,
            samples=_draws("samples", content["samples"], len(terms)),
            widest=_draws("widest", content["widest"], len(terms)),
            reach=_reach(content["reach"]),
            damping=_split(content["damping"]) if "damping" in content else None,
            limit_cycle=_cycle(content["limit_cycle"]) if "limit_cycle" in content else None,
        )


def _draws(name: str, value: Any, n_terms: int) -> Array:
    draws = array(name, value)
    if draws.ndim != 2 or draws.shape[1] != n_terms or not np.all(np.isfinite(draws)):
        raise ValueError(
            f"{name} has the shape {draws.shape}: give rows of {n_terms} finite numbers, one for"
            " each term of richest"
        )
    return draws


def _split(value: Any) -> DampingSplit:
    given = table("damping", value)
    if {*given} != {*DampingSplit._fields}:
        raise ValueError(f"damping holds {sorted(given)}: give {sorted(DampingSplit._fields)}")
    several_of = {n: several(finite)(n, x) for n, x in given.items() if isinstance(x, list)}
    if any(len(x) != 3 for x in several_of.values()):
        raise ValueError("damping has values that are not three numbers: value, low and high")
    return DampingSplit(**{**given, **several_of})


def _cycle(value: Any) -> LimitCycle:
    given = table("limit_cycle", value)
    if {*given} != {*LimitCycle._fields}:
        raise ValueError(f"limit_cycle holds {sorted(given)}: give {sorted(LimitCycle._fields)}")
    return LimitCycle(**{name: finite(name, x) for name, x in given.items()})


def _reach(value: Any) -> tuple[float, float]:
    ends = several(finite)("reach", value)
    if len(ends) != 2 or not ends[0] < 0 < ends[1]:
        raise ValueError(f"reach = {list(ends)!r:.60} must be two numbers, below and above 0")
    return float(ends[0]), float(ends[1])


def _shortest(values: Array) -> tuple[Array, Array]:
    """Ends of the shortest intervals that hold 95 % of the draws (n_draws, n), (n,) each."""
    ordered = np.sort(values, axis=0)
    kept = int(np.ceil(0.95 * len(values)))
    widths = ordered[kept - 1 :] - ordered[: len(values) - kept + 1]
    first, column = np.argmin(widths, axis=0), np.arange(values.shape[1])
    return ordered[first, column], ordered[first + kept - 1, column]
