"""What all sensors say of explanations, beside the first mode.

Along the curve of the first mode many effects do the same work: a damper anywhere, or in the
material. The first coordinate tells what acts, and not where. Higher modes are moved by phi_m(a)
times a force at a, and are damped and detuned in proportions of their own; a release rings them.
The beam is simulated with each explanation, as strong as the first coordinate asks for, and with an
effect that can be anywhere at some points a: between them the readings are splines over a. Gains of
the sensors, and small errors of the higher modes, are marginalised; what is left is a likelihood.

Are the sensors right? Each against the others, through the curve of the simulated beam.

Combinations of the channels that a motion of the first modes does not reach (parity relations)
vanish but for noise and for what curves with the amplitude, which the simulation tells. A faulty
channel drives them along a direction of its own.

[1] J. Gertler, Fault Detection and Diagnosis in Engineering Systems, Marcel Dekker (1998), ch. 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag, null_space
from scipy.stats import chi2

from romsindy.beam.beam import Beam
from romsindy.diagnosis.all_sensors import (
    GAINS,
    FirstMode,
    Readings,
    by_gains,
    noise_of,
    with_errors,
    without,
)
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import PlaceOnBeam
from romsindy.fit.verdict import NAMED_ABOVE, ONE_SENSOR, PLACE_RISE, SAME_DAMPING, SENSOR_FAULT
from romsindy.typing import Array

_FINE = 51  # places between two points
_ITERATIONS, _SETTLED = 4, 0.05  # of a fit; radians
_GROWN = (0.25, 0.5, 1.0)  # parts of what was read: a mode that is off may lose step over all of it
# Relative standard deviation of the frequency of the second mode, at the least. Errors of a mesh,
# and of steps in time, grow with the square of the frequency.
_FREQUENCY = 5e-4


@dataclass(frozen=True, eq=False)
class Latitude:
    """What sensors and higher modes may do beside what is simulated: standard deviations."""

    gains: Array  # (n_sensors,), relative, of the sensors
    places: Array  # (n_sensors, n_modes): of the mode shapes there, all of a sensor by one error
    frequencies: Array  # (n_modes,), relative, of the modes above the first that are told apart
    rates: Array  # (n_modes,), of their damping, 1/s

    @property
    def spreads(self) -> Array:
        """All, as the columns that they belong to; those of places are in their own."""
        pairs = np.stack([self.frequencies, self.rates], axis=1).ravel()
        return np.concatenate([self.gains, np.ones(len(self.places)), pairs])

    @classmethod
    def of(
        cls,
        seen: InstrumentedBeam,
        doubtful: Sequence[Beam],
        damping: tuple[float, float],
        places: Array,
    ) -> Latitude:
        """Latitude of a beam, given what it would be if each doubtful parameter were another.

        ``damping`` are standard deviations of alpha and eta, 1/s and s; zero where none is stated.
        """
        count = seen.shapes.shape[1]
        omega = seen.basis.omega[:count]
        shifts = [b.modes(count=count).omega / omega - 1 for b in doubtful]
        least = _FREQUENCY * (omega / omega[min(1, count - 1)]) ** 2
        frequencies = np.sqrt(least**2 + sum(x**2 for x in shifts))
        alpha, eta = np.hypot(damping, SAME_DAMPING * np.array([seen.beam.alpha, seen.beam.eta]))
        rates = np.hypot(alpha, eta * omega**2) / 2
        return cls(np.full(len(places), GAINS), places, frequencies[1:], rates[1:])


class SimulatedReadings(NamedTuple):
    """What the sensors read of a simulated beam, (n, n_sensors) each."""

    readings: Array
    ring: Array  # what more of the higher modes in its release does to them

    def until(self, n: int) -> SimulatedReadings:
        """The first samples."""
        return SimulatedReadings(self.readings[:n], self.ring[:n])


class OpenValues(NamedTuple):
    """Values of a beam that its first mode leaves open, in units of their own, n of them.

    By the first mode, and by what is known beforehand, the chi-square of values that are ``off``
    from their likeliest is the square of ``known`` times these.
    """

    slopes: Array  # (2 n_higher, n): of the frequency, relative, and the rate of each higher mode
    known: Array  # (m, n)
    off: Array  # (n,)


class Left(NamedTuple):
    """What motions leave of the sensors beside the first mode, over the noise, and of the slack."""

    left: Array  # (m,)
    step: Array  # (n,): what would leave less, as a change of the open values
    turns: float  # rad, by which that turns a higher mode by the end, at the most
    # Of each record, (n_higher,) complex: how much more of every mode its release had
    more: list[Array]


@dataclass(frozen=True, eq=False)
class TriedOnBeam:
    """An explanation that a beam was simulated with, at one point or at several."""

    names: frozenset[str]  # what it says
    at: Array | None  # (n_points,), those of the one effect that can be anywhere, m
    left: Array  # (m, n_points), of the sensors over the noise at each of the points: see `left_of`
    off: Array  # (n_points, n), of values that the first mode leaves open: see `OpenValues`

    @property
    def points(self) -> Array:
        """Points of an effect that can be anywhere."""
        return np.zeros(0) if self.at is None else self.at

    @property
    def rms(self) -> float:
        """What is left over the noise, at the point where it is least."""
        return float(np.sqrt(np.min(np.mean(self.left**2, axis=0))))

    def joined(self, more: TriedOnBeam) -> TriedOnBeam:
        """The same with further points."""
        at, left = np.append(self.points, more.points), np.hstack([self.left, more.left])
        order, off = np.argsort(at), np.vstack([self.off, more.off])
        return TriedOnBeam(self.names, at[order], left[:, order], off[order])


class Heard(NamedTuple):
    """What all sensors say of an explanation.

    ``misfit`` is minus twice the logarithm of its likelihood, places integrated over; ``place`` is
    that of an effect that can be anywhere, ``off`` are values that were open, at the point nearest
    to it.
    """

    misfit: float
    place: PlaceOnBeam | None
    off: Array


def weigh(
    tried: Sequence[TriedOnBeam], read: Sequence[Readings], seen: InstrumentedBeam
) -> list[Heard]:
    """What all sensors say of some explanations, by what they ``read``.

    Where none of them leaves noise alone, what the best leaves counts as noise. An effect that can
    be anywhere is as likely where the first mode moves most as at all other points together.
    """
    profiles = [_profile(t) for t in tried]
    noise = noise_of(min(float(x.min()) for _, x in profiles), read)
    pairs = zip(tried, profiles, strict=True)
    return [_heard(t, fine, x / noise, seen) for t, (fine, x) in pairs]


def _profile(tried: TriedOnBeam) -> tuple[Array | None, Array]:
    """Points of a fine grid, and chi-square there, of an explanation."""
    if tried.at is None:
        return None, np.sum(tried.left**2, axis=0)
    fine = np.unique(np.concatenate([np.linspace(a, b, _FINE) for a, b in pairwise(tried.at)]))
    weights = CubicSpline(tried.at, np.eye(len(tried.at)))(fine)
    return fine, np.einsum("ij,jk,ik->i", weights, tried.left.T @ tried.left, weights)


def _heard(
    tried: TriedOnBeam, fine: Array | None, chi_squared: Array, seen: InstrumentedBeam
) -> Heard:
    least = float(chi_squared.min())
    if fine is None:
        return Heard(least, None, tried.off[0])
    likelihood = np.exp(-0.5 * (chi_squared - least))
    there = np.interp(seen.usual, fine, likelihood, left=0.0, right=0.0)
    anywhere = np.trapezoid(likelihood, fine) / seen.beam.length
    inside, best = fine[chi_squared < least + PLACE_RISE], float(fine[np.argmin(chi_squared)])
    place = PlaceOnBeam(best, float(inside.min()), float(inside.max()), seen.beam.length)
    nearest = tried.off[int(np.argmin(np.abs(tried.points - best)))]
    return Heard(least - 2 * float(np.log((there + anywhere) / 2)), place, nearest)


def left_of(
    seen: InstrumentedBeam,
    read: Sequence[Readings],
    motions: Sequence[SimulatedReadings],
    slack: Latitude,
    values: OpenValues | None = None,
) -> Left:
    """What motions leave of the sensors, and how values that are open would leave less.

    How much the higher modes are off is fitted, by the values and beside them, from the first
    cycles on: their phase may run away by radians.
    """
    n_higher = seen.shapes.shape[1] - 1
    slopes, known, begun = values or (np.zeros((2 * n_higher, 0)), np.zeros((0, 0)), np.zeros(0))
    spreads, free = np.diag(1 / slack.spreads), len(slack.spreads)
    n_read = free - 2 * n_higher  # of the readings, which are linear in them
    off, more = np.zeros(free + len(begun)), [np.zeros(n_higher, complex)] * len(read)
    by_all = np.hstack([np.eye(2 * n_higher), slopes])  # what each does to the higher modes
    prior = block_diag(spreads, known)
    for share in _GROWN:
        parts = [(r.part(share), m) for r, m in zip(read, motions, strict=True)]
        heard = [HigherModes.of(seen, r, m.until(len(r.t))) for r, m in parts]
        for _ in range(_ITERATIONS):
            modes = by_all @ off[n_read:]
            rows = [h.columns(modes, c, slack.places) for h, c in zip(heard, more, strict=True)]
            given = off + np.append(np.zeros(free), begun)
            y = np.concatenate([*(r.left for r in rows), -prior @ given])
            own = np.concatenate([r.own for r in rows])
            x = np.vstack([np.hstack([own, own[:, n_read:] @ slopes]), prior])
            step = np.linalg.lstsq(x, y)[0]
            change = np.append(step[:n_read], by_all @ step[n_read:])
            more = [r.ringing(change) for r in rows]
            turn = float(np.abs(change[n_read:] * heard[0].reach).max(initial=0.0))
            off[n_read:] += step[n_read:] / max(turn, 1.0)
            if turn < _SETTLED:
                break
    moved = off[free:]
    turns = float(np.abs(slopes @ moved * heard[0].reach).max(initial=0.0))
    return Left(np.asarray(y - x @ step), moved, turns, more)


class Columns(NamedTuple):
    """What is left of a record over the noise, and what it follows: by slack, by the release."""

    left: Array  # (m,)
    own: Array  # (m, n_slack)
    free: Array  # (m, 2 n_higher): in phase with more of a mode, and a quarter of a cycle before
    all_left: Array  # (m,), with what the release may be
    all_own: Array

    def ringing(self, step: Array) -> Array:
        """How much more of every higher mode the release had, (n_higher,), complex."""
        found = np.linalg.lstsq(self.free, self.all_left - self.all_own @ step)[0]
        return np.asarray(found[::2] + 1j * found[1::2])


@dataclass(frozen=True, eq=False)
class HigherModes:
    """A motion in a record: its first mode with what follows that, and every higher mode.

    ``rung`` and ``more`` are the higher modes of the motion and of what more of them in the release
    does, as rotating complex amplitudes (n, n_higher).
    """

    seen: InstrumentedBeam
    read: Readings
    motion: SimulatedReadings
    first: FirstMode
    rung: Array
    more: Array
    # (n, n_sensors): what more of the second mode does beside its shape, as where it shortens the
    # beam together with the first
    bent: Array

    @classmethod
    def of(cls, seen: InstrumentedBeam, read: Readings, motion: SimulatedReadings) -> HigherModes:
        """Part a motion."""
        project, t = np.linalg.pinv(seen.shapes).T[:, 1:], read.t
        first = FirstMode.of(seen.coordinate(motion.readings), motion.readings, t)
        beside = motion.readings - first.readings
        rung, more = (_rotating(x @ project, t) for x in (beside, motion.ring))
        bent = motion.ring - more.real @ seen.shapes[:, 1:].T
        return cls(seen, read, motion, first, rung, more, bent)

    @property
    def omega(self) -> Array:
        """Of the higher modes, rad/s."""
        return self.seen.basis.omega[1 : self.seen.shapes.shape[1]]

    @property
    def reach(self) -> Array:
        """Radians, or logarithms of a ratio, that a unit of each error makes in the record."""
        end = float(self.read.t[-1])
        return np.stack([self.omega * end, np.full(len(self.omega), end)], axis=1).ravel()

    def columns(self, off: Array, more: Array, places: Array) -> Columns:
        """What is left where modes are off, (2 n_higher,), and rang ``more`` than was thought.

        Mode shapes may be others by what ``places`` do, see `Latitude`.

        What the release may be is taken off; errors of the phase and the size of the first mode
        count as noise.
        """
        t, shapes = self.read.t, self.seen.shapes[:, 1:].T
        turn = np.exp(t[:, None] * (1j * self.omega * off[::2] - off[1::2]))
        rung, ring = self.rung * turn, self.more * turn
        whole = rung + more * ring
        moved = self.motion.readings + (rung - self.rung).real @ shapes
        first = self.first.errors(t, self.seen.basis.omega[0])
        modes = np.column_stack([self.seen.coordinate(self.first.readings), rung.real])
        free, own = [], [*by_gains(moved), *by_gains(modes @ places.T)]
        for k, shape in enumerate(shapes):
            by_frequency = (1j * self.omega[k] * t * whole[:, k]).real
            own += [np.outer(x, shape) for x in (by_frequency, -t * whole[:, k].real)]
            free += [np.outer(x, shape) for x in (ring[:, k].real, -ring[:, k].imag)]
        free = [free[0] + self.bent, *free[1:]] if free else []
        shape = self.seen.shapes[:, 0]
        table = self.read.over_noise([self.read.measured - moved, *own, *free], shape)
        table = with_errors(table, self.read.over_noise(first, shape))
        n, release = 1 + len(own), table[:, 1 + len(own) :]
        known = without(table[:, :n], release)
        return Columns(known[:, 0], known[:, 1:], release, table[:, 0], table[:, 1:n])


def _rotating(x: Array, t: Array) -> Array:
    """Ringing modes (n, m) as complex amplitudes that rotate; their real part is what rings."""
    turned = np.gradient(x, t, axis=0)
    # Differences of few samples a cycle are too small, in the right phase.
    size = np.linalg.norm(x, axis=0) / np.maximum(np.linalg.norm(turned, axis=0), 1e-300)
    return np.asarray(x - 1j * turned * size)


# Swings that end at exactly the same value are clipped: those of a decay differ.
_SAME, _SWINGS = 1e-9, 4
# That sensors within their tolerances disagree by more, as for the strength of what is named.
_CHANCE = float(chi2.sf(NAMED_ABOVE**2, 1))
_CUT = 30.0  # of chi-square, for independent samples, over some hundred limits that are tried
_LIMITS = np.linspace(0.6, 1.0, 41)  # of a channel, over its largest reading
_MEMORY = 20  # samples after which noise is not alike any more
_FOLDS = 40  # parts of a channel's range over which what repeats is told from noise


@dataclass(frozen=True)
class SensorFault:
    """A channel that disagrees with the others."""

    channel: int
    label: str
    kind: str  # "gain", "offset" or "saturation"
    value: float  # relative error of the gain; offset, m; limit, m

    def __str__(self) -> str:
        unit = "" if self.kind == "gain" else " m"
        return f"sensor {self.label} is faulty ({self.kind} {self.value:.3g}{unit})"


def find_fault(
    measured: Array, simulated: Array, shapes: Array, labels: list[str], gains: Array | None = None
) -> SensorFault | None:
    """Find the channel that is faulty, if there is one.

    Two sensors more than modes are needed to say which is wrong. Displacements from equilibrium
    over the same amplitudes, ``measured`` and ``simulated``, are (n, n_sensors), m, the ``shapes``
    of the modes (n_sensors, n_modes). Where places of sensors are known to a tolerance, ``gains``
    are the standard deviations of their gains, (n_sensors,).
    """
    for channel, y in enumerate(measured.T):
        if _clips(y):
            return SensorFault(channel, labels[channel], "saturation", float(np.abs(y).max()))
    parity = null_space(shapes.T).T
    if len(parity) < 2:
        return None
    project = np.linalg.pinv(shapes)[0]
    curve, *_ = np.linalg.lstsq(_powers(simulated @ project), simulated @ parity.T, rcond=None)
    q = measured @ project
    left = measured @ parity.T - _powers(q) @ curve
    allowed = gains is not None and _places_explain(left, q, parity * shapes[:, 0], gains)
    fault = _worst(measured, parity, left, labels, without=q if allowed else None)
    return fault or _cut(measured, parity, left, q, labels)


def _places_explain(left: Array, q: Array, drives: Array, gains: Array) -> bool:
    """Whether gains within their standard deviations make the relations follow the coordinate."""
    follows = q @ left / (q @ q)
    spread = drives * gains
    chi_squared = follows @ np.linalg.solve(spread @ spread.T, follows)
    return bool(chi_squared < chi2.isf(_CHANCE, len(follows)))


def _worst(
    measured: Array, parity: Array, left: Array, labels: list[str], without: Array | None = None
) -> SensorFault | None:
    """The channel that explains what is left of the relations, if one explains it.

    What follows ``without`` (n,) is no fault.
    """

    def seen(relations: Array, y: Array) -> float:
        if without is not None:
            follows = without @ relations / (without @ without)
            relations = relations - np.outer(without, follows)
        return float(np.sum(_repeated(relations, y) ** 2))

    found = []
    for channel, y in enumerate(measured.T):
        # A fault of the channel drives the relations, and the coordinate that the curve uses.
        column = parity[:, channel]
        f = left @ column / (column @ column)
        for kind, value, part in _explanations(y, f):
            if kind == "gain" and without is not None:
                continue
            found.append((seen(left - np.outer(part, column), y), channel, kind, value, part))
    cost, channel, kind, value, part = min(found, key=lambda row: row[0])
    all_of_it = seen(left, measured[:, channel])
    worst = float(np.mean(np.abs(part[np.abs(part) > 0]))) if np.any(part) else 0.0
    small = worst < SENSOR_FAULT * np.std(measured[:, channel])
    if small or cost > (1 - ONE_SENSOR) * all_of_it:
        return None
    return SensorFault(channel, labels[channel], kind, value)


def _cut(
    measured: Array, parity: Array, left: Array, q: Array, labels: list[str]
) -> SensorFault | None:
    """The channel that stays below a limit in a few swings, under the noise, if there is one.

    What follows the coordinate smoothly is no limit of a sensor.
    """
    smooth = np.linalg.qr(_powers(q))[0]

    def rest(x: Array) -> Array:
        return np.asarray(x - smooth @ (smooth.T @ x))

    left = rest(left)
    noise = np.cov(left.T)
    found = []
    for channel, y in enumerate(measured.T):
        weight = np.linalg.solve(noise, parity[:, channel])
        precision = float(weight @ parity[:, channel])
        f = left @ weight / precision
        true = smooth @ (smooth.T @ y)
        for limit in np.abs(true).max() * _LIMITS:
            part = rest(np.clip(true, -limit, limit) - true)
            found.append((precision * float(part @ (2 * f - part)), channel, float(limit)))
    gain, channel, limit = max(found)
    if gain < _CUT * _correlated(left):
        return None
    return SensorFault(channel, labels[channel], "saturation", limit)


def _correlated(x: Array) -> float:
    """Samples that tell as much as one that is independent, of the worst column; at least 1."""
    x = x - x.mean(axis=0)
    power = np.sum(x**2, axis=0)
    rho = [np.sum(x[k:] * x[:-k], axis=0) / power for k in range(1, _MEMORY)]
    return float(np.max(1 + 2 * np.maximum(np.sum(rho, axis=0), 0.0)))


def _clips(y: Array) -> bool:
    """Whether a channel comes back to one and the same largest value, swing after swing."""
    top = np.abs(y) >= (1 - _SAME) * np.abs(y).max()
    return int(np.count_nonzero(np.diff(np.flatnonzero(top)) > 1)) >= _SWINGS - 1


def _powers(q: Array) -> Array:
    return np.stack([q, q**2, q**3], axis=1)


def _explanations(y: Array, f: Array) -> list[tuple[str, float, Array]]:
    """Kinds of fault of a channel with their least-squares values and what they add to it."""
    shown = float(f @ y / (y @ y))
    return [
        ("gain", shown / (1 - shown), shown * y),  # y is (1 + gain) of the true displacement
        ("offset", float(np.mean(f)), np.full_like(y, np.mean(f))),
    ]


def _repeated(left: Array, y: Array) -> Array:
    """Parts of the relations that follow the channel: means over its size, one row per bin."""
    edges = np.linspace(y.min(), y.max(), _FOLDS + 1)[1:-1]
    bins = np.digitize(y, edges)
    counts = np.maximum(np.bincount(bins, minlength=_FOLDS), 1)
    sums = np.stack([np.bincount(bins, x, minlength=_FOLDS) for x in left.T], axis=1)
    return sums / np.sqrt(counts)[:, None]
