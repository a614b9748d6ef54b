"""What needs no effect: what the measurement itself may add, and other values of the model.

An offset, a gain and a curvature of the sensor within what is known of them are nuisances: they
are fitted, and nobody is told that anything is missing. With them the values of the model, linear
stiffness and damping, then each other coefficient, are asked before any effect is.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from romsindy.diagnosis.decay_search import DecaySearch
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.screening import part_of, screen
from romsindy.diagnosis.unsure import nuisances
from romsindy.effects.base import Effect
from romsindy.fit.coefficient import Coefficient
from romsindy.fit.record import scales
from romsindy.fit.verdict import NOTHING_LEFT
from romsindy.physics.equations import inputs_of
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness

_LINEAR = ("omega^2", "c_linear")
_TRIED = 3  # of the coefficients, those that the screening puts first


def other_values(
    model: ReducedModel, catalogue: Sequence[Effect], known: Collection[str]
) -> tuple[Coefficient, ...]:
    """Each coefficient of a model that may be another, but for those that are ``known``.

    It goes by the name of the effect that has the same law, if there is one.
    """
    laws = {e.term(): e.name for e in catalogue}
    names = {law.key: name for law, name in laws.items() if law is not None}
    taken = {*_LINEAR, *known, *(term.key for term in inputs_of(model))}
    return tuple(
        Coefficient(term, names.get(term.key, "coefficient"))
        for term in model.terms
        if term.key not in taken
    )


def without_effects(
    search: DecaySearch, slack: Hypothesis, base: Hypothesis, values: Sequence[Coefficient]
) -> list[Hypothesis]:
    """What nuisances do, ``slack``, linear values beside, and these with one more of ``values``.

    One more value is asked where more than noise is left. Fits begin with the linear values of
    ``base``, without nuisances: beside these a frequency that is far off is not found by itself.
    """
    started = base.solution.parts[: base.n_free] if base.solution.finite else search.free
    search = replace(search, free=(*started, *nuisances(search.records)), compared=[])
    linear = search.settled(search.hypothesis([]))
    left = search.remainder(linear)
    enough = left.explained and left.ratio < NOTHING_LEFT
    if enough or not (values and linear.solution.finite):
        linear = linear.settled(search.noise.known)
        return [slack.at(linear.noise), linear]
    known = scales(search.records)
    parts, names = linear.solution.parts, {v.variant: v for v in values}
    found = screen(search.model, parts, list(names.values()), search.records, known)
    singles = [s for s in found.singles() if np.isfinite(s.chi_squared)]
    # A quadratic force acts to second order in its strength, which the screening does not see.
    second = [s for s in singles[_TRIED:] if s.effect.term() == Stiffness(2)]
    asked = [*singles[:_TRIED], *second]
    trials = search.fitted([[part_of(s, known, len(search.records))] for s in asked])
    ranked = search.ranked([linear, *(h for h in trials if h.solution.finite)])
    form = ranked[0].noise
    return [slack.at(form), linear.at(form), *(h for h in ranked if h.effects)]
