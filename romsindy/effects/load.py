"""A law mounted on a beam is a load: force, tangents, stored and dissipated energy."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from romsindy.effects.mounting import AlongBeam, AtPoint, Matrix, Mounting, Point, Vector
from romsindy.physics.term import Term
from romsindy.physics.validation import require_finite, require_positive


class MountedLaw:
    """Anything that is a law, times a strength, with a mounting."""

    law: Term  # of displacement and speed
    strength: float  # N over the dimension of the law; per m along a beam
    mounting: Mounting

    @property
    def at(self) -> float | None:
        """Position on the undeformed axis [m]; None is the right end."""
        return self.mounting.at

    @property
    def distributed(self) -> bool:
        """Whether it is a force per unit length."""
        return isinstance(self.mounting, AlongBeam)

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with this load."""
        return replace(beam, effects=(*beam.effects, self))

    @cached_property
    def stores(self) -> bool:
        """Whether the law has a potential."""
        return self.law.has("stiffness")

    @cached_property
    def dissipates(self) -> bool:
        """Whether the law takes energy out of the motion."""
        return self.law.has("damping")

    @cached_property
    def _preload(self) -> float:
        return self.law.preload

    def _motion(self, point: Point) -> tuple[Any, Any, Vector]:
        d, g = self.mounting.kinematics(point)
        return d, g[0] * point.x_dot + g[1] * point.y_dot + g[2] * point.theta_dot, g

    def _resistance(self, d: Any, w: Any) -> Any:
        """Force against d."""
        # Only what the law has: a beam asks a million times.
        force = self._preload
        if self.stores:
            force = force + self.law.stiffness(d)
        if self.dissipates:
            force = force + self.law.damping(d, w)
        return self.strength * force

    def force(self, point: Point) -> Vector:
        """Return (fx, fy, moment) on the beam, N and N m (per m for a distributed load)."""
        d, w, g = self._motion(point)
        f = self._resistance(d, w)
        return -f * g[0], -f * g[1], -f * g[2]

    def tangent(self, point: Point) -> Matrix:
        """Return -d(force)/d(x, y, theta)."""
        d, w, g = self._motion(point)
        f = self._resistance(d, w)
        by_w = self.strength * self.law.damping_dq_dot(d, w)
        by_d = self.strength * (self.law.stiffness_dq(d) + self.law.damping_dq(d, w))
        by_d = 0.0 if self.distributed else by_d
        v, (t0, t1, t2) = point.velocity, self.mounting.turning(point)
        # w = g . v turns with g.
        b = [by_d * g[j] + by_w * (t0[j] * v[0] + t1[j] * v[1] + t2[j] * v[2]) for j in range(3)]
        return (
            (g[0] * b[0] + f * t0[0], g[0] * b[1] + f * t0[1], g[0] * b[2] + f * t0[2]),
            (g[1] * b[0] + f * t1[0], g[1] * b[1] + f * t1[1], g[1] * b[2] + f * t1[2]),
            (g[2] * b[0] + f * t2[0], g[2] * b[1] + f * t2[1], g[2] * b[2] + f * t2[2]),
        )

    def damping_tangent(self, point: Point) -> Matrix:
        """Return -d(force)/d(x_dot, y_dot, theta_dot)."""
        d, w, g = self._motion(point)
        c = self.strength * self.law.damping_dq_dot(d, w)
        rows = [tuple(c * a * b for b in g) for a in g]
        return rows[0], rows[1], rows[2]

    def potential(self, point: Point) -> Any:
        """Return the stored energy [J] (per m for a distributed load)."""
        if not self.stores:
            return 0.0
        d = self.mounting.displacement(point)
        return self.strength * (self.law.potential(d) + self.law.preload * d)

    def power(self, point: Point) -> Any:
        """Return the power [W] that is dissipated (per m for a distributed load)."""
        d, w, _ = self._motion(point)
        return self.strength * self.law.damping(d, w) * w


@dataclass(frozen=True)
class Load(MountedLaw):
    """A law on a beam; `Beam.with_effect` takes it.

    Parameters
    ----------
    law : Term
        A force of displacement and speed, such as ``PowerDamping(2)`` or ``Stiffness(3)``. A
        friction must have a ``creep`` velocity: a beam's Newton iteration needs its slope.
    strength : float
        What the law is multiplied by: N over its dimension; per m along a beam.
    mounting : Mounting

    Raises
    ------
    ValueError
        For a strength that is not finite, or a law that has no force, that jumps, or that does not
        go with its mounting.
    """

    law: Term
    strength: float
    mounting: Mounting = field(default_factory=AtPoint)

    def __post_init__(self) -> None:
        require_finite("strength", self.strength)
        kind = type(self.law).__name__
        if not (self.law.has("stiffness") or self.law.has("damping")):
            raise ValueError(f"law = {kind} is no force: a PointMass adds mass to a beam")
        if not self.law.smooth:
            raise ValueError(f"law = {kind} jumps: give it a creep velocity, such as creep=1e-3")
        if self.distributed and self.law.has("stiffness"):
            raise ValueError(
                f"law = {kind} depends on displacement, AlongBeam knows the speed alone: mount it"
                " AtPoint or TowardsAnchor"
            )

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with this load, anchored at the beam's spring where no anchor is given."""
        settled = replace(self, mounting=self.mounting.settled(beam))
        return replace(beam, effects=(*beam.effects, settled))


@dataclass(frozen=True)
class PointMass:
    """A mass clamped to a point of the beam; with gravity it also weighs.

    Parameters
    ----------
    mass : float
        Mass [kg].
    at : float, optional
        Position on the undeformed axis [m]; None is the right end.
    rotary_inertia : float
        Moment of inertia about the point [kg m^2].

    Raises
    ------
    ValueError
        For a negative mass or inertia.
    """

    mass: float
    at: float | None = None
    rotary_inertia: float = 0.0

    def __post_init__(self) -> None:
        require_positive("mass", self.mass, zero_allowed=True)
        require_positive("rotary_inertia", self.rotary_inertia, zero_allowed=True)

    def applied_to(self, beam: Any) -> Any:
        """Return `beam` with this mass."""
        return replace(beam, effects=(*beam.effects, self))
