"""The vibrations of a model: small ones, how large they were, and which ring near p : q.

Ratios of frequencies are read off the tones of the records, never put in: no fit asks for one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.fit.kernel.prepared import Prepared, one_a_decay
from romsindy.fit.results.estimate import Estimate
from romsindy.physics.coupled import AnyModel, CoupledModel
from romsindy.record.vibrations import Resonance, resonances_of
from romsindy.text import quantity
from romsindy.typing import Array


@dataclass(frozen=True, eq=False)
class SmallVibration:
    """One mode of small vibrations, and the vibration of the decays that is near it.

    Attributes
    ----------
    number : int
        Of the mode, by frequency, from 1.
    coordinate : int
        That it moves most, from 1.
    frequency, frequency_std : float
        Of small vibrations, Hz, with its standard error.
    damping_ratio, damping_ratio_std : float
    measured_amplitude : (n,) array
        Of the coordinate, as it was followed in all decays; unit of q.
    measured_frequency : (n,) array
        At these amplitudes, Hz; the other coordinates move it, too.
    """

    number: int
    coordinate: int
    frequency: float
    frequency_std: float
    damping_ratio: float
    damping_ratio_std: float
    measured_amplitude: Array
    measured_frequency: Array


def small_vibrations(fit: Estimate, records: Sequence[Prepared]) -> tuple[SmallVibration, ...]:
    """The modes of a model that was fitted to some records, by frequency."""
    numbers = np.stack([_linear(fit.model), fit.errors_of(_linear)], axis=1)  # (2, 2, R)
    main = np.argmax(np.abs(_coupled(fit.model).linear_modes[1]), axis=0)
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


def _linear(model: AnyModel) -> Array:
    """Frequencies, Hz, and damping ratios of the modes, (2, R)."""
    coupled = _coupled(model)
    return np.array([coupled.linear_modes[0] / (2 * np.pi), coupled.linear_damping_ratios])


def _coupled(model: AnyModel) -> CoupledModel:
    assert isinstance(model, CoupledModel)  # a fit of several coordinates
    return model


def resonances_in(records: Sequence[Prepared]) -> tuple[Resonance, ...]:
    """Pairs of modes, counted from 0 by frequency, where they come nearest to p : q in any record.

    Empty for records of one coordinate.
    """
    several = one_a_decay(records)
    if not several:
        return ()
    by_frequency = np.argsort([np.median(tone.frequency) for tone in several[0].tones])
    nearest: dict[tuple[int, int, int, int], Resonance] = {}
    for record in several:
        for r in resonances_of([record.tones[i] for i in by_frequency], record.derivative):
            pair = (r.lower, r.higher, r.p, r.q)
            nearest[pair] = min(nearest.get(pair, r), r, key=lambda x: x.off)
    return tuple(nearest[pair] for pair in sorted(nearest))


def resonance_notes(model: AnyModel, records: Sequence[Prepared]) -> list[str]:
    """A sentence for each of them."""
    return [
        f"modes {r.lower + 1} and {r.higher + 1} ring at {r.p}:{r.q} (ratio {r.ratio:.4g} at"
        f" {quantity(r.amplitude, model.unit or '[q]')})"
        f"{'' if _couples(model, r) else ', but no term of the model couples them'}"
        for r in resonances_in(records)
    ]


def _couples(model: AnyModel, resonance: Resonance) -> bool:
    """Whether the equation of one coordinate holds the other, in a motion of both."""
    if not isinstance(model, CoupledModel):
        return False
    main = np.argmax(np.abs(model.linear_modes[1]), axis=0)
    i, j = main[resonance.lower], main[resonance.higher]
    moving = np.ones(model.n_coordinates)
    return any(slope[i, j] or slope[j, i] for slope in model.linearise(moving, moving, moving)[1:])
