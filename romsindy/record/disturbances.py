"""What is added to a vibration and does not fade with it: offset, drift and steady lines.

Arrays are one channel (n,) with a uniform rate, NaN where a sample is missing.
Nothing here knows what was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_lsq_spline
from scipy.ndimage import minimum_filter1d, uniform_filter1d
from scipy.signal import periodogram

from romsindy.record.faults import filled
from romsindy.record.signals import MAINS, STRAY, Mask, moving_mean, vertex
from romsindy.record.spectrum import noise_std, round_about, standing_out
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
_PIECES, _STEADY, _MAINS_STEADY = 4, 0.05, 0.5
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
    midline = moving_mean(x, 2 * round(cycle) + 1)
    power = _power(x - midline, cycle)
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
    far = moved > least
    return bool(np.any(far & quiet[few:] & quiet[:-few]))


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
    for piece in np.array_split(x, _PIECES):
        window = np.hanning(len(piece))
        turn = np.exp(-2j * np.pi * dt * np.arange(len(piece)) * f)
        # Frequencies a few lines away show what the noise does to this one.
        near = np.array([-8, -6, -4, 0, 4, 6, 8]) / (len(piece) * dt)
        waves = np.exp(-2j * np.pi * dt * np.outer(near, np.arange(len(piece))))
        values = 2 * np.abs(waves @ (window * turn * piece)) / window.sum()
        values = np.maximum(values, np.finfo(float).tiny)
        size.append(values[3])
        scatter.append(np.median(np.delete(values, 3)) / values[3])
    change = abs(np.polyfit(np.arange(_PIECES), np.log(size), 1)[0]) * (_PIECES - 1)
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
