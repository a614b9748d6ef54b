"""The record of a forced vibration: what drives it, and what was measured of the motion."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import ShortTimeFFT, find_peaks, periodogram

from romsindy.record.interpolation import INTERPOLATIONS, Interpolation, is_base, require_input
from romsindy.record.recording import (
    QUANTITIES,
    Measurement,
    Quantity,
    RecordedInput,
    checked_signal,
    checked_time,
    held_on_uniform_times,
    part_between,
)
from romsindy.record.signals import runs, vertex
from romsindy.record.units import require_unit_of_input, require_unit_of_q
from romsindy.typing import Array

# What response and input must have, and the remedy.
ONE_CLOCK = (
    "response and input need one clock; resample one of them, or cut both to the times that they"
    " share"
)
# So many samples in a row at the largest, or at the least value, are an input that is clipped, if
# they are this part of all; one that switches between a few levels is not.
_CLIPPED, _PART, _LEVELS = 3, 2e-3, 20


# An input acts where it reaches this part of its largest value, and drives a record where it acts
# in this part of it: a blow is over at once.
_ACTS, _DRIVES = 0.05, 0.3
_WINDOWS = 64  # windows of a record in which a tone is looked for
# Of the power of a window: so much near its strongest line is one tone, in most of the windows.
_TONE, _MOST = 0.7, 0.8
# From window to window a frequency that sweeps moves by its range over their number. One that is
# stepped moves by less than a part of that, so often. Less than so many lines tell neither.
_STILL, _HOLDS, _FAR = 0.1, 0.2, 8
_BAND = 0.01  # of the power: what lies beyond belongs to no band
# A force rests where it stays within so many standard deviations of its noise, that of the quietest
# quarter of the record, and acts where it is so much larger. Noise whose neighbours go together
# more than this is none of its sensor.
_QUIETEST, _RESTS, _STANDS_OUT, _WHITE = 0.25, 5.0, 30.0, 0.3
_ROUNDING = 1e-9  # of the largest value
# Beside what stands out of the noise, a burst has so much of its length to either side. A hit
# pushes one way with this part of it, and begins with its first slope above that part of its peak.
_FEET, _ONE_WAY, _FOOT = 0.5, 0.9, 0.05
_KINK = 0.0745  # rms of Bernoulli's second polynomial over places between two samples


@dataclass(frozen=True, eq=False, repr=False)
class ForcedVibration(Measurement):
    """One forced vibration, uniformly sampled; checked when it is made.

    Parameters
    ----------
    t : (n,) array
        Time in s, increasing, of response and input alike. Jitter is resampled, with a warning.
        Dates count in s from the first one.
    y : (n,) or (n, n_channels) array
        What was measured of the motion: displacement, velocity or acceleration of q. With a base
        that moves, q counts from the base. Several channels show several coordinates.
    u : (n,) or (n, n_inputs) array
        Measured inputs: forces, or accelerations of the base.
    unit : str, optional
        Unit of q, such as "m".
    measured : "displacement", "velocity" or "acceleration"
        What y is.
    inputs : str or sequence of str
        What each column of u is: "force", "base", and of several of a kind "force 2", ...
    input_unit : str or sequence of str, optional
        Unit of u, such as "N" or "m/s^2"; of each column where they differ.
    interpolation : "band-limited", "linear" or "hold", optional
        What the inputs do between their samples, where it is known; else the data choose.
    notes : tuple of str
        What was done to the record, for the reader.

    Raises
    ------
    ValueError
        For NaN, gaps, lengths that differ, or an input that is constant; the message names the
        argument and the remedy.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0.0, 2.0, 1e-3)
    >>> ForcedVibration(t, np.sin(9 * t), np.cos(9 * t), unit="m", input_unit="N")
    <ForcedVibration: 2000 samples at 1000 Hz, 1.999 s, max |displacement| 1 m, by force>
    """

    t: Array
    y: Array
    u: Array
    unit: str | None = None
    measured: Quantity = "displacement"
    inputs: str | Sequence[str] = "force"
    input_unit: str | Sequence[str | None] | None = None
    interpolation: Interpolation | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.measured not in QUANTITIES:
            raise ValueError(f"measured = {self.measured!r} must be one of {QUANTITIES}")
        if self.interpolation not in (None, *INTERPOLATIONS):
            raise ValueError(
                f"interpolation = {self.interpolation!r} must be one of {INTERPOLATIONS}, or None"
            )
        require_unit_of_q(self.unit)
        t = checked_time(self.t)
        y, u = (_checked(name, getattr(self, name), t) for name in ("y", "u"))
        y, u = y[:, 0] if y.ndim == 2 and y.shape[1] == 1 else y, u.reshape(len(t), -1)
        names = (self.inputs,) if isinstance(self.inputs, str) else tuple(self.inputs)
        for name in names:
            require_input(name)
        if len(set(names)) != u.shape[1]:
            raise ValueError(
                f"inputs = {names} must name each of the {u.shape[1]} columns of u once"
            )
        if not isinstance(self.input_unit, str | None) and len(self.input_unit) != len(names):
            raise ValueError(
                f"input_unit = {self.input_unit!r} must be one unit, or one for each of {names}"
            )
        for name, unit in zip(names, self._units(len(names)), strict=True):
            require_unit_of_input(name, unit, is_base(name))
        if not np.ptp(y) > 0:
            raise ValueError(f"y is constant ({y[0]:.6g}): nothing vibrates in this record")
        held, notes = held_on_uniform_times(t, {"y": y, "u": u})
        for name, x in zip(names, held["u"].T, strict=True):
            if not np.ptp(x) > 0:
                what = "zero" if x[0] == 0 else f"constant ({x[0]:.6g})"
                raise ValueError(
                    f"the input {name!r} is {what}: it drives no vibration; choose the column that"
                    " was measured, or take the record for a free decay"
                )
            clipped = _clipped_note(name, x)
            if clipped:
                warnings.warn(clipped, stacklevel=3)
                notes = (*notes, clipped)
        own = {"inputs": names, "notes": (*self.notes, *notes)}
        for name, value in {**held, **own}.items():
            object.__setattr__(self, name, value)

    @property
    def response(self) -> Array:
        """y."""
        return self.y

    @property
    def signal(self) -> Array:
        """What was measured of the motion, (n,).

        Raises
        ------
        ValueError
            If it has several channels.
        """
        if self.y.ndim == 2:
            raise ValueError(
                f"y has {self.n_channels} channels, and one is needed here: choose one, y[:, 0], or"
                " model several coordinates"
            )
        return self.y

    @property
    def names(self) -> tuple[str, ...]:
        """Of the inputs, in the order of the columns of u."""
        return tuple(self.inputs)

    @property
    def units(self) -> tuple[str | None, ...]:
        """Of the inputs, in the order of the columns of u."""
        return self._units(len(self.names))

    @property
    def windows(self) -> dict[str, ForceWindow]:
        """The inputs by name, forces without what their sensors show where they rest."""
        pairs = zip(self.names, self.u.T, strict=True)
        return {n: ForceWindow(u) if is_base(n) else ForceWindow.of(u) for n, u in pairs}

    def _units(self, count: int) -> tuple[str | None, ...]:
        unit = self.input_unit
        return (unit,) * count if isinstance(unit, str | None) else tuple(unit)

    def between(self, start: float | None = None, end: float | None = None) -> ForcedVibration:
        """The part with start <= t <= end, in s; None leaves an end as it is.

        Raises
        ------
        ValueError
            If fewer than eight samples are left.
        """
        part, cut = part_between(self.t, start, end), copy(self)
        # Nothing is checked once more: between two hits an input may rest.
        for name in ("t", "y", "u"):
            object.__setattr__(cut, name, getattr(self, name)[part])
        return cut

    def __repr__(self) -> str:
        size = f"{len(self.t)} samples at {1 / self.dt:.6g} Hz, {self.t[-1] - self.t[0]:.4g} s"
        peak = f"max |{self.measured}| {np.abs(self.y).max():.4g} {self.signal_unit}"
        first = f"<ForcedVibration: {size}, {peak}, by {' and '.join(self.names)}>"
        return "\n".join([first, *(f"  - {note}" for note in self.notes)])


def _checked(name: str, x: ArrayLike, t: Array) -> Array:
    try:
        return checked_signal(name, x, len(t))
    except ValueError as error:
        n = len(np.atleast_1d(np.asanyarray(x)))
        if np.ndim(x) and n != len(t):
            raise ValueError(f"{name} has {n} samples, and t {len(t)}: {ONE_CLOCK}") from error
        raise


def _clipped_note(name: str, u: Array) -> str:
    """What is to be said of an input that sticks to the end of its range; empty if none does."""
    if len(np.unique(u)) < _LEVELS:  # a square wave, or a binary one
        return ""
    found = 0
    for end in {u.max(), u.min()} - {np.median(u)}:  # at the value at rest nothing is clipped
        lengths = [run.stop - run.start for run in runs(u == end)]
        found += sum(length for length in lengths if length >= _CLIPPED)
    if found < max(_PART * len(u), _CLIPPED):
        return ""
    return (
        f"{found} samples of the input {name!r} stick to {u.max():.4g} or {u.min():.4g}: it is"
        " saturated, and the true one is larger; measure it again with a wider range, or cut the"
        " record to where it is not"
    )


def input_names(kinds: Sequence[str]) -> list[str]:
    """Names of inputs of some kinds, such as "force" and "force 2" for two forces."""
    counts = [kinds[: i + 1].count(kind) for i, kind in enumerate(kinds)]
    pairs = zip(kinds, counts, strict=True)
    return [kind if count == 1 else f"{kind} {count}" for kind, count in pairs]


def recorded_input(x: Array, dt: float, name: str, kind: str) -> RecordedInput:
    """What an input does, by its samples (n,) every ``dt`` seconds; NaN where one is missing."""
    x = np.where(np.isfinite(x), x, 0.0)
    x = x - np.median(x)
    size = np.array([np.max(np.abs(part), initial=0.0) for part in np.array_split(x, _WINDOWS)])
    if not np.any(size):
        return RecordedInput(name, kind, "nothing but a constant", False, False)
    acts = float(np.mean(size > _ACTS * size.max()))
    if acts < _DRIVES:
        return RecordedInput(
            name, kind, f"a blow or several, {100 * acts:.2g} % of the record", False
        )
    return RecordedInput(name, kind, _how(x, dt), True)


class Hit(NamedTuple):
    """A pulse of a force: its samples, and the error of its impulse, a standard deviation."""

    at: slice
    error: float  # as a part of the impulse


class ForceWindow(NamedTuple):
    """A force that is 0 wherever it rests, and the hits that it consists of, if it does.

    What its sensor shows between hits, or after a shaker was switched off, is noise and a zero that
    is off: W. Halvorsen, D. Brown, "Impulse technique for structural frequency response testing",
    Sound and Vibration 11 (1977).
    """

    u: Array
    hits: tuple[Hit, ...] = ()

    @classmethod
    def of(cls, u: Array) -> ForceWindow:
        """Of samples (n,), which stay as they are where no white noise about one value is rest."""
        parts = [x for x in np.array_split(u, _WINDOWS) if len(x)]
        spread = np.array([np.std(x) for x in parts])
        noise = float(np.quantile(spread, _QUIETEST))
        levels = np.array([np.median(x) for x in parts])[spread <= 2 * noise]
        zero = float(np.median(levels))
        off = u - zero
        size = np.abs(off)
        near = _RESTS * noise + _ROUNDING * float(size.max())
        loud = [run for run in runs(size > near) if size[run].max() > 2 * near]
        if np.any(np.abs(levels - zero) > near) or not size.max() > _STANDS_OUT * noise or not loud:
            return cls(u)
        # Feet of a pulse are in the noise, and it rings where it was filtered.
        feet = 2 + int(_FEET * max(run.stop - run.start for run in loud))
        acts = np.zeros(len(u), bool)
        for run in loud:
            acts[max(run.start - feet, 0) : run.stop + feet] = True
        rest = np.where(acts, 0.0, off)
        if np.all(acts) or abs(float(rest[1:] @ rest[:-1])) > _WHITE * float(rest @ rest):
            return cls(u)
        own = np.where(acts, off, 0.0)
        return cls(own, _hits(own, runs(acts), float(np.std(off[~acts]))))


def _hits(u: Array, bursts: Sequence[slice], noise: float) -> tuple[Hit, ...]:
    """Bursts of a force as hits; none where one of them does not push one way.

    Noise is in the sum of the samples. And samples tell an integral badly where the force begins or
    ends with a kink, which may be anywhere between two of them: by the first term of Euler and
    Maclaurin's formula, with the slopes there.
    """
    found = []
    for run in bursts:
        own = u[run]
        impulse, peak = abs(float(own.sum())), float(np.abs(own).max())
        if impulse < _ONE_WAY * float(np.abs(own).sum()):
            return ()
        slopes = np.diff(own[np.abs(own) > _FOOT * peak], append=0.0)
        kink = _KINK / 2 * float(np.hypot(slopes[0], slopes[-2:][0]))
        found.append(Hit(run, float(np.hypot(noise * np.sqrt(len(own)), kink)) / impulse))
    return tuple(found)


def _how(x: Array, dt: float) -> str:
    """Of an input that lasts: a tone that holds, steps or sweeps, or a broad band."""
    width = max(4 * len(x) // _WINDOWS, 16)
    window = ShortTimeFFT(np.hanning(width), max(width // 4, 1), 1 / dt)
    power = window.spectrogram(x)[:, window.lower_border_end[1] :]
    power = power[:, power.sum(axis=0) > _ACTS**2 * power.sum(axis=0).max()]
    near = np.abs(np.arange(len(power))[:, None] - np.argmax(power, axis=0)) <= 3
    tones = np.sum(power * near, axis=0) > _TONE * power.sum(axis=0)
    line = 1 / (width * dt)
    if np.mean(tones) > _MOST:
        f = line * _tops(power[:, tones])
        low, high = float(f.min()), float(f.max())
        if high - low < 3 * line:
            return f"harmonic at {np.median(f):.4g} Hz"
        steady = np.mean(np.abs(np.diff(f)) < _STILL * (high - low) / len(f)) > _HOLDS
        kind = ("stepped " if steady else "swept ") if high - low > _FAR * line else ""
        return f"{kind}sine from {low:.3g} to {high:.3g} Hz"
    f, power = periodogram(x, 1 / dt)
    part = np.cumsum(power) / power.sum()
    low, high = (float(f[np.searchsorted(part, p)]) for p in (_BAND, 1 - _BAND))
    peaks = find_peaks(power, 1e-3 * power.max(), distance=2)[0]
    lines = len(peaks) > 2 and power[peaks].sum() > _TONE * power.sum()
    return f"{'many tones' if lines else 'random'} from {low:.3g} to {high:.3g} Hz"


def _tops(power: Array) -> Array:
    """Lines, not whole, at which each column is greatest: a parabola through three logarithms."""
    top = np.clip(np.argmax(power, axis=0), 1, len(power) - 2)
    log = np.log(np.maximum(power, 1e-300))
    return top + vertex(*(np.take_along_axis(log, top[None] + k, axis=0)[0] for k in (-1, 0, 1)))
