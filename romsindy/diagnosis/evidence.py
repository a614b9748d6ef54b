"""Hypotheses on what is missing: fitted, weighed by one kind of noise, and compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from scipy.stats import chi2

from romsindy.diagnosis.unsure import allowed, largest_reading
from romsindy.diagnosis.weighing import NO_FORM_ERROR, FormError, Solved, Weighed, Worth
from romsindy.effects.base import ReadingEffect
from romsindy.fit.gauss_newton import Solution
from romsindy.fit.part import Part
from romsindy.fit.record import Record
from romsindy.fit.verdict import NAMED_ABOVE
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

# Standard deviations from which on a value that was known to a tolerance is worth a word: 5 %.
_FAR = 2.0


class Weighing(Protocol):
    """What a fit says of its values by noise of any size or colour, and which it asks for."""

    @property
    def needed(self) -> Any:
        """Noise that its own residual asks for."""

    def excess(self, noise: Any) -> float:
        """Structure left in the residual, over that of noise, at least 1."""

    def solved(self, solution: Solution, noise: Any) -> Solved:
        """The fit by noise of one kind: values, misfit and covariance."""


@dataclass(frozen=True)
class Hypothesis:
    """A fitted hypothesis and what it is worth, given how far its model may be from the truth.

    The first ``n_unsure`` parts are values that the simulation is unsure of, all up to ``n_free``
    by default; those after them are fitted whatever the hypothesis. ``noise`` is what separates a
    right model from the records: the `FormError` of decays, the `Colours` of driven records.
    Hypotheses are compared by the same noise: see `at` and `ProcessNoise`, `ColourOfBest`.
    """

    solution: Solution
    n_free: int
    n_samples: float
    weighed: Weighing | None  # None where there is no motion
    noise: Any = NO_FORM_ERROR
    tested: float = 0.0  # misfit on what took no part in the fit, beyond that of the best there
    reach: float = 0.0  # largest reading of all records
    unsaid: tuple[str, ...] = ()  # values that moved by less than matters
    n_unsure: int | None = None

    @classmethod
    def of(
        cls, model: ReducedModel, solution: Solution, n_free: int, records: Sequence[Record]
    ) -> Hypothesis:
        """Weigh a fit to decays; one that did not converge counts for what it reached."""
        weighed = Weighed.of(model, solution, records)
        n_samples, reach = sum(r.count for r in records), largest_reading(records)
        return cls(solution, n_free, n_samples, weighed, reach=reach)

    def at(self, noise: Any) -> Hypothesis:
        """The same by other noise."""
        return self if noise == self.noise else replace(self, noise=noise)

    def settled(self, known: FormError) -> Hypothesis:
        """The same with the form error that is known, or as much more as it needs."""
        return self.at(known if self.weighed is None else known.joined(self.needs))

    @property
    def needs(self) -> Any:
        """Noise that its own misfit asks for."""
        return FormError(np.inf, np.inf) if self.weighed is None else self.weighed.needed

    @property
    def excess(self) -> float:
        """Structure left in the residual, over that of noise, at least 1."""
        return np.inf if self.weighed is None else self.weighed.excess(self.noise)

    @property
    def misfit(self) -> float:
        """Minus twice the logarithm of the likelihood: without form error, the chi-square."""
        return self._worth.misfit

    @property
    def price(self) -> float:
        """Of all values."""
        return self._worth.price

    @property
    def moved(self) -> tuple[str, ...]:
        """Names of the unsure values that moved."""
        return self._worth.moved

    @property
    def parts(self) -> tuple[Part, ...]:
        """All parts, with the values that are best by this noise."""
        return self._worth.parts

    @property
    def covariance(self) -> Array:
        """Of the values of all parts, in their order."""
        return self._worth.covariance

    @property
    def score(self) -> float:
        """Misfit, here and on what took no part, plus price: the least is the best."""
        return self.misfit + self.price + self.tested

    @property
    def effects(self) -> tuple[Part, ...]:
        """Parts beside the unsure ones."""
        return self.parts[self.n_free :]

    @property
    def changed(self) -> tuple[int, ...]:
        """Which of the parts are values that moved."""
        changed = {*self.moved, *self.beyond}
        free = self.parts[: self.n_free]
        return tuple(i for i, p in enumerate(free) if p.effect.name in changed)

    @property
    def blamed(self) -> tuple[int, ...]:
        """Which of the parts are missing: effects, and values that moved where no force does.

        A force may take part of what a value does; what is wrong in a sensor leaves it as it is.
        Nothing is wrong in a sensor whose offset, gain and curvature are as they may be.
        """
        beside = range(self.n_free, len(self.parts))
        effects = tuple(i for i in beside if not self._as_it_may_be(i))
        if self.forced:
            return effects
        free = (i for i in self.changed if self.parts[i].effect.name not in self.unsaid)
        return (*effects, *free)

    @property
    def of_measurement(self) -> tuple[int, ...]:
        """Which of the parts are what a measurement may add, as far as it may."""
        return tuple(i for i in range(len(self.parts)) if self._as_it_may_be(i))

    def _as_it_may_be(self, index: int) -> bool:
        """Whether an effect is one of the measurement, not surely beyond what is known of it."""
        most = allowed(self.parts[index].effect, self.reach)
        return most > 0 and self.at_least(index) <= most

    def at_least(self, index: int) -> float:
        """How large a strength surely is, of one of the parts."""
        where = self.solution.slices()[index]
        error = float(np.sqrt(self.covariance[where, where][0, 0]))
        return float(np.abs(self.parts[index].strengths).max()) - NAMED_ABOVE * error

    @property
    def sureness(self) -> float:
        """Standard errors by which the least sure of the strengths that are blamed is off zero.

        An effect without any value, such as another course between samples, has none to ask; where
        a mass was at the start of a record says nothing about the mass.
        """
        found = [np.inf]
        for i in self.blamed:
            n = self.parts[i].effect.n_shared or self.parts[i].strengths.size
            if not n:
                continue
            where = self.solution.slices()[i]
            x, covariance = self.parts[i].values[:n], self.covariance[where, where][:n, :n]
            squared = float(x @ np.linalg.pinv(covariance, hermitian=True) @ x)
            found.append(max(squared, 0.0) ** 0.5)
        return min(found)

    @property
    def forced(self) -> bool:
        """Whether a force is among its effects, not only what is wrong in a sensor."""
        return any(not isinstance(p.effect, ReadingEffect) for p in self.effects)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is missing."""
        return tuple(self.parts[i].effect.name for i in self.blamed)

    @property
    def said(self) -> set[str]:
        """Names of all that is not as in the simulation."""
        return {p.effect.name for p in self.effects}.union(self.moved).difference(self.unsaid)

    @property
    def beyond(self) -> tuple[str, ...]:
        """Names of the values that moved by more than their tolerances let expect."""
        known = [(p.effect.name, p.tolerance, p.strengths) for p in self.parts[: self.n_free]]
        return tuple(n for n, s, x in known if s is not None and np.any(np.abs(x) > _FAR * s))

    @cached_property
    def _worth(self) -> Worth:
        if self.weighed is None:
            return Worth.of_none(self.solution)
        solved = self.weighed.solved(self.solution, self.noise)
        n_unsure = self.n_free if self.n_unsure is None else self.n_unsure
        return Worth.of(self.solution, solved, n_unsure, self.n_free, self.n_samples)


def pays(before: Hypothesis, after: Hypothesis, n_candidates: int, false_alarm: float) -> bool:
    """Whether it gains more than chance would to say more, over all that was looked at.

    One candidate of n is right with odds of 1/n beforehand, exp(-looks / 2) with looks = 2 log n,
    and chance has so many tries for each effect.
    """
    if after.weighed is None:  # it has no motion
        return False
    more = max(len(after.effects) - len(before.effects), 1)
    looks = 2 * float(np.log(max(n_candidates, 1)))
    gain, price = before.misfit - after.misfit, after.price - before.price
    n_values = _count(after) - _count(before)
    alarm = chi2.isf(false_alarm * np.exp(-looks / 2 * more), max(n_values, more))
    return bool(gain > alarm and gain > price + more * looks)


def _count(hypothesis: Hypothesis) -> int:
    """Values of the effects, and unsure ones that moved."""
    return sum(p.size for p in hypothesis.effects) + len(hypothesis.moved)


def weights(hypotheses: Sequence[Hypothesis]) -> Array:
    """Posterior probabilities among hypotheses, all alike beforehand."""
    scores = np.array([h.score for h in hypotheses])
    weight = np.exp(-0.5 * (scores - scores.min()))
    return weight / weight.sum()
