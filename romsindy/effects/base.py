"""What an effect is: something that a simulation may lack, with its strength and its shape.

The contract for a new effect, one small class with ``name``, ``label``, ``family``:

* an effect on the motion derives from `TermEffect` and returns its `Term` for given shape values;
* an effect that knows the time derives from `TimedEffect` (``pull``);
* an effect of the sensor derives from `ReadingEffect` (``shown``).

All are linear in their strengths. Shape values (exponents, gaps, frequencies) have starting
values, limits and a prior. ``sign`` = 1 says that a negative strength is unphysical.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from romsindy.physics.terms import Term
from romsindy.typing import Array


class State(NamedTuple):
    """Where the motion is, (n,) each; ``t`` from the start of the record, ``step`` between them."""

    t: Array
    q: Array
    q_dot: Array
    q_ddot: Array
    step: float


class Scales(NamedTuple):
    """What shapes are measured by: largest amplitude, rad/s, s, and spectral lines (rad/s)."""

    amplitude: float
    omega: float
    duration: float
    tones: tuple[float, ...] = ()


@dataclass(frozen=True)
class Shape:
    """A shape value of an effect.

    Attributes
    ----------
    name : str
    starts : tuple of float
        Values to screen.
    low, high : float
        Limits.
    spread : float or None
        Standard deviation of the prior about ``starts[0]``; None: any value within the limits.
    reach : float or None
        How far a fit may go from the value that it starts from.
    unit : str
        "q" stands for the unit of the coordinate.
    """

    name: str
    starts: tuple[float, ...]
    low: float
    high: float
    spread: float | None = None
    reach: float | None = None
    unit: str = ""

    def from_start(self, start: float) -> Shape:
        """The same with the limits of a fit that starts from one of the values."""
        if self.reach is None:
            return self
        low, high = max(self.low, start - self.reach), min(self.high, start + self.reach)
        return replace(self, low=low, high=high)

    @classmethod
    def near(cls, name: str, value: float, spread: float) -> Shape:
        """A value known to a standard deviation."""
        return cls(name, (value,), value - 4 * spread, value + 4 * spread, spread)


class Effect(ABC):
    """Something that a simulation may lack."""

    name: ClassVar[str]
    label: ClassVar[str]  # as an engineer says it
    family: ClassVar[str]  # damping, stiffness, inertia, time, outside, measurement
    sign: ClassVar[int] = 0
    n_strengths: ClassVar[int] = 1
    per_record: ClassVar[bool] = False  # strengths differ from record to record
    unit: ClassVar[str] = ""  # of the strength, where it does not follow from the term
    advice: ClassVar[str] = "a longer decay from a larger amplitude"

    @property
    def variant(self) -> str:
        """What tells apart effects of the same name, such as the side of a stop."""
        return ""

    def shapes(self, scales: Scales) -> tuple[Shape, ...]:
        """Shape values."""
        return ()

    def forces(self, state: State, shape: Array) -> Array | None:
        """Additions to the left side of the equation for unit strengths, (n_strengths, n)."""
        return None

    def slopes(self, state: State, shape: Array, strengths: Array) -> tuple[Any, Any, Any]:
        """Derivatives of the force with respect to q, q_dot, q_ddot."""
        return 0.0, 0.0, 0.0

    def readings(self, t: Array, q: Array, shape: Array) -> Array | None:
        """Additions to what the sensor shows for unit strengths, (n_strengths, n)."""
        return None

    def reading_slopes(self, t: Array, q: Array, shape: Array) -> Array:
        """Derivatives of the readings with respect to q."""
        return np.zeros((self.n_strengths, len(q)))

    def term(self, shape: Array) -> Term | None:
        """The term that it adds to a `ReducedModel`, where it can be one."""
        return None

    def beam_effect(self, strength: float, shape: Array) -> Any:
        """What the beam is given, by `Beam.with_effect`; None where there is no counterpart."""
        return None


class TermEffect(Effect):
    """An effect that is a `Term` of the equation of motion."""

    @abstractmethod
    def term(self, shape: Array) -> Term:
        """The term for given shape values."""

    def forces(self, state: State, shape: Array) -> Array:
        """The term in its strong form."""
        value = self.term(shape).strong(state.q, state.q_dot, state.q_ddot)
        return np.atleast_2d(np.broadcast_to(value, state.q.shape))

    def slopes(self, state: State, shape: Array, strengths: Array) -> tuple[Any, Any, Any]:
        """Derivatives of the term."""
        term, s = self.term(shape), strengths[0]
        _, q, q_dot, q_ddot, _ = state
        by_q = (
            term.inertia_dq(q) * q_ddot
            + term.convection_dq(q) * q_dot**2
            + term.stiffness_dq(q)
            + term.damping_dq(q, q_dot)
        )
        by_q_dot = 2 * term.convection(q) * q_dot + term.damping_dq_dot(q, q_dot)
        return s * by_q, s * by_q_dot, s * term.inertia(q)


class TimedEffect(Effect):
    """A force that knows the time."""

    @abstractmethod
    def pull(self, t: Array, q: Array, shape: Array) -> Array:
        """Additions to the left side of the equation, (n_strengths, n)."""

    def pull_dq(self, t: Array, q: Array, shape: Array) -> Array:
        """Derivative of `pull` with respect to q."""
        return np.zeros((self.n_strengths, len(q)))

    def forces(self, state: State, shape: Array) -> Array:
        """The pull at the times of the state."""
        return self.pull(state.t, state.q, shape)

    def slopes(self, state: State, shape: Array, strengths: Array) -> tuple[Any, Any, Any]:
        """It depends on q alone."""
        return strengths @ self.pull_dq(state.t, state.q, shape), 0.0, 0.0


class ReadingEffect(Effect):
    """A fault of the sensor, or what reaches it beside the motion."""

    family = "measurement"

    @abstractmethod
    def shown(self, t: Array, q: Array, shape: Array) -> Array:
        """Additions to the reading, (n_strengths, n)."""

    def shown_dq(self, t: Array, q: Array, shape: Array) -> Array:
        """Derivative of `shown` with respect to q."""
        return np.zeros((self.n_strengths, len(q)))

    def readings(self, t: Array, q: Array, shape: Array) -> Array:
        """What is shown beside q."""
        return self.shown(t, q, shape)

    def reading_slopes(self, t: Array, q: Array, shape: Array) -> Array:
        """Derivatives of what is shown."""
        return self.shown_dq(t, q, shape)


def mean_sign(x: Array, change: Array) -> Array:
    """Sign of x averaged over x - change to x + change: a jump spread over a step in time."""
    change = np.maximum(np.abs(change), 1e-12 * np.max(np.abs(x)) + 1e-300)
    return np.clip(x / change, -1.0, 1.0)


def mean_sign_slope(x: Array, change: Array) -> Array:
    """Derivative of `mean_sign` with respect to x."""
    change = np.maximum(np.abs(change), 1e-12 * np.max(np.abs(x)) + 1e-300)
    return (np.abs(x) < change) / change
