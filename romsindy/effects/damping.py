"""Effects that take energy out of the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from romsindy.effects.base import (
    Scales,
    Shape,
    State,
    TermEffect,
    mean_sign,
    mean_sign_slope,
)
from romsindy.physics.force_laws import (
    AmplitudePowerDamping,
    HystereticDamping,
    PowerDamping,
    RubbingDamping,
)
from romsindy.physics.terms import CoulombDamping, LinearDamping, Term
from romsindy.typing import Array


class Viscous(TermEffect):
    """A wrong coefficient of viscous damping."""

    name, family = "viscous", "damping"
    label = "other viscous damping than assumed"

    def term(self, shape: Array) -> Term:
        return LinearDamping()


class QuadraticDrag(TermEffect):
    """Air drag."""

    name, family, sign = "quadratic_drag", "damping", 1
    label = "air drag proportional to speed squared"
    advice = "a decay from a larger amplitude, or one in thinner air"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        return (Shape.near("exponent", 2.0, 0.07),)

    def term(self, shape: Array) -> Term:
        return PowerDamping(float(shape[0]))


class CubicDamping(TermEffect):
    """Damping with the cube of speed."""

    name, family, sign = "cubic_damping", "damping", 1
    label = "damping proportional to speed cubed"
    advice = "a decay from a larger amplitude: the third harmonic decides"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        return (Shape.near("exponent", 3.0, 0.07),)

    def term(self, shape: Array) -> Term:
        return PowerDamping(float(shape[0]))


class AmplitudeDamping(TermEffect):
    """Viscous damping that grows with displacement."""

    name, family, sign = "amplitude_damping", "damping", 1
    label = "damping q^2 q_dot that grows with displacement"
    advice = "a decay from a larger amplitude: the third harmonic decides"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        return (Shape.near("exponent", 2.0, 0.07),)

    def term(self, shape: Array) -> Term:
        return AmplitudePowerDamping(float(shape[0]))


class _Jumping(TermEffect):
    """Forces that change sign with the velocity, spread over a step in time."""

    def size(self, state: State, shape: Array) -> Array:
        return np.ones_like(state.q)

    def size_dq(self, state: State, shape: Array) -> Array:
        return np.zeros_like(state.q)

    def forces(self, state: State, shape: Array) -> Array:
        sign = mean_sign(state.q_dot, state.q_ddot * state.step / 3)
        return (self.size(state, shape) * sign)[None]

    def slopes(self, state: State, shape: Array, strengths: Array) -> tuple[Any, Any, Any]:
        turn = state.q_ddot * state.step / 3
        by_q = self.size_dq(state, shape) * mean_sign(state.q_dot, turn)
        by_q_dot = self.size(state, shape) * mean_sign_slope(state.q_dot, turn)
        return strengths[0] * by_q, strengths[0] * by_q_dot, 0.0


class DryFriction(_Jumping):
    """Coulomb friction."""

    name, family, sign = "dry_friction", "damping", 1
    label = "dry friction"
    advice = "a decay followed to smaller amplitudes, where friction stops the motion"

    def term(self, shape: Array) -> Term:
        return CoulombDamping()


class Hysteretic(_Jumping):
    """Loss of a fixed part of the energy, whatever the frequency."""

    name, family, sign = "hysteretic", "damping", 1
    label = "hysteretic (structural) damping"
    advice = "decays at another frequency, with a mass added"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        return (Shape.near("exponent", 1.0, 0.04),)

    def term(self, shape: Array) -> Term:
        return HystereticDamping(float(shape[0]))

    def size(self, state: State, shape: Array) -> Array:
        return np.abs(state.q) ** shape[0]

    def size_dq(self, state: State, shape: Array) -> Array:
        return shape[0] * np.abs(state.q) ** (shape[0] - 1) * np.sign(state.q)


@dataclass(frozen=True)
class Rubbing(_Jumping):
    """Friction on one side of a position."""

    side: int = 1

    name, family, sign = "rubbing", "damping", 1
    label = "rubbing on one side"
    advice = "a second sensor next to the suspected contact"

    @property
    def variant(self) -> str:
        return "above" if self.side > 0 else "below"

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        a = scales.amplitude
        return (Shape("gap", (0.0, 0.03 * a, -0.03 * a), -0.2 * a, 0.2 * a, 0.05 * a, unit="q"),)

    def term(self, shape: Array) -> Term:
        return RubbingDamping(float(shape[0]), self.side)

    def size(self, state: State, shape: Array) -> Array:
        beyond = self.side * (state.q - shape[0])
        return 0.5 + 0.5 * mean_sign(beyond, state.q_dot * state.step / 3)

    def size_dq(self, state: State, shape: Array) -> Array:
        beyond = self.side * (state.q - shape[0])
        return 0.5 * self.side * mean_sign_slope(beyond, state.q_dot * state.step / 3)
