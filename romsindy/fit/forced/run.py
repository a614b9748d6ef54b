"""What a model says of a forced vibration: its motion from a state, under the measured inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from romsindy.effects import Bias
from romsindy.fit.collocation import integrate
from romsindy.fit.equation import equation_of
from romsindy.fit.fitted import Fit
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.gauss_newton import fit as fit_motion
from romsindy.fit.measured import NUMERICS, Offset
from romsindy.fit.part import Part
from romsindy.physics.driven import inputs_of
from romsindy.record.forced import ForcedVibration
from romsindy.typing import Array


def forced_run(fit: Fit, vibration: ForcedVibration, samples: int) -> Array:
    """`romsindy.free_run` of a forced vibration, (n,): the inputs are those that were measured.

    The offset of the sensor is the mean of those of the fit.
    """
    missing = [t.source for t in inputs_of(fit.model) if t.source not in vibration.names]
    if missing:
        raise ValueError(
            f"the model is driven by {missing}, and the record has {list(vibration.names)}: give"
            " all inputs under the names of the fit"
        )
    record = ForcedRecord.of(vibration, NUMERICS)
    offset = Part(Bias(), (), np.full((1, 1), np.mean(fit.offsets)))
    parts = (*(p for p in fit.solution.parts if not isinstance(p.effect, Offset)), offset)
    motion = replace(record.motion, q=record.motion.q + record.signal.mean() - offset.values[0])
    first = replace(record, motion=motion if not record.derivative else record.motion)
    first = first.until(float(record.t[samples - 1]))
    start = fit_motion(fit.start, parts, [first], fixed=True).motions[0].start
    equation = equation_of(fit.start, parts, 0, record)
    found = integrate(equation, start, record.motion.grid, record.motion)
    x = found.samples(equation, record.derivative)
    return record.read(parts, 0, x).shown
