"""What hypotheses say of a driven record that took no part, and what that makes of a finding.

Its motion starts where it was, and the zero of its sensor is its own; all else is as it was fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from romsindy.diagnosis.colour import driven_instead
from romsindy.diagnosis.driven.search import DrivenSearch
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.search import Finding, rivals_of
from romsindy.fit.any_record import AnyRecord
from romsindy.fit.gauss_newton import fit
from romsindy.fit.part import Part
from romsindy.fit.verdict import AS_GOOD, AS_ONE, EQUIVALENT, GAINED
from romsindy.physics.coupled import AnyModel
from romsindy.typing import Array

_MOST = 6  # hypotheses that are asked


def left_of(model: AnyModel, parts: Sequence[Part], record: AnyRecord) -> Array:
    """Measured minus simulated (n,), of a model with parts; infinite where it has no motion."""
    own = [p.elsewhere(record.t) for p in parts]
    return fit(driven_instead(model, own), own, [record], fixed=True).residuals[0]


def tested(search: DrivenSearch, found: Finding, record: AnyRecord) -> Finding:
    """The same finding, by what its hypotheses say of a record that took no part.

    Those that the fits do not tell apart are ranked with their predictions, and effects of the best
    that gain nothing there are dropped.
    """

    def misfit(h: Hypothesis) -> float:
        return float(np.sum(record.whitened(left_of(search.model, h.parts, record)) ** 2))

    asked = {id(h): misfit(h) for h in found.rivals[:_MOST]}
    least = min(asked.values())
    scale = max(1.0, least / record.count)  # what the best misses, others may miss by chance
    ranked = sorted(
        (
            replace(h, tested=max((asked[id(h)] - least) / scale - AS_GOOD, 0.0))
            for h in found.rivals[:_MOST]
        ),
        key=lambda h: h.score,
    )
    best = ranked[0]
    near = [h for h in ranked if h.score - best.score < EQUIVALENT]
    left, needed = misfit(best), best
    while needed.effects:
        fewer = search.without_one(needed)
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


def _with_best(search: DrivenSearch, found: Finding, best: Hypothesis) -> Finding:
    """The finding without what was better than another hypothesis, now the best."""
    every = search.ranked(search.compared)
    best = next(h for h in every if h.solution is best.solution)
    compared = [best, *(h for h in every if h is not best and h.score >= best.score)]
    base = next(h for h in every if h.solution is found.base.solution)
    return replace(found, rivals=rivals_of(best, compared, AS_ONE), compared=compared, base=base)
