"""What a hypothesis is worth: fit, less the price of its values.

The score of a hypothesis is minus twice the logarithm of its evidence, up to a constant: the
chi-square of the whitened residual, plus log n for every strength (as in the Bayesian information
criterion [1]), plus, for every shape value, how much the data narrow down its prior (Laplace's
method, [2]). Values that the simulation itself is unsure of stay at their nominal ones unless
freeing them pays. Whitening makes samples of correlated noise count for what they are worth.

[1] G. Schwarz, Annals of Statistics 6 (1978).  [2] D. MacKay, Neural Computation 4 (1992).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from romsindy.diagnosis.form import NO_FORM_ERROR, FormError, Weighed
from romsindy.diagnosis.nuisance import allowed, largest_reading
from romsindy.effects.base import ReadingEffect
from romsindy.fit.gauss_newton import Solution, limits, moved_parts
from romsindy.fit.normal_equations import NormalEquations
from romsindy.fit.part import Part, prior_cost
from romsindy.fit.record import Record
from romsindy.fit.verdict import NAMED_ABOVE
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

# Standard deviations from which on a value that was known to a tolerance is worth a word: 5 %.
_FAR = 2.0


@dataclass(frozen=True)
class Hypothesis:
    """A fitted hypothesis and what it is worth, given how far its model may be from the truth.

    The first ``n_free`` parts are the unsure ones. Hypotheses are compared at the same form error:
    see `at` and `ranked`.
    """

    solution: Solution
    n_free: int
    n_samples: float
    weighed: Weighed | None  # None where there is no motion
    form: FormError = NO_FORM_ERROR
    tested: float = 0.0  # misfit on what took no part in the fit, beyond that of the best there
    reach: float = 0.0  # largest reading of all records
    unsaid: tuple[str, ...] = ()  # values that moved by less than matters

    @classmethod
    def of(
        cls, model: ReducedModel, solution: Solution, n_free: int, records: Sequence[Record]
    ) -> Hypothesis:
        """Weigh a solution; one that did not converge still counts for what it reached."""
        weighed = Weighed.of(model, solution, records)
        n_samples, reach = sum(r.count for r in records), largest_reading(records)
        return cls(solution, n_free, n_samples, weighed, reach=reach)

    def at(self, form: FormError) -> Hypothesis:
        """The same with another form error."""
        return self if form == self.form else replace(self, form=form)

    def settled(self, known: FormError) -> Hypothesis:
        """The same with the form error that is known, or as much more as it needs."""
        return self.at(known if self.weighed is None else known.joined(self.needs))

    @property
    def needs(self) -> FormError:
        """Form error that its own misfit asks for."""
        return FormError(np.inf, np.inf) if self.weighed is None else self.weighed.needed

    @property
    def excess(self) -> float:
        """Structure left in the residual, over that of noise, at least 1."""
        return np.inf if self.weighed is None else self.weighed.excess(self.form)

    @property
    def misfit(self) -> float:
        """Minus twice the logarithm of the likelihood: without form error, the chi-square."""
        return self._worth.misfit

    @property
    def own(self) -> float:
        """Score at the form error that it needs itself: what repeats has the power of that."""
        if self.weighed is None:
            return np.inf
        plain, n = self.at(FormError(self.needs.jump)), self.weighed.n_functions
        # The other samples hold noise: what repeats cannot have more than the rest of the misfit.
        most = max((plain.misfit - (self.n_samples - n)) / n, 1.0)
        excess = min(self.weighed.excess(self.needs), most)
        return plain.score - n * (excess - 1 - float(np.log(excess)))

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
        """All parts, with the values that are best at this form error."""
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
    def innocent(self) -> tuple[int, ...]:
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
        solution, n = self.solution, len(self.solution.covariance)
        if self.weighed is None:
            return Worth(np.inf, 0.0, (), solution.parts, solution.covariance)
        marginal, jump = self.weighed.marginal, self.form.jump
        system, step = marginal.solve(jump, self.excess)
        if jump:
            parts, misfit = moved_parts(marginal.parts, step[:n]), marginal.cost(jump, self.excess)
        else:
            parts, known = solution.parts, prior_cost(solution.parts)
            misfit = (solution.chi_squared - known) / self.excess + known
        covariance = _given(system.covariance()[:n, :n], parts)
        rise, price, moved = price_of_free(system, solution.parts, self.n_free, self.n_samples)
        for part, where in list(zip(parts, solution.slices(), strict=True))[self.n_free :]:
            price += price_of(part, covariance[where, where], self.n_samples)
        return Worth(misfit + rise, price, moved, parts, covariance)


def _given(covariance: Array, parts: Sequence[Part]) -> Array:
    """Covariance of the values of parts where shape values that are held are known."""
    held: list[bool] = []
    for part in parts:
        held += [False] * part.strengths.size + [p.low == p.high for p in part.parameters]
    if not any(held):
        return covariance
    cross = covariance[:, held]
    known = covariance - cross @ np.linalg.pinv(cross[held], hermitian=True) @ cross.T
    known[held] = known[:, held] = 0.0
    return known


class Worth(NamedTuple):
    """What the score of a hypothesis is made of."""

    misfit: float
    price: float
    moved: tuple[str, ...]
    parts: tuple[Part, ...]
    covariance: Array


def price_of_free(
    system: NormalEquations, parts: Sequence[Part], n_free: int, n_samples: float
) -> tuple[float, float, tuple[str, ...]]:
    """Cheapest choice of which unsure values to free.

    Each costs log n, or the rise of the misfit when it is fixed: effects take its place as far as
    their limits let them. Returns rise, price and names.
    """
    first = np.cumsum([0, *(p.size for p in parts)])
    judged = [i for i in range(n_free) if parts[i].tolerance is None]
    names = [parts[i].effect.name for i in judged]
    low, high = limits(parts)
    choices = []
    for freed in itertools.product((False, True), repeat=len(judged)):
        for i, free in zip(judged, freed, strict=True):
            own = parts[i].limits() if free else (np.zeros(1), np.zeros(1))
            low[first[i]], high[first[i]] = (x[0] - parts[i].values[0] for x in own)
        there = system.bounded_step(np.zeros(0, bool), low, high)
        moved = tuple(n for n, f in zip(names, freed, strict=True) if f)
        choices.append((system.chi_squared(there), sum(freed) * float(np.log(n_samples)), moved))
    least = min(misfit for misfit, _, _ in choices)
    misfit, price, moved = min(choices, key=lambda c: c[0] + c[1])
    return misfit - least, price, moved


def price_of(part: Part, covariance: Array, n_samples: float) -> float:
    """Of the values of an effect, with their covariance."""
    k, sets = part.strengths.size, len(part.strengths)
    shared = int(np.sum(part.shared))
    price = shared * float(np.log(n_samples))
    price += (k - sets * shared) * float(np.log(n_samples / sets))
    return price + _price_of_shape(part, covariance[k:, k:])


def _price_of_shape(part: Part, covariance: Array) -> float:
    price = 0.0
    for p, variance in zip(part.parameters, np.diag(covariance), strict=True):
        prior = p.spread or (p.high - p.low) / np.sqrt(2 * np.pi)
        if p.low < p.high:  # one that is rounded to the textbook's costs nothing
            price += max(float(np.log(prior**2 / max(variance, 1e-300))), 0.0)
    return price


def ranked(hypotheses: Sequence[Hypothesis], known: FormError = NO_FORM_ERROR) -> list[Hypothesis]:
    """Best first, all with the form error that is known, or as much more as one of them needs.

    It is the one that is most likely with departures of its own size.
    """
    if not hypotheses:
        return []
    each = [h.settled(known) for h in hypotheses]
    form = min(each, key=lambda h: h.own).form
    return sorted((h.at(form) for h in hypotheses), key=lambda h: h.score)


def weights(hypotheses: Sequence[Hypothesis]) -> Array:
    """Posterior probabilities among hypotheses, all alike beforehand."""
    scores = np.array([h.score for h in hypotheses])
    weight = np.exp(-0.5 * (scores - scores.min()))
    return weight / weight.sum()
