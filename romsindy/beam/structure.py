"""What a beam is made of: length, section, supports, gravity, damping and effects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.beam.section import Section
from romsindy.effects.load import MountedLaw, PointMass
from romsindy.effects.mounting import TowardsAnchor
from romsindy.physics.validation import require_finite, require_position, require_positive

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
class Structure:
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
