"""What the channels of a record show of every term, window by window.

Linear oscillators with the frequency and damping of small vibrations stand in for the coordinates.
What a term contributes to the record is the response of the oscillators to it as a force; in a
window of a few cycles any free motion of the oscillators is added. No signal is differentiated.
Records are decays of several coordinates, or forced vibrations of one: there an input is a column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import cont2discrete, lfilter, ss2tf

from romsindy.fit.records.coupled import CoupledRecord
from romsindy.fit.records.driven import ForcedRecord
from romsindy.physics.input import Input
from romsindy.physics.term import Term
from romsindy.record.forced import ForcedVibration
from romsindy.record.ridges import Ridge
from romsindy.typing import Array

# Steps in a cycle of the fastest coordinate: between them forces are straight lines, which misses
# (2 pi / 80)^2 / 12 = 5e-4 of a force of that frequency.
_STEPS = 80
# Of the way to the motion that the model gives: with all of it long windows overshoot.
_STEP = 0.7


class Oscillators(NamedTuple):
    """q_ddot + damping q_dot + omega^2 q = force for each coordinate."""

    # (R,), rad/s and 1/s
    omega: Array
    damping: Array

    @classmethod
    def of(cls, records: Sequence[CoupledRecord]) -> Oscillators:
        """Those of small vibrations, in the mean of the records."""
        small = np.array([[_small(tone) for tone in record.tones] for record in records])
        return cls(*small.mean(axis=0).T)

    def restoring(self, motion: Array) -> Array:
        """damping q_dot + omega^2 q, (n, R), of a motion (3, n, R)."""
        return self.omega**2 * motion[0] + self.damping * motion[1]

    def forced(self, force: Array, step: float) -> Array:
        """q, q_dot, q_ddot from rest, (3, n, R), under forces (n, R) every ``step`` s."""
        found = []
        for f, omega, damping in zip(force.T, self.omega, self.damping, strict=True):
            rates = np.array([[0.0, 1.0], [-(omega**2), -damping]])
            system = (rates, np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1)))
            above, below = ss2tf(*cont2discrete(system, step, method="foh")[:4])
            q, q_dot = (lfilter(b, below, f) for b in above)
            found.append([q, q_dot, f - damping * q_dot - omega**2 * q])
        return np.moveaxis(np.array(found), 0, -1)

    def free(self, t: Array) -> Array:
        """q, q_dot, q_ddot of both free motions of every coordinate, (3, n, R, 2)."""
        rate = -self.damping / 2 + 1j * np.sqrt(self.omega**2 - self.damping**2 / 4)
        turning = np.exp(t[:, None] * rate)
        moved = np.array([turning * rate**k for k in range(3)])
        return np.stack([moved.real, moved.imag], axis=-1)


def _small(tone: Ridge) -> tuple[float, float]:
    """rad/s and 1/s, as the quietest third of a tone, and its decay as a whole, show them."""
    quiet = np.argsort(tone.amplitude)[: max(len(tone.t) // 3, 1)]
    log = np.log(np.maximum(tone.amplitude, 1e-300))
    fall = -2 * np.polyfit(tone.t, log, 1)[0] if len(tone.t) > 1 else 0.0
    return 2 * np.pi * float(tone.frequency[quiet].mean()), max(float(fall), 0.0)


class WindowRows(NamedTuple):
    """Rows of the regression theta c = target: samples of all channels in all windows."""

    # (n_rows, n_terms), (n_rows,), what the channels show of the terms as forces, and of -q_ddot;
    # free motions projected out
    theta: Array
    target: Array
    window: NDArray[np.intp]  # (n_rows,)

    @staticmethod
    def stacked(parts: Sequence[WindowRows]) -> WindowRows:
        """Rows of several records, windows numbered through."""
        starts = np.cumsum([0] + [p.window[-1] + 1 for p in parts[:-1]])
        window = np.concatenate([p.window + s for p, s in zip(parts, starts, strict=True)])
        return WindowRows(
            np.concatenate([p.theta for p in parts]),
            np.concatenate([p.target for p in parts]),
            window,
        )


@dataclass(frozen=True)
class WindowMotion:
    """A record with what is known so far of the motion of its coordinates."""

    record: CoupledRecord | ForcedRecord
    # What has the inputs; then the sensor may have an offset, too
    vibration: ForcedVibration | None
    shapes: Array  # (c, R), what each channel shows of each coordinate
    oscillators: Oscillators
    scale: Array  # (c,), what samples of each channel are divided by: its noise
    factor: int  # steps of the motion in an interval of the samples
    width: int  # samples of a window
    motion: Array  # (3, n, R), q, q_dot, q_ddot at the steps

    @classmethod
    def of(
        cls,
        record: CoupledRecord | ForcedRecord,
        vibration: ForcedVibration | None,
        shapes: Array,
        oscillators: Oscillators,
        cycles: float,
        weighted: bool,
    ) -> WindowMotion:
        """Start from the motion of the record, windows of so many of the longest cycles."""
        scale = np.array([noise.std if weighted else 1.0 for noise in record.noises])
        dt, rate = record.decay.dt, oscillators.omega / (2 * np.pi)
        factor = int(np.ceil(_STEPS * rate.max() * dt))
        width = min(round(cycles / (rate.min() * dt)), len(record.t))
        grid, q, q_dot = record.motion.grid, record.motion.q, record.motion.q_dot
        motion_at = CubicHermiteSpline(grid.start + grid.step * np.arange(len(q)), q, q_dot)
        t = dt / factor * np.arange(factor * (len(record.t) - 1) + 1)
        motion = np.array([motion_at(t, k) for k in range(3)])
        return cls(record, vibration, shapes, oscillators, scale, factor, width, motion)

    @property
    def amplitude(self) -> Array:
        """Largest displacement of the coordinates in each window."""
        return np.array([np.abs(self.motion[0, steps]).max() for _, steps in self._windows])

    def rows(self, terms: Sequence[Term]) -> WindowRows:
        """What the channels show of the terms, and of -q_ddot."""
        shown = [self._shown(self._forced(-self._strong(term))) for term in terms]
        restored = self._shown(self._forced(self.oscillators.restoring(self.motion)))
        table = np.stack([*shown, self._measured - restored], axis=-1)
        basis = np.linalg.qr(np.column_stack([self._free, *self._offset]))[0]
        found = []
        for samples, _ in self._windows:
            own = table[:, samples].reshape(len(basis), -1)
            found.append(own - basis @ (basis.T @ own))
        rows = np.concatenate(found)
        window = np.repeat(np.arange(len(found)), [len(x) for x in found])
        return WindowRows(rows[:, :-1], rows[:, -1], window)

    def following(self, terms: Sequence[Term], coef: Array) -> WindowMotion:
        """With a motion nearer to that of a model, which in each window follows the channels."""
        total = np.zeros_like(self.motion[0])
        for term, c in zip(terms, coef, strict=True):
            total += c * self._strong(term)
        forced = self._forced(self.oscillators.restoring(self.motion) - total)
        left = self._measured - self._shown(forced)
        moved, weight = np.zeros_like(forced), np.zeros((forced.shape[1], 1))
        n = self.factor * (self.width - 1) + 1
        free = self.oscillators.free(self.record.decay.dt / self.factor * np.arange(n))
        fade = np.sin(np.pi * (np.arange(n) + 0.5) / n)[:, None] ** 2
        start = np.linalg.pinv(np.column_stack([self._free, *self._offset]))
        start = start[: self._free.shape[1]]
        for samples, steps in self._windows:
            own = (start @ left[:, samples].ravel()).reshape(-1, 2)
            moved[:, steps] += fade * (forced[:, steps] + np.einsum("knrj,rj->knr", free, own))
            weight[steps] += fade
        return replace(self, motion=self.motion + _STEP * (moved / weight - self.motion))

    @property
    def mode_shapes(self) -> Array:
        """What the channels show of the motion, (c, R); 1 in the main channel of a coordinate."""
        moved = self.motion[self.record.derivative, :: self.factor]
        shapes = np.linalg.lstsq(moved, self._measured.T, rcond=None)[0].T * self.scale[:, None]
        main = np.argmin(np.abs(self.shapes - 1), axis=0)
        return shapes / shapes[main, range(len(moved.T))]

    def _strong(self, term: Term) -> Array:
        """A term on the left side of the equations, (n, R)."""
        vibration = self.vibration
        if vibration is None or not isinstance(term, Input):
            return term.strong(*self.motion)
        u = vibration.u[:, vibration.names.index(term.source)]
        place = np.arange(self.motion.shape[1]) / self.factor - term.delay / vibration.dt
        # Where a held input jumps, the mean of both sides.
        before, after = (term.at(u, place + x, vibration.dt) for x in (-1e-6, 1e-6))
        return -term.sign * (before + after)[:, None] / 2

    @property
    def _measured(self) -> Array:
        """Channels over their noise, (c, n)."""
        return self.record.signal.reshape(len(self.scale), -1) / self.scale[:, None]

    @property
    def _shapes(self) -> Array:
        return self.shapes / self.scale[:, None]

    def _forced(self, force: Array) -> Array:
        return self.oscillators.forced(force, self.record.decay.dt / self.factor)

    def _shown(self, motion: Array) -> Array:
        """What the channels show of a motion, over their noise, (c, n)."""
        return self._shapes @ motion[self.record.derivative, :: self.factor].T

    @cached_property
    def _free(self) -> Array:
        """What they show of the free motions in a window, (c w, 2 R)."""
        free = self.oscillators.free(self.record.decay.dt * np.arange(self.width))
        shown = np.einsum("cr,nrk->cnrk", self._shapes, free[self.record.derivative])
        return shown.reshape(len(self.scale) * self.width, -1)

    @property
    def _offset(self) -> list[Array]:
        """An offset of the sensor, where that is free: (w,) or nothing."""
        return [np.ones(self.width)] if self.vibration is not None else []

    @cached_property
    def _windows(self) -> list[tuple[slice, slice]]:
        """Samples and steps of windows that overlap by half."""
        last = len(self.record.t) - self.width
        starts = [*range(0, last, max(self.width // 2, 1)), last]
        ends = [(start, start + self.width) for start in starts]
        return [(slice(a, b), slice(a * self.factor, (b - 1) * self.factor + 1)) for a, b in ends]
