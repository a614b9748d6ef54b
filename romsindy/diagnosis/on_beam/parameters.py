"""Parameters of a beam as effects: what a change of each does to the reduced equation of motion.

The direction in coefficient space is a difference of two reductions of the beam, that of the
changed one about its own equilibrium and brought to the coordinate of the sensors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from romsindy.beam import Beam, StaticCurve
from romsindy.beam.changes import (
    ClampCompliance,
    ExtraTension,
    HeavierMasses,
    MassDamping,
    MaterialDamping,
    StifferBending,
    StifferSpring,
)
from romsindy.beam.spring import Spring
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import BeamEffect, DampingEffect
from romsindy.effects.base import TermEffect
from romsindy.effects.load import PointMass
from romsindy.effects.mounting import AtPoint, Mounting
from romsindy.physics.combination import Combination
from romsindy.physics.serial import term_from_key

_ORDER = 7
_LEAST = 1e-12  # an effect that must be positive, and is zero
_FAR = 20.0  # steps of a parameter up to which a shift of the frequency is put down to it


@dataclass(frozen=True)
class ParameterEffect(TermEffect, BeamEffect):
    """A parameter of the beam that is another than assumed; the strength is its change.

    The tolerance is the standard deviation of the change, where it is known to be near 0.
    """

    direction: Combination  # what a unit of the change does to the coefficients
    change: type  # what `Beam.with_effect` takes, in one number
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
        pairs = zip(self.direction.terms, self.direction.weights, strict=True)
        weights = {term.key: w for term, w in pairs}
        return weights["omega^2"] - omega2 * weights["mu"]


def _changed(change: Any, value: float, at: float | None) -> Any:
    """A change of the beam; a mass sits where the first mode moves most."""
    return change(value, at) if change is PointMass else change(value)


# name, label, unit, change of the beam, step of the difference, sign
_RELATIVE = "of the assumed one"
_OF_ANY_BEAM = (
    ("bending_stiffness", "another bending stiffness", _RELATIVE, StifferBending, 0.01, 0),
    ("added_mass", "more mass {place}", "kg", PointMass, 1e-4, 1),
    ("clamp_compliance", "a clamp that gives way", "rad/(N m)", ClampCompliance, 1e-3, 1),
)
# Of masses that are there; what is looked for is mass that is not ("added_mass").
_OF_MASSES = (
    ("point_masses", "other point masses", "of the assumed ones", HeavierMasses, 0.01, 0),
)
_OF_A_SPRING = (
    ("spring_stiffness", "another spring stiffness", _RELATIVE, StifferSpring, 0.01, 0),
    ("pre_tension", "another tension in the spring", "N", ExtraTension, 0.01, 0),
)


def damping_effects(curve: StaticCurve) -> tuple[DampingEffect, ...]:
    """The beam's own damping, in proportion to mass and to stiffness."""
    by_mass = "other damping in proportion to mass (alpha) than assumed"
    by_stiffness = "other damping in proportion to stiffness (eta) than assumed"
    longer, second = "a longer decay from a larger amplitude", "a second mode: it damps that more"
    return (
        DampingEffect(curve, MassDamping, "mass_damping", by_mass, "1/s", longer),
        DampingEffect(curve, MaterialDamping, "material_damping", by_stiffness, "s", second),
    )


def parameter_effects(
    seen: InstrumentedBeam, amplitude: float, shift: float = 0.0
) -> tuple[ParameterEffect, ...]:
    """Effects of the parameters that a beam has, up to some coordinate (kg^0.5 m).

    ``shift`` is by how much omega^2 was found to differ, 1/s^2: the differences are taken over the
    change of each parameter that would cause this, so that they are exact there.
    """
    springs = [e for e in seen.beam.effects if isinstance(e, Spring)]
    left, at = seen.beam.left, seen.basis.point(1)
    clamped = left.fixed[2] or left.rotational_stiffness > 0.0
    start = _seen_coefficients(seen, seen.beam, amplitude)
    found = []
    known = _OF_ANY_BEAM + (_OF_A_SPRING if len(springs) == 1 else ())
    if any(isinstance(e, PointMass) for e in seen.beam.effects):
        known += _OF_MASSES
    for name, label, unit, change, step, sign in known:
        if change is ClampCompliance and not clamped:
            continue

        def direction(step: float, name: str = name, change: Any = change) -> Combination:
            changed = seen.beam.with_effect(_changed(change, step, at))
            there = _seen_coefficients(seen, changed, amplitude)
            terms = tuple(term_from_key(key) for key in start)
            return Combination(name, terms, tuple((there[k] - start[k]) / step for k in start))

        place = label.format(place=AtPoint(at).place)
        tangent = ParameterEffect(direction(step), change, name, place, unit, sign, at)
        slope = tangent.linear_shift(start["omega^2"])
        needed = shift / slope if slope else np.inf
        # Steps that the frequency does not ask for stay small.
        chord = step < abs(needed) < _FAR * step and needed * max(sign, 0) >= 0
        found.append(replace(tangent, direction=direction(needed)) if chord else tangent)
    return tuple(found)


def standard_deviations(beam: Beam, tolerances: Mapping[str, float]) -> dict[str, float]:
    """Turn relative standard deviations of parameters of a beam into the units of their effects.

    Raises
    ------
    ValueError
        For a name that is no parameter of the beam, a tolerance that is not positive, or one of a
        parameter that is zero.
    """
    assumed = _assumed(beam)
    for name, relative in tolerances.items():
        if name not in assumed:
            raise ValueError(f"tolerances name {name!r}: this beam has {sorted(assumed)}")
        if not relative > 0:
            raise ValueError(f"tolerances[{name!r}] = {relative!r} must be positive (relative)")
        if assumed[name] == 0:
            raise ValueError(
                f"tolerances name {name!r}, which is 0 in this beam: a part of it is 0 as well;"
                " leave it out, so that it is looked for"
            )
    return {name: relative * assumed[name] for name, relative in tolerances.items()}


def _assumed(beam: Beam) -> dict[str, float]:
    """What a beam assumes of the parameters that a tolerance can be of, in their units."""
    sizes = {"bending_stiffness": 1.0, "mass_damping": beam.alpha, "material_damping": beam.eta}
    if any(isinstance(e, PointMass) for e in beam.effects):
        sizes["point_masses"] = 1.0
    springs = [e for e in beam.effects if isinstance(e, Spring)]
    if len(springs) == 1:
        (spring,) = springs
        at = beam.length if spring.at is None else spring.at
        stretch = spring.mounting.span(at, 0.0) - spring.natural_length
        sizes |= {"spring_stiffness": 1.0, "pre_tension": abs(spring.stiffness * stretch)}
    return sizes


def _seen_coefficients(seen: InstrumentedBeam, beam: Beam, amplitude: float) -> dict[str, float]:
    """Coefficients of a reduced beam in the coordinate that the sensors show."""
    modes = seen.shapes.shape[1]
    shapes = seen.sensors.mode_shapes(beam.modes(count=modes), modes)
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
