"""Which further measurement would tell apart what the data so far do not.

Every candidate test is simulated under each rival in turn, and each other rival is fitted to it
within what the data so far allow. What it cannot follow decides: half of that misfit, over the
noise, is the expected logarithm of the odds against it [1]. First all is linearised about the
motion of the rival that is taken for the truth; a test that would tell is then tried by fits.

[1] G. Box, W. Hill, Technometrics 9 (1967), "Discrimination among mechanistic models".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from romsindy.diagnosis.evidence import Hypothesis, weights
from romsindy.diagnosis.experiment import EXPERIMENTS, Advice, Experiment
from romsindy.diagnosis.found import titles
from romsindy.diagnosis.rival import QUARTILE, Rival
from romsindy.effects.base import Effect
from romsindy.fit.record import Record, scales
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

_MOST_ODDS = 1000.0  # more depends on what no rival knows of
_RIVALS = 3
_UNLIKELY = 0.1  # rivals that share so little of the weight may stay untold


def next_test(
    rivals: Sequence[Hypothesis],
    model: ReducedModel,
    records: Sequence[Record],
    tests: Sequence[Experiment] = EXPERIMENTS,
    *,
    explained: bool = True,
) -> Advice | None:
    """The cheapest test that would tell rivals apart; of several, that with the best expected odds.

    Where none would, the one that comes nearest; None where there is nothing to tell apart, or no
    test that the model can simulate.

    Parameters
    ----------
    rivals : sequence of Hypothesis
        Fitted to the records, the best first.
    model : ReducedModel
        The simulation as it was.
    records : sequence of Record
    tests : sequence of Experiment
        Those that can be made, with their costs.
    explained : bool
        Whether the rivals explain the records: else the odds so far mean nothing, and the test is
        to show which of them is nearest to what is missing.
    """
    rivals = rivals[:_RIVALS]
    if len(rivals) < 2:
        return None
    largest = max(range(len(records)), key=lambda i: records[i].amplitude)
    shares = weights(rivals) if explained else np.full(len(rivals), 1 / len(rivals))
    compared = _Comparison(
        [Rival.of(model, h, records, largest) for h in rivals],
        np.array([h.score if explained else 0.0 for h in rivals]),
        shares,
        records,
        largest,
    )
    value, test = _best(tests, compared)
    if test is None:
        return None
    action = test.action(records[largest].amplitude, records[largest].decay.unit)
    odds = float(np.exp(min(value, np.log(_MOST_ODDS))))
    names = tuple(titles(h) for h in rivals)
    own = [p.effect.advice for h in rivals for p in h.effects]
    otherwise = tuple(dict.fromkeys(words for words in own if words != Effect.advice))
    return Advice(test, action, odds, names, explained, otherwise)


def _best(tests: Sequence[Experiment], compared: _Comparison) -> tuple[float, Experiment | None]:
    """The cheapest test that tells, and its log odds; else the one that comes nearest.

    Of tests that cost the same, the one that promises most is tried by fits.
    """
    best: tuple[float, Experiment | None] = (-np.inf, None)
    for cost in sorted({test.cost for test in tests}):
        near = [(compared.log_odds(test), test) for test in tests if test.cost == cost]
        value, test = max(near, key=lambda found: found[0])
        if 2 * value >= EQUIVALENT:
            value = min(value, compared.log_odds(test, exact=True))
        if value > best[0]:
            best = (value, test)
        if 2 * value >= EQUIVALENT:
            break
    return best


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Rivals, minus twice the logarithms of their evidence so far, and their weights, (n,)."""

    rivals: Sequence[Rival]
    scores: Array
    shares: Array
    records: Sequence[Record]
    largest: int  # which of the records has the largest amplitude
    shown: dict[tuple, list[Record | None]] = field(default_factory=dict)

    def log_odds(self, test: Experiment, exact: bool = False) -> float:
        """Logarithm of the odds for the right rival against the next, whichever it is.

        But for the least likely; minus infinity where the test cannot be simulated.
        """
        told = []
        shown = self._shown(test)
        for i, record in enumerate(shown):
            if record is None:
                return -np.inf
            odds = [self._against(i, j, record, test, exact) for j in range(len(shown)) if j != i]
            told.append(min(odds))
        order = np.argsort(told)
        at = np.searchsorted(np.cumsum(self.shares[order]), _UNLIKELY)
        return float(told[order[at]])

    def _against(self, i: int, j: int, record: Record, test: Experiment, exact: bool) -> float:
        """The same for rival i against j, were i the truth."""
        other = self.rivals[j]
        misfit = other.misfit(record, test)
        if exact:
            so_far = (self.records, self.largest)
            misfit = min(misfit, other.exact_misfit(record, test, *so_far))
        if not np.isfinite(misfit):
            return -np.inf
        misfit = max(misfit, 0.0)
        # Noise moves it by twice its root.
        noise = QUARTILE * float(np.sqrt(misfit))
        return 0.5 * float(misfit + self.scores[j] - self.scores[i]) - noise

    def _shown(self, test: Experiment) -> list[Record | None]:
        """What the test shows, were each of the rivals true; tests may share it."""
        spans = scales(self.records).spans
        now = max(end for _, end in spans) if spans else None
        key = (test.amplitude, test.duration, test.noise, now and test.wait)
        if key not in self.shown:
            found: list[Record | None] = []
            for rival in self.rivals:
                guess = found[-1].motion if found and found[-1] else None
                found.append(rival.shows(test, self.records[self.largest], now, guess))
            self.shown[key] = found
        return self.shown[key]
