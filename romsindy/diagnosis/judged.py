"""Hypotheses weighed by what they predict of data that took no part in their fits.

A prediction multiplies the evidence by its own likelihood. The best of them sets the scale: what it
misses beyond the noise, others may miss by chance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.prediction import misfit_of
from romsindy.diagnosis.search import Finding, Search
from romsindy.fit.record import Record
from romsindy.fit.verdict import EQUIVALENT, GAINED

_MOST = 6  # hypotheses that are asked


@dataclass
class Judges:
    """Records that hypotheses are asked to predict, by name."""

    search: Search
    records: Mapping[str, Record]
    least: float = field(default=np.inf, init=False)  # chi-square of the best of those asked

    @property
    def scale(self) -> float:
        """What the best leaves, over noise: at least 1."""
        return max(1.0, self.least / self._count)

    @property
    def _count(self) -> float:
        return sum(record.count for record in self.records.values())

    def weighed(self, found: Finding) -> Finding:
        """The same, ranked with the predictions of those that these decide about."""
        most = len(found.rivals[0].effects)
        compared = [h for h in found.compared if len(h.effects) <= most]
        misfits: dict[int, float] = {}

        def beyond(i: int) -> float:
            far = (misfits[i] - self._count) / compared[i].excess if i in misfits else 0.0
            return max(far, 0.0)

        while len(misfits) < _MOST:
            scores = np.array([h.score + beyond(i) for i, h in enumerate(compared)])
            asked = {compared[i].names for i in misfits}
            near = np.flatnonzero(scores < scores.min() + EQUIVALENT)
            left = [i for i in near if compared[i].names not in asked]
            if not left:
                break
            first = min(left, key=lambda i: scores[i])
            compared[first] = self.search.settled(compared[first])
            misfits[first] = self._misfit(compared[first])
        self.least = min(misfits.values())
        if len(misfits) == 1 and any(h is compared[i] for h in found.compared for i in misfits):
            return found  # as the search left it
        tested = [self._tested(compared[i], x) for i, x in misfits.items()]
        others = [h for i, h in enumerate(compared) if i not in misfits]
        others += [h for h in found.compared if len(h.effects) > most]
        best = min(tested, key=lambda h: h.score)
        return self.search.finding(best, replace(found, compared=[*tested, *others]))

    def useful(self, found: Finding) -> Finding:
        """The same, without effects that gain nothing here."""
        best = found.rivals[0]
        misfit = best.tested * self.scale + self.least
        while best.effects:
            fewer = self.search.without_one(best, found.base)
            misfits = [self._misfit(h) for h in fewer]
            i = int(np.argmin(misfits))
            if misfits[i] - misfit > GAINED * best.excess * self.scale:
                break
            if len(fewer[i].moved) > len(best.moved):
                # Values of the model in its place are another explanation, not a simpler one.
                found = self.search.finding(best, found)
                return replace(found, rivals=[*found.rivals, self._tested(fewer[i], misfits[i])])
            best, misfit = self._tested(fewer[i], misfits[i]), misfits[i]
        return found if best is found.rivals[0] else self.search.finding(best, found)

    def _misfit(self, hypothesis: Hypothesis) -> float:
        return misfit_of(self.search.model, hypothesis, self.records)

    def _tested(self, hypothesis: Hypothesis, misfit: float) -> Hypothesis:
        return replace(hypothesis, tested=(misfit - self.least) / self.scale)
