"""Effects that take energy out of the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from romsindy.effects.base import Parameter, Scales, TermEffect
from romsindy.effects.mounting import AlongBeam, AtPoint, Mounting, TowardsAnchor
from romsindy.physics.damping import AmplitudeDamping, Friction, PowerDamping, RubbingFriction


@dataclass(frozen=True)
class Viscous(TermEffect):
    """A wrong coefficient of viscous damping."""

    name, family = "viscous", "damping"
    label = "another damping proportional to speed (viscous) than assumed"
    law = PowerDamping(1)


@dataclass(frozen=True)
class Damper(Viscous):
    """A viscous damper between the structure and the ground."""

    sign = 1
    label = "a damper proportional to speed (viscous)"
    mounting = AtPoint()


@dataclass(frozen=True)
class AirDrag(TermEffect):
    """Drag in air or water."""

    exponent: float = 2.0

    spread = 0.07
    name, family, sign = "quadratic_drag", "damping", 1
    label = "damping proportional to speed squared (drag in air or water)"
    advice = "a decay from a larger amplitude, or with the area that meets the air changed"
    resembles = ("amplitude_damping", "cubic_damping")
    mounting = AlongBeam()
    law = PowerDamping()


@dataclass(frozen=True)
class SpeedCubedDamping(TermEffect):
    """Damping with the cube of speed."""

    exponent: float = 3.0

    spread = 0.07
    name, family, sign = "cubic_damping", "damping", 1
    label = "damping proportional to speed cubed"
    advice = "a decay from a larger amplitude: the third harmonic decides"
    law = PowerDamping()


@dataclass(frozen=True)
class GrowingDamping(TermEffect):
    """Viscous damping that grows with displacement."""

    exponent: float = 2.0

    spread = 0.07
    name, family, sign = "amplitude_damping", "damping", 1
    label = "viscous damping that grows with displacement squared (q^2 q_dot)"
    advice = "a decay from a larger amplitude: the third harmonic decides"
    resembles = ("cubic_damping",)
    law = AmplitudeDamping()


@dataclass(frozen=True)
class DryFriction(TermEffect):
    """Coulomb friction."""

    name, family, sign = "dry_friction", "damping", 1
    label = "friction of constant size (dry, Coulomb)"
    advice = "a decay followed to smaller amplitudes, where friction stops the motion"
    resembles = ("rubbing", "hysteretic")
    mounting: ClassVar[Mounting] = AtPoint()
    law = Friction()


@dataclass(frozen=True)
class SpringFriction(DryFriction):
    """Dry friction inside a spring, which a small motion hardly lengthens."""

    name = "spring_friction"
    advice = "a decay with the spring exchanged"
    mounting: ClassVar[Mounting] = TowardsAnchor()


@dataclass(frozen=True)
class Hysteretic(TermEffect):
    """Loss of a fixed part of the energy, whatever the frequency."""

    exponent: float = 1.0

    spread = 0.04
    name, family, sign = "hysteretic", "damping", 1
    label = "damping that takes a fixed part of the energy of every cycle (structural)"
    advice = "decays at another frequency, with a mass added"
    resembles = ("rubbing",)
    law = Friction()


@dataclass(frozen=True)
class Rubbing(TermEffect):
    """Friction on one side of a position."""

    side: int = 1
    gap: float = 0.0

    name, family, sign = "rubbing", "damping", 1
    law = RubbingFriction()
    label = "friction on one side of a position (rubbing)"
    advice = "a second sensor next to the suspected contact"

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        a = scales.amplitude
        starts = (0.0, 0.03 * a, -0.03 * a, 0.1 * a, -0.1 * a)
        return (Parameter("gap", starts, -0.2 * a, 0.2 * a, 0.05 * a, unit="q"),)
