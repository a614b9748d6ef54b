"""What all sensors say of explanations, beside the first mode.

Along the curve of the first mode many effects do the same work: a damper anywhere, or in the
material. The first coordinate tells what acts, and not where. Higher modes are moved by phi_m(a)
times a force at a, and are damped and detuned in proportions of their own; a release rings them.
The beam is simulated with each explanation, as strong as the first coordinate asks for, and with an
effect that can be anywhere at some points a: between them the readings are splines over a. Gains of
the sensors, and small errors of the higher modes, are marginalised; what is left is a likelihood.

Sensors have noises of their own colours. Cosines of their readings, over the noise, are nearly
independent: in each, what goes with the shape of the first mode is left to the coordinate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from romsindy.beam.beam import Beam
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.place import PlaceOnBeam
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import PLACE_RISE, SAME_DAMPING
from romsindy.record.decay import Decay
from romsindy.record.noise import Noise
from romsindy.record.smoothing import HarmonicSpline
from romsindy.typing import Array

_FINE = 301
_NEW = 1e-9  # of a column beside others
_SLOW = 3  # cycles from knot to knot of what is no noise of a sensor
_GAINS = 2e-3  # standard deviation of the gain of a sensor, by calibration and place
# Relative standard deviation of the frequency of the second mode, at the least. Errors of a mesh, of
# steps in time and of small masses grow with the frequency.
_FREQUENCY = 5e-4


@dataclass(frozen=True, eq=False)
class Latitude:
    """What sensors and higher modes may do beside what is simulated: standard deviations."""

    gains: Array  # (n_sensors,), relative, of the sensors
    frequencies: Array  # (n_modes,), relative, of the modes above the first that are told apart
    rates: Array  # (n_modes,), of their damping, 1/s

    @property
    def spreads(self) -> Array:
        """All, as the columns that they belong to."""
        pairs = np.stack([self.frequencies, self.rates], axis=1).ravel()
        return np.concatenate([self.gains, pairs])

    @classmethod
    def of(cls, seen: InstrumentedBeam, doubtful: Sequence[Beam], gains: Array) -> Latitude:
        """Latitude of a beam, given what it would be if each doubtful parameter were another."""
        count = seen.shapes.shape[1]
        omega = seen.basis.omega[:count]
        shifts = [b.modes(count=count).omega / omega - 1 for b in doubtful]
        least = _FREQUENCY * omega / omega[min(1, count - 1)]
        frequencies = np.sqrt(least**2 + sum(x**2 for x in shifts))
        rates = SAME_DAMPING * (seen.beam.alpha + seen.beam.eta * omega**2) / 2
        return cls(np.hypot(_GAINS, gains), frequencies[1:], rates[1:])


@dataclass(frozen=True, eq=False)
class Readings:
    """What all sensors read in the first cycles of a record, and the noise of each."""

    t: Array  # (n,), s, from where the beam is let go
    measured: Array  # (n, n_sensors)
    noises: tuple[Noise, ...]
    first: int = 0  # sample from which on it is calm enough

    @classmethod
    def of(cls, record: Record, decay: Decay, first: float, last: float, floor: float) -> Readings:
        """Of a record of the coordinate, and the same as all sensors measured it.

        It is looked at from time ``first`` to ``last``, s, on the clock of the decay.
        """
        clock = decay.t - decay.t[0]
        amplitude = np.abs(record.spline.amplitudes(clock)[:, 1])
        cycle = 2 * np.pi / record.rate
        noises = []
        for x in decay.signal.T:
            smooth = HarmonicSpline.along(record.spline.phase, clock, x, _SLOW)
            rest, least = x - smooth(clock)[0], floor * float(np.abs(x).max())
            slow = smooth.midline(clock)
            noises.append(Noise.of(rest, slow, amplitude, cycle, decay.dt, least))
        n = int(np.searchsorted(decay.t, last))
        calm = int(np.searchsorted(decay.t, first))
        return cls(clock[:n], decay.signal[:n], tuple(noises), calm)

    def cosines(self, x: Array, shape: Array) -> Array:
        """Cosines of readings (n, n_sensors) over the noise, without what goes with a shape."""
        x = x[self.first :]
        y = np.stack([n.cosines(y) for n, y in zip(self.noises, x.T, strict=True)], axis=1)
        along = shape / np.stack([n.of_cosines(len(x)) for n in self.noises], axis=1)
        along /= np.linalg.norm(along, axis=1)[:, None]
        return np.asarray(y - along * np.sum(along * y, axis=1)[:, None]).ravel()


class Motion(NamedTuple):
    """What the sensors read of a simulated beam, (n, n_sensors) each."""

    readings: Array
    ring: Array  # what more of the higher modes in its release does to them


@dataclass(frozen=True, eq=False)
class Tried:
    """An explanation that a beam was simulated with, at one point or at several.

    Attributes
    ----------
    names : frozenset of str
        What it says.
    at : (n_points,) array or None
        Points of the one effect that can be anywhere, m.
    motions : sequence of sequence of Motion
        In each record, for each of the points.
    """

    names: frozenset[str]
    at: Array | None
    motions: Sequence[Sequence[Motion]]


def followed(seen: InstrumentedBeam, t: Array, motion: Motion, measured: Array) -> Motion:
    """A motion whose first mode moves as it was ``measured``, (n,): the higher modes as before.

    What a beam lacks moves its first mode otherwise; other modes follow that.
    """
    own = _along(seen.coordinate(motion.readings), t)
    shapes = np.linalg.lstsq(own, motion.readings)[0]
    return motion._replace(readings=motion.readings + (_along(measured, t) - own) @ shapes)


class Heard(NamedTuple):
    """What all sensors say of an explanation.

    ``misfit`` is minus twice the logarithm of its likelihood, places integrated over; ``place`` is
    that of an effect that can be anywhere.
    """

    misfit: float
    place: PlaceOnBeam | None


def weigh(
    seen: InstrumentedBeam, read: Sequence[Readings], tried: Sequence[Tried], slack: Latitude
) -> list[Heard]:
    """What all sensors say of some explanations.

    What they read in each record is ``read``. Where no explanation leaves noise alone, what the best
    leaves counts as noise.
    """
    profiles = [_profile(seen, read, t, slack) for t in tried]
    samples = sum((len(r.t) - r.first) * (r.measured.shape[1] - 1) for r in read)
    noise = max(min(float(x.min()) for _, x in profiles) / samples, 1.0)
    return [_heard(fine, x / noise, seen.beam.length) for fine, x in profiles]


def _profile(
    seen: InstrumentedBeam, read: Sequence[Readings], tried: Tried, slack: Latitude
) -> tuple[Array | None, Array]:
    """Points of a fine grid, and chi-square there, of an explanation."""
    n_points = len(tried.motions[0])
    left = np.stack(
        [_left(seen, read, [m[j] for m in tried.motions], slack) for j in range(n_points)], axis=1
    )
    if tried.at is None:
        return None, np.sum(left**2, axis=0)
    fine = np.linspace(tried.at[0], tried.at[-1], _FINE)
    weights = CubicSpline(tried.at, np.eye(n_points))(fine)
    return fine, np.einsum("ij,jk,ik->i", weights, left.T @ left, weights)


def _heard(fine: Array | None, chi_squared: Array, length: float) -> Heard:
    least = float(chi_squared.min())
    misfit = least - 2 * float(np.log(np.mean(np.exp(-0.5 * (chi_squared - least)))))
    if fine is None:
        return Heard(misfit, None)
    inside, best = fine[chi_squared < least + PLACE_RISE], float(fine[np.argmin(chi_squared)])
    return Heard(misfit, PlaceOnBeam(best, float(inside.min()), float(inside.max()), length))


def _left(
    seen: InstrumentedBeam, read: Sequence[Readings], motions: Sequence[Motion], slack: Latitude
) -> Array:
    """What motions leave of the sensors beside the first mode, over the noise, and of the slack."""
    rows = [_columns(seen, *pair) for pair in zip(read, motions, strict=True)]
    left = np.concatenate([y for y, _ in rows])
    own = np.concatenate([x for _, x in rows])
    known = np.diag(1 / slack.spreads)
    y, x = np.concatenate([left, np.zeros(len(known))]), np.concatenate([own, known])
    return np.asarray(y - x @ np.linalg.lstsq(x, y)[0])


def _columns(seen: InstrumentedBeam, read: Readings, motion: Motion) -> tuple[Array, Array]:
    """What a motion leaves of a record, over the noise, and what the slack does, (m, n_slack).

    The release is known no better than it was read: what more of the higher modes would do, and
    errors of the phase and the amplitude of the first, are taken off.
    """
    t, usual, project = read.t, motion.readings, np.linalg.pinv(seen.shapes).T
    slaved = _fitted(_along(seen.coordinate(usual), t), usual)
    rung, rings = (usual - slaved) @ project, motion.ring @ project
    share, rate = (t / t[-1])[:, None], np.gradient(slaved, t, axis=0)
    free = [rate, share * rate, share**2 * rate, slaved, share * slaved]
    own = [np.outer(usual[:, s], row) for s, row in enumerate(np.eye(usual.shape[1]))]
    for k, shape in list(enumerate(seen.shapes.T))[1:]:
        own += [np.outer(t * x, shape) for x in (np.gradient(rung[:, k], t), rung[:, k])]
        free += [np.outer(x, shape) for x in (rings[:, k], np.gradient(rings[:, k], t))]

    def over_noise(columns: Sequence[Array]) -> Array:
        return np.stack([read.cosines(y, seen.shapes[:, 0]) for y in columns], axis=1)

    basis = _orthonormal(over_noise(free))
    table = over_noise([read.measured - usual, *own])
    table -= basis @ (basis.T @ table)
    return table[:, 0], table[:, 1:]


def _along(q: Array, t: Array) -> Array:
    """What shapes of a beam follow along the motion of its first mode: columns (n, 6)."""
    rate = np.gradient(q, t)
    return np.stack([np.ones_like(q), q, q**2, q**3, rate**2, q * rate**2], axis=1)


def _fitted(columns: Array, y: Array) -> Array:
    basis = _orthonormal(columns)
    return np.asarray(basis @ (basis.T @ y))


def _orthonormal(columns: Array) -> Array:
    """A basis of what columns span, those that say nothing new left out."""
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(u[:, s > _NEW * s[0]])
