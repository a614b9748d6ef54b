"""Recordings of some channels over time, and samples and times as they are given.

Numbers, dates, masks; uniform and increasing times.
"""

from __future__ import annotations

import itertools
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date, timedelta
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline
from scipy.ndimage import maximum_filter1d

from romsindy.text import counted
from romsindy.typing import Array, Indices

# Deviation from uniform sampling, in sampling intervals: below it digits were merely rounded.
_ROUNDING = 1e-4
Quantity = Literal["displacement", "velocity", "acceleration"]
QUANTITIES: tuple[Quantity, ...] = ("displacement", "velocity", "acceleration")
# Of the usual step: a longer one is a gap, where the times after it stay late by the rest of it.
# Where they jitter, medians of up to so many of them tell: so many times the spread squared.
_GAP, _MOST_TIMES, _TIMES = 1.5, 64, 300
# Longer steps than so many that an even grid explains to this part of the last digit are rounded.
_FEW_STEPS, _OF_A_DIGIT, _DIGITS = 4, 0.75, 9


def as_floats(name: str, x: ArrayLike) -> Array:
    """Real numbers as a new array of floats; nan where a sample is masked.

    Raises a ValueError if they are complex, dates or no numbers.
    """
    masked = x if isinstance(x, np.ma.MaskedArray) else None
    try:
        if np.iscomplexobj(x):
            raise TypeError("it is complex")
        if np.asarray(x).dtype.kind in "mM":
            raise TypeError("it holds dates or durations")
        found = np.array(x, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of real numbers: {error}") from None
    if masked is not None:
        found[np.ma.getmaskarray(masked)] = np.nan
    return found


def as_seconds(name: str, t: ArrayLike) -> Array:
    """Times in s as a new array of floats: dates count from the first one, durations from zero.

    Those of NumPy (``datetime64``, ``timedelta64``), of pandas and of Python's ``datetime`` are
    taken, exact to the last digit of a float; of masked ones nan.

    Raises a ValueError as `as_floats`.
    """
    times = np.asarray(t)
    first = times.flat[0] if times.size else 0.0
    try:
        if times.dtype.kind == "M":
            times = times - first
        if times.dtype.kind == "O" and isinstance(first, date):
            times = np.array([x - first for x in times.flat]).reshape(times.shape)
            first = times.flat[0]
        if times.dtype.kind == "m":
            times = times / np.timedelta64(1, "s")
        if times.dtype.kind == "O" and isinstance(first, timedelta):
            times = np.array([x.total_seconds() for x in times.flat]).reshape(times.shape)
    except (TypeError, AttributeError) as error:  # months, or times of several kinds
        raise ValueError(f"{name} must be times in s, dates or durations: {error}") from None
    mask = np.ma.getmask(t) if isinstance(t, np.ma.MaskedArray) else np.ma.nomask
    return as_floats(name, np.ma.array(times, mask=mask))


def uniform_times(t: Array) -> tuple[Array, str]:
    """Uniform times over the same span, (n,), and what the jitter is in words.

    There are no words where digits of t were merely rounded; no samples need be changed then.
    """
    uniform = np.linspace(t[0], t[-1], len(t))
    jitter = np.abs(t - uniform) / (uniform[1] - uniform[0])
    if jitter.max() <= _ROUNDING or _only_rounded(t):
        return uniform, ""
    rms = np.sqrt(np.mean(jitter**2))
    return uniform, (
        f"t is not uniform: it jitters by {rms:.2g} of the sampling interval in the rms,"
        f" at most {jitter.max():.2g}; resampled uniformly"
    )


def _only_rounded(t: Array) -> bool:
    """Whether times (n,) are those of an even grid but for digits that were left out."""
    last = 8 * np.finfo(float).eps * float(np.abs(t).max())  # to which a decimal is kept
    digits = (10.0**d for d in range(_DIGITS + 1))
    off = ((s, np.abs(s * t - np.rint(s * t))) for s in digits)
    whole = next((np.rint(s * t) for s, x in off if np.all(x <= s * last)), None)
    if whole is None:
        return False
    k = np.arange(len(t)) - (len(t) - 1) / 2
    off = whole - whole.mean() - k * (k @ whole) / (k @ k)
    return bool(np.abs(off).max() <= _OF_A_DIGIT)


def lost_samples(t: Array) -> Indices:
    """How many samples are missing after each time but the last, (n - 1,).

    None are where times jitter about an even grid, or have few digits: the times after a long step
    are late for good where samples are missing.
    """
    steps = np.diff(t)
    low, usual, high = np.quantile(steps, [0.25, 0.5, 0.75])
    spread = (high - low) / 1.35 / usual  # of a normal distribution
    m = int(np.clip(np.ceil(_TIMES * spread**2), 1, min(_MOST_TIMES, len(t) // 8)))
    usual = float(np.median(t[m:] - t[:-m])) / m
    off = t / usual - np.arange(len(t))  # in steps of an even grid
    level = off if m == 1 else np.median(sliding_window_view(off, m), axis=1)
    late = np.pad(level[m:] - level[:-m], m - 1, mode="edge")
    long = (steps > _GAP * usual) & (late > _GAP - 1)
    long &= steps >= maximum_filter1d(steps, m)  # of what one gap makes late, the gap
    if np.count_nonzero(long) > _FEW_STEPS and _only_rounded(t):
        return np.zeros(len(steps), int)
    return np.where(long, np.maximum(np.rint(late), 1), 0).astype(int)


def held_on_uniform_times(
    t: Array, signals: dict[str, Array]
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Times and signals of a record, not to be written to; and what was done to them, if anything.

    Jitter is resampled, with a warning.
    """
    uniform, note = uniform_times(t)
    if note:
        signals = {name: make_interp_spline(t, x, k=3)(uniform) for name, x in signals.items()}
        warnings.warn(note, stacklevel=4)  # where the record is made
    held = {"t": uniform, **signals}
    for x in held.values():
        x.flags.writeable = False
    return held, (note,) if note else ()


def part_between(t: Array, start: float | None, end: float | None) -> slice:
    """Samples with start <= t <= end, in s; None leaves an end as it is.

    Raises a ValueError if they are fewer than eight, or a time is no finite number.
    """
    for name, value in (("start", start), ("end", end)):
        if value is not None and not np.isfinite(value):
            raise ValueError(f"{name}={value} is no time: give seconds, or leave it out")
    low, high = t[0] if start is None else start, t[-1] if end is None else end
    slack = 1e-6 * float(t[1] - t[0])
    first, last = np.searchsorted(t, [low - slack, high + slack]).tolist()
    if last - first < 8:
        raise ValueError(
            f"start = {start}, end = {end} leave {max(last - first, 0)} samples of the record,"
            f" which runs from {t[0]:.6g} to {t[-1]:.6g} s"
        )
    return slice(first, last)


def enough_times(t: ArrayLike) -> Array:
    """Times as `as_seconds` takes them, refused where they are not (n,) of at least 8."""
    t = as_seconds("t", t)
    if t.ndim != 1 or len(t) < 8:
        raise ValueError(
            f"t must be one-dimensional with at least 8 samples, got shape {t.shape}: give more of"
            " the record"
        )
    return t


def require_increasing(
    t: Array, remedy: str = "sort the samples or remove the repeated ones"
) -> None:
    """Refuse times (n,) of which one is not after the one before it."""
    bad = np.flatnonzero(~(np.diff(t) > 0))
    if len(bad):
        i = int(bad[0])
        what = "repeats" if t[i + 1] == t[i] else "decreases"
        raise ValueError(
            f"t must increase, but it {what} at sample {i + 1} ({t[i]:.9g} -> {t[i + 1]:.9g} s):"
            f" {remedy}"
        )


def checked_time(t: ArrayLike) -> Array:
    """Times of a record, (n,) in s.

    Raises a ValueError unless they are finite numbers that increase without a gap, at least 8 of
    them.
    """
    t = enough_times(t)
    _refuse_nan("t", t)
    require_increasing(t)
    lost = lost_samples(t)
    if lost.any():
        steps, i = np.diff(t), int(np.argmax(lost))
        usual = float(np.median(steps))
        raise ValueError(
            f"t has a gap of {steps[i]:.6g} s after {t[i]:.9g} s (usual step {usual:.6g} s): split"
            " the record there and pass the pieces as a list, keep one with start= or end=, or"
            " interpolate"
        )
    return t


def checked_signal(name: str, x: ArrayLike, n: int) -> Array:
    x = as_floats(name, x)
    if x.ndim not in (1, 2) or len(x) != n:
        raise ValueError(
            f"{name} must have shape ({n},) or ({n}, n_channels) to go with t, got {x.shape}"
        )
    _refuse_nan(name, x)
    if name == "q" and not np.all(np.ptp(x, axis=0) > 0):
        raise ValueError(f"q is constant ({x.flat[0]:.6g}): nothing vibrates in this record")
    return x


def _refuse_nan(name: str, x: Array) -> None:
    bad = np.argwhere(~np.isfinite(x))
    if len(bad):
        what = counted(len(bad), "value that is", "values that are")
        raise ValueError(
            f"{name} has {what} NaN, infinite or masked, the first at sample"
            f" {int(bad[0][0])}: cut them off, or interpolate over them; rs.inspect takes a"
            " Recording in which samples are missing"
        )


@dataclass(frozen=True)
class RecordedInput:
    """One measured input of a record."""

    name: str  # of its column
    kind: str  # "force" or "base": what `romsindy identify --input` calls it
    how: str  # what it does: "swept sine from 4 to 12 Hz"
    lasting: bool  # whether it drives the record; what follows a blow is free
    acts: bool = True  # whether it does anything

    def __str__(self) -> str:
        return f"{self.kind} in column {self.name!r}: {self.how}"


def unit_of(quantity: Quantity, unit: str | None) -> str:
    """Unit of a quantity where q has a unit."""
    return (unit or "[q]") + ("", "/s", "/s^2")[QUANTITIES.index(quantity)]


class Measurement(ABC):
    """A record of one motion, uniformly sampled: a `Decay`, or a `ForcedVibration` with inputs."""

    t: Array
    unit: str | None
    measured: Quantity

    @property
    @abstractmethod
    def response(self) -> Array:
        """What was measured of the motion, (n,) or (n, n_channels)."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Of the inputs that were measured; none drives a decay."""

    def same_record(self, other: Any) -> bool:
        """Whether both hold the same samples of what was measured."""
        return isinstance(other, type(self)) and np.array_equal(self.response, other.response)

    @property
    def driven(self) -> bool:
        """Whether inputs drive the motion."""
        return bool(self.names)

    @property
    def dt(self) -> float:
        """Sampling interval in s."""
        return float(self.t[1] - self.t[0])

    @property
    def n_channels(self) -> int:
        """Number of channels that show the motion."""
        return 1 if self.response.ndim == 1 else self.response.shape[1]

    @property
    def derivative(self) -> int:
        """0, 1, 2 where displacement, velocity or acceleration was measured."""
        return QUANTITIES.index(self.measured)

    @property
    def signal_unit(self) -> str:
        """Unit of the measured quantity."""
        return unit_of(self.measured, self.unit)


class Given(NamedTuple):
    """What an argument holds that takes one record or several, in their order."""

    several: list[Any]
    decays: list[Any]  # records that nothing drives
    driven: list[Any]  # those with inputs
    others: list[Any]  # what is no record of one motion

    @classmethod
    def of(cls, argument: Any) -> Given:
        """A record by itself, or those of a list."""
        several = list(argument) if isinstance(argument, (list, tuple, Iterator)) else [argument]
        own = [r for r in several if isinstance(r, Measurement)]
        decays, driven = ([r for r in own if r.driven == moved] for moved in (False, True))
        return cls(several, decays, driven, [r for r in several if not isinstance(r, Measurement)])


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """Channels sampled together, as they were measured.

    Unlike a `Decay` it may hold anything: the blow, several releases, gaps in time, samples that
    are missing (NaN), several vibrations at once. `romsindy.inspect` says what is in it.

    Parameters
    ----------
    t : (n,) array
        Time in s, increasing; it may have gaps.
    x : (n,) or (n, m) array
        What the sensors gave, in SI units; NaN, or masked, where a sample is missing. Kept as
        (n, m).
    names : sequence of str, optional
        Of the m channels; "1", "2", ... by default.
    quantity : "displacement", "velocity" or "acceleration"
        What all channels measured.
    unit : str, optional
        SI unit of the displacement q, such as "m" or "rad"; None where it is not known. A velocity
        is in unit/s, an acceleration in unit/s^2.
    basis : str
        What quantity and unit rest on, for the reader: "header 'v [mm/s]'", "--unit m/s".
    source : str
        Name of the file, for messages.
    notes : tuple of str
        What was done to the record, for the reader.
    drives : tuple of RecordedInput
        Inputs that were measured with it.
    left_out : tuple of str
        Names of further columns of the file.
    lever : float, optional
        Lever arm, m, at which angles among the channels were made lengths.

    Raises
    ------
    ValueError
        For time that is not finite or does not increase, and shapes that do not fit.

    Examples
    --------
    >>> t = np.arange(0.0, 5.0, 0.01)
    >>> Recording(t, np.column_stack([np.cos(6 * t), np.sin(6 * t)]), ["tip", "root"], unit="m")
    <Recording: 500 samples at 100 Hz, 4.99 s, displacement in m, channels tip, root>
    """

    t: Array
    x: Array
    names: Sequence[str] = ()
    quantity: Quantity = "displacement"
    unit: str | None = None
    basis: str = ""
    source: str = ""
    notes: tuple[str, ...] = ()
    drives: tuple[RecordedInput, ...] = ()
    left_out: tuple[str, ...] = ()
    lever: float | None = None

    def __post_init__(self) -> None:
        t, x = enough_times(self.t), as_floats("x", self.x)
        x = x[:, None] if x.ndim == 1 else x
        if x.ndim != 2 or len(x) != len(t) or x.shape[1] == 0:
            raise ValueError(f"x must have shape ({len(t)},) or ({len(t)}, m), got {x.shape}")
        if self.quantity not in QUANTITIES:
            raise ValueError(f"quantity = {self.quantity!r} must be one of {QUANTITIES}")
        require_increasing(t)
        names = tuple(self.names) or tuple(str(i + 1) for i in range(x.shape[1]))
        if len(names) != x.shape[1]:
            raise ValueError(f"names = {names} are not the names of {x.shape[1]} channels")
        for name, value in {"t": t, "x": x, "names": names}.items():
            object.__setattr__(self, name, value)

    @cached_property
    def lost(self) -> Indices:
        """Samples that are missing after each but the last, (n - 1,)."""
        return lost_samples(self.t)

    @cached_property
    def dt(self) -> float:
        """Sampling interval, s: the mean between gaps, for times may be rounded."""
        inside = self.lost == 0
        steps = np.diff(self.t)
        return float(steps[inside].mean() if inside.any() else np.median(steps))

    @property
    def signal_unit(self) -> str:
        """Unit of the samples."""
        return unit_of(self.quantity, self.unit)

    @property
    def driven(self) -> bool:
        """Whether a measured input drives it all along: it is no free decay."""
        return any(drive.lasting for drive in self.drives)

    @cached_property
    def pieces(self) -> list[slice]:
        """Samples between gaps in time."""
        edges = [0, *(np.flatnonzero(self.lost) + 1).tolist(), len(self.t)]
        return [slice(a, b) for a, b in itertools.pairwise(edges)]

    def as_recording(self) -> Recording:
        """The recording itself; a `Decay` makes one."""
        return self

    def channel(self, *names: str) -> Recording:
        """These channels alone.

        Raises
        ------
        ValueError
            If there is no channel of that name.
        """
        for name in names:
            if name not in self.names:
                raise ValueError(
                    f"{self.source or 'the record'} has no channel {name!r}, but {self.names}"
                )
        columns = [list(self.names).index(name) for name in names]
        return replace(self, x=self.x[:, columns], names=names)

    def between(self, start: float | None = None, end: float | None = None) -> Recording:
        """The part with start <= t <= end, in s; None leaves an end as it is.

        Raises
        ------
        ValueError
            If fewer than eight samples are left.
        """
        part = part_between(self.t, start, end)
        return replace(self, t=self.t[part], x=self.x[part])

    def __repr__(self) -> str:
        size = f"{len(self.t)} samples at {1 / self.dt:.6g} Hz, {self.t[-1] - self.t[0]:.4g} s"
        channels = f"channels {', '.join(self.names)}"
        return f"<Recording: {size}, {self.quantity} in {self.signal_unit}, {channels}>"
