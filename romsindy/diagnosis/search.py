"""The search for what is missing: what it has, whatever the records, and what decides.

Effects are accepted one after another, as long as each gains more than chance would, and those that
others have made superfluous are dropped. What is looked at beside a hypothesis is said by
`DecaySearch` and `ResidualSearch`, how hypotheses are fitted and weighed by a noise model.

All candidates at once, by linear least squares about one motion.

The response of the measured motion to every candidate force is one column of a linear problem
whose rows are samples, weighted by their noise. What a candidate, or a pair, would gain is read off
its normal equations. Linear in everything, it takes about as long as one fit.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from time import monotonic
from typing import Any, Protocol

import numpy as np
from joblib import Parallel, delayed
from scipy.fft import next_fast_len

from romsindy.diagnosis.difference import Tolerance
from romsindy.diagnosis.evidence import Hypothesis, pays
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Parameter, Scales
from romsindy.effects.choices import family_of
from romsindy.effects.outside import HIGHEST, TONES, same_tone
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.hypothesis import NormalEquations
from romsindy.fit.kernel.linear_response import nodes, respond
from romsindy.fit.kernel.part import Coefficient, Part, Solution, columns_of, in_place, read
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.record import Record, scales
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel
from romsindy.record.signals import vertex
from romsindy.record.spectrum import Line
from romsindy.typing import Array, Indices

# Of a comb of lines: which may be its first harmonics, and combs to be tried.
_STRONGEST, _COMBS = 3, 2
# Points of a spectrum for each line of its own.
_FINE = 8


def strongest_tones(t: Array, x: Array, count: int, apart: float) -> list[float]:
    """Angular frequencies of the strongest lines of a tapered signal (n,), rad/s.

    The times are uniform; lines are ``apart`` by so many rad/s at least.
    """
    n = 8 * len(x)
    step = 2 * np.pi / (n * (t[1] - t[0]))
    power = np.abs(np.fft.rfft(x, n)) ** 2
    power[: 8 * 2] = power[-1] = 0.0  # two cycles a record at least
    found = []
    for _ in range(count):
        k = int(np.argmax(power))
        if not 0 < k < len(power) - 1 or power[k] <= 0:
            break
        top = vertex(*np.log(power[k - 1 : k + 2] + 1e-300))
        found.append(float(step * (k + np.clip(top, -1, 1))))
        width = max(int(apart / step), 16)
        power[max(k - width, 0) : k + width] = 0.0
    return found


def combs(lines: Sequence[Line], t: Array) -> tuple[tuple[float, int], ...]:
    """Lines that are harmonics of one frequency: that in rad/s, and the number of the highest.

    They may come from several records, none of which need show them all. Any of the strongest may
    be the first, second or third harmonic, whichever leaves fewest alone. Some are too weak to be
    seen, or lie beside a harmonic of the vibration: each comb is there up to the highest as well,
    and where no lines fit together, the strongest is the first or the second of one.
    """
    width = 1 / (t[-1] - t[0])  # Hz, of a line
    different: list[Line] = []
    for line in sorted(lines, key=lambda line: -line.rms):
        if all(abs(line.frequency - other.frequency) > 2 * width for other in different):
            different.append(line)
    found: dict[tuple[int, ...], tuple[float, int]] = {}
    for line, number in itertools.product(different[:_STRONGEST], (1, 2, 3)):
        first = line.frequency / number
        order = np.array([other.frequency / first for other in different])
        nearest = np.round(order)
        at = (np.abs(order - nearest) * first < (1 + nearest / number) * width) & (nearest > 0)
        at &= nearest <= HIGHEST
        if np.count_nonzero(at) > 1:
            members = tuple(map(int, np.flatnonzero(at)))
            found.setdefault(members, (2 * np.pi * first, int(nearest[at].max())))
    whole = [m for m in found if not any(set(m) < set(other) for other in found)]
    seen = [found[m] for m in sorted(whole, key=len, reverse=True)[:_COMBS]]
    alone = [2 * np.pi * different[0].frequency / k for k in (1, 2)] if different else []
    fastest = np.pi / (t[1] - t[0])
    guessed = [
        (first, min(HIGHEST, int(fastest / first)))
        for first in ([first for first, _ in seen] or alone)
    ]
    return tuple(dict.fromkeys((*seen, *(comb for comb in guessed if comb[1] > 1))))


def tuned(comb: tuple[float, int], signals: Sequence[tuple[Array, Array]]) -> tuple[float, int]:
    """A comb with the frequency, within a line's width, at which it holds most of some signals.

    Its highest harmonic must keep step over the whole of a record, or nothing of it is found.
    ``signals`` are uniform times (s) and values of each record, without its vibration.
    """
    first, highest = comb[0] / (2 * np.pi), comb[1]
    spans = [float(t[-1] - t[0]) for t, _ in signals]
    fine = 1 / (_FINE * highest * max(spans))
    tried = first + np.arange(-1 / min(spans), 1 / min(spans), fine)
    power = np.zeros(len(tried))
    for t, x in signals:
        n = next_fast_len(_FINE * len(x), real=True)
        spectrum = np.abs(np.fft.rfft(x * np.hanning(len(x)), n)) ** 2
        lines = np.fft.rfftfreq(n, t[1] - t[0])
        for k in range(1, highest + 1):
            power += np.interp(k * tried, lines, spectrum, right=0.0)
    return 2 * np.pi * float(tried[np.argmax(power)]), highest


# A line this close to the vibration itself beats with it slowly: it could imitate any effect.
_BEATS = 0.12


@dataclass(frozen=True)
class Screened:
    """One effect with its shape values, screened."""

    effect: Effect
    chi_squared: float  # what the linear problem leaves with it
    strengths: Array  # (n_sets, k)


@dataclass(frozen=True)
class Screening:
    """Normal equations of ``n_base`` always-free columns (first) and of candidates."""

    system: NormalEquations
    n_base: int
    candidates: tuple[tuple[Effect, Indices], ...]
    scales: Scales  # with the lines of the spectrum

    @property
    def base(self) -> float:
        """Sum of squares left with no candidate."""
        return self.left(0)

    def left(self, held: int) -> float:
        """Sum of squares left with no candidate, and the first ``held`` free columns left out."""
        return self.system.power - self.system.by_some(np.arange(held, self.n_base))[1]

    def singles(self, held: int = 0) -> list[Screened]:
        """Every candidate by itself, best first; the first ``held`` free columns stay out."""
        found = []
        always = np.arange(held, self.n_base)
        for effect, columns in self.candidates:
            x, gain = self.system.by_some(np.concatenate([always, columns]))
            own = x[len(always) :]
            if _reversed(effect, own):
                gain = self.system.power - self.left(held)
            found.append(_screened(effect, self.system.power - gain, own))
        return sorted(found, key=lambda s: s.chi_squared)

    def pairs(self, chosen: Sequence[Screened]) -> list[tuple[Screened, Screened]]:
        """Pairs of different effects among some candidates, best first."""
        where = dict(self.candidates)
        found = []
        for a, b in itertools.combinations([s.effect for s in chosen], 2):
            if a.name == b.name:
                continue
            x, gain = self.system.by_some(
                np.concatenate([np.arange(self.n_base), where[a], where[b]])
            )
            of_a, of_b = np.split(x[self.n_base :], [len(where[a])])
            if not (_reversed(a, of_a) or _reversed(b, of_b)):
                left = self.system.power - gain
                found.append((_screened(a, left, of_a), _screened(b, left, of_b)))
        return sorted(found, key=lambda pair: pair[0].chi_squared)


def _screened(effect: Effect, chi_squared: float, strengths: Array) -> Screened:
    return Screened(effect, chi_squared, strengths.reshape(-1, effect.n_strengths))


def _reversed(effect: Effect, strengths: Array) -> bool:
    """Whether an effect that must be positive is negative, and says no other start."""
    k = effect.n_strengths
    signed = strengths.reshape(-1, k)[:, : effect.n_shared or k]
    return bool(effect.sign and np.all(signed < 0) and not effect.start)


def screen(
    model: ReducedModel,
    parts: Sequence[Part],
    effects: Sequence[Effect],
    records: Sequence[Record],
    motions: Sequence[Trajectory] | None = None,
) -> Screening:
    """Screen effects as additions to a model with its parts (which stay free).

    The parts are the values now of what is unsure, and what was accepted already. Lines are found
    in what the parts leave. The equation is linearised about the motions, by default the smoothed
    measurement.
    """
    motions = motions or [r.motion for r in records]
    known = {tone for e in effects if isinstance(e, TONES) for tone in e.beside}
    lines = _with_tones(model, tuple(parts), records, motions, tuple(known))
    return screened(model, parts, effects, records, lines, motions)


def screened(
    model: Equations,
    parts: Sequence[Part],
    effects: Sequence[Effect],
    records: Sequence[Prepared],
    scales: Scales,
    motions: Sequence[Trajectory],
) -> Screening:
    """The same where the lines of the spectrum are known, or nothing is to be said of them."""
    parts = tuple(parts)
    n_parts, n_records = sum(p.size for p in parts), len(records)
    trials = [
        Part.of(e, scales, n_records, start)
        for effect in effects
        for e in effect.forms(scales)
        for start in itertools.product(*(p.starts for p in e.parameters(scales)))
    ]
    n_base = n_parts + 2 * model.n_coordinates * n_records
    ends = np.cumsum([n_base, *(trial.strengths.size for trial in trials)])
    columns = (np.arange(*pair) for pair in itertools.pairwise(ends))
    candidates = [(trial.effect, own) for trial, own in zip(trials, columns, strict=True)]
    system = NormalEquations(n_parts, n_records, int(ends[-1]) - n_base, model.n_coordinates)
    for i, record in enumerate(records):
        with np.errstate(all="ignore"):  # `finite` says whether they stay within reach of numbers
            where, rows = _rows(model, parts, trials, candidates, record, i, motions[i])
            at = np.concatenate([where[0], system.states_of(i), *where[1:]]).astype(int)
            system.add(at, rows)
    system.add_priors(parts)
    return Screening(system, n_base, tuple(candidates), scales)


def _rows(
    model: Equations,
    parts: tuple[Part, ...],
    trials: Sequence[Part],
    candidates: Sequence[tuple],
    record: Prepared,
    i: int,
    motion: Trajectory,
) -> tuple[list[Indices], Array]:
    """Places of the values that act in one record, and the columns of these, states and misfit."""
    at = nodes(motion)
    equation = equation_of(model, parts, i, record)
    own = equation.by_parameter(*at)
    forces = [equation.forces(t.effect, *at) for t in trials]
    response = respond(
        equation, motion, np.concatenate([own, *(f for f in forces if f is not None)])
    )
    m, change = len(own), record.in_orders(parts, response.samples)
    measured = record.in_orders(parts, partial(equation.sampled, motion))
    reading = record.read(parts, i, measured + change[..., 0])
    columns = reading.by_motion(change[..., 1:])
    states = columns[:, -2 * model.n_coordinates :]
    base = np.column_stack([columns[:, :m] + reading.by_value.T, states])
    blocks, next_force = [base], m
    where = [columns_of(parts, i)]
    for force, trial, (effect, at_columns) in zip(forces, trials, candidates, strict=True):
        k = effect.n_strengths
        block = np.zeros((len(record.signal), k))
        if force is not None:
            block += columns[:, next_force : next_force + k]
            next_force += k
        blocks.append(block + record.read((trial,), i, measured).by_value[:k].T)
        where.append(at_columns[k * i : k * i + k] if effect.per_record else at_columns)
    return where, record.whitened(np.column_stack([*blocks, record.signal - reading.shown]))


def _with_tones(
    model: ReducedModel,
    parts: tuple[Part, ...],
    records: Sequence[Record],
    motions: Sequence[Trajectory],
    known: tuple[float, ...],
) -> Scales:
    """The strongest lines: beside the harmonics, and in what the parts leave.

    Those at ``known`` frequencies, rad/s, are those of something else: they make no comb.
    """
    record, motion, own = records[0], motions[0], scales(records)
    rests = [(r.t, r.signal - r.spline(r.t)[0]) for r in records]
    rest = rests[0][1]
    equation = equation_of(model, parts, 0, record)
    change = respond(equation, motion).samples(record.derivative)[:, 0]
    shown = read(parts, 0, record.t, equation.sampled(motion, record.derivative))[0]
    left = record.signal - shown
    basis = change[:, 1:]
    left = left - change[:, 0]
    left = left - basis @ np.linalg.lstsq(basis, left, rcond=1e-10)[0]
    # The spline takes hum beside a harmonic with it, and leaves a flank of that line in the rest:
    # half a line away another is not the same.
    apart, half = 0.15 * own.omega, np.pi / float(record.t[-1])
    steady, fading = np.hanning(len(rest)), np.hanning(len(rest) // 2)[len(rest) // 4 :]
    tones: list[float] = []
    for x, window in ((rest, steady), (rest, fading), (left, steady), (left, fading)):
        for tone in strongest_tones(record.t, x[: len(window)] * window, 2, apart):
            beats = abs(tone / own.omega - 1) < _BEATS
            if not beats and all(abs(tone - other) > half for other in tones):
                tones.append(tone)
    lines = [
        line
        for r in records
        for line in r.noise.lines
        if not same_tone(2 * np.pi * line.frequency, known)
    ]
    shortest = min((r.t for r in records), key=lambda t: float(t[-1]))
    found = tuple(tuned(comb, rests) for comb in combs(lines, shortest))
    return own._replace(tones=tuple(tones), combs=found)


def part_of(screened: Screened, scales: Scales, n_records: int) -> Part:
    """A part to start a fit from."""
    effect = screened.effect
    start = [effect.value(p.name) for p in effect.parameters(scales)]
    part = Part.of(effect, scales, n_records, start)
    if effect.start:
        return part
    least = part.limits()[0][: part.strengths.size].reshape(part.strengths.shape)
    return replace(part, strengths=np.maximum(screened.strengths, least))


@dataclass(frozen=True)
class Options:
    """How to look for what is missing: see `romsindy.diagnosis.diagnose`."""

    catalogue: tuple[Effect, ...]
    false_alarm: float
    max_effects: int
    floor: float
    n_jobs: int
    progress: Callable[[str], None]
    tolerance: Tolerance = field(default_factory=Tolerance)
    until: float = np.inf  # s, on the clock of `time.monotonic`: then the best so far is told

    @property
    def over(self) -> bool:
        """Whether the time is up."""
        return monotonic() > self.until

    def tolerating(self, other: Tolerance) -> Options:
        """The same with the larger of two tolerances, of each kind."""
        return replace(self, tolerance=self.tolerance.or_more(other))


@dataclass(frozen=True)
class Request:
    """What is asked, and of which records: see `romsindy.diagnosis.diagnose`."""

    measured: Sequence[Any]
    held_out: Any  # a record that takes no part, or None
    free: Sequence[str | Effect]
    tolerances: Mapping[str, float]
    options: Options

    @property
    def everything(self) -> list[Any]:
        """All records, that which is held out last."""
        return [*self.measured, *([] if self.held_out is None else [self.held_out])]

    def tolerating(self, other: Tolerance) -> Request:
        """The same with the larger of two tolerances, of each kind."""
        return replace(self, options=self.options.tolerating(other))


@dataclass(frozen=True)
class Finding:
    """What a search found; its lists have the best first."""

    rivals: list[Hypothesis]  # what the data do not tell apart
    compared: list[Hypothesis]  # all that were fitted
    base: Hypothesis  # without any effect
    interrupted: bool = False


class NoiseModel(Protocol):
    """How hypotheses are fitted, and by which noise they are weighed: `ProcessNoise` of decays.

    Of driven records it is `NoiseOfBest`, by ``among``, all that were fitted.
    """

    def fitted(
        self,
        model: Any,
        records: Sequence[Any],
        parts: Sequence[Part],
        n_unsure: int,
        n_free: int,
        motions: Sequence[Trajectory] | None = None,
    ) -> Hypothesis:
        """Fit parts to all records; the first are unsure values, up to ``n_free`` no effects.

        It starts from the ``motions``: see `romsindy.fit.kernel.gauss_newton.fit`.
        """

    def further(self, model: Any, records: Sequence[Any], hypothesis: Hypothesis) -> Hypothesis:
        """Go on with a fit that has not come to its end."""

    def ranked(
        self, hypotheses: Sequence[Hypothesis], among: Sequence[Hypothesis]
    ) -> list[Hypothesis]:
        """Best first, all by the same noise."""

    def alike(
        self, before: Hypothesis, after: Hypothesis, among: Sequence[Hypothesis]
    ) -> tuple[Hypothesis, Hypothesis]:
        """Two by the same noise, to say whether one gains enough."""

    def examined(
        self, model: Any, records: Sequence[Any], solution: Solution, false_alarm: float
    ) -> Adequacy:
        """What a solution leaves of records."""


@dataclass(eq=False)
class Search(ABC):
    """Looks for effects that a model lacks in some records, and keeps what it has compared."""

    model: Any
    records: Sequence[Any]
    # Values that the simulation is unsure of, blamed only if nothing else is
    free: tuple[Part, ...]
    options: Options
    noise: NoiseModel
    beside: tuple[Part, ...] = ()  # fitted whatever the hypothesis, and never blamed
    # All that were fitted so far: it grows, and is what an interrupt leaves. Searches that are made
    # of one another share it.
    compared: list[Hypothesis] = field(default_factory=list)

    @abstractmethod
    def run(self) -> Finding:
        """Look for the best hypothesis; an interrupt keeps what was compared.

        Raises a ValueError if the model alone has no motion near the measured one.
        """

    @abstractmethod
    def enough(self, best: Hypothesis) -> bool:
        """Whether nothing more is to be looked for beside a hypothesis."""

    @abstractmethod
    def one_more(self, best: Hypothesis) -> list[Hypothesis]:
        """The same with one effect more, of those that may be missing: fitted, best first."""

    def unsure_as(self, hypothesis: Hypothesis) -> Search:
        """The same search, unsure of the values that are free in a hypothesis alone."""
        names = {p.effect.name for p in hypothesis.parts[: hypothesis.n_free]}
        return self.with_free([p for p in self.free if p.effect.name in names])

    def with_free(self, free: Sequence[Part]) -> Search:
        """The same search, unsure of these values."""
        return replace(self, free=tuple(free))

    def hypothesis(
        self, parts: Sequence[Part], motions: Sequence[Trajectory] | None = None
    ) -> Hypothesis:
        """Fit and weigh the unsure values together with some effects, from motions if given."""
        return self._fitted([parts], motions)[0]

    def fitted(
        self, trials: Sequence[Sequence[Part]], motions: Sequence[Trajectory] | None = None
    ) -> list[Hypothesis]:
        """Fit and weigh several, in parallel, until the time is up."""
        return [] if self.options.over else self._fitted(trials, motions)

    def _fitted(
        self, trials: Sequence[Sequence[Part]], motions: Sequence[Trajectory] | None
    ) -> list[Hypothesis]:
        for parts in trials:
            self.options.progress(" + ".join(p.effect.name for p in parts) or "nothing")
        first = (*self.free, *self.beside)
        # Functions of data alone go to other processes: a Search holds what cannot.
        given = (self.model, self.records)
        tasks = (
            delayed(self.noise.fitted)(
                *given, (*first, *parts), len(self.free), len(first), motions
            )
            for parts in trials
        )
        found = []
        for hypothesis in Parallel(self.options.n_jobs, return_as="generator")(tasks):
            found.append(hypothesis)
            self.compared.append(hypothesis)
            if self.options.over:
                break
        return found

    def further(self, several: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Go on with the fits that have not come to their end."""
        given = (self.model, self.records)
        tasks = (delayed(self.noise.further)(*given, h) for h in several)
        return list(Parallel(self.options.n_jobs)(tasks))

    def ranked(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Best first, all by the same noise."""
        return self.noise.ranked(hypotheses, self.compared)

    def remainder(self, hypothesis: Hypothesis) -> Adequacy:
        """What a hypothesis leaves."""
        return self.examined(self.records, hypothesis.solution)

    def examined(self, records: Sequence[Any], solution: Solution) -> Adequacy:
        """What a solution leaves of records."""
        return self.noise.examined(self.model, records, solution, self.options.false_alarm)

    def worth(self, before: Hypothesis, after: Hypothesis) -> bool:
        """Whether one says more than chance would, over all that was looked at."""
        both = self.noise.alike(before, after, self.compared)
        return pays(*both, len(self.options.catalogue), self.options.false_alarm)

    def grown(self, best: Hypothesis) -> tuple[Hypothesis, list[Hypothesis]]:
        """Accept effects one after another; the best, and all that were tried on the way."""
        seen: list[Hypothesis] = []
        most = self.options.max_effects
        while len(best.effects) < most and not (self.options.over or self.enough(best)):
            tried = self.one_more(best)
            seen += tried
            if not tried or not self.worth(best, tried[0]):
                break
            best = tried[0]
        return best, seen

    def pruned(
        self, best: Hypothesis, known: Sequence[Hypothesis] = ()
    ) -> tuple[Hypothesis, list[Hypothesis]]:
        """Drop effects that the others have made superfluous; what was tried as well.

        Where a value moves instead by more than matters no less is said: the likelier is taken.
        """
        seen: list[Hypothesis] = []
        while len(best.effects) > 1 and not self.options.over:
            fewer = self.without_one(best, [*seen, *known])
            seen += fewer
            if not fewer:
                break
            shortest = self.ranked(fewer)[0]
            less, first = len(shortest.names) < len(best.names), self.ranked([shortest, best])[0]
            if self.worth(shortest, best) if less else first is not shortest:
                break
            best = shortest
        return best, seen

    def without_one(self, best: Hypothesis, known: Sequence[Hypothesis] = ()) -> list[Hypothesis]:
        """What is left of a hypothesis without one of its effects, for each of them.

        They start from its motion, for a sensor may have shown another. The best of several fits:
        those that are known started elsewhere.
        """
        parts = best.effects
        fewer = [(*parts[:i], *parts[i + 1 :]) for i in range(len(parts))]
        found = []
        for fitted in self.unsure_as(best).fitted(fewer, best.solution.motions):
            names = [p.effect.name for p in fitted.effects]
            alike = [h for h in known if [p.effect.name for p in h.effects] == names]
            found.append(min([fitted, *alike], key=lambda h: h.at(best.noise).score))
        return found


def rivals_of(
    best: Hypothesis, compared: Sequence[Hypothesis], as_one: float = 0.0
) -> list[Hypothesis]:
    """Different hypotheses that the data do not tell apart from the best, itself first.

    Values that moved, and that leave less than ``as_one`` more of chi-square, do what one effect
    does, whatever they cost. Beside a force a value comes before any effect in its place that is no
    likelier, but for one of its family.
    """
    if not best.names:
        return [best]
    found = {frozenset(best.names): best}
    # One effect may stand for values that moved.
    instead = not best.effects or any(i < best.n_free for i in best.blamed)
    most = len(best.effects) + bool(instead)
    for h in compared:
        alike = family_of([(name,) for name in {*best.names} ^ {*h.names}])
        replaces = best.forced and len(h.effects) > len(best.effects) and not alike
        near = h.score - best.score < (0.0 if replaces else EQUIVALENT)
        near |= not h.effects and h.misfit - best.misfit < as_one
        more = h.said > best.said
        if near and not more and len(h.effects) <= most and h.names:
            found.setdefault(frozenset(h.names), h)
    return list(found.values())


def leaders(singles: Sequence[Screened], each: int = 1, by_variant: bool = False) -> list[Screened]:
    """The best few shapes of every effect, or of each of its variants; the best effect first."""
    found: dict[tuple[str, str], list[Screened]] = {}
    for s in singles:
        group = found.setdefault((s.effect.name, s.effect.variant if by_variant else ""), [])
        if len(group) < each:
            group.append(s)
    return [s for group in found.values() for s in group]


def with_textbook_exponent(part: Part) -> Part:
    """The same with its exponent held at that of the textbook."""
    return _at_exponent(part, lambda p: p.starts[0])


def with_whole_exponent(part: Part) -> Part:
    """The same with its exponent held at the next whole number."""
    return _at_exponent(part, lambda p: float(round(part.effect.value(p.name))))


def _at_exponent(part: Part, value: Callable[[Parameter], float]) -> Part:
    held = [
        replace(p, low=value(p), high=value(p)) if p.name == "exponent" else p
        for p in part.parameters
    ]
    if held == list(part.parameters):
        return part
    shape = np.clip(part.shape, [p.low for p in held], [p.high for p in held])
    return replace(part.shaped(shape), parameters=tuple(held))


# -- what is free under every hypothesis -----------------------------------------------------------


def smooth_model(model: ReducedModel, all_scales: Scales) -> ReducedModel:
    """Dry friction that the model has already must not jump."""
    if all(term.smooth for term in model.terms):
        return model
    return model.regularised(0.01 * all_scales.amplitude * all_scales.omega)


# What a model is unsure of, where nothing else is said.
LINEAR: Mapping[str, Effect] = {"omega^2": LinearFrequency(), "c_linear": Viscous()}


def unsure_parts(
    model: Equations,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    all_scales: Scales,
    n_records: int,
    known: Mapping[str, Effect] = LINEAR,
) -> tuple[Part, ...]:
    """Parts of the values that a simulation is unsure of, or knows to a tolerance.

    Effects that stand for linear values are ``known`` by the names of these.
    """
    unsure = [known[f] if isinstance(f, str) else f for f in free if f not in tolerances]
    parts = [Part.of(effect, all_scales, n_records) for effect in unsure]
    terms = {term.key: term for term in model.terms}
    for name, relative in tolerances.items():
        effect: Effect = known.get(name) or Coefficient(terms[name])
        part = Part.of(effect, all_scales, n_records)
        parts.append(replace(part, tolerance=relative * abs(model.coefficients[name])))
    return tuple(parts)


def sought_beside(
    unsure: Sequence[Part],
    model: Equations,
    catalogue: Sequence[Effect],
    tolerances: Mapping[str, float],
) -> tuple[Effect, ...]:
    """Effects that are not among the unsure values, and too much of a term of the model."""
    names = {p.effect.name for p in unsure}
    effects = [e for e in catalogue if e.name not in names]
    return (*effects, *(c for c in in_place(model, effects) if c.of.key not in tolerances))
