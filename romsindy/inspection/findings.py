"""What is in a record: releases, modes, noise, defects, and the decays that an analysis needs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter

import numpy as np

from romsindy.record.decay import Decay
from romsindy.record.defects import Defect, clean
from romsindy.record.prediction import slowest_frequency, unexplained
from romsindy.record.recording import Recording
from romsindy.record.releases import FORCED, Discarded, Release
from romsindy.record.signals import rest_level
from romsindy.record.vibrations import (
    ENOUGH_SAMPLES,
    Resonance,
    Stretch,
    Vibration,
    dominant,
    find_vibrations,
    isolated,
    resonances,
    together,
)
from romsindy.text import listed, quantity, span
from romsindy.typing import Array

# Frequencies of one mode in two releases overlap when each range is widened by this part.
_SAME = 0.03


@dataclass(frozen=True, eq=False, repr=False)
class Mode:
    """One vibration of a structure, in every release in which it rings.

    Attributes
    ----------
    number : int
        From 1, by frequency.
    parts : tuple of Vibration or None
        One for each release; None where it does not stand out.
    share : float
        Of the energy of all that vibrates in all releases, its harmonics included: those of all
        modes add up to at most 1.
    """

    number: int
    parts: tuple[Vibration | None, ...]
    share: float

    def __repr__(self) -> str:
        (high, low), (loud, quiet) = self.frequency, self.damping_ratio
        return (
            f"<Mode {self.number}: {high:.5g} Hz loud, {low:.5g} Hz quiet,"
            f" damping {100 * loud:.2g} % loud, {100 * quiet:.2g} % quiet>"
        )

    @property
    def rings(self) -> list[Vibration]:
        """The vibrations, of the releases in which it stands out."""
        return [v for v in self.parts if v is not None]

    @property
    def mean_frequency(self) -> float:
        """Hz, weighted by the energy in the releases."""
        weights = [v.energy for v in self.rings]
        return float(np.average([v.mean_frequency for v in self.rings], weights=weights))

    @property
    def energy(self) -> float:
        """Integral of the displacement^2 over all releases."""
        return float(sum(v.energy for v in self.rings))

    @property
    def steady(self) -> bool:
        """Whether it does not decay while others do: mains hum, a motor, no mode."""
        return all(v.steady for v in self.rings)

    @property
    def harmonics(self) -> tuple[int, ...]:
        """Numbers of the harmonics that stand out."""
        return tuple(sorted({n for v in self.rings for n, _ in (*v.harmonics, *v.carried)}))

    @property
    def ends(self) -> tuple[Stretch, Stretch]:
        """Where its displacement is largest, and least, of all releases."""
        loud = max((v.loud for v in self.rings), key=attrgetter("amplitude"))
        return loud, min((v.quiet for v in self.rings), key=attrgetter("amplitude"))

    @property
    def amplitude(self) -> tuple[float, float]:
        """Largest and least amplitude of the displacement that was followed, unit of q."""
        return self._at_ends("amplitude")

    @property
    def frequency(self) -> tuple[float, float]:
        """Hz at these amplitudes."""
        return self._at_ends("frequency")

    @property
    def hertz(self) -> str:
        """The same in words: "77.57 to 44.74"."""
        return span(*self.frequency, 5)

    @property
    def damping_ratio(self) -> tuple[float, float]:
        """Damping ratio at these amplitudes; NaN where it is lost in scatter."""
        return self._at_ends("damping_ratio")

    def _at_ends(self, name: str) -> tuple[float, float]:
        loud, quiet = (float(getattr(end, name)) for end in self.ends)
        return loud, quiet


def modes_of(releases: Sequence[Sequence[Vibration]]) -> tuple[Mode, ...]:
    """The modes of the vibrations of several releases, by frequency."""
    found: list[list[Vibration | None]] = []
    for i, vibrations in enumerate(releases):
        free = [m for m in found if m[i] is None]
        for v in vibrations:
            same = [m for m in free if m[i] is None and any(_same(v, o) for o in m if o)]
            if not same:
                same = [[None] * len(releases)]
                found += same
            # Of several that overlap, that whose frequency is nearest.
            nearest = min(same, key=lambda m: _apart(v, m))
            nearest[i] = v
    found = [m for m in found if not all(v.faint for v in m if v)]
    ordered = sorted(found, key=lambda m: float(np.mean([v.mean_frequency for v in m if v])))
    whole = sum(vibrations[0].signal for vibrations in releases if vibrations)
    shares = [sum(v.share * v.signal for v in m if v) / whole for m in ordered]
    return tuple(
        Mode(n, tuple(m), s) for n, (m, s) in enumerate(zip(ordered, shares, strict=True), 1)
    )


def _same(one: Vibration, other: Vibration) -> bool:
    low = max(one.frequency.min(), other.frequency.min()) * (1 - _SAME)
    return bool(low < min(one.frequency.max(), other.frequency.max()) * (1 + _SAME))


def _apart(vibration: Vibration, parts: Sequence[Vibration | None]) -> float:
    return min((abs(vibration.mean_frequency - v.mean_frequency) for v in parts if v), default=0.0)


# Of the largest swing of a release: where what was followed begins with less, that is told.
_BEGINS = 0.75


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one channel, beside everything that rings."""

    channel: str
    rms: float  # unit of the samples
    ratio: float  # rms of the loudest release over it, in dB
    rings: bool  # whether it holds anything but noise, of whatever colour


@dataclass(frozen=True, eq=False)
class Findings:
    """What is in a recording, in numbers.

    Attributes
    ----------
    recording, cleaned : Recording
        As it was read, and with its defects mended.
    channel : str
        Name of the channel in which modes were looked for.
    together : tuple of str
        Names of the channels that a decay is made of, each as far as the mode shows in it.
    defects : tuple of Defect
        What is wrong with samples, and what was done about it.
    releases : tuple of Release
    discarded : tuple of Discarded
        What of the record is no free decay, and why.
    vibrations : tuple of tuples of Vibration
        Of each release, by frequency.
    noise : tuple of ChannelNoise
    """

    recording: Recording
    cleaned: Recording
    channel: str
    together: tuple[str, ...]
    defects: tuple[Defect, ...]
    releases: tuple[Release, ...]
    discarded: tuple[Discarded, ...]
    vibrations: tuple[tuple[Vibration, ...], ...]
    noise: tuple[ChannelNoise, ...]

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """The vibrations that ring, numbered from 1 by frequency."""
        return modes_of(self.vibrations)

    @property
    def dominant(self) -> Mode:
        """The mode that moves most; of two that move about as much the lower one.

        Raises
        ------
        ValueError
            If nothing rings.
        """
        ringing = [m for m in self.modes if not m.steady]
        if not ringing:
            source = self.recording.source or "the record"
            raise ValueError(f"{source}: {self._why_nothing()}: {self._remedy()}")
        return ringing[dominant([m.energy for m in ringing])]

    @cached_property
    def resonances(self) -> tuple[tuple[Mode, Mode, Resonance], ...]:
        """Pairs of modes that come near a ratio of small whole numbers, with where they do."""
        found: dict[tuple[int, ...], tuple[Mode, Mode, Resonance]] = {}
        for i, vibrations in enumerate(self.vibrations):
            of = {id(m.parts[i]): m for m in self.modes}
            for r in resonances(vibrations):
                pair = [of.get(id(vibrations[k])) for k in (r.lower, r.higher)]
                if pair[0] is None or pair[1] is None:  # too faint for a mode
                    continue
                found.setdefault((pair[0].number, pair[1].number, r.p, r.q), (pair[0], pair[1], r))
        return tuple(found.values())

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the record, a sentence each."""
        return (*(str(d) for d in self.defects), *self._not_free(), *self._begins_larger())

    def _not_free(self) -> list[str]:
        """Modes that end without decaying: no free vibration does."""
        return [
            f"mode {m.number} ({m.hertz} Hz) does not decay at the end of release"
            f" {i + 1}: if something drives it, it is no free decay; cut the record with start= and"
            " end="
            for m in self.modes
            for i, part in enumerate(m.parts)
            if part is not None and not m.steady and part.stays
        ]

    def _begins_larger(self) -> Iterator[str]:
        """Releases whose first swings are larger than all that was followed."""
        for i, vibrations in enumerate(self.vibrations):
            swing = np.abs(self.release_signal(i)[1])
            part = self.releases[i]
            followed = sum(v.tone.amplitude.max() for v in vibrations)
            if vibrations and followed < _BEGINS * swing.max():
                unit = self.recording.signal_unit
                yield (
                    f"release {i + 1} begins with {quantity(swing.max(), unit)} at"
                    f" {part.start:.6g} s, and what was followed with {quantity(followed, unit)}:"
                    " the table of modes holds from there on"
                )

    def decays(
        self,
        mode: int | None = None,
        band: tuple[float, float] | None = None,
        release: int | None = None,
    ) -> tuple[Decay, ...]:
        """The free decays of one mode by itself, ready to be analysed.

        Parameters
        ----------
        mode : int, optional
            Its number in `modes`; the dominant one by default.
        band : (float, float), optional
            Hz; the dominant mode with its mean frequency in there.
        release : int, optional
            Number of the release, from 1; all in which the mode rings by default.

        Raises
        ------
        ValueError
            If there is no such mode or release, or the mode does not ring in it.
        """
        chosen = self.mode(mode, band)
        return tuple(self._isolated(i, chosen) for i in self.rings_in(chosen, release))

    def measured_decays(self, release: int | None = None) -> tuple[Decay, ...]:
        """The free decays of the channel with all that is in them, as a diagnosis takes them.

        Level, hold and tail are taken off, and samples that are missing or spiked are mended.
        Nothing is filtered: hum, a drift, a sensor that clips or a faint mode may be what is to be
        named.

        Parameters
        ----------
        release : int, optional
            Number of the release, from 1; all in which the dominant mode rings by default.

        Raises
        ------
        ValueError
            If there is no such release, or nothing rings.
        """
        numbers = self.rings_in(self.mode(), release)
        whole, defects = clean(self.recording.channel(self.channel), as_measured=True)
        own = replace(self, defects=defects)
        return tuple(own._as_measured(i, whole) for i in numbers)

    def whole_decays(
        self, release: int | None = None, modes: int | None = None
    ) -> tuple[Decay, ...]:
        """The free decays with all that rings in them, each channel by itself.

        They are what `identify` takes with ``coordinates="auto"``. A record of many samples a cycle
        is decimated.

        Parameters
        ----------
        release : int, optional
            Number of the release, from 1; all in which enough modes ring by default.
        modes : int, optional
            How many modes are enough; as many as ring in any release by default.

        Raises
        ------
        ValueError
            If there is no such release, or nothing rings.
        """
        numbers, inside = self.rings_together(release, modes), self.cleaned.channel(*self.together)
        fastest = max(max(m.frequency) for m in self.modes if not m.steady)
        factor = int(1 / (ENOUGH_SAMPLES * inside.dt * fastest))
        decays = [
            Decay.of_release(inside, self.releases[i], self._notes(i, self.together))
            for i in numbers
        ]
        return tuple(decay.decimated(factor) for decay in decays)

    def rings_together(self, release: int | None = None, modes: int | None = None) -> list[int]:
        """Numbers, from 0, of the releases that `whole_decays` takes.

        Raises
        ------
        ValueError
            If there is no such release, or nothing rings.
        """
        self.mode()  # refuses a record in which nothing rings
        ringing = [m for m in self.modes if not m.steady]
        counts = [sum(m.parts[i] is not None for m in ringing) for i in range(len(self.releases))]
        if release is None:
            enough = min(max(counts), modes or max(counts))
            return [i for i, count in enumerate(counts) if count >= enough]
        if release not in range(1, len(counts) + 1):
            raise ValueError(f"release = {release} is none of the releases, 1 to {len(counts)}")
        return [release - 1]

    def mode(self, mode: int | None = None, band: tuple[float, float] | None = None) -> Mode:
        """One of the modes by number or band, the dominant one by default.

        Raises
        ------
        ValueError
            If there is none, or both are given.
        """
        listed = ", ".join(f"{m.number} at {m.mean_frequency:.4g} Hz" for m in self.modes)
        if mode is not None and band is not None:
            raise ValueError(f"mode = {mode} and band = {band} are two choices: give one")
        if mode is not None:
            if mode not in [m.number for m in self.modes]:
                raise ValueError(f"mode = {mode} is none of the modes: {listed or 'nothing rings'}")
            return self.modes[mode - 1]
        if band is None:
            return self.dominant
        low, high = band
        if not low < high:
            raise ValueError(f"band = {low:g} {high:g} must name the lower frequency first, in Hz")
        inside = [m for m in self.modes if low <= m.mean_frequency <= high and not m.steady]
        if not inside:
            raise ValueError(
                f"band = {low:g} to {high:g} Hz holds no mode: {listed or 'nothing rings'}"
            )
        return inside[dominant([m.energy for m in inside])]

    def rings_in(self, mode: Mode, release: int | None = None) -> list[int]:
        """Numbers, from 0, of the releases in which a mode rings; or of that one alone, from 1.

        Raises
        ------
        ValueError
            If there is no such release, or the mode does not ring in it.
        """
        rings = [i for i, part in enumerate(mode.parts) if part is not None]
        if release is None:
            return rings
        if release - 1 not in rings:
            raise ValueError(
                f"release = {release}: mode {mode.number} ({mode.mean_frequency:.4g} Hz) rings in"
                f" release {listed([i + 1 for i in rings])} of {len(self.releases)}: choose there"
            )
        return [release - 1]

    def _why_nothing(self) -> str:
        """Why no mode rings: in the words of what was left out, where that is all."""
        if self.releases:
            return f"in channel {self.channel} no vibration that decays stands out of the noise"
        longest = max(self.discarded, key=lambda part: part.end - part.start)
        return (
            f"no free decay between {longest.start:.6g} and {longest.end:.6g} s: {longest.reason}"
        )

    def _remedy(self) -> str:
        if self.recording.driven:
            return "give the input to `romsindy identify --input` or rs.load_forced"
        remedy = "choose another channel, cut the record with start= and end=, or record longer"
        if not self.may_drive:
            return remedy
        return f"if a column is the input, name it with input_column=; else {remedy}"

    @property
    def may_drive(self) -> tuple[tuple[str, str], ...]:
        """Pairs of columns that may be response and input, where what was left out seems forced."""
        if self.releases or not any(FORCED in part.reason for part in self.discarded):
            return ()
        beside = (name for name in self.recording.names if name != self.channel)
        left_out = ((self.channel, name) for name in self.recording.left_out)
        return (*left_out, *map(self._driven_first, beside))

    def _driven_first(self, other: str) -> tuple[str, str]:
        """The channel and another one, that first which the other foretells better."""
        names = (self.channel, other)
        x = self.cleaned.channel(*names).x
        x = x[np.isfinite(x).all(axis=1)].T
        frequency = slowest_frequency(x[0], self.cleaned.dt, 0)
        if frequency is None:
            return names
        period = 1 / (frequency * self.cleaned.dt)
        backwards = unexplained(x[1], x[0], period) < unexplained(x[0], x[1], period)
        return names[::-1] if backwards else names

    def release_signal(self, number: int) -> tuple[Array, Array]:
        """Times in s and cleaned samples of release ``number``, from 0, in the channel."""
        part = self.releases[number]
        inside = self.cleaned.between(part.start, part.end).channel(self.channel)
        return inside.t, inside.x[:, 0]

    def _as_measured(self, i: int, whole: Recording) -> Decay:
        """One release of a channel without its level: where the vibration comes to rest."""
        part = whole.between(self.releases[i].start, self.releases[i].end)
        notes = self._notes(i, part.names)
        level = rest_level(part.x[:, 0], part.dt)
        if level:
            raw = self.recording.channel(self.channel).between(part.t[0], part.t[-1])
            as_read = level + float(np.nanmedian(raw.x) - np.median(part.x))  # before steps went
            size = quantity(as_read, self.recording.signal_unit)
            notes = (*notes, f"level of {size}, where it comes to rest, taken off")
        return Decay.of_release(replace(part, x=part.x - level), self.releases[i], notes)

    def _isolated(self, i: int, mode: Mode) -> Decay:
        t, x = self.release_signal(i)
        vibrations = self.vibrations[i]
        number = next(k for k, v in enumerate(vibrations) if v is mode.parts[i])
        notes = self._notes(i, (self.channel,))
        if len(self.together) > 1:
            x, shape = self._together(i, vibrations[number])
            own = dict(zip(self.together, shape.tolist(), strict=True))
            left = [name for name, s in own.items() if not s]
            used = listed([f"{name} ({s:+.3g})" for name, s in own.items() if s])
            note = f"channels {used} together, as displacement of {self.channel}"
            notes = (*notes, note + (f"; not in phase with it: {listed(left)}" if left else ""))
            vibrations = find_vibrations(x, float(t[1] - t[0]), vibrations[number].derivative)
            off = [abs(v.mean_frequency / mode.mean_frequency - 1) for v in vibrations]
            number = int(np.argmin(off))
        alone = isolated(t, x, vibrations, number, self.recording.unit, notes)
        tone = vibrations[number].tone
        first, last = float(t[0]) + tone.start, float(t[0]) + tone.end
        if first <= alone.t[0] and alone.t[-1] <= last:
            return alone
        note = f"cut to {first:.6g} to {last:.6g} s, where it stands out of the noise"
        return replace(alone.between(first, last), notes=(*alone.notes, note))

    def _notes(self, i: int, channels: Collection[str]) -> tuple[str, ...]:
        """What was done to a release, and what is wrong with it in some channels."""
        part, notes = self.releases[i], list(self.recording.notes)
        if len(self.releases) > 1 or part.start > self.recording.t[0]:
            notes.append(
                f"release {i + 1} of {len(self.releases)}: from {part.start:.6g} s"
                f" ({part.why_start}) to {part.end:.6g} s ({part.why_end})"
            )
        inside = [d for d in self.defects if d.start <= part.end and d.end >= part.start]
        return (*notes, *(str(d) for d in inside if d.channel in ("", *channels)))

    def _together(self, i: int, vibration: Vibration) -> tuple[Array, Array]:
        """The channels as one for a vibration, scaled to the main one, and what each has of it."""
        part = self.releases[i]
        inside = self.cleaned.between(part.start, part.end).channel(*self.together)
        main = self.together.index(self.channel)
        return together(inside.t - inside.t[0], inside.x, main, vibration.tone)

    def in_phase(self, mode: Mode) -> tuple[str, ...]:
        """Channels that move in phase with the main one in a mode, itself among them."""
        if len(self.together) == 1:
            return self.together
        first, part = next((i, v) for i, v in enumerate(mode.parts) if v is not None)
        shape = self._together(first, part)[1]
        return tuple(n for n, s in zip(self.together, shape, strict=True) if s)
