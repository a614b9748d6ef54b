"""The vibrations that ring in a free decay: modes, their harmonics, and steady tones."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfiltfilt, welch

from romsindy.record.decay import Decay
from romsindy.record.recording import QUANTITIES
from romsindy.record.ridges import Ridge, find_ridges, only_ridge, refined
from romsindy.record.signals import downsample
from romsindy.record.smoothing import HarmonicSpline
from romsindy.record.spectrum import HARMONICS, noise_std
from romsindy.typing import Array

# Of the energy of the signal: weaker tones are noise, and those below the second are not told.
_LEAST_SHARE, _TOLD = 2e-4, 1e-3
# Of two that move about as much, up to this factor in energy, the lower one is the dominant.
_AS_MUCH = 3.0
# What lies this near to a ridge with so many times its energy is what its fit has left.
_RESIDUE_NEAR, _RESIDUE_WEAKER = 0.2, 50.0
# A tone stays where it is this loud at its end, and the last sixth of its windows is as loud as the
# one before, over so many cycles.
_LOUD, _STAYS, _MANY = 0.1, 0.99, 20
# Cycles that a tone rings, of an exponential 1 / (2 pi zeta): fewer are a
# transient. The strongest tone may be as short.
_FLEETING = 4.0
# A harmonic follows n times the phase: within so many radians in the rms, n times the lesser at
# most, and so much of its frequency, over so many cycles at least. Its amplitude follows a power of
# the fundamental's, n to n + 2 where both are small, 1 where a stop or friction makes it. Over
# fewer cycles nothing but the ratio can tell, and roughly. Where the spring hardens much, a
# harmonic may grow as the fundamental falls; then the sweep tells: a mode keeps near its own
# frequency, so that which follows by more than this (rms, relative), for so much of its energy, is
# a harmonic, whatever its amplitude does; it is not taken for one that the motion made.
_HARMONICS, _HARMONIC_NEAR, _LOCKED, _TURNED, _LEAST_POWER = 12, 0.03, 0.7, 0.12, 0.5
_CYCLES, _ROUGHLY, _LOW, _SHORT = 5, 0.1, 3, 40
_SWEPT, _MOSTLY = 0.05, 0.8
# Change of the amplitude over a stretch, in e-folds: the least that leaves the damping ratio a
# relative standard error like the first of these. Beyond the second one nothing is said.
_CHANGES, _SURE, _UNSURE = (0.2, 0.3, 0.45, 0.7, 1.0), 0.1, 0.5
# Ratios of frequencies that are near p : q.
_RATIOS = ((1, 2), (1, 3), (2, 3), (1, 4), (3, 4), (1, 5), (2, 5), (1, 6), (1, 7))
_RESONANT = 0.01
# A tone is steady where its amplitude falls by less than this and is hardly ever (a tenth of the
# time) below this part of its highest, while another falls by more. A mode that gets its energy
# from another comes and goes.
_STEADY, _EVEN, _FALLEN = 0.1, 0.7, 0.5
# Where tones make up less than this of a signal, it is looked at as one short vibration.
_MOST_OF_IT = 0.5
# Samples a cycle of the highest frequency that stands out of the noise.
_SAMPLES_PER_CYCLE = 3.0
# Of the lowest tone: what is slower is no vibration.
_SLOWER = 0.5
_STANDS_OUT = 20.0  # power over the median of the spectrum
_MOST_SAMPLES = 400_000


@dataclass(frozen=True)
class Stretch:
    """A vibration over a stretch of time in which its amplitude changes little: means of that."""

    amplitude: float  # of the displacement
    frequency: float  # Hz
    damping_ratio: float  # NaN where it is less than two standard errors


@dataclass(frozen=True, eq=False)
class Vibration:
    """One vibration of a free decay: a tone whose frequency may move, and its harmonics.

    Attributes
    ----------
    tone : Ridge
        The fundamental; times from the start of the decay.
    harmonics : tuple of (int, Ridge)
        Number and tone of the harmonics that stand out.
    energy : float
        Integral of the displacement^2 over time: how much it moves, and how long.
    share : float
        Of the signal's energy, harmonics included; those of all vibrations add up to at most 1.
    derivative : int
        0, 1, 2 for a displacement, velocity or acceleration.
    steady : bool
        Whether it does not decay while others do: mains hum, a motor, no mode.
    signal : float
        Energy of the signal: integral of its square over time, without what is slower.
    carried : tuple of (int, Vibration)
        Number, and tone, of what keeps to n times its phase with an amplitude that no function of
        the motion makes: other modes, which it drives as it sweeps past a part of their frequency.
    """

    tone: Ridge
    harmonics: tuple[tuple[int, Ridge], ...]
    energy: float
    share: float
    derivative: int
    steady: bool = False
    signal: float = 0.0
    carried: tuple[tuple[int, Vibration], ...] = ()

    @property
    def frequency(self) -> Array:
        """Frequencies in Hz where it was followed, (n,)."""
        return self.tone.frequency

    @cached_property
    def displacement(self) -> Array:
        """Amplitudes of the displacement there, (n,)."""
        return _displacement(self.tone, self.tone.t, self.derivative)

    @property
    def acceleration(self) -> float:
        """Its largest amplitude of acceleration."""
        return float(np.max((2 * np.pi * self.frequency) ** 2 * self.displacement))

    @cached_property
    def loud(self) -> Stretch:
        """Where its displacement is largest."""
        return self._stretch(int(np.argmax(self.displacement)))

    @cached_property
    def quiet(self) -> Stretch:
        """Where its displacement is least."""
        return self._stretch(int(np.argmin(self.displacement)))

    @property
    def stays(self) -> bool:
        """Whether it rings on at its end as loud as before, over many cycles."""
        a, cycles = self.tone.amplitude, _turns(self.tone)
        third = a[-max(len(a) // 3, 1) :]
        loud = third[-1] > _LOUD * a.max() and cycles > 3 * _MANY
        half = len(third) // 2
        return bool(loud and half and third[half:].mean() > _STAYS * third[:half].mean())

    def __call__(self, t: Array) -> Array:
        """The vibration with its harmonics at times t from the start of the decay."""
        return self.tone(t) + sum((r(t) for _, r in self.harmonics), np.zeros(len(t)))

    @property
    def faint(self) -> bool:
        """Whether it is too weak to be told."""
        return self.share < _TOLD

    @cached_property
    def mean_frequency(self) -> float:
        """Hz, weighted by the energy of the signal."""
        weight = self.tone.amplitude**2
        return float(np.sum(weight * self.tone.frequency) / np.sum(weight))

    @cached_property
    def small_frequency(self) -> float:
        """Hz, of the quietest third of where it was followed: near that of small motions."""
        quiet = np.argsort(self.tone.amplitude)[: max(len(self.frequency) // 3, 1)]
        return float(self.frequency[quiet].mean())

    @cached_property
    def small_damping_ratio(self) -> float:
        """Of the quietest third of its amplitudes, in decibels."""
        log = np.log(self.displacement)
        part = log <= log.min() + np.ptp(log) / 3
        return self._damping(part if np.count_nonzero(part) > 1 else part | True)[0]

    def _stretch(self, k: int) -> Stretch:
        """Round window ``k``: as short as tells the damping."""
        log, n = np.log(self.displacement), len(self.displacement)
        for change in _CHANGES:
            far = np.flatnonzero(np.abs(log - log[k]) > change)
            # Three windows at least.
            first = min(max(far[far < k], default=-1) + 1, max(min(k - 1, n - 3), 0))
            part = slice(first, max(min(far[far > k], default=n), min(max(k + 2, 3), n)))
            damping, std = self._damping(part)
            if std < _SURE * abs(damping):
                break
        known = damping if std < _UNSURE * abs(damping) else np.nan
        frequency = float(np.mean(self.frequency[part]))
        return Stretch(float(np.exp(np.mean(log[part]))), frequency, known)

    def _damping(self, part: slice | NDArray[np.bool_]) -> tuple[float, float]:
        """Damping ratio from the decay of the displacement in a part, and its standard error."""
        t, log = self.tone.t[part], np.log(self.displacement[part])
        if len(t) < 2:
            return float("nan"), float("nan")
        t, log = t - t.mean(), log - log.mean()
        rate = -float(t @ log / (t @ t))
        std = np.sqrt(np.sum((log + rate * t) ** 2) / max(len(t) - 2, 1) / (t @ t))
        omega = float(np.hypot(rate, 2 * np.pi * np.mean(self.frequency[part])))
        return rate / omega, float(std) / omega


@dataclass(frozen=True)
class Resonance:
    """Two vibrations whose frequencies are near p : q somewhere."""

    lower: int  # number of the slower vibration, from 0
    higher: int  # of the faster one
    p: int
    q: int
    ratio: float  # higher over lower frequency where it is nearest to q / p
    amplitude: float  # of the displacement of the lower one there

    @property
    def off(self) -> float:
        """How far the ratio is off q / p, relative."""
        return abs(self.ratio * self.p / self.q - 1)


def find_vibrations(
    x: Array, dt: float, derivative: int = 0, progress: Callable[[str], None] | None = None
) -> tuple[Vibration, ...]:
    """The vibrations of one free decay, by frequency; none where nothing stands out for long.

    ``x`` (n,) is one channel from the release on, free of offset and drift, every ``dt`` s;
    ``derivative`` is 0, 1, 2 for a displacement, velocity or acceleration. ``progress`` is called
    with a line of text for every tone that was followed.
    """
    factor = decimation(x, dt)
    x, dt = downsample(np.asarray(x, float), factor), dt * factor
    if not np.ptp(x) > 0:
        return ()
    ridges = find_ridges(x, dt, progress)
    if sum(_shares(ridges, x, dt).values()) < _MOST_OF_IT:
        few = [r for r in only_ridge(x, dt) if _turns(r) < _SHORT]
        ridges = few if sum(_shares(few, x, dt).values()) > _MOST_OF_IT else ridges
    share = _shares(ridges, x, dt)
    ridges = [r for r in ridges if share[id(r)] > _LEAST_SHARE]
    ridges = [r for r in ridges if not any(_is_residue(r, o, share) for o in ridges)]
    ridges = [r.from_its_start() for r in refined(ridges, x, dt)]
    share = _shares(ridges, x, dt)
    loudest = max(share, key=lambda k: share[k], default=0)
    ridges = [r for r in ridges if id(r) == loudest or _cycles(r) > _FLEETING]
    moved = {id(r): _energy(r, derivative) for r in ridges}
    found: list[Vibration] = []
    for ridge in sorted(ridges, key=lambda r: -moved[id(r)]):
        weaker = [share[id(ridge)] < v.share for v in found]
        orders = [_harmonic_order(ridge, v.tone, w) for v, w in zip(found, weaker, strict=True)]
        own = next((i for i, (order, _) in enumerate(orders) if order), None)
        alone = Vibration(ridge, (), moved[id(ridge)], share[id(ridge)], derivative)
        if own is None:
            found.append(alone)
            continue
        of, (order, made) = found[own], orders[own]
        harmonics = (*of.harmonics, *([(order, ridge)] if made else []))
        carried = (*of.carried, *([] if made else [(order, alone)]))
        total = of.share + alone.share
        found[own] = replace(of, harmonics=harmonics, carried=carried, share=total)
    falls = any(_fall(v.tone) < _FALLEN for v in found)
    whole = dt * float(np.sum(_vibrating(x, ridges, dt) ** 2))
    found = [replace(v, steady=falls and _is_steady(v.tone), signal=whole) for v in found]
    return tuple(sorted(found, key=lambda v: v.mean_frequency))


def vibrations_of(ridges: Sequence[Ridge], x: Array, dt: float, derivative: int) -> list[Vibration]:
    """Tones of a signal (n,), each as a vibration without harmonics: see `find_vibrations`."""
    share, whole = _shares(ridges, x, dt), dt * float(np.sum(_vibrating(x, ridges, dt) ** 2))
    return [
        Vibration(r, (), _energy(r, derivative), share[id(r)], derivative, signal=whole)
        for r in ridges
    ]


def decimation(x: Array, dt: float) -> int:
    """Factor by which a signal can be decimated and keep all that stands out of its noise.

    Of a signal with very many samples the strongest tone, and what lies below it, is kept.
    """
    # Pieces, since a window over all of it would not see what has died away by its middle.
    size = max(len(x) // 50, min(len(x) // 8, 4096), min(len(x), 64))
    f, power = welch(x, 1 / dt, nperseg=size)
    floor = max(_STANDS_OUT * np.median(power), 1e-9 * power.max())
    highest = f[np.flatnonzero(power > floor)[-1]] if power.max() > floor else f[-1]
    most = int(1 / (dt * _SAMPLES_PER_CYCLE * max(f[np.argmax(power)], f[1])))
    kept = int(1 / (dt * _SAMPLES_PER_CYCLE * max(highest, f[1])))
    return max(1, kept, min(most, int(np.ceil(len(x) / _MOST_SAMPLES))))


def resonances(vibrations: Sequence[Vibration]) -> tuple[Resonance, ...]:
    """Pairs whose frequencies come near a ratio of small whole numbers along their decay."""
    ringing = [i for i, v in enumerate(vibrations) if not v.steady]
    tones = [vibrations[i].tone for i in ringing]
    found = resonances_of(tones, vibrations[0].derivative) if tones else ()
    return tuple(replace(r, lower=ringing[r.lower], higher=ringing[r.higher]) for r in found)


def resonances_of(tones: Sequence[Ridge], derivative: int) -> tuple[Resonance, ...]:
    """The same of tones of a displacement, velocity or acceleration (0, 1, 2), by frequency."""
    pairs = itertools.combinations(range(len(tones)), 2)
    found = (_nearest(i, j, tones[i], tones[j], derivative) for i, j in pairs)
    return tuple(r for r in found if r is not None)


def _nearest(i: int, j: int, low: Ridge, high: Ridge, derivative: int) -> Resonance | None:
    """Where two tones, with their numbers, are nearest to a ratio; None where they never are."""
    t = low.t[(low.t >= high.t[0]) & (low.t <= high.t[-1])]
    if not len(t):
        return None
    below, size = (np.interp(t, low.t, x) for x in (low.frequency, low.amplitude))
    ratio = np.interp(t, high.t, high.frequency) / below
    for p, q in _RATIOS:
        k = int(np.argmin(np.abs(ratio * p / q - 1)))
        moved = float(size[k] / (2 * np.pi * below[k]) ** derivative)
        found = Resonance(i, j, p, q, float(ratio[k]), moved)
        if found.off < _RESONANT:
            return found
    return None


def dominant(energy: Sequence[float]) -> int:
    """Which of several vibrations moves most, by energy; of two alike the first."""
    return int(np.argmax(np.asarray(energy) >= max(energy) / _AS_MUCH))


def _vibrating(x: Array, ridges: Sequence[Ridge], dt: float) -> Array:
    """A signal without what is slower than half the lowest tone: no vibration, but drift."""
    lowest = min((float(r.frequency.min()) for r in ridges), default=0.0)
    cosines = dct(x, norm="ortho")
    cosines[: max(int(_SLOWER * lowest * 2 * dt * len(x)), 1)] = 0.0
    return np.asarray(idct(cosines, norm="ortho"))


def _shares(ridges: Sequence[Ridge], x: Array, dt: float) -> dict[int, float]:
    """What each explains of the energy of a signal; at most 1 in all.

    Of tones that are fitted together the products with the signal add up to the energy that all of
    them explain; the energies of tones that take from one another what they give do not.
    """
    t, signal = dt * np.arange(len(x)), _vibrating(x, ridges, dt)
    part = np.array([max(float(r(t) @ signal), 0.0) for r in ridges]) / float(signal @ signal)
    part = part / max(float(part.sum()), 1.0)
    return {id(r): float(s) for r, s in zip(ridges, part, strict=True)}


def _energy(ridge: Ridge, derivative: int) -> float:
    """Integral of the displacement^2 over time."""
    t = np.linspace(ridge.start, ridge.end, 8 * len(ridge.t) + 1)
    return float(np.trapezoid(_displacement(ridge, t, derivative) ** 2, t) / 2)


def _displacement(ridge: Ridge, t: Array, derivative: int) -> Array:
    """Amplitudes of the displacement at times t."""
    _, frequency, size = ridge.along(t)
    slow = np.median(ridge.frequency) / 2  # where the tone fades its own frequency may be nothing
    return size / (2 * np.pi * np.maximum(frequency, slow)) ** derivative


def _turns(ridge: Ridge) -> float:
    """Cycles from its start to its end."""
    return float(ridge.phase(ridge.end) - ridge.phase(ridge.start)) / (2 * np.pi)


def _cycles(ridge: Ridge) -> float:
    """Cycles that a tone rings, as its energy is spread over them."""
    t = np.linspace(ridge.start, ridge.end, 8 * len(ridge.t) + 1)
    power = ridge.along(t)[2] ** 2
    seconds = np.trapezoid(power, t) ** 2 / np.trapezoid(power**2, t)
    return float(np.median(ridge.frequency) * seconds)


def _is_residue(ridge: Ridge, other: Ridge, share: dict[int, float]) -> bool:
    """Whether it is no more than what the fit of a strong neighbour has left."""
    if _RESIDUE_WEAKER * share[id(ridge)] > share[id(other)]:
        return False
    near = np.interp(ridge.t, other.t, other.frequency)
    return bool(np.median(np.abs(ridge.frequency / near - 1)) < _RESIDUE_NEAR)


def _harmonic_order(ridge: Ridge, of: Ridge, weaker: bool) -> tuple[int, bool]:
    """n where a tone goes with n times the phase of another, or else 0.

    And whether its amplitude is one that a function of the motion may make.
    """
    low, high = max(ridge.t[0], of.t[0]), min(ridge.t[-1], of.t[-1])
    t = np.linspace(low, high, 200)
    if high <= low or ridge.t[-1] - ridge.t[0] > 1.2 * (of.end - of.start):
        return 0, False
    (phase, frequency, size), (base, slow, main) = ridge.along(t), of.along(t)
    weight = size**2 / np.sum(size**2)  # where it is loud: at its end noise turns the phase
    order = round(float(weight @ (frequency / slow)))
    if not 2 <= order <= _HARMONICS:
        return 0, False
    off = float(weight @ np.abs(frequency / (order * slow) - 1))
    if off > _ROUGHLY:
        return 0, False
    cycles = (base[-1] - base[0]) / (2 * np.pi) / (len(t) * float(weight @ weight))
    turned = phase - order * base
    turned, limit = turned - weight @ turned, min(_LOCKED, _TURNED * order)
    near = float(weight @ turned**2) < limit**2
    goes_with_it = _LEAST_POWER < _power(weight, main, size) < order + 2
    made = off < _HARMONIC_NEAR and near and goes_with_it
    locked = made or (weaker and _follows(weight, slow, turned, limit))
    if cycles < _CYCLES:  # too few to tell
        made = locked = weaker and order <= _LOW and (locked or _turns(of) < _SHORT)
    return (order, made) if locked else (0, False)


def _follows(weight: Array, slow: Array, turned: Array, limit: float) -> bool:
    """Whether phases stay together, for most of the energy, while the fundamental sweeps."""
    mean = float(weight @ slow)
    swept = float(weight @ (slow / mean - 1) ** 2) > _SWEPT**2
    turn = np.exp(1j * turned)
    near = np.abs(np.angle(turn / (weight @ turn))) < limit  # a phase may slip by whole turns
    return swept and float(weight @ near) > _MOSTLY


def _power(weight: Array, main: Array, size: Array) -> float:
    """Power of one amplitude that another follows."""
    x, y = (np.log(a) - weight @ np.log(a) for a in (main, size))
    return float(weight @ (x * y) / (weight @ x**2))


def _fall(ridge: Ridge) -> float:
    """Amplitude at the end over that at the start."""
    n = max(len(ridge.t) // 10, 1)
    return float(np.mean(ridge.amplitude[-n:]) / np.mean(ridge.amplitude[:n]))


def _is_steady(ridge: Ridge) -> bool:
    """Whether it neither falls nor comes and goes."""
    low, high = np.quantile(ridge.amplitude, [0.1, 0.9])
    return bool(_fall(ridge) > 1 - _STEADY and low > _EVEN * high)


_WIDE = 12.0  # between knots: wide, so that other vibrations do not count
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
    followed = [
        HarmonicSpline.along(tone.phase, t[inside], channel[inside], _WIDE, 1) for channel in x.T
    ]
    z = [spline.amplitudes(t[inside])[:, 1] for spline in followed]  # complex, along the phase
    own = float(np.vdot(z[main], z[main]).real)
    shape = np.zeros(len(z))
    for i, other in enumerate(z):
        product, size = np.vdot(z[main], other), float(np.vdot(other, other).real)
        coherent = abs(product) ** 2 > _COHERENT * own * size
        if coherent and abs(product.real) > _IN_PHASE * abs(product):
            shape[i] = product.real / own
    weight = shape / np.array([noise_std(channel) for channel in x.T]) ** 2
    return x @ (weight / (weight @ shape)), shape


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
_SPOILED, _HARMLESS, _MUCH = 4.0, 0.005, 0.5
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
        spoiled |= _spoiled(rest, tone, dt * factor, own, _MUCH)
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
        beside=max((v.acceleration for v in told), default=0.0) / own.acceleration,
        slowest=_slowest(own),
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
    """Zero-phase Butterworth filter, of the third order each way; frequencies in Hz."""
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
    dt, slow = float(t[1] - t[0]), _slowest(own)
    rest = _filtered(x - own(t), slow, "highpass", dt)
    tones = [own.tone, *(tone for _, tone in own.harmonics)]
    q: Array = sum((_integrated(tone, t, own.derivative) for tone in tones), np.zeros(len(t)))
    integral: Array = rest
    for _ in range(own.derivative):
        integral = _filtered(
            cumulative_trapezoid(integral, dx=dt, initial=0.0), slow, "highpass", dt
        )
    return own(t) + rest, q + integral, q


def _slowest(own: Vibration) -> float:
    """Hz, below which a velocity or an acceleration is filtered; 0 for a displacement."""
    return _SLOW * float(own.frequency.min()) if own.derivative else 0.0


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
