"""What is behind the samples of a forced record: its smooth motion, and its inputs between them.

A fit starts from the motion; what an input does between its samples the record decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d

from romsindy.fit.kernel.collocation import Grid, Trajectory
from romsindy.fit.verdict import EQUIVALENT, FORM
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import INTERPOLATIONS, Interpolation
from romsindy.record.prediction import innovation
from romsindy.record.spectrum import falling_power, quiet_power
from romsindy.text import listed
from romsindy.typing import Array

_LINES = 9  # of the spectrum over which its power is averaged
_FINER = 4  # samples of the smooth motion in the place of one


def smooth_motion(y: Array, dt: float, derivative: int, grid: Grid) -> Trajectory:
    """Displacement on the steps of a simulation, from a measured derivative of it (n,).

    What stands out of the noise passes (N. Wiener's filter); of a velocity or an acceleration, what
    stands out of the noise integrated, which may be slow. Ends go on by odd reflection.
    """
    lines = reflected(y)
    power = np.abs(lines) ** 2
    mean = averaged(power)
    noise = falling_power(power, mean) if derivative else quiet_power(power)
    lines *= np.clip(1 - noise / np.maximum(mean, 1e-300), 0.0, 1.0)
    fine = finer(lines, y[0], y[-1])
    t = dt / _FINER * np.arange(len(fine))
    for times in range(derivative, 0, -1):
        lowest = _lowest(y, dt, times)
        fine = _without_slow(
            make_interp_spline(t, fine - fine.mean(), k=5).antiderivative()(t), t, lowest
        )
    return on_grid(fine[:, None], dt, grid)


def averaged(power: Array) -> Array:
    """A spectrum (n,), each line the mean of its neighbours."""
    return np.asarray(uniform_filter1d(power, _LINES, mode="nearest"))


def reflected(y: Array) -> NDArray[np.complex128]:
    """Spectrum of a signal (n, ...) that goes on by odd reflection about both ends, 2 (n - 1) long.

    Without the line through the ends.
    """
    rest = y - np.linspace(y[0], y[-1], len(y))
    return np.fft.rfft(np.concatenate([rest, -rest[-2:0:-1]]), axis=0)


def finer(lines: NDArray[np.complex128], first: Array | float, last: Array | float) -> Array:
    """The signal of such a spectrum at four times the samples, on a line through its ends."""
    n = len(lines) - 1
    wave = np.fft.irfft(lines, 2 * _FINER * n, axis=0)[: _FINER * n + 1] * _FINER
    return np.asarray(wave + np.linspace(first, last, len(wave)))


def on_grid(fine: Array, dt: float, grid: Grid) -> Trajectory:
    """The motion through displacements (m, R), four in the place of a sample, on some steps."""
    t = dt / _FINER * np.arange(len(fine))
    spline = make_interp_spline(t, fine, k=5)
    at = np.clip(grid.ends, 0.0, t[-1])
    inside = np.clip(grid.node_times(0, grid.n_steps), 0.0, t[-1])
    return Trajectory(grid, spline(at), spline(at, 1), spline(inside, 2))


def _without_slow(x: Array, t: Array, lowest: float) -> Array:
    """A signal without a parabola, and without cosines slower than a frequency (Hz)."""
    place = np.linspace(-1, 1, len(x))
    x = x - np.polynomial.Legendre.fit(place, x, 2)(place)
    waves = dct(x, norm="ortho")
    waves[: int(np.ceil(2 * lowest * t[-1]))] = 0.0
    return idct(waves, norm="ortho")


def _lowest(y: Array, dt: float, times: int) -> float:
    """Frequency, Hz, below which integrals of a signal are left out: there is more noise in them.

    Noise above it, and signal below, together are least.
    """
    frequency = np.fft.rfftfreq(len(y), dt)[1:]
    power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(len(y)))) ** 2
    mean = averaged(power)[1:]
    noise = falling_power(power[1:], mean)
    weight = frequency ** (-2.0 * times)
    lost = np.cumsum(np.maximum(mean - noise, 0.0) * weight)
    heard = np.cumsum((noise * weight)[::-1])[::-1]
    return float(frequency[np.argmin(lost + heard)])


_OWN = 3  # values of each record: its state, and the offset of the sensor
_SAID: dict[Interpolation, str] = {
    "band-limited": "band-limited",
    "linear": "linear",
    "hold": "held",
}


def ways(vibrations: Sequence[ForcedVibration]) -> tuple[Interpolation, ...]:
    """What the inputs of records may do: what is said of them, or anything; a hit is no converter.

    Raises a ValueError if two records say different things.
    """
    said_so = {v.interpolation for v in vibrations if v.interpolation is not None}
    if len(said_so) > 1:
        raise ValueError(
            f"interpolation = {sorted(said_so)} differs between records: fit those of one kind"
        )
    hits = all(window.hits for v in vibrations for window in v.windows.values())
    return tuple(said_so) or (INTERPOLATIONS[:1] if hits else INTERPOLATIONS)


def deviance(residuals: Sequence[Array]) -> float:
    """Minus twice the logarithm of the likelihood of residuals, as autoregressive noise."""
    found = 0.0
    for e in residuals:
        if not np.all(np.isfinite(e)):
            return np.inf
        driven, order = innovation(e)
        values = order + 1 + _OWN
        found += len(e) * float(np.log(np.mean(driven**2))) + values * np.log(len(e))
    return found


@dataclass(frozen=True)
class Rivals:
    """What inputs may do between their samples: that which explains most, and what does as well.

    ``weights`` has the likelihood of those that the records do not tell apart, of 1 in all;
    ``tried`` are all of them, the likeliest first.
    """

    best: Interpolation
    weights: dict[Interpolation, float]
    tried: tuple[Interpolation, ...]

    def __str__(self) -> str:
        if len(self.weights) > 1:
            names = listed([_SAID[way] for way in self.weights], "or")
            return (
                f"between its samples the input may be {names}: the record cannot tell these"
                " apart, and the errors count them all"
            )
        others = [way for way in INTERPOLATIONS if way in self.tried and way != self.best]
        told = listed([_SAID[way] for way in others], "or")
        return f"between its samples the input is {_SAID[self.best]}, not {told}"


def rated(residuals: Mapping[Interpolation, Sequence[Array]], form: float = 1.0) -> Rivals:
    """Hypotheses by what they leave: the ``form`` of the model makes it so many times larger."""
    deviances = {way: deviance(left) for way, left in residuals.items()}
    least = min(deviances.values())
    n = sum(len(e) for left in residuals.values() for e in left) / len(residuals)
    apart = max(EQUIVALENT, FORM * n, float(np.log(form)) * n)
    # Where the form of the model counts, likelihoods say less than they seem to.
    rate = EQUIVALENT / apart / 2
    alike = {w: np.exp(rate * (least - d)) for w, d in deviances.items() if d - least < apart}
    total = sum(alike.values())
    weights = {way: float(weight / total) for way, weight in alike.items()}
    tried = tuple(sorted(deviances, key=lambda way: deviances[way]))
    return Rivals(tried[0], weights, tried)
