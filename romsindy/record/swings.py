"""Swings of one stretch of a record: where they become free, and whether they decay.

Arrays are one channel (n,); ``period`` is that of the slowest vibration, in samples, ``noise`` the
standard deviation of white noise.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from romsindy.record.faults import runs
from romsindy.record.prediction import unpredicted
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


def rest_of(x: Array) -> float:
    """About where a vibration comes to rest: the mean of its later half, tapered."""
    later = x[len(x) // 2 :]
    return float(np.average(later, weights=np.hanning(len(later) + 2)[1:-1]))


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
    size = np.maximum.reduceat(amplitude, np.arange(0, len(amplitude), step))
    later = np.maximum.accumulate(size[::-1])[::-1]
    floor = max(noise, NOTHING * float(size.max()), np.finfo(float).tiny)
    low = int(np.argmax(later / np.maximum(size, floor)))
    high = low + int(np.argmax(size[low:]))
    higher_before = np.flatnonzero(size[:low] >= size[high])
    if size[high] < max(_AGAIN * size[low], 2 * LOUD * noise) or not len(higher_before):
        return None
    fall, rise = low - int(higher_before[-1]), high - low
    return low * step if rise < _FASTER * fall else None


def refusal(t: Array, swing: Array, amplitude: Array, start: int, period: float) -> str | None:
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
            f" {after // 2} after it: the record grows, so it is forced or not a free decay"
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
        return f"the amplitude grows by {np.expm1(growth):.0%}: it is forced or not a free decay"
    return None


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
