"""One vibration of a free decay by itself, and channels weighed so that it stands out best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfiltfilt

from romsindy.record.decay import Decay
from romsindy.record.recording import QUANTITIES
from romsindy.record.ridges import Ridge
from romsindy.record.signals import downsample
from romsindy.record.smoothing import HarmonicSpline
from romsindy.record.spectrum import HARMONICS, noise_std
from romsindy.record.vibrations import Vibration, decimation
from romsindy.typing import Array

_CYCLES = 12.0  # between knots: wide, so that other vibrations do not count
# Amplitudes of one vibration in two channels have a ratio that is constant and real: so much of
# their product must agree, and so much of it must be in phase. Else they are of different things.
_COHERENT, _IN_PHASE = 0.98, 0.95


def together(t: Array, x: Array, main: int, tone: Ridge) -> tuple[Array, Array]:
    """Channels ``x`` (n, m) as one (n,), weighed by the shape of a vibration and by their noise.

    Times ``t`` count from the start of the release, s; ``tone`` was followed in channel ``main``,
    to which the sum is scaled. The shape (m,) is the amplitude of the vibration in each channel
    over that in the main one; 0 where it was left out because it does not go with that.
    """
    inside = tone.inside(t)
    z = [_amplitude(t[inside], channel[inside], tone) for channel in x.T]
    own = float(np.vdot(z[main], z[main]).real)
    shape = np.zeros(len(z))
    for i, other in enumerate(z):
        product, size = np.vdot(z[main], other), float(np.vdot(other, other).real)
        coherent = abs(product) ** 2 > _COHERENT * own * size
        if coherent and abs(product.real) > _IN_PHASE * abs(product):
            shape[i] = product.real / own
    weight = shape / np.array([noise_std(channel) for channel in x.T]) ** 2
    return x @ (weight / (weight @ shape)), shape


def _amplitude(t: Array, x: Array, tone: Ridge) -> Array:
    """Complex amplitude of a tone in a signal, along its phase."""
    return HarmonicSpline.along(tone.phase, t, x, _CYCLES, 1).amplitudes(t)[:, 1]


# Below this part of its lowest frequency a velocity or an acceleration shows nothing of it.
_SLOW = 0.7
# Half of a band round the frequencies of another vibration, and the widest band, as ratios.
_STOP, _WIDEST = 0.03, 1.4
_SHARED = (
    "where others ring, harmonics of it were taken off with them: {}; what shows there, as"
    " asymmetry does at harmonic 2, is not known"
)
# An end is spoiled where a cycle differs from the smooth vibration by this many times what is
# usual, and by more than that part of its size: of the displacement, and of the measured signal.
# Fewer cycles are too few to say what is usual.
_SPOILED, _HARMLESS, _LOUD = 4.0, 0.005, 0.5
_FEW_CYCLES, _MOST_SPOILED = 30, 5
# Samples a cycle of what is returned: six harmonics, and noise beyond them.
ENOUGH_SAMPLES = 20
_TERMS = 2  # of an integration by parts
_NAMES = ("q", "q_dot", "q_ddot")


def isolated(
    t: Array,
    x: Array,
    vibrations: Sequence[Vibration],
    number: int,
    unit: str | None = None,
    notes: tuple[str, ...] = (),
) -> Decay:
    """The free decay of one of several vibrations, with its harmonics, in the quantity measured.

    The others are subtracted as they were followed, so that neither the ends nor the harmonics of
    the one suffer, and the noise stays what it was. A record of many samples a cycle is decimated.

    ``x`` (n,) is free of offset and drift, at uniform times ``t``, s; ``vibrations`` are those that
    `find_vibrations` found in it, ``number`` counts them from 0. ``unit`` is that of the
    displacement, ``notes`` say what was done before.
    """
    own = vibrations[number]
    others = [v for i, v in enumerate(vibrations) if i != number]
    others += [v for _, v in own.carried]
    enough = 1 / (ENOUGH_SAMPLES * float(t[1] - t[0]) * float(own.frequency.max()))
    coarse = max(min(decimation(x, float(t[1] - t[0])), int(enough)), 1)
    x, t = downsample(x, coarse), t[::coarse]
    dt, clock = float(t[1] - t[0]), t - t[0]
    alone: Array = x - sum((v(clock) for v in others), np.zeros(len(x)))
    told = [v for v in others if not v.faint]
    if told:
        names = ", ".join(f"{v.mean_frequency:.4g} Hz" for v in told)
        notes = (*notes, f"vibration at {own.mean_frequency:.4g} Hz isolated; subtracted: {names}")
    alone, shared = _without_bands(alone, own, others, clock)
    if shared:
        notes = (*notes, _SHARED.format(", ".join(shared)))
    alone, q, smooth = _with_displacement(alone, own, clock)
    factor = max(int(enough / coarse), 1)
    alone, q, smooth, tone = (downsample(x, factor) for x in (alone, q, smooth, own(clock)))
    rest: Array = alone - tone
    t = t[::factor]
    if others or own.derivative:
        spoiled = _spoiled(q - smooth, smooth, dt * factor, own, _HARMLESS)
        spoiled |= _spoiled(rest, tone, dt * factor, own, _LOUD)
        kept = _between(spoiled, len(t), dt * factor, own)
        t, alone, q, rest = (x[kept] for x in (t, alone, q, rest))
    # Steady noise is in all of its spectrum; what is more than that others have left.
    leftover = np.sqrt(max(float(np.mean(rest**2)) - noise_std(rest) ** 2, 0.0)) if told else 0.0
    if told:
        part = 100 * leftover / float(np.abs(alone).max())
        notes = (
            *notes,
            f"what they leave, {part:.2g} % of the largest sample in the rms, is noise",
        )
    if factor * coarse > 1:
        notes = (*notes, f"decimated by {factor * coarse}: that is fast enough for it")
    signals = {_NAMES[own.derivative]: alone, "q": q}
    return Decay(
        t,
        unit=unit,
        measured=QUANTITIES[own.derivative],
        notes=notes,
        stage="free",
        leftover=float(leftover),
        **signals,
    )


def _without_bands(
    x: Array, own: Vibration, others: Sequence[Vibration], t: Array
) -> tuple[Array, list[str]]:
    """Without what other vibrations have left near their frequencies.

    Harmonics of the vibration that lie there go too: number and frequency of these, in words.
    """
    smooth, dt = own(t), float(t[1] - t[0])
    rest: Array = x - smooth
    shared: list[str] = []
    for v in others:
        low, high = (1 - _STOP) * v.frequency.min(), (1 + _STOP) * v.frequency.max()
        wide = high > _WIDEST * low or high > 0.45 / dt
        near = low < own.frequency.max() * (1 + _STOP) and high > own.frequency.min() * (1 - _STOP)
        if v.faint or wide or near:
            continue
        rest = _filtered(rest, (low, high), "bandstop", dt)
        mine = own.mean_frequency * np.arange(2, HARMONICS + 1)
        inside = [n for n, f in enumerate(mine, 2) if low < f < high]
        shared += [f"harmonic {n} ({v.mean_frequency:.4g} Hz)" for n in inside]
    return smooth + rest, shared


def _filtered(x: Array, band: float | tuple[float, float], kind: str, dt: float) -> Array:
    """Zero-phase Butterworth filter of the third order; frequencies in Hz."""
    return np.asarray(sosfiltfilt(butter(3, band, kind, fs=1 / dt, output="sos"), x), float)


def _spoiled(
    rest: Array, smooth: Array, dt: float, own: Vibration, harmless: float
) -> NDArray[np.bool_]:
    """Cycles in which more is left than in others, and more than a harmless part of it."""
    cycle = _cycle(own, dt)
    n = len(rest) // cycle
    left, size = (
        np.sqrt(np.mean(x[: n * cycle].reshape(n, cycle) ** 2, axis=1)) for x in (rest, smooth)
    )
    part = left / np.maximum(size, 1e-9 * size.max())
    return np.asarray(part > max(_SPOILED * float(np.median(part)), harmless))


def _between(spoiled: NDArray[np.bool_], n: int, dt: float, own: Vibration) -> slice:
    """Samples, of n, between spoiled cycles at the ends; a cycle at least goes."""
    if len(spoiled) < _FEW_CYCLES:
        return slice(None)
    most = max(min(len(spoiled) // 10, _MOST_SPOILED), 1)
    ends = spoiled, spoiled[::-1]
    first, last = (next((i for i in range(1, most) if not b[i]), most) for b in ends)
    return slice(first * _cycle(own, dt), n - last * _cycle(own, dt))


def _cycle(own: Vibration, dt: float) -> int:
    """Samples of a mean cycle."""
    return max(round(1 / (own.mean_frequency * dt)), 1)


def _with_displacement(x: Array, own: Vibration, t: Array) -> tuple[Array, Array, Array]:
    """The measured signal without what is far below it, the displacement, and its smooth part.

    The vibration as it was followed is integrated tone by tone, which spoils no end; what it
    leaves of the signal is small, and loses what is slow before every integration.
    """
    if own.derivative == 0:
        return x, x, own(t)
    dt, slow = float(t[1] - t[0]), _SLOW * float(own.frequency.min())
    rest = _filtered(x - own(t), slow, "highpass", dt)
    tones = [own.tone, *(tone for _, tone in own.harmonics)]
    q: Array = sum((_integrated(tone, t, own.derivative) for tone in tones), np.zeros(len(t)))
    integral: Array = rest
    for _ in range(own.derivative):
        integral = _filtered(
            cumulative_trapezoid(integral, dx=dt, initial=0.0), slow, "highpass", dt
        )
    return own(t) + rest, q + integral, q


def _integrated(tone: Ridge, t: Array, times: int) -> Array:
    """A tone integrated over time, so many times, without a constant.

    By parts: the integral of Z exp(i phase) is (Z / i rate) exp(i phase) less that of a function
    whose amplitude is the slope of Z / i rate, which is smaller by the damping ratio. Two terms are
    off by its square.
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
