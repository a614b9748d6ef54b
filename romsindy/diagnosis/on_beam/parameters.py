"""Parameters of a beam as effects: what a change of each does to the reduced equation of motion.

The direction in coefficient space is a difference of two reductions of the beam, that of the
changed one about its own equilibrium and brought to the coordinate of the sensors. Effects that can
be anywhere, such as a mass, do the same to the first mode elsewhere with another strength.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np

from romsindy.beam import changes
from romsindy.beam.beam import Beam
from romsindy.beam.static_shapes import StaticCurve
from romsindy.beam.structure import FREE, springs_of
from romsindy.diagnosis.evidence import Amended, Hypothesis, Solved
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import (
    BeamEffect,
    DampingEffect,
    MountedEffect,
    PlaceOnBeam,
    some_points,
)
from romsindy.effects.base import Effect, State, TermEffect
from romsindy.effects.mounting import AtPoint, Mounting, PointMass
from romsindy.fit.kernel.linear_response import sampled
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.physics.term import Combination
from romsindy.physics.term_sum import term_from_key
from romsindy.typing import Array

_ORDER = 7
_LEAST = 1e-12  # an effect that must be positive, and is zero
# Tolerances of positions are in m, all others relative.
POSITIONS = ("sensor_positions", "anchor_x", "anchor_y")
_FAR = 20.0  # steps of a parameter up to which a shift of the frequency is put down to it


class _Varied(NamedTuple):
    """A parameter of a beam: names, unit, and what changes the beam by one number.

    ``step`` is that of the difference; ``sign`` = 1 says that it can but grow.
    """

    name: str
    label: str
    unit: str
    change: Any
    step: float = 0.01
    sign: int = 0


_OF_ASSUMED = "of the assumed one"
_SECTION = (
    _Varied("bending_stiffness", "another bending stiffness", _OF_ASSUMED, changes.StifferBending),
    _Varied("length", "another length", _OF_ASSUMED, changes.Longer, 2e-3),
    _Varied("thickness", "another thickness", _OF_ASSUMED, changes.Thicker),
    _Varied("density", "another density", _OF_ASSUMED, changes.Denser),
)
# Of a beam with a free end it is but another bending stiffness.
_MATERIAL = (_Varied("modulus", "another modulus", _OF_ASSUMED, changes.StifferMaterial),)
# Told from the others by nothing, or only by what stretches or hangs on the beam.
_ALIKE = (
    _Varied("width", "another width", _OF_ASSUMED, changes.Wider),
    _Varied("axial_stiffness", "another axial stiffness", _OF_ASSUMED, changes.StifferAxially),
)
PLACED_MASS = "added_mass"
_MASS = (_Varied(PLACED_MASS, "more mass {place}", "kg", PointMass, 1e-4, 1),)
_CLAMP = (
    _Varied(
        "clamp_compliance", "a clamp that gives way", "rad/(N m)", changes.ClampCompliance, 1e-3, 1
    ),
)
_SPRING = (
    _Varied("spring_stiffness", "another spring stiffness", _OF_ASSUMED, changes.StifferSpring),
    _Varied("pre_tension", "another tension in the spring", "N", changes.ExtraTension),
)
_ANCHOR = (
    _Varied("anchor_x", "an anchor farther along the beam", "m", changes.FartherAnchor, 1e-3),
    _Varied("anchor_y", "a higher anchor", "m", changes.HigherAnchor, 1e-3),
)
# Of masses that are there; what is looked for is mass that is not ("added_mass").
_MASSES = (
    _Varied("point_masses", "other point masses", "of the assumed ones", changes.HeavierMasses),
)
_ROTARY = (
    _Varied(
        "rotary_inertia",
        "another rotary inertia of the point masses",
        "of the assumed one",
        changes.HeavierRotation,
    ),
)


@dataclass(frozen=True)
class ParameterEffect(TermEffect, BeamEffect):
    """A parameter of the beam that is another than assumed; the strength is its change.

    ``direction`` is what a unit of ``change`` does to the coefficients, ``at`` is where a point
    mass sits, ``tolerance`` the standard deviation of a change that is known to be near 0.
    """

    direction: Combination
    change: Any
    name: str  # type: ignore[misc]
    label: str  # type: ignore[misc]
    fixed_unit: str  # type: ignore[misc]
    sign: int = 0  # type: ignore[misc]
    at: float | None = None  # where a point mass is, m
    tolerance: float | None = None  # type: ignore[misc]

    family = "beam"
    advice = "a second mode, or the equilibrium shape"

    def term(self) -> Combination:
        return self.direction

    def on_beam(self, strength: float, mounting: Mounting | None = None) -> Any:
        return _changed(self.change, max(strength, _LEAST) if self.sign else strength, self.at)

    def linear_shift(self, omega2: float) -> float:
        """Change of omega^2 for a unit of the parameter."""
        keys = (term.key for term in self.direction.terms)
        weights = dict(zip(keys, self.direction.weights, strict=True))
        return weights["omega^2"] - omega2 * weights["mu"]


def _changed(change: Any, value: float, at: float | None) -> Any:
    """A change of the beam; a mass sits where the first mode moves most."""
    return change(value, at) if change is PointMass else change(value)


def damping_effects(curve: StaticCurve) -> tuple[DampingEffect, ...]:
    """The beam's own damping, in proportion to mass and to stiffness."""
    by_mass = "other damping in proportion to mass (alpha) than assumed"
    by_stiffness = "other damping in proportion to stiffness (eta) than assumed"
    longer, second = "a longer decay from a larger amplitude", "a second mode: it damps that more"
    alpha, eta = -curve.beam.alpha, -curve.beam.eta
    return (
        DampingEffect(curve, changes.MassDamping, "mass_damping", by_mass, "1/s", longer, alpha),
        DampingEffect(
            curve, changes.MaterialDamping, "material_damping", by_stiffness, "s", second, eta
        ),
    )


def that_do_the_same(beam: Beam) -> frozenset[str]:
    """Parameters that nothing tells apart: of a beam alone only E / rho says how it moves.

    Springs and masses on it, and clamps that give way, have a stiffness or a mass of their own.
    """
    if beam.effects or beam.left.rotational_stiffness or beam.right.rotational_stiffness:
        return frozenset()
    return frozenset({"density", "modulus" if any(beam.right.fixed) else "bending_stiffness"})


def parameter_effects(
    seen: InstrumentedBeam,
    amplitude: float,
    shift: float = 0.0,
    names: Collection[str] | None = None,
    at: float | None = None,
) -> tuple[ParameterEffect, ...]:
    """Effects of the parameters that a beam has, up to some coordinate (kg^0.5 m).

    ``shift`` is by how much omega^2 was found to differ, 1/s^2: the differences are taken over the
    change of each parameter that would cause this, so that they are exact there. Without
    ``names``, those that are looked for where nothing is said about them. Mass is added at ``at``,
    m; by default where the first mode moves most, and at some other `points`.
    """
    start = seen_coefficients(seen, seen.beam, amplitude)

    def effect(p: _Varied, step: float, at: float | None) -> ParameterEffect:
        changed = seen.beam.with_effect(_changed(p.change, step, at))
        there = seen_coefficients(seen, changed, amplitude)
        slopes = tuple((there[key] - start[key]) / step for key in start)
        direction = Combination(p.name, tuple(map(term_from_key, start)), slopes)
        label = p.label.format(place=AtPoint(at).place)
        return ParameterEffect(direction, p.change, p.name, label, p.unit, p.sign, at)

    found = []
    known = _looked_for(seen.beam) if names is None else _parameters_of(seen.beam)
    # Mass resists otherwise where the beam turns than where it shifts: one column for each place.
    places = some_points(seen.beam, seen.basis.point(1)) if at is None else [at]
    chosen = [p for p in known if names is None or p.name in names]
    tried = [(p, where) for p in chosen for where in (places if p in _MASS else places[:1])]
    for p, where in tried:
        tangent = effect(p, p.step, where)
        slope = tangent.linear_shift(start["omega^2"])
        needed = shift / slope if slope else np.inf
        # Steps that the frequency does not ask for stay small.
        chord = p.step < abs(needed) < _FAR * p.step and needed * max(p.sign, 0) >= 0
        found.append(effect(p, needed, where) if chord else tangent)
    return tuple(found)


def _looked_for(beam: Beam) -> tuple[_Varied, ...]:
    """Parameters that are looked for as if they were missing effects."""
    clamped = beam.left.fixed[2] or beam.left.rotational_stiffness > 0.0
    return (
        *_SECTION,
        *(_MATERIAL if beam.right != FREE else ()),
        *_MASS,
        *(_CLAMP if clamped else ()),
        *(_SPRING if len(springs_of(beam)) == 1 else ()),
    )


def _parameters_of(beam: Beam) -> tuple[_Varied, ...]:
    """All parameters of a beam."""
    return (
        *_looked_for(beam),
        *(_MATERIAL if beam.right == FREE else ()),
        *_ALIKE,
        *(_ANCHOR if len(springs_of(beam)) == 1 else ()),
        *(_MASSES if _masses(beam) else ()),
        *(_ROTARY if any(m.rotary_inertia for m in _masses(beam)) else ()),
    )


def _masses(beam: Beam) -> list[PointMass]:
    return [e for e in beam.effects if isinstance(e, PointMass)]


def standard_deviations(beam: Beam, tolerances: Mapping[str, float]) -> dict[str, float]:
    """Turn standard deviations of parameters of a beam into the units of their effects.

    Those of sizes are relative, those of positions (`POSITIONS`) in m, that of a clamp that was
    taken as rigid in rad/(N m).

    Raises a ValueError for a name that is no parameter of the beam, a tolerance that is not
    positive, or one of a parameter that is zero.
    """
    sizes = _sizes(beam)
    for name, tolerance in tolerances.items():
        if name not in sizes:
            raise ValueError(f"tolerances name {name!r}: this beam has {sorted(sizes)}")
        if not 0 < tolerance < np.inf:
            kind = "in m" if name in POSITIONS else "relative"
            raise ValueError(f"tolerances of {name} = {tolerance!r} must be positive ({kind})")
        if sizes[name] == 0:
            raise ValueError(
                f"tolerances name {name!r}, which is 0 in this beam: a part of it is 0 as well;"
                " leave it out, so that it is looked for"
            )
    return {name: tolerance * sizes[name] for name, tolerance in tolerances.items()}


def _sizes(beam: Beam) -> dict[str, float]:
    """What a tolerance of 1 is of every parameter, in the unit of its effect."""
    sizes = dict.fromkeys((p.name for p in _parameters_of(beam) if p.name != PLACED_MASS), 1.0)
    sizes |= {"mass_damping": beam.alpha, "material_damping": beam.eta, "sensor_positions": 1.0}
    if beam.left.rotational_stiffness > 0.0:
        sizes["clamp_compliance"] = 1.0 / beam.left.rotational_stiffness
    if len(springs_of(beam)) == 1:
        (spring,) = springs_of(beam)
        at = beam.length if spring.at is None else spring.at
        stretch = spring.mounting.span(at, 0.0) - spring.natural_length
        sizes["pre_tension"] = abs(spring.stiffness * stretch)
    return sizes


def seen_coefficients(seen: InstrumentedBeam, beam: Beam, amplitude: float) -> dict[str, float]:
    """Coefficients of a reduced beam in the coordinate that the sensors show."""
    modes = seen.shapes.shape[1]
    shapes = seen.sensors_on(beam).mode_shapes(beam.modes(count=modes), modes)
    scale = float(seen.coordinate(shapes[:, 0]))
    # In the coordinate that is seen the modal mass is 1 / scale^2; with it kept, and not divided
    # by, a mass changes the inertia alone.
    mass = scale**-2
    model = beam.reduce(order=_ORDER, amplitude=amplitude).coefficients
    found = {
        key: mass * (value if key == "omega^2" else value * scale ** (1 - int(key.split("_")[1])))
        for key, value in model.items()
    }
    damping = beam.alpha + beam.eta * model["omega^2"]
    return {"mu": mass - 1.0, "c_linear": mass * damping, **found}


TOLD = 1.96  # standard errors of a strength to either side


def can_be_anywhere(effect: Effect) -> bool:
    """Whether an effect acts at one point, which was not given."""
    if isinstance(effect, MountedEffect):
        usual = effect.effect.mounting
        return isinstance(usual, AtPoint) and usual.at is None
    return isinstance(effect, ParameterEffect) and effect.change is PointMass


def place_now(seen: InstrumentedBeam, effect: Effect) -> float:
    """Where an effect that can be anywhere is taken to act, m."""
    at = effect.mounting.at if isinstance(effect, MountedEffect) else effect.at  # type: ignore[attr-defined]
    return seen.beam.length if at is None else float(at)


def where(part: Part) -> str:
    """Where an effect that can be anywhere is taken to act, as its label says it."""
    effect = part.effect
    mounting = effect.mounting if isinstance(effect, MountedEffect) else AtPoint(effect.at)  # type: ignore[attr-defined]
    return str(mounting.place)


def moved_to(seen: InstrumentedBeam, part: Part, at: float, record: Record) -> Part:
    """An effect elsewhere, where it does the same to the first mode in a record.

    One at the end of the beam stays there where the beam is shorter than was said.
    """
    effect, strength = part.effect, float(part.strengths[0, 0])
    end = None if at == seen.beam.length else at
    if isinstance(effect, ParameterEffect):
        squared = (_lift(seen, effect.at) / _lift(seen, at)) ** 2
        weights = tuple(w / squared for w in effect.direction.weights)
        there = replace(effect, at=end, direction=replace(effect.direction, weights=weights))
        return replace(part, effect=there, strengths=part.strengths * squared)
    effect = cast(MountedEffect, effect)
    mounting = cast(AtPoint, effect.mounting)
    ratio = _lift(seen, at) / _lift(seen, mounting.at)
    metres = {p.name: effect.value(p.name) * ratio for p in part.parameters if p.unit == "m"}
    other = replace(effect.shaped(metres), mounting=replace(mounting, at=end))
    q, q_dot, q_ddot = (sampled(record.motion, k)[:, 0] for k in range(3))
    state = State(record.t, q, q_dot, q_ddot, record.motion.grid.step)
    here, elsewhere = effect.forces(state)[0], other.forces(state)[0]
    share = strength * float(here @ elsewhere) / float(elsewhere @ elsewhere)
    return replace(part, effect=other, strengths=np.array([[share]]))


def _lift(seen: InstrumentedBeam, at: float | None) -> float:
    """Transverse size of the first mode at a point."""
    return float(np.vdot(seen.beam.point_load((0.0, 1.0), at=at), seen.basis.shape(1)))


@dataclass(frozen=True)
class NearPlace(Amended):
    """What a fit says of its values, with the error of the place where one of its effects acts."""

    own: slice  # values of that effect
    moved: Array  # what they change by where it acts a standard error farther

    def amended(self, found: Solved) -> Solved:
        covariance = found.covariance.copy()
        covariance[self.own, self.own] += np.outer(self.moved, self.moved)
        return found._replace(covariance=covariance)


def with_error_of_place(
    seen: InstrumentedBeam, best: Hypothesis, place: PlaceOnBeam, record: Record
) -> tuple[Hypothesis, PlaceOnBeam]:
    """The same with errors of the values of its one effect that hold wherever it may act.

    Where the place is not told they are those at the place that was taken, and the place says how
    strong the effect is at its ends.
    """
    rows = zip(best.parts, best.solution.slices(), strict=True)
    part, own = next(
        (p, own) for p, own in rows if can_be_anywhere(p.effect) and np.any(p.strengths)
    )
    low, high = (moved_to(seen, part, at, record).values for at in (place.low, place.high))
    # Further apart by what the strength is unsure of at either end.
    error = float(best.covariance[own, own][0, 0]) ** 0.5
    unsure = TOLD * error / abs(float(part.values[0]))
    ends = np.array([low[0], high[0]])
    ends += unsure * np.abs(ends) * ([-1, 1] if low[0] < high[0] else [1, -1])
    place = replace(place, strengths=(float(ends[0]), float(ends[1])))
    if not place.told:
        return best, place
    # A place lies within its interval in about 19 of 20 trials, whatever its likelihood says; and
    # how strong an effect is at either end, in no proportion.
    moved = max((x - part.values for x in (low, high)), key=lambda x: abs(x[0])) / TOLD
    return replace(best, weighed=NearPlace(best.weighed, own, moved)), place
