"""Hypotheses on what is missing: fitted, weighed by one kind of noise, and compared.

Model-form error is what an equation leaves although nothing is missing but a better equation.

The score of a hypothesis is minus twice the logarithm of its evidence, up to a constant: the
chi-square of the whitened residual, plus log n for every strength (as in the Bayesian information
criterion [1]), plus, for every shape value, how much the data narrow down its prior (Laplace's
method, [2]). Values that the simulation itself is unsure of stay at their nominal ones unless
freeing them pays. Whitening makes samples of correlated noise count for what they are worth.

[1] G. Schwarz, Annals of Statistics 6 (1978).  [2] D. MacKay, Neural Computation 4 (1992).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.stats import chi2

from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect, ReadingEffect
from romsindy.effects.memory import MemoryEffect
from romsindy.effects.outside import Bias, Gain, InputDistortion, SensorNonlinearity
from romsindy.fit.adequacy.verdicts import examine_white
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.hypothesis import NormalEquations
from romsindy.fit.kernel.part import Part, Solution, limits, moved_parts, prior_cost
from romsindy.fit.process_noise import Departures, Marginal
from romsindy.fit.records.coupled import free_offsets
from romsindy.fit.records.record import Record, scales
from romsindy.fit.verdict import KNOWN_CURVATURE, KNOWN_GAIN, NAMED_ABOVE, RARER
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.typing import Array

# Standard deviations from which on a value that was known to a tolerance is beyond it: 5 %.
FAR = 2.0


class Solved(NamedTuple):
    """The normal equations of a fit, by noise of one kind, and what they say of its values."""

    system: NormalEquations
    misfit: float  # of the best values, their priors included
    parts: tuple[Part, ...]  # with these values
    covariance: Array
    about: tuple[Part, ...]  # values that the equations are linear about


class Worth(NamedTuple):
    """What the score of a hypothesis is made of."""

    misfit: float
    price: float
    moved: tuple[str, ...]
    parts: tuple[Part, ...]
    covariance: Array

    @classmethod
    def of(
        cls, solution: Solution, solved: Solved, n_unsure: int, n_free: int, n_samples: float
    ) -> Worth:
        """Of a fit whose first parts are unsure values, and up to ``n_free`` no effects."""
        system, misfit, parts, covariance, about = solved
        rise, price, moved = _price_of_unsure(system, about, n_unsure, n_samples)
        for part, where in list(zip(parts, solution.slices(), strict=True))[n_free:]:
            price += _price_of(part, covariance[where, where], n_samples)
        return cls(misfit + rise, price, moved, parts, covariance)


def _price_of_unsure(
    system: NormalEquations, parts: Sequence[Part], n_unsure: int, n_samples: float
) -> tuple[float, float, tuple[str, ...]]:
    """Cheapest choice of which unsure values to free.

    Each costs log n, or the rise of the misfit when it is fixed: effects take its place as far as
    their limits let them. Returns rise, price and names.
    """
    first = np.cumsum([0, *(p.size for p in parts)])
    unknown = [i for i in range(n_unsure) if parts[i].tolerance is None]
    names = [parts[i].effect.name for i in unknown]
    low, high = limits(parts)
    choices = []
    for freed in itertools.product((False, True), repeat=len(unknown)):
        for i, free in zip(unknown, freed, strict=True):
            own = parts[i].limits() if free else (np.zeros(1), np.zeros(1))
            low[first[i]], high[first[i]] = (x[0] - parts[i].values[0] for x in own)
        there = system.bounded_step(np.zeros(0, bool), low, high)
        moved = tuple(n for n, f in zip(names, freed, strict=True) if f)
        choices.append((system.chi_squared(there), sum(freed) * float(np.log(n_samples)), moved))
    least = min(misfit for misfit, _, _ in choices)
    misfit, price, moved = min(choices, key=lambda c: c[0] + c[1])
    return misfit - least, price, moved


def _price_of(part: Part, covariance: Array, n_samples: float) -> float:
    """Of the values of an effect, with their covariance."""
    k, sets = part.strengths.size, len(part.strengths)
    shared = int(np.sum(part.shared))
    price = shared * float(np.log(n_samples))
    price += (k - sets * shared) * float(np.log(n_samples / sets))
    price += RARER * isinstance(part.effect, InputDistortion)
    return price + _price_of_shape(part, covariance[k:, k:])


def _price_of_shape(part: Part, covariance: Array) -> float:
    price = 0.0
    for p, variance in zip(part.parameters, np.diag(covariance), strict=True):
        prior = p.spread or (p.high - p.low) / np.sqrt(2 * np.pi)
        if p.low < p.high:  # one that is rounded to the textbook's costs nothing
            price += max(float(np.log(prior**2 / max(variance, 1e-300))), 0.0)
    return price


@dataclass(frozen=True)
class FormError:
    """How far the motion of a model may be from a measured one."""

    # Process noise: so much the frequency, relatively, and the damping ratio are off from one
    # window of a few cycles to another
    jump: float = 0.0
    # Rms of what repeats with the vibration beside that, such as wrong harmonics, in the largest
    # amplitude of a record
    structure: float = 0.0

    def joined(self, other: FormError) -> FormError:
        """The larger of both, one by one."""
        return FormError(max(self.jump, other.jump), max(self.structure, other.structure))

    def times(self, factor: float) -> FormError:
        """So many times as large."""
        return FormError(factor * self.jump, factor * self.structure)

    def __le__(self, other: FormError) -> bool:
        """Whether it is within another one."""
        return self.joined(other) == other

    @classmethod
    def of(cls, model: ReducedModel, reference: Decay, floor: float) -> FormError:
        """What a model needs on the record that it was identified from.

        The ``floor`` is the least noise, as a part of the largest amplitude.

        Raises a ValueError if the model has no motion near the record.
        """
        records = [Record.loud(reference, floor)]
        parts = [Part.of(e, scales(records), 1) for e in (LinearFrequency(), Viscous())]
        weighed = Weighed.of(model, fit(model, parts, records), records)
        if weighed is None:
            raise ValueError(
                "the model has no motion near its reference: give the record that it was"
                " identified from, in the same unit"
            )
        return weighed.needed


NO_FORM_ERROR = FormError()


@dataclass(frozen=True)
class Weighed:
    """What a fit says of its values at any form error, and what form error it needs."""

    marginal: Marginal
    needed: FormError
    gain: float  # power at the harmonics that a structure of one amplitude has, over that of noise
    n_functions: int  # that what repeats with the vibration is made of

    @classmethod
    def of(
        cls, model: ReducedModel, solution: Solution, records: Sequence[Record]
    ) -> Weighed | None:
        """Weigh a fit; None where it has no motion."""
        if not solution.finite:
            return None
        free = Departures.of(model, solution.parts, records, solution.motions)
        if free is None:
            return None
        left = examine_white(records, free.left, solution.n_values)
        power = sum(r.count * (np.abs(r.signal).max() / r.noise.std) ** 2 for r in records)
        gain = power / max(left.n_functions, 1)
        structure = float(np.sqrt(max(left.structure - 1, 0.0) / gain))
        return cls(free.marginal, FormError(free.jump, structure), gain, left.n_functions)

    def excess(self, form: FormError) -> float:
        """Power at the harmonics over that of noise: 1 where nothing is wrong."""
        return 1 + self.gain * form.structure**2

    def solved(self, solution: Solution, form: FormError) -> Solved:
        """The fit at a form error: values, misfit and covariance."""
        jump, excess, n = form.jump, self.excess(form), len(solution.covariance)
        system, step = self.marginal.solve(jump, excess)
        if jump:
            parts = moved_parts(self.marginal.parts, step[:n])
            misfit = self.marginal.cost(jump, excess)
        else:
            parts, known = solution.parts, prior_cost(solution.parts)
            misfit = (solution.chi_squared - known) / excess + known
        covariance = _given(system.covariance()[:n, :n], parts)
        return Solved(system, misfit, parts, covariance, solution.parts)


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
class Amended:
    """What a fit says of its values, with what is known of them from elsewhere."""

    weighed: Any  # what it says by itself, a `Weighing`

    @property
    def needed(self) -> Any:
        return self.weighed.needed

    def excess(self, noise: Any) -> float:
        return float(self.weighed.excess(noise))

    def solved(self, solution: Solution, noise: Any) -> Solved:
        return self.amended(self.weighed.solved(solution, noise))

    def amended(self, found: Solved) -> Solved:
        """The same with what is known."""
        raise NotImplementedError


@dataclass(frozen=True)
class Hypothesis:
    """A fitted hypothesis and what it is worth, given how far its model may be from the truth.

    The first ``n_unsure`` parts are values that the simulation is unsure of, all up to ``n_free``
    by default; those after them are fitted whatever the hypothesis. ``noise`` is what separates a
    right model from the records: the `FormError` of decays, the `Noises` of others.
    Hypotheses are compared by the same noise: see `at` and `ProcessNoise`, `NoiseOfBest`.
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
    # Misfit of what other modes do, beyond that of the best there, by the names of effects
    elsewhere: Mapping[frozenset[str], float] = field(default_factory=dict)
    # Changes of unsure values, by name, from which on they matter beside a force
    matters: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls, model: ReducedModel, solution: Solution, n_free: int, records: Sequence[Record]
    ) -> Hypothesis:
        """Weigh a fit to decays; one that did not converge counts for what it reached."""
        weighed = Weighed.of(model, solution, records)
        n_samples, reach = sum(r.count for r in records), largest_reading(records)
        return cls(solution, n_free, n_samples, weighed, reach=reach)

    def again(
        self, model: ReducedModel, solution: Solution, records: Sequence[Record]
    ) -> Hypothesis:
        """The same, fitted further."""
        found = Hypothesis.of(model, solution, self.n_free, records)
        return replace(found, elsewhere=self.elsewhere, matters=self.matters)

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
        """Misfit, here, on what took no part and in other modes, plus price: the least is best."""
        return self.misfit + self.price + self.tested + self.misfit_elsewhere

    @property
    def misfit_elsewhere(self) -> float:
        """Misfit in other modes, see `said_elsewhere`."""
        return said_elsewhere(self.elsewhere, frozenset(p.effect.name for p in self.effects))

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
        """Which of the parts are missing: effects, and values that moved.

        A force may take part of what a value does: beside one a value must have moved by more than
        matters. What is wrong in a sensor leaves it as it is. Nothing is wrong in a sensor whose
        offset, gain and curvature are as they may be.
        """
        beside = range(self.n_free, len(self.parts))
        effects = tuple(i for i in beside if not self._as_it_may_be(i))
        free = {i: self.parts[i].effect.name for i in self.changed}
        if self.forced:
            return (*effects, *(i for i, name in free.items() if name in self.material))
        return (*effects, *(i for i, name in free.items() if name not in self.unsaid))

    @property
    def material(self) -> tuple[str, ...]:
        """Names of the unsure values that surely moved by more than matters."""
        names = [p.effect.name for p in self.parts[: self.n_free]]
        asked = [n for n in self.moved if n in self.matters]
        return tuple(n for n in asked if self.at_least(names.index(n)) > self.matters[n])

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

    def growth(self, ratio: float) -> float:
        """How its errors grow where what is left, so many times the noise, is above it."""
        return max(ratio, 1.0) if self.noise == NO_FORM_ERROR else 1.0

    @property
    def forced(self) -> bool:
        """Whether a force is among its effects, not only what is wrong in a sensor."""
        return any(not isinstance(p.effect, ReadingEffect) for p in self.effects)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is missing."""
        return tuple(self.parts[i].effect.name for i in self.blamed)

    @property
    def pliable(self) -> bool:
        """Whether it says so much that it takes the shape of laws which are on no list.

        That are three things that are missing, or a force that remembers and one thing more: such
        laws are fits of loops. Values that moved count as one.
        """
        missing = [p.effect for p in self.effects if p.effect.structural]
        said = len(missing) + any(i < self.n_free for i in self.blamed)
        return said > (1 if any(isinstance(e, MemoryEffect) for e in missing) else 2)

    @property
    def said(self) -> set[str]:
        """Names of all that is not as in the simulation."""
        values = {*self.moved, *self.beyond}
        return {p.effect.name for p in self.effects}.union(values).difference(self.unsaid)

    @property
    def beyond(self) -> tuple[str, ...]:
        """Names of the values that moved by more than their tolerances let expect."""
        known = [(p.effect.name, p.tolerance, p.strengths) for p in self.parts[: self.n_free]]
        return tuple(n for n, s, x in known if s is not None and np.any(np.abs(x) > FAR * s))

    @cached_property
    def _worth(self) -> Worth:
        if self.weighed is None:
            return Worth(np.inf, 0.0, (), self.solution.parts, self.solution.covariance)
        solved = self.weighed.solved(self.solution, self.noise)
        n_unsure = self.n_free if self.n_unsure is None else self.n_unsure
        return Worth.of(self.solution, solved, n_unsure, self.n_free, self.n_samples)


def said_elsewhere(known: Mapping[frozenset[str], float], names: frozenset[str]) -> float:
    """Misfit of effects in other modes; of those that are not known that of the likeliest part."""
    return known.get(names, min((m for of, m in known.items() if of <= names), default=0.0))


def pays(before: Hypothesis, after: Hypothesis, n_candidates: int, false_alarm: float) -> bool:
    """Whether it gains more than chance would to say more, over all that was looked at.

    One candidate of n is right with odds of 1/n beforehand, exp(-looks / 2) with looks = 2 log n,
    and chance has so many tries for each effect.
    """
    if after.weighed is None:  # it has no motion
        return False
    more = max(len(after.effects) - len(before.effects), 1)
    looks = 2 * float(np.log(max(n_candidates, 1)))
    then, now = (h.misfit + h.misfit_elsewhere for h in (before, after))
    gain, price = then - now, after.price - before.price
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


# -- what a measurement may add though it is right ----------------------------------------------


def allowed(effect: Effect, reach: float) -> float:
    """Strength up to which an effect is none: what a measurement up to ``reach`` may add."""
    if isinstance(effect, Bias):
        return np.inf
    if isinstance(effect, Gain):
        return KNOWN_GAIN
    if isinstance(effect, SensorNonlinearity) and effect.power == 2 and reach:
        return KNOWN_CURVATURE / reach
    return 0.0


def largest_reading(records: Sequence[Record]) -> float:
    """In any record, unit of what was measured."""
    return max(float(np.abs(r.signal).max()) for r in records)


def offsets(records: Sequence[Record]) -> Part:
    """The zero of the sensor in each record: free."""
    return replace(free_offsets(records), tolerance=largest_reading(records))


def nuisances(records: Sequence[Record]) -> tuple[Part, ...]:
    """What the measurement may add: an offset, and gain and curvature as far as they are known."""
    reach, found = largest_reading(records), [offsets(records)]
    for effect in (Gain(), SensorNonlinearity(2)):
        most = allowed(effect, reach)
        found.append(Part(effect, (), np.zeros((1, 1)), tolerance=most, most=most))
    return tuple(found)
