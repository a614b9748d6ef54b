"""The vibrations of a model: as small ones, and how large they were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.fit.kernel.prepared import Prepared, one_a_decay
from romsindy.fit.results.estimate import Estimate
from romsindy.physics.equations import Equations
from romsindy.typing import Array


@dataclass(frozen=True, eq=False)
class SmallVibration:
    """One mode of small vibrations, and the vibration of the decays that is near it."""

    number: int  # of the mode, by frequency, from 1
    coordinate: int  # that it moves most, from 1
    # Of small vibrations, Hz and without unit, with standard errors
    frequency: float
    frequency_std: float
    damping_ratio: float
    damping_ratio_std: float
    # (n,), of the coordinate, as it was followed in all decays; unit of q
    measured_amplitude: Array
    measured_frequency: Array  # (n,), at these amplitudes, Hz; the other coordinates move it, too


def small_vibrations(fit: Estimate, records: Sequence[Prepared]) -> tuple[SmallVibration, ...]:
    """The modes of a model that was fitted to some records, by frequency."""
    numbers = np.stack([_linear(fit.model), fit.errors_of(_linear)], axis=1)  # (2, 2, R)
    main = np.argmax(np.abs(fit.model.linear_modes[1]), axis=0)
    found = []
    for i, coordinate in enumerate(main.tolist()):
        frequency, frequency_std, ratio, ratio_std = numbers[:, :, i].ravel().tolist()
        found.append(
            SmallVibration(
                i + 1,
                coordinate + 1,
                frequency,
                frequency_std,
                ratio,
                ratio_std,
                *_followed(fit, records, coordinate),
            )
        )
    return tuple(found)


def _followed(fit: Estimate, records: Sequence[Prepared], coordinate: int) -> tuple[Array, Array]:
    """Amplitude of a coordinate, and its frequency in Hz, as followed in all decays.

    Where inputs drive it, its largest displacement; its frequency is theirs.
    """
    ringing = one_a_decay(records)
    if not ringing:
        return np.array([max(map(abs, fit.reach_of(coordinate + 1)))]), np.array([np.nan])
    tones = [(r.tones[coordinate], r) for r in ringing]
    amplitude = [t.amplitude / (2 * np.pi * t.frequency) ** r.derivative for t, r in tones]
    return np.concatenate(amplitude), np.concatenate([t.frequency for t, _ in tones])


def _linear(model: Equations) -> Array:
    """Frequencies, Hz, and damping ratios of the modes, (2, R)."""
    return np.array([model.linear_modes[0] / (2 * np.pi), model.linear_damping_ratios])
