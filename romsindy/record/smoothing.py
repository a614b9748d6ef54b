"""The smooth motion behind a record; displacements integrated without drift by it; filters.

A free decay is a sum of harmonics of one phase whose complex amplitudes drift slowly. Splines for
these amplitudes, a few cycles between knots, are fitted to the samples by least squares. A filter
has one to choose; its derivatives are those of the signal that it smoothed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline, make_lsq_spline
from scipy.linalg import solveh_banded
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import savgol_filter
from scipy.sparse import csr_array

from romsindy.record.signals import crossings, fundamental_frequency, lowpass
from romsindy.record.spectrum import HARMONICS
from romsindy.typing import Array

_CYCLES = 3.0  # between knots
_UNEVEN = 0.4  # difference of a cycle from its neighbours that no free decay has


def swing(x: Array) -> tuple[Array, int]:
    """A record about its own moving mean, and the samples of a cycle.

    Raises a ValueError if the record holds fewer than three cycles.
    """
    slow = uniform_filter1d(x, max(len(x) // 15, 3), mode="mirror")  # a drift hides the vibration
    cycle = max(round(1 / fundamental_frequency(x - slow, 1.0)), 2)
    return x - uniform_filter1d(x, cycle, mode="mirror"), cycle


@dataclass(frozen=True)
class HarmonicSpline:
    """q(t) = Re sum_h Z_h(t) exp(i h phi(t)), with splines Z_h and phi."""

    phase: BSpline
    amplitudes: BSpline  # complex, (H + 1) columns

    @classmethod
    def fit(
        cls, t: Array, x: Array, cycles: float = _CYCLES, centred: Array | None = None
    ) -> HarmonicSpline:
        """Fit to samples (n,) at uniform times t (s); the phase is that of ``centred``, or x."""
        dt = t[1] - t[0]
        if centred is None:
            centred = swing(x)[0]  # an offset may hide crossings
        up = crossings(centred, dt)[0]
        cycle = np.diff(up)
        if np.any(np.abs(cycle / median_filter(cycle, 9) - 1) > _UNEVEN):
            # Noise about as slow as the vibration adds crossings: the fundamental alone has none.
            narrow = 2 * (int(np.median(cycle)) // 4) + 1
            centred = uniform_filter1d(uniform_filter1d(centred, narrow), narrow)
            up = crossings(centred, dt)[0]
        rise = centred[up + 1] - centred[up]  # so may noise, between two samples
        at = t[up] + dt * np.clip(-centred[up] / np.where(rise > 0, rise, np.inf), 0, 1)
        return cls.along(_phase(t, at), t, x, cycles)

    @classmethod
    def along(
        cls, phase: BSpline, t: Array, x: Array, cycles: float, harmonics: int = HARMONICS
    ) -> HarmonicSpline:
        """Fit along a phase that is known, with a knot every so many cycles."""
        n_cycles = (phase(t[-1]) - phase(t[0])) / (2 * np.pi)
        harmonics = min(harmonics, int(0.45 * len(t) / n_cycles))
        knots = _knots(t, max(1, round(n_cycles / cycles)))
        return cls(phase, BSpline(knots, _fitted(t, x, phase(t), knots, harmonics), 3))

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """q, q_dot, q_ddot at times t."""
        h = 1j * np.arange(self.amplitudes.c.shape[1])
        rate, bend = (self.phase(t, d)[:, None] * h for d in (1, 2))
        z, z1, z2 = (self.amplitudes(t, d) for d in (0, 1, 2))
        carrier = np.exp(self.phase(t)[:, None] * h)
        first = z1 + rate * z
        second = z2 + bend * z + rate * z1 + rate * first
        q, q_dot, q_ddot = (np.sum(x * carrier, axis=1).real for x in (z, first, second))
        return q, q_dot, q_ddot

    def midline(self, t: Array) -> Array:
        """Its slow part at times t."""
        return self.amplitudes(t)[:, 0].real

    @property
    def n_values(self) -> int:
        """Number of real values fitted."""
        return len(self.amplitudes.c) * (2 * self.amplitudes.c.shape[1] - 1)


def _knots(t: Array, n: int) -> Array:
    return np.concatenate([[t[0]] * 3, np.linspace(t[0], t[-1], n + 1), [t[-1]] * 3])


def _phase(t: Array, at: Array) -> BSpline:
    """Smooth phase through the times of up-crossings, one turn each."""
    turns = 2 * np.pi * np.arange(len(at))
    slope = [(turns[1] - turns[0]) / (at[1] - at[0]), (turns[-1] - turns[-2]) / (at[-1] - at[-2])]
    at = np.concatenate([[min(t[0], at[0] - 1e-9)], at, [max(t[-1], at[-1] + 1e-9)]])
    turns = np.concatenate(
        [[turns[0] - slope[0] * (at[1] - at[0])], turns, [turns[-1] + slope[1] * (at[-1] - at[-2])]]
    )
    return make_lsq_spline(at, turns, _knots(at, max(1, len(at) // 8)), k=3)


def _fitted(t: Array, x: Array, phase: Array, knots: Array, harmonics: int) -> Array:
    """Complex amplitudes (n_splines, H + 1) by banded normal equations."""
    angle = phase[:, None] * np.arange(1, harmonics + 1)
    waves = np.column_stack([np.ones(len(t)), np.cos(angle), np.sin(angle)])
    splines = BSpline.design_matrix(t, knots, 3).tocsr()
    local = splines.data.reshape(len(t), 4)
    first = splines.indices.reshape(len(t), 4)[:, 0]
    m, n_splines = waves.shape[1], splines.shape[1]
    normal = np.zeros((4 * m, n_splines * m))  # upper band form, lower rows used
    right = np.zeros((n_splines, m))
    for k in range(first[-1] + 1):  # the samples between two knots see the same four splines
        rows = slice(*np.searchsorted(first, [k, k + 1]))
        block = (local[rows, :, None] * waves[rows, None, :]).reshape(-1, 4 * m)
        square = block.T @ block
        right[k : k + 4] += (block.T @ x[rows]).reshape(4, m)
        for j in range(4 * m):
            normal[: 4 * m - j, k * m + j] += square[j:, j]
    # A trace of a ridge: harmonics beyond the sampling of a short piece must not blow up.
    normal[0] += 1e-9 * normal[0].max()
    c = solveh_banded(normal, right.ravel(), lower=True).reshape(n_splines, m)
    z = c[:, : harmonics + 1].astype(complex)
    z[:, 1:] -= 1j * c[:, harmonics + 1 :]
    return z


# Knots of the midline, in cycles: it follows slow noise and leaves the vibration alone. Knots
# farther apart tell how far it can be trusted: what both disagree about is of the
# size of the true error.
MIDLINE, _CHECK = 3.5, 5.0
# Of the amplitude: an end where the midline is known no better is left out, half a cycle at most;
# farther inside it is as good as anywhere.
_SPOILT, _LONGEST = 0.01, 0.5


def displacement(x: Array, dt: float, frequency: float, times: int) -> tuple[Array, slice]:
    """Displacement from one channel (n,), and the samples that the removal of drift leaves sound.

    Arguments as those of `integrate`.
    """
    q = integrate(x, dt, frequency, times)
    check = integrate(x, dt, frequency, times, _CHECK)
    cycle = max(round(1 / (frequency * dt)), 1)
    spoilt = np.abs(q - check) > _SPOILT * np.sqrt(2 * uniform_filter1d(q**2, cycle))
    longest = round(_LONGEST * cycle)
    first = np.flatnonzero(spoilt[:longest])
    last = np.flatnonzero(spoilt[::-1][:longest])
    return q, slice(first[-1] + 1 if len(first) else 0, len(q) - (last[-1] + 1 if len(last) else 0))


def integrate(
    x: Array, dt: float, frequency: float, times: int = 1, cycles: float = MIDLINE
) -> Array:
    """Integrate one channel (n,) of a free decay over time and remove the drift.

    The integration constant, an offset and slow noise of the sensor leave a wandering midline. It
    is the slow part of a sum of harmonics whose amplitudes drift (`HarmonicSpline`), fitted to the
    integral and subtracted: at the ends this is far better than a high-pass filter. The cost: the
    mean of an asymmetric vibration, which a velocity cannot show, is set to zero too.

    ``dt`` in s; ``frequency`` of the slowest vibration, Hz; ``times`` is 1 for a velocity, 2 for an
    acceleration; so many ``cycles`` lie between the knots of the midline.

    Raises a ValueError if the record holds fewer than three cycles.
    """
    t = dt * np.arange(len(x))
    cycle = max(round(1 / (frequency * dt)), 2)
    for _ in range(times):
        x = make_interp_spline(t, x - x.mean(), k=5).antiderivative()(t)
        slow = lowpass(x, dt, 3 * frequency)
        for _ in range(2):
            slow = slow - uniform_filter1d(slow, cycle, mode="mirror")
        x = x - HarmonicSpline.fit(t, x, cycles, slow).midline(t)
    return x


Derivatives = tuple[Array, Array, Array]


class Filter(Protocol):
    """Anything that smooths one channel and differentiates it twice."""

    def __call__(self, q: Array, dt: float) -> Derivatives:
        """Return smoothed q, q_dot, q_ddot, each (n,), from q (n,) sampled every dt seconds."""
        ...


@dataclass(frozen=True)
class Butterworth:
    """Zero-phase Butterworth low-pass, forward and backward, then a quintic spline.

    Parameters
    ----------
    cutoff : float, optional
        Hz; ten times the fundamental by default. At or above 0.45 of the sampling rate nothing
        is filtered.
    order : int
        Order of one pass, 4 in the method's paper.

    Raises
    ------
    ValueError
        If the cut-off or the order is not positive.

    Examples
    --------
    >>> from romsindy import example_decay
    >>> example_decay(40, periods=20).differentiated(Butterworth(cutoff=6.0)).notes
    ('smoothed and differentiated by Butterworth(cutoff=6.0, order=4)',)
    """

    cutoff: float | None = None
    order: int = 4

    def __post_init__(self) -> None:
        if self.cutoff is not None and not self.cutoff > 0:
            raise ValueError(f"cutoff = {self.cutoff!r} must be a positive frequency in Hz")
        if self.order < 1:
            raise ValueError(f"order = {self.order!r} must be at least 1")

    def __call__(self, q: Array, dt: float) -> Derivatives:
        cutoff = self.cutoff or 10 * fundamental_frequency(q, dt)
        smooth = lowpass(q, dt, cutoff, self.order)
        t = dt * np.arange(len(q))
        spline = make_interp_spline(t, smooth, k=5)
        return smooth, spline(t, 1), spline(t, 2)


@dataclass(frozen=True)
class SavitzkyGolay:
    """Local polynomials over a window of samples.

    Parameters
    ----------
    window : int
        Number of samples, odd.
    order : int
        Degree of the polynomials, below the window.

    Examples
    --------
    >>> q, q_dot, q_ddot = SavitzkyGolay(window=21)(np.sin(6 * np.arange(0.0, 5.0, 0.01)), dt=0.01)
    >>> f"{q_dot.max():.2f}, {q_ddot.max():.1f}"
    '6.00, 36.0'
    """

    window: int = 31
    order: int = 5

    def __call__(self, q: Array, dt: float) -> Derivatives:
        if self.window > len(q):
            raise ValueError(
                f"window = {self.window} is longer than the record of {len(q)} samples"
            )
        q0, q1, q2 = (
            savgol_filter(q, self.window, self.order, deriv=d, delta=dt) for d in range(3)
        )
        return q0, q1, q2


HIGHEST = 4  # harmonic of a waveform
_SMOOTH, _DEGREE = 9, 4  # cycles behind each rate, and degree of the polynomial through them


@dataclass(frozen=True)
class Cycles:
    """First harmonic and waveform of the cycles of a vibration, in the order of time."""

    t: Array  # (n,), middle of each cycle, s
    # (n,), of the first harmonic; the angle, in rad, counts on from cycle to cycle
    amplitude: Array
    angle: Array
    waveform: Array  # (n, h): mean, harmonics 2, 3, ... relative to the angle; unit of the signal

    def __len__(self) -> int:
        return len(self.t)

    @classmethod
    def of(cls, t: Array, x: Array, phase: Array) -> Cycles:
        """Demodulate a signal (n,) by a phase (n,) that follows it, in rad.

        Windows of two cycles (Hann) add up to one: no sample is lost, and harmonics do not leak
        into each other while amplitudes change.
        """
        turn = phase / (2 * np.pi)
        first = np.floor(turn).astype(int)
        per_cycle = (len(t) - 1) / (turn[-1] - turn[0])
        orders = np.arange(max(2, min(HIGHEST, int(0.45 * per_cycle)) + 1))
        waves = x[:, None] * np.exp(-1j * phase[:, None] * orders)
        centres = np.arange(int(np.ceil(turn[0])) + 1, int(np.floor(turn[-1])))
        # Every sample belongs to the window that is centred before it, and to the one after it.
        later = np.sin(np.pi / 2 * (turn - first)) ** 2
        at = np.concatenate([first, first + 1]) - centres[0] if len(centres) else np.array([], int)
        weight = np.concatenate([1 - later, later])[: len(at)]
        sample = np.tile(np.arange(len(t)), 2)[: len(at)]
        full = (at >= 0) & (at < len(centres))
        window = csr_array((weight[full], (at[full], sample[full])), (len(centres), len(t)))
        total = window @ np.ones(len(t))
        c = (window @ waves) / total[:, None]
        shift = np.angle(c[:, 1])
        turned = c * np.exp(-1j * shift[:, None] * orders) * np.where(orders, 2, 1)
        return cls(
            (window @ t) / total,
            2 * np.abs(c[:, 1]),
            (window @ phase) / total + np.unwrap(shift),
            np.delete(turned, 1, axis=1),
        )

    def rates(self) -> tuple[Array, Array]:
        """Angular frequency, rad/s, and decay rate, 1/s, of every cycle, smoothed a little."""
        dt = _derivative(self.t)
        return _derivative(self.angle) / dt, -_derivative(np.log(self.amplitude)) / dt


def _derivative(x: Array) -> Array:
    """Change from one cycle to the next."""
    width = min(_SMOOTH, len(x))
    return np.asarray(savgol_filter(x, width, min(_DEGREE, width - 1), deriv=1))
