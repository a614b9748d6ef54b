"""What all sensors read beside the first mode of a structure, and what counts as noise there.

Sensors have noises of their own colours. Cosines of their readings, over the noise, are nearly
independent: in each, what goes with the shape of the first mode is left to the coordinate.

A mode whose frequency is off by 0.2 % has turned, by the time t, 0.002 omega t too far: by what it
does there, times that, its cosines are unsure. So a fast mode is heard in its first cycles, and
hardly when it may have lost step: all explanations leave that, and one takes a part by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.fft import dct
from scipy.ndimage import uniform_filter1d

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
_HARMONICS = 3.5  # of the first mode: what is faster is another mode
_LOST = np.sqrt(2.0)  # of what a mode does: so far it is from any other phase
_BESIDE = 3  # cosines next to each other, among which a mode is


@dataclass(frozen=True, eq=False)
class Readings:
    """What all sensors read in the first cycles of a record, and the noise of each.

    Where it is not known how fast other modes are, ``rung`` is what these do.
    """

    t: Array  # (n,), s, from where the beam is let go
    measured: Array  # (n, n_sensors)
    noises: tuple[Noise, ...]
    first: int = 0  # sample from which on it is calm enough
    rung: Array | None = None  # (n, n_sensors)
    cycle: float = np.inf  # of the first mode, s, where others ring

    @classmethod
    def of(cls, record: Record, decay: Decay, first: float, floor: float) -> Readings:
        """Of a record of the coordinate, and the same as all sensors measured it.

        It is looked at for some cycles from time ``first`` on, s, on the clock of the decay.
        """
        noises = channel_noises(record, decay, floor)
        n = int(np.searchsorted(decay.t, first + _CYCLES * 2 * np.pi / record.rate))
        calm = int(np.searchsorted(decay.t, first))
        return cls((decay.t - decay.t[0])[:n], decay.signal[:n], noises, calm)

    def unsure(self, q: Array, rate: float) -> Readings:
        """The same where frequencies of other modes than that of q (n,) are not known, rad/s."""
        rung = self.measured - FirstMode.of(q, self.measured, self.t).readings
        return replace(self, rung=rung, cycle=2 * np.pi / rate)

    def part(self, share: float) -> Readings:
        """The first part of what is looked at."""
        n = self.first + int(np.ceil(share * (len(self.t) - self.first)))
        rung = None if self.rung is None else self.rung[:n]
        return replace(self, t=self.t[:n], measured=self.measured[:n], rung=rung)

    def cosines(self, x: Array, shape: Array | None = None) -> Array:
        """Cosines (m, ...) of readings (n, n_sensors, ...) over what is not known of them.

        Readings are from the first on; what goes with a ``shape`` is taken off.
        """
        found = []
        for span in self._spans(len(x)):
            unknown = self._unknown(span)
            y = (dct(x[span], norm="ortho", axis=0).T / unknown.T).T
            if shape is not None:
                along = shape / unknown
                along /= np.linalg.norm(along, axis=1)[:, None]
                y -= np.einsum("ks,kr,kr...->ks...", along, along, y)
            found.append(y.reshape(-1, *x.shape[2:]))
        return np.concatenate(found)

    def _spans(self, n: int) -> list[slice]:
        """Of n samples the first cycle, the second, the next two, the next four, and so on."""
        cycle = self.cycle / float(self.t[1] - self.t[0])
        edges = [self.first]
        while (later := (2 ** (len(edges) - 1)) * cycle) < n - self.first - cycle / 2:
            edges.append(self.first + round(later))
        return [slice(*pair) for pair in pairwise([*edges, n])]

    def _unknown(self, span: slice) -> Array:
        """Standard deviations of cosines, (n, n_sensors): noise, and modes turned too far."""
        n = span.stop - span.start
        noise = np.stack([own.of_cosines(n) for own in self.noises], axis=1)
        if self.rung is None:
            return noise
        half_turns = np.arange(n) / (n * (self.t[1] - self.t[0]))  # in a second
        phase = np.minimum(_DETUNED * np.pi * half_turns * self.t[span.stop - 1], _LOST)
        phase[half_turns * self.cycle < 2 * _HARMONICS] = 0.0
        waves = dct(self.rung[span], norm="ortho", axis=0) ** 2
        square = _BESIDE * uniform_filter1d(waves, _BESIDE, axis=0, mode="nearest")
        return np.asarray(np.sqrt(noise**2 + phase[:, None] ** 2 * square))

    def over_noise(self, columns: Sequence[Array], shape: Array) -> Array:
        """Cosines of several readings as columns (m, k)."""
        return self.cosines(np.stack(columns, axis=-1), shape)


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
    basis = orthonormal(free)
    return np.asarray(table - basis @ (basis.T @ table))


def orthonormal(columns: Array) -> Array:
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
