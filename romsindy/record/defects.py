"""What is wrong with the samples of a recording, and what can be mended.

What is added to a vibration and does not fade with it: offset, drift and steady lines.

Arrays are one channel (n,) with a uniform rate, NaN where a sample is missing.
Nothing here knows what was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline, make_lsq_spline
from scipy.ndimage import minimum_filter1d, uniform_filter1d
from scipy.signal import periodogram

from romsindy.record.faults import clipped, dropouts, filled, resolution, restored, spikes, steps
from romsindy.record.recording import Recording, uniform_times
from romsindy.record.signals import MAINS, STRAY, Mask, level_of_few, moving_mean, runs, vertex
from romsindy.record.smoothing import swing
from romsindy.record.spectrum import NoiseLevel, noise_std, round_about, standing_out
from romsindy.text import counted
from romsindy.typing import Array, Indices

# Cycles for each value of a drift; a midline that moves faster belongs to the vibration.
_SLOW, _MOST_VALUES = 6.0, 16
# Samples of a cycle that a drift is fitted to.
_RATE = 16
# Of the amplitude at the time: where a drift reaches as much, and so often, it matters.
_MATTERS, _OFTEN = 0.05, 0.1
# What has less than so many times the power of the noise has come to rest; what had more than so
# many times as much a cycle before was stopped there.
_ALIVE, _STOPPED = 4.0, 16.0
# Cycles at either end that count less.
_TAPER = 4.0
# What has less than this part of the largest power is still, and what goes so far, in the largest
# amplitude, within so many cycles was moved by hand.
_STILL, _ELSEWHERE, _FEW = 0.01, 0.4, 2
# Times as far as it usually moves.
_SUDDEN = 4.0
# Of the amplitude: the vibration's own midline moves no further.
_OWN = 0.25
# Of what a level or a polynomial leaves: less is left where the slow motion is the vibration's.
_EXPLAINED = 0.3
# Degree of the drift beside which the vibration's own midline is sought.
_DEGREE = 4
# Pieces of the quieter half over which a line must keep its size, and the most that it may change,
# relative: mains are known beforehand, and may be as faint as the noise.
_ROUNDED_PIECES, _STEADY, _MAINS_STEADY = 4, 0.05, 0.5
# Most lines that are looked for in one channel.
_MOST = 24
# Of the rms of the later half: a line below does nothing.
_FAINT = 1e-3
_HARMONICS = 12  # of the mains that are looked for


def level_and_drift(x: Array, cycle: float) -> tuple[float, Array]:
    """Level of rest, and the slow drift about it; each 0 where it matters nowhere.

    Both are read off the slow part of the channel, to which quiet samples count most. An
    asymmetric vibration moves its own midline in proportion to amplitude^2, which is no drift.
    ``cycle`` in samples.
    """
    n, known, x = len(x), np.isfinite(x), filled(x)
    power = _power(x - moving_mean(x, 2 * round(cycle) + 1), cycle)
    loud = power.max()
    # Before the release there may be a hold, whose level is not that of rest.
    begin = min(int(np.argmax(power > loud / 4)) + round(cycle), n // 2)
    step = max(round(cycle / _RATE), 1)
    if moved_by_hand(x[begin:], power[begin:], cycle):
        return float(np.mean(x[n - max(round(cycle), 1) :])), np.zeros(n)
    here = np.arange(begin, n, step)
    here = here[minimum_filter1d(known, 2 * round(cycle) + 1)[here]]
    if len(here) < _RATE or not np.any(power[here]):
        return 0.0, np.zeros(n)  # hardly a cycle between holes
    if n - begin < _TAPER * cycle:
        return level_of_few(x[max(begin - round(cycle), 0) :], cycle), np.zeros(n)
    here, alive = _moving(here, power[here], noise_std(x) ** 2)
    if len(here) < _RATE:
        return 0.0, np.zeros(n)  # hardly a cycle before it comes to rest
    # The ends of a vibration, the loud one above all, would bend the spline: the taper.
    ends = np.clip(np.minimum(here - begin, here[-1] - here) / (_TAPER * cycle), 1e-3, 1)
    weight = np.sin(np.pi / 2 * ends) ** 2 / np.maximum(power[here], 1e-4 * loud)
    smooth = moving_mean(moving_mean(x, 2 * step - 1), 2 * step - 1)
    values = min(int((here[-1] - begin) / (_SLOW * cycle)), _MOST_VALUES)
    slow = _slow_part(here.astype(float), smooth[here], weight, values)
    slow = slow - _own_midline(here, slow, power[here], weight)
    level = float(np.average(slow[alive], weights=weight[alive]))
    # Where nothing vibrates, there is nothing to bend; a drift is no extrapolation.
    judged = alive & (ends > ends[alive].max() / 2)
    amplitude = np.where(judged, _MATTERS * np.sqrt(2 * power[here]), np.inf)
    matters = np.mean(np.abs(slow - level) > amplitude) > _OFTEN
    drift = np.interp(np.arange(n), here, slow - level) if matters else np.zeros(n)
    return (level if np.mean(abs(level) > amplitude) > _OFTEN else 0.0), drift


def _moving(here: Indices, power: Array, noise: float) -> tuple[Indices, Mask]:
    """Samples without those at rest where friction stopped it, and whether it vibrates there."""
    alive = power > _ALIVE * noise
    moving = minimum_filter1d(alive, 2 * _RATE + 1)  # windows that hold nothing of a rest
    if np.any(moving) and power[moving].min() > _STOPPED * noise:
        return here[moving], alive[moving]  # friction holds it anywhere
    return here, alive if np.any(alive) else np.ones(len(here), bool)


def moved_by_hand(x: Array, power: Array, cycle: float) -> bool:
    """Whether something that hardly vibrates is taken elsewhere within a few cycles.

    So a structure is displaced and held for another release. No sensor drifts as fast, and what
    is slow there is no drift that could be read off it. ``power`` is that of the vibration.
    """
    few = round(_FEW * cycle)
    if few < 1 or len(x) <= 2 * few:
        return False
    quiet = power < _STILL * power.max()
    midline = uniform_filter1d(x, max(round(cycle), 1))
    moved = np.abs(midline[few:] - midline[:-few])
    # What moves on as it always does is a drift, however steep.
    least = max(_ELSEWHERE * np.sqrt(2 * power.max()), _SUDDEN * float(np.median(moved)))
    return bool(np.any((moved > least) & quiet[few:] & quiet[:-few]))


def _own_midline(at: Indices, slow: Array, power: Array, weight: Array) -> Array:
    """The part of a slow motion that goes with amplitude^2; zeros where that explains little."""
    powers = np.polynomial.legendre.legvander(2 * (at - at[0]) / (at[-1] - at[0]) - 1, _DEGREE)
    root, own = np.sqrt(weight), power / power.max()
    most = _OWN * np.sqrt(2 * power.max())
    for drift in (powers[:, :1], powers):  # no drift at all, or one beside it
        left = []
        for columns in (drift, np.column_stack([drift, own])):
            fit = np.linalg.lstsq(columns * root[:, None], slow * root)[0]
            left.append(np.linalg.norm((slow - columns @ fit) * root))
        if left[1] < _EXPLAINED * left[0]:
            return float(np.clip(fit[-1], -most, most)) * own
    return np.zeros(len(at))


def _power(x: Array, cycle: float) -> Array:
    """Mean square over two cycles."""
    return np.maximum(uniform_filter1d(x**2, 2 * round(cycle) + 1), 0.0)  # sums are rounded


def _slow_part(t: Array, x: Array, weight: Array, values: int) -> Array:
    """Weighted least-squares spline of so many values."""
    degree = int(np.clip(values - 1, 0, 3))
    inner = np.quantile(t, np.linspace(0, 1, max(values - degree, 1) + 1))
    knots = np.concatenate([[t[0]] * degree, inner, [t[-1]] * degree])
    return make_lsq_spline(t, x, knots, k=degree, w=np.sqrt(weight))(t)


@dataclass(frozen=True)
class SteadyLine:
    """A tone that keeps frequency (Hz), amplitude (unit of x) and phase (rad at t = 0)."""

    frequency: float
    amplitude: float
    phase: float

    def __call__(self, t: Array) -> Array:
        return self.amplitude * np.cos(2 * np.pi * self.frequency * t + self.phase)

    @property
    def mains(self) -> float:
        """Fundamental frequency of the mains that it belongs to, 0 if none."""
        for f in MAINS:
            order = round(self.frequency / f)
            if 0 < order <= _HARMONICS and abs(self.frequency - order * f) < STRAY * order:
                return f
        return 0.0


def steady_lines(x: Array, dt: float) -> tuple[SteadyLine, ...]:
    """Lines that stay while the vibration decays, strongest first; t = 0 at the first sample.

    They are sought in the later half, where the vibration is quieter, and fitted to the whole
    channel by least squares, each sample weighed by the power round it.
    """
    known, x = np.isfinite(x), filled(x)
    half = len(x) // 2
    if np.mean(x[half:] ** 2) > 0.5 * np.mean(x[:half] ** 2):
        return ()  # what does not decay is full of steady lines
    t = dt * np.arange(len(x))
    # A smooth weight: one that knows the beat of vibration and line would favour their minima.
    power = _power(x, len(x) / 20)
    # A taper keeps the vibration out, which is far stronger at the end of the record.
    weight = known * np.hanning(len(x)) / np.maximum(power, 1e-12 * np.max(power))
    lines: dict[int, SteadyLine] = {}
    frequencies = [f for f in _candidates(x, dt) if _stays(x[half:], dt, f)]
    left = x.copy()
    for _ in range(2):  # strong lines disturb the fits of weak ones
        for i, f in enumerate(frequencies):
            if i in lines:
                left += lines[i](t)
            lines[i] = _fitted(left, t, weight, lines[i].frequency if i in lines else f)
            left -= lines[i](t)
    heard = [line for line in lines.values() if line.amplitude > _FAINT * np.std(x[half:])]
    return tuple(sorted(heard, key=lambda line: -line.amplitude))


def hidden_mains(lines: Sequence[SteadyLine]) -> float:
    """Fundamental, Hz, of mains whose harmonics are heard without it; 0 where there is none."""
    for f in MAINS:
        orders = {round(line.frequency / f): line.frequency for line in lines if line.mains == f}
        if len(orders) > 1 and 1 not in orders:
            return float(np.mean([frequency / order for order, frequency in orders.items()]))
    return 0.0


def _candidates(x: Array, dt: float) -> list[float]:
    """Frequencies of lines in the later half; not that of the vibration itself, strongest first."""
    half = len(x) // 2
    frequency, power = periodogram(x[half:], 1 / dt, window="hann")
    own = periodogram(x[:half], 1 / dt, window="hann")
    floor = np.maximum(round_about(power), 1e-12 * power.max())
    peaks = standing_out(power, floor, 3)
    peaks = peaks[np.argsort(-power[peaks])][:_MOST]
    peaks = peaks[peaks < len(power) - 4]  # a window mirrors the last lines into themselves
    peaks = peaks[np.abs(frequency[peaks] - own[0][np.argmax(own[1])]) > 4 * frequency[1]]
    tops = vertex(*(np.log(power[peaks + k]) for k in (-1, 0, 1)))
    return (frequency[peaks] + tops * frequency[1]).tolist()


def _stays(x: Array, dt: float, f: float) -> bool:
    """Whether a line keeps its size, as well as noise lets see; mains are known beforehand."""
    size, scatter = [], []
    for piece in np.array_split(x, _ROUNDED_PIECES):
        window = np.hanning(len(piece))
        turn = np.exp(-2j * np.pi * dt * np.arange(len(piece)) * f)
        # Frequencies a few lines away show what the noise does to this one.
        near = np.array([-8, -6, -4, 0, 4, 6, 8]) / (len(piece) * dt)
        waves = np.exp(-2j * np.pi * dt * np.outer(near, np.arange(len(piece))))
        values = 2 * np.abs(waves @ (window * turn * piece)) / window.sum()
        values = np.maximum(values, np.finfo(float).tiny)
        size.append(values[3])
        scatter.append(np.median(np.delete(values, 3)) / values[3])
    change = abs(np.polyfit(np.arange(_ROUNDED_PIECES), np.log(size), 1)[0]) * (_ROUNDED_PIECES - 1)
    if SteadyLine(f, 0.0, 0.0).mains:
        return bool(change < _MAINS_STEADY)
    error = float(np.sqrt(np.mean(np.square(scatter))))
    return bool(change < max(_STEADY, 3 * error) and error < _STEADY)


def _fitted(x: Array, t: Array, weight: Array, f: float) -> SteadyLine:
    """Frequency, amplitude and phase of a tone over many of its cycles (Gauss-Newton)."""
    late = t - np.average(t, weights=weight)
    for last in (False, False, False, True):
        turned = weight * x * np.exp(-2j * np.pi * f * t)
        size = 2 * np.sum(turned) / np.sum(weight)
        if not last:
            # A tone that is off by dw turns as 1 + i dw t.
            slope = 2 * np.sum(late * turned) / np.sum(weight * late**2)
            f += (slope / size).imag / (2 * np.pi)
    return SteadyLine(float(f), float(np.abs(size)), float(np.angle(size)))


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
