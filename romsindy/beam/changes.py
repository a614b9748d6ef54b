"""Changes of a beam itself, in one number each: what `Beam.with_effect` takes beside loads."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

from romsindy.beam.structure import Section, Spring, find_spring
from romsindy.effects.mounting import PointMass
from romsindy.physics.validation import require_finite, require_positive


@dataclass(frozen=True)
class _Change:
    """One number; ``applied_to`` returns a beam that is changed by it."""

    change: float  # of a parameter in its unit, or relative to it: 0.01 is one per cent more


class _OfSection(_Change):
    """A relative change of the section: its stiffness and inertia go with powers of 1 + change."""

    powers: ClassVar[dict[str, int]]  # of the fields of `Section`

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with another section."""
        changed = {
            name: getattr(beam.section, name) * (1 + self.change) ** power
            for name, power in self.powers.items()
        }
        return replace(beam, section=replace(beam.section, **changed))


class StifferBending(_OfSection):
    """A relative change of the bending stiffness EI."""

    powers: ClassVar = {"EI": 1}


class StifferAxially(_OfSection):
    """A relative change of the axial stiffness EA."""

    powers: ClassVar = {"EA": 1}


class StifferMaterial(_OfSection):
    """A relative change of Young's modulus, and of the shear modulus with it."""

    powers: ClassVar = {"EA": 1, "GA": 1, "EI": 1}


class Denser(_OfSection):
    """A relative change of the density, so of the mass per length and its rotary inertia."""

    powers: ClassVar = {"mass": 1, "rotary_inertia": 1}


class Wider(_OfSection):
    """A relative change of the width."""

    powers: ClassVar = {f.name: 1 for f in fields(Section)}


class Thicker(_OfSection):
    """A relative change of the thickness, in the direction of bending."""

    powers: ClassVar = {"EA": 1, "GA": 1, "EI": 3, "mass": 1, "rotary_inertia": 3}


class Longer(_Change):
    """A relative change of the length; what sits at the right end moves with it."""

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with another length; anchors stay where they are."""
        length = beam.length * (1 + self.change)
        beyond = [e for e in beam.effects if e.at is not None and e.at > length]
        effects = tuple(_at_the_end(e) if e in beyond else e for e in beam.effects)
        return replace(beam, length=length, effects=effects)


class FartherAnchor(_Change):
    """A shift of the anchor of the beam's spring along the beam, m."""

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with its spring anchored farther to the right."""
        spring = find_spring(beam)
        return _exchanged(beam, spring, anchor=(spring.anchor[0] + self.change, spring.anchor[1]))


class HigherAnchor(_Change):
    """A shift of the anchor of the beam's spring upwards, m."""

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with its spring anchored higher."""
        spring = find_spring(beam)
        return _exchanged(beam, spring, anchor=(spring.anchor[0], spring.anchor[1] + self.change))


class StifferSpring(_Change):
    """A relative change of the stiffness of the beam's spring; its natural length stays."""

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with another spring."""
        spring = find_spring(beam)
        return _exchanged(beam, spring, stiffness=spring.stiffness * (1 + self.change))


class HeavierMasses(_Change):
    """A relative change of all point masses on the beam."""

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with other point masses."""
        factor = 1 + self.change
        for e in (e for e in beam.effects if isinstance(e, PointMass)):
            turned = e.rotary_inertia * factor
            beam = _exchanged(beam, e, mass=e.mass * factor, rotary_inertia=turned)
        return beam


class HeavierRotation(_Change):
    """A relative change of the rotary inertia of all point masses on the beam."""

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with point masses that are harder to turn."""
        for e in (e for e in beam.effects if isinstance(e, PointMass)):
            beam = _exchanged(beam, e, rotary_inertia=e.rotary_inertia * (1 + self.change))
        return beam


class MassDamping(_Change):
    """A change of the mass-proportional damping alpha [1/s]; alpha stays at least zero."""

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with another alpha."""
        return replace(beam, alpha=max(beam.alpha + self.change, 0.0))


class MaterialDamping(_Change):
    """A change of the stiffness-proportional damping eta [s]; eta stays at least zero."""

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with another eta."""
        return replace(beam, eta=max(beam.eta + self.change, 0.0))


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

        Raises a ValueError if the beam has not exactly one spring, or it would have to be shorter
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
        return _exchanged(beam, spring, natural_length=natural)


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

        Raises a ValueError if the left end turns freely.
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


def _at_the_end(effect: Any) -> Any:
    """An effect, moved to the right end."""
    if hasattr(effect, "mounting") and not isinstance(effect, Spring):
        return replace(effect, mounting=replace(effect.mounting, at=None))
    return replace(effect, at=None)


def _exchanged(beam: Any, effect: Spring | PointMass, **values: Any) -> Any:
    """The beam with other values of one of its effects."""
    new = replace(effect, **values)
    return replace(beam, effects=tuple(new if e is effect else e for e in beam.effects))
