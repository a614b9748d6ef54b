"""Effects on restoring force and mass."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from romsindy.effects.base import Scales, Shape, TermEffect
from romsindy.physics.force_laws import (
    AddedMass,
    ConstantForce,
    Magnet,
    PowerStiffness,
    StopStiffness,
    TwoSidedGap,
)
from romsindy.physics.terms import Inertia, Stiffness, Term
from romsindy.typing import Array


class LinearFrequency(TermEffect):
    """A wrong linear stiffness."""

    name, family = "linear_frequency", "stiffness"
    label = "another linear stiffness (natural frequency) than assumed"
    advice = "a second mode, or a decay with a known mass added"

    def term(self, shape: Array) -> Term:
        return Stiffness(1)


class MoreMass(TermEffect):
    """Mass that moves along."""

    name, family, sign = "added_mass", "inertia", 1
    label = "added mass"
    advice = "a second mode: mass and stiffness move it differently"

    def term(self, shape: Array) -> Term:
        return AddedMass()


class CubicStiffness(TermEffect):
    """Hardening or softening with the cube of displacement."""

    name, family = "cubic_stiffness", "stiffness"
    label = "cubic stiffness"
    advice = "a larger amplitude: the third harmonic decides"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        return (Shape.near("exponent", 3.0, 0.04),)

    def term(self, shape: Array) -> Term:
        return PowerStiffness(float(shape[0]))


class QuinticStiffness(TermEffect):
    """Hardening or softening with the fifth power."""

    name, family = "quintic_stiffness", "stiffness"
    label = "quintic stiffness"
    advice = "a larger amplitude"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        return (Shape.near("exponent", 5.0, 0.07),)

    def term(self, shape: Array) -> Term:
        return PowerStiffness(float(shape[0]))


class QuadraticStiffness(TermEffect):
    """Asymmetric stiffness, as of a sagged structure."""

    name, family = "quadratic_stiffness", "stiffness"
    label = "quadratic (asymmetric) stiffness, as from sag"
    advice = "a test in another position relative to gravity"

    def term(self, shape: Array) -> Term:
        return Stiffness(2)


class SteadyForce(TermEffect):
    """A constant force."""

    name, family = "constant_force", "stiffness"
    label = "a constant force"
    advice = "a record of the structure at rest before and after"

    def term(self, shape: Array) -> Term:
        return ConstantForce()


class NonlinearInertia(TermEffect):
    """Inertia that grows with displacement."""

    name, family = "nonlinear_inertia", "inertia"
    label = "nonlinear inertia"
    advice = "a larger amplitude: the third harmonic decides"

    def term(self, shape: Array) -> Term:
        return Inertia(3)


class Bilinear(TermEffect):
    """Two stiffnesses that meet near rest."""

    name, family = "bilinear", "stiffness"
    label = "bilinear stiffness, as of a crack that opens and closes"
    advice = "a static pull to either side"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        a = scales.amplitude
        starts = (0.0, 0.025 * a, -0.025 * a, 0.05 * a, -0.05 * a)
        return (Shape("gap", starts, -0.2 * a, 0.2 * a, 0.05 * a, unit="q"),)

    def term(self, shape: Array) -> Term:
        return StopStiffness(float(shape[0]))


def _gaps(scales: Scales, least: float) -> tuple[Shape, ...]:
    a = scales.amplitude
    starts = np.linspace(max(least, 0.2), 0.9, 9)
    return (Shape("gap", tuple(starts * a), least * a, 0.97 * a, unit="q"),)


@dataclass(frozen=True)
class Stop(TermEffect):
    """A stop that is met on one side."""

    side: int = 1

    name, family, sign = "stop", "stiffness", 1
    label = "a stop on one side"
    advice = "a decay from just below the gap"

    @property
    def variant(self) -> str:
        return "above" if self.side > 0 else "below"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        (gap,) = _gaps(scales, 0.2)
        if self.side < 0:
            starts = tuple(-g for g in gap.starts)
            gap = replace(gap, starts=starts, low=-gap.high, high=-gap.low)
        return (gap, Shape.near("exponent", 1.0, 0.04))

    def term(self, shape: Array) -> Term:
        return StopStiffness(float(shape[0]), self.side, float(shape[1]))


class Gap(TermEffect):
    """Springs met on both sides beyond a gap."""

    name, family = "two_sided_gap", "stiffness"
    label = "a spring with a gap on both sides"
    advice = "a decay from just below the gap"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        return (*_gaps(scales, 0.15), Shape.near("exponent", 1.0, 0.04))

    def term(self, shape: Array) -> Term:
        return TwoSidedGap(float(shape[0]), float(shape[1]))


@dataclass(frozen=True)
class MagnetPull(TermEffect):
    """Attraction that grows on approach."""

    side: int = 1

    name, family, sign = "magnet", "stiffness", 1
    label = "a magnet that attracts from one side"
    advice = "a static pull towards the magnet, or a larger amplitude"

    @property
    def variant(self) -> str:
        return "above" if self.side > 0 else "below"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        a = scales.amplitude
        distance = Shape("distance", (1.3 * a, 1.5 * a, 1.8 * a, 2.3 * a), 1.1 * a, 4 * a, unit="q")
        return (distance, Shape.near("exponent", 2.0, 0.07))

    def term(self, shape: Array) -> Term:
        return Magnet(float(shape[0]), self.side, float(shape[1]))
