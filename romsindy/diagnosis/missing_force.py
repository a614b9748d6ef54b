"""Where simulation and measurement disagree: by amplitude, phase, harmonic, time and record.

The force that the simulation lacks is its residual along the smoothed measured motion: it needs no
fit, and no simulation that keeps step with the measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from romsindy.diagnosis.gap import Gap, Prediction, name_of
from romsindy.diagnosis.prediction import predict
from romsindy.fit.equation import ExtendedEquation
from romsindy.fit.linear_response import nodes
from romsindy.fit.part import Part
from romsindy.fit.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.record.smoothing import HarmonicSpline
from romsindy.typing import Array

HARMONICS = 3
_CYCLES = (2.0, 10.0)  # between knots, in short and in long records
_LEAST_NODES = 2  # in a cell of the plane of q and q_dot; one cycle leaves about three


@dataclass(frozen=True)
class MissingForce:
    """Residual force along the measured motion of one record, (n,) each.

    ``force`` is in parts of the largest restoring force, ``q`` and ``q_dot`` in parts of their
    largest; ``phase`` is that of q, in rad; ``t`` in s.
    """

    t: Array
    q: Array
    q_dot: Array
    phase: Array
    force: Array

    @classmethod
    def of(
        cls, model: ReducedModel, parts: Sequence[Part], record: Record, index: int = 0
    ) -> MissingForce:
        """Of a model with some parts, along a record: number ``index`` of those fitted."""
        t = nodes(record.motion)[0]
        # Of the displacement, whatever was measured: a velocity leads it by a quarter of a cycle.
        phase = HarmonicSpline.fit(record.t, record.decay.q).phase
        # Fewer knots and harmonics than a fit starts from: accelerations amplify noise.
        n_cycles = float(phase(record.t[-1]) - phase(0.0)) / (2 * np.pi)
        cycles = min(max(n_cycles / 10, _CYCLES[0]), _CYCLES[1])
        spline = HarmonicSpline.along(phase, record.t, record.decay.q, cycles, HARMONICS)
        q, q_dot, q_ddot = spline(t)
        equation = ExtendedEquation(
            model, tuple(parts), index, record.motion.grid.step, record.clock
        )
        # What is missing on the right side: positive pushes towards positive q.
        state = (x[:, None] for x in (q, q_dot, q_ddot))
        force = equation.linearise(t, *state).residual[:, 0]
        scale = float(np.abs(q_ddot).max())
        return cls(t, q / np.abs(q).max(), q_dot / np.abs(q_dot).max(), phase(t), force / scale)

    def harmonics(self) -> Array:
        """Amplitudes (2, 4) of the loudest third on harmonics 0 to 3: with q, and with q_dot."""
        loud = self.t <= np.quantile(self.t, 1 / 3)
        phase, force = self.phase[loud], self.force[loud]
        # The phase counts from the up-crossing: q is a sine of it, q_dot a cosine.
        shift = phase - np.pi / 2
        orders = np.arange(HARMONICS + 1)[:, None]
        weight = np.where(orders == 0, 1.0, 2.0)
        inward = np.mean(weight * force * np.cos(orders * shift), axis=1)
        along = np.mean(weight * force * np.sin(orders * shift), axis=1)
        return np.stack([inward, along])

    def plane(self, rings: int = 6, sectors: int = 32) -> tuple[Array, Array, Array]:
        """Mean force over rings and sectors of the (q, q_dot) plane.

        Radii (rings + 1,), angles (sectors + 1,), force (rings, sectors); nan where there is no
        motion.
        """
        edges = (np.linspace(0, 1.001, rings + 1), np.linspace(-np.pi, np.pi, sectors + 1))
        where = (np.hypot(self.q, self.q_dot), np.arctan2(self.q_dot, self.q))
        total = np.histogram2d(*where, edges, weights=self.force)[0]
        count = np.histogram2d(*where, edges)[0]
        return *edges, np.where(count >= _LEAST_NODES, total / np.maximum(count, 1), np.nan)


def record_errors(
    model: ReducedModel, parts: Sequence[Part], records: Sequence[Record], gap: Gap
) -> tuple[list[str], Array, Array]:
    """Names, and error over noise before and after, of every record and what was held out.

    As in the table of the gap, "before" is the simulation as it was: only the initial state follows
    the record.
    """
    predictions = [predict(model, parts, r, name_of(i)) for i, r in enumerate(records)]
    names = [p.name if p.record.part is None else f"{p.name}, fitted" for p in predictions]
    if gap.unseen:
        predictions += gap.predictions
        names += [p.title for p in gap.predictions]
    before = np.array([p.error(p.before) for p in predictions])
    after = np.array([p.error(p.after) for p in predictions])
    return names, before, after


def errors_per_cycle(p: Prediction) -> tuple[Array, Array, Array]:
    """Times of the cycles of a record that are compared, and their error over noise each time."""
    taken = np.ones(len(p.record.t), bool) if p.record.part is None else p.record.part
    white = [p.record.whitened(p.record.signal - x) for x in (p.before, p.after)]
    times, (before, after) = per_cycle(p.record.t, p.record.spline.phase(p.record.t), taken, white)
    return times, before, after


def per_cycle(
    t: Array, phase: Array, taken: NDArray[np.bool_], white: Sequence[Array]
) -> tuple[Array, list[Array]]:
    """Mean times of cycles, and the rms of errors over noise, (n,), in the samples taken of each.

    A cycle that takes part in a few samples says little, and is left out.
    """
    cycle = np.floor(phase / (2 * np.pi)).astype(int)
    cycle -= cycle.min()
    count = np.bincount(cycle, taken)
    some = count > 0.5 * np.median(np.bincount(cycle))
    rms = [np.sqrt(np.bincount(cycle, e**2)[some] / count[some]) for e in white]
    return np.bincount(cycle, t * taken)[some] / count[some], rms
