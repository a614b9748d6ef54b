"""How a beam starts a record: what held it, and what rings beside its first mode.

A beam that is pulled at a point or hit moves in all its modes, one that is held by a modal force
almost in one. What the sensors read in the first cycles tells how each mode starts.

What the beam does beside its reduced model, taken off the measurement.

A reduced model follows its beam to a few parts in a thousand. The defect, beam minus reduced model
with the same effects and from the same release, hardly depends on what is still missing: with it
taken off, a fit of the reduced model is one of the beam (defect correction, [1]).

[1] H. Stetter, The defect correction principle and discretization methods, Numer. Math. 29 (1978).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from romsindy.beam.beam import Beam
from romsindy.beam.equilibrium import NoEquilibriumError
from romsindy.beam.motion import StepTooLongError
from romsindy.diagnosis.all_sensors import without
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam, RingingModes
from romsindy.diagnosis.on_beam.within_tolerances import beam_with, on_the_beam
from romsindy.diagnosis.structure import (
    AskedMotion,
    Moved,
    as_measured,
    linear_parts,
    start_of,
)
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import MOVING
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.signals import downsample
from romsindy.record.spectrum import noise_std
from romsindy.typing import Array

FAILURES = (NoEquilibriumError, StepTooLongError, TrajectoryError)
_HIGHER = 4  # modes beside the first whose part in the release is looked for
_AXIAL = 0.5  # share of the kinetic energy above which a mode is no bending mode
_RESOLVED = 0.95  # of the largest frequency that the sampling shows
_STEP = 0.02  # of the amplitude, for differences
_TURN = 0.7  # rad, of a mode in a step: Radau's damping, z^6 / 7200, is 2e-5 then
_CYCLES = 3  # from which the release is read: noise hides in one what rings a little
_SHARES = (1.0, 0.5, 0.25)  # of a step
# As a part of the first: higher modes that are as loud hide how that starts.
_LOUD = 0.1
# Of reading the release, until readings change by less than this part: the motion is nearly linear
# in higher modes that ring little, and not in those that ring as loud as the first.
_ROUNDS, _READ = 8, 0.005


class BeamRelease(NamedTuple):
    """How a beam starts: the nodal load that held it, (n_nodes, 3) and of any size, and what rings.

    A load of None is the modal force of its first mode. ``state`` is the coordinate and its rate
    where these too were read from all sensors: where the beam was hit, or higher modes are loud.
    """

    load: Array | None = None
    ringing: RingingModes | None = None
    state: tuple[float, float] | None = None


def read_release(
    seen: InstrumentedBeam,
    beam: Beam,
    start: tuple[float, float],
    measured: Array,
    dt: float,
    derivative: int = 0,
    near: BeamRelease | None = None,
) -> BeamRelease:
    """Read how a beam starts in its bending modes: where each is and, if it moves, how fast.

    Errors of the damping and the frequency of each are fitted beside, so that what the beam lacks
    is not taken for a part of the release.

    The beam has all effects that are known by now; ``start`` is its coordinate and its rate at
    the first sample, kg^0.5 m and s, and ``measured`` what the sensors read from there on, (n,
    n_sensors), m and s: displacement, velocity or acceleration by ``derivative``. It is looked for
    from what was read with other effects on, ``near``, if there is such.
    """
    (q, q_dot), modes = start, bending(beam, dt)
    n = min(int(_CYCLES * 2 * np.pi / modes.omega[0] / dt) + 1, len(measured))
    amplitude = float(np.hypot(q, q_dot / modes.omega[0]))
    moves = abs(q_dot) > MOVING * modes.omega[0] * amplitude
    begun = _FirstCycles(seen, beam, modes, amplitude, measured[:n], dt, derivative)
    state = begun.state(start, near)
    here = begun.simulated(state)
    for _ in range(_ROUNDS):
        try:
            step, misfit = begun.step(state, here, moves)
        except FAILURES:  # what was read so far can be held
            break
        before = here
        state, here = _towards(begun.simulated, state, step, here, misfit)
        if np.linalg.norm(here - before) <= _READ * np.linalg.norm(here):
            break
    displaced, rates = np.split(state * begun.sizes, 2)
    size = np.hypot(displaced, rates / modes.omega)
    loud = moves or size[1:].max(initial=0.0) > _LOUD * size[0]
    first = (float(displaced[0]), float(rates[0])) if loud else None
    return BeamRelease(None, modes.ringing(displaced[1:], rates[1:]), first)


def ringing(
    beam: Beam, start: tuple[float, float], release: BeamRelease, modes: int, dt: float
) -> BeamRelease:
    """A release that rings the modes up to a number a little more."""
    own, (q, q_dot) = bending(beam, dt), start
    more = np.where(np.arange(len(own.omega) - 1) < modes - 1, _STEP, 0.0)
    now = release.ringing or own.ringing(0 * more, 0 * more)
    if abs(q_dot) > own.omega[0] * abs(q):
        return release._replace(ringing=now._replace(rates=now.rates + more * q_dot))
    return release._replace(ringing=now._replace(displaced=now.displaced + more * q))


def rung_by(release: BeamRelease, more: BeamRelease, by: Array) -> BeamRelease:
    """A release that rings higher modes by so many times, complex, what ``more`` rings them more.

    A part that is imaginary is a quarter of a cycle before.
    """
    then = more.ringing
    assert then is not None
    now = release.ringing or then._replace(displaced=0 * then.displaced, rates=0 * then.rates)
    omega = np.sqrt(_norms(then.forces) / _norms(then.momenta))
    rung = (then.displaced - now.displaced) - 1j * (then.rates - now.rates) / omega
    rung[: len(by)] *= by
    displaced, rates = now.displaced + rung.real, now.rates - omega * rung.imag
    return release._replace(ringing=then._replace(displaced=displaced, rates=rates))


def _norms(fields: Array) -> Array:
    return np.asarray(np.linalg.norm(fields, axis=(1, 2)))


class Bending(NamedTuple):
    """The first bending modes of a beam that the sampling shows."""

    momenta: Array  # (n_modes, n_nodes, 3)
    omega: Array  # (n_modes,), rad/s

    def ringing(self, displaced: Array, rates: Array) -> RingingModes:
        """How all but the first start, (n_modes - 1,) each, kg^0.5 m and s."""
        forces = self.momenta * self.omega[:, None, None] ** 2
        return RingingModes(self.momenta[1:], forces[1:], displaced, rates)


def bending(beam: Beam, dt: float) -> Bending:
    """The first bending modes of a beam that samples every ``dt``, s, show."""
    free = int(np.count_nonzero(~beam.assembly.fixed))
    basis = beam.modes(count=min(2 * _HIGHER + 2, free - 2))
    first, *higher = np.flatnonzero(basis.axial < _AXIAL)[: 1 + _HIGHER]
    shown = [first, *(m for m in higher if basis.omega[m] * dt < _RESOLVED * np.pi)]
    return Bending(basis.momenta[shown], basis.omega[shown])


def steps(fastest: float, dt: float) -> int:
    """So many steps to a sample that a mode of some rad/s is not damped by them."""
    return max(int(np.ceil(fastest * dt / _TURN)), 1)


@dataclass(frozen=True, eq=False)
class _FirstCycles:
    """What the sensors read first of a beam, beside what is simulated from the states of its modes.

    A state is a displacement of each mode and then a rate of each, in units of its own.
    """

    seen: InstrumentedBeam
    beam: Beam
    modes: Bending
    amplitude: float  # kg^0.5 m
    measured: Array  # (n, n_sensors)
    dt: float
    derivative: int

    @property
    def sizes(self) -> Array:
        """Units of a state: each mode has the energy that the first has at its amplitude."""
        omega = self.modes.omega
        rate = self.amplitude * omega[0]
        return np.concatenate([rate / omega, np.full(len(omega), rate)])

    def state(self, first: tuple[float, float], near: BeamRelease | None) -> Array:
        """A state in which the higher modes are at rest, or as they were read before."""
        state = np.zeros((2, len(self.modes.omega)))
        state[:, 0] = first
        if near is not None and near.ringing is not None:
            rung = near.ringing
            state[:, 0] = near.state or first
            n = min(len(rung.rates), len(self.modes.omega) - 1)
            state[:, 1 : n + 1] = rung.displaced[:n], rung.rates[:n]
        return np.asarray(state.ravel() / self.sizes)

    def simulated(self, state: Array) -> Array:
        """What the sensors read from a state on."""
        (q, *displaced), (q_dot, *rates) = np.split(state * self.sizes, 2)
        rung = self.modes.ringing(np.array(displaced), np.array(rates))
        finer = steps(self.seen.fastest, self.dt)
        duration, step = (len(self.measured) - 0.5) * self.dt, self.dt / finer
        motion = self.seen.motion(self.beam, q, duration, step, q_dot=q_dot, ringing=rung)
        return motion[self.derivative][::finer]

    def step(
        self, state: Array, here: Array, moves: bool
    ) -> tuple[Array, Callable[[Array], float]]:
        """A step from a state towards what was measured, and how far readings are from that."""
        unknown = np.repeat([True, moves], len(self.modes.omega))
        tried = state + _STEP * np.eye(len(state))[unknown]
        changes = [(self.simulated(other) - here) / _STEP for other in tried]
        # What the beam lacks damps and detunes each mode otherwise.
        t = self.dt * np.arange(len(here))[:, None]
        turned = [] if moves else [np.gradient(c, self.dt, axis=0) for c in changes]
        off = self._over_noise([t * c for c in (*changes, *turned)])
        matrix = np.hstack([self._over_noise(changes), off])
        matrix /= (scale := np.linalg.norm(matrix, axis=0))
        wanted = self._over_noise([self.measured - here])[:, 0]
        found = (np.linalg.lstsq(matrix, wanted, rcond=None)[0] / scale)[: len(changes)]
        return found @ np.eye(len(state))[unknown], partial(self._misfit, off=off)

    def _misfit(self, here: Array, off: Array) -> float:
        return float(np.linalg.norm(without(self._over_noise([self.measured - here]), off)))

    def _over_noise(self, columns: Sequence[Array]) -> Array:
        # Without noise there is nothing to weigh, and nothing to divide by.
        least = 1e-9 * float(np.abs(self.measured).max())
        noise = np.maximum([noise_std(y) for y in self.measured.T], least)
        return np.stack([(c / noise).ravel() for c in columns], axis=1)


def _towards(
    simulated: Callable[[Array], Array],
    state: Array,
    step: Array,
    here: Array,
    misfit: Callable[[Array], float],
) -> tuple[Array, Array]:
    """A step from a state, as far as the beam can be held and comes nearer; what is there."""
    least = misfit(here)
    for share in _SHARES:
        try:
            there = simulated(state + share * step)
        except FAILURES:  # half as far
            continue
        if misfit(there) < least:
            return state + share * step, there
    return state, here


# What changes all modes alike, and so any first motion nearly as what is missing does.
STAND_INS = ("density", "mass_damping")


@dataclass(frozen=True, eq=False)
class OnBeam:
    """A beam that a diagnosis simulates, see `diagnosis.structure.SimulatedStructure`."""

    seen: InstrumentedBeam

    what = "the beam"
    failures: tuple[type[Exception], ...] = FAILURES
    apart = True

    def coordinate(self, displacements: Array) -> Array:
        return self.seen.coordinate(displacements)

    def with_effects(self, parts: Sequence[Part]) -> tuple[Part, ...]:
        return on_the_beam(parts)

    def start(
        self, model: ReducedModel, parts: Sequence[Part], record: Record
    ) -> tuple[float, float]:
        there = {p.effect.name for p in parts}
        if not there or there == set(STAND_INS):  # something is missing still
            return start_of(model, linear_parts(record), record, fixed=False)
        return start_of(model, parts, record)

    def moved(self, asked: AskedMotion, decay: Decay) -> Moved:
        """What the sensors, that measured ``decay``, read of the beam with some parts.

        The release is read from them where none is given.
        """
        equation, parts, record, start, release = asked
        beam = beam_with(self.seen.beam, parts)
        own = decay.between(record.decay.t[0])
        if release is None:
            release = read_release(self.seen, beam, start, own.signal, own.dt, own.derivative)
        begins = release.state or start
        try:
            fastest = self.seen.fastest if release.state else 0.0
            found = simulated(self.seen, beam, record, own, begins, release, fastest)
        except FAILURES:
            if release.ringing is None:
                raise
            # Where it cannot be, it was not: what was read is no release.
            release, begins = BeamRelease(), start
            found = simulated(self.seen, beam, record, own, start, release)
        if release.state:  # what rings as loud as the first mode moves this: no state of its own
            alike = as_measured(record, self.coordinate(found[record.derivative]))
            begins = start_of(equation.model, parts, alike)  # type: ignore[arg-type]
        return Moved(found, begins, release)


def simulated(
    seen: InstrumentedBeam,
    beam: Beam,
    record: Record,
    decay: Decay,
    start: tuple[float, float],
    release: BeamRelease,
    fastest: float = 0.0,
) -> list[Array]:
    """What the sensors read of a beam: displacements, velocities, accelerations.

    At the times of a record; the decay holds what was measured, as fast as it was. Steps do not
    damp modes up to the ``fastest``, rad/s.
    """
    dt = record.decay.dt
    finer = round(dt / decay.dt) if decay.derivative else 1  # displacements hardly show fast modes
    finer = max(finer, steps(fastest, dt))
    step, (q, q_dot) = dt / finer, start
    duration = float(record.t[-1]) + 0.5 * step
    held, ringing = release.load, release.ringing
    motion = seen.motion(beam, q, duration, step, held, q_dot=q_dot, ringing=ringing)
    return [downsample(x, finer) for x in motion]
