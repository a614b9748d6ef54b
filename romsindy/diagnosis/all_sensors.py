"""What all sensors read beside the first mode of a structure, and what counts as noise there.

Sensors have noises of their own colours. Cosines of their readings, over the noise, are nearly
independent: in each, what goes with the shape of the first mode is left to the coordinate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from romsindy.diagnosis.structure import channel_noises
from romsindy.fit.records.record import Record
from romsindy.record.decay import Decay
from romsindy.record.noise import Noise
from romsindy.typing import Array

GAINS = 2e-3  # standard deviation of the gain of a sensor, by calibration and place
# Standard deviations of a first mode that follows the coordinate: rad, and as a part of it
_PHASE, _SIZE = 0.02, 0.01
# Of the frequencies of other modes, a standard deviation: elements and clamps are not known better
_DETUNED = 2e-3
# Of what no explanation explains: by so much one may seem better than another
UNEXPLAINED = 0.2
_NEW = 1e-9  # of a column beside others
_CYCLES = 12  # once it is calm: over these all sensors are heard


@dataclass(frozen=True, eq=False)
class Readings:
    """What all sensors read in the first cycles of a record, and the noise of each."""

    t: Array  # (n,), s, from where the beam is let go
    measured: Array  # (n, n_sensors)
    noises: tuple[Noise, ...]
    first: int = 0  # sample from which on it is calm enough

    @classmethod
    def of(cls, record: Record, decay: Decay, first: float, floor: float) -> Readings:
        """Of a record of the coordinate, and the same as all sensors measured it.

        It is looked at for some cycles from time ``first`` on, s, on the clock of the decay.
        """
        noises = channel_noises(record, decay, floor)
        n = int(np.searchsorted(decay.t, first + _CYCLES * 2 * np.pi / record.rate))
        calm = int(np.searchsorted(decay.t, first))
        return cls((decay.t - decay.t[0])[:n], decay.signal[:n], noises, calm)

    def part(self, share: float) -> Readings:
        """The first part of what is looked at."""
        n = self.first + int(np.ceil(share * (len(self.t) - self.first)))
        return replace(self, t=self.t[:n], measured=self.measured[:n])

    def cosines(self, x: Array, shape: Array) -> Array:
        """Cosines of readings (n, n_sensors) over the noise, without what goes with a shape."""
        x = x[self.first :]
        y = np.stack([n.cosines(y) for n, y in zip(self.noises, x.T, strict=True)], axis=1)
        along = shape / np.stack([n.of_cosines(len(x)) for n in self.noises], axis=1)
        along /= np.linalg.norm(along, axis=1)[:, None]
        return np.asarray(y - along * np.sum(along * y, axis=1)[:, None]).ravel()

    def over_noise(self, columns: Sequence[Array], shape: Array) -> Array:
        """Cosines of several readings as columns (m, k)."""
        return np.stack([self.cosines(y, shape) for y in columns], axis=1)


class FirstMode(NamedTuple):
    """What follows the first mode of a simulated motion, (n, n_sensors) each."""

    readings: Array
    larger: Array  # what they would change by if it were larger

    @classmethod
    def of(cls, q: Array, readings: Array, t: Array) -> FirstMode:
        """Of readings of a motion whose coordinate is q (n,)."""
        columns = along(q, t)
        shapes = np.linalg.lstsq(columns, readings)[0]
        return cls(columns @ shapes, (columns * _DEGREES) @ shapes)

    def errors(self, t: Array, omega: float) -> list[Array]:
        """Standard deviations of what is known of it by the coordinate: phase and size."""
        share = (t / t[-1])[:, None]
        later = _PHASE / omega * np.gradient(self.readings, t, axis=0)
        larger = _SIZE * self.larger
        return [later, share * later, share**2 * later, larger, share * larger]


_DEGREES = np.array([0, 1, 2, 3, 2, 3])  # in the amplitude, of what shapes follow


def along(q: Array, t: Array) -> Array:
    """What shapes of a structure follow along the motion of its first mode: columns (n, 6)."""
    rate = np.gradient(q, t)
    return np.stack([np.ones_like(q), q, q**2, q**3, rate**2, q * rate**2], axis=1)


def followed(readings: Array, q: Array, measured: Array, t: Array) -> Array:
    """Readings of a motion whose coordinate q moves as it was ``measured``: other modes as before.

    What a structure lacks moves its first mode otherwise; other modes follow that.
    """
    own = along(q, t)
    shapes = np.linalg.lstsq(own, readings)[0]
    return np.asarray(readings + (along(measured, t) - own) @ shapes)


def by_gains(readings: Array) -> list[Array]:
    """What the gain of each sensor changes."""
    return [np.outer(y, e) for y, e in zip(readings.T, np.eye(len(readings.T)), strict=True)]


def with_errors(table: Array, errors: Array) -> Array:
    """Columns made white again where errors, each a standard deviation, add to the noise."""
    u, size, _ = np.linalg.svd(errors, full_matrices=False)
    return np.asarray(table - u @ ((1 - 1 / np.sqrt(1 + size**2))[:, None] * (u.T @ table)))


def without(table: Array, free: Array) -> Array:
    """Columns without what others span."""
    basis = _orthonormal(free)
    return np.asarray(table - basis @ (basis.T @ table))


def _orthonormal(columns: Array) -> Array:
    """A basis of what columns span, those that say nothing new left out."""
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(u[:, s > _NEW * s.max(initial=0)])


def noise_of(least: float, read: Sequence[Readings]) -> float:
    """What counts as noise by the ``least`` chi-square of what was read, in its unit.

    Where no explanation leaves noise alone, it is what the best leaves.
    """
    return max(least / samples_beside(read), 1.0)


def samples_beside(read: Sequence[Readings]) -> int:
    """Samples of what was read beside the first mode, of all sensors."""
    return sum((len(r.t) - r.first) * (r.measured.shape[1] - 1) for r in read)


def detuned(rung: Array, t: Array) -> list[Array]:
    """What frequencies of other modes change of their readings (n, n_sensors), to a deviation each.

    Of all of them by the same part, and by parts that grow with their square, as of what meshes and
    steps in time leave.
    """
    later = np.gradient(rung, t, axis=0)
    sooner = np.gradient(np.gradient(later, t, axis=0), t, axis=0)
    size = float(np.linalg.norm(later)) / max(float(np.linalg.norm(sooner)), 1e-300)
    return [_DETUNED * t[:, None] * x for x in (later, size * sooner)]


def tells(rise: float, least: float, noise: float, unexplained: float = UNEXPLAINED) -> float:
    """Chi-square that a misfit counts for beyond the least of all, which is ``noise`` times noise.

    What even the best leaves beside noise is an error of the simulator, such as modes that ring
    otherwise at large amplitude. It may go with any explanation, and with any place.
    """
    return max(rise - unexplained * least * (1 - 1 / noise), 0.0) / noise


def refuted_by(left: Array, unexplained: float, samples: int) -> Array:
    """What chi-squares of several explanations count for against each, see `tells`."""
    least = float(left.min())
    noise = max(least / samples, 1.0)
    return np.array([tells(x - least, least, noise, unexplained) for x in left.tolist()])


def beside_known(left: Array, known: Array) -> float:
    """Chi-square of what is left, (m,), where columns (m, k) may be in it, once each."""
    along = known.T @ left
    return float(left @ left - along @ np.linalg.solve(np.eye(len(along)) + known.T @ known, along))


def chi_squared(rows: Sequence[Array]) -> float:
    """What is left of all records, `left_of` each, by the likeliest gains."""
    table = np.concatenate([*rows, np.eye(rows[0].shape[1])[1:]])
    left, gains = table[:, 0], table[:, 1:]
    return float(np.sum((left - gains @ np.linalg.lstsq(gains, left)[0]) ** 2))
