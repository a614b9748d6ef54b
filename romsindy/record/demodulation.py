"""A vibration cycle by cycle: amplitude, phase and waveform, from all of its samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter
from scipy.sparse import csr_array

from romsindy.typing import Array

HIGHEST = 4  # harmonic of a waveform
_SMOOTH, _DEGREE = 9, 4  # cycles behind each rate, and degree of the polynomial through them


@dataclass(frozen=True)
class Cycles:
    """First harmonic and waveform of the cycles of a vibration, in the order of time."""

    t: Array  # (n,), middle of each cycle, s
    # (n,), of the first harmonic; the angle, in rad, counts on from cycle to cycle
    amplitude: Array
    angle: Array
    waveform: Array  # (n, h): mean, harmonics 2, 3, ... relative to the angle; unit of the signal

    def __len__(self) -> int:
        return len(self.t)

    @classmethod
    def of(cls, t: Array, x: Array, phase: Array) -> Cycles:
        """Demodulate a signal (n,) by a phase (n,) that follows it, in rad.

        Windows of two cycles (Hann) add up to one: no sample is lost, and harmonics do not leak
        into each other while amplitudes change.
        """
        turn = phase / (2 * np.pi)
        first = np.floor(turn).astype(int)
        per_cycle = (len(t) - 1) / (turn[-1] - turn[0])
        orders = np.arange(max(2, min(HIGHEST, int(0.45 * per_cycle)) + 1))
        waves = x[:, None] * np.exp(-1j * phase[:, None] * orders)
        centres = np.arange(int(np.ceil(turn[0])) + 1, int(np.floor(turn[-1])))
        # Every sample belongs to the window that is centred before it, and to the one after it.
        later = np.sin(np.pi / 2 * (turn - first)) ** 2
        at = np.concatenate([first, first + 1]) - centres[0] if len(centres) else np.array([], int)
        weight = np.concatenate([1 - later, later])[: len(at)]
        sample = np.tile(np.arange(len(t)), 2)[: len(at)]
        full = (at >= 0) & (at < len(centres))
        window = csr_array((weight[full], (at[full], sample[full])), (len(centres), len(t)))
        total = window @ np.ones(len(t))
        c = (window @ waves) / total[:, None]
        shift = np.angle(c[:, 1])
        turned = c * np.exp(-1j * shift[:, None] * orders) * np.where(orders, 2, 1)
        return cls(
            (window @ t) / total,
            2 * np.abs(c[:, 1]),
            (window @ phase) / total + np.unwrap(shift),
            np.delete(turned, 1, axis=1),
        )

    def rates(self) -> tuple[Array, Array]:
        """Angular frequency, rad/s, and decay rate, 1/s, of every cycle, smoothed a little."""
        dt = _derivative(self.t)
        return _derivative(self.angle) / dt, -_derivative(np.log(self.amplitude)) / dt


def _derivative(x: Array) -> Array:
    """Change from one cycle to the next."""
    width = min(_SMOOTH, len(x))
    return np.asarray(savgol_filter(x, width, min(_DEGREE, width - 1), deriv=1))
