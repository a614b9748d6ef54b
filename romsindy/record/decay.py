"""The record of one free decay."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from romsindy.record.recording import (
    QUANTITIES,
    Measurement,
    Quantity,
    Recording,
    checked_signal,
    checked_time,
    held_on_uniform_times,
    part_between,
)
from romsindy.record.releases import Release, split_releases
from romsindy.record.signals import (
    crossings,
    downsample,
    fundamental_frequency,
    rest_level,
    upsample,
)
from romsindy.record.smoothing import Butterworth, Filter, displacement
from romsindy.record.spectrum import steady_wave
from romsindy.record.units import require_unit_of_q
from romsindy.typing import Array, Indices

Stage = Literal["raw", "free", "conditioned"]
STAGES: tuple[Stage, ...] = ("raw", "free", "conditioned")

SIGNALS = ("q", "q_dot", "q_ddot")
# Fewer samples a cycle than this are interpolated before cycles are analysed.
SAMPLES_PER_CYCLE = 40


@dataclass(frozen=True, eq=False, repr=False)
class Decay(Measurement):
    """One free decay, uniformly sampled; checked when it is made.

    Parameters
    ----------
    t : (n,) array
        Time in s, increasing. Jitter is resampled onto a uniform grid, with a warning. Dates
        count in s from the first one.
    q : (n,) or (n, n_channels) array
        Displacement, or modal coordinate, from rest.
    q_dot, q_ddot : arrays like q, optional
        Velocity and acceleration, where known. They must belong to q.
    unit : str, optional
        Unit of q, such as "m" or "rad"; None where it is not known.
    measured : "displacement", "velocity" or "acceleration"
        Which of the three the sensor gave.
    notes : tuple of str
        What was done to the record, for the reader.
    stage : "raw", "free" or "conditioned"
        How far it is prepared: as it came; its free part alone; with velocity and acceleration that
        agree. One that comes with both is conditioned. No step is done twice.
    leftover : float
        Rms of what other vibrations left when this one was isolated, unit of the measured signal.
        It counts as noise when a model is judged.
    beside : float
        Largest acceleration of these other vibrations, as a part of its own.
    slowest : float
        Hz, below which a velocity or an acceleration was filtered, and what is integrated from it;
        0 where none was.

    Raises
    ------
    ValueError
        For NaN, gaps, time that does not increase, shapes that do not fit, a constant signal;
        the message names the argument, the value and the remedy.

    Examples
    --------
    >>> t = np.arange(0.0, 5.0, 0.01)
    >>> Decay(t, np.exp(-0.1 * t) * np.cos(6 * t), unit="m")
    <Decay: 500 samples at 100 Hz, 4.99 s, max |q| 1 m, measured displacement>
    """

    t: Array
    q: Array
    q_dot: Array | None = None
    q_ddot: Array | None = None
    unit: str | None = None
    measured: Quantity = "displacement"
    notes: tuple[str, ...] = ()
    stage: Stage = "raw"
    leftover: float = 0.0
    beside: float = 0.0
    slowest: float = 0.0

    def __post_init__(self) -> None:
        for name, choices in (("measured", QUANTITIES), ("stage", STAGES)):
            if getattr(self, name) not in choices:
                raise ValueError(f"{name} = {getattr(self, name)!r} must be one of {choices}")
        require_unit_of_q(self.unit)
        t = checked_time(self.t)
        signals = {
            name: checked_signal(name, getattr(self, name), len(t))
            for name in SIGNALS
            if getattr(self, name) is not None
        }
        if any(x.shape != signals["q"].shape for x in signals.values()):
            shapes = {name: x.shape for name, x in signals.items()}
            raise ValueError(f"q, q_dot and q_ddot must have the same shape, got {shapes}")
        held, notes = held_on_uniform_times(t, signals)
        for name, value in {**held, "notes": (*self.notes, *notes)}.items():
            object.__setattr__(self, name, value)
        if self.signal is None:
            name = SIGNALS[self.derivative]
            raise ValueError(f"measured = {self.measured!r} needs {name}, which is None: give it")
        if self.complete:
            object.__setattr__(self, "stage", "conditioned")
        elif self.stage == "conditioned":
            raise ValueError("stage = 'conditioned' needs q_dot and q_ddot: see differentiated()")

    # -- other ways to make one ---------------------------------------------------------------

    @classmethod
    def from_velocity(cls, t: ArrayLike, v: ArrayLike, unit: str | None = None) -> Decay:
        """Make a decay from a measured velocity, integrated once without drift.

        Of several releases the largest is taken, from after the blow on, without what the removal
        of drift spoils at either end.

        Parameters
        ----------
        t : (n,) array
            s.
        v : (n,) or (n, n_channels) array
            Unit of q per second.
        unit : str, optional
            Unit of q: "m" for a velocity in m/s.

        Raises
        ------
        ValueError
            If there is no free decay in it.
        """
        return _largest(t, v, "velocity", unit)

    @classmethod
    def from_acceleration(cls, t: ArrayLike, a: ArrayLike, unit: str | None = None) -> Decay:
        """Make a decay from a measured acceleration, integrated twice without drift.

        Arguments as those of `from_velocity`; a in units of q per second squared.
        """
        return _largest(t, a, "acceleration", unit)

    @classmethod
    def of_release(
        cls, recording: Recording, release: Release, notes: tuple[str, ...] = ()
    ) -> Decay:
        """The free decay of one release, with every channel of the recording.

        A measured velocity or acceleration is integrated without drift, and loses what that spoils
        at either end.
        """
        part = recording.between(release.start, release.end)
        x = part.x if len(part.names) > 1 else part.x[:, 0]
        decay = cls(part.t, x, unit=part.unit, notes=notes, stage="free")
        if part.quantity == "displacement":
            return decay
        return _integrated(decay, release.frequency, part.quantity)

    names = ()  # no input drives it

    # -- what it is ---------------------------------------------------------------------------

    @property
    def complete(self) -> bool:
        """Whether velocity and acceleration came with the displacement."""
        return self.q_dot is not None and self.q_ddot is not None

    def as_recording(self, basis: str = "the decay that was given", source: str = "") -> Recording:
        """What the sensor gave, with the notes."""
        return Recording(
            *(self.t, self.signal, (), self.measured, self.unit, basis, source, self.notes)
        )

    @property
    def signals(self) -> dict[str, Any]:
        """Displacement, velocity and acceleration, as far as they are known, by name."""
        return {n: getattr(self, n) for n in SIGNALS if getattr(self, n) is not None}

    @property
    def signal(self) -> Array:
        """What was measured: q, q_dot or q_ddot."""
        return getattr(self, SIGNALS[self.derivative])

    @property
    def response(self) -> Array:
        """The same."""
        return self.signal

    @cached_property
    def crossings(self) -> tuple[Indices, Indices]:
        """Last samples before the up- and the down-crossings of q, see `cycles.crossings`."""
        return crossings(self.q, self.dt)

    def channel(self, index: int) -> Decay:
        """One channel as a decay of its own, with q of shape (n,)."""
        if not -self.n_channels <= index < self.n_channels:
            raise ValueError(f"channel {index} does not exist: the decay has {self.n_channels}")
        if self.q.ndim == 1:
            return self
        return self._mapped(lambda x: x[:, index])

    def single(self) -> Decay:
        """The decay itself if it has one channel.

        Raises
        ------
        ValueError
            If it has several.
        """
        if self.n_channels > 1:
            raise ValueError(
                f"the decay has {self.n_channels} channels: choose one with decay.channel(i)"
            )
        return self.channel(0)

    def __repr__(self) -> str:
        size = f"{len(self.t)} samples at {1 / self.dt:.6g} Hz, {self.t[-1] - self.t[0]:.4g} s"
        peak = f"max |q| {np.abs(self.q).max():.4g} {self.unit or '[q]'}"
        channels = f", {self.n_channels} channels" if self.n_channels > 1 else ""
        first = f"<Decay: {size}{channels}, {peak}, measured {self.measured}>"
        return "\n".join([first, *(f"  - {note}" for note in self.notes)])

    # -- conditioning: each returns a new decay -----------------------------------------------

    def between(self, start: float | None = None, end: float | None = None) -> Decay:
        """The part with start <= t <= end, in s; None leaves an end as it is.

        Raises
        ------
        ValueError
            If fewer than eight samples are left.
        """
        part = part_between(self.t, start, end)
        return self._mapped(lambda x: x[part], self.t[part])

    def free(self, start: float | None = None, end: float | None = None) -> Decay:
        """The free decay alone: from the first large turning point to where noise takes over.

        A record that is free already is returned as it is, or cut to the times that are given. An
        offset of a displacement, where the vibration does not come to rest at 0, is removed.

        Parameters
        ----------
        start, end : float, optional
            Times in s; what is not given is found.

        Raises
        ------
        ValueError
            If fewer than three cycles are left, or the amplitude grows.
        """
        record = self if start is None and end is None else self.between(start, end)
        if self.stage != "raw":
            return record
        release, notes = _release(record.as_recording(), start, end)
        first = release.start if start is None else record.t[0]
        part = record.between(first, release.end if end is None else record.t[-1])
        free = replace(part, notes=(*part.notes, *notes), stage="free")
        if self.measured != "displacement" or self.n_channels > 1:
            return free
        wave = steady_wave(record.channel(0).q, record.dt)
        if wave is not None:
            note = (
                f"a wave of {wave.frequency:.4g} Hz and {abs(wave.size):.3g} {self.unit or '[q]'}"
                " removed: it goes on as the decay has faded"
            )
            without = record.q - wave(record.t - record.t[0])
            return replace(record, q=without, notes=(*record.notes, note)).free(start, end)
        rest = rest_level(free.channel(0).q, free.dt)
        if not rest:
            return free
        note = f"offset of {rest:.4g} {self.unit or '[q]'} removed: where the vibration rests"
        return replace(free, q=free.q - rest, notes=(*free.notes, note))

    def upsampled(self, samples_per_cycle: int = SAMPLES_PER_CYCLE) -> Decay:
        """At least this many samples a cycle, by band-limited interpolation."""
        x = self.signal  # what was measured: integration colours the noise
        liveliest = x if x.ndim == 1 else x[:, np.argmax(x.std(axis=0))]
        per_cycle = 1 / (fundamental_frequency(liveliest, self.dt) * self.dt)
        factor = int(np.ceil(samples_per_cycle / per_cycle))
        if factor <= 1:
            return self
        t = np.linspace(self.t[0], self.t[-1], factor * (len(self.t) - 1) + 1)
        note = f"{per_cycle:.3g} samples a cycle interpolated to {factor * per_cycle:.3g}"
        return self._mapped(lambda x: upsample(x, factor), t, (note,))

    def decimated(self, factor: int) -> Decay:
        """Every ``factor``-th sample, low-passed before."""
        if factor <= 1:
            return self
        note = f"decimated by {factor}: that is fast enough"
        return self._mapped(lambda x: downsample(x, factor), self.t[::factor], (note,))

    def differentiated(self, method: Filter | None = None) -> Decay:
        """Smooth the displacement and derive velocity and acceleration that agree with it.

        Parameters
        ----------
        method : Filter, optional
            `Butterworth` (the default), `SavitzkyGolay` or the like.
        """
        method = method or Butterworth()
        columns = [method(x, self.dt) for x in self.q.reshape(len(self.t), -1).T]
        signals = [np.stack(x, axis=1).reshape(self.q.shape) for x in zip(*columns, strict=True)]
        notes = (*self.notes, f"smoothed and differentiated by {method}")
        return replace(self, **dict(zip(SIGNALS, signals, strict=True)), notes=notes)  # type: ignore[arg-type]

    def conditioned(self, method: Filter | None = None) -> Decay:
        """What an analysis of cycles needs: free part, enough samples, derivatives.

        A record that is conditioned already is returned as it is.
        """
        done = self.stage == "conditioned"
        return self if done else self.free().upsampled().differentiated(method)

    def _mapped(
        self, change: Callable[[Array], Array], t: Array | None = None, notes: tuple[str, ...] = ()
    ) -> Decay:
        """The same record with every signal changed, on other times where t is given."""
        signals = {n: getattr(self, n) for n in SIGNALS}
        changed: Any = {n: None if x is None else change(x) for n, x in signals.items()}
        return replace(self, t=self.t if t is None else t, notes=(*self.notes, *notes), **changed)


def _release(
    recording: Recording, start: float | None = None, end: float | None = None
) -> tuple[Release, tuple[str, ...]]:
    """The largest release, or that at an end that is given, and what is to be said of it."""
    releases, discarded = split_releases(recording)
    first, last = recording.t[0], recording.t[-1]
    if not releases:
        t, x = recording.t, np.nan_to_num(recording.x)  # a channel may have no samples
        parts = [x[(t >= part.start) & (t <= part.end)] for part in discarded]
        # Of all that is none the loudest is what was meant, not the rest after it.
        why = discarded[int(np.argmax([np.ptp(part, axis=0).max() for part in parts]))].reason
        raise ValueError(
            f"no free decay between {first:.4g} and {last:.4g} s: {why}; cut the record"
            " with start= and end=, filter it, or record longer"
        )
    largest = max(releases, key=lambda release: release.peak)
    release = releases[0] if start is not None else releases[-1] if end is not None else largest
    notes = []
    if start is None and release.start > first:
        notes.append(f"free decay starts at {release.start:.6g} s (found): {release.why_start}")
    if end is None and release.end < last:
        notes.append(f"tail after {release.end:.6g} s cut: {release.why_end}")
    others = [f"{r.start:.6g} to {r.end:.6g} s" for r in releases if r is not release]
    if others:
        note = (
            f"the record holds {len(releases)} releases; that from {release.start:.6g} to"
            f" {release.end:.6g} s is used, others with start= and end=: {', '.join(others)}"
        )
        warnings.warn(note, stacklevel=4)
        notes.append(note)
    return release, tuple(notes)


def _largest(t: ArrayLike, x: ArrayLike, quantity: Quantity, unit: str | None) -> Decay:
    """The largest release of a measured velocity or acceleration."""
    rate = Decay(t, x)  # type: ignore[arg-type]
    recording = Recording(rate.t, rate.q, quantity=quantity, unit=unit)
    release, notes = _release(recording)
    return Decay.of_release(recording, release, (*rate.notes, *notes))


def _integrated(rate: Decay, frequency: float, quantity: Quantity) -> Decay:
    """The decay whose velocity or acceleration is given as q; ``frequency`` is the slowest, Hz."""
    times = QUANTITIES.index(quantity)
    columns = rate.q.reshape(len(rate.t), -1).T
    found = [displacement(x, rate.dt, frequency, times) for x in columns]
    q = np.stack([x for x, _ in found], axis=1).reshape(rate.q.shape)
    sound = slice(max(s.start for _, s in found), min(s.stop for _, s in found))
    how = "from velocity" if times == 1 else "twice from acceleration"
    done = [f"displacement integrated {how}, drift removed"]
    if len(rate.t[sound]) < len(rate.t):
        before, after = sound.start * rate.dt, (len(rate.t) - sound.stop) * rate.dt
        done.append(f"{before:.3g} s at the start and {after:.3g} s at the end cut: drift unclear")
    signals: Any = {"q": q[sound], SIGNALS[times]: rate.q[sound]}
    notes = (*rate.notes, *done)
    return replace(rate, t=rate.t[sound], measured=quantity, notes=notes, **signals)
