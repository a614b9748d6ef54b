"""The search for what is missing: what it has, whatever the records, and what decides.

Effects are accepted one after another, as long as each gains more than chance would, and those that
others have made superfluous are dropped. What is looked at beside a hypothesis is said by
`DecaySearch` and `ResidualSearch`, how hypotheses are fitted and weighed by a noise model.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import Any, Protocol

import numpy as np
from joblib import Parallel, delayed

from romsindy.diagnosis.difference import Tolerance
from romsindy.diagnosis.evidence import Hypothesis, pays
from romsindy.diagnosis.screening import Screened
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, Parameter, Scales
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.kernel.part import Coefficient, Part, Solution
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel


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
        self, model: Any, records: Sequence[Any], parts: Sequence[Part], n_unsure: int, n_free: int
    ) -> Hypothesis:
        """Fit parts to all records; the first are unsure values, up to ``n_free`` no effects."""

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

    def hypothesis(self, parts: Sequence[Part]) -> Hypothesis:
        """Fit and weigh the unsure values together with some effects."""
        return self._fitted([parts])[0]

    def fitted(self, trials: Sequence[Sequence[Part]]) -> list[Hypothesis]:
        """Fit and weigh several, in parallel, until the time is up."""
        return [] if self.options.over else self._fitted(trials)

    def _fitted(self, trials: Sequence[Sequence[Part]]) -> list[Hypothesis]:
        for parts in trials:
            self.options.progress(" + ".join(p.effect.name for p in parts) or "nothing")
        first = (*self.free, *self.beside)
        # Functions of data alone go to other processes: a Search holds what cannot.
        given = (self.model, self.records)
        tasks = (
            delayed(self.noise.fitted)(*given, (*first, *parts), len(self.free), len(first))
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

        The best of several fits: those that are known started elsewhere.
        """
        parts = best.effects
        fewer = [(*parts[:i], *parts[i + 1 :]) for i in range(len(parts))]
        found = []
        for fitted in self.unsure_as(best).fitted(fewer):
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
    likelier.
    """
    if not best.names:
        return [best]
    found = {frozenset(best.names): best}
    # One effect may stand for values that moved.
    instead = not best.effects or any(i < best.n_free for i in best.blamed)
    most = len(best.effects) + bool(instead)
    for h in compared:
        in_place = best.forced and len(h.effects) > len(best.effects)
        near = h.score - best.score < (0.0 if in_place else EQUIVALENT)
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


_LINEAR: Mapping[str, Effect] = {"omega^2": LinearFrequency(), "c_linear": Viscous()}


def unsure_parts(
    model: Equations,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    all_scales: Scales,
    n_records: int,
    known: Mapping[str, Effect] = _LINEAR,
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
