"""Which laws of one coordinate, and effects of a catalogue, are looked for, and where.

"decay": beside functions of q, where one coordinate decays. "coupled": on every one of several
coordinates; "jointed": on these as well, where what is smooth does not explain them. "driven":
damping under a measured input, beside powers up to an order of the user's. "steady": in points of
steady vibration, where near one resonance the first harmonic tells powers of the amplitude only, so
that gamma_3 stands for inertia and the cube of the speed for the square of q times it. "series": in
what stands for a simulated series, one by one; "rich": in what that is measured by.
"""

from __future__ import annotations

from collections.abc import Iterable

from romsindy.effects.base import Effect
from romsindy.physics.damping import AmplitudeDamping, Friction, PowerDamping
from romsindy.physics.inertia import Inertia
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term

_TABLE: tuple[tuple[Term, str], ...] = (
    (Stiffness(2, odd=True), "jointed steady"),
    (Stiffness(2), "coupled series rich"),
    (Stiffness(3), "coupled steady rich"),
    (Stiffness(4), "rich"),
    (Stiffness(5), "steady series rich"),
    (AmplitudeDamping(1), "jointed driven"),
    (AmplitudeDamping(2), "coupled driven"),
    (PowerDamping(2), "decay jointed driven steady series rich"),
    (PowerDamping(3), "driven steady"),
    (Friction(), "decay jointed driven series"),
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
