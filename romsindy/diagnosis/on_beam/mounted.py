"""Effects mounted on a beam, as its one coordinate feels them.

Along the curve of shapes x(q) a point of the beam is displaced by d(q) and moves at D(q) q_dot,
with D = dd/dq. A law f(d, w) that is mounted there does the work Q dq with

    Q(q, q_dot) = sum of D(q) f(d(q), D(q) q_dot)

over the points: that is its projection on the mode, exact along the curve.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from romsindy.beam.static_shapes import StaticCurve
from romsindy.beam.structure import FREE, BeamStructure, springs_of
from romsindy.effects import BEAM_CATALOGUE
from romsindy.effects.base import Effect, Parameter, Scales, State, TermEffect
from romsindy.effects.choices import FAMILIES
from romsindy.effects.mounting import AlongBeam, AtPoint, Mounting, Point, TowardsAnchor
from romsindy.fit.verdict import PLACE
from romsindy.physics.damping import Averaged, FrictionLaw
from romsindy.physics.term import Term
from romsindy.typing import Array

# Parts of the length over which an effect is looked for, at so many points: nearer to a support
# nothing moves.
_WITH_FREE_END, _BETWEEN, _PLACES = (0.25, 1.0), (0.2, 0.8), 7


def points(beam: BeamStructure) -> list[float]:
    """Where an effect that may be anywhere is tried at all sensors, m."""
    between = _WITH_FREE_END if beam.right == FREE else _BETWEEN
    return (beam.length * np.linspace(*between, _PLACES)).tolist()


def some_points(beam: BeamStructure, usual: float | None) -> list[float | None]:
    """Where it is tried in the coordinate of the first mode, m: ``usual``, and at some others."""
    return [usual, *points(beam)[:-1:2]]


@dataclass(frozen=True)
class PlaceOnBeam:
    """Where an effect acts, m."""

    at: float  # the likeliest point
    # Three standard errors to either side, see `PLACE_RISE`
    low: float
    high: float
    length: float  # of the beam
    # Of the effect, were it at ``low`` and at ``high``, with their 95 % errors outwards; empty
    # where it was not found again
    strengths: tuple[float, ...] = ()

    @property
    def told(self) -> bool:
        """Whether the data can tell where."""
        return self.high - self.low < PLACE * self.length

    def holds(self, at: float) -> bool:
        """Whether an effect may act at a point, m."""
        return self.low <= at <= self.high

    def between(self, known: Array) -> list[float]:
        """Points to look at, beside those that are ``known``, where these are too far apart."""
        i = int(np.clip(np.searchsorted(known, self.at), 1, len(known) - 1))
        apart = float(known[i] - known[i - 1])
        if self.high - self.low > apart:
            return []
        return [x for x in (self.at - apart / 4, self.at + apart / 4) if known[0] < x < known[-1]]

    def about(self, points: Sequence[float]) -> list[float]:
        """Where to look again, of ``points`` at equal distances: all, or about where it may be.

        They reach beyond its interval to either side, so that this is not cut off.
        """
        if not self.told:
            return list(points)
        apart = points[1] - points[0]
        below, above = ((x // apart + 1) for x in (self.at - self.low, self.high - self.at))
        near = self.at + apart * np.arange(-below, above + 1)
        return sorted(set(np.clip(near, points[0], points[-1]).tolist()))

    def cut_off(self, tried: Sequence[float], everywhere: Sequence[float]) -> bool:
        """Whether it may act beyond the points that were ``tried``, of those where it can be."""
        below = self.low <= tried[0] and tried[0] > everywhere[0]
        return below or (self.high >= tried[-1] and tried[-1] < everywhere[-1])

    def untold(self) -> PlaceOnBeam:
        """The same, where nothing else supports it."""
        return replace(self, low=0.0, high=self.length, strengths=())

    def __str__(self) -> str:
        if self.told:
            return f"it acts at {self.at:.3g} m ({self.low:.3g} to {self.high:.3g} m)"
        if not self.strengths:
            return "these data cannot tell where on the beam it acts"
        return f"between {self.low:.2g} and {self.high:.2g} m"


_POINTS = 8  # Gauss points along a beam: exact for cubes of the first mode's shape to 1e-6


class BeamEffect(Effect):
    """An effect that exists on a beam."""

    @abstractmethod
    def on_beam(self, strength: float, mounting: Mounting | None = None) -> Any:
        """What `Beam.with_effect` takes."""


@dataclass(frozen=True, eq=False)
class MountedEffect(BeamEffect):
    """An effect at its place on a beam."""

    effect: TermEffect
    curve: StaticCurve
    mounting: Mounting

    name = property(lambda self: self.effect.name)
    family = property(lambda self: self.effect.family)
    sign = property(lambda self: self.effect.sign)
    advice = property(lambda self: self.effect.advice)
    resembles = property(lambda self: self.effect.resembles)
    variant = property(lambda self: self.effect.variant)

    @property
    def label(self) -> str:  # type: ignore[override]
        """As an engineer says it, with the place."""
        return f"{self.effect.label} {self.mounting.place}"

    def strength_unit(self, unit: str | None) -> str:
        return self.effect.strength_on_beam(self.mounting)

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        """Those of the effect, in metres; exponents that are but guesses are exact on a beam."""
        at_rest = self.mounting.zeroed(_at_rest(self.curve, self.mounting))
        ends = np.array([-self.curve.reach, self.curve.reach])
        d = _Path.of(self.curve, at_rest).displacement(ends)
        metres = scales._replace(amplitude=float(np.abs(d).min()))
        known = [p for p in self.effect.parameters(metres) if p.name != "exponent" or not p.spread]
        return tuple(replace(p, unit="m") if p.unit == "q" else p for p in known)

    def shaped(self, values: Mapping[str, float]) -> MountedEffect:
        return replace(self, effect=self.effect.shaped(values))  # type: ignore[arg-type]

    def value(self, name: str) -> float:
        return self.effect.value(name)

    @cached_property
    def placed(self) -> Mounting:
        """The mounting for the present shape values, counted from the equilibrium where it must."""
        return self.effect.placed(self.mounting, _at_rest(self.curve, self.mounting))

    def on_beam(self, strength: float, mounting: Mounting | None = None) -> Any:
        least = max(strength, 0.0) if self.sign else strength
        return self.effect.on_beam(least, mounting or self.placed)

    @cached_property
    def _law(self) -> Term:
        law = self.on_beam(1.0).law
        # A fit averages the jump over its step in time, the beam needs it smooth.
        return law.jumping() if isinstance(law, FrictionLaw) else law

    @property
    def _path(self) -> _Path:
        return _Path.of(self.curve, self.placed)

    def _resistance(self, state: State, q: Array, slope: Array) -> Averaged:
        """The law at each point, for q within the curve, and its derivatives by d and w."""
        law, d, w = self._law, self._path.displacement(q), slope * state.q_dot[:, None]
        if isinstance(law, FrictionLaw):
            change = slope * state.q_ddot[:, None] * state.step / 3
            return law.averaged(d, w, w * state.step / 3, change)
        force = law.stiffness(d) + law.preload + law.damping(d, w)
        by_d = law.stiffness_dq(d) + law.damping_dq(d, w)
        return Averaged(force, by_d, law.damping_dq_dot(d, w), np.zeros_like(w))

    def forces(self, state: State) -> Array:
        """The projection for a unit of strength, less that at rest, where sensors are zero."""
        q = self.curve.within(state.q)
        slope = self._path.slope(q)
        force = slope * self._resistance(state, q, slope).force
        held = self._path.slope(np.zeros(1)) * self._law.preload
        return np.asarray((force - held) @ self._path.weights)[None]

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        """Derivatives of the projection."""
        path, q = self._path, self.curve.within(state.q)
        slope, bend = path.slope(q), path.slope(q, 1)
        force, by_d, by_w, by_change = self._resistance(state, q, slope)
        if not path.holonomic:
            by_d = 0.0
        by_q = bend * force + slope * (by_d * slope + by_w * bend * state.q_dot[:, None])
        by_q_dot = slope * slope * by_w
        by_q_ddot = slope * slope * by_change * state.step / 3
        s = strengths[0]
        mass = np.maximum(s * (by_q_ddot @ path.weights), -0.5)  # as in `TermEffect.slopes`
        return s * (by_q @ path.weights), s * (by_q_dot @ path.weights), mass

    def readings(self, t: Array, q: Array) -> Array | None:
        """Displacements are counted from the equilibrium, which a force at rest moves."""
        if not self._law.has("stiffness"):
            return None
        still = State(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), 0.0)
        return np.full((1, len(q)), float(self.forces(still)[0, 0]) / self.curve.omega2)


@dataclass(frozen=True, eq=False)
class _Path:
    """How the points of a mounting move along the curve; (n_points,) columns.

    ``displacement`` and ``slope`` are splines over q of d and of D.
    """

    displacement: CubicSpline
    slope: CubicSpline
    weights: Array
    holonomic: bool

    @staticmethod
    @lru_cache(maxsize=256)
    def of(curve: StaticCurve, mounting: Mounting) -> _Path:
        columns, weights = [], []
        for place, weight in _places(curve, mounting):
            u, w, theta = np.moveaxis(place.of(curve.shapes), -1, 0)
            point = Point(place.s, place.s + u, w, theta)
            tangent = place.of(curve.tangents)
            g = np.stack(np.broadcast_arrays(*mounting.gradient(point), point.y)[:3], axis=-1)
            columns.append((mounting.displacement(point), np.sum(g * tangent, axis=-1)))
            weights.append(weight)
        d, slope = (CubicSpline(curve.q, np.stack(c, 1)) for c in zip(*columns, strict=True))
        return _Path(d, slope, np.array(weights), not isinstance(mounting, AlongBeam))


def _places(curve: StaticCurve, mounting: Mounting) -> list[tuple[Any, float]]:
    """Places of a mounting on the beam, each with its weight: one, or Gauss points along it."""
    assembly, length = curve.assembly, curve.beam.length
    if not isinstance(mounting, AlongBeam):
        return [(assembly.place(mounting.at), 1.0)]
    x, w = np.polynomial.legendre.leggauss(_POINTS)
    pairs = zip((length * (1 + x) / 2).tolist(), (length * w / 2).tolist(), strict=True)
    return [(assembly.place(at), weight) for at, weight in pairs]


def _at_rest(curve: StaticCurve, mounting: Mounting) -> Point:
    """The first place of a mounting at the equilibrium."""
    return _places(curve, mounting)[0][0].point(curve.rest, np.zeros_like(curve.rest))


@dataclass(frozen=True, eq=False)
class DampingEffect(BeamEffect):
    """A change of the beam's own damping; its force is a difference of two beams.

    ``change`` is one of `romsindy.beam.changes`, in one number: no less than takes away all.
    """

    curve: StaticCurve
    change: type  # of `romsindy.beam.changes`, in one number
    name: str  # type: ignore[misc]
    label: str  # type: ignore[misc]
    fixed_unit: str  # type: ignore[misc]
    advice: str  # type: ignore[misc]
    least: float  # type: ignore[misc]
    tolerance: float | None = None  # type: ignore[misc]

    family = "damping"
    assumed = property(lambda self: -self.least)

    def on_beam(self, strength: float, mounting: Mounting | None = None) -> Any:
        return self.change(strength)

    @cached_property
    def _resistance(self) -> CubicSpline:
        """Resistance over q for a unit of the change, and of q_dot."""
        rate = self.curve.reach * np.sqrt(self.curve.omega2)
        spline = self.curve.resistance(self.change(1.0), rate)
        spline.c /= rate
        return spline

    def forces(self, state: State) -> Array:
        return (self._resistance(self.curve.within(state.q)) * state.q_dot)[None]

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        inside = self.curve.within(state.q)
        by_q = self._resistance(inside, 1) * state.q_dot
        return strengths[0] * by_q, strengths[0] * self._resistance(inside), 0.0


def _settled(
    effect: TermEffect, where: Mounting, curve: StaticCurve, at: float | None
) -> list[Mounting]:
    """Where an effect is tried; one that may be anywhere at a place that is given, or the usual.

    One that does the same to the first mode as others are is tried at some points: how it bends
    with the amplitude there is what tells it from them.
    """
    if not isinstance(where, AtPoint) or where.at is not None:
        return [where]
    alike = any(effect.name in names for names in FAMILIES.values())
    some = some_points(curve.beam, curve.point) if alike else [curve.point]
    return [replace(where, at=x) for x in (some if at is None else [at])]


def mounted_effects(
    curve: StaticCurve,
    catalogue: Sequence[TermEffect] = BEAM_CATALOGUE,
    places: Mapping[str, float] | None = None,
) -> tuple[MountedEffect, ...]:
    """The effects of a catalogue that can be on this beam, each at its place.

    One that may be anywhere is where ``places`` say, m by name; by default where the first mode
    moves most, and at some other points.
    """
    springs = springs_of(curve.beam)
    found = []
    for effect in catalogue:
        where = effect.mounting
        if isinstance(where, TowardsAnchor) and where.anchor is None:
            if len(springs) != 1:
                continue
            # Other loads may pull towards anchors of their own.
            where = replace(where, at=springs[0].at, anchor=springs[0].mounting.anchor)
        if where is not None:
            at = (places or {}).get(effect.name)
            settled = _settled(effect, where.settled(curve.beam), curve, at)
            found += [MountedEffect(effect, curve, x) for x in settled]
    return tuple(found)
