"""Steady lines that may be something else that vibrates, or hum."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.fft import next_fast_len

from romsindy.effects.outside import HIGHEST
from romsindy.record.signals import vertex
from romsindy.record.spectrum import Line
from romsindy.typing import Array

# Of a comb of lines: which may be its first harmonics, and combs to be tried.
_STRONGEST, _COMBS = 3, 2
# Points of a spectrum for each line of its own.
_FINE = 8


def strongest_tones(t: Array, x: Array, count: int, apart: float) -> list[float]:
    """Angular frequencies of the strongest lines of a signal, rad/s.

    Parameters
    ----------
    t : array
        Uniform times, s.
    x : (n,) array
        Tapered.
    count : int
    apart : float
        Least distance of two lines, rad/s.
    """
    n = 8 * len(x)
    step = 2 * np.pi / (n * (t[1] - t[0]))
    power = np.abs(np.fft.rfft(x, n)) ** 2
    power[: 8 * 2] = power[-1] = 0.0  # two cycles a record at least
    found = []
    for _ in range(count):
        k = int(np.argmax(power))
        if not 0 < k < len(power) - 1 or power[k] <= 0:
            break
        top = vertex(*np.log(power[k - 1 : k + 2] + 1e-300))
        found.append(float(step * (k + np.clip(top, -1, 1))))
        width = max(int(apart / step), 16)
        power[max(k - width, 0) : k + width] = 0.0
    return found


def combs(lines: Sequence[Line], t: Array) -> tuple[tuple[float, int], ...]:
    """Lines that are harmonics of one frequency: that in rad/s, and the number of the highest.

    They may come from several records, none of which need show them all. Any of the strongest may
    be the first, second or third harmonic, whichever leaves fewest alone. Some are too weak to be
    seen, or lie beside a harmonic of the vibration: each comb is there up to the highest as well,
    and where no lines fit together, the strongest is the first or the second of one.
    """
    width = 1 / (t[-1] - t[0])  # Hz, of a line
    different: list[Line] = []
    for line in sorted(lines, key=lambda line: -line.rms):
        if all(abs(line.frequency - other.frequency) > 2 * width for other in different):
            different.append(line)
    found: dict[tuple[int, ...], tuple[float, int]] = {}
    for line, number in itertools.product(different[:_STRONGEST], (1, 2, 3)):
        first = line.frequency / number
        order = np.array([other.frequency / first for other in different])
        nearest = np.round(order)
        at = (np.abs(order - nearest) * first < (1 + nearest / number) * width) & (nearest > 0)
        at &= nearest <= HIGHEST
        if np.count_nonzero(at) > 1:
            members = tuple(map(int, np.flatnonzero(at)))
            found.setdefault(members, (2 * np.pi * first, int(nearest[at].max())))
    whole = [m for m in found if not any(set(m) < set(other) for other in found)]
    seen = [found[m] for m in sorted(whole, key=len, reverse=True)[:_COMBS]]
    alone = [2 * np.pi * different[0].frequency / k for k in (1, 2)] if different else []
    fastest = np.pi / (t[1] - t[0])
    guessed = [
        (first, min(HIGHEST, int(fastest / first)))
        for first in ([first for first, _ in seen] or alone)
    ]
    return tuple(dict.fromkeys((*seen, *(comb for comb in guessed if comb[1] > 1))))


def tuned(comb: tuple[float, int], signals: Sequence[tuple[Array, Array]]) -> tuple[float, int]:
    """A comb with the frequency, within a line's width, at which it holds most of some signals.

    Its highest harmonic must keep step over the whole of a record, or nothing of it is found.
    ``signals`` are uniform times (s) and values of each record, without its vibration.
    """
    first, highest = comb[0] / (2 * np.pi), comb[1]
    spans = [float(t[-1] - t[0]) for t, _ in signals]
    fine = 1 / (_FINE * highest * max(spans))
    tried = first + np.arange(-1 / min(spans), 1 / min(spans), fine)
    power = np.zeros(len(tried))
    for t, x in signals:
        n = next_fast_len(_FINE * len(x), real=True)
        spectrum = np.abs(np.fft.rfft(x * np.hanning(len(x)), n)) ** 2
        lines = np.fft.rfftfreq(n, t[1] - t[0])
        for k in range(1, highest + 1):
            power += np.interp(k * tried, lines, spectrum, right=0.0)
    return 2 * np.pi * float(tried[np.argmax(power)]), highest
