"""The simulated experiment: five noisy sensors and mode shapes of the default beam."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

import romsindy as rs
from romsindy.record.signals import with_noise

SNR_DB = 35.0  # of displacements and of mode shapes


@dataclass(frozen=True)
class Records:
    """Sensors of the beam without noise."""

    t: np.ndarray
    displacement: np.ndarray
    shapes: np.ndarray
    omega: float


def beam_records(elements: int) -> Records:
    """Default beam, released from a third of its length by a modal force; 25 s, five points."""
    beam = rs.Beam.cantilever(elements=elements)
    sensors = beam.sensors([0.03, 0.135, 0.24, 0.345, 0.45])
    motion = beam.simulate(beam.release_shape(0.15, mode=1), 25.0, sensors=sensors, progress=False)
    return Records(
        motion.t,
        sensors.measure(motion),
        sensors.mode_shapes(motion.basis, 3),
        float(motion.basis.omega[0]),
    )


def trial(records: Records, seed: int) -> tuple[float, float, float, float]:
    """|omega_1| off, backbone off (rms), share of it that the band holds, width of the band.

    All relative. The true backbone is extracted from the noise-free displacements, seen through
    the same mode shapes. The model's is extracted alike from its simulated decay: what extraction
    and damping do to a frequency then cancels.
    """
    row = np.linalg.pinv(with_noise(records.shapes, SNR_DB, 2 * seed + 1))[0]
    q = with_noise(records.displacement, SNR_DB, 2 * seed) @ row
    found = rs.identify(rs.Decay(records.t, q, unit="kg^0.5 m"))
    pure = records.displacement @ row
    own = _decayed(found.model, pure[0], records.t)
    amplitude, true = _known(_extracted(records.t, pure), own)
    off = own(amplitude) / true - 1
    std = found.band(amplitude).frequency_std / true
    linear = found.model.coefficients["omega^2"] ** 0.5 / records.omega - 1
    held = np.mean(np.abs(off) <= 1.96 * std)
    return float(abs(linear)), float(np.sqrt(np.mean(off**2))), float(held), float(std.mean())


def _decayed(model: rs.ReducedModel, start: float, t: np.ndarray) -> CubicSpline:
    """Backbone of a model, extracted from its own decay."""
    simulated = model.simulate(start, 0.0, t)
    return _extracted(simulated.t, simulated.q)


def _extracted(t: np.ndarray, q: np.ndarray) -> CubicSpline:
    """Frequency (rad/s) over amplitude, read off a clean decay."""
    backbone = rs.extract_backbone(rs.Decay(t, q))
    order = np.argsort(backbone.amplitude)
    return CubicSpline(backbone.amplitude[order], backbone.frequency[order], extrapolate=False)


def _known(truth: CubicSpline, model: CubicSpline) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes and frequencies of the true cycles that the model's decay covers."""
    inside = (truth.x >= model.x[0]) & (truth.x <= model.x[-1])
    return truth.x[inside], truth(truth.x[inside])
