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
    if others:
        names = ", ".join(f"{v.mean_frequency:.4g} Hz" for v in others)
        notes = (*notes, f"vibration at {own.mean_frequency:.4g} Hz isolated; subtracted: {names}")
    alone, q = _with_displacement(alone, own, clock)
    factor = int(1 / (SAMPLES_PER_CYCLE * dt * float(own.frequency.max())))
    if factor > 1:
        alone, q = downsample(alone, factor), downsample(q, factor)
        t = t[::factor]
        notes = (*notes, f"decimated by {factor}: {SAMPLES_PER_CYCLE} samples a cycle are enough")
    signals = {_NAMES[own.derivative]: alone, "q": q}
    found = Decay(
        t, unit=unit, measured=QUANTITIES[own.derivative], notes=notes, stage="free", **signals
    )
    # What was taken off is least known at the ends.
    cycle = 1 / own.mean_frequency if others or own.derivative else 0.0
    return found.between(t[0] + cycle, t[-1] - cycle)


def _with_displacement(x: Array, own: Vibration, t: Array) -> tuple[Array, Array]:
    """The measured signal without what is far below its frequency, and the displacement.

    The vibration as it was followed is integrated tone by tone, which spoils no end; what it
    leaves of the signal is small, and loses what is slow before every integration.
    """
    if own.derivative == 0:
        return x, x
    dt = float(t[1] - t[0])
    cutoff = _SLOW * float(own.frequency.min())
    slow = butter(2, cutoff, "highpass", fs=1 / dt, output="sos")
    rest = sosfiltfilt(slow, x - own(t))
    tones = [own.tone, *(tone for _, tone in own.harmonics)]
    q = sum((_integrated(tone, t, own.derivative) for tone in tones), np.zeros(len(t)))
    integral = rest
    for _ in range(own.derivative):
        integral = sosfiltfilt(slow, cumulative_trapezoid(integral, dx=dt, initial=0.0))
    return own(t) + rest, q + integral


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
