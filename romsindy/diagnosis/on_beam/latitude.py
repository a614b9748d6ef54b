"""How well sensors and the higher modes of a beam are known, beside what is simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.beam.beam import Beam
from romsindy.diagnosis.all_sensors import GAINS
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.fit.verdict import SAME_DAMPING
from romsindy.typing import Array

# Relative standard deviation of the frequency of the second mode, at the least. Errors of a mesh,
# of steps in time and of small masses grow with the frequency.
_FREQUENCY = 5e-4


@dataclass(frozen=True, eq=False)
class Latitude:
    """What sensors and higher modes may do beside what is simulated: standard deviations."""

    gains: Array  # (n_sensors,), relative, of the sensors
    frequencies: Array  # (n_modes,), relative, of the modes above the first that are told apart
    rates: Array  # (n_modes,), of their damping, 1/s

    @property
    def spreads(self) -> Array:
        """All, as the columns that they belong to."""
        pairs = np.stack([self.frequencies, self.rates], axis=1).ravel()
        return np.concatenate([self.gains, pairs])

    @classmethod
    def of(
        cls,
        seen: InstrumentedBeam,
        doubtful: Sequence[Beam],
        damping: tuple[float, float],
        gains: Array,
    ) -> Latitude:
        """Latitude of a beam, given what it would be if each doubtful parameter were another.

        ``damping`` are standard deviations of alpha and eta, 1/s and s; zero where none is stated.
        """
        count = seen.shapes.shape[1]
        omega = seen.basis.omega[:count]
        shifts = [b.modes(count=count).omega / omega - 1 for b in doubtful]
        least = _FREQUENCY * omega / omega[min(1, count - 1)]
        frequencies = np.sqrt(least**2 + sum(x**2 for x in shifts))
        alpha, eta = np.hypot(damping, SAME_DAMPING * np.array([seen.beam.alpha, seen.beam.eta]))
        rates = np.hypot(alpha, eta * omega**2) / 2
        return cls(np.hypot(GAINS, gains), frequencies[1:], rates[1:])
