"""Parameters of a beam as effects: what a change of each does to the reduced equation of motion.

The direction in coefficient space is a difference of two reductions of the beam, that of the
changed one about its own equilibrium and brought to the coordinate of the sensors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from romsindy.beam import Beam
from romsindy.beam import effects as on_beam
from romsindy.beam.effects.spring import find_spring
from romsindy.beam.sensors import SensorArray
from romsindy.diagnosis.effects import TermEffect
from romsindy.force_laws import term_from_key
from romsindy.terms import Scalars, Term, WeakForm
from romsindy.typing import Array

_ORDER = 7


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
    sign: int = 0  # type: ignore[misc]

    family = "beam"
    advice = "a second mode, or the equilibrium shape"

    def term(self, shape: Array) -> Term:
        return self.direction

    def beam_effect(self, coefficient: float) -> Any:
        return changed_by(self.law, coefficient)


def changed_by(law: type, value: float) -> Any:
    """The effect on a beam with a strength."""
    return law(cubic=value) if law is on_beam.CubicSpring else law(value)


# name, label, effect on the beam, step of the difference, sign
_OF_ANY_BEAM = (
    ("bending_stiffness", "another bending stiffness (relative change)", Stiffer, 0.01, 0),
    ("added_mass", "more mass at the tip (kg)", on_beam.AddedMass, 1e-4, 1),
    ("clamp_compliance", "a clamp that gives way (rad/(N m))", on_beam.ClampCompliance, 1e-3, 1),
    ("cubic_stiffness", "a cubic spring at the tip (N/m^3)", on_beam.CubicSpring, 100.0, 0),
)
_OF_A_SPRING = (
    ("spring_stiffness", "another spring stiffness (relative change)", StifferSpring, 0.01, 0),
    ("pre_tension", "another tension in the spring (N)", on_beam.ExtraTension, 0.01, 0),
)


def parameter_effects(
    beam: Beam, sensors: SensorArray, amplitude: float
) -> tuple[ParameterEffect, ...]:
    """Effects of the parameters that a beam has.

    Parameters
    ----------
    beam : Beam
    sensors : SensorArray
        Through which the coordinate is seen, which a changed mode shape changes.
    amplitude : float
        Largest coordinate, kg^0.5 m.
    """
    springs = [e for e in beam.effects if isinstance(e, on_beam.Spring)]
    start = _seen_coefficients(beam, beam, sensors, amplitude)
    found = []
    for name, label, law, step, sign in _OF_ANY_BEAM + (_OF_A_SPRING if len(springs) == 1 else ()):
        changed = beam.with_effect(changed_by(law, step))
        there = _seen_coefficients(beam, changed, sensors, amplitude)
        direction = _direction(name, start, there, step)
        found.append(ParameterEffect(direction, law, name, label, sign))
    return tuple(found)


def _direction(
    name: str, start: Mapping[str, float], there: Mapping[str, float], step: float
) -> Combination:
    terms = tuple(term_from_key(key) for key in start)
    return Combination(name, terms, tuple((there[key] - start[key]) / step for key in start))


def _seen_coefficients(
    nominal: Beam, beam: Beam, sensors: SensorArray, amplitude: float
) -> dict[str, float]:
    """Coefficients of the reduced beam in the coordinate that the nominal mode shapes give."""
    modes = projected_modes(len(sensors.sensors))
    seen = sensors.mode_shapes(beam.modes(count=modes), modes)
    used = sensors.mode_shapes(nominal.modes(count=modes), modes)
    scale = float((np.linalg.pinv(used) @ seen)[0, 0])
    model = beam.reduce(order=_ORDER, amplitude=amplitude)
    return {
        key: value if key == "omega^2" else value * scale ** (1 - int(key.split("_")[1]))
        for key, value in model.coefficients.items()
    }


def projected_modes(n_sensors: int) -> int:
    """Modes that so many sensors tell apart, with some sensors to spare."""
    return max(1, min(2, n_sensors - 2))


def without(catalogue: Sequence[Any], names: Sequence[str]) -> tuple[Any, ...]:
    """A catalogue without what the beam explains in its own way."""
    return tuple(e for e in catalogue if e.name not in names)
