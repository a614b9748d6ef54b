"""Which laws, and effects of a catalogue, are looked for, and where.

Laws of one coordinate by places: "decay": beside functions of q, where one coordinate decays.
"coupled": on every one of several coordinates; "jointed": on these as well, where what is smooth
does not explain them. "driven": damping under a measured input, beside powers up to an order of the
user's. "steady": in points of steady vibration, where near one resonance the first harmonic tells
powers of the amplitude only, so that gamma_3 stands for inertia and the cube of the speed for the
square of q times it. "swept": in sweeps, of which amplitudes alone are known. "series": in what
stands for a simulated series, one by one; "rich": in what that is measured by. Of several
coordinates what may couple them, from the plainest kind of structure on.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from romsindy.effects.base import Effect
from romsindy.physics.coupling import (
    Along,
    CoupledTerm,
    MixedDamping,
    MixedStiffness,
    SlavedInertia,
)
from romsindy.physics.damping import AmplitudeDamping, Friction, PowerDamping
from romsindy.physics.inertia import AddedMass, Inertia
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.typing import Array

_TABLE: tuple[tuple[Term, str], ...] = (
    (Stiffness(2, odd=True), "jointed steady"),
    (Stiffness(2), "coupled series rich"),
    (Stiffness(3), "coupled steady swept rich"),
    (Stiffness(4), "rich"),
    (Stiffness(5), "steady swept series rich"),
    (AmplitudeDamping(1), "jointed driven"),
    (AmplitudeDamping(2), "coupled driven"),
    (PowerDamping(2), "decay jointed driven steady swept series rich"),
    (PowerDamping(3), "driven steady swept"),
    (Friction(), "decay jointed driven series swept"),
    (Inertia(3), "series rich"),
    (Inertia(5), "rich"),
)
# Effects of a catalogue that are not looked for: what a beam explains by its own parameters, and a
# sensor by comparison with the others; in driven records a mode that rings down, and the zero of
# the sensor, which is fitted always.
_LEFT_OUT = {
    "beam": ("linear_frequency", "gain", "saturation", "bias", "sensor_nonlinearity"),
    "driven": ("second_mode", "bias"),
}
DAMPING, FREQUENCY = "linear damping", "linear frequency"
# Effects that do the same to one mode, as they are tried: what needs no place first.
FAMILIES = {
    DAMPING: ("mass_damping", "material_damping", "viscous", "hysteretic"),
    FREQUENCY: (
        "linear_frequency",
        "bending_stiffness",
        "modulus",
        "density",
        "thickness",
        "length",
        "width",
        "clamp_compliance",
        "added_mass",
    ),
}


def family_of(said: Sequence[tuple[str, ...]]) -> str | None:
    """The family of which all explanations, by their names, are members; None if of none."""
    for name, members in FAMILIES.items():
        if all(len(n) == 1 and n[0] in members for n in said):
            return name
    return None


PLACES = frozenset(place for _, places in _TABLE for place in places.split())


def looked_for(catalogue: Iterable[Effect], where: str) -> list[Effect]:
    """The effects of a catalogue that are looked for on a "beam", or in "driven" records."""
    return [e for e in catalogue if e.name not in _LEFT_OUT[where]]


def sought(place: str) -> tuple[Term, ...]:
    """The laws that are looked for in one place of the table, beside the linear ones.

    Raises a ValueError for another place.
    """
    if place not in PLACES:
        raise ValueError(f"place = {place!r} must be one of {sorted(PLACES)}")
    return tuple(law for law, places in _TABLE if place in places.split())


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
