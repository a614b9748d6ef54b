"""A user's simulator seen through the channels of the records, in one coordinate.

The coordinate q is the motion of the first channel in the slow mode, whose shape at the other
channels the simulator itself shows. A record begins anywhere in a swing, some cycles after its
release: the simulator is let go from a turning point before, which the equation finds going
backwards, and what it gives from the beginning of the record on is compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
from scipy.integrate import solve_ivp

from romsindy.diagnosis.structure import AskedMotion, Moved, key_of, linear_parts, start_of
from romsindy.effects.base import TermEffect
from romsindy.effects.stiffness import MoreMass
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.part import Part, extended
from romsindy.fit.records.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Combination, Term
from romsindy.record.decay import Decay
from romsindy.simulator.force import Force, LawForce
from romsindy.simulator.simulator import (
    Question,
    SimulatedDecay,
    Simulator,
    SimulatorError,
    times,
    whole,
)
from romsindy.typing import Array

_NEAR = 0.3  # of the largest velocity: a record that begins below it may begin with its release
_CYCLES = 3  # at the start of a record, which tell the state that it begins with
_STILL = 0.02  # the same where no other mode tells
# Of what is left one way, the other: less may be noise. A record that begins as a release does is
# hardly cut just there; with wrong values the other modes tell badly.
_TELLS, _TELLS_OF_REST = 1.02, 2.0
_FIRST = 2.0  # cycles in which other modes tell
_AT_REST = 1e-6  # of the largest velocity: a motion that begins so turns there
_CREEP = 3e-3  # of the largest velocity, over which friction in a simulator turns round
_BACK = 2  # half periods more, within which so many turning points lie
_EARLIEST = 16  # turns since a release that is looked for
# Of the amplitude in the record: how large a release is looked for where the equation is not known
# so far; and what runs away.
_FARTHER, _RUNAWAY = 1.15, 2.0
_ECHOES = 3  # times that other modes are followed from the latest to the earliest release
_TIGHT = 1e-9
_FIRST_SENSOR = 2e-3  # a point that moves as it does within this is that of the sensor
_INSIDE = 0.5  # of the largest motion: there the strengths of laws are compared
_PART, _SPLINE = 10, 60  # of a simulated decay tells how far a point moves, and samples at least


Failure = SimulatorError | TrajectoryError


class ForceScale(NamedTuple):
    """What a force does: its point moves by ``per_q`` q, over the modal ``mass`` of q."""

    mass: float
    per_q: float


@dataclass(frozen=True)
class ValueEffect(TermEffect):
    """A value that the simulator takes is another than assumed; the strength is its change.

    Where it is assumed to be zero it cannot be less, and its ``size`` is that of a change.
    ``direction`` is what a unit of the change does to the coefficients of the equation, ``assumed``
    the value, ``tolerance`` the standard deviation of a change that is known to be near 0.
    """

    value_name: str
    assumed: float
    direction: Combination
    tolerance: float | None = None  # type: ignore[misc]
    size: float = 0.0  # of a change, where it is assumed to be zero

    family = "value"
    advice = "measure the value by itself"

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the value."""
        return self.value_name

    @property
    def label(self) -> str:  # type: ignore[override]
        """As an engineer says it."""
        return f"another {self.value_name} than {self.assumed:.6g}"

    @property
    def sign(self) -> int:  # type: ignore[override]
        """What is assumed to be zero is not less."""
        return int(self.assumed == 0)

    @property
    def scale(self) -> float:
        """The size of what it may be."""
        return abs(self.assumed) or self.size

    def term(self) -> Combination:
        return self.direction

    def strength_unit(self, unit: str | None) -> str:
        """Its own, which nobody knows."""
        return ""


def _other_modes(measured: Array, simulated: Array) -> float:
    """What is left of a few cycles (n, n_sensors) by another size, time, damping and frequency.

    It is what other modes do.
    """
    columns = [simulated, np.gradient(simulated, axis=0)]
    columns += [np.linspace(-1, 1, len(x))[:, None] * x for x in columns]
    matrix = np.stack([x.ravel() for x in (*columns, np.ones_like(simulated))], axis=1)
    found = np.linalg.lstsq(matrix, measured.ravel())[0]
    return float(np.std(measured.ravel() - matrix @ found))


class Beginning(NamedTuple):
    """How a record begins: how long after its release, and with which state of the coordinate.

    At zero it begins with its release. Without a state this is read from the record.
    """

    since: float  # s
    state: tuple[float, float] | None = None

    def larger(self, start: tuple[float, float], by: float) -> Beginning:
        """The same with a state that is known: so many times another one."""
        return self._replace(state=(by * start[0], by * start[1]))


@dataclass(frozen=True, eq=False)
class OnSimulator:
    """A simulator as what a diagnosis simulates, see `structure.SimulatedStructure`."""

    simulator: Simulator
    shape: Array  # (n_sensors,), of the slow mode at the channels, 1 at the first
    reading: Array  # (n_sensors,), weights of the channels in the coordinate
    values: Mapping[str, float]  # as they were assumed
    # What a force at its point does to the coordinate; None where it takes none
    scale: ForceScale | None = None
    point: str | None = None  # at which it acts, if not the simulator's own
    reach: tuple[float, float] = (0.0, 0.0)  # largest displacement and velocity of the coordinate
    # Releases, and where the coordinate began
    released: list[tuple[float, float]] = field(default_factory=list)
    # What a force does at other points, which were asked
    scales: dict[str, ForceScale] = field(default_factory=dict)
    # How motions of an equation came to a state: the same wherever on the simulator its parts act
    pasts: dict[tuple[Any, ...], Past] = field(default_factory=dict)

    failures: ClassVar[tuple[type[Exception], ...]] = (SimulatorError, TrajectoryError)
    apart = False  # what it computed is kept here

    @property
    def what(self) -> str:
        return f"simulator {self.simulator.name}"

    def coordinate(self, displacements: Array) -> Array:
        """The coordinate of displacements (..., n_sensors), unit of the records.

        Other modes do not show in it, as far as the channels tell them apart.
        """
        return np.asarray(displacements @ self.reading)

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
            slowest=readings.slowest,
        )

    def with_effects(self, parts: Sequence[Part]) -> tuple[Part, ...]:
        """Values of the simulator, and what a force can do where it takes one."""
        return tuple(p for p in parts if np.any(p.strengths) and self._possible(p))

    def _possible(self, part: Part) -> bool:
        if isinstance(part.effect, ValueEffect):
            return True
        if isinstance(part.effect, MoreMass):
            return self.simulator.takes_mass and self.scale is not None
        law = part.effect.term() if isinstance(part.effect, TermEffect) else None
        if law is None or self.scale is None:
            return False
        return not (law.has("inertia") or law.has("convection"))

    def force(self, parts: Sequence[Part]) -> LawForce | None:
        """The force that stands for some parts; None where none does."""
        laws = tuple(
            (self._smooth(part.effect.term()), float(part.strengths[0, 0]))
            for part in self.with_effects(parts)
            if not isinstance(part.effect, (ValueEffect, MoreMass))
        )
        if self.scale is None or not laws:
            return None
        q, q_dot = self.reach
        reach = (q * self.scale.per_q, q_dot * self.scale.per_q)
        return LawForce(laws, self.scale.mass, self.scale.per_q, reach)

    def mass(self, parts: Sequence[Part]) -> float:
        """The mass at the point that stands for some parts, kg."""
        added = (p for p in self.with_effects(parts) if isinstance(p.effect, MoreMass))
        share = sum(float(p.strengths[0, 0]) for p in added)
        return share and share * self.scale.mass / self.scale.per_q**2  # type: ignore[union-attr]

    def strength(self, parts: Sequence[Part], other: OnSimulator) -> float:
        """How strong what acts is at its point, over what does the same at that of another one."""
        assert self.scale is not None and other.scale is not None  # something acts
        ratio = other.scale.per_q / self.scale.per_q
        force, same = self.force(parts), other.force(parts)
        x, v = (_INSIDE * min(1.0, abs(ratio)) * abs(self.scale.per_q) * r for r in self.reach)
        if force is None or same is None or not same(0.0, x, v):
            return ratio**2
        return force(0.0, x, v) / same(0.0, x, v)

    def acts(self, parts: Sequence[Part]) -> bool:
        """Whether some parts are at the point."""
        return self.force(parts) is not None or self.mass(parts) != 0

    @property
    def points(self) -> Mapping[str, Array]:
        """Where what is missing may act, the simulator's own point first; often none is named."""
        return self.simulator.points if self.scale is not None else {}

    @property
    def at_point(self) -> str:
        """The name of the point at which it acts; the first is the simulator's own."""
        return self.point or next(iter(self.points), "")

    def at(self, points: Sequence[str]) -> list[OnSimulator]:
        """The same with what acts at each of some other points of the simulator.

        How far these move with the coordinate a force of nothing sees there.
        """
        assert self.scale is not None  # it takes a force
        release, q = max(self.released, key=lambda pair: abs(pair[0]))
        t = next(a.t for a in self.simulator.computed if a.release == release)
        t = t[: max(len(t) // _PART, _SPLINE)]
        new = [point for point in dict.fromkeys(points) if point not in self.scales]
        probes = [ProbeSpring(0.0) for _ in new]
        rows = zip(new, probes, strict=True)
        asked = [replace(self, point=point).question(q, t, probe) for point, probe in rows]
        answers = self.simulator.decays(asked, len(self.shape))
        for point, probe, answer in zip(new, probes, answers, strict=True):
            self.scales[point] = self.scale._replace(per_q=self.per_q(whole(answer), probe.seen))
        return [replace(self, point=point, scale=self.scales[point]) for point in points]

    def per_q(self, moved: SimulatedDecay, seen: Sequence[tuple[float, float]]) -> float:
        """How far the point of a force moves where the coordinate moves by 1.

        A program reads a file, and nobody sees where: it is taken for the first sensor.
        """
        inside = np.array([row for row in seen if moved.t[0] <= row[0] <= moved.t[-1]])
        if not len(inside):
            return 1.0
        at, x = inside[np.argsort(inside[:, 0])].T
        q = self.coordinate(moved.at(at))
        per_q = float(q @ x / (q @ q))
        return 1.0 if abs(per_q - 1) < _FIRST_SENSOR else per_q

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

    def question(
        self,
        q: float,
        t: Array,
        force: Force | None = None,
        values: Mapping[str, float] | None = None,
    ) -> Question:
        """To let the simulator go with the coordinate at ``q``."""
        known = self.values if values is None else values
        return Question(self.release_at(q), t, force, known, self.point)

    def simulated(self, q: float, t: Array, force: Force | None = None) -> SimulatedDecay:
        """What it gives to that."""
        (answer,) = self.simulator.decays([self.question(q, t, force)], len(self.shape))
        return whole(answer)

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
        known = extended(model, self.with_effects(parts))
        return start_of(known, linear_parts(record), first, fixed=False)

    def moved(self, asked: AskedMotion, decay: Decay) -> Moved:
        """What the sensors read from a state of the coordinate on, over a record.

        Other modes in its first cycles say how long ago it was released; where they say nothing, it
        was at the turning point before, or where it begins if its velocity is next to none.
        """
        if asked.release is not None:
            (found,) = moved_together([(self, asked)])
            return whole(found)
        equation, parts, record, start, _ = asked
        past = self._past(equation, start, record, _EARLIEST)
        turns = max(int(past.speed > _STILL), past.first)
        run = self._run(past, turns, parts, record, float(record.t[-1]))
        at = int(np.searchsorted(decay.t, record.decay.t[0]))
        measured = decay.signal.reshape(len(decay.t), -1)[at:]
        turns = self._turns(past, run, parts, record, measured)
        if turns != run.turns:
            run = self._run(past, turns, parts, record, float(record.t[-1]))
        return run.moved(record, past, None)

    def _past(
        self, equation: ExtendedEquation, begins: tuple[float, float], record: Record, most: int
    ) -> Past:
        values = tuple((*key_of(p), p.values.tobytes()) for p in equation.parts)
        asked = (values, begins, record.rate, most)
        if asked not in self.pasts:
            model = cast(ReducedModel, extended(equation.model, equation.parts))
            smooth = replace(model, terms=tuple(self._smooth(law) for law in model.terms))
            self.pasts[asked] = Past.of(smooth, begins, record.rate, most)
        return self.pasts[asked]

    def _run(
        self, past: Past, turns: int, parts: Sequence[Part], record: Record, end: float
    ) -> Run:
        """The motion from a release on, up to a time of the record (s)."""
        question = self._since(past, turns, parts, record, end)
        (answer,) = self.simulator.decays([question], len(self.shape))
        return Run(turns, *past.releases[turns], whole(answer))

    def _since(
        self, past: Past, turns: int, parts: Sequence[Part], record: Record, end: float
    ) -> Question:
        """To let the simulator go so many turns before a record."""
        q, before = past.releases[turns]
        t = times(before + end, record.decay.dt, record.rate)
        mass = self.mass(parts)
        values = self.values_with(parts) | ({"mass": mass} if mass else {})
        return self.question(q, t, self.force(parts), values)

    def _turns(
        self, past: Past, usual: Run, parts: Sequence[Part], record: Record, measured: Array
    ) -> int:
        """How often a motion turned since its release, as its other modes in ``measured`` tell.

        They are linear: they ring after every release alike, in proportion to it. After the
        earliest they have died, or nearly so, and what the usual motion has beside that is theirs.
        """
        order, cycle = record.derivative, 2 * np.pi / record.rate
        first = record.t[: int(_FIRST * cycle / record.decay.dt)]
        measured, room = measured[: len(first)], float(record.t[-1] - first[-1])
        largest = max(_FARTHER * abs(past.releases[0][0]), *(abs(a) for _, a in self.released))
        known = sorted({usual.turns, *past.within(largest, usual.before + room)})
        apart = past.releases[known[-1]][1] - usual.before
        if apart <= 0:
            return usual.turns
        echoes = int(min(room // apart, _ECHOES))
        earliest = self._run(past, known[-1], parts, record, float(first[-1]) + echoes * apart)

        def ringing(turns: int) -> Array:
            """Of the other modes in the first cycles after so many turns, (n, n_sensors)."""
            q, since = past.releases[turns]
            rung = np.zeros_like(measured)
            for k in range(echoes):  # what they still did after the earliest release
                t = first + since - usual.before + k * apart
                beside = usual.read(t, order) - earliest.read(t, order)
                rung += (earliest.q / usual.q) ** k * beside
            return q / usual.q * rung

        slow = usual.read(first, order) - ringing(usual.turns)
        left = {k: _other_modes(measured, slow + ringing(k)) for k in known}
        best, least = min(known, key=lambda k: left[k]), left[usual.turns]
        told = _TELLS if usual.turns else _TELLS_OF_REST
        return best if left[best] * told < least else usual.turns


@dataclass
class ProbeSpring:
    """A force -k x that keeps when (s) it was asked, and at which displacement of its point."""

    stiffness: float
    seen: list[tuple[float, float]] = field(default_factory=list)

    def __call__(self, t: float, x: float, v: float) -> float:
        self.seen.append((float(t), float(x)))
        return -self.stiffness * float(x)

    def code(self, language: str) -> str:
        """As that of every force."""
        return LawForce(((Stiffness(1), self.stiffness),), 1.0).code(language)


class Run(NamedTuple):
    """A simulated motion that turned so often since its release, ``before`` (s) a record."""

    turns: int
    q: float  # at the release
    before: float
    answer: SimulatedDecay

    def read(self, t: Array, order: int) -> Array:
        """Displacements or their derivatives at times of the record, (m, n_sensors)."""
        return self.answer.at(self.before + t, order)

    def moved(self, record: Record, past: Past, state: tuple[float, float] | None) -> Moved:
        """What the sensors read over the record; ``state`` is that of its beginning, if known."""
        readings = [self.read(record.t, order) for order in range(3)]
        return Moved(readings, past.start(self.turns), Beginning(self.before, state))


def moved_together(asked: Sequence[tuple[OnSimulator, AskedMotion]]) -> list[Moved | Failure]:
    """What the sensors of one simulator read in each motion, or why there is none.

    How each begins is known.
    """
    found: dict[int, Moved | Failure] = {}
    runs: list[tuple[int, Past, int, Question]] = []
    for i, (there, (equation, parts, record, start, release)) in enumerate(asked):
        try:
            begins, most = release.state or start, round(release.since * record.rate / np.pi)
            past = there._past(equation, begins, record, most + (release.since > 0))
            if most >= len(past.releases):
                raise TrajectoryError(f"the motion did not turn {most} times before the record")
            turns = past.nearest(release.since)
            question = there._since(past, turns, parts, record, float(record.t[-1]))
            runs.append((i, past, turns, question))
        except TrajectoryError as error:
            found[i] = error
    if runs:
        there = asked[0][0]
        answers = there.simulator.decays([question for *_, question in runs], len(there.shape))
        for (i, past, turns, _), answer in zip(runs, answers, strict=True):
            if isinstance(answer, SimulatorError):
                found[i] = answer
            else:
                run = Run(turns, *past.releases[turns], answer)
                own = asked[i][1]
                found[i] = run.moved(own.record, past, own.release.state)
    return [found[i] for i in range(len(asked))]


class Past(NamedTuple):
    """How a motion came to a state: releases from which it may have come.

    ``releases`` are coordinates and how long ago they were (s): at the state itself, if it is near
    a turning point, and at the turning points before it, the latest first.
    """

    state: tuple[float, float]
    speed: float  # the part of velocity in the state
    releases: Sequence[tuple[float, float]]

    @classmethod
    def of(cls, model: ReducedModel, state: tuple[float, float], rate: float, most: int) -> Past:
        """Of a state of a model, at ``most`` so many turns ago; errors are of `turning_points`."""
        q, q_dot = state
        speed = abs(q_dot) / max(rate * abs(q), 1e-300)
        here = float(np.copysign(np.hypot(q, q_dot / rate), q)), 0.0
        turned = turning_points(model, state, rate, most or 1) if most or speed >= _NEAR else []
        return cls(state, speed, [here, *turned])

    @property
    def first(self) -> int:
        """Turns since the latest release that can be."""
        return int(self.speed >= _NEAR)

    def nearest(self, since: float) -> int:
        """Turns since the release that was about so long ago, s: the motion may turn soon, too."""
        known = range(self.first, len(self.releases))
        return min(known, key=lambda k: abs(self.releases[k][1] - since))

    def within(self, largest: float, longest: float) -> list[int]:
        """Turns since releases that were from no more, and are no longer ago, s."""
        rows = enumerate(self.releases[self.first :], self.first)
        return [k for k, (q, before) in rows if abs(q) <= largest and before < longest]

    def start(self, turns: int) -> tuple[float, float]:
        """The state with which the record begins."""
        return self.state if turns else self.releases[0]


def turning_points(
    model: ReducedModel, start: tuple[float, float], rate: float, most: int = 1
) -> list[tuple[float, float]]:
    """Where a motion turned before it came to a state, the latest first: coordinate, time since.

    They are at ``most`` so many, and it is not followed where it runs away.

    Raises a TrajectoryError if it never turned.
    """
    q, q_dot = start
    size = float(np.hypot(q, q_dot / rate))
    mass_and_force = model.mass_and_force()

    def backwards(t: float, state: Array) -> list[float]:
        q, q_dot = state.tolist()
        mass, force = mass_and_force(q, q_dot)
        return [-q_dot, force / mass]

    def turns(t: float, state: Array) -> float:
        return float(state[1])

    def beyond(t: float, state: Array) -> float:
        return float(abs(state[0]) - _RUNAWAY * size)

    beyond.terminal = True  # type: ignore[attr-defined]
    span = (0.0, (most + _BACK) * np.pi / rate)
    limits = _TIGHT * size * np.array([1.0, rate])
    events = [turns, beyond]
    done = solve_ivp(backwards, span, start, "DOP853", events=events, rtol=_TIGHT, atol=limits)
    rows = zip(done.y_events[0], done.t_events[0], strict=True)
    found = [(float(y[0]), float(t)) for y, t in rows if t > _AT_REST / rate]
    if not found:
        raise TrajectoryError("the motion did not turn within a cycle before the record began")
    return found[:most]
