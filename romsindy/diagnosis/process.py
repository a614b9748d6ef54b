"""Decays: hypotheses by process noise, as much as the most likely of them needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.weighing import NO_FORM_ERROR, FormError, Weighed
from romsindy.fit.adequacy import Adequacy, examine
from romsindy.fit.gauss_newton import fit
from romsindy.fit.part import Part
from romsindy.fit.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

_CHECKS = 6  # iterations, to see what values that did not settle leave
_FURTHER = 40  # of a fit that others are held against


@dataclass(frozen=True)
class ProcessNoise:
    """The motion of a model may depart from the measured one; see `romsindy.fit.process_noise`.

    Attributes
    ----------
    known : FormError
        Of the model, as its reference record shows it.
    """

    known: FormError = NO_FORM_ERROR

    def fitted(
        self,
        model: ReducedModel,
        records: Sequence[Record],
        parts: Sequence[Part],
        n_unsure: int,
        n_free: int,
    ) -> Hypothesis:
        """Fit parts to all records; the first are unsure values, up to ``n_free`` no effects."""
        # One thread: the same sums in the same order, however many processes there are.
        with threadpool_limits(limits=1, user_api="blas"):
            solution = fit(model, parts, records)
            if solution.finite and not solution.converged:
                # A motion that does not yet satisfy its equation leaves too little.
                given = (solution.parts, records, solution.motions)
                solution = fit(model, *given, fixed=True, iterations=_CHECKS)
                solution = replace(solution, converged=False)
            return replace(Hypothesis.of(model, solution, n_free, records), n_unsure=n_unsure)

    def further(
        self, model: ReducedModel, records: Sequence[Record], hypothesis: Hypothesis
    ) -> Hypothesis:
        """Go on with a fit that has not come to its end; the same one where that is no better."""
        s = hypothesis.solution
        if s.converged or not s.finite:
            return hypothesis
        with threadpool_limits(limits=1, user_api="blas"):
            more = fit(model, s.parts, records, s.motions, iterations=_FURTHER)
            again = Hypothesis.of(model, more, hypothesis.n_free, records)
            return ProcessNoise().ranked([hypothesis, again])[0]

    def ranked(
        self, hypotheses: Sequence[Hypothesis], among: Sequence[Hypothesis] = ()
    ) -> list[Hypothesis]:
        """Best first, with the form error that is known, or as much more as one of them needs.

        It is the one that is most likely with departures of its own size.
        """
        if not hypotheses:
            return []
        each = [h.settled(self.known) for h in hypotheses]
        form = min(each, key=_own_score).noise
        return sorted((h.at(form) for h in hypotheses), key=lambda h: h.score)

    def alike(
        self, before: Hypothesis, after: Hypothesis, among: Sequence[Hypothesis] = ()
    ) -> tuple[Hypothesis, Hypothesis]:
        """Two by the same noise: structure that stays unexplained is as large by chance."""
        after = after.settled(self.known)
        return before.at(after.noise), after

    def examined(
        self,
        records: Sequence[Record],
        residuals: Sequence[Array],
        n_values: int,
        false_alarm: float,
    ) -> Adequacy:
        """What is left of records, to which so many values were fitted."""
        return examine(records, residuals, n_values, false_alarm)


def _own_score(hypothesis: Hypothesis) -> float:
    """Score at the form error that it needs itself: what repeats has the power of that."""
    weighed = hypothesis.weighed
    if not isinstance(weighed, Weighed):
        return np.inf
    plain, n = hypothesis.at(FormError(weighed.needed.jump)), weighed.n_functions
    # The other samples hold noise: what repeats cannot have more than the rest of the misfit.
    most = max((plain.misfit - (hypothesis.n_samples - n)) / n, 1.0)
    excess = min(weighed.excess(weighed.needed), most)
    return plain.score - n * (excess - 1 - float(np.log(excess)))
