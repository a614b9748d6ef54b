"""Terms that several coordinates may need, from the plainest kind of structure on."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from romsindy.effects.choices import sought
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import (
    Along,
    CoupledTerm,
    MixedDamping,
    MixedStiffness,
    SlavedInertia,
)
from romsindy.physics.damping import PowerDamping
from romsindy.physics.inertia import AddedMass
from romsindy.physics.stiffness import Stiffness
from romsindy.typing import Array


def linear_terms(n_coordinates: int) -> tuple[Along, ...]:
    """Stiffness and damping of every coordinate by itself."""
    laws = (Stiffness(1), PowerDamping(1))
    return tuple(Along.coordinate(law, i + 1) for i in range(n_coordinates) for law in laws)


def linear_model(omega: Array, ratios: Array, unit: str | None) -> CoupledModel:
    """Small vibrations by angular frequencies and damping ratios, which do not grow."""
    pairs = zip(omega, ratios, strict=True)
    values = [float(v) for w, z in pairs for v in (w**2, 2 * max(z, 0.0) * w)]
    return CoupledModel(linear_terms(len(omega)), tuple(values), unit)


class Kind(NamedTuple):
    """Which candidates there are beside the smooth ones.

    Laws of single coordinates that have a kink or jump at rest, as joints and drag do; modal masses
    that differ, for sensors scale the coordinates; what couples coordinates, without which masses
    are not told, and what couples their damping.
    """

    kinked: bool = False
    masses: bool = False
    coupled: bool = True
    coupled_damping: bool = True


# From the plainest on. Masses show where what couples is known well, not beside everything else.
KINDS = (Kind(), Kind(masses=True), Kind(masses=True, kinked=True))


def candidates(n_coordinates: int, kind: Kind) -> tuple[CoupledTerm, ...]:
    """Terms that may be needed beside the linear ones: to the third power, and of pairs."""
    alone = (*sought("coupled"), *(sought("jointed") if kind.kinked else ()))
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
        found += [_slaved(a + b, x) for x in (2 * a, a + b, 2 * b)]
        found.append(_slaved(2 * a, 2 * b))
        if not kind.coupled_damping:
            continue
        found.append(MixedDamping(i + 1, j + 1))
        found += [
            MixedDamping(k + 1, k + 1, tuple((2 * unit[m]).tolist())) for k, m in ((i, j), (j, i))
        ]
    for a, b, c in itertools.combinations(unit, 3):
        found.append(MixedStiffness(tuple((a + b + c).tolist())))
    return tuple(found)


def couplings(n_coordinates: int) -> tuple[CoupledTerm, ...]:
    """Those of several coordinates together, and the masses that a coordinate drags along."""
    every = candidates(n_coordinates, KINDS[0])
    return tuple(term for term in every if not isinstance(term, Along))


def _slaved(first: Array, second: Array) -> SlavedInertia:
    return SlavedInertia(tuple(first.tolist()), tuple(second.tolist()))
