"""What an effect is: something that a simulation may lack, written once.

The contract for a new effect: one small frozen dataclass with ``name``, ``label``, ``family``,
whose fields are its shape values (an exponent, a gap), each with its usual value as default.

* An effect on the motion derives from `TermEffect` and names its ``law``, whose fields of the same
  name it sets (or returns it from `term`); or it derives from a law too, and is its own. From the
  law follow the term of a reduced model, the load on a beam (``mounting``: where on it), the
  candidate of the diagnosis, and its JSON.
* An effect that remembers derives from `romsindy.effects.memory.MemoryEffect` and names a law
  with an inner state, one of `romsindy.physics.memory`.
* An effect that knows the time derives from `TimedEffect` (``pull``).
* An effect of the sensor derives from `ReadingEffect` (`readings`).

All are linear in their strengths. `parameters` says which fields a fit may change, from which
values it starts, their limits and prior. ``sign`` = 1 says that a negative strength is unphysical;
``resembles`` names effects that look alike in one mode and are never judged one without the other.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from romsindy.effects.mounting import AlongBeam, Load, Mounting, Point, PointMass
from romsindy.physics.coupling import Along
from romsindy.physics.damping import Averaged, FrictionLaw
from romsindy.physics.input import Input
from romsindy.physics.memory import Memory
from romsindy.physics.term import Term, side_name, unit_text
from romsindy.typing import Array


class SampledInput(Protocol):
    """A measured input."""

    @property
    def spans(self) -> Sequence[tuple[float, float]]:
        """Begin and end, s, of each hit, if it consists of hits."""

    def at(self, t: Array, term: Input) -> Array:
        """What acts of it, as a term says, at times from the start of the record, (n,)."""

    def of_hits(self, t: Array, term: Input) -> Array:
        """The same of each of its hits alone, (n_hits, n)."""


class State(NamedTuple):
    """Where the motion is, (n,) each; ``t`` from the start of the record, ``step`` between them.

    ``rate`` (rad/s) is that of small vibrations, ``memory`` what an effect remembers of the motion
    before, None where the motion begins; ``clock`` (s) is what the clock of all records shows at
    the start of this one; ``inputs`` are those that were measured, by name. Below the velocity
    ``creep`` friction turns round smoothly.
    """

    t: Array
    q: Array
    q_dot: Array
    q_ddot: Array
    step: float
    rate: float = 1.0
    memory: Memory | None = None
    clock: float = 0.0
    inputs: Mapping[str, SampledInput] | None = None
    creep: float = 0.0
    held: NDArray[np.bool_] | None = None


class Scales(NamedTuple):
    """What parameters are measured by: largest amplitude, rad/s, s, and spectral lines (rad/s).

    ``combs`` are lines that are harmonics of one frequency (rad/s), and how many there may be;
    ``spans`` begin and end of every record, in their order, on the clock that all share (s): none
    where records overlap, as those that all begin at 0 do.
    """

    amplitude: float
    omega: float
    duration: float
    tones: tuple[float, ...] = ()
    combs: tuple[tuple[float, int], ...] = ()
    spans: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Parameter:
    """A shape value of an effect that a fit may change, within the limits ``low`` and ``high``."""

    name: str  # the field of the effect
    starts: tuple[float, ...]  # values to screen
    low: float
    high: float
    spread: float | None = None  # standard deviation of the prior about starts[0]; None: no prior
    reach: float | None = None  # how far a fit may go from the value that it starts from
    unit: str = ""  # "q" stands for the unit of the coordinate

    def from_start(self, start: float) -> Parameter:
        """The same with the limits of a fit that starts from one of the values."""
        if self.reach is None:
            return self
        low, high = max(self.low, start - self.reach), min(self.high, start + self.reach)
        return replace(self, low=low, high=high)

    @classmethod
    def near(cls, name: str, value: float, spread: float) -> Parameter:
        """A value known to a standard deviation."""
        return cls(name, (value,), value - 4 * spread, value + 4 * spread, spread)


class Effect(ABC):
    """Something that a simulation may lack."""

    name: ClassVar[str]
    label: ClassVar[str]  # as an engineer says it
    family: ClassVar[str]  # damping, stiffness, inertia, time, outside, measurement
    formula: ClassVar[str] = ""  # of what it adds, where no law says it
    resembles: ClassVar[tuple[str, ...]] = ()
    sign: ClassVar[int] = 0
    least: ClassVar[float] = -np.inf  # strength of what takes away from something that is there
    start: ClassVar[float] = 0.0  # strength that a fit starts from
    tolerance: ClassVar[float | None] = None  # standard deviation of a strength known to be near 0
    n_strengths: ClassVar[int] = 1
    per_record: ClassVar[bool] = False  # strengths differ from record to record
    n_shared: ClassVar[int] = 0  # so many of them, the first, do not
    acts_on: ClassVar[int] = 0  # number, from 0, of its coordinate among several
    fixed_unit: ClassVar[str] = ""  # of the strength, where it does not follow from the law
    advice: ClassVar[str] = "a longer decay from a larger amplitude"

    @property
    def variant(self) -> str:
        """What tells apart effects of the same name, such as the side of a stop."""
        return side_name(self.side) if hasattr(self, "side") else ""

    @property
    def structural(self) -> bool:
        """Neither in the measurement nor from outside."""
        return self.family not in ("measurement", "outside")

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        """Fields that a fit may change."""
        return ()

    def forms(self, scales: Scales) -> tuple[Effect, ...]:
        """What differs in more than shape values, such as the number of harmonics."""
        return (self,)

    def elsewhere(self, t: Array) -> Effect:
        """The form that it may have in another record, with samples at ``t`` (s)."""
        return self

    def shaped(self, values: Mapping[str, float]) -> Effect:
        """The same with other values of some of its fields."""
        return replace(self, **values) if values else self  # type: ignore[type-var]

    def value(self, name: str) -> float:
        """Present value of a parameter."""
        return float(getattr(self, name))

    def forces(self, state: State) -> Array | None:
        """Additions to the left side of the equation for unit strengths, (n_strengths, n)."""
        return None

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        """Derivatives of the force with respect to q, q_dot, q_ddot."""
        return 0.0, 0.0, 0.0

    def remembered(self, state: State) -> Memory | None:
        """What its force beyond the state depends on, beside the state at its end."""
        return None

    def readings(self, t: Array, q: Array) -> Array | None:
        """Additions to what the sensor shows for unit strengths, (n_strengths, n)."""
        return None

    def reading_slopes(self, t: Array, q: Array) -> Array:
        """Derivatives of the readings with respect to q."""
        return np.zeros((self.n_strengths, len(q)))

    def term(self) -> Term | None:
        """The law that it adds to a `ReducedModel`, where it can be one."""
        return None

    def laws(self) -> tuple[Term, ...]:
        """The terms that it adds to a model, one for each strength; none where it can be none."""
        law = self.term()
        return () if law is None else (law,)

    def strength_unit(self, unit: str | None) -> str:
        """Unit of the strength for a coordinate in ``unit``."""
        law = self.term()
        return self.fixed_unit or ("" if law is None else law.unit(unit))

    def on_beam(self, strength: float, mounting: Mounting | None = None) -> Any:
        """What `Beam.with_effect` takes; None where there is no counterpart on a beam."""
        return None


class TermEffect(Effect):
    """An effect that is a law of the equation of motion."""

    law: ClassVar[Term | None] = None  # the fields of the effect are put in for its own
    mounting: ClassVar[Mounting | None] = None  # where it is looked for on a beam
    spread: ClassVar[float] = 0.0  # standard deviation of its exponent, where that is but a guess

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        """Its exponent, if that is but a guess."""
        textbook = getattr(self, "exponent", 0.0)
        return (Parameter.near("exponent", textbook, self.spread),) if self.spread else ()

    def term(self) -> Term:
        """The law with the fields of the effect; the effect itself, where it derives from one.

        Raises a TypeError if the effect names no law, is none and returns none.
        """
        if self.law is not None:
            shared = {f.name for f in fields(self.law)} & vars(self).keys()  # type: ignore[arg-type]
            return replace(self.law, **{n: getattr(self, n) for n in shared})  # type: ignore[type-var]
        if not isinstance(self, Term):
            raise TypeError(
                f"{type(self).__name__} must name its law, derive from one, or return one in term()"
            )
        return self

    @property
    def _own_law(self) -> Term:
        """The law of the one coordinate that it acts on, or of the direction."""
        law = self.term()
        return law.law if isinstance(law, Along) else law

    @property
    def jumping(self) -> FrictionLaw | None:
        """Its law, where that is friction that jumps."""
        law = self._own_law
        return law if isinstance(law, FrictionLaw) and not law.smooth else None

    def forces(self, state: State) -> Array:
        """The law in its strong form; a jump is averaged over the step in time."""
        if (friction := self.jumping) is not None:
            value = _averaged(friction, state).force
        else:
            value = self._own_law.strong(state.q, state.q_dot, state.q_ddot)
        return np.atleast_2d(np.broadcast_to(value, state.q.shape))

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        """Derivatives of the law."""
        law, s = self._own_law, strengths[0]
        q, q_dot, q_ddot = state[1:4]
        if (friction := self.jumping) is not None:
            _, by_q, by_q_dot, by_change = _averaged(friction, state)
            # What is about to be held would have no mass left; half of it is enough to go on.
            return s * by_q, s * by_q_dot, np.maximum(s * by_change * state.step / 3, -0.5)
        by_q = (
            law.inertia_dq(q) * q_ddot
            + law.convection_dq(q) * q_dot**2
            + law.stiffness_dq(q)
            + law.damping_dq(q, q_dot)
        )
        by_q_dot = 2 * law.convection(q) * q_dot + law.damping_dq_dot(q, q_dot)
        return s * by_q, s * by_q_dot, s * law.inertia(q)

    def on_beam(self, strength: float, mounting: Mounting | None = None) -> Load | PointMass:
        """The law as a load, at ``mounting`` or where the effect usually is.

        Raises a ValueError if neither says where it acts; and as `Load`.
        """
        where = mounting or self.mounting
        if where is None:
            raise ValueError(
                f"mounting = None, and {type(self).__name__} names no place on a beam of its own:"
                " give one, such as AtPoint()"
            )
        law = self.term()
        return Load(law if law.smooth else law.regularised(CREEP), strength, where)

    def placed(self, mounting: Mounting, rest: Point) -> Mounting:
        """The mounting of a candidate, given where its point is at rest."""
        return mounting

    def strength_on_beam(self, mounting: Mounting) -> str:
        """Unit of the strength of a load."""
        length, time = self.term().dimension
        along = isinstance(mounting, AlongBeam)
        return unit_text({"N": 1, "m": -length - along, "s": -time})


# Velocity [m/s] below which friction on a beam turns round smoothly.
CREEP = 1e-3


def _averaged(law: FrictionLaw, state: State) -> Averaged:
    """Friction averaged from one Gauss point to the next."""
    changes = state.q_dot * state.step / 3, state.q_ddot * state.step / 3
    return law.averaged(state.q, state.q_dot, *changes, state.creep, state.held)


class TimedEffect(Effect):
    """A force that knows the time."""

    @abstractmethod
    def pull(self, t: Array, q: Array) -> Array:
        """Additions to the left side of the equation, (n_strengths, n)."""

    def pull_dq(self, t: Array, q: Array) -> Array:
        """Derivative of `pull` with respect to q."""
        return np.zeros((self.n_strengths, len(q)))

    def times(self, state: State) -> Array:
        """Times that it counts from, (n,): by default, from the start of each record."""
        return state.t

    def forces(self, state: State) -> Array:
        """The pull at the times of the state."""
        return self.pull(self.times(state), state.q)

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        """It depends on q alone."""
        return strengths @ self.pull_dq(self.times(state), state.q), 0.0, 0.0


class ReadingEffect(Effect):
    """A fault of the sensor, or what reaches it beside the motion."""

    family = "measurement"

    @abstractmethod
    def readings(self, t: Array, q: Array) -> Array:
        """Additions to the reading, (n_strengths, n)."""
