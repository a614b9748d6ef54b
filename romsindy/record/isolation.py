"""One vibration of a free decay by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfiltfilt

from romsindy.record.decay import QUANTITIES, SAMPLES_PER_CYCLE, Decay
from romsindy.record.ridges import Ridge
from romsindy.record.signals import downsample
from romsindy.record.vibrations import Vibration
from romsindy.typing import Array

# Below this part of its lowest frequency a velocity or an acceleration shows nothing of it.
_SLOW = 0.4
# An end is spoiled where a cycle differs from the smooth vibration by this many times what is
# usual, and by more than that part of its size. Fewer cycles are too few to say what is usual.
_SPOILED, _HARMLESS, _FEW_CYCLES, _MOST_SPOILED = 4.0, 0.005, 30, 5
_TERMS = 4  # of an integration by parts
_NAMES = ("q", "q_dot", "q_ddot")


def isolated(
    t: Array,
    x: Array,
    vibrations: Sequence[Vibration],
    number: int,
    unit: str | None = None,
    notes: tuple[str, ...] = (),
) -> Decay:
    """The free decay of one of several vibrations, with its harmonics.

    The others are subtracted as they were followed, so that neither the ends nor the harmonics of
    the one suffer, and the noise stays what it was. A record of many samples a cycle is decimated.

    Parameters
    ----------
    t : (n,) array
        Uniform times of the decay, s.
    x : (n,) array
        What was measured, free of offset and drift.
    vibrations : sequence of Vibration
        As `find_vibrations` found them in x.
    number : int
        Which of them, from 0.
    unit : str, optional
        SI unit of the displacement.
    notes : tuple of str
        What was done to the record before.

    Returns
    -------
    Decay
        Free, in the quantity that was measured.
    """
    own = vibrations[number]
    others = [v for i, v in enumerate(vibrations) if i != number]
    dt = float(t[1] - t[0])
    clock = t - t[0]
    alone = x - sum((v(clock) for v in others), np.zeros(len(x)))
    told = [v for v in others if not v.faint]
    if told:
        names = ", ".join(f"{v.mean_frequency:.4g} Hz" for v in told)
        notes = (*notes, f"vibration at {own.mean_frequency:.4g} Hz isolated; subtracted: {names}")
    alone, q, smooth = _with_displacement(alone, own, clock)
    kept = _unspoiled(q - smooth, smooth, dt, own) if others or own.derivative else slice(None)
    factor = int(1 / (SAMPLES_PER_CYCLE * dt * float(own.frequency.max())))
    t, alone, q = (x[kept] for x in (t, alone, q))
    if factor > 1:
        alone, q = downsample(alone, factor), downsample(q, factor)
        t = t[::factor]
        notes = (*notes, f"decimated by {factor}: {SAMPLES_PER_CYCLE} samples a cycle are enough")
    signals = {_NAMES[own.derivative]: alone, "q": q}
    return Decay(
        t, unit=unit, measured=QUANTITIES[own.derivative], notes=notes, stage="free", **signals
    )


def _unspoiled(rest: Array, smooth: Array, dt: float, own: Vibration) -> slice:
    """Samples between the ends at which more is left than elsewhere; a cycle at least goes."""
    cycle = max(round(1 / (own.mean_frequency * dt)), 1)
    n = len(rest) // cycle
    if n < _FEW_CYCLES:
        return slice(None)
    left, size = (
        np.sqrt(np.mean(x[: n * cycle].reshape(n, cycle) ** 2, axis=1)) for x in (rest, smooth)
    )
    part = left / np.maximum(size, 1e-9 * size.max())
    bad = part > max(_SPOILED * float(np.median(part)), _HARMLESS)
    most = max(min(n // 10, _MOST_SPOILED), 1)
    first, last = (next((i for i in range(1, most) if not b[i]), most) for b in (bad, bad[::-1]))
    return slice(first * cycle, len(rest) - last * cycle)


def _with_displacement(x: Array, own: Vibration, t: Array) -> tuple[Array, Array, Array]:
    """The measured signal without what is far below it, the displacement, and its smooth part.

    The vibration as it was followed is integrated tone by tone, which spoils no end; what it
    leaves of the signal is small, and loses what is slow before every integration.
    """
    if own.derivative == 0:
        return x, x, own(t)
    dt = float(t[1] - t[0])
    cutoff = _SLOW * float(own.frequency.min())
    slow = butter(2, cutoff, "highpass", fs=1 / dt, output="sos")
    rest = sosfiltfilt(slow, x - own(t))
    tones = [own.tone, *(tone for _, tone in own.harmonics)]
    q = sum((_integrated(tone, t, own.derivative) for tone in tones), np.zeros(len(t)))
    integral = rest
    for _ in range(own.derivative):
        integral = sosfiltfilt(slow, cumulative_trapezoid(integral, dx=dt, initial=0.0))
    return own(t) + rest, q + integral, q


def _integrated(tone: Ridge, t: Array, times: int) -> Array:
    """A tone integrated over time, so many times, without a constant.

    By parts: the integral of Z exp(i phase) is (Z / i rate) exp(i phase) less that of a function
    whose amplitude is the slope of Z / i rate, which is smaller by the damping ratio; four terms.
    """
    inside = tone.inside(t)
    clock, q = t[inside], np.zeros(len(t))
    phase, z = tone.phase(clock), tone.z(clock)
    rate = np.maximum(tone.phase(clock, 1), np.pi * tone.frequency.min())  # never near none
    for _ in range(times):
        part, z = z, np.zeros_like(z)
        for _term in range(_TERMS):
            part = part / (1j * rate)
            z = z + part
            part = -np.gradient(part, clock, edge_order=2)
    q[inside] = np.real(z * np.exp(1j * phase))
    return q
