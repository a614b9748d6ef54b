"""What the choice of terms adds to the errors of a fit.

The errors of a fit take its terms for the right ones. Where the data hardly tell another choice
from it, that one counts as well: with a term more, a term less, or one in the place of another. The
choices are weighed by the Bayesian information criterion, those of less than a twentieth of the
weight are left out ("Occam's window" [1]). Each has a covariance, and values that differ from those
of the fit: the errors are those of the mixture [2]. All is linear about the motions of the fit.

[1] D. Madigan, A. Raftery, J. Am. Statist. Assoc. 89, 1994.
[2] J. Hoeting, D. Madigan, A. Raftery, C. Volinsky, Statist. Sci. 14, 1999.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from romsindy.fit.choice.selection import Linearised, Trials
from romsindy.fit.verdict import HARDLY_TOLD
from romsindy.typing import Array


class Alternative(NamedTuple):
    """Another choice of groups: without ``gone``, with ``added``, either may be None.

    ``weight`` is its probability among all alternatives and the choice itself, ``squares`` (m, m)
    what the mean squares of its values about those of the choice are beyond the covariance of that,
    at all places.
    """

    gone: int | None
    added: int | None
    weight: float
    squares: Array


def counting_choice(
    free: Sequence[str], covariance: Array, every: Linearised
) -> tuple[Array, list[str]]:
    """The same for the covariance of some values by name, and what is to be said of it."""
    at = {i: p for i, name in enumerate(free) if (p := every.place(name)) is not None}
    here, places = np.ix_([*at], [*at]), [*at.values()]
    own = np.diag(every.trials.covariance(every.present))
    ratio = np.diag(covariance)[[*at]] / np.where(own > 0, own, np.inf)[places]
    scale = np.ones(len(own))
    scale[places] = np.sqrt(ratio)
    found = alternatives(every.trials, every.present, scale)
    errors = {free[i]: float(np.sqrt(covariance[i, i])) for i in at}
    notes = [s for a in found if (s := _sentence(a, every, places, errors))]
    mixture = covariance.copy()
    mixture[here] = mixed(covariance[here], found, places)
    return mixture, notes


def alternatives(
    trials: Trials, kept: Sequence[int], scale: Array | float = 1.0
) -> list[Alternative]:
    """Those that the data hardly tell from the groups that were chosen.

    ``trials`` has one part: all data. ``scale`` (m,) is the error of each value over that which
    the trials give it: that of noise with a colour may be less.
    """
    left, values, own = trials.left_out(kept), trials.values(kept), trials.covariance(kept)
    found: list[Alternative] = []
    for gone, added in _changes(kept, len(trials.groups)):
        others = [k for k in kept if k != gone]
        if added is not None:
            others.append(added)
        if added is None or trials.possible(others) == others:
            cost = trials.cost(others, left) - trials.cost(kept, left)
            rise = trials.left_out(others) - left + cost
            shift = trials.values(others) - values
            wider = (trials.covariance(others) - own) * np.multiply.outer(scale, scale)
            squares = wider + np.outer(shift, shift)
            found.append(Alternative(gone, added, rise, squares))
    least = min([0.0, *(a.weight for a in found)])
    odds = [a._replace(weight=float(np.exp((least - a.weight) / 2))) for a in found]
    odds = [a for a in odds if a.weight > HARDLY_TOLD]
    total = np.exp(least / 2) + sum(a.weight for a in odds)
    return [a._replace(weight=a.weight / total) for a in odds]


def mixed(covariance: Array, found: Sequence[Alternative], places: Sequence[int]) -> Array:
    """Covariance of the values at some places, with that of the alternatives."""
    here = np.ix_(places, places)
    return covariance + sum((a.weight * a.squares[here] for a in found), np.zeros_like(covariance))


def _changes(kept: Sequence[int], n: int) -> list[tuple[int | None, int | None]]:
    """What may go and what may come, of n groups: one, the other, or both."""
    added = [None, *(g for g in range(n) if g not in kept)]
    return [(a, b) for a in (None, *kept) for b in added if (a, b) != (None, None)]


def _sentence(
    a: Alternative, every: Linearised, places: Sequence[int], errors: Mapping[str, float]
) -> str:
    """Which choices are hardly told apart, where an error grows by half by that; else none."""
    added = np.sqrt(np.maximum(a.weight * np.diag(a.squares)[places], 0.0))
    names = [n for (n, error), by in zip(errors.items(), added, strict=True) if by > error]
    if not names:
        return ""
    told = " or ".join(every.name(g) for g in (a.gone, a.added) if g is not None)
    if a.gone is None or a.added is None:
        told = f"with or without {told}"
    return f"{told}: the data hardly tell; the errors of {', '.join(names)} count both"
