"""What the beam does beside its reduced model, taken off the measurement.

A reduced model follows its beam to a few parts in a thousand. The defect, beam minus reduced model
with the same effects and from the same release, hardly depends on what is still missing: with it
taken off, a fit of the reduced model is one of the beam (defect correction, [1]).

[1] H. Stetter, The defect correction principle and discretization methods, Numer. Math. 29 (1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from romsindy.beam import Beam
from romsindy.diagnosis.on_beam.doubts import Doubt, changes_of
from romsindy.diagnosis.on_beam.instrumented import UNIT, InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import BeamEffect
from romsindy.diagnosis.on_beam.release import load_at_release
from romsindy.fit.collocation import integrate
from romsindy.fit.gauss_newton import fit
from romsindy.fit.linear_response import sampled
from romsindy.fit.part import ExtendedEquation, Part, read
from romsindy.fit.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.typing import Array


class Corrected(NamedTuple):
    """A decay without the defect, and the displacements (n, n_sensors) of the beam in it."""

    decay: Decay
    readings: Array


def on_the_beam(parts: Sequence[Part]) -> tuple[Part, ...]:
    """Parts that exist on a beam and are there."""
    return tuple(p for p in parts if isinstance(p.effect, BeamEffect) and np.any(p.strengths))


def effects_of(parts: Sequence[Part]) -> list[Any]:
    """What `Beam.with_effect` takes, of some parts."""
    there = on_the_beam(parts)
    own = [p for p in there if not isinstance(p.effect, Doubt)]
    return changes_of(there) + [p.effect.on_beam(float(p.strengths[0, 0])) for p in own]


def beam_with(beam: Beam, parts: Sequence[Part]) -> Beam:
    """The beam with the effects of some parts."""
    return reduce(Beam.with_effect, effects_of(parts), beam)


def corrected(
    seen: InstrumentedBeam,
    model: ReducedModel,
    parts: Sequence[Part],
    record: Record,
    decay: Decay,
    load: Array | None = None,
) -> Corrected:
    """Simulate the beam and its reduced model, both with the effects that a beam can have.

    Only the coordinate of the release is fitted. The record is that of the coordinate, the decay
    holds the displacements of the sensors, m. The nodal load (n_nodes, 3) that held the beam is
    read from the sensors where none is given.
    """
    parts = on_the_beam(parts)
    beam = beam_with(seen.beam, parts)
    solution = fit(model, parts, [record], fixed=True, iterations=25)
    start = solution.motions[0].q[:1]
    if not np.isfinite(solution.chi_squared):
        start = record.motion.q[:1]
    shown = float(read(parts, 0, record.t[:1], start)[0][0])
    dt = record.decay.dt
    if load is None:
        measured = decay.between(record.decay.t[0], record.decay.t[-1]).q
        load = load_at_release(seen, beam, shown, measured, dt)
    readings = seen.readings(beam, shown, float(record.t[-1]) + 0.5 * dt, dt, load)
    equation = ExtendedEquation(model, parts, 0, record.motion.grid.step)
    motion = integrate(equation, (float(start[0, 0]), 0.0), record.motion.grid)
    reduced = read(parts, 0, record.t, sampled(motion))[0]
    q = record.signal - (seen.coordinate(readings) - reduced)
    return Corrected(Decay(record.decay.t, q, unit=UNIT), readings)
