"""What explanations of forced vibrations are worth, all by the colour of the noise that is left.

Where the noise starts in a forced record is not known beforehand: what the best explanation leaves
stands for it. An autoregression makes that white, and the misfits of all others alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

from romsindy.diagnosis.evidence import Hypothesis, Worth, price_of, price_of_free
from romsindy.effects.drive import InputBetweenSamples, InputDelay, InputDistortion, InputLag
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.gauss_newton import Solution, fit, linear_table
from romsindy.fit.normal_equations import NormalEquations
from romsindy.fit.part import Part, columns_of, prior_cost
from romsindy.fit.verdict import RARER
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.record.autoregression import autoregression
from romsindy.typing import Array, Indices

_ITERATIONS = 40  # of a fit that others are held against
_CHECKS = 8  # to see what values that did not settle leave


@dataclass(frozen=True)
class Trial:
    """A fit that is to be weighed.

    The first ``n_judged`` parts are values that the simulation is unsure of; those up to ``n_free``
    are fitted whatever the hypothesis. ``rows`` are derivatives of the reading of each record and
    its misfit, over the noise, at the ``places`` of the values; none where no motion was found that
    satisfies its equation. ``ended`` says whether the values came to their end.
    """

    model: ReducedModel
    solution: Solution
    n_judged: int
    n_free: int
    places: tuple[Indices, ...] = ()
    rows: tuple[Array, ...] = ()
    ended: bool = False

    @classmethod
    def of(
        cls,
        model: ReducedModel,
        parts: Sequence[Part],
        n_judged: int,
        n_free: int,
        records: Sequence[ForcedRecord],
    ) -> Trial:
        """Fit the parts to all records; those that stand instead of inputs take their place."""
        given = driven_instead(model, parts)
        with threadpool_limits(limits=1, user_api="blas"):
            return cls(given, fit(given, parts, records), n_judged, n_free)._told(records)

    def further(self, records: Sequence[ForcedRecord]) -> Trial:
        """Go on with a fit that has not come to its end."""
        s = self.solution
        if self.ended or not s.finite:
            return self
        with threadpool_limits(limits=1, user_api="blas"):
            more = fit(self.model, s.parts, records, s.motions, iterations=_ITERATIONS)
            return replace(self, solution=more)._told(records)

    def _told(self, records: Sequence[ForcedRecord]) -> Trial:
        s, ended = self.solution, self.solution.converged
        if s.finite and not ended:
            # A motion that does not yet satisfy its equation leaves too little.
            s = fit(self.model, s.parts, records, s.motions, fixed=True, iterations=_CHECKS)
        if not s.converged:
            return replace(self, solution=s, ended=False, rows=())
        rows = []
        for i, (record, motion) in enumerate(zip(records, s.motions, strict=True)):
            rows.append(linear_table(self.model, s.parts, i, record, motion)[1])
            # A step further may lead astray where the motion is sensitive.
            rows[i][:, -1] = record.whitened(s.residuals[i])
        system = self._system(len(records))
        places = tuple(
            np.concatenate([columns_of(s.parts, i), system.states_of(i)])
            for i in range(len(records))
        )
        return replace(self, solution=s, ended=ended, rows=tuple(rows), places=places)

    def _system(self, n_records: int) -> NormalEquations:
        return NormalEquations(sum(p.size for p in self.solution.parts), n_records)

    def weighed(self, colours: Sequence[Colour]) -> ForcedHypothesis:
        """By noise of these colours."""
        s, n = self.solution, sum(len(e) for e in self.solution.residuals)
        if not self.rows:
            nothing = Worth(np.inf, 0.0, (), s.parts, s.covariance)
            return ForcedHypothesis(s, self.n_free, n, None, trial=self, worth=nothing)
        system, misfit = self._system(len(colours)), prior_cost(s.parts)
        for where, rows, colour in zip(self.places, self.rows, colours, strict=True):
            white = colour.whitened(rows)
            system.add(where, white)
            misfit += float(white[:, -1] @ white[:, -1])
        system.add_priors(s.parts)
        covariance = system.covariance()[: system.n_values, : system.n_values]
        rise, price, moved = price_of_free(system, s.parts, self.n_judged, n)
        for part, own in list(zip(s.parts, s.slices(), strict=True))[self.n_free :]:
            price += price_of(part, covariance[own, own], n)
            price += RARER * isinstance(part.effect, InputDistortion)
        worth = Worth(misfit + rise, price, moved, s.parts, covariance)
        return ForcedHypothesis(s, self.n_free, n, None, trial=self, worth=worth)


@dataclass(frozen=True)
class Colour:
    """Noise as an autoregression: its filter, and the standard deviation of what drives it."""

    filter: Array
    std: float

    @classmethod
    def of(cls, residual: Array) -> Colour:
        """That of what is left of a record, (n,)."""
        a = autoregression(residual - residual.mean())
        driven = lfilter(a, [1.0], residual - residual.mean())[len(a) :]
        return cls(a, float(np.std(driven)))

    def whitened(self, rows: Array) -> Array:
        """Rows (n, m), white and over the noise."""
        return lfilter(self.filter, [1.0], rows, axis=0) / self.std


@dataclass(frozen=True, kw_only=True)
class ForcedHypothesis(Hypothesis):
    """A hypothesis on forced vibrations: its worth is that by the noise of the best."""

    trial: Trial
    worth: Worth

    @property
    def _worth(self) -> Worth:
        return self.worth


def weighed(trials: Sequence[Trial]) -> list[ForcedHypothesis]:
    """All by what the one that fits best leaves of the records, the best first."""
    followed = [t for t in trials if t.rows]
    if not followed:
        return [t.weighed(()) for t in trials]
    nearest = min(followed, key=lambda t: t.solution.chi_squared)
    colours = [Colour.of(rows[:, -1]) for rows in nearest.rows]
    return sorted((t.weighed(colours) for t in trials), key=lambda h: h.score)


def driven_instead(model: ReducedModel, parts: Sequence[Part]) -> ReducedModel:
    """The model without the inputs that parts stand instead of, and with those that are others."""
    others = (InputDelay, InputLag, InputBetweenSamples)
    changed = [p.effect for p in parts if isinstance(p.effect, others)]
    instead: dict[str, Input | None] = {
        e.of.key: replace(e.of, delay=e.delay) if isinstance(e, InputBetweenSamples) else None
        for e in changed
    }
    pairs = zip(model.terms, model.values, strict=True)
    inputs = {t: v for t, v in pairs if t.key in instead}
    kept = {t: v for t, v in zip(model.terms, model.values, strict=True) if t not in inputs}
    for term, value in inputs.items():
        other = instead[term.key]
        if other is not None:
            kept[other] = value
    return replace(model, terms=tuple(kept), values=tuple(kept.values()))
