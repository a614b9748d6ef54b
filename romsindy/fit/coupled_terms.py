"""Which terms several coordinates need: chosen by what each gains on data that took no part.

All candidates at once are linearised about the present motions; a fit to any of them, and its
misfit on parts of the data that are left out in turn, are then solutions of small systems. Records
are left out where there are many, else stretches of them that all span the amplitudes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from romsindy.fit.normal_equations import solved
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


# From the plainest on.
KINDS = (Kind(), Kind(kinked=True))


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


def chosen(
    parts: Sequence[Gram], n_always: int, least: Mapping[int, float]
) -> tuple[list[int], Array]:
    """Places of the values to keep, the first ones and what gains most, and the values there.

    Parameters
    ----------
    parts : sequence of Gram
        Each is left out in turn.
    n_always : int
        So many values come first, and always take part.
    least : mapping of int to float
        What some values must exceed.
    """
    always, n_values, n = list(range(n_always)), len(parts[0].right), sum(p.n for p in parts)
    kept: list[int] = []
    left = _left_out(parts, always)

    def can_be(i: int) -> bool:
        return i not in least or _fitted(parts, [*always, *kept, i])[-1] > least[i]

    while True:
        others = [i for i in range(n_always, n_values) if i not in kept]
        trials = sorted((_left_out(parts, [*always, *kept, i]), i) for i in others)
        misfit, best = next((trial for trial in trials if can_be(trial[1])), (left, -1))
        if left - misfit < needed(n, left, len(others)):
            return [*always, *kept], _fitted(parts, [*always, *kept])
        kept, left = _exchanged(parts, n_always, [*kept, best], misfit)
        kept, left = _without_idle(parts, n_always, kept, left)


def _exchanged(
    parts: Sequence[Gram], n_always: int, kept: list[int], left: float
) -> tuple[list[int], float]:
    """With another in the place of one, where that leaves less."""
    always, n = list(range(n_always)), sum(p.n for p in parts)
    for i in kept[:-1]:
        rest = [k for k in kept if k != i]
        others = [j for j in range(n_always, len(parts[0].right)) if j not in kept]
        misfit, best = min((_left_out(parts, [*always, *rest, j]), j) for j in others)
        if left - misfit > needed(n, left, 1):
            return _exchanged(parts, n_always, [*rest, best], misfit)
    return kept, left


def _without_idle(
    parts: Sequence[Gram], n_always: int, kept: list[int], left: float
) -> tuple[list[int], float]:
    """Without those that later ones have made superfluous."""
    for i in kept[:-1]:
        fewer = [k for k in kept if k != i]
        misfit = _left_out(parts, [*range(n_always), *fewer])
        if misfit - left < needed(sum(p.n for p in parts), left, 1):
            return _without_idle(parts, n_always, fewer, misfit)
    return kept, left


def needed(n: int, left: float, looks: int) -> float:
    """What a term must gain of chi-square: more than chance, and a part of what is left.

    There are ``n`` samples, ``left`` is chi-square, ``looks`` the number of terms to choose from.
    """
    return float(np.log(n) + 2 * np.log(looks) + TERM * max(left - n, 0.0))


def _fitted(parts: Sequence[Gram], where: Sequence[int]) -> Array:
    at = np.array(where)
    matrix = sum(p.matrix[np.ix_(at, at)] for p in parts)
    return solved(np.asarray(matrix), sum(p.right[at] for p in parts))


def _left_out(parts: Sequence[Gram], where: Sequence[int]) -> float:
    """Misfit of all parts, each by values that were fitted to the others."""
    at = np.array(where)
    return sum(p.misfit(at, _fitted([o for o in parts if o is not p], where)) for p in parts)
