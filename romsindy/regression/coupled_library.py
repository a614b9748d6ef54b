"""Candidate terms of several coordinates, from what is asked for of one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

from romsindy.physics.coupling import Along, CoupledTerm, MixedStiffness, Powers, SlavedInertia
from romsindy.physics.damping import damping_law
from romsindy.physics.inertia import AddedMass
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term


def is_coupled(terms: Sequence[Term]) -> bool:
    """Whether there are terms of several coordinates among them."""
    return any(isinstance(term, CoupledTerm) for term in terms)


def coupled_terms(
    modes: int,
    inertia: Sequence[int],
    stiffness: Sequence[int],
    damping: Sequence[str],
    masses: bool = False,
) -> tuple[CoupledTerm, ...]:
    """Terms in the order of a library's columns; arguments as those of `ROMLibrary`."""
    found: list[CoupledTerm] = []
    for order in inertia:
        found += _slaved(modes, order)
    for degree in stiffness:
        found += [Along.coordinate(Stiffness(degree), i) for i in _numbers(modes)]
    for degree in stiffness:
        if degree > 1:  # coordinates are modes: small motions are not coupled
            found += [MixedStiffness(p) for p in _products(modes, degree + 1) if max(p) <= degree]
    for kind in damping:
        found += [Along.coordinate(damping_law(kind), i) for i in _numbers(modes)]
    if masses:
        found += [Along.coordinate(AddedMass(), i) for i in _numbers(modes)[1:]]
    return tuple(found)


def _numbers(modes: int) -> range:
    return range(1, modes + 1)


def _products(modes: int, degree: int) -> list[Powers]:
    """Powers of all products of the coordinates of a degree, those of q1 first."""
    chosen = combinations_with_replacement(range(modes), degree)
    return [tuple(factors.count(i) for i in range(modes)) for factors in chosen]


def _slaved(modes: int, order: int) -> list[SlavedInertia]:
    """Products of shapes of slaved modes: of degrees a and b, alike or next, a + b = order + 1."""
    if isinstance(order, bool) or order != int(order) or order < 3:
        raise ValueError(
            f"inertia names the order {order!r}: with several modes orders are whole numbers of at"
            " least 3, the products of quadratic shapes"
        )
    low = (int(order) + 1) // 2
    first, second = _products(modes, low), _products(modes, int(order) + 1 - low)
    if first == second:
        return [SlavedInertia(a, b) for a, b in combinations_with_replacement(first, 2)]
    return [SlavedInertia(a, b) for a in first for b in second]
