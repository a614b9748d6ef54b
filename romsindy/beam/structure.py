"""What a beam is made of: length, section, supports, springs, gravity, damping and effects."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from romsindy.effects.mounting import MountedLaw, PointMass, TowardsAnchor
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.validation import require_finite, require_position, require_positive


@dataclass(frozen=True)
class Section:
    """Stiffness and inertia of a cross-section about its centroid.

    Parameters
    ----------
    EA, GA, EI : float
        Axial stiffness, N; shear stiffness with its correction factor, N; bending stiffness, N m^2.
    mass, rotary_inertia : float
        Per unit length, kg/m and kg m.

    Raises
    ------
    ValueError
        For a value that is not positive (rotary_inertia may be zero).
    """

    EA: float
    GA: float
    EI: float
    mass: float
    rotary_inertia: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            zero_allowed = field.name == "rotary_inertia"
            require_positive(field.name, getattr(self, field.name), zero_allowed=zero_allowed)

    @classmethod
    def rectangle(
        cls,
        width: float,
        thickness: float,
        young: float,
        density: float,
        poisson: float = 0.3,
        shear_correction: float = 5.0 / 6.0,
    ) -> Section:
        """Make a solid rectangle that bends about its `width` axis (SI units).

        Raises
        ------
        ValueError
            For an argument that is not positive, or a Poisson ratio outside (-1, 0.5].

        Examples
        --------
        >>> round(Section.rectangle(0.025, 0.001, young=210e9, density=7800).EI, 6)
        0.4375
        """
        names = ("width", "thickness", "young", "density", "shear_correction")
        values = (width, thickness, young, density, shear_correction)
        for name, value in zip(names, values, strict=True):
            require_positive(name, value)
        if not -1.0 < poisson <= 0.5:
            raise ValueError(f"poisson must lie in (-1, 0.5], got {poisson}; steel has 0.3")
        area, second_moment = width * thickness, width * thickness**3 / 12.0
        return cls(
            EA=young * area,
            GA=shear_correction * young / (2.0 * (1.0 + poisson)) * area,
            EI=young * second_moment,
            mass=density * area,
            rotary_inertia=density * second_moment,
        )


@dataclass(frozen=True)
class Spring(MountedLaw):
    """A spring from a point of the beam to a fixed anchor, force k (l - l0) along itself.

    Parameters
    ----------
    at : float, optional
        Position on the undeformed axis [m]; None is the right end.
    stiffness : float
        Stiffness k [N/m].
    anchor : (float, float)
        (x, y) of the fixed end [m]; x runs along the undeformed beam from its left end.
    natural_length : float
        Length l0 [m] at which the spring is free of force.

    Raises
    ------
    ValueError
        For a negative stiffness or natural length, or an anchor that is not finite.
    """

    at: float | None = None
    stiffness: float = 1.0
    anchor: tuple[float, float] = (0.0, 0.0)
    natural_length: float = 0.0

    def __post_init__(self) -> None:
        require_positive("stiffness", self.stiffness, zero_allowed=True)
        require_positive("natural_length", self.natural_length, zero_allowed=True)
        require_finite("anchor", *self.anchor)

    law = Stiffness(1)

    @property
    def strength(self) -> float:  # type: ignore[override]
        """The stiffness."""
        return self.stiffness

    @cached_property
    def mounting(self) -> TowardsAnchor:  # type: ignore[override]
        """Towards the anchor, beyond the natural length."""
        return TowardsAnchor(self.anchor, self.at, self.natural_length)


def springs_of(beam: Any) -> list[Spring]:
    """Return the springs of a beam."""
    return [e for e in beam.effects if isinstance(e, Spring)]


def find_spring(beam: Any) -> Spring:
    """Return the one spring of a beam.

    Raises a ValueError if there is none, or more than one.
    """
    springs = springs_of(beam)
    if len(springs) != 1:
        raise ValueError(f"the beam has {len(springs)} springs, this effect needs exactly one")
    return springs[0]


TRANSVERSE, AXIAL = (0.0, 1.0), (1.0, 0.0)  # directions
_MOST = 10_000  # elements: the finest mesh that is solved within hours


@dataclass(frozen=True)
class Support:
    """What holds one end of the beam.

    Parameters
    ----------
    fixed : tuple of three bool
        Whether u, w and theta are held.
    rotational_stiffness : float
        Spring between the section and the ground, N m/rad.

    Raises
    ------
    ValueError
        For a negative stiffness.
    """

    fixed: tuple[bool, bool, bool] = (False, False, False)
    rotational_stiffness: float = 0.0

    def __post_init__(self) -> None:
        require_positive("rotational_stiffness", self.rotational_stiffness, zero_allowed=True)

    @classmethod
    def elastic(cls, rotational_stiffness: float) -> Support:
        """Make a clamp that gives way in rotation; stiffness in N m/rad."""
        return cls((True, True, False), rotational_stiffness)


FREE = Support()
PINNED = Support((True, True, False))
CLAMPED = Support((True, True, True))


@dataclass(frozen=True)
class BeamStructure:
    """The data of a `Beam`; everything that is computed from it lies above.

    Parameters
    ----------
    length : float
        Length, m.
    section : Section
        Stiffness and inertia of the cross-section.
    elements : int
        Number of quadratic elements (two nodes each).
    left, right : Support
        What holds the ends.
    gravity : tuple of two float
        Acceleration (gx, gy), m/s^2.
    alpha : float
        Mass-proportional damping, 1/s.
    eta : float
        Stiffness-proportional damping, s; acts on strain rates.
    effects : tuple of MountedLaw or PointMass
        Point masses, springs and the loads that `with_effect` has added.

    Raises
    ------
    ValueError
        For a length that is not positive, fewer than one element, negative damping, an effect off
        the beam, or an anchor on its own point of the beam.
    """

    length: float
    section: Section
    elements: int = 150
    left: Support = CLAMPED
    right: Support = FREE
    gravity: tuple[float, float] = (0.0, -9.81)
    alpha: float = 0.0
    eta: float = 0.0
    effects: tuple[MountedLaw | PointMass, ...] = ()

    def __post_init__(self) -> None:
        require_positive("length", self.length)
        require_positive("alpha", self.alpha, zero_allowed=True)
        require_positive("eta", self.eta, zero_allowed=True)
        require_finite("gravity", *self.gravity)
        whole = isinstance(self.elements, int | np.integer) and not isinstance(self.elements, bool)
        if not whole or not 1 <= self.elements <= _MOST:
            raise ValueError(
                f"elements must be a whole number from 1 to {_MOST}, got {self.elements!r:.60}"
            )
        for effect in self.effects:
            at = self.length if effect.at is None else effect.at
            require_position(f"at of {type(effect).__name__}", at, self.length)
            mounting = getattr(effect, "mounting", None)
            if not isinstance(mounting, TowardsAnchor):
                continue
            if mounting.span(at, 0.0) < 1e-9 * self.length:
                raise ValueError(
                    f"anchor = {mounting.anchor} lies on the beam's own point at {at} m, so "
                    "the spring has no length and no direction; move the anchor away"
                )
