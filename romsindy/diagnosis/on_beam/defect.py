"""What the beam does beside its reduced model, taken off the measurement.

A reduced model follows its beam to a few parts in a thousand. The defect, beam minus reduced model
with the same effects and from the same release, hardly depends on what is still missing: with it
taken off, a fit of the reduced model is one of the beam (defect correction, [1]).

[1] H. Stetter, The defect correction principle and discretization methods, Numer. Math. 29 (1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from romsindy.beam.beam import Beam
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.release import FAILURES, BeamRelease, read_release, steps
from romsindy.diagnosis.on_beam.within_tolerances import beam_with, on_the_beam
from romsindy.diagnosis.structure import Moved, as_measured, linear_parts, start_of
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.signals import downsample
from romsindy.typing import Array

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

    def moved(
        self,
        equation: ExtendedEquation,
        parts: Sequence[Part],
        record: Record,
        decay: Decay,
        start: tuple[float, float],
        release: BeamRelease | None,
    ) -> Moved:
        """What the sensors, that measured ``decay``, read of the beam with some parts.

        The release is read from them where none is given.
        """
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
