"""Where simulation and measurement disagree: by amplitude, phase, harmonic, time and record.

The force that the simulation lacks is its residual along the smoothed measured motion: it needs no
fit, and no simulation that keeps step with the measurement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.diagnosis.fitting import ExtendedEquation, Part
from romsindy.diagnosis.records import Measured
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.quasilinear import nodes
from romsindy.typing import Array

HARMONICS = 4


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
        t, q, q_dot, q_ddot = nodes(record.motion)
        equation = ExtendedEquation(report.nominal, parts, index, record.motion.grid.step)
        force = -equation.linearise(t, q, q_dot, q_ddot).residual
        scale = float(np.abs(q_ddot).max())
        return cls(
            t,
            q / np.abs(q).max(),
            q_dot / np.abs(q_dot).max(),
            record.spline.phase(t),
            force / scale,
        )

    def per_cycle(self) -> tuple[Array, Array]:
        """Times of the cycles, and rms of the force over each."""
        cycle = np.floor(self.phase / (2 * np.pi)).astype(int)
        cycle -= cycle.min()
        count = np.maximum(np.bincount(cycle), 1)
        return (
            np.bincount(cycle, self.t) / count,
            np.sqrt(np.bincount(cycle, self.force**2) / count),
        )

    def harmonics(self) -> Array:
        """Amplitudes of the loudest third on harmonics 0 to 4: in phase with q, and with q_dot."""
        loud = self.t <= np.quantile(self.t, 1 / 3)
        phase, force = self.phase[loud], self.force[loud]
        # The phase counts from the up-crossing: q is a sine of it, q_dot a cosine.
        shift = phase - np.pi / 2
        orders = np.arange(HARMONICS + 1)[:, None]
        weight = np.where(orders == 0, 1.0, 2.0)
        inward = np.mean(weight * force * np.cos(orders * shift), axis=1)
        along = np.mean(weight * force * np.sin(orders * shift), axis=1)
        return np.stack([inward, along])

    def plane(self, bins: int = 24) -> tuple[Array, Array]:
        """Edges, and mean force over the (q, q_dot) plane, nan where the motion never is."""
        edges = np.linspace(-1.001, 1.001, bins + 1)
        total = np.histogram2d(self.q, self.q_dot, edges, weights=self.force)[0]
        count = np.histogram2d(self.q, self.q_dot, edges)[0]
        return edges, np.where(count > 2, total / np.maximum(count, 1), np.nan)


def record_errors(report: DiagnosisReport) -> tuple[list[str], Array, Array]:
    """Names, and error over noise before and after, of every record and what was held out."""
    names, before, after = [], [], []
    fits = [report.base.solution.residuals, report.best.solution.residuals]
    for i, record in enumerate(report.records):
        names.append(f"record {i + 1}")
        for residuals, values in zip(fits, (before, after), strict=True):
            values.append(_rms(record, residuals[i]))
    for i, p in enumerate(report.gap.predictions):
        names.append("held out" if len(report.gap.predictions) == 1 else f"held out {i + 1}")
        before.append(p.error(p.before))
        after.append(p.error(p.after))
    return names, np.array(before), np.array(after)


def _rms(record: Measured, residual: Array) -> float:
    if not np.all(np.isfinite(residual)):
        return float("nan")
    return float(np.sqrt(np.mean(record.noise(residual) ** 2)))
