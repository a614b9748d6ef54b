"""Parameters of a beam as effects: what a change of each does to the reduced equation of motion.

The direction in coefficient space is a difference of two reductions of the beam, that of the
changed one about its own equilibrium and brought to the coordinate of the sensors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from romsindy.beam import Beam
from romsindy.beam import effects as on_beam
from romsindy.beam.effects.spring import find_spring
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam, place_in_words
from romsindy.effects.base import TermEffect
from romsindy.physics.force_laws import term_from_key
from romsindy.physics.terms import Scalars, Term, WeakForm
from romsindy.typing import Array

_ORDER = 7
_LEAST = 1e-12  # an effect that must be positive, and is zero
_FAR = 20.0  # steps of a parameter up to which a shift of the frequency is put down to it


@dataclass(frozen=True)
class Stiffer(on_beam.Effect):
    """A relative change of the bending stiffness."""

    change: float

    def applied_to(self, beam: Beam) -> Beam:
        """Return `beam` with another EI."""
        section = replace(beam.section, EI=beam.section.EI * (1 + self.change))
        return replace(beam, section=section)


@dataclass(frozen=True)
class StifferSpring(on_beam.Effect):
    """A relative change of the stiffness of the beam's spring; its natural length stays."""

    change: float

    def applied_to(self, beam: Beam) -> Beam:
        """Return `beam` with another spring."""
        spring = find_spring(beam)
        new = replace(spring, stiffness=spring.stiffness * (1 + self.change))
        return replace(beam, effects=tuple(new if e is spring else e for e in beam.effects))


@dataclass(frozen=True)
class Combination(Term):
    """A weighted sum of terms with one common coefficient."""

    name: str
    terms: tuple[Term, ...]
    weights: tuple[float, ...]

    dimension = (1, -2)

    @property
    def key(self) -> str:
        return self.name

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"d_{self.name}({q}, {q_dot}, {q_ddot})"

    def _sum(self, part: str, *arguments: Scalars) -> Scalars:
        pairs = zip(self.terms, self.weights, strict=True)
        return sum(w * getattr(term, part)(*arguments) for term, w in pairs)

    def linear_shift(self, omega2: float) -> float:
        """Change of omega^2 for a unit of the coefficient."""
        weights = dict(zip((t.key for t in self.terms), self.weights, strict=True))
        return weights["omega^2"] - omega2 * weights["mu"]

    def inertia(self, q: Scalars) -> Scalars:
        return self._sum("inertia", q)

    def convection(self, q: Scalars) -> Scalars:
        return self._sum("convection", q)

    def stiffness(self, q: Scalars) -> Scalars:
        return self._sum("stiffness", q)

    def potential(self, q: Scalars) -> Scalars:
        return self._sum("potential", q)

    def inertia_dq(self, q: Scalars) -> Scalars:
        return self._sum("inertia_dq", q)

    def convection_dq(self, q: Scalars) -> Scalars:
        return self._sum("convection_dq", q)

    def stiffness_dq(self, q: Scalars) -> Scalars:
        return self._sum("stiffness_dq", q)

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self._sum("damping", q, q_dot)

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self._sum("damping_dq_dot", q, q_dot)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """Sum of the weak forms."""
        forms = [(w, t.weak(q, q_dot)) for t, w in zip(self.terms, self.weights, strict=True)]
        columns = [[(w, f[i]) for w, f in forms if f[i] is not None] for i in range(4)]
        return WeakForm(*(sum(w * x for w, x in c) if c else None for c in columns))


@dataclass(frozen=True)
class ParameterEffect(TermEffect):
    """A parameter of the beam that is another than assumed; the strength is its change."""

    direction: Combination
    law: type  # the effect on a beam, which takes the change as its first argument
    name: str  # type: ignore[misc]
    label: str  # type: ignore[misc]
    unit: str  # type: ignore[misc]
    sign: int = 0  # type: ignore[misc]
    at: float | None = None  # where on the beam, of a law that has a place, m

    family = "beam"
    advice = "a second mode, or the equilibrium shape"

    def term(self, shape: Array) -> Term:
        return self.direction

    def beam_effect(self, strength: float, shape: Array) -> on_beam.Effect:
        value = max(strength, _LEAST) if self.sign else strength
        return changed_by(self.law, value, self.at)


def changed_by(law: type, value: float, at: float | None = None) -> Any:
    """The effect on a beam with a strength, at a place where it has one."""
    if law is on_beam.CubicSpring:
        return law(at=at, cubic=value)
    return law(value, at=at) if law is on_beam.AddedMass else law(value)


# name, label, unit, effect on the beam, step of the difference, sign
_OF_ANY_BEAM = (
    ("bending_stiffness", "another bending stiffness", "of the assumed one", Stiffer, 0.01, 0),
    ("added_mass", "more mass at {place}", "kg", on_beam.AddedMass, 1e-4, 1),
    ("clamp_compliance", "a clamp that gives way", "rad/(N m)", on_beam.ClampCompliance, 1e-3, 1),
    ("cubic_stiffness", "a cubic spring at {place}", "N/m^3", on_beam.CubicSpring, 100.0, 0),
)
_OF_A_SPRING = (
    ("spring_stiffness", "another spring stiffness", "of the assumed one", StifferSpring, 0.01, 0),
    ("pre_tension", "another tension in the spring", "N", on_beam.ExtraTension, 0.01, 0),
)


def parameter_effects(
    seen: InstrumentedBeam, amplitude: float, shift: float = 0.0
) -> tuple[ParameterEffect, ...]:
    """Effects of the parameters that a beam has.

    Parameters
    ----------
    seen : InstrumentedBeam
        Through its sensors a changed mode shape changes the coordinate.
    amplitude : float
        Largest coordinate, kg^0.5 m.
    shift : float
        By how much omega^2 was found to differ, 1/s^2: the differences are taken over the change
        of each parameter that would cause this, so that they are exact there.
    """
    springs = [e for e in seen.beam.effects if isinstance(e, on_beam.Spring)]
    start = _seen_coefficients(seen, seen.beam, amplitude)
    at = seen.basis.point(1)
    found = []
    left = seen.beam.left
    clamped = left.fixed[2] or left.rotational_stiffness > 0.0
    known = _OF_ANY_BEAM + (_OF_A_SPRING if len(springs) == 1 else ())
    for name, label, unit, law, step, sign in known:
        if law is on_beam.ClampCompliance and not clamped:
            continue

        def direction(step: float, name: str = name, law: type = law) -> Combination:
            changed = seen.beam.with_effect(changed_by(law, step, at))
            there = _seen_coefficients(seen, changed, amplitude)
            return _direction(name, start, there, step)

        tangent = direction(step)
        slope = tangent.linear_shift(start["omega^2"])
        needed = shift / slope if slope else np.inf
        # Steps that the frequency does not ask for stay small.
        chord = step < abs(needed) < _FAR * step and needed * max(sign, 0) >= 0
        chosen = direction(needed) if chord else tangent
        text = label.format(place=place_in_words(at))
        found.append(ParameterEffect(chosen, law, name, text, unit, sign, at))
    return tuple(found)


def _direction(
    name: str, start: Mapping[str, float], there: Mapping[str, float], step: float
) -> Combination:
    terms = tuple(term_from_key(key) for key in start)
    return Combination(name, terms, tuple((there[key] - start[key]) / step for key in start))


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
