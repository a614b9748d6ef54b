"""Offset that drifts: what is slower than a vibration, and no mean of it.

A vibration with asymmetric stiffness has a mean of its own, which follows its amplitude: even
powers of it, of any size, take no part here. What is left of the slow part of a record, in its
cosine transform, is noise that goes on at low frequencies, power that rises towards slow
frequencies (a random walk: 1/f^2), and slow lines (a temperature that swings).
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.fft import dct
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from romsindy.record.spectrum import TOGETHER, Spectrum
from romsindy.typing import Array, Indices

_MEAN = (2, 4, 6, 8)  # powers of the amplitude
_LEAST = 15  # cosines that tell a drift from such a mean
_SLOW, _LINES = 0.4, 0.2  # fundamentals: what is slow, and up to where slow lines are drift
_POWERS = (0.0, 1.0, 2.0, 3.0, 4.0)
_SIZES = np.geomspace(1e-2, 1e10, 61)  # of the slowest cosine, over the noise
_REACH = 3  # so many times further the drift goes on as it is found where it is slow
_CHANCE = 1e-2  # drift is believed against noise without it
_AROUND, _ROUNDS = 3, 4  # cosines that a slow line shares; passes over them


def drift(
    slow: Array, amplitude: Array, noise: Spectrum, cycle: float, dt: float
) -> Spectrum | None:
    """Power that a drifting offset adds to the noise; None where there is no drift.

    Parameters
    ----------
    slow : (n,) array
        A record without the harmonics of its vibration.
    amplitude : (n,) array
        Of the vibration.
    noise : Spectrum
        Of the noise between the harmonics.
    cycle, dt : float
        Mean length of a cycle, and sampling interval, s.
    """
    n = len(slow)
    count = int(2 * n * dt * _SLOW / cycle)
    if count < _LEAST:
        return None
    k = np.arange(_REACH * count)
    frequency = k / (2 * n * dt)
    series = (amplitude / amplitude.max())[:, None] ** np.array(_MEAN)
    # The first cosine is a constant: an offset that stays is no drift, and free here.
    y, x = (dct(z, norm="ortho", axis=0)[1:count] for z in (slow, series))
    quiet = noise(frequency)
    added = _rising(y, x, quiet, k)
    lines = _lines(y, x, quiet + added, int(count * _LINES / _SLOW))
    if not np.any(added) and not np.any(lines):
        return None
    # From half of the fundamental on, the noise between the harmonics holds the drift, too.
    added = np.where(frequency * cycle > 0.5, np.maximum(added - quiet, 0.0), added) + lines
    nothing = 1e-12 * float(quiet.min())  # beyond the slow part
    beyond = frequency[-1] + frequency[1]
    return Spectrum(np.append(frequency, beyond), np.append(np.maximum(added, nothing), nothing))


def _rising(y: Array, x: Array, quiet: Array, k: Indices) -> Array:
    """Power laws of the cosine's number, as likely as each is; none if none is distinctly so."""
    # A constant is as uncertain as half a cosine would be.
    laws = [
        quiet[0] * size / np.maximum(k, 0.5) ** power
        for size, power in itertools.product(_SIZES, _POWERS)
    ]
    slow = slice(1, len(y) + 1)
    found = [_left(y, x, (quiet + law)[slow])[0] for law in laws]
    gain = _left(y, x, quiet[slow])[0] - min(found)
    if gain < chi2.isf(_CHANCE, 2):
        return np.zeros(len(k))
    return np.average(laws, axis=0, weights=np.exp(-0.5 * (np.array(found) - min(found))))


def _lines(y: Array, x: Array, variance: Array, slowest: int) -> Array:
    """What neighbouring cosines hold beyond their variance, together, with what leaks from it."""
    k, j = np.arange(len(variance)), np.arange(1, slowest)[:, None]
    # A line between two cosines is in all others, too: see `Spectrum.leaking`.
    leak = TOGETHER * j**2 / (j**2 + (k**2 - j**2) ** 2)
    lines = np.zeros(len(variance))
    for _ in range(_ROUNDS):
        total = (variance + lines)[1 : len(y) + 1]
        _, left, spare = _left(y, x, total)
        share = uniform_filter1d(spare, _AROUND, mode="nearest")
        near = uniform_filter1d(left**2, _AROUND, mode="nearest")
        loud = near > chi2.isf(_CHANCE / len(y), _AROUND * share) / _AROUND
        if not np.any(loud[: slowest - 1]):
            break
        own = np.where(loud, total * near / share, 0.0)[: slowest - 1]
        lines = np.maximum(lines, np.max(own[:, None] * leak, axis=0))
    return lines


def _left(y: Array, x: Array, variance: Array) -> tuple[float, Array, Array]:
    """Fit y = x b + noise.

    Minus twice the restricted log-likelihood, what is left over the noise, and the share of it that
    the fit leaves.
    """
    weight = 1 / np.sqrt(variance)
    q, r = np.linalg.qr(x * weight[:, None])
    left = y * weight
    left = left - q @ (q.T @ left)
    surprise = np.log(variance).sum() + 2 * np.log(np.abs(np.diag(r)) + 1e-300).sum() + left @ left
    return float(surprise), left, np.maximum(1 - np.sum(q**2, axis=1), 1e-3)
