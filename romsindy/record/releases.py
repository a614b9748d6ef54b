"""Releases: the free decays within a recording, and why the rest is left out."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from romsindy.record.faults import runs
from romsindy.record.noise_level import noise_std
from romsindy.record.prediction import JUMP_KNOWN, departures, jumps, slowest_frequency
from romsindy.record.recording import QUANTITIES, Recording
from romsindy.record.swings import (
    CYCLES_AT_LEAST,
    LOUD,
    NOTHING,
    amplitude_of,
    background_of,
    first_swing,
    onset,
    pushed_again,
    refusal,
    rest_of,
)
from romsindy.typing import Array

# A start of fewer cycles is not worth a cut: a velocity peaks a quarter after its let-go. Of a
# displacement, which begins at its peak, it is less.
_WORTH = 0.3
# Cycles over which a vibration stands out of the noise.
_LASTS = 1.5
# Of the swing that follows an event: less before it is rest.
_REST = 0.1


@dataclass(frozen=True)
class Release:
    """One free decay within a recording.

    Attributes
    ----------
    start, end : float
        First and last sample, s of the recording's clock.
    peak : float
        Largest deflection of the liveliest channel from rest, unit of the recording.
    frequency : float
        Of the slowest vibration of the recording, Hz, about.
    cycles : float
        How many of these cycles it holds.
    why_start, why_end : str
        What happens there: "after the blow at 0.0102 s", "amplitude below three times the noise".
    """

    start: float
    end: float
    peak: float
    frequency: float
    cycles: float
    why_start: str
    why_end: str


@dataclass(frozen=True)
class Discarded:
    """A part of a recording that is no free decay.

    Attributes
    ----------
    start, end : float
        First and last sample, s of the recording's clock.
    reason : str
        Why it is left out.
    """

    start: float
    end: float
    reason: str


@dataclass(frozen=True)
class _Stretch:
    """Samples [first, last) between two events, and which these are."""

    first: int
    last: int
    before: str = "record"
    after: str = "record"
    whole_from: int = 0  # neither a gap nor a jump between there and the first sample


_STARTS = {
    "record": "start of the record",
    "gap": "start after missing samples",
    "jump": "after the jump at {:.5g} s: a blow, or another record was joined",
    "event": "after the event at {:.5g} s",
    "push": "after the push that began at {:.5g} s",
}
_ENDS = {
    "record": "end of the record",
    "gap": "samples are missing after {:.5g} s",
    "jump": "jump at {:.5g} s: a blow, or another record was joined",
    "event": "something acts on it at {:.5g} s",
    "push": "grows from {:.5g} s on: pushed again",
}


def split_releases(recording: Recording) -> tuple[tuple[Release, ...], tuple[Discarded, ...]]:
    """Split a recording into free decays and what is none, in the order of time.

    A release begins at the start of the record, after a gap, or after an event that neither the
    samples before nor those after predict: a blow, the end of a hold, a splice. It ends at the
    next of these, or where the amplitude falls for good below three times the noise, of whatever
    colour. All channels together tell the events, the liveliest one the amplitude.

    Parameters
    ----------
    recording : Recording
        NaN splits it like a gap in time.

    Returns
    -------
    releases : tuple of Release
    discarded : tuple of Discarded
    """
    sampled = np.isfinite(recording.x).any(axis=0)
    recording = (
        replace(recording, x=recording.x[:, sampled], names=()) if sampled.any() else recording
    )
    pieces = list(_finite_pieces(recording))
    if not pieces:
        return (), (Discarded(float(recording.t[0]), float(recording.t[-1]), "no samples"),)
    liveliest = int(np.argmax(np.nanstd(recording.x, axis=0)))
    channel = recording.x[:, liveliest]
    energy = [np.var(channel[p.first : p.last]) * (p.last - p.first) for p in pieces]
    main = pieces[int(np.argmax(energy))]
    derivative = QUANTITIES.index(recording.quantity)
    frequency = slowest_frequency(channel[main.first : main.last], recording.dt, derivative)
    if frequency is None:
        reason = "fewer than three cycles of any vibration stand out of noise and drift"
        return (), (Discarded(float(recording.t[0]), float(recording.t[-1]), reason),)
    period = 1 / (frequency * recording.dt)
    parts: list[Release | Discarded] = []
    for piece in pieces:
        inside = recording.x[piece.first : piece.last].T
        white = np.array([noise_std(x) for x in inside])
        background = np.array([background_of(x, period) for x in inside])
        noise = float(max(white[liveliest], background[liveliest]))
        for part in _between_events(recording, piece, period, (white, background)):
            if isinstance(part, Discarded):
                parts.append(part)
            else:
                parts += _decays(recording, channel, part, period, noise)
    releases = [part for part in parts if isinstance(part, Release)]
    return tuple(_until_the_next(releases)), tuple(p for p in parts if isinstance(p, Discarded))


def _finite_pieces(recording: Recording) -> Iterator[_Stretch]:
    """Runs of samples without gaps and NaN, eight at least."""
    finite = np.asarray(np.isfinite(recording.x).all(axis=1))
    for piece in recording.pieces:
        inside = finite[piece].astype(int)
        edges = piece.start + np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]])))
        for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            if last - first >= 8:
                ends = (
                    "record" if first == 0 else "gap",
                    "record" if last == len(finite) else "gap",
                )
                yield _Stretch(first, last, *ends, first)


def _between_events(
    recording: Recording, piece: _Stretch, period: float, noise: tuple[Array, Array]
) -> Iterator[_Stretch | Discarded]:
    """The stretches of a piece between jumps, blows and the like; these are discarded."""
    t, x = recording.t, recording.x
    start, before = piece.first, piece.before
    found = [piece.first + at for at in jumps(x[piece.first : piece.last], period)]
    for end in [*found, piece.last]:
        joined = end < piece.last
        last, after = (
            (end - max(JUMP_KNOWN, round(period / 8)), "jump") if joined else (end, piece.after)
        )
        first = start
        for a, b in departures(x[start:last], period, *noise):
            if first < start + a:
                yield _Stretch(first, start + a, before, "event", start)
            first, before = start + a, "event"
            if _still(x[start : start + a], x[start + a : last], period):
                continue  # the first large swing tells the beginning better
            reason = "predicted neither by what is before nor by what is after: something acts"
            yield Discarded(float(t[start + a]), float(t[start + b - 1]), reason)
            first = start + b
        if first < last:
            yield _Stretch(first, last, before, after, start)
        start, before = end, "jump"


def _still(before: Array, after: Array, period: float) -> bool:
    """Whether nothing vibrates before, (n, m), compared with what comes after."""
    cycle = round(period)
    if len(before) < cycle / 8:
        return False
    moves = [np.ptp(part, axis=0) for part in (before[-cycle:], after[: 2 * cycle])]
    return bool(np.all(moves[0] < _REST * moves[1]))


def _until_the_next(releases: list[Release]) -> Iterator[Release]:
    for release, following in itertools.zip_longest(releases, releases[1:]):
        acted = release.why_end.startswith("something")
        if (
            acted
            and following is not None
            and following.start - release.end < 2 / release.frequency
        ):
            yield replace(release, why_end=f"next release at {following.start:.5g} s")
        else:
            yield release


def _decays(
    recording: Recording, channel: Array, stretch: _Stretch, period: float, noise: float
) -> Iterator[Release | Discarded]:
    """The free decays of a stretch, and what lies before, between and after them."""
    t, x = recording.t[stretch.first : stretch.last], channel[stretch.first : stretch.last]
    amplitude = amplitude_of(x, period, noise)
    quiet = f"amplitude below three times the noise (rms {noise:.2g} {recording.signal_unit})"
    loud = runs(amplitude >= max(LOUD * noise, NOTHING * float(np.nanstd(channel))))
    # Noise stands out for no more than the cycle that an amplitude is taken over.
    loud = [run for run in loud if run.stop - run.start > _LASTS * period]
    if not loud:
        yield Discarded(float(t[0]), float(t[-1]), quiet)
        return
    if len(x) < CYCLES_AT_LEAST * period:
        reason = f"only {len(x) / period:.1f} cycles, fewer than three cycles"
        yield Discarded(float(t[0]), float(t[-1]), reason)
        return
    stop, why_end = loud[-1].stop, quiet
    # Less than a cycle is not worth a cut: so a record that was cut before stays as it is.
    if len(x) - stop <= period:
        stop, why_end = len(x), _ENDS[stretch.after].format(t[-1])
    rest = rest_of(x[:stop])
    swing = x[:stop] - rest
    derivative = QUANTITIES.index(recording.quantity)
    worth = _WORTH if derivative else 0.75 * _WORTH
    least = 0.0 if stretch.before == "event" else worth
    start = first_swing(swing, period, noise, derivative, least)
    pushed = pushed_again(amplitude[start:stop], period, noise)
    if pushed:
        at = stretch.first + start + pushed
        halves = replace(stretch, last=at, after="push"), replace(stretch, first=at, before="push")
        for half in halves:
            yield from _decays(recording, channel, half, period, noise)
        return
    refused = refusal(t, swing, amplitude[:stop], start, period)
    if refused:
        yield Discarded(float(t[0]), float(t[-1]), refused)
        return
    peak, cycles = float(np.abs(swing[start:]).max()), (stop - start) / period
    if start > 0:
        yield Discarded(float(t[0]), float(t[start - 1]), "before the release")
    since = slice(stretch.whole_from, stretch.first + start + 1)
    why_start = onset(
        recording.t[since], channel[since] - rest, peak, noise, period, displaced=derivative == 0
    )
    why_start = why_start or _STARTS[stretch.before].format(t[0])
    span = float(t[start]), float(t[stop - 1])
    yield Release(*span, peak, 1 / (period * recording.dt), cycles, why_start, why_end)
    if stop < len(x):
        yield Discarded(float(t[stop]), float(t[-1]), why_end)
