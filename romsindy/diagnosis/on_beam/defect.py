"""What the beam does beside its reduced model, taken off the measurement.

A reduced model follows its beam to a few parts in a thousand. The defect, beam minus reduced model
with the same effects and from the same release, hardly depends on what is still missing: with it
taken off, a fit of the reduced model is one of the beam (defect correction, [1]).

A beam that is pulled at a point or hit moves in all its modes, one that is held by a modal force
almost in one. What the higher modes do in the first cycles tells which forces held and pushed it.

[1] H. Stetter, The defect correction principle and discretization methods, Numer. Math. 29 (1978).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from romsindy.beam.beam import Beam
from romsindy.beam.equilibrium import NoEquilibriumError
from romsindy.beam.motion import StepTooLongError
from romsindy.diagnosis.all_sensors import without
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.within_tolerances import beam_with, on_the_beam
from romsindy.diagnosis.structure import Moved, linear_parts, start_of
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.equation import ExtendedEquation
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
_RESOLVED = 0.8  # of the largest frequency that the sampling shows
_STEP = 0.02  # amplitude of a higher mode, relative to the first, for differences
_TURN = 0.7  # rad, of a mode in a step: Radau's damping, z^6 / 7200, is 2e-5 then
_CYCLES = 3  # from which the release is read: noise hides in one what rings a little
_SHARES = (1.0, 0.5, 0.25)  # of a step
# Of reading the release, until ratios change by less than this: the motion is nearly linear in
# higher modes that ring little, and not in those that ring as loud as the first.
_ROUNDS, _READ = 6, 0.03
# What changes all modes alike, and so any first motion nearly as what is missing does.
STAND_INS = ("density", "mass_damping")


class ReleaseLoad(NamedTuple):
    """Nodal loads, (n_nodes, 3) and of any size, that held a beam and that pushed it.

    None stands for the modal force of its first mode. ``read`` is True of one that was read from
    the sensors.
    """

    load: Array | None = None
    push: Array | None = None
    read: bool = False


def read_release(
    seen: InstrumentedBeam,
    beam: Beam,
    start: tuple[float, float],
    measured: Array,
    dt: float,
    derivative: int = 0,
) -> ReleaseLoad:
    """Find the loads that held a beam until it was let go, and that pushed it.

    Each is a sum of modal forces. Beside their ratios errors of the amplitude, of the damping and
    the frequency and, for a beam that moves, one of the time are fitted, so that what the beam
    lacks is not taken for a part of the release.

    The beam has all effects that are known by now; ``start`` is its coordinate and its rate at
    the first sample, kg^0.5 m and s, and ``measured`` what the sensors read from there on, (n,
    n_sensors), m and s: displacement, velocity or acceleration by ``derivative``.
    """
    (q, q_dot), (forces, omega) = start, _modal_forces(beam, dt)
    n = min(int(_CYCLES * 2 * np.pi / omega / dt) + 1, len(measured))
    # Without noise there is nothing to weigh, and nothing to divide by.
    least = 1e-9 * float(np.abs(measured).max())
    noise = np.maximum([noise_std(y) for y in measured.T], least)
    t = dt * np.arange(n)[:, None]
    parts = np.array([q * omega, q_dot]) / np.hypot(q * omega, q_dot)
    unknown = np.repeat(np.abs(parts) > MOVING, len(forces) - 1)

    def simulated(ratios: Array) -> Array:
        held, pushed = _loads(forces, ratios)
        motion = seen.motion(beam, q, (n - 0.5) * dt, dt, held, q_dot=q_dot, push=pushed)
        return motion[derivative]

    def over_noise(columns: Sequence[Array]) -> Array:
        return np.stack([(c / noise).ravel() for c in columns], axis=1)

    def unread(here: Array) -> list[Array]:
        """What is not the release: amplitude, damping, frequency and, where it moves, time."""
        rate = np.gradient(here, dt, axis=0)
        return [here, t * here, t * rate, *([rate] if unknown[-1] else [])]

    def misfit(here: Array) -> float:
        y = over_noise([measured[:n] - here])
        return float(np.linalg.norm(without(y, over_noise(unread(here)))))

    ratios: Array = np.zeros(len(unknown))
    here = simulated(ratios)
    for _ in range(_ROUNDS if unknown.any() else 0):
        steps = _STEP * np.eye(len(ratios))[unknown]
        try:
            changes = [(simulated(ratios + step) - here) / _STEP for step in steps]
        except FAILURES:  # what was read so far can be held
            break
        matrix = over_noise([*changes, *unread(here)])
        matrix /= (scale := np.linalg.norm(matrix, axis=0))
        found, *_ = np.linalg.lstsq(matrix, over_noise([measured[:n] - here])[:, 0], rcond=None)
        step = np.zeros(len(unknown))
        step[unknown] = (found / scale)[: len(steps)]
        last = ratios
        ratios, here = _towards(simulated, ratios, step, here, misfit)
        if np.abs(ratios - last).max() < _READ:
            break
    held, pushed = _loads(forces, ratios)
    return ReleaseLoad(held, pushed, read=True)


def _towards(
    simulated: Callable[[Array], Array],
    ratios: Array,
    step: Array,
    here: Array,
    misfit: Callable[[Array], float],
) -> tuple[Array, Array]:
    """A step from ratios, as far as the beam can be held and comes nearer; what is there."""
    least = misfit(here)
    for share in _SHARES:
        try:
            there = simulated(ratios + share * step)
        except FAILURES:  # half as far
            continue
        if misfit(there) < least:
            return ratios + share * step, there
    return ratios, here


def ringing(
    beam: Beam, start: tuple[float, float], release: ReleaseLoad, modes: int, dt: float
) -> ReleaseLoad:
    """A release that rings the modes up to a number a little more."""
    forces, omega = _modal_forces(beam, dt)
    (first, *higher), shape = forces[:modes], beam.modes(count=1).shapes[0]

    def more(load: Array | None) -> Array:
        load = first if load is None else load
        size = float(np.vdot(load, shape) / np.vdot(first, shape))
        return np.asarray(load + _STEP * size * sum(higher))

    q, q_dot = start
    if abs(q_dot) > omega * abs(q):
        return release._replace(push=more(release.push))
    return release._replace(load=more(release.load))


def _loads(forces: Array, ratios: Array) -> Iterator[Array]:
    """Sums of modal forces: what holds, what pushes."""
    for own in np.split(ratios, 2):
        yield np.asarray(forces[0] + np.tensordot(own, forces[1:], axes=1))


def _modal_forces(beam: Beam, dt: float) -> tuple[Array, float]:
    """Forces of the first bending modes that the sampling shows, and the frequency of the first.

    Each bends the beam by the same modal displacement.
    """
    free = int(np.count_nonzero(~beam.assembly.fixed))
    basis = beam.modes(count=min(2 * _HIGHER + 2, free - 2))
    bending = np.flatnonzero(basis.axial < _AXIAL)[: 1 + _HIGHER]
    seen = [m for m in bending if basis.omega[m] * dt < _RESOLVED * np.pi]
    forces = basis.momenta[seen] * basis.omega[seen, None, None] ** 2
    return forces, float(basis.omega[bending[0]])


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

    def moved(
        self,
        equation: ExtendedEquation,
        parts: Sequence[Part],
        record: Record,
        decay: Decay,
        start: tuple[float, float],
        release: ReleaseLoad | None,
    ) -> Moved:
        """What the sensors, that measured ``decay``, read of the beam with some parts.

        The release is read from them where none is given.
        """
        beam = beam_with(self.seen.beam, parts)
        own = decay.between(record.decay.t[0])
        if release is None:
            release = read_release(self.seen, beam, start, own.signal, own.dt, own.derivative)
        try:
            return Moved(simulated(self.seen, beam, record, own, start, release), start, release)
        except FAILURES:
            if not release.read:
                raise
        # By loads that cannot hold it, it was not held: what was read is no release.
        release = ReleaseLoad(read=True)
        return Moved(simulated(self.seen, beam, record, own, start, release), start, release)


def simulated(
    seen: InstrumentedBeam,
    beam: Beam,
    record: Record,
    decay: Decay,
    start: tuple[float, float],
    release: ReleaseLoad,
    fastest: float = 0.0,
) -> list[Array]:
    """What the sensors read of a beam: displacements, velocities, accelerations.

    At the times of a record; the decay holds what was measured, as fast as it was. Steps do not
    damp modes up to the ``fastest``, rad/s.
    """
    dt = record.decay.dt
    finer = round(dt / decay.dt) if decay.derivative else 1  # displacements hardly show fast modes
    finer = max(finer, int(np.ceil(fastest * dt / _TURN)))
    step, (q, q_dot) = dt / finer, start
    duration = float(record.t[-1]) + 0.5 * step
    motion = seen.motion(beam, q, duration, step, release.load, q_dot=q_dot, push=release.push)
    return [downsample(x, finer) for x in motion]
