"""Where simulation and measurement disagree: by amplitude, phase, harmonic, time and record.

The force that the simulation lacks is its residual along the smoothed measured motion: it needs no
fit, and no simulation that keeps step with the measurement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.diagnosis.report import DiagnosisReport
from romsindy.fit.linear_response import nodes
from romsindy.fit.part import ExtendedEquation, Part
from romsindy.fit.record import Record
from romsindy.record.smoothing import HarmonicSpline
from romsindy.typing import Array

HARMONICS = 3
_CYCLES = (2.0, 10.0)  # between knots, in short and in long records
_LEAST_NODES = 2  # in a cell of the plane of q and q_dot; one cycle leaves about three


@dataclass(frozen=True)
class MissingForce:
    """Residual force along the measured motion of one record, (n,) each.

    ``force`` is in parts of the largest restoring force, ``q`` and ``q_dot`` in parts of their
    largest; ``phase`` in rad; ``t`` in s.
    """

    t: Array
    q: Array
    q_dot: Array
    phase: Array
    force: Array

    @classmethod
    def of(cls, report: DiagnosisReport, parts: tuple[Part, ...], index: int = 0) -> MissingForce:
        """Of the nominal model with some parts, along a record."""
        record = report.records[index]
        t = nodes(record.motion)[0]
        # Fewer knots and harmonics than a fit starts from: accelerations amplify noise.
        phase = record.spline.phase
        n_cycles = float(phase(record.t[-1]) - phase(0.0)) / (2 * np.pi)
        cycles = min(max(n_cycles / 10, _CYCLES[0]), _CYCLES[1])
        spline = HarmonicSpline.along(phase, record.t, record.decay.q, cycles, HARMONICS)
        q, q_dot, q_ddot = spline(t)
        equation = ExtendedEquation(report.nominal, parts, index, record.motion.grid.step)
        # What is missing on the right side: positive pushes towards positive q.
        force = equation.linearise(t, q, q_dot, q_ddot).residual
        scale = float(np.abs(q_ddot).max())
        return cls(
            t,
            q / np.abs(q).max(),
            q_dot / np.abs(q_dot).max(),
            record.spline.phase(t),
            force / scale,
        )

    def harmonics(self) -> Array:
        """Amplitudes of the loudest third on harmonics 0 to 3: in phase with q, and with q_dot."""
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


def record_errors(report: DiagnosisReport) -> tuple[list[str], Array, Array]:
    """Names, and error over noise before and after, of every record and what was held out."""
    names: list[str] = []
    before: list[float] = []
    after: list[float] = []
    fits = [report.base.solution.residuals, report.best.solution.residuals]
    for i, record in enumerate(report.records):
        names.append(f"record {i + 1}")
        for residuals, values in zip(fits, (before, after), strict=True):
            values.append(_rms(record, residuals[i]))
    for i, p in enumerate(report.gap.predictions if report.gap.unseen else ()):
        names.append("held out" if len(report.gap.predictions) == 1 else f"held out {i + 1}")
        before.append(p.error(p.before))
        after.append(p.error(p.after))
    return names, np.array(before), np.array(after)


def errors_per_cycle(report: DiagnosisReport) -> tuple[Array, Array, Array]:
    """Times of the held-out cycles, and their error over noise before and after."""
    p = report.gap.predictions[0]
    cycle = np.floor(p.record.spline.phase(p.record.t) / (2 * np.pi)).astype(int)
    cycle -= cycle.min()
    count = np.maximum(np.bincount(cycle), 1)
    rms = [
        np.sqrt(np.bincount(cycle, p.record.whitened(p.record.signal - x) ** 2) / count)
        for x in (p.before, p.after)
    ]
    return np.bincount(cycle, p.record.t) / count, rms[0], rms[1]


def _rms(record: Record, residual: Array) -> float:
    if not np.all(np.isfinite(residual)):
        return float("nan")
    return float(np.sqrt(np.mean(record.whitened(residual) ** 2)))
