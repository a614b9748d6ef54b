"""Releases: the free decays within a recording, and why the rest is left out.

Swings of one stretch tell where it becomes free, and whether it decays: ``x`` is one channel (n,),
``period`` that of the slowest vibration, in samples, ``noise`` the standard deviation of white
noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from romsindy.record.prediction import JUMP_KNOWN, departures, jumps, slowest_frequency, unpredicted
from romsindy.record.recording import QUANTITIES, Recording
from romsindy.record.signals import runs, without_hum
from romsindy.record.spectrum import noise_std
from romsindy.typing import Array

# Fewer cycles are no decay to analyse.
CYCLES_AT_LEAST = 3
# The amplitude that stands out of the noise, in its standard deviations; less than that part of
# the size of a record is nothing.
LOUD, NOTHING = 3.0, 1e-6
# A swing counts as large from this part of the largest on; a hold or a rest is below that.
_LARGE, _SILENT = 0.5, 0.1
# A blow exceeds what a sensor of velocity or acceleration shows in the next cycle by this factor.
_BLOW = 3.0
# A free decay that swings higher again, by this factor, rises as slowly as it fell before: it
# beats. Where it rises in this part of that time it was pushed.
_AGAIN, _FASTER = 1.5, 0.75
_SMOOTH = 3  # cycles, of which the largest amplitude is taken: fast beats do not show
# Blocks of so many cycles that tell a background, and the quietest parts of all that are tried.
_BLOCKS, _QUIETEST = 8, np.arange(0.95, 0.05, -0.01)
# A background goes up and down from block to block, by this part at least, which a tone does not.
# It falls by no more than so many standard errors of that, and than this part of what a vibration
# does that falls on as it fell before: beats go up and down, too.
_STEADY, _UP_AND_DOWN, _SLOWER = 0.02, 2.0, 0.3
# And this part of it, at least, is not predicted: what decays freely is, beats and all.
_UNPREDICTED = 0.75
# A vibration that swings higher again by this factor, to this part of its largest, is driven where
# this part of it, beside twice the noise, is not predicted: nonlinear beats are, to 0.15.
_RISES, _NEAR, _DRIVEN = 1.35, 0.5, 0.2
FORCED = "it is forced or not a free decay"


def amplitude_of(x: Array, period: float, noise: float) -> Array:
    """Amplitude of the vibration over the cycle round each sample, without the noise."""
    cycle = min(max(round(period), 1), len(x))
    x = x - x.mean()
    power = uniform_filter1d(x**2, cycle) - uniform_filter1d(x, cycle) ** 2
    return np.sqrt(2 * np.clip(power - noise**2, 0, None))


def background_of(x: Array, period: float) -> float:
    """Rms of what is there when nothing rings, of any colour; 0 where that is not seen.

    The amplitude of the vibration falls until it is that of the background, which then goes up and
    down about one level: wind and traffic that keep the structure moving, a sensor's slow noise.
    """
    amplitude = amplitude_of(x, period, 0.0)
    step = max(round(_SMOOTH * period), 1)
    blocks = amplitude[: len(amplitude) // step * step].reshape(-1, step)
    size = np.sqrt(np.mean(blocks**2, axis=1))
    if len(size) < _BLOCKS or not size.min() > 0:
        return 0.0
    loudest = int(np.argmax(size))
    for most in np.quantile(size, _QUIETEST):
        quiet = max(runs(size <= most), key=lambda run: run.stop - run.start)
        level = float(np.sqrt(np.mean(size[quiet] ** 2)))
        # How fast the vibration falls to there, in a block.
        lower = np.flatnonzero(size[loudest:] <= most)
        rate = np.log(size.max() / level) / lower[0] if len(lower) else np.inf
        if not (LOUD * level < size.max() and _stays(np.log(size[quiet]), rate)):
            continue
        part = x[quiet.start * step : quiet.stop * step]
        if unpredicted(part, period, _SMOOTH) > _UNPREDICTED:
            return level / np.sqrt(2)
    return 0.0


def _stays(log: Array, rate: float) -> bool:
    """Whether a series goes up and down by more than it falls, and falls at no such rate."""
    third = len(log) // 3
    if len(log) < _BLOCKS:
        return False
    scatter = float(np.std(np.diff(log))) / np.sqrt(2)
    fall = abs(float(log[:third].mean() - log[-third:].mean()))
    falling = rate * (len(log) - third)
    error = scatter * np.sqrt(2 / third)
    return bool(scatter > _STEADY and fall < _UP_AND_DOWN * error and fall < _SLOWER * falling)


def first_swing(swing: Array, period: float, noise: float, derivative: int, least: float) -> int:
    """First turning point that comes near the largest: holds and blows are before it.

    A start of ``least`` cycles is not worth a cut.
    """
    size = np.abs(swing)
    high = int(np.argmax(size >= _LARGE * size.max()))
    change = np.flatnonzero(np.signbit(swing[high:]) != np.signbit(swing[high]))
    stroke = size[high : high + int(change[0])] if len(change) else size[high:]
    # The last of the largest samples: where a hold at the release position ends.
    slack = max(1e-3 * stroke.max(), 3 * noise)
    start = high + int(np.flatnonzero(stroke >= stroke.max() - slack)[-1])
    start = start if start > least * period else 0
    if derivative == 0:
        return start
    # A sensor of velocity or acceleration shows the blow itself: no swing falls so much at once.
    cycle = int(period)
    following = size[start + cycle : start + 2 * cycle]
    if not len(following):
        return start
    blow = np.flatnonzero(size[start : start + cycle] > _BLOW * following.max())
    return start + int(blow[-1]) + 1 if len(blow) else start


def pushed_again(amplitude: Array, period: float, noise: float) -> int | None:
    """Sample where a decay begins to grow faster than beating does; None where it does not."""
    step = max(int(_SMOOTH * period), 1)
    size, later = _sizes(amplitude, step)
    floor = max(noise, NOTHING * float(size.max()), np.finfo(float).tiny)
    low = int(np.argmax(later / np.maximum(size, floor)))
    high = low + int(np.argmax(size[low:]))
    higher_before = np.flatnonzero(size[:low] >= size[high])
    if size[high] < max(_AGAIN * size[low], 2 * LOUD * noise) or not len(higher_before):
        return None
    fall, rise = low - int(higher_before[-1]), high - low
    return low * step if rise < _FASTER * fall else None


def _sizes(amplitude: Array, step: int) -> tuple[Array, Array]:
    """The largest amplitude of every so many samples, and of all from there on."""
    size = np.maximum.reduceat(amplitude, np.arange(0, len(amplitude), step))
    return size, np.maximum.accumulate(size[::-1])[::-1]


def _driven(swing: Array, amplitude: Array, period: float, noise: float) -> str | None:
    """That a vibration swings higher again as its own past does not foretell; None if not so."""
    size, later = _sizes(amplitude, max(int(_SMOOTH * period), 1))
    if len(size) < _BLOCKS:
        return None
    low = int(np.argmax(later / np.maximum(size, LOUD * noise + NOTHING * size.max())))
    most = _RISES * max(float(size[low]), LOUD * noise)
    if later[low] < max(most, _NEAR * size.max()):
        return None
    white = noise_std(swing) / float(np.std(swing))
    if unpredicted(swing, period, _SMOOTH) < _DRIVEN + 2 * white:
        return None
    return f"the amplitude falls and grows again, which its own past does not foretell: {FORCED}"


def refusal(
    t: Array, swing: Array, amplitude: Array, start: int, period: float, noise: float
) -> str | None:
    """Why this is no free decay; None if it is one."""
    # Many large strokes before the largest one, and fewer after it, are no free decay.
    size = np.abs(swing)
    largest = int(np.argmax(size >= 0.9 * size.max()))
    large = np.flatnonzero(size > 0.3 * size.max())
    reversals = large[1:][np.diff(np.sign(swing[large])) != 0]
    before = int(np.searchsorted(reversals, largest))
    after = len(reversals) - before
    if largest > CYCLES_AT_LEAST * period and before >= 6 and before > after:
        return (
            f"{before // 2} cycles come before the largest amplitude (at {t[largest]:.4g} s),"
            f" {after // 2} after it: the record grows, so {FORCED}"
        )
    cycles = (len(swing) - start) / period
    if cycles < CYCLES_AT_LEAST:
        return (
            f"only {cycles:.1f} cycles after the release (at {t[start]:.4g} s) stand out of the"
            " noise, fewer than three cycles"
        )
    cycle = round(period)
    size = amplitude[start:]
    size = size[cycle:-cycle] if len(size) > 4 * cycle else size
    size = np.log(np.maximum(size, NOTHING * size.max()))  # where noise was taken off is nothing
    growth = np.polyfit(np.linspace(0, 1, len(size)), size, 1)[0]
    if growth > 0.05:
        return f"the amplitude grows by {np.expm1(growth):.0%}: {FORCED}"
    return _driven(swing[start:], amplitude[start:], period, noise)


def onset(
    t: Array, swing: Array, peak: float, noise: float, period: float, *, displaced: bool
) -> str | None:
    """What set off the vibration that is free from the last sample on; None if all was moving."""
    before = swing[max(len(swing) - round(2.5 * period), 0) :]
    still = before[: max(len(before) - round(1.5 * period), round(period / 8), 4)]
    if len(before) <= len(still):
        return None
    level = float(still.mean())
    if np.sqrt(2 * max(still.var() - 1.2 * noise**2, 0.0)) > _SILENT * peak:
        return None
    if abs(level) > peak / 2:
        return f"held until {t[-1]:.5g} s"
    moving = np.abs(before - level) > max(_SILENT * peak, 5 * noise)
    first = len(swing) - len(before) + int(np.argmax(moving))
    return f"{'at rest until' if displaced else 'after the blow at'} {t[first]:.5g} s"


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
    """A part of a recording that is no free decay."""

    start: float  # first sample, s of the clock of the recording
    end: float  # last sample
    reason: str  # why it is left out


@dataclass(frozen=True)
class _Interval:
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
    samples before nor those after predict: a blow, the end of a hold, a splice. It ends at the next
    of these, or where the amplitude falls for good below three times the noise, of whatever colour.
    All channels together tell the events, the liveliest one the amplitude. NaN splits like a gap in
    time.
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


def _finite_pieces(recording: Recording) -> Iterator[_Interval]:
    """Runs of samples without gaps and NaN, eight at least."""
    finite = np.asarray(np.isfinite(recording.x).all(axis=1))
    for piece in recording.pieces:
        for run in runs(finite[piece]):
            first, last = piece.start + run.start, piece.start + run.stop
            if last - first >= 8:
                ends = (
                    "record" if first == 0 else "gap",
                    "record" if last == len(finite) else "gap",
                )
                yield _Interval(first, last, *ends, first)


def _between_events(
    recording: Recording, piece: _Interval, period: float, noise: tuple[Array, Array]
) -> Iterator[_Interval | Discarded]:
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
                yield _Interval(first, start + a, before, "event", start)
            first, before = start + a, "event"
            if _still(x[start : start + a], x[start + a : last], period):
                continue  # the first large swing tells the beginning better
            reason = "predicted neither by what is before nor by what is after: something acts"
            yield Discarded(float(t[start + a]), float(t[start + b - 1]), reason)
            first = start + b
        if first < last:
            yield _Interval(first, last, before, after, start)
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
    recording: Recording, channel: Array, stretch: _Interval, period: float, noise: float
) -> Iterator[Release | Discarded]:
    """The free decays of a stretch, and what lies before, between and after them."""
    t, x = recording.t[stretch.first : stretch.last], channel[stretch.first : stretch.last]
    if np.ptp(x) < _LARGE * (
        np.nanmax(channel) - np.nanmin(channel)
    ):  # a hold, or where friction has stopped it
        x = without_hum(x, recording.dt)
    amplitude = amplitude_of(x, period, noise)
    quiet = f"amplitude below three times the noise (rms {noise:.2g} {recording.signal_unit})"
    loud = runs(amplitude >= max(LOUD * noise, NOTHING * float(np.nanstd(channel))))
    if loud and len(x) < CYCLES_AT_LEAST * period:
        reason = f"only {len(x) / period:.1f} cycles, fewer than three cycles"
        yield Discarded(float(t[0]), float(t[-1]), reason)
        return
    # Noise stands out for no more than the cycle that an amplitude is taken over.
    loud = [run for run in loud if run.stop - run.start > _LASTS * period]
    if not loud:
        yield Discarded(float(t[0]), float(t[-1]), quiet)
        return
    stop, why_end = loud[-1].stop, quiet
    # Less than a cycle is not worth a cut: so a record that was cut before stays as it is.
    if len(x) - stop <= period:
        stop, why_end = len(x), _ENDS[stretch.after].format(t[-1])
    later = x[stop // 2 : stop]  # its tapered mean is about where it comes to rest
    rest = float(np.average(later, weights=np.hanning(len(later) + 2)[1:-1]))
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
    refused = refusal(t, swing, amplitude[:stop], start, period, noise)
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
