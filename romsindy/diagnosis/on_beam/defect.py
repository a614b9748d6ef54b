"""What the beam does beside its reduced model, taken off the measurement.

A reduced model follows its beam to a few parts in a thousand. The defect, beam minus reduced model
with the same effects and from the same release, hardly depends on what is still missing: with it
taken off, a fit of the reduced model is one of the beam (defect correction, [1]).

[1] H. Stetter, The defect correction principle and discretization methods, Numer. Math. 29 (1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from romsindy.beam import Beam, NoEquilibriumError
from romsindy.diagnosis.on_beam.instrumented import SIGNALS, InstrumentedBeam, signals_of
from romsindy.diagnosis.on_beam.mounted import BeamEffect
from romsindy.diagnosis.on_beam.release import ReleaseLoad, read_release
from romsindy.diagnosis.on_beam.within_tolerances import ParameterDirection, changes_of
from romsindy.fit.collocation import integrate
from romsindy.fit.equation import ExtendedEquation
from romsindy.fit.gauss_newton import fit
from romsindy.fit.linear_response import sampled
from romsindy.fit.part import Part
from romsindy.fit.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.signals import downsample
from romsindy.typing import Array

# A cycle is left out that differs by so many times the median of so many later ones.
_RESTLESS, _NEXT = 1.3, 8


class Corrected(NamedTuple):
    """A decay without the defect, what the sensors of the beam in it read, and its release."""

    decay: Decay
    readings: Array  # (n, n_sensors), in what was measured
    start: tuple[float, float]  # coordinate and its rate
    release: ReleaseLoad


def on_the_beam(parts: Sequence[Part]) -> tuple[Part, ...]:
    """Parts that exist on a beam and are there."""
    return tuple(p for p in parts if isinstance(p.effect, BeamEffect) and np.any(p.strengths))


def effects_of(parts: Sequence[Part]) -> list[Any]:
    """What `Beam.with_effect` takes, of some parts."""
    there = on_the_beam(parts)
    own = [p for p in there if not isinstance(p.effect, ParameterDirection)]
    return changes_of(there) + [p.effect.on_beam(float(p.strengths[0, 0])) for p in own]


def beam_with(beam: Beam, parts: Sequence[Part]) -> Beam:
    """The beam with the effects of some parts.

    Raises
    ------
    NoEquilibriumError
        If there can be no such beam.
    """
    try:
        return reduce(Beam.with_effect, effects_of(parts), beam)
    except ValueError as error:
        raise NoEquilibriumError(f"there is no such beam: {error}") from error


def corrected(
    seen: InstrumentedBeam,
    model: ReducedModel,
    parts: Sequence[Part],
    record: Record,
    decay: Decay,
    release: ReleaseLoad | None = None,
    smooth: Record | None = None,
) -> Corrected:
    """Simulate the beam and its reduced model, both with the effects that a beam can have.

    Only the coordinate and its rate at the start are fitted: to the record of the coordinate, or to
    one that was corrected before, from which higher modes are gone. The decay holds what the
    sensors measured, m and s, as fast as they did. The release is read from the sensors where none
    is given.
    """
    parts = on_the_beam(parts)
    beam = beam_with(seen.beam, parts)
    smooth = smooth or record
    start = start_of(model, parts, smooth)
    equation = ExtendedEquation(model, parts, 0, record.motion.grid.step, record.clock)
    reduced = integrate(equation, np.array(start), record.motion.grid)
    own = decay.between(record.decay.t[0])
    if release is None:
        release = read_release(seen, beam, start, own.signal, own.dt, own.derivative)
    moved = simulated(seen, beam, record, own, start, release)

    def left(measured: Array, derivative: int) -> Array:
        """A signal without what the beam does beside its reduced model."""
        beside = seen.coordinate(moved[derivative]) - sampled(reduced, derivative)[:, 0]
        return np.asarray(measured - beside)

    signals: dict[str, Any] = {
        n: left(x, SIGNALS.index(n)) for n, x in signals_of(record.decay).items()
    }
    return Corrected(replace(record.decay, **signals), moved[record.derivative], start, release)


def start_of(model: ReducedModel, parts: Sequence[Part], record: Record) -> tuple[float, float]:
    """Coordinate and its rate at the start of a record, which the reduced model follows."""
    solution = fit(model, parts, [record], fixed=True, iterations=25)
    q, q_dot = (solution.motions[0] if solution.finite else record.motion).start
    return float(q), float(q_dot)


def simulated(
    seen: InstrumentedBeam,
    beam: Beam,
    record: Record,
    decay: Decay,
    start: tuple[float, float],
    release: ReleaseLoad,
) -> list[Array]:
    """What the sensors read of a beam: displacements, velocities, accelerations.

    At the times of a record; the decay holds what was measured, as fast as it was.
    """
    dt = record.decay.dt
    finer = round(dt / decay.dt) if decay.derivative else 1  # displacements hardly show fast modes
    step, (q, q_dot) = dt / finer, start
    duration = float(record.t[-1]) + 0.5 * step
    motion = seen.motion(beam, q, duration, step, release.load, q_dot=q_dot, push=release.push)
    return [downsample(x, finer) for x in motion]


def calm_from(record: Record, readings: Array) -> float:
    """Time from which on a simulated beam, seen in the coordinate, follows a record well.

    Modes that are too fast to be read from the sensors ring in the first cycles.
    """
    cycles = np.split(readings - record.signal, record.cycles)
    rms = np.array([np.std(x) for x in cycles[1:-1]])
    first = 0
    while first < len(rms) // 4 and rms[first] > _RESTLESS * np.median(rms[first + 1 :][:_NEXT]):
        first += 1
    return float(record.decay.t[record.cycles[first] if first else 0])
