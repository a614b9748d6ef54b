"""What is wrong with the samples of a recording, and what can be mended."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from romsindy.record.disturbances import hidden_mains, level_and_drift, steady_lines
from romsindy.record.faults import clipped, dropouts, filled, resolution, restored, spikes, steps
from romsindy.record.recording import Recording, uniform_times
from romsindy.record.signals import Mask, moving_mean, runs
from romsindy.record.smoothing import swing
from romsindy.record.spectrum import NoiseLevel
from romsindy.text import counted
from romsindy.typing import Array

# Of the range: coarser steps are told.
_COARSE = 2e-4
# Faults that are told one by one; more of them are told together.
_ONE_BY_ONE = 5
# Samples of the longest gap in time that is filled, with NaN at first.
_BRIDGED = 64
# Of the largest amplitude: coloured noise below it is not told; and samples that tell a colour.
_NOISY, _TELLING = 0.005, 256
# Pieces of a record, the mean of which a drift follows, and how often it is taken off.
_PIECES, _PASSES = 15, 4
# Samples that a channel must have.
_FEWEST = 16


@dataclass(frozen=True)
class Defect:
    """What is wrong with samples of a recording.

    Attributes
    ----------
    kind : str
        "gap", "jitter", "missing", "dropout", "spikes", "clipping", "quantisation", "offset",
        "drift", "step", "mains", "line", "coloured noise", "nothing vibrates".
    channel : str
        Its name; "" where all channels are meant.
    start, end : float
        When, s of the recording's own clock.
    size : float
        How large: unit of the samples, but s for gaps, sampling intervals for jitter, and the
        share of a channel that is missing.
    message : str
        All of that and what was done about it, in one sentence.
    argument : str
        What the user may give to do without the samples: "start=1.25"; "" where no need is.
    """

    kind: str
    channel: str
    start: float
    end: float
    size: float
    message: str
    argument: str = ""

    def __str__(self) -> str:
        return self.message


def clean(
    recording: Recording, *, as_measured: bool = False
) -> tuple[Recording, tuple[Defect, ...]]:
    """Mend what can be mended, NaN where nothing can, and list all that is wrong with the samples.

    Times become uniform between gaps. Samples that are missing, dropped out, spiked or clipped are
    interpolated where a quarter of a cycle or less is lost, and NaN otherwise. Offset, drift and
    steady lines such as mains hum are subtracted. The vibration's own moving midline stays.
    ``as_measured`` what a sensor or its surroundings do stays: samples that clip, offset, drift and
    lines.
    """
    recording, found = _uniform(_whole(recording))
    x = recording.x.copy()
    for piece in recording.pieces:
        for i, name in enumerate(recording.names):
            channel = _Channel(recording.t[piece], x[piece, i], name, recording)
            x[piece, i], told = _mended(channel, as_measured)
            found += told
    return replace(recording, x=x), tuple(found)


@dataclass(frozen=True)
class _Channel:
    """Samples of one channel between two gaps."""

    t: Array
    x: Array
    name: str
    recording: Recording

    def defect(
        self,
        kind: str,
        what: str,
        where: slice = slice(None),
        size: float = 0.0,
        argument: str = "",
    ) -> Defect:
        start, end = float(self.t[where][0]), float(self.t[where][-1])
        place = f"{self.recording.source or 'record'}, channel {self.name}, {_when(start, end)}"
        return Defect(kind, self.name, start, end, size, f"{place}: {what}", argument)

    @property
    def other(self) -> str:
        """The remedy that takes another channel, where there is one."""
        others = [name for name in self.recording.names if name != self.name]
        return f"column={others[0]!r}" if others else ""

    def number(self, size: float) -> str:
        return f"{size:.3g} {self.recording.signal_unit}"


def _when(start: float, end: float) -> str:
    return f"at {start:.6g} s" if start == end else f"from {start:.6g} to {end:.6g} s"


def _whole(recording: Recording) -> Recording:
    """The samples that short gaps leave out are there, as NaN."""
    lost = np.where(recording.lost > _BRIDGED, 0, recording.lost)
    index = np.arange(len(recording.t)) + np.concatenate([[0], np.cumsum(lost)])
    t = np.interp(np.arange(index[-1] + 1), index, recording.t)
    x = np.full((len(t), recording.x.shape[1]), np.nan)
    x[index] = recording.x
    return replace(recording, t=t, x=x)


def _uniform(recording: Recording) -> tuple[Recording, list[Defect]]:
    """Uniform times between gaps, and what is told of gaps and jitter."""
    source, found = recording.source or "record", []
    t, x = recording.t.copy(), recording.x.copy()
    for last, piece in zip([None, *recording.pieces], recording.pieces, strict=False):
        if last is not None:
            start, end = float(t[last][-1]), float(t[piece][0])
            what = f"no samples {_when(start, end)}: the parts before and after stand alone"
            argument = f"start={end:.6g}"
            found.append(Defect("gap", "", start, end, end - start, f"{source}: {what}", argument))
        own = recording.t[piece]
        t[piece], note = uniform_times(own) if len(own) > 4 else (own, "")
        if note:
            size = float(np.abs(t[piece] - own).max() / recording.dt)
            message = f"{source}, {_when(own[0], own[-1])}: {note}"
            found.append(Defect("jitter", "", float(own[0]), float(own[-1]), size, message))
            x[piece] = np.stack([_moved(own, c, t[piece]) for c in x[piece].T], axis=1)
    return replace(recording, t=t, x=x), found


def _moved(t: Array, x: Array, to: Array) -> Array:
    """Samples at other times less than a step away; what is missing stays so."""
    known = np.isfinite(x)
    if np.count_nonzero(known) < 4:
        return x
    return np.where(known, make_interp_spline(t[known], x[known], k=3)(to), np.nan)


def _mended(channel: _Channel, as_measured: bool) -> tuple[Array, list[Defect]]:
    """Samples of a channel after all that could be done, and what that was."""
    x = np.where(np.isfinite(channel.x), channel.x, np.nan)
    if np.count_nonzero(np.isfinite(x)) < _FEWEST:
        return x, [
            channel.defect("missing", "hardly any sample is a number", argument=channel.other)
        ]
    missing = np.isnan(x)
    marks = {"missing": missing, "spikes": spikes(filled(x)) & ~missing}
    x = np.where(marks["spikes"], np.nan, x)
    found = _coarse(channel, x)
    try:
        cycle = _cycle(filled(x))
    except ValueError as error:
        return x, [channel.defect("nothing vibrates", f"{error}", argument=channel.other)]
    marks["dropout"] = dropouts(x, cycle)
    x = np.where(marks["dropout"], np.nan, x)
    for at, size in steps(filled(x), cycle):
        x[at:] -= size
        what = f"the level steps by {channel.number(size)}: taken back"
        found.append(channel.defect("step", what, slice(at, at + 1), size))
    if not as_measured:
        marks["clipping"] = clipped(x)
        x = np.where(marks["clipping"], np.nan, x)
    x = restored(x, cycle)
    for kind, mark in marks.items():
        found += _told(channel, kind, mark, x)
    if as_measured:
        return x, found
    x, told = _undisturbed(channel, x, cycle)
    return x, found + told


def _cycle(x: Array) -> int:
    """Samples of a cycle of what vibrates in a channel, beside a drift of any size.

    Raises a ValueError if nothing does.
    """
    for _ in range(_PASSES):
        x = x - moving_mean(x, max(len(x) // _PIECES, 3))
        try:
            return swing(x)[1]
        except ValueError as error:
            refused = error  # a drift may be left that is greater than the vibration
    raise refused


def _coarse(channel: _Channel, x: Array) -> list[Defect]:
    step = resolution(x)
    if step < _COARSE * np.nanmax(np.abs(x - np.nanmedian(x))):
        return []
    what = f"the sensor counts in steps of {channel.number(step)}"
    return [channel.defect("quantisation", what, size=step)]


def _told(channel: _Channel, kind: str, mark: Mask, mended: Array) -> list[Defect]:
    """One defect for each run, or for all of them together where they are many."""
    places = runs(mark)
    if not places:
        return []
    many = len(places) > _ONE_BY_ONE
    groups = [slice(places[0].start, places[-1].stop)] if many else places
    found = []
    for where in groups:
        own = mark[where]
        count, lost = np.count_nonzero(own), np.count_nonzero(own & np.isnan(mended[where]))
        size, what = _words(channel, kind, where, own)
        done, argument = "interpolated", ""
        if lost:
            end = float(channel.t[min(where.stop, len(mark) - 1)])
            done = f"{lost} of {count} samples are left out, the others interpolated"
            done = f"left out; start after it at {end:.6g} s" if lost == count else done
            argument = f"start={end:.6g}"
        found.append(channel.defect(kind, f"{what}: {done}", where, size, argument))
    return found


def _words(channel: _Channel, kind: str, where: slice, own: Mask) -> tuple[float, str]:
    """Size of a defect, and what it is in words."""
    x = channel.x[where][own]
    if kind == "dropout":
        held = channel.number(float(x[0]))
        return float(x[0]), f"the sensor stands still at {held} while the motion goes on"
    if kind == "clipping":
        limit = float(x[np.argmax(np.abs(x))])
        count = counted(len(x), "sample", "samples")
        return limit, f"the sensor clips at {channel.number(limit)} ({count})"
    if kind == "spikes":
        size = float(np.max(np.abs(x - np.median(channel.x[np.isfinite(channel.x)]))))
        count = counted(len(runs(own)), "spike", "spikes")
        return size, f"{count} of up to {channel.number(size)}"
    return len(x) / len(channel.x), counted(len(x), "sample is missing", "samples are missing")


def _undisturbed(channel: _Channel, x: Array, cycle: float) -> tuple[Array, list[Defect]]:
    """Without level, drift and steady lines."""
    found, dt = [], float(channel.t[1] - channel.t[0])
    level, slow = level_and_drift(x, cycle)
    if np.any(slow):
        size = float(np.ptp(slow))
        what = f"the level drifts by {channel.number(size)}: removed"
        found.append(channel.defect("drift", what, size=size))
    if level:
        what = f"the level is off by {channel.number(level)}: removed"
        found.append(channel.defect("offset", what, size=level))
    if found:
        x = x - level - slow
    t = channel.t - channel.t[0]
    lines = steady_lines(x, dt)
    for line in lines:
        mains = line.mains
        what = (
            f"mains hum at {line.frequency:.5g} Hz"
            if mains
            else f"a steady tone at {line.frequency:.5g} Hz"
        )
        what += f", amplitude {channel.number(line.amplitude)}: subtracted"
        found.append(channel.defect("mains" if mains else "line", what, size=line.amplitude))
        x = x - line(t)
    if hidden := hidden_mains(lines):
        what = (
            f"the hum at {hidden:.5g} Hz itself is too near to the vibration to be told from it: it"
            " stays, and bends the backbone where it is not far smaller"
        )
        found.append(channel.defect("mains", what))
    stretch = max(runs(np.isfinite(x)), key=lambda run: run.stop - run.start)
    if stretch.stop - stretch.start < _TELLING or not np.any(x[stretch]):
        return x, found
    noise = NoiseLevel.of(x[stretch], dt)
    if noise.coloured and noise.rms > _NOISY * np.nanmax(np.abs(x)):
        what = (
            f"coloured noise of {channel.number(noise.rms)} rms, stronger the slower (power like"
            f" f^{noise.slope:.2g}): standard errors allow for it"
        )
        found.append(channel.defect("coloured noise", what, size=noise.rms))
    return x, found
