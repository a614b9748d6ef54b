"""Which terms are needed, chosen by what each gains on data left out; the errors of that choice.

All candidates at once are linearised about the present motions; a fit to any of them, and its
misfit on parts of the data that are left out in turn, are then solutions of small systems. Records
are left out where there are many, else stretches of them that all span the amplitudes. The kinetic
energy of what is dragged along is a sum of squares: a choice that makes it negative is none.

The errors of a fit take its terms for the right ones. Where the data hardly tell another choice
from it, that one counts as well: with a term more, a term less, or one in the place of another. The
choices are weighed by the Bayesian information criterion, those of less than a twentieth of the
weight are left out ("Occam's window" [1]). Each has a covariance, and values that differ from those
of the fit: the errors are those of the mixture [2]. All is linear about the motions of the fit.

[1] D. Madigan, A. Raftery, J. Am. Statist. Assoc. 89, 1994.
[2] J. Hoeting, D. Madigan, A. Raftery, C. Volinsky, Statist. Sci. 14, 1999.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.hypothesis import inverse, solved
from romsindy.fit.kernel.linear_response import nodes
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.coupled import CurvedShape
from romsindy.fit.verdict import HARDLY_TOLD, NEGATIVE, REFUSED, TERM
from romsindy.physics.term import Term
from romsindy.typing import Array, Indices

_PLACES = 400  # of a motion, at which kinetic energy is looked at


class Gram(NamedTuple):
    """Normal equations of one part of the data, for the values alone: states are eliminated.

    ``matrix`` (m, m), ``right`` (m,), ``power``, and the number of samples.
    """

    matrix: Array
    right: Array
    power: float
    n: int

    @classmethod
    def of(cls, rows: Array, at: Array) -> Gram:
        """From derivatives by values and states and the misfit, (n, m + k + 1), over the noise.

        The equations are for the values themselves; the rows were linearised at ``at``, (m,).
        """
        m, products = len(at), rows.T @ rows
        kept, states = [*range(m), -1], slice(m, -1)
        by_state = products[states][:, kept]
        own = products[np.ix_(kept, kept)] - by_state.T @ solved(products[states, states], by_state)
        return cls.of_products(own, at, len(rows))

    @classmethod
    def of_products(cls, products: Array, at: Array, n: int) -> Gram:
        """From weighed products of such columns without states, (m + 1, m + 1)."""
        turn = np.eye(len(products))
        turn[:-1, -1] = at
        own = turn.T @ products @ turn
        return cls(own[:-1, :-1], own[:-1, -1], float(own[-1, -1]), n)

    @classmethod
    def sum(cls, several: Sequence[Gram]) -> Gram:
        """Of the parts together."""
        matrix, right, power, n = zip(*several, strict=True)
        return cls(np.sum(matrix, axis=0), np.sum(right, axis=0), sum(power), sum(n))

    def misfit(self, where: Indices, values: Array) -> float:
        """Chi-square of some values, all others 0."""
        own = self.matrix[np.ix_(where, where)]
        return float(self.power - 2 * values @ self.right[where] + values @ own @ values)


@dataclass(frozen=True)
class Trials:
    """Misfits of parts that are left out, by which groups of values take part."""

    parts: Sequence[Gram]  # each is left out in turn; one alone is judged by its own misfit
    always: Sequence[int]  # places of the values that always take part
    groups: Sequence[Sequence[int]]  # places of values that take part together, or not at all
    least: Mapping[int, float]  # what the value of a group of one must exceed
    # Groups of which the data may refuse that, by `REFUSED` standard errors
    refusable: Collection[int] = ()
    # Kinetic energy at some states that a value of 1 of a group of one adds: see
    # `romsindy.fit.choice`. Their sum is not negative, by `NEGATIVE` standard errors.
    kinetic: Mapping[int, Array] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        parts: Sequence[Gram],
        always: Sequence[int],
        groups: Sequence[Sequence[int]],
        laws: Mapping[int, Term],
        kinetic: Mapping[int, Array],
    ) -> Trials:
        """Of groups, some of which are ``laws``, with the signs that these can have."""
        least = {g: law.least for g, law in laws.items() if law.least > -np.inf}
        damping = [g for g, law in laws.items() if law.has("damping")]
        return cls(parts, always, groups, least, damping, kinetic)

    @property
    def n(self) -> int:
        """Number of samples."""
        return sum(p.n for p in self.parts)

    def chosen(self, present: Sequence[int]) -> list[int]:
        """Numbers of the groups that gain, in order of their gains.

        They are looked for from none on, and from those that are present: about a wrong motion no
        term alone may gain. The better choice is taken.
        """
        held, misfit = self._best(present)
        lifted = {g: low for g, low in self.least.items() if g not in self.refusable}
        if len(lifted) == len(self.least):
            return held
        free, less = replace(self, least=lifted)._best(present)
        gain = misfit - less + self.cost(held, less) - self.cost(free, less)
        return free if gain > REFUSED**2 * max(less / self.n, 1.0) else held

    def _best(self, present: Sequence[int]) -> tuple[list[int], float]:
        """The best choice, and its misfit.

        On the way to it values stand for terms that are still missing, and what is dragged along
        may seem to have no mass: the choice is judged, and looked for with that rule if it fails.
        """
        found = replace(self, kinetic={})._cheapest(present)
        return self._cheapest(present) if self._negative(found[0]) else found

    def _cheapest(self, present: Sequence[int]) -> tuple[list[int], float]:
        found = [self._grown(list(start)) for start in ((), present)]
        least = min(left for _, left in found)
        return min(found, key=lambda x: x[1] + self.cost(x[0], least))

    def _grown(self, start: list[int]) -> tuple[list[int], float]:
        """From some groups on, and the misfit."""
        kept = self.possible(start)
        kept, left = self._without_idle(kept, self.left_out(kept))
        while True:
            others = [g for g in range(len(self.groups)) if g not in kept]
            misfit, new = min(self._with_one_of(others, kept), default=(left, kept))
            if new == kept or left - misfit < self._needed(left, new[-1], len(others)):
                return kept, left
            kept, left = self._exchanged(new, misfit)
            kept, left = self._without_idle(kept, left)

    def _with_one_of(
        self, others: Sequence[int], kept: Sequence[int]
    ) -> list[tuple[float, list[int]]]:
        """Misfits of some groups with another one, and those that it leaves possible."""
        trials = ((g, self.possible([*kept, g])) for g in others)
        return [(self.left_out(new), new) for g, new in trials if new[-1:] == [g]]

    def _exchanged(self, kept: list[int], left: float) -> tuple[list[int], float]:
        """With another in the place of one, where that leaves less."""
        for g in kept[:-1]:
            rest = [k for k in kept if k != g]
            others = [j for j in range(len(self.groups)) if j not in kept]
            misfit, best = min(self._with_one_of(others, rest), default=(left, kept))
            more = self._size(best) - self._size(kept) + 1
            if left - misfit > max(more, 1) * needed(self.n, left, 1):
                return self._exchanged(best, misfit)
        return kept, left

    def _size(self, kept: Sequence[int]) -> int:
        return sum(len(self.groups[g]) for g in kept)

    def _without_idle(self, kept: list[int], left: float) -> tuple[list[int], float]:
        """Without those that later ones have made superfluous."""
        for g in kept:
            fewer = self.possible([k for k in kept if k != g])
            misfit = self.left_out(fewer)
            if misfit - left < self._needed(left, g, 1):
                return self._without_idle(fewer, misfit)
        return kept, left

    def cost(self, kept: Sequence[int], left: float) -> float:
        """What so many values must gain, where ``left`` is left."""
        return sum(self._needed(left, g, 1) for g in kept)

    def _needed(self, left: float, group: int, looks: int) -> float:
        return len(self.groups[group]) * needed(self.n, left, looks)

    def possible(self, kept: Sequence[int]) -> list[int]:
        """Without groups whose values cannot be what they are."""
        left = list(kept)
        while wrong := self._impossible(left):
            left = [g for g in left if g not in wrong]
        return left

    def _impossible(self, kept: Sequence[int]) -> list[int]:
        if not any(g in self.least or g in self.kinetic for g in kept):
            return []
        values = self.values(kept)
        own = {g: float(values[self.groups[g][0]]) for g in kept}
        wrong = [g for g in kept if g in self.least and own[g] <= self.least[g]]
        return wrong or self._negative(kept)

    def _negative(self, kept: Sequence[int]) -> list[int]:
        """Groups that take kinetic energy away where all of them together leave less than none."""
        found = self.values(kept)
        values = {g: float(found[self.groups[g][0]]) for g in kept if g in self.kinetic}
        each = np.array([self.kinetic[g] * value for g, value in values.items()])
        if not len(each) or np.all(each.sum(axis=0) >= 0):
            return []
        places = [self.groups[g][0] for g in values]
        covariance = self.covariance(kept)[np.ix_(places, places)]
        rows = np.array([self.kinetic[g] for g in values])
        excess = max(self.left_out(kept) / self.n, 1.0)  # what is left counts as noise
        power = excess * np.einsum("gn,gh,hn->n", rows, covariance, rows)
        error = np.sqrt(np.maximum(power, 1e-300))
        worst = int(np.argmin(each.sum(axis=0) / error))
        if each[:, worst].sum() > -NEGATIVE * error[worst]:
            return []
        return [g for g, taken in zip(values, each[:, worst], strict=True) if taken < 0]

    def places(self, kept: Sequence[int]) -> list[int]:
        """Of the values that always take part, and those of the groups."""
        return [*self.always, *(i for g in kept for i in self.groups[g])]

    def values(self, kept: Sequence[int]) -> Array:
        """Of all places, fitted to all parts; 0 of groups that take no part."""
        where = self.places(kept)
        found = np.zeros(len(self.parts[0].right))
        found[where] = _fitted(self.parts, where)
        return found

    def covariance(self, kept: Sequence[int]) -> Array:
        """Of the values of all places, (m, m); 0 for groups that take no part."""
        where = self.places(kept)
        found = np.zeros_like(self.parts[0].matrix)
        here = np.ix_(where, where)
        found[here] = inverse(Gram.sum(self.parts).matrix[here])
        return found

    def left_out(self, kept: Sequence[int]) -> float:
        """Misfit of all parts, each by values that were fitted to the others, if there are any."""
        where = self.places(kept)
        at, parts = np.array(where), self.parts
        others = [[o for o in parts if o is not p] or parts for p in parts]
        return sum(p.misfit(at, _fitted(o, where)) for p, o in zip(parts, others, strict=True))


class Linearised(NamedTuple):
    """All that may take part in a fit, linearised about motions.

    ``sensors`` come first among the places of ``trials``, then ``terms``, those that are free, and
    what is fitted of a ``chain`` from excitation to force; ``present`` are the numbers of the
    groups that take part so far.
    """

    trials: Trials
    sensors: tuple[Part, ...]
    terms: tuple[Term, ...]
    present: list[int]
    chain: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the values behind those of the sensors."""
        return (*(t.key for t in self.terms), *self.chain)

    def place(self, name: str) -> int | None:
        """Of a coefficient among all values; None where it is no candidate."""
        names = self.names
        return len(self.sensors) + names.index(name) if name in names else None

    def name(self, group: int) -> str:
        """Of a term, or of what sensors show."""
        place = self.trials.groups[group][0]
        if place >= len(self.sensors):
            return self.names[place - len(self.sensors)]
        effect = self.sensors[place].effect
        return effect.sentence if isinstance(effect, CurvedShape) else effect.variant


def needed(n: int, left: float, looks: int) -> float:
    """What a term must gain of chi-square: more than chance, and a part of what is left.

    There are ``n`` samples, ``left`` is chi-square, ``looks`` the number of terms to choose from:
    the extended Bayesian information criterion (J. Chen, Z. Chen, Biometrika 95, 2008).
    """
    return float(np.log(n) + 2 * np.log(looks) + TERM * max(left - n, 0.0))


def _fitted(parts: Sequence[Gram], where: Sequence[int]) -> Array:
    at = np.array(where)
    matrix = sum(p.matrix[np.ix_(at, at)] for p in parts)
    return solved(np.asarray(matrix), sum(p.right[at] for p in parts))


def dragged(terms: Sequence[Term], motions: Sequence[Trajectory]) -> dict[int, Array]:
    """Kinetic energy that a coefficient of 1 adds where the motions went, (n,), by place of a term.

    At unit velocities in some directions. Only of terms whose inertia vanishes at rest: it is that
    of fast modes which follow, a sum of squares. Masses at rest may differ either way.
    """
    q = np.concatenate([nodes(m)[1] for m in motions])
    q = q[:: max(len(q) // _PLACES, 1)]
    v = np.random.default_rng(0).standard_normal(q.shape)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    energies = {i: np.sum(v * _force(term, q, v), axis=1) / 2 for i, term in enumerate(terms)}
    rest = np.zeros_like(q[:1])
    at_rest = {i: bool(np.any(_force(term, rest, v[:1]))) for i, term in enumerate(terms)}
    return {i: e for i, e in energies.items() if np.any(e) and not at_rest[i]}


def _force(term: Term, q: Array, q_ddot: Array) -> Array:
    """Inertia of a term times accelerations, (n, R), from rest."""
    rest = np.zeros_like(q)
    return np.asarray(term.strong(q, rest, q_ddot) - term.strong(q, rest, rest))


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
