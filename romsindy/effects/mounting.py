"""Where on a structure a law acts (at a point, towards an anchor, along the beam), and its load.

A mounting turns the motion of a point of the beam into the one displacement d and speed w that a
law knows, and the force of the law back into a force on the beam. With the gradient g of d,

    w = g . v,      force = -f(d, w) g.

A law mounted on a beam is a load: force, tangents, stored and dissipated energy.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from romsindy.physics.term import Term
from romsindy.physics.validation import require_finite, require_positive, unit_vector

Vector = tuple[Any, Any, Any]
Matrix = tuple[Vector, Vector, Vector]

ZERO: Vector = (0.0, 0.0, 0.0)
ZEROS: Matrix = (ZERO, ZERO, ZERO)


class Point(NamedTuple):
    """Where a point of the beam's axis is and how it moves [m, m, rad; m/s, m/s, rad/s].

    `s` is its position on the undeformed axis, so the axial displacement is x - s. Each may be a
    number, or an array over points.
    """

    s: Any
    x: Any
    y: Any
    theta: Any
    x_dot: Any = 0.0
    y_dot: Any = 0.0
    theta_dot: Any = 0.0

    @property
    def velocity(self) -> Vector:
        """(x_dot, y_dot, theta_dot)."""
        return self.x_dot, self.y_dot, self.theta_dot


def _hypot(x: Any, y: Any) -> Any:
    # The beam's solvers ask for one point at a time: plain floats are several times faster.
    return math.hypot(x, y) if isinstance(x, float) else np.hypot(x, y)


class Mounting(ABC):
    """The contract: displacement, its gradient, and how the gradient turns."""

    at: float | None = None  # position on the undeformed axis [m]; None is the right end

    @abstractmethod
    def kinematics(self, point: Point) -> tuple[Any, Vector]:
        """d [m], and its derivatives with respect to (x, y, theta)."""

    def displacement(self, point: Point) -> Any:
        """d [m]."""
        return self.kinematics(point)[0]

    def gradient(self, point: Point) -> Vector:
        """Derivatives of d with respect to (x, y, theta)."""
        return self.kinematics(point)[1]

    def turning(self, point: Point) -> Matrix:
        """Derivatives of the gradient (rows) with respect to (x, y, theta)."""
        return ZEROS

    def zeroed(self, rest: Point) -> Mounting:
        """The same with d zero at a point at rest."""
        return self

    def settled(self, beam: Any) -> Mounting:
        """The same with what it takes from the beam filled in."""
        return self

    @property
    @abstractmethod
    def place(self) -> str:
        """Where it is, for a label."""


@dataclass(frozen=True)
class AtPoint(Mounting):
    """At one point, along a fixed direction.

    Parameters
    ----------
    at : float, optional
        Position on the undeformed axis [m]; None is the right end, the tip of a cantilever.
    direction : (float, float)
        (x, y), of any length; (0, 1) is transverse, upwards.
    datum : float
        Displacement from the undeformed beam [m] at which d is zero.

    Raises
    ------
    ValueError
        For a direction of length zero.
    """

    at: float | None = None
    direction: tuple[float, float] = (0.0, 1.0)
    datum: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", unit_vector(self.direction))

    def kinematics(self, point: Point) -> tuple[Any, Vector]:
        ex, ey = self.direction
        return ex * (point.x - point.s) + ey * point.y - self.datum, (ex, ey, 0.0)

    def zeroed(self, rest: Point) -> AtPoint:
        return replace(self, datum=self.datum + self.displacement(rest))

    @property
    def place(self) -> str:
        return "at the tip" if self.at is None else f"at {self.at:.3g} m"


@dataclass(frozen=True)
class TowardsAnchor(Mounting):
    """Between a point and a fixed anchor: d is the lengthening of the straight line.

    Parameters
    ----------
    anchor : (float, float), optional
        (x, y) of the fixed end [m]; None takes place and anchor from the beam's own spring.
    at : float, optional
        Position on the undeformed axis [m]; None is the right end.
    length : float
        Length [m] at which d is zero.
    """

    anchor: tuple[float, float] | None = None
    at: float | None = None
    length: float = 0.0

    def __post_init__(self) -> None:
        require_finite("anchor", *self.anchor or ())
        if not 0.0 <= self.length < math.inf:
            raise ValueError(f"length = {self.length!r} m must be zero or positive")

    def settled(self, beam: Any) -> TowardsAnchor:
        """With place and anchor of the beam's one spring, where none is given.

        Raises a ValueError if the beam has not exactly one spring.
        """
        if self.anchor is not None:
            return self
        mounted = [getattr(e, "mounting", None) for e in beam.effects]
        springs = [m for m in mounted if isinstance(m, TowardsAnchor)]
        if len(springs) != 1:
            raise ValueError(
                f"anchor = None, but the beam has {len(springs)} springs to take it from: give the"
                " anchor (x, y) in m"
            )
        return replace(self, at=springs[0].at, anchor=springs[0].anchor)

    def span(self, x: Any, y: Any) -> Any:
        """Distance [m] of a point (x, y) from the anchor."""
        return _hypot(*self._from_anchor(x, y))

    def _from_anchor(self, x: Any, y: Any) -> tuple[Any, Any]:
        if self.anchor is None:
            raise ValueError("anchor = None; add the load by beam.with_effect(...), or give it")
        return x - self.anchor[0], y - self.anchor[1]

    def kinematics(self, point: Point) -> tuple[Any, Vector]:
        dx, dy = self._from_anchor(point.x, point.y)
        span = _hypot(dx, dy)
        return span - self.length, (dx / span, dy / span, 0.0)

    def zeroed(self, rest: Point) -> TowardsAnchor:
        return replace(self, length=self.length + self.displacement(rest))

    def turning(self, point: Point) -> Matrix:
        d, (ex, ey, _) = self.kinematics(point)
        span = d + self.length
        xy = -ex * ey / span
        return (ey * ey / span, xy, 0.0), (xy, ex * ex / span, 0.0), ZERO

    @property
    def place(self) -> str:
        return "in the spring" if self.anchor is None else "towards an anchor"


@dataclass(frozen=True)
class AlongBeam(Mounting):
    """All along the beam, across its own axis; the law gives a force per unit length.

    Only the velocity across the section is known, so that laws of the speed alone can act.
    """

    def kinematics(self, point: Point) -> tuple[Any, Vector]:
        return 0.0 * point.y, (-np.sin(point.theta), np.cos(point.theta), 0.0)

    def turning(self, point: Point) -> Matrix:
        c, s = np.cos(point.theta), np.sin(point.theta)
        return (0.0, 0.0, -c), (0.0, 0.0, -s), ZERO

    @property
    def place(self) -> str:
        return "along the beam"


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
