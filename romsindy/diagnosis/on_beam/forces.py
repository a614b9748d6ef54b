"""Forces on a beam as effects: named, screened and fitted in one coordinate, put on the beam.

A force of your own derives from one of the four kinds (`StoredForce`, `ViscousForce`,
`SquaredForce`, `FrictionForce`: how it depends on the velocity) and returns its effect on a beam
for a strength, in the unit of that effect, and shape values.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import CubicSpline

from romsindy.beam import Beam, StaticCurve
from romsindy.beam import effects as on_beam
from romsindy.diagnosis.on_beam.instrumented import place_in_words
from romsindy.effects.base import Effect, Scales, Shape, State, mean_sign, mean_sign_slope
from romsindy.typing import Array

_TENTHS = tuple(np.linspace(0.2, 0.9, 8))


@dataclass(frozen=True)
class MassDamping(on_beam.Effect):
    """A change of the mass-proportional damping, 1/s."""

    change: float

    def applied_to(self, beam: Beam) -> Beam:
        """Return `beam` with another alpha, at least zero."""
        return replace(beam, alpha=max(beam.alpha + self.change, 0.0))


@dataclass(frozen=True)
class MaterialDamping(on_beam.Effect):
    """A change of the stiffness-proportional damping, s."""

    change: float

    def applied_to(self, beam: Beam) -> Beam:
        """Return `beam` with another eta, at least zero."""
        return replace(beam, eta=max(beam.eta + self.change, 0.0))


@dataclass(frozen=True, eq=False)
class BeamForce(Effect):
    """A force on a beam, felt along the curve of its shapes."""

    curve: StaticCurve

    what: ClassVar[str]  # the label, with {place} for where on the beam
    rate: ClassVar[float] = 1.0  # q_dot at which the force is looked at, in reach times omega

    @property
    def label(self) -> str:  # type: ignore[override]
        """The force in words."""
        return self.what.format(place=place_in_words(self.curve.point))

    @abstractmethod
    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        """The effect on a beam."""

    @abstractmethod
    def speed(self, state: State) -> tuple[Array, Array]:
        """How the force depends on the velocity, and the derivative of that."""

    def forces(self, state: State, shape: Array) -> Array:
        """The force for a unit of strength."""
        return (self._along(state.q, shape)[0] * self.speed(state)[0])[None]

    def slopes(self, state: State, shape: Array, strengths: Array) -> tuple[Any, Any, Any]:
        """Its derivatives."""
        along, by_q = self._along(state.q, shape)
        speed, by_q_dot = self.speed(state)
        return strengths[0] * by_q * speed, strengths[0] * along * by_q_dot, 0.0

    def _along(self, q: Array, shape: Array) -> tuple[Array, Array]:
        spline = _resistance(self, tuple(shape.tolist()))
        inside = np.clip(q, self.curve.q[0], self.curve.q[-1])
        return spline(inside), spline(inside, 1)


@lru_cache(maxsize=256)
def _resistance(force: BeamForce, shape: tuple[float, ...]) -> CubicSpline:
    """Resistance over q for a unit of strength and of `speed`."""
    curve = force.curve
    rate = force.rate * curve.reach * np.sqrt(curve.omega2)
    spline = curve.resistance(force.beam_effect(1.0, np.array(shape)), rate)
    at = State(np.zeros(1), np.zeros(1), np.array([rate]), np.zeros(1), 0.0)
    spline.c /= float(np.ravel(force.speed(at)[0])[0])
    return spline


class StoredForce(BeamForce):
    """A force that depends on position alone; it also moves the equilibrium."""

    rate = 0.0

    def speed(self, state: State) -> tuple[Array, Array]:
        return np.ones_like(state.q), np.zeros_like(state.q)

    def readings(self, t: Array, q: Array, shape: Array) -> Array:
        """Displacements are counted from the equilibrium with the force."""
        pull = float(self._along(np.zeros(1), shape)[0][0])
        return np.full((1, len(q)), pull / self.curve.omega2)

    def metres(self, *parts: float) -> tuple[float, ...]:
        """Displacement of the point at parts of the reach, m."""
        return tuple(np.interp(np.array(parts) * self.curve.reach, self.curve.q, self.curve.height))

    @property
    def rest(self) -> float:
        """Transverse displacement of the point at equilibrium, m."""
        return self.curve.rest

    def stop(self, strength: float, above: float | None, below: float | None) -> on_beam.Stop:
        """A stop at the point."""
        stiffness = max(strength, 1e-9)
        return on_beam.Stop(at=self.curve.point, stiffness=stiffness, above=above, below=below)


class ViscousForce(BeamForce):
    """A force proportional to velocity."""

    def speed(self, state: State) -> tuple[Array, Array]:
        return state.q_dot, np.ones_like(state.q)


class SquaredForce(BeamForce):
    """A force proportional to velocity squared."""

    def speed(self, state: State) -> tuple[Array, Array]:
        return np.abs(state.q_dot) * state.q_dot, 2 * np.abs(state.q_dot)


class FrictionForce(BeamForce):
    """A force that only the sign of the velocity changes, spread over a step in time."""

    def speed(self, state: State) -> tuple[Array, Array]:
        turn = state.q_ddot * state.step / 3
        return mean_sign(state.q_dot, turn), mean_sign_slope(state.q_dot, turn)


class OtherMassDamping(ViscousForce):
    """Damping in proportion to the mass."""

    name, family = "mass_damping", "damping"
    what, unit = "other damping in proportion to mass (alpha) than assumed", "1/s"

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        return MassDamping(strength)


class OtherMaterialDamping(ViscousForce):
    """Damping in proportion to stiffness."""

    name, family = "material_damping", "damping"
    what, unit = "other damping in proportion to stiffness (eta) than assumed", "s"
    advice = "a second mode: it damps that more"

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        return MaterialDamping(strength)


class Damper(ViscousForce):
    """A viscous damper at the tip."""

    name, family, sign = "viscous", "damping", 1
    what, unit = "a viscous damper at {place}", "N s/m"

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        return on_beam.Dashpot(at=self.curve.point, coefficient=max(strength, 0.0))


class Drag(SquaredForce):
    """Air drag along the beam."""

    name, family, sign = "quadratic_drag", "damping", 1
    what, unit = "air drag proportional to speed squared", "drag coefficient"
    advice = "a decay from a larger amplitude, or one in thinner air"

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        return on_beam.Drag(coefficient=max(strength, 0.0))


class Friction(FrictionForce):
    """Dry friction at the tip."""

    name, family, sign = "dry_friction", "damping", 1
    what, unit = "dry friction at {place}", "N"
    advice = "a decay followed to smaller amplitudes, where friction stops the motion"

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        return on_beam.Friction(at=self.curve.point, limit=max(strength, 0.0))


class SpringFriction(FrictionForce):
    """Dry friction inside the spring, which a small motion hardly lengthens."""

    name, family, sign = "spring_friction", "damping", 1
    what, unit = "dry friction inside the spring", "N"
    advice = "a decay with the spring exchanged"

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        return on_beam.SpringFriction(limit=max(strength, 0.0))


@dataclass(frozen=True, eq=False)
class Stop(StoredForce):
    """A stop that the tip meets on one side."""

    side: int = 1

    name, family, sign = "stop", "stiffness", 1
    what, unit = "a stop on one side of {place}", "N/m"
    advice = "a decay from just below the gap"

    @property
    def variant(self) -> str:
        return "above" if self.side > 0 else "below"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        starts = self.metres(*(self.side * f for f in _TENTHS))
        low, high = sorted(self.metres(0.2 * self.side, 0.97 * self.side))
        return (Shape("gap", starts, low, high, unit="m"),)

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        place = self.rest + float(shape[0])
        above, below = (place, None) if self.side > 0 else (None, place)
        return self.stop(strength, above, below)


class Gap(StoredForce):
    """Stops on both sides of the tip."""

    name, family, sign = "two_sided_gap", "stiffness", 1
    what, unit = "stops on both sides of {place}", "N/m"
    advice = "a decay from just below the gap"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        starts = tuple(np.abs(self.metres(*_TENTHS)))
        low, high = np.abs(self.metres(0.15, 0.97))
        return (Shape("gap", starts, float(low), float(high), unit="m"),)

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        gap = float(shape[0])
        above, below = self.rest + gap, self.rest - gap
        return self.stop(strength, above, below)


@dataclass(frozen=True, eq=False)
class Magnet(StoredForce):
    """A magnet above or below the tip, as between two dipoles."""

    side: int = 1

    name, family, sign = "magnet", "stiffness", 1
    what, unit = "a magnet that attracts {place} from one side", "N m^4"
    advice = "a static pull towards the magnet, or a larger amplitude"

    @property
    def variant(self) -> str:
        return "above" if self.side > 0 else "below"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        (reach,) = np.abs(self.metres(float(self.side)))
        starts = tuple(float(f * reach) for f in (1.3, 1.5, 1.8, 2.3))
        return (Shape("distance", starts, 1.15 * reach, 4.0 * reach, unit="m"),)

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        point = self.curve.point
        x = self.curve.beam.length if point is None else point
        place = (x, self.rest + self.side * float(shape[0]))
        return on_beam.Magnet(at=point, strength=strength, position=place, power=4.0)


def beam_forces(curve: StaticCurve) -> tuple[BeamForce, ...]:
    """Forces that a beam may lack."""
    springs = [e for e in curve.beam.effects if isinstance(e, on_beam.Spring)]
    return (
        OtherMassDamping(curve),
        OtherMaterialDamping(curve),
        Damper(curve),
        Drag(curve),
        Friction(curve),
        *((SpringFriction(curve),) if len(springs) == 1 else ()),
        *(Stop(curve, side=side) for side in (1, -1)),
        Gap(curve),
        *(Magnet(curve, side=side) for side in (1, -1)),
    )
