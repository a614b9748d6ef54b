"""Ridges: tones whose frequency and amplitude drift, followed through a signal one by one.

The strongest tone of a time-frequency picture is followed both ways, fitted as a slowly varying
complex amplitude on a smooth phase, and taken off; the next one shows in what is left. Windows
hold a number of cycles, so that they are as short as a frequency allows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline, make_lsq_spline
from scipy.ndimage import maximum_filter1d
from scipy.signal import decimate

from romsindy.record.signals import vertex
from romsindy.record.smoothing import HarmonicSpline
from romsindy.record.spectrum import HARMONICS
from romsindy.typing import Array

# Cycles of a window: few where a record is short, more where it is long and neighbours are near.
_SHORTEST, _USUAL, _LONGEST = 3.0, 16.0, 48.0
_OVERLAP = 4  # steps in a window
# A ridge starts where it is this many times what lies round it, in amplitude (noise reaches that
# once in 1e8 lines of a spectrum), and ends for good below so many times.
_CLEAR, _LOST = 5.0, 3.0
# Of the largest amplitude of a ridge, and of the strongest ridge: 60 dB.
_FAINT = 1e-3
_MOST, _MOST_REFUSED = 12, 20
_NEARLY_ALL = 0.8
# Half-width of what belongs to a ridge, and of the search round its next frequency, in lines (1
# over the length of a window): a Hann window spreads a tone over two.
_BELONGS, _SEARCH = 1.6, 0.6
_BINS = 10  # of the search, to either side
# Cycles between knots of amplitudes: first, at the end, and where another ridge is near.
_KNOTS, _FINE_KNOTS, _COARSE_KNOTS = 6.0, 4.0, 24.0
_LEAST_CYCLES = 4.0  # of the lowest frequency
_FEWEST_SAMPLES = 24  # of an octave
_LOBE = 4  # lines over which a Hann window spreads a tone
_MEDIAN = 0.83  # of the amplitude of noise in a line of a spectrum, over its rms


@dataclass(frozen=True, eq=False)
class Track:
    """Where a tone was followed."""

    # (n,), of the windows: middle in s, Hz, unit of the signal
    t: Array
    frequency: Array
    amplitude: Array
    # Times between which it is seen, s
    start: float
    end: float

    def inside(self, t: Array) -> NDArray[np.bool_]:
        """Which times lie between its ends."""
        return np.asarray((t >= self.start) & (t <= self.end))


@dataclass(frozen=True, eq=False)
class Ridge(Track):
    """A tone Re Z(t) exp(i phase(t))."""

    phase: BSpline  # rad
    z: BSpline  # complex, unit of the signal

    def __call__(self, t: Array) -> Array:
        """The tone at times t; 0 beyond its ends."""
        inside = self.inside(t)
        x = np.zeros(len(t))
        x[inside] = np.real(self.z(t[inside]) * np.exp(1j * self.phase(t[inside])))
        return x

    def along(self, t: Array) -> tuple[Array, Array, Array]:
        """Total phase (rad), frequency (Hz) and amplitude (unit of the signal) at times t."""
        z = self.z(t)
        rate = self.phase(t, 1) + np.imag(self.z(t, 1) / np.where(z == 0, 1.0, z))
        return self.phase(t) + np.unwrap(np.angle(z)), rate / (2 * np.pi), np.abs(z)

    def later(self, seconds: float) -> Ridge:
        """The same with times from so long before."""
        phase, z = (BSpline(x.t + seconds, x.c, x.k) for x in (self.phase, self.z))
        ends = self.start + seconds, self.end + seconds
        return Ridge(self.t + seconds, self.frequency, self.amplitude, *ends, phase, z)

    def from_its_start(self) -> Ridge:
        """The same with what was fitted before the middle of the first window, too.

        A vibration that is damped fast is loudest there. Amplitudes are as they were fitted.
        """
        step = (self.end - self.start) / (len(self.t) + 3)
        count = max(int((self.t[0] - self.start) / step), 1)
        before = np.linspace(self.start, self.t[0], count + 1)[:-1]
        t = np.concatenate([before, self.t])
        first, degree = slice(7), min(2, len(self.t) // 3)  # it changes fastest there
        parabola = np.polynomial.Polynomial.fit(self.t[first], self.frequency[first], degree)
        frequency = np.concatenate([parabola(before), self.frequency])
        return replace(self, t=t, frequency=frequency, amplitude=np.abs(self.z(t)))


def find_ridges(x: Array, dt: float, progress: Callable[[str], None] | None = None) -> list[Ridge]:
    """Follow the tones of a signal ``x`` (n,), free of offset and drift, strongest first.

    Samples are ``dt`` s apart; ``progress`` is called with a line of text for every ridge.
    """
    n = len(x)
    duration, t = n * dt, dt * np.arange(n)
    rest, found, refused = np.array(x, float), list[Ridge](), list[Track]()
    while len(found) < _MOST and len(refused) < _MOST_REFUSED:
        levels = _levels(rest, dt, duration)
        seed = _seed(levels, [*found, *refused], duration)
        if seed is None or (found and seed[2] < _FAINT * found[0].amplitude.max()):
            break
        track = _followed(levels, seed[0], seed[1], duration)
        # Three windows apart, or nearly all of a short record: less may be chance.
        long = len(track.t) > 2 * _OVERLAP or track.end - track.start > _NEARLY_ALL * duration
        fitted = _fitted(track, _phase_of(track), rest, t, _KNOTS) if long else None
        if fitted is None:
            refused.append(track)
            continue
        fitted = _fitted(fitted, _settled(fitted, t, _KNOTS), rest, t, _KNOTS) or fitted
        # What the fits have left of each other would look like further tones. Phases stay: where
        # a tone is faint, two of them could come to follow the same one.
        found = refined([*found, fitted], x, dt, 1)
        rest = x - sum((r(t) for r in found), np.zeros(n))
        if progress is not None:
            progress(f"{fitted.frequency[-1]:.5g} Hz")
    return found


def only_ridge(x: Array, dt: float) -> list[Ridge]:
    """The one tone of a signal of few cycles, by its zero crossings; none where it has no three."""
    t = dt * np.arange(len(x))
    try:
        spline = HarmonicSpline.fit(t, x)
    except ValueError:
        return []  # no vibration
    found = spline.amplitudes
    if found.c.shape[1] < 2:
        return []  # hardly two samples a cycle
    z = BSpline(found.t, found.c[:, 1], found.k)
    turns = (spline.phase(t[-1]) - spline.phase(0.0)) / (2 * np.pi)
    at = np.linspace(0, t[-1], max(int(turns), 3) + 1)
    track = (at, spline.phase(at, 1) / (2 * np.pi), np.abs(z(at)))
    return [Ridge(*track, 0.0, float(t[-1]), spline.phase, z)]


def refined(ridges: Sequence[Ridge], x: Array, dt: float, sweeps: int = 4) -> list[Ridge]:
    """Ridges fitted anew, each to what the others leave of the signal."""
    t = dt * np.arange(len(x))
    found = list(ridges)
    rest = x - sum((r(t) for r in found), np.zeros(len(x)))
    for _ in range(sweeps):
        for i, ridge in enumerate(found):
            alone = rest + ridge(t)
            others = [r for r in found if r is not ridge]
            better = _fitted(ridge, ridge.phase, alone, t, _knots(ridge, others))
            found[i] = better or ridge
            rest = alone - found[i](t)
    return found


def window_cycles(frequency: float, duration: float) -> float:
    """Cycles of a window for a frequency (Hz) in a record (s)."""
    cycles = frequency * duration
    return max(float(np.clip(cycles / 5, _SHORTEST, _USUAL)), min(cycles / 60, _LONGEST))


# -- seeds --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Octave:
    """An octave of a signal: samples, their interval in s, and the band in Hz."""

    x: Array
    dt: float
    low: float
    high: float


def _levels(x: Array, dt: float, duration: float) -> list[_Octave]:
    found, high = [_Octave(x, dt, 0.225 / dt, 0.45 / dt)], 0.225 / dt
    while high > _LEAST_CYCLES / duration and len(x) > _FEWEST_SAMPLES:
        found.append(_Octave(x, dt, high / 2, high))
        x, dt, high = decimate(x, 2, ftype="fir", zero_phase=True), 2 * dt, high / 2
    return found


def _seed(
    levels: Sequence[_Octave], known: Sequence[Track], duration: float
) -> tuple[float, float, float] | None:
    """Time, frequency and amplitude of the strongest tone that belongs to no ridge yet."""
    best, strongest = None, 0.0
    for t, f, amplitude, clear in (p for level in levels for p in _picture(level, duration)):
        for ridge in known:
            at = np.interp(t, ridge.t, ridge.frequency)
            line = at / window_cycles(float(at.mean()), duration)
            near = np.abs(f - at[:, None]) < _BELONGS * line[:, None]
            inside = (t > ridge.start - 1 / line) & (t < ridge.end + 1 / line)
            clear &= ~(near & inside[:, None])
        # Low tones first: their windows are long, and what is left of them reaches far.
        weight = np.where(clear, amplitude / np.sqrt(f), 0.0)
        i, j = np.unravel_index(int(np.argmax(weight)), weight.shape)
        if weight[i, j] > strongest:
            strongest = float(weight[i, j])
            best = float(t[i]), float(f[j]), float(amplitude[i, j])
    return best


def _picture(
    level: _Octave, duration: float
) -> Iterator[tuple[Array, Array, Array, NDArray[np.bool_]]]:
    """Times, frequencies, amplitudes (n_t, n_f) of an octave, and which of them stand out."""
    middle = np.sqrt(level.low * level.high)
    size = int(window_cycles(middle, duration) / middle / level.dt)
    if not 8 <= size < len(level.x):
        return
    window = np.hanning(size)
    step = max(size // _OVERLAP, 1)
    pieces = np.lib.stride_tricks.sliding_window_view(level.x, size)[::step]
    fine = 2 ** int(np.ceil(np.log2(2 * size)))
    f = np.fft.rfftfreq(fine, level.dt)
    t = (np.arange(len(pieces)) * step + (size - 1) / 2) * level.dt
    amplitude = np.abs(np.fft.rfft(pieces * window, fine, axis=1)) * (2 / window.sum())
    near = (f > level.low / 1.6) & (f < min(1.6 * level.high, 0.49 / level.dt))
    # A tone of few cycles a window fills most of its octave: then the lower bins are the noise.
    line = round(fine / size)
    share = 0.5 if np.count_nonzero(near) > 2 * _LOBE * line else 0.25
    noise = np.quantile(amplitude[:, near], share, axis=1) / np.sqrt(-np.log(1 - share))
    own = (f >= max(level.low, _LEAST_CYCLES / duration)) & (f < level.high)
    if np.any(own):
        # A tone is a peak: what only rises towards slow frequencies is drift.
        peak = amplitude >= maximum_filter1d(amplitude, 2 * line + 1, axis=1)
        clear = peak & (amplitude > _CLEAR * noise[:, None])
        yield t, f[own], amplitude[:, own], clear[:, own]


# -- following ----------------------------------------------------------------------------------


def _followed(levels: Sequence[_Octave], t: float, f: float, duration: float) -> Track:
    first = _look(levels, t, f, duration)
    points = np.array(
        [
            *_one_way(levels, -1, first, duration)[::-1],
            first[:3],
            *_one_way(levels, 1, first, duration),
        ]
    )
    times, frequency, amplitude = points[np.unique(points[:, 0], return_index=True)[1]].T
    # Half a window beyond the first and the last; a whole one where the record ends there.
    half = [window_cycles(x, duration) / 2 / x for x in (frequency[0], frequency[-1])]
    start = 0.0 if times[0] < 1.5 * half[0] else float(times[0] - half[0])
    last = duration - times[-1] < 1.5 * half[1]
    end = duration if last else float(times[-1] + half[1])
    return Track(times, frequency, amplitude, start, end)


def _one_way(
    levels: Sequence[_Octave],
    direction: int,
    first: tuple[float, float, float, bool],
    duration: float,
) -> list[tuple[float, float, float]]:
    t, f, top, _ = first
    slope, lost, points = 0.0, 0, []
    while lost < 3:
        window = window_cycles(f, duration) / f
        t += direction * window / _OVERLAP
        if not 0.45 * window < t < duration - 0.45 * window:
            break
        # A little less than straight on: a slope that is wrong leads away.
        at, frequency, amplitude, clear = _look(levels, t, f + 0.7 * slope, duration)
        if clear and amplitude > _FAINT * top:
            slope, f, top, lost = frequency - f, frequency, max(top, amplitude), 0
            points.append((at, f, amplitude))
        else:
            lost += 1
    return points


def _look(
    levels: Sequence[_Octave], t: float, f: float, duration: float
) -> tuple[float, float, float, bool]:
    """Time, frequency and amplitude of the tone near f, and whether it stands out there."""
    level = next((v for v in levels[::-1] if v.high > 1.5 * f), levels[0])
    line = f / window_cycles(f, duration)
    size = min(round(1 / line / level.dt), len(level.x))
    first = int(np.clip(round(t / level.dt - (size - 1) / 2), 0, len(level.x) - size))
    window = np.hanning(size)
    k = np.arange(size) * level.dt
    near = f + line * np.linspace(-_SEARCH, _SEARCH, 2 * _BINS + 1)
    round_it = f + line * np.concatenate([np.linspace(-8, -2.5, 12), np.linspace(2.5, 8, 12)])
    round_it = round_it[(round_it > line) & (round_it < 0.49 / level.dt)]
    waves = np.exp(-2j * np.pi * np.outer(np.concatenate([near, round_it]), k))
    size_of = np.abs(waves @ (window * level.x[first : first + size])) * (2 / window.sum())
    peak = int(np.argmax(size_of[: len(near)]))
    noise = np.median(size_of[len(near) :]) / _MEDIAN if len(round_it) > 4 else 0.0
    inner = 0 < peak < 2 * _BINS
    clear = inner and bool(size_of[peak] > _LOST * noise)
    at = first * level.dt + (size - 1) / 2 * level.dt
    top = np.log(np.maximum(size_of[peak - 1 : peak + 2], 1e-300))
    shift = float(vertex(*top)) if inner else 0.0
    return at, float(near[peak] + shift * (near[1] - near[0])), float(size_of[peak]), clear


# -- fitting ------------------------------------------------------------------------------------


def _fitted(track: Track, phase: BSpline, x: Array, t: Array, cycles: float) -> Ridge | None:
    """A ridge with its amplitude fitted to a signal; None if it has too few samples."""
    inside = track.inside(t)
    found = HarmonicSpline.along(phase, t[inside], x[inside], cycles, 1).amplitudes
    if found.c.shape[1] < 2:
        return None
    z = BSpline(found.t, found.c[:, 1], found.k)
    return Ridge(track.t, track.frequency, track.amplitude, track.start, track.end, phase, z)


def _settled(ridge: Ridge, t: Array, cycles: float) -> BSpline:
    """Its phase with what turns the amplitude: then the amplitude is smooth."""
    t = t[ridge.inside(t)]
    total, _, size = ridge.along(t)
    n_knots = max(2, int((total[-1] - total[0]) / (2 * np.pi) / cycles / 2))
    inner = np.linspace(t[0], t[-1], n_knots + 1)[1:-1]
    knots = np.concatenate([[t[0]] * 4, inner, [t[-1]] * 4])
    return make_lsq_spline(t, total, knots, k=3, w=size / size.max() + 1e-6)


def _phase_of(track: Track) -> BSpline:
    """Integral of the frequencies that were followed, straight on beyond the first and last."""
    t, f = track.t, track.frequency
    ends = [track.start - 1e-6, track.end + 1e-6]
    values = [
        np.polynomial.Polynomial.fit(t[s], f[s], min(1, len(t) - 1))(end)
        for s, end in ((slice(4), ends[0]), (slice(-4, None), ends[1]))
    ]
    spline = make_interp_spline(
        np.concatenate([ends[:1], t, ends[1:]]), np.concatenate([values[:1], f, values[1:]]), k=1
    ).antiderivative()
    return BSpline(spline.t, 2 * np.pi * spline.c, spline.k)


def _knots(ridge: Ridge, others: Sequence[Ridge]) -> float:
    """Cycles between knots: so many that the amplitude does not follow a neighbour's beat.

    Neighbours are other tones and, of lower ones, their harmonics, which may be too faint for
    ridges of their own. A tone that decays fast has no more than a knot in every e-fold.
    """
    f = float(np.median(ridge.frequency))
    near = [
        abs(n * float(np.median(o.frequency)) / f - 1)
        for o in others
        for n in range(1, HARMONICS + 1)
    ]
    fold = np.log(max(ridge.amplitude.max() / max(ridge.amplitude[-1], 1e-300), np.e))
    most = np.clip(f * (ridge.end - ridge.start) / fold, _FINE_KNOTS, _COARSE_KNOTS)
    return float(np.clip(1.5 / max(min(near, default=1.0), 1e-3), _FINE_KNOTS, most))
