"""How a fit is weighed: how far its model may be off, and what it is worth.

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
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.drive import InputDistortion
from romsindy.fit.adequacy import examine_white
from romsindy.fit.gauss_newton import Solution, fit, limits, moved_parts
from romsindy.fit.normal_equations import NormalEquations
from romsindy.fit.part import Part, prior_cost
from romsindy.fit.process_noise import Departures, Marginal
from romsindy.fit.record import Record, scales
from romsindy.fit.verdict import RARER
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.typing import Array


class Solved(NamedTuple):
    """The normal equations of a fit, by noise of one kind, and what they say of its values."""

    system: NormalEquations
    misfit: float  # of the best values, their priors included
    parts: tuple[Part, ...]  # with these values
    covariance: Array


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
        system, misfit, parts, covariance = solved
        rise, price, moved = _price_of_unsure(system, solution.parts, n_unsure, n_samples)
        for part, where in list(zip(parts, solution.slices(), strict=True))[n_free:]:
            price += _price_of(part, covariance[where, where], n_samples)
        return cls(misfit + rise, price, moved, parts, covariance)

    @classmethod
    def of_none(cls, solution: Solution) -> Worth:
        """Of a fit that has no motion."""
        return cls(np.inf, 0.0, (), solution.parts, solution.covariance)


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
    """How far the motion of a model may be from a measured one.

    Attributes
    ----------
    jump : float
        Process noise: so much the frequency, relatively, and the damping ratio are off from one
        window of a few cycles to another.
    structure : float
        Rms of what repeats with the vibration beside that, such as wrong harmonics, in the largest
        amplitude of a record.
    """

    jump: float = 0.0
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

        Parameters
        ----------
        model : ReducedModel
        reference : Decay
        floor : float
            Least noise, as a part of the largest amplitude.

        Raises
        ------
        ValueError
            If the model has no motion near the record.
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
    """What a fit says of its values at any form error, and what form error it needs.

    Attributes
    ----------
    marginal : Marginal
    needed : FormError
    gain : float
        Power at the harmonics that a structure of one amplitude has, over that of noise.
    n_functions : int
        That what repeats with the vibration is made of.
    """

    marginal: Marginal
    needed: FormError
    gain: float
    n_functions: int

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
        return Solved(system, misfit, parts, _given(system.covariance()[:n, :n], parts))


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
