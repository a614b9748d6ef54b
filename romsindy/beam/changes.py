"""Changes of a beam itself, in one number each: what `Beam.with_effect` takes beside loads."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from romsindy.beam.spring import find_spring
from romsindy.beam.validation import require_finite, require_positive
from romsindy.effects.load import PointMass


@dataclass(frozen=True)
class StifferBending:
    """A relative change of the bending stiffness EI.

    Parameters
    ----------
    change : float
        0.01 is one per cent more.
    """

    change: float

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with another EI."""
        section = replace(beam.section, EI=beam.section.EI * (1 + self.change))
        return replace(beam, section=section)


@dataclass(frozen=True)
class StifferSpring:
    """A relative change of the stiffness of the beam's spring; its natural length stays.

    Parameters
    ----------
    change : float
        0.01 is one per cent more.
    """

    change: float

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with another spring."""
        spring = find_spring(beam)
        new = replace(spring, stiffness=spring.stiffness * (1 + self.change))
        return replace(beam, effects=tuple(new if e is spring else e for e in beam.effects))


@dataclass(frozen=True)
class HeavierMasses:
    """A relative change of all point masses on the beam.

    Parameters
    ----------
    change : float
        0.01 is one per cent more.
    """

    change: float

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with other point masses."""
        factor = 1 + self.change
        return replace(
            beam,
            effects=tuple(
                replace(e, mass=e.mass * factor, rotary_inertia=e.rotary_inertia * factor)
                if isinstance(e, PointMass)
                else e
                for e in beam.effects
            ),
        )


@dataclass(frozen=True)
class ExtraTension:
    """More (or less) tension in the beam's spring, by a shorter natural length.

    Parameters
    ----------
    tension : float
        Added tension [N] at the spring's present length.
    """

    tension: float

    def __post_init__(self) -> None:
        require_finite("tension", self.tension)

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with its spring tightened.

        Raises
        ------
        ValueError
            If the beam has not exactly one spring, or it would have to be shorter
            than nothing.
        """
        spring = find_spring(beam)
        natural = spring.natural_length - self.tension / spring.stiffness
        if natural < 0.0:
            most = spring.natural_length * spring.stiffness
            raise ValueError(
                f"tension = {self.tension} N would need a negative natural length; at most "
                f"{most:.4g} N can be added"
            )
        tightened = replace(spring, natural_length=natural)
        return replace(beam, effects=tuple(tightened if e is spring else e for e in beam.effects))


@dataclass(frozen=True)
class ClampCompliance:
    """Rotational compliance of the left clamp, in series with the stiffness that it has.

    Parameters
    ----------
    compliance : float
        Rotation per moment, rad/(N m).
    """

    compliance: float

    def __post_init__(self) -> None:
        require_positive("compliance", self.compliance)

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with its left clamp on a softer rotational spring.

        Raises
        ------
        ValueError
            If the left end turns freely.
        """
        u, w, theta = beam.left.fixed
        stiffness = beam.left.rotational_stiffness
        if not theta and stiffness == 0.0:
            raise ValueError(
                "the left end turns freely, so no clamp can give way; give it "
                "left=CLAMPED or left=Support.elastic(...)"
            )
        softer = 1.0 / ((0.0 if theta else 1.0 / stiffness) + self.compliance)
        support = replace(beam.left, fixed=(u, w, False), rotational_stiffness=softer)
        return replace(beam, left=support)


@dataclass(frozen=True)
class MassDamping:
    """A change of the mass-proportional damping.

    Parameters
    ----------
    change : float
        Of alpha [1/s]; alpha stays at least zero.
    """

    change: float

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with another alpha."""
        return replace(beam, alpha=max(beam.alpha + self.change, 0.0))


@dataclass(frozen=True)
class MaterialDamping:
    """A change of the stiffness-proportional damping.

    Parameters
    ----------
    change : float
        Of eta [s]; eta stays at least zero.
    """

    change: float

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with another eta."""
        return replace(beam, eta=max(beam.eta + self.change, 0.0))
