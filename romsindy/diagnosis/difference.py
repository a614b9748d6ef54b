"""How a simulated decay differs from a measured one, in the terms of an engineer.

Both are demodulated cycle by cycle and compared at equal amplitude, so that neither the start nor a
phase that runs away hides what differs. The slopes of what the phase and the logarithm of the
amplitude differ by are the differences of frequency and damping. Their standard errors come from
the scatter of the cycles themselves, whatever the colour of the noise. A `Tolerance` says what of
them does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson
from scipy.interpolate import PchipInterpolator
from scipy.signal import savgol_filter
from scipy.stats import norm
from scipy.stats import t as student

from romsindy.fit.records.record import Record
from romsindy.fit.verdict import (
    LEAST_CYCLES,
    QUIET,
    SAME_DAMPING,
    SAME_FREQUENCY,
    SAME_SIGNAL,
    SURE,
    WIDEST_DAMPING,
    WIDEST_FREQUENCY,
    WIDEST_SIGNAL,
)
from romsindy.record.smoothing import Cycles, HarmonicSpline
from romsindy.typing import Array, Indices

KINDS = ("frequency", "damping", "signal")
WIDEST = dict(zip(KINDS, (WIDEST_FREQUENCY, WIDEST_DAMPING, WIDEST_SIGNAL), strict=True))
DEFAULT = "default"
_FAINT = 1e-3  # of the largest amplitude: below, nothing has any weight
_POINTS = 20


@dataclass(frozen=True)
class Tolerance:
    """How large a difference does not matter.

    Attributes
    ----------
    frequency : float
        Of the frequency at equal amplitude, relative.
    damping : float
        Of the damping ratio at equal amplitude, relative.
    signal : float
        Of the waveform: rms as a part of the largest amplitude.
    source : str
        Where it comes from: "default", or "stated", "repeats", "reference", "bands", joined by
        "and".
    sources : mapping of str to str
        Where each comes from by itself, where that is not the same for all.
    undetermined : tuple of (str, str, float)
        Kind, source and size of what was too wide, for records that do not determine it.
    bands : mapping of str to (2, n) array
        Of "frequency" and "damping": amplitudes, and what a model itself is known to there; see
        `over`.
    """

    frequency: float = SAME_FREQUENCY
    damping: float = SAME_DAMPING
    signal: float = SAME_SIGNAL
    source: str = DEFAULT
    sources: Mapping[str, str] = field(default_factory=dict, compare=False)
    undetermined: tuple[tuple[str, str, float], ...] = field(default=(), compare=False)
    bands: Mapping[str, Array] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name in KINDS:
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and 0 <= value < float("inf")):
                raise ValueError(
                    f"tolerance of {name} = {value!r} must be a relative size that is not negative,"
                    " such as 0.001"
                )

    @property
    def stated(self) -> bool:
        """Whether a user said it."""
        return "stated" in self.source.split(" and ")

    def source_of(self, kind: str) -> str:
        """Where the tolerance of "frequency", "damping" or "signal" comes from."""
        return self.sources.get(kind, self.source)

    def or_more(self, other: Tolerance) -> Tolerance:
        """The larger of each, with the sources of both unless one is but the default."""
        larger = {k: self if getattr(self, k) >= getattr(other, k) else other for k in KINDS}
        known = [x for x in dict.fromkeys((self.source, other.source)) if x != DEFAULT]
        return Tolerance(
            **{k: getattr(of, k) for k, of in larger.items()},
            source=" and ".join(known) or DEFAULT,
            sources={k: of.source_of(k) for k, of in larger.items()},
            undetermined=(*self.undetermined, *other.undetermined),
            bands={**self.bands, **other.bands},
        )

    def over(self, low: float, high: float) -> Tolerance:
        """The same for cycles of these amplitudes: more where a model is known less well.

        Louder cycles tell more about a frequency or a damping, in proportion to their power.
        """
        if not self.bands:
            return self
        ends = np.geomspace(max(low, _FAINT * high), high, _POINTS)
        a = np.sqrt(ends[1:] * ends[:-1])
        sizes = dict.fromkeys(KINDS, 0.0)
        for kind, (amplitude, size) in self.bands.items():
            sizes[kind] = float(np.average(np.interp(a, amplitude, size), weights=a**2))
        return replace(self, bands={}).or_more(Tolerance.read_off(sizes, "bands"))

    @classmethod
    def read_off(cls, sizes: Mapping[str, float], source: str) -> Tolerance:
        """What records differ by, no wider than those make it that determine what they tell."""
        narrow = {k: min(size, WIDEST[k]) for k, size in sizes.items()}
        wide = tuple((k, source, size) for k, size in sizes.items() if size > WIDEST[k])
        by_default = {k: DEFAULT for k, *_ in wide}
        return cls(**narrow, source=source, sources=by_default, undetermined=wide, bands={})


_LEAST = 4  # cycles that are compared
_SPAN = 6  # cycles of a part of a record, at least
_LOOKS = 8  # parts of a record that `SURE` is for
_BENT = 8  # from so many on, a difference may change steadily
_LOUD = 4.0  # amplitude over the error of that of a cycle, from which on a cycle counts
_SHARED = 0.03  # by how much the first cycle may be outside of the amplitudes of the simulation
_SAME_DECAY = 1e-5  # of the angular frequency: less damping is none
_MOST_ALIKE = 0.8  # of the errors of neighbours
_AMPLITUDE_CYCLES = 7


@dataclass(frozen=True)
class Difference:
    """One simulated signal beside one record, or beside a part of it.

    Attributes
    ----------
    amplitude : tuple of float
        From, to: unit of q.
    frequency, frequency_std : float
        Simulated over measured frequency at equal amplitude, less one; nan where the two share no
        amplitudes.
    damping, damping_std : float
        Simulated less measured damping ratio over the larger of the two.
    signal, signal_std : float
        Rms by which the waveform differs (mean, harmonics, hum) where phase and amplitude agree,
        without the part of the noise, over the largest amplitude; all that differs where the two
        share no amplitudes.
    noise : float
        Rms over the largest amplitude.
    parts : tuple of Difference
        Of the halves, quarters, down to 32nds of a record that is long enough.
    name : str
        Of the record.
    share : float
        Of the cycles of the record. A part of a record repeats to the root of its length less than
        all of it, and so much more is tolerated there.
    """

    amplitude: tuple[float, float]
    frequency: float
    frequency_std: float
    damping: float
    damping_std: float
    signal: float
    signal_std: float
    noise: float
    parts: tuple[Difference, ...] = ()
    name: str = ""
    share: float = 1.0

    @classmethod
    def of(cls, record: Record, simulated: Array, exact: bool = False) -> Difference:
        """Compare a simulated signal (n,) with the record that it stands for.

        Of what a record has beside its harmonics the lines count, or all if it is ``exact``,
        without noise.
        """
        said = _said(record.t, simulated)
        if said is None:
            return _apart(record, simulated)
        cycles, rest = said
        pair = _paired(record, cycles, _beside(record, rest, exact))
        return _apart(record, simulated) if pair is None else _of_parts(pair)

    @classmethod
    def between(cls, record: Record, other: Record) -> Difference:
        """Compare a record with a second one of the same test.

        Raises a ValueError if they share fewer than four cycles of the same amplitude.
        """
        said = Cycles.of(other.t, other.signal, np.asarray(other.spline.phase(other.t)))
        pair = _paired(record, said, lines=0.0)
        if pair is None:
            raise ValueError(
                f"decays of up to {record.amplitude:.3g} and {other.amplitude:.3g} share fewer than"
                f" {_LEAST} cycles of the same amplitude: release them alike, in the same unit"
            )
        return _of_parts(pair)

    @property
    def apart(self) -> bool:
        """Whether the two share hardly any cycles of the same amplitude."""
        return bool(np.isnan(self.frequency))

    def exceeds(self, tolerance: Tolerance) -> bool:
        """Whether it, or a part of it, is surely beyond a tolerance."""
        return self.largest(tolerance).excess(tolerance) > SURE

    def within(self, tolerance: Tolerance) -> bool:
        """Whether its values are within a tolerance, sure or not."""
        here = tolerance.over(*self.amplitude)
        return all(_size(getattr(self, kind)) <= getattr(here, kind) for kind in KINDS)

    def bound(self, kind: str) -> float:
        """How large a value may be, by its standard error; infinite where nothing tells."""
        return _size(getattr(self, kind)) + getattr(self, f"{kind}_std")

    def agrees(self, kind: str, tolerance: Tolerance) -> bool:
        """Whether a value is within a tolerance, as far as it may go by its standard error."""
        return self.bound(kind) <= getattr(tolerance.over(*self.amplitude), kind)

    def excess(self, tolerance: Tolerance) -> float:
        """By how many standard errors the worst of its values is beyond a tolerance."""
        return max(self.excess_of(kind, tolerance) for kind in KINDS)

    def excess_of(self, kind: str, tolerance: Tolerance) -> float:
        """The same of one of its values: "frequency", "damping" or "signal"."""
        value, std = getattr(self, kind), getattr(self, f"{kind}_std")
        if np.isnan(value):
            return -np.inf  # the signal says it
        beyond = abs(value) - getattr(tolerance.over(*self.amplitude), kind) / np.sqrt(self.share)
        return float(beyond / max(std, np.finfo(float).tiny))

    def largest(self, tolerance: Tolerance) -> Difference:
        """The part that is most surely beyond a tolerance; all of it where no part is more so."""
        return max((self, *self.parts), key=lambda d: d.excess(tolerance))

    def worst(self, tolerance: Tolerance) -> Difference:
        """The largest part of those that are surely beyond a tolerance, else `largest`."""
        sure = [d for d in (self, *self.parts) if d.excess(tolerance) > SURE]
        return max(sure, key=Difference._at_least, default=self.largest(tolerance))

    def _at_least(self) -> float:
        """What is sure of the largest of its values, over what is tolerated by default."""
        least = [abs(getattr(self, k)) - SURE * getattr(self, f"{k}_std") for k in KINDS]
        return float(np.nanmax(np.divide(least, [getattr(Tolerance(), k) for k in KINDS])))


def over_all(tolerance: Tolerance, differences: Sequence[Difference]) -> Tolerance:
    """A tolerance for the cycles of several differences together."""
    if not differences:
        return tolerance
    lows, highs = zip(*(d.amplitude for d in differences), strict=True)
    return tolerance.over(min(lows), max(highs))


def _size(value: float) -> float:
    return float("inf") if np.isnan(value) else abs(value)


class _Pair(NamedTuple):
    """Cycles of a record, and by how much those of the simulation differ at equal amplitude."""

    t: Array
    amplitude: Array  # unit of q
    weight: Array  # of angles and logarithms of amplitudes: the louder, the better known
    ahead: Array  # angle of the simulation less that of the record, rad
    louder: Array  # logarithm of simulated over measured amplitude
    omega: Array  # of the record, rad/s
    decay: Array  # rate of the simulation, 1/s
    waveform: Array  # simulated less measured: columns whose squares add up to a mean square
    wander: Array  # standard error of each column over one cycle
    lines: float  # power of what vibrates beside, over that of the largest amplitude
    noise: float


def _paired(record: Record, said: Cycles, lines: float) -> _Pair | None:
    """None where fewer than four cycles can be compared."""
    t = record.t
    true = Cycles.of(t, record.signal, np.asarray(record.spline.phase(t)))
    if min(len(said), len(true)) < _LEAST:
        return None
    peak = float(true.amplitude.max())
    per_cycle = len(t) / len(true)
    sizes, order = np.unique(said.amplitude, return_index=True)
    low, high = sizes[[0, -1]] * (1 - _SHARED, 1 + _SHARED)
    loud = true.amplitude > _LOUD * record.noise.std * np.sqrt(2 / per_cycle)
    shared = loud & (true.amplitude >= low) & (true.amplitude <= high) & _takes_part(record, true)
    if np.count_nonzero(shared) < _LEAST:
        return None
    # The noise of single cycles must not add up along the record.
    at = _smooth(true.amplitude)

    def said_at(values: Array) -> Array:
        return np.asarray(PchipInterpolator(sizes, values[order])(np.clip(at, *sizes[[0, -1]])))

    omega, decay = map(said_at, said.rates())
    both = min(said.waveform.shape[1], true.waveform.shape[1])
    apart = said_at(_columns(said.waveform[:, :both])) - _columns(true.waveform[:, :both])
    waveform = apart[shared] / peak
    wander = [_fitted(true.t[shared], x, np.ones(len(waveform)), 0)[1] for x in waveform.T]
    ahead = cumulative_simpson(omega, x=true.t, initial=0) - true.angle
    louder = -cumulative_simpson(decay, x=true.t, initial=0) - np.log(true.amplitude)
    return _Pair(
        true.t[shared],
        at[shared] / record.rate**record.derivative,
        true.amplitude[shared] / peak,
        ahead[shared],
        louder[shared],
        true.rates()[0][shared],
        decay[shared],
        waveform,
        np.sqrt(len(waveform)) * np.array(wander),
        lines / peak**2,
        record.noise.std / peak,
    )


def _takes_part(record: Record, cycles: Cycles) -> NDArray[np.bool_]:
    """Which cycles have windows that take part in a comparison as a whole."""
    if record.part is None:
        return np.ones(len(cycles), bool)
    count = np.concatenate([[0], np.cumsum(record.part)])
    window = 2 * np.pi / cycles.rates()[0]
    start, end = (np.searchsorted(record.t, cycles.t + s * 0.99 * window) for s in (-1, 1))
    return np.asarray(count[end] - count[start] == end - start)


def _columns(waveform: Array) -> Array:
    """Mean, cosines and sines (n, 2 h - 1), scaled: their squares add up to a mean square."""
    waves = waveform[:, 1:] / np.sqrt(2)
    return np.column_stack([waveform[:, 0].real, waves.real, waves.imag])


def _said(t: Array, x: Array) -> tuple[Cycles, Array] | None:
    """Cycles of a simulated signal, and what is beside its harmonics, (n,).

    None where it dies, or moves too little to have any.
    """
    if not (np.all(np.isfinite(x)) and np.ptp(x) > 0):
        return None
    end = int(np.flatnonzero(np.abs(x - x.mean()) > QUIET * np.ptp(x))[-1]) + 1
    if end < LEAST_CYCLES:
        return None
    try:
        spline = HarmonicSpline.fit(t[:end], x[:end])
    except ValueError:  # fewer than three cycles
        return None
    rest = np.zeros_like(x)
    rest[:end] = x[:end] - spline(t[:end])[0]
    return Cycles.of(t[:end], x[:end], np.asarray(spline.phase(t[:end]))), rest


def _beside(record: Record, rest: Array, exact: bool) -> float:
    """Power by which a record and a simulated signal differ beside their harmonics."""
    part = slice(None) if record.part is None else record.part
    if exact:  # the spline is that of what was measured
        said = _said(record.t, record.signal)
        return 0.0 if said is None else float(np.mean((said[1] - rest)[part] ** 2))
    own = record.signal - record.spline(record.t)[0]
    explained = float(np.mean((own**2 - (own - rest) ** 2)[part]))
    return max(sum(line.rms**2 for line in record.noise.lines) - explained, 0.0)


def _of_parts(pair: _Pair) -> Difference:
    n = len(pair.t)
    counts = [k for k in (2, 4, 8, 16, 32) if n >= k * (_SPAN if k <= _LOOKS else _BENT)]
    pieces = [(s, k) for k in counts for s in np.array_split(np.arange(n), k)]
    parts = tuple(replace(_difference(pair, p, k), share=len(p) / n) for p, k in pieces)
    return replace(_difference(pair, np.arange(n)), parts=parts)


def _difference(pair: _Pair, which: Indices, count: int = 1) -> Difference:
    """By some of the cycles: one of so many parts of a record."""
    t, weight = pair.t[which], pair.weight[which]
    omega = float(np.average(pair.omega[which], weights=weight**2))
    said = float(np.average(pair.decay[which], weights=weight**2))
    faster, faster_std = _fitted(t, pair.ahead[which], weight, 1, count)
    less, less_std = _fitted(t, pair.louder[which], weight, 1, count)
    scale = max(abs(said), abs(said + less), _SAME_DECAY * omega)
    frequency = faster / omega
    # The damping ratio is the decay rate over the frequency.
    damping = -less / scale - frequency
    values = np.array([_fitted(t, x, np.ones_like(t), 0) for x in pair.waveform[which].T])
    # Slow noise looks steady over a few cycles: all of the record tells how it wanders.
    noise_power = np.sum(np.maximum(values[:, 1], pair.wander / np.sqrt(len(t))) ** 2)
    power = np.sum(values[:, 0] ** 2) - noise_power + pair.lines
    amplitude = pair.amplitude[which]
    return Difference(
        (float(amplitude.min()), float(amplitude.max())),
        frequency,
        faster_std / omega,
        damping,
        float(np.hypot(less_std / scale, faster_std / omega)),
        float(np.sqrt(max(power, 0.0))),
        # Noise alone exceeds 3.5 halves of its rms as rarely as a normal error exceeds 3.5 of its
        # own: chi-square of seven values.
        float(np.sqrt(noise_power) / 2 * norm.isf(_chance(count)) / SURE),
        pair.noise,
    )


def _chance(count: int) -> float:
    """How likely one of ``count`` parts of a record may be beyond `SURE` errors: of many, less."""
    return float(norm.sf(SURE)) / max(count / _LOOKS, 1.0)


def _apart(record: Record, simulated: Array) -> Difference:
    """Of signals that share no amplitudes: all that differs."""
    # Friction may hold a simulation where it begins.
    peak = next((x for x in map(_peak, (record.signal, simulated)) if x > 0), 1.0)
    power = float(np.mean((record.signal - simulated) ** 2)) - record.noise.std**2
    power = power if np.isfinite(power) else np.inf
    amplitude = np.hypot(record.motion.q, record.motion.q_dot / record.rate)
    noise = record.noise.std / peak
    nan = float("nan")
    reach = float(amplitude.min()), float(amplitude.max())
    signal = float(np.sqrt(max(power, 0.0))) / peak
    error = noise / np.sqrt(len(record.t) / 2)
    return Difference(reach, nan, nan, nan, nan, signal, error, noise)


def _peak(x: Array) -> float:
    return float(np.abs(x).max())


def _fitted(
    t: Array, x: Array, weight: Array, derivative: int, count: int = 1
) -> tuple[float, float]:
    """Value or slope of x at the weighted mean of the times, and its standard error.

    A polynomial follows what changes steadily; the scatter about it, with neighbours that err
    alike, is the error: that of one of ``count`` parts of a record, see `_chance`.
    """
    degree = derivative + (1 if len(t) >= _BENT else 0)
    middle = np.average(t, weights=weight**2)
    scale = float(np.ptp(t))
    basis = np.vander((t - middle) / scale, degree + 1, increasing=True) * weight[:, None]
    inverse = np.linalg.pinv(basis)
    misfit = weight * x - basis @ (inverse @ (weight * x))
    freedom = len(t) - degree - 1
    row = inverse[derivative] / scale**derivative
    variance = misfit @ misfit / freedom * (row @ row)
    # Few cycles know their own scatter badly.
    widened = student.isf(_chance(count), freedom) / SURE
    alike = _alike(misfit, np.eye(len(t)) - basis @ inverse)
    return float(row @ (weight * x)), float(widened * np.sqrt(variance * (1 + alike) / (1 - alike)))


def _alike(misfit: Array, left: Array) -> float:
    """Correlation of neighbouring errors, beyond what a fit leaves of independent ones."""
    own = misfit @ misfit
    if not own > 0:
        return 0.0
    expected = np.trace(left, 1) / np.trace(left)
    return float(np.clip(misfit[1:] @ misfit[:-1] / own - expected, 0.0, _MOST_ALIKE))


def _smooth(amplitude: Array) -> Array:
    width = min(_AMPLITUDE_CYCLES, len(amplitude))
    return np.exp(savgol_filter(np.log(amplitude), width, min(2, width - 1)))
