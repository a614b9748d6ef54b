"""What takes no part in a fit, and what hypotheses say of it.

Every fourth stretch of a few cycles of a decay is held out: what learns and what judges both see
large and small amplitudes, early and late times. The motion of a model goes through all of the
record in either case, so that its phase tells as much as before; samples that were made white are
independent, so that those left out tell nothing about the others.

A prediction multiplies the evidence by its own likelihood. The best of them sets the scale: what it
misses beyond the noise, others may miss by chance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from romsindy.diagnosis.decay_search import DecaySearch
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.gap import foretold, misfit_of
from romsindy.diagnosis.residual_search import ResidualSearch, driven_instead
from romsindy.diagnosis.search import Finding, rivals_of
from romsindy.effects.choices import family_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Part, Solution
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import AS_GOOD, AS_ONE, EQUIVALENT, GAINED, MATERIAL, PREDICTED, UNJUDGED
from romsindy.physics.equations import Equations
from romsindy.typing import Array

_EVERY = 4  # one stretch of so many
_LEAST, _MOST = 3, 8  # cycles of a stretch: two that are whole, and as in a window of adequacy
SHORTEST = 18  # cycles of a record that can spare two stretches


def parted(record: Record) -> tuple[Record, Record] | None:
    """What learns and what judges; None where the record is too short to spare anything."""
    first = record.cycles
    n = len(first) - 1
    if n < SHORTEST:
        return None
    length = int(np.clip(n // (2 * _EVERY), _LEAST, _MOST))
    judges = np.zeros(len(record.signal), bool)
    for start in range(length, n - length + 1, _EVERY * length):
        judges[first[start] : first[start + length]] = True
    return replace(record, part=~judges), replace(record, part=judges)


_ASKED = 6  # hypotheses that are asked


@dataclass(frozen=True)
class Validation:
    """Records that hypotheses are asked to predict, by name.

    ``exact`` is the simulation as it was. Records that are not ``unseen`` took part in the fits:
    they settle hypotheses, and have no further say.
    """

    search: DecaySearch
    exact: Hypothesis
    records: Mapping[str, Record]
    unseen: bool = True

    def _scale(self, least: float) -> float:
        """What the best leaves, over noise, by its chi-square: at least 1."""
        return max(1.0, least / self._count)

    @property
    def _count(self) -> float:
        return sum(record.count for record in self.records.values())

    def weighed(self, found: Finding) -> tuple[Finding, float]:
        """The same, ranked with the predictions of those that these decide about.

        Beside it, the chi-square of the best of them here.
        """
        most, form = len(found.rivals[0].effects), found.rivals[0].noise
        compared = [h for h in found.compared if len(h.effects) <= most]
        misfits: dict[int, float] = {}

        def beyond(i: int) -> float:
            asked = self.unseen and i in misfits
            return max((misfits[i] - self._count) / compared[i].excess, 0.0) if asked else 0.0

        while len(misfits) < _ASKED:
            scores = np.array([h.score + beyond(i) for i, h in enumerate(compared)])
            asked = {compared[i].names for i in misfits}
            near = np.flatnonzero(scores < scores.min() + EQUIVALENT)
            left = [int(i) for i in near if compared[i].names not in asked]
            if not left:
                break
            first = min(left, key=lambda i: scores[i])
            compared[first] = self.search.settled(compared[first]).at(form)
            misfits[first] = self._foretold(compared[first])
        least = min(misfits.values())
        if len(misfits) == 1 and any(h is compared[i] for h in found.compared for i in misfits):
            return found, least  # as the search left it
        tested = [self._tested(compared[i], x, least) for i, x in misfits.items()]
        others = [h for i, h in enumerate(compared) if i not in misfits]
        others += [h for h in found.compared if len(h.effects) > most]
        best = min(tested, key=lambda h: h.score)
        return self.search.finding(best, replace(found, compared=[*tested, *others])), least

    def useful(self, found: Finding, least: float) -> tuple[Finding, bool]:
        """The same, without effects that gain nothing here, or next to nothing of the gap.

        Beside it, whether these records are blind: they cannot tell what was found from less.
        ``least`` is the chi-square of the best of those that were asked.
        """
        best, scale = found.rivals[0], self._scale(least)
        left = self._left(best)
        whole = float(np.sum(self._left(self.exact) ** 2)) if len(best.effects) > 1 else 0.0
        while best.effects:
            fewer = self.search.without_one(best, [*found.compared, found.base])
            if not fewer:  # the budget has ended
                break
            fewer = [self.search.settled(h) for h in fewer]
            without = [self._left(h) for h in fewer]
            i = int(np.argmin([np.sum(x**2) for x in without]))
            misfit = float(np.sum(without[i] ** 2))
            gain, chance = misfit - np.sum(left**2), GAINED * best.excess * scale
            matters = max(MATERIAL**2 * whole, MATERIAL * self._count)
            little = gain < matters and misfit < PREDICTED**2 * self._count
            little &= self._explains(fewer[i]) or not self._explains(best)
            if gain > chance and not (fewer[i].effects and little):
                break
            if not fewer[i].effects and np.sum((self._left(best, bare=True) - left) ** 2) < chance:
                return self._with(found, best), True
            if fewer[i].misfit_elsewhere - best.misfit_elsewhere > EQUIVALENT:
                break  # other modes ask for it
            either = (fewer[i], best)
            values = [h.material if fewer[i].forced else h.moved + h.beyond for h in either]
            gone = {*best.names} - {*fewer[i].names}
            alike = gone and family_of([(name,) for name in (*gone, *values[0])])
            if alike or len(values[0]) > len(values[1]):
                # Values of the model in its place are another explanation, not a simpler one.
                apart = np.sum((without[i] - left) ** 2) > EQUIVALENT * best.excess * scale
                if not apart and fewer[i].at(best.noise).score - best.score > UNJUDGED:
                    break  # no one could tell here, and the fits do
                found = self.search.finding(best, found)
                other = self._tested(fewer[i], self._foretold(fewer[i]), least)
                return replace(found, rivals=[*found.rivals, other]), False
            best = self._tested(fewer[i], self._foretold(fewer[i]), least)
            left = without[i]
        return self._with(found, best), False

    def _explains(self, hypothesis: Hypothesis) -> bool:
        """Whether a hypothesis leaves noise of what was learned."""
        return self.search.remainder(hypothesis).explained

    def _with(self, found: Finding, best: Hypothesis) -> Finding:
        return found if best is found.rivals[0] else self.search.finding(best, found)

    def _left(self, hypothesis: Hypothesis, bare: bool = False) -> np.ndarray:
        """What a hypothesis leaves, or ``bare`` of its effects."""
        parts = hypothesis.parts[: hypothesis.n_free] if bare else None
        return misfit_of(self.search.model, hypothesis, self.records, parts)

    def _foretold(self, hypothesis: Hypothesis) -> float:
        return foretold(self.search.model, hypothesis, self.records)

    def _tested(self, hypothesis: Hypothesis, misfit: float, least: float) -> Hypothesis:
        beyond = (misfit - least) / self._scale(least) - AS_GOOD if self.unseen else 0.0
        return replace(hypothesis, tested=max(beyond, 0.0))


def left_of(model: Equations, parts: Sequence[Part], record: Prepared) -> Array:
    """Measured minus simulated (n,), of a model with parts; infinite where it has no motion."""
    return followed(model, parts, record).residuals[0]


def followed(model: Equations, parts: Sequence[Part], record: Prepared) -> Solution:
    """A model with parts in a record that took no part: of its values the start is fitted."""
    own = [p.elsewhere(record.t) for p in parts]
    return fit(driven_instead(model, own), own, [record], fixed=True)


def tested(search: ResidualSearch, found: Finding, record: Prepared | None) -> Finding:
    """The same finding, by what its hypotheses say of a record that took no part.

    Those that the fits do not tell apart are ranked with their predictions, and effects of the best
    that gain nothing there are dropped. It stays as it is where there is none, or no time.
    """
    if record is None or found.interrupted:
        return found

    def misfit(h: Hypothesis) -> float:
        return float(np.sum(record.whitened(left_of(search.model, h.parts, record)) ** 2))

    asked = {id(h): misfit(h) for h in found.rivals[:_ASKED]}
    least = min(asked.values())
    scale = max(1.0, least / record.count)  # what the best misses, others may miss by chance
    ranked = sorted(
        (
            replace(h, tested=max((asked[id(h)] - least) / scale - AS_GOOD, 0.0))
            for h in found.rivals[:_ASKED]
        ),
        key=lambda h: h.score,
    )
    best = ranked[0]
    near = [h for h in ranked if h.score - best.score < EQUIVALENT]
    left, needed = misfit(best), best
    while needed.effects:
        fewer = search.without_one(needed)
        if not fewer:  # the budget has ended
            break
        without = [misfit(h) for h in fewer]
        i = int(np.argmin(without))
        if without[i] - left > GAINED * scale:
            break
        needed, left = fewer[i], without[i]
    if needed is not best:
        return _with_best(search, found, needed)
    fitted = [h.solution for h in ranked]
    others = [h for h in found.compared if all(h.solution is not s for s in fitted)]
    compared = sorted([*ranked[1:], *others], key=lambda h: h.score)
    return replace(found, rivals=near, compared=[best, *compared])


def _with_best(search: ResidualSearch, found: Finding, best: Hypothesis) -> Finding:
    """The finding without what was better than another hypothesis, now the best."""
    every = search.ranked(search.compared)
    best = next(h for h in every if h.solution is best.solution)
    compared = [best, *(h for h in every if h is not best and h.score >= best.score)]
    base = next(h for h in every if h.solution is found.base.solution)
    return replace(found, rivals=rivals_of(best, compared, AS_ONE), compared=compared, base=base)
