"""A decay made on the spot, for examples, benchmarks and first steps."""

from __future__ import annotations

from copy import deepcopy
from functools import lru_cache

import numpy as np

from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.signals import with_noise

_STIFFNESS = {"omega^2": 36.0, "gamma_2": 2.0, "gamma_3": 9.0}
_INERTIA = {"Upsilon_3": 0.30, "Upsilon_4": 0.05, "Upsilon_5": 0.12}
EXAMPLE_MODEL = ReducedModel.from_coefficients(_STIFFNESS | _INERTIA | {"c_linear": 0.06}, "m")


def add_noise(decay: Decay, snr_db: float, seed: int) -> Decay:
    """White noise on the displacement; velocity and acceleration are dropped.

    Parameters
    ----------
    decay : Decay
    snr_db : float
        Ratio of the rms of q over the whole record to that of the noise, in dB.
    seed : int

    Examples
    --------
    >>> clean = example_decay(periods=5)
    >>> noise = add_noise(clean, snr_db=40, seed=0).q - clean.q
    >>> round(float(noise.std() / clean.q.std()), 3)
    0.01
    """
    return Decay(decay.t, with_noise(decay.q, snr_db, seed), unit=decay.unit)


def example_decay(
    snr_db: float | None = None, seed: int = 0, *, periods: float = 150, samples: int = 100
) -> Decay:
    """Decay of an oscillator with nonlinear stiffness and inertia (`EXAMPLE_MODEL`), from 1.8 m.

    Parameters
    ----------
    snr_db : float, optional
        Signal-to-noise ratio in dB; without it the decay is clean, with exact derivatives.
    seed : int
        Of the noise.
    periods, samples : float, int
        Length in linear periods, and samples in each.

    Examples
    --------
    >>> example_decay(snr_db=40, periods=5)
    <Decay: 501 samples at 95.493 Hz, 5.236 s, max |q| 1.867 m, measured displacement>
    """
    clean = deepcopy(_clean(periods, samples))  # arrays of its own
    return clean if snr_db is None else add_noise(clean, snr_db, seed)


@lru_cache(maxsize=4)  # most are the same motion with other noise
def _clean(periods: float, samples: int) -> Decay:
    period = 2 * np.pi / np.sqrt(EXAMPLE_MODEL.coefficients["omega^2"])
    t = np.arange(round(periods * samples) + 1) * period / samples
    return EXAMPLE_MODEL.simulate(1.8, 0.0, t, rtol=1e-12)
