"""Effects on restoring force and mass."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from romsindy.effects.base import Parameter, Scales, TermEffect
from romsindy.effects.mounting import AtPoint, Load, Mounting, Point, PointMass, TowardsAnchor
from romsindy.physics.inertia import AddedMass, Inertia
from romsindy.physics.stiffness import ConstantForce, GapForce, MagnetForce, Stiffness, StopForce


@dataclass(frozen=True)
class LinearFrequency(TermEffect):
    """A wrong linear stiffness."""

    name, family = "linear_frequency", "stiffness"
    label = "another linear stiffness (natural frequency) than assumed"
    advice = "a second mode, or a decay with a known mass added"
    law = Stiffness(1)


@dataclass(frozen=True)
class MoreMass(TermEffect):
    """Mass that moves along."""

    name, family, sign = "added_mass", "inertia", 1
    label = "mass that moves along (added mass)"
    advice = "a second mode: mass and stiffness move it differently"
    law = AddedMass()

    def on_beam(self, strength: float, mounting: Mounting | None = None) -> PointMass:
        """A point mass [kg], at the right end if nothing else is said."""
        return PointMass(strength, None if mounting is None else mounting.at)


@dataclass(frozen=True)
class CubicStiffness(TermEffect):
    """Hardening or softening with the cube of displacement."""

    exponent: float = 3.0

    spread = 0.04
    name, family = "cubic_stiffness", "stiffness"
    label = "a restoring force with displacement cubed (cubic stiffness)"
    advice = "a larger amplitude: the third harmonic decides"
    resembles = (
        "nonlinear_inertia",
        "gain",
        "added_mass",
        "magnet",
        "quintic_stiffness",
        "saturation",
    )
    mounting = AtPoint()

    def term(self) -> Stiffness:
        return Stiffness(self.exponent)


@dataclass(frozen=True)
class QuinticStiffness(TermEffect):
    """Hardening or softening with the fifth power."""

    exponent: float = 5.0

    spread = 0.07
    name, family = "quintic_stiffness", "stiffness"
    label = "a restoring force with the fifth power of displacement (quintic stiffness)"
    advice = "a larger amplitude"
    resembles = ("two_sided_gap", "stop", "saturation")

    def term(self) -> Stiffness:
        return Stiffness(self.exponent)


@dataclass(frozen=True)
class QuadraticStiffness(TermEffect):
    """Asymmetric stiffness, as of a sagged structure."""

    name, family = "quadratic_stiffness", "stiffness"
    label = "a stiffness that rises to one side (quadratic, as from sag)"
    advice = "a test in another position relative to gravity"
    resembles = ("bilinear", "constant_force", "bias", "sensor_nonlinearity")
    law = Stiffness(2)


@dataclass(frozen=True)
class SteadyForce(TermEffect):
    """A constant force."""

    name, family = "constant_force", "stiffness"
    label = "a constant force"
    advice = "a record of the structure at rest before and after"
    resembles = ("bilinear", "bias", "sensor_nonlinearity")
    law = ConstantForce()


@dataclass(frozen=True)
class NonlinearInertia(TermEffect):
    """Inertia that grows with displacement."""

    name, family = "nonlinear_inertia", "inertia"
    label = "mass that changes with displacement (nonlinear inertia)"
    advice = "a larger amplitude: the third harmonic decides"
    resembles = ("gain", "added_mass", "magnet")
    law = Inertia(3)


@dataclass(frozen=True)
class Bilinear(TermEffect):
    """Two stiffnesses that meet near rest."""

    gap: float = 0.0

    name, family = "bilinear", "stiffness"
    law = StopForce()
    label = "a stiffness on either side (bilinear, as of a crack that opens and closes)"
    advice = "a static pull to either side"
    resembles = ("bias", "sensor_nonlinearity")

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        a = scales.amplitude
        starts = (0.0, 0.025 * a, -0.025 * a, 0.05 * a, -0.05 * a)
        return (Parameter("gap", starts, -0.2 * a, 0.2 * a, 0.05 * a, unit="q"),)


class _AtRest(TermEffect):
    """Contacts, whose gap and distance count from the position at rest."""

    advice = "a decay from just below the gap"

    def placed(self, mounting: Mounting, rest: Point) -> Mounting:
        return mounting.zeroed(rest)


def _gap(scales: Scales, least: float) -> Parameter:
    a = scales.amplitude
    starts = np.linspace(max(least, 0.2), 0.9, 9)
    return Parameter("gap", tuple(starts * a), least * a, 0.97 * a, unit="q")


@dataclass(frozen=True)
class Stop(_AtRest):
    """A stop that is met on one side."""

    side: int = 1
    gap: float = 0.0
    exponent: float = 1.0

    name, family, sign = "stop", "stiffness", 1
    law = StopForce()
    label = "a stop on one side"
    resembles = ("two_sided_gap", "cubic_stiffness", "saturation")
    mounting = AtPoint()

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        gap = _gap(scales, 0.2)
        if self.side < 0:
            starts = tuple(-g for g in gap.starts)
            gap = replace(gap, starts=starts, low=-gap.high, high=-gap.low)
        return (gap, Parameter.near("exponent", 1.0, 0.04))


@dataclass(frozen=True)
class TwoSidedGap(_AtRest):
    """Springs met on both sides beyond a gap."""

    gap: float = 0.0
    exponent: float = 1.0

    name, family, sign = "two_sided_gap", "stiffness", 1
    law = GapForce()
    label = "springs met on both sides beyond a gap (clearance)"
    resembles = ("cubic_stiffness", "saturation")
    mounting = AtPoint()

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        return (_gap(scales, 0.15), Parameter.near("exponent", 1.0, 0.04))


@dataclass(frozen=True)
class Magnet(_AtRest):
    """Attraction that grows on approach; its strength is the pull at rest."""

    side: int = 1
    distance: float = 1.0
    exponent: float = 2.0

    name, family, sign = "magnet", "stiffness", 1
    law = MagnetForce()
    label = "attraction that grows on approach from one side (as of a magnet)"
    advice = "a static pull towards the magnet, or a larger amplitude"
    resembles = ("gain", "added_mass")
    mounting = AtPoint()

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        a = scales.amplitude
        starts = (1.3 * a, 1.5 * a, 1.8 * a, 2.3 * a)
        distance = Parameter("distance", starts, 1.1 * a, 4 * a, unit="q")
        # Poles attract with the square of the distance, dipoles with its fourth power.
        return (distance, Parameter("exponent", (self.exponent, 3.0), 1.6, 4.4))

    def placed(self, mounting: Mounting, rest: Point) -> Mounting:
        """A pole at the distance from the point at rest, pulling along the line to it."""
        ex, ey, _ = mounting.gradient(rest)
        reach = self.side * self.distance
        return TowardsAnchor((rest.x + reach * ex, rest.y + reach * ey), mounting.at, self.distance)

    def on_beam(self, strength: float, mounting: Mounting | None = None) -> Load | PointMass:
        # Towards a pole, d is the lengthening: the pole is below.
        side = -1 if isinstance(mounting, TowardsAnchor) else self.side
        return super(Magnet, replace(self, side=side)).on_beam(strength, mounting)
