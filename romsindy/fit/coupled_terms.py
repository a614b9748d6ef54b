"""Which terms several coordinates need: chosen by what each gains on data that took no part.

All candidates at once are linearised about the present motions; a fit to any of them, and its
misfit on parts of the data that are left out in turn, are then solutions of small systems. Records
are left out where there are many, else stretches of them that all span the amplitudes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from romsindy.fit.normal_equations import inverse, solved
from romsindy.fit.verdict import TERM
from romsindy.physics.coupling import (
    Along,
    CoupledTerm,
    MixedDamping,
    MixedStiffness,
    SlavedInertia,
)
from romsindy.physics.damping import AmplitudeDamping, PowerDamping
from romsindy.physics.inertia import AddedMass
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.typing import Array, Indices

# Of one coordinate: elastic and geometric; and those with a kink, of a joint that slips and drag.
_SMOOTH: tuple[Term, ...] = (Stiffness(2), Stiffness(3), AmplitudeDamping(2))
_KINKED: tuple[Term, ...] = (Stiffness(2, odd=True), AmplitudeDamping(1), PowerDamping(2))


def linear_terms(n_coordinates: int) -> tuple[Along, ...]:
    """Stiffness and damping of every coordinate by itself."""
    laws = (Stiffness(1), PowerDamping(1))
    return tuple(Along.coordinate(law, i + 1) for i in range(n_coordinates) for law in laws)


class Kind(NamedTuple):
    """Which candidates there are beside the smooth ones.

    Laws of single coordinates that have a kink at rest; modal masses that differ, for sensors scale
    the coordinates; what couples coordinates, without which masses are not told, and what couples
    their damping.
    """

    kinked: bool = False
    masses: bool = False
    coupled: bool = True
    coupled_damping: bool = True


# From the plainest on. Masses show where what couples is known well, not beside everything else.
KINDS = (Kind(), Kind(masses=True), Kind(masses=True, kinked=True))


def candidates(n_coordinates: int, kind: Kind) -> tuple[CoupledTerm, ...]:
    """Terms that may be needed beside the linear ones: to the third power, and of pairs."""
    alone = _SMOOTH + _KINKED if kind.kinked else _SMOOTH
    found: list[CoupledTerm] = []
    unit = np.eye(n_coordinates, dtype=int)
    if kind.masses and kind.coupled:
        found += [Along.coordinate(AddedMass(), i + 1) for i in range(1, n_coordinates)]
    for i in range(n_coordinates):
        found += [Along.coordinate(law, i + 1) for law in alone]
        found.append(_slaved(2 * unit[i], 2 * unit[i]))
    if not kind.coupled:
        return tuple(found)
    for i, j in itertools.combinations(range(n_coordinates), 2):
        a, b = unit[i], unit[j]
        powers = [2 * a + b, a + 2 * b, 3 * a + b, 2 * (a + b), a + 3 * b]
        found += [MixedStiffness(tuple(p.tolist())) for p in powers]
        found += [_slaved(a + b, a + b), _slaved(2 * a, a + b), _slaved(2 * b, a + b)]
        if not kind.coupled_damping:
            continue
        found.append(MixedDamping(i + 1, j + 1))
        found += [
            MixedDamping(k + 1, k + 1, tuple((2 * unit[m]).tolist())) for k, m in ((i, j), (j, i))
        ]
    for a, b, c in itertools.combinations(unit, 3):
        found.append(MixedStiffness(tuple((a + b + c).tolist())))
    return tuple(found)


def _slaved(first: Array, second: Array) -> SlavedInertia:
    return SlavedInertia(tuple(first.tolist()), tuple(second.tolist()))


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
        m = len(at)
        misfit = rows[:, -1] + rows[:, :m] @ at
        matrix, right, power = (
            rows[:, :-1].T @ rows[:, :-1],
            rows[:, :-1].T @ misfit,
            misfit @ misfit,
        )
        states = matrix[m:, m:]
        by_values = solved(states, matrix[m:, :m])
        own = solved(states, right[m:, None])[:, 0]
        return cls(
            matrix[:m, :m] - matrix[:m, m:] @ by_values,
            right[:m] - matrix[:m, m:] @ own,
            float(power - right[m:] @ own),
            len(rows),
        )

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
    """Misfits of parts that are left out, by which groups of values take part.

    Attributes
    ----------
    parts : sequence of Gram
        Each is left out in turn; one alone is judged by its own misfit.
    always : sequence of int
        Places of the values that always take part.
    groups : sequence of sequence of int
        Places of values that take part together, or not at all.
    least : mapping of int to float
        What the value of a group of one must exceed.
    """

    parts: Sequence[Gram]
    always: Sequence[int]
    groups: Sequence[Sequence[int]]
    least: Mapping[int, float]

    @property
    def n(self) -> int:
        """Number of samples."""
        return sum(p.n for p in self.parts)

    def chosen(self, present: Sequence[int]) -> list[int]:
        """Numbers of the groups that gain, in order of their gains.

        They are looked for from none on, and from those that are present: about a wrong motion no
        term alone may gain. The better choice is taken.
        """
        found = [self._grown(list(start)) for start in ((), present)]
        least = min(left for _, left in found)
        return min(found, key=lambda x: x[1] + self.cost(x[0], least))[0]

    def _grown(self, kept: list[int]) -> tuple[list[int], float]:
        """From some groups on, and the misfit."""
        kept, left = self._without_idle(kept, self.left_out(kept))
        while True:
            others = [g for g in range(len(self.groups)) if g not in kept]
            trials = sorted((self.left_out([*kept, g]), g) for g in others)
            misfit, best = next((t for t in trials if self.can_be([*kept, t[1]])), (left, -1))
            if best < 0 or left - misfit < self._needed(left, best, len(others)):
                return kept, left
            kept, left = self._exchanged([*kept, best], misfit)
            kept, left = self._without_idle(kept, left)

    def _exchanged(self, kept: list[int], left: float) -> tuple[list[int], float]:
        """With another in the place of one, where that leaves less."""
        for g in kept[:-1]:
            rest = [k for k in kept if k != g]
            others = [j for j in range(len(self.groups)) if j not in kept]
            misfit, best = min(((self.left_out([*rest, j]), j) for j in others), default=(left, g))
            more = len(self.groups[best]) - len(self.groups[g]) + 1
            if left - misfit > max(more, 1) * needed(self.n, left, 1):
                return self._exchanged([*rest, best], misfit)
        return kept, left

    def _without_idle(self, kept: list[int], left: float) -> tuple[list[int], float]:
        """Without those that later ones have made superfluous."""
        for g in kept:
            fewer = [k for k in kept if k != g]
            misfit = self.left_out(fewer)
            if misfit - left < self._needed(left, g, 1):
                return self._without_idle(fewer, misfit)
        return kept, left

    def cost(self, kept: Sequence[int], left: float) -> float:
        """What so many values must gain, where ``left`` is left."""
        return sum(self._needed(left, g, 1) for g in kept)

    def _needed(self, left: float, group: int, looks: int) -> float:
        return len(self.groups[group]) * needed(self.n, left, looks)

    def can_be(self, kept: Sequence[int]) -> bool:
        """Whether the value of the last group is one that it may have."""
        if not kept or kept[-1] not in self.least:
            return True
        return bool(_fitted(self.parts, self.places(kept))[-1] > self.least[kept[-1]])

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
