"""A user's simulator seen through the channels of the records, in one coordinate.

The coordinate q is the motion of the first channel in the slow mode, whose shape at the other
channels the simulator itself shows. A record begins anywhere in a swing: the simulator is let go
from the turning point before, which the equation finds going backwards, and what it gives from the
beginning of the record on is compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from romsindy.diagnosis.on_simulator.effects import ForceScale, ValueEffect
from romsindy.diagnosis.structure import Moved, start_of
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import TermEffect
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.part import Part, extended
from romsindy.fit.records.record import Record, scales
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.simulator.force import LawForce
from romsindy.simulator.simulator import Force, SimulatedDecay, Simulator, SimulatorError, times
from romsindy.typing import Array

_NEAR = 0.3  # of the largest velocity: a record that begins below it may begin with its release
_CYCLES = 3  # at the start of a record, which tell the state that it begins with
_STILL = 0.02  # the same where no other mode tells
_TELLS = 1.02  # of what is left one way, the other: less may be noise
_FIRST = 2.0  # cycles in which other modes tell
_AT_REST = 1e-6  # of the largest velocity: a record that begins so begins with its release
_CREEP = 3e-3  # of the largest velocity, over which friction in a simulator turns round
_BACK = 1.5  # periods within which the turning point before a state lies
_TIGHT = 1e-10


def _other_modes(measured: Array, simulated: Array) -> float:
    """What is left of a few cycles (n, n_sensors) by another size and time: other modes."""
    columns = (simulated, np.gradient(simulated, axis=0), np.ones_like(simulated))
    matrix = np.stack([x.ravel() for x in columns], axis=1)
    found = np.linalg.lstsq(matrix, measured.ravel())[0]
    return float(np.std(measured.ravel() - matrix @ found))


class Beginning(NamedTuple):
    """How a record begins: with its release or after it, and by how much more than was fitted."""

    released: bool
    size: float = 1.0


@dataclass(frozen=True, eq=False)
class OnSimulator:
    """A simulator as what a diagnosis simulates, see `structure.SimulatedStructure`.

    Attributes
    ----------
    simulator : Simulator
    shape : (n_sensors,) array
        Of the slow mode at the channels, 1 at the first.
    values : dict of str to float
        Values of the simulator as they were assumed.
    scale : ForceScale or None
        What a force at its point does to the coordinate; None where it takes none.
    reach : pair of float
        Largest displacement and velocity of the coordinate.
    released : list of pairs
        Releases, and where the coordinate began.
    """

    simulator: Simulator
    shape: Array
    values: Mapping[str, float]
    scale: ForceScale | None = None
    reach: tuple[float, float] = (0.0, 0.0)
    released: list[tuple[float, float]] = field(default_factory=list)

    failures: ClassVar[tuple[type[Exception], ...]] = (SimulatorError, TrajectoryError)
    apart = False  # what it computed is kept here

    @property
    def what(self) -> str:
        return f"simulator {self.simulator.name}"

    def coordinate(self, displacements: Array) -> Array:
        """The coordinate of displacements (..., n_sensors), by least squares, unit of the records.

        What is orthogonal to the shape does not show.
        """
        return np.asarray(displacements @ self.shape / (self.shape @ self.shape))

    def decay(self, readings: Decay) -> Decay:
        """What all channels measured as a decay of the coordinate."""
        n = len(self.shape)
        signals: dict[str, Any] = {
            name: self.coordinate(x.reshape(-1, n)) for name, x in readings.signals.items()
        }
        return Decay(
            readings.t,
            **signals,
            unit=readings.unit,
            measured=readings.measured,
            leftover=readings.leftover,
        )

    def with_effects(self, parts: Sequence[Part]) -> tuple[Part, ...]:
        """Values of the simulator, and what a force can do where it takes one."""
        return tuple(p for p in parts if np.any(p.strengths) and self._possible(p))

    def _possible(self, part: Part) -> bool:
        if isinstance(part.effect, ValueEffect):
            return True
        law = part.effect.term() if isinstance(part.effect, TermEffect) else None
        if law is None or self.scale is None:
            return False
        return not (law.has("inertia") or law.has("convection"))

    def force(self, parts: Sequence[Part]) -> LawForce | None:
        """The force that stands for some parts; None where none does."""
        laws = tuple(
            (self._smooth(part.effect.term()), float(part.strengths[0, 0]))
            for part in self.with_effects(parts)
            if not isinstance(part.effect, ValueEffect)
        )
        if self.scale is None or not laws:
            return None
        q, q_dot = self.reach
        reach = (q * self.scale.per_q, q_dot * self.scale.per_q)
        return LawForce(laws, self.scale.mass, self.scale.per_q, reach)

    def _smooth(self, law: Term | None) -> Term:
        assert law is not None  # `with_effects` asked
        return law if law.smooth else law.regularised(_CREEP * self.reach[1])

    def values_with(self, parts: Sequence[Part]) -> dict[str, float]:
        """Values of the simulator with the changes that some parts are."""
        values = dict(self.values)
        for part in parts:
            if isinstance(part.effect, ValueEffect):
                values[part.effect.value_name] += float(part.strengths[0, 0])
        return values

    def simulated(
        self,
        q: float,
        t: Array,
        force: Force | None = None,
        values: Mapping[str, float] | None = None,
    ) -> SimulatedDecay:
        """Let the simulator go with the coordinate at ``q``."""
        known = self.values if values is None else values
        return self.simulator.decay(self.release_at(q), t, len(self.shape), force, known)

    def release_at(self, q: float) -> float:
        """The release after which the coordinate begins at ``q``.

        Other modes move the first sensor as well: in proportion to what was let go before, between
        releases of the same sign on a line.
        """
        known = sorted((a, r) for r, a in self.released if a * q > 0)
        if not known:
            return q
        amplitudes, releases = np.abs(np.array(known)).T
        order = np.argsort(amplitudes)
        ratio = np.interp(abs(q), amplitudes[order], (releases / amplitudes)[order])
        return float(q * ratio)

    def start(
        self, model: ReducedModel, parts: Sequence[Part], record: Record
    ) -> tuple[float, float]:
        """The state that a record begins with, whatever is missing.

        What is missing changes the first cycles as other linear values do, nearly.
        """
        first = record.until(_CYCLES * 2 * np.pi / record.rate)
        linear = [Part.of(e, scales([record]), 1) for e in (LinearFrequency(), Viscous())]
        return start_of(extended(model, self.with_effects(parts)), linear, first, fixed=False)

    def moved(
        self,
        equation: ExtendedEquation,
        parts: Sequence[Part],
        record: Record,
        decay: Decay,
        start: tuple[float, float],
        release: Beginning | None,
    ) -> Moved:
        """What the sensors read from a state of the coordinate on, over a record.

        Where the record may begin with its release, the other modes in its first cycles say whether
        it does; where they say nothing, its velocity.
        """
        given, (q, q_dot) = (equation, parts, record, start), start
        near = abs(q_dot) < _NEAR * record.rate * abs(q)
        if release is not None or not near:
            known = release or Beginning(False)
            return self._from(known._replace(released=known.released and near), *given)
        after, begins = (self._from(Beginning(way), *given) for way in (False, True))
        n = int(_FIRST * 2 * np.pi / record.rate / record.decay.dt)
        at = int(np.searchsorted(decay.t, record.decay.t[0]))
        measured = decay.signal.reshape(len(decay.t), -1)[at:][:n]
        left = [_other_modes(measured, m.readings[record.derivative][:n]) for m in (after, begins)]
        if max(left) < _TELLS * min(left):
            return begins if abs(q_dot) < _STILL * record.rate * abs(q) else after
        return begins if left[1] < left[0] else after

    def _from(
        self,
        way: Beginning,
        equation: ExtendedEquation,
        parts: Sequence[Part],
        record: Record,
        start: tuple[float, float],
    ) -> Moved:
        """The motion over a record that begins in one way."""
        if way.released:
            start = (float(np.copysign(np.hypot(start[0], start[1] / record.rate), start[0])), 0.0)
        start = (way.size * start[0], way.size * start[1])
        q, before = turning_point(equation, start, record.rate)
        t = times(before + float(record.t[-1]), record.decay.dt, record.rate)
        answer = self.simulated(q, t, self.force(parts), self.values_with(parts))
        readings = [answer.at(before + record.t, order) for order in range(3)]
        return Moved(readings, start, way)


def turning_point(
    equation: ExtendedEquation, start: tuple[float, float], rate: float
) -> tuple[float, float]:
    """Where a motion turned before it came to a state: the coordinate there, and the time since.

    Raises a TrajectoryError if it never did.
    """
    q, q_dot = start
    if abs(q_dot) <= _AT_REST * rate * abs(q):
        return q, 0.0

    def backwards(t: float, state: Array) -> list[float]:
        at, now = np.array([-t]), state[:, None, None]
        here = equation.linearise(at, now[0], now[1], np.zeros((1, 1)))
        return [-state[1], float(here.residual[0, 0] / here.by_q_ddot[0, 0, 0])]

    def turns(t: float, state: Array) -> float:
        return float(state[1])

    turns.terminal = True  # type: ignore[attr-defined]
    amplitude = np.hypot(q, q_dot / rate)
    span = (0.0, _BACK * 2 * np.pi / rate)
    limits = _TIGHT * amplitude * np.array([1.0, rate])
    done = solve_ivp(backwards, span, start, events=turns, rtol=_TIGHT, atol=limits)
    if not len(done.t_events[0]):
        raise TrajectoryError("the motion did not turn within a cycle before the record began")
    return float(done.y_events[0][0][0]), float(done.t_events[0][0])
