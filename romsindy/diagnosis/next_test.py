"""Which further measurement would tell apart what the data so far do not.

Every candidate test is simulated under each rival in turn, and each other rival is fitted to it
within what the data so far allow. What it cannot follow decides: half of that misfit, over the
noise, is the expected logarithm of the odds against it [1]. First all is linearised about the
motion of the rival that is taken for the truth; a test that would tell is then tried by fits.

[1] G. Box, W. Hill, Technometrics 9 (1967), "Discrimination among mechanistic models".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

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
    several = [Rival.of(model, h, records, largest) for h in rivals]
    spans = scales(records).spans
    now = max(end for _, end in spans) if spans else None
    scores = np.array([h.score if explained else 0.0 for h in rivals])
    shares = weights(rivals) if explained else np.full(len(rivals), 1 / len(rivals))

    def log_odds(test: Experiment, exact: bool) -> float:
        told = _log_odds(several, scores, records, largest, test, now, exact)
        return -np.inf if told is None else _sure(told, shares)

    value, test = _best(tests, log_odds)
    if test is None:
        return None
    action = test.action(records[largest].amplitude, records[largest].decay.unit)
    odds = float(np.exp(min(value, np.log(_MOST_ODDS))))
    names = tuple(titles(h) for h in rivals)
    own = [p.effect.advice for h in rivals for p in h.effects]
    otherwise = tuple(dict.fromkeys(words for words in own if words != Effect.advice))
    return Advice(test, action, odds, names, explained, otherwise)


def _best(
    tests: Sequence[Experiment], log_odds: Callable[[Experiment, bool], float]
) -> tuple[float, Experiment | None]:
    """The cheapest test that tells, and its log odds; else the one that comes nearest.

    Of tests that cost the same, those that promise most are tried by fits first.
    """
    best: tuple[float, Experiment | None] = (-np.inf, None)
    for cost in sorted({test.cost for test in tests}):
        near = [(log_odds(test, False), test) for test in tests if test.cost == cost]
        for value, test in sorted(near, key=lambda found: -found[0]):
            if 2 * value >= EQUIVALENT:
                value = min(value, log_odds(test, True))
            if value > best[0]:
                best = (value, test)
            if 2 * value >= EQUIVALENT:
                return best
    return best


def _log_odds(
    rivals: Sequence[Rival],
    scores: Array,
    records: Sequence[Record],
    largest: int,
    test: Experiment,
    now: float | None,
    exact: bool,
) -> Array | None:
    """Logarithm of the odds for each rival against the next, were it true, (n,).

    None where it cannot be simulated.
    """
    told, motion = [], None
    for true, score in zip(rivals, scores, strict=True):
        record = true.shows(test, records[largest], now, motion)
        if record is None:
            return None
        motion = record.motion
        against = []
        for other, its_score in zip(rivals, scores, strict=True):
            if other is true:
                continue
            misfit = other.misfit(record, test)
            if exact:
                misfit = min(misfit, other.exact_misfit(record, test, records, largest))
            if not np.isfinite(misfit):
                return None
            # Noise moves it by twice its root.
            misfit = max(misfit, 0.0)
            against.append(0.5 * (misfit + its_score - score) - QUARTILE * float(np.sqrt(misfit)))
        told.append(min(against))
    return np.array(told)


def _sure(values: Array, share: Array) -> float:
    """Value that is reached whichever is true, but for the least likely."""
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(share[order]), _UNLIKELY)])
