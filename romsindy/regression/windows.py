"""Rows of windows of a few cycles: several coordinates, or one under inputs, by regression.

What the channels of a record show of every term, window by window.

Linear oscillators with the frequency and damping of small vibrations stand in for the coordinates.
What a term contributes to the record is the response of the oscillators to it as a force; in a
window of a few cycles any free motion of the oscillators is added. No signal is differentiated.
Records are decays of several coordinates, or forced vibrations of one: there an input is a column.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pysindy.optimizers.base import BaseOptimizer
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import cont2discrete, lfilter, ss2tf
from sklearn.base import BaseEstimator

from romsindy.fit.records.arguments import require_unit, small_frequencies
from romsindy.fit.records.coupled import CoupledRecord, coupled_records
from romsindy.fit.records.driven import ForcedRecord, inputs_in, refuse_displacement
from romsindy.fit.records.driven import regressed as regressed_about_motion
from romsindy.fit.records.record import NUMERICS
from romsindy.fit.records.smooth import ways
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.damping import PowerDamping
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.ridges import Ridge
from romsindy.record.ringing import names_of, require_channels, ringing_in
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
        motion_at = CubicHermiteSpline(grid.ends, q, q_dot)
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


# A known omega^2 is refused where it is so many times that of the vibration, or less.
_FAR = 10.0
# Rounds end where another changes what is left by less than this part.
_SETTLED = 1e-3
# A motion runs away where it is so many times as large as the measured one.
_AWAY = 10.0
# Damping of the oscillators that stand in for a driven motion, over their frequency.
_LEAST_DAMPING, _MOST_DAMPING = 0.01, 0.5

Solve = Callable[[Sequence[Term], WindowRows], BaseOptimizer]


@dataclass(eq=False, repr=False)
class WindowProjection(BaseEstimator):
    """Compare terms with the channels, in windows of a few cycles.

    The motion of several coordinates, or under inputs, repeats itself in no cycle. So the windows
    hold some cycles of the slowest, and overlap by half. A term, as a force on linear oscillators,
    contributes what the channels show of their response; free motions of the oscillators are
    projected out in every window. This is -q_ddot = sum of terms with both sides filtered alike,
    and reads displacement, velocity or acceleration as it was measured. All R equations stand in
    each row: a coefficient that they share is one column.

    Terms are evaluated on the motion of the coordinates, which at first is that of the followed
    vibrations; each round replaces it by that of the model found, which in every window follows the
    channels. Harmonics, and what coordinates show of each other, come in by that.

    Parameters
    ----------
    cycles : float
        Length of a window in cycles of the slowest coordinate, at least 2. Long windows tell small
        terms better, and may not settle where motions are strongly nonlinear.
    rounds : int
        Regressions at most, at least 1; the one that leaves least is kept.

    Examples
    --------
    >>> from romsindy import Decay, HarmonicSINDy, ROMLibrary
    >>> t, windows = np.arange(0.0, 10.0, 0.02), WindowProjection(cycles=4)
    >>> decay = Decay(t, np.exp(-0.1 * t) * (np.cos(6 * t) + 0.5 * np.cos(15 * t)))
    >>> model = HarmonicSINDy(ROMLibrary((), (1,), modes=2), projection=windows).fit(decay).model_
    >>> round(model.coefficients["omega^2 [q1]"], 1), round(model.coefficients["omega^2 [q2]"], 1)
    (36.0, 225.0)
    """

    cycles: float = 6.0
    rounds: int = 20

    def check(self) -> None:
        """Refuse settings that mean nothing.

        Raises a ValueError if ``cycles`` or ``rounds`` is too small.
        """
        if not self.cycles >= 2:
            raise ValueError(f"cycles = {self.cycles!r} must be at least 2")
        if isinstance(self.rounds, bool) or self.rounds != int(self.rounds) or self.rounds < 1:
            raise ValueError(f"rounds = {self.rounds!r} must be a whole number of at least 1")


class Regression(NamedTuple):
    """The best of several rounds; ``left`` is the mean square of what it leaves of its rows."""

    left: float
    optimizer: BaseOptimizer  # fitted
    terms: tuple[Term, ...]  # of the columns; inputs come last
    rows: WindowRows
    shapes: Array  # (c, R), what channels show of coordinates

    @property
    def kept(self) -> dict[Term, float]:
        """Terms whose coefficients are not 0."""
        pairs = zip(self.terms, self.optimizer.coef_[0].tolist(), strict=True)
        return {term: value for term, value in pairs if value}


def regressed(
    terms: Sequence[Term],
    decays: Sequence[Decay],
    projection: WindowProjection,
    solve: Solve,
    known: Mapping[str, float],
    weighted: bool = True,
) -> tuple[CoupledModel, Regression]:
    """Find coefficients of terms of several coordinates, in rounds: the model, and the best round.

    Decays have one channel or several, in one unit; ``solve`` makes a fitted optimizer of terms and
    rows, and holds fixed what is ``known`` by name. Where ``weighted``, each channel is divided by
    its noise.

    Raises a ValueError if the decays have different channels, fewer vibrations ring than the terms
    have coordinates, a known stiffness is far from theirs, or none is left of a coordinate.
    """
    projection.check()
    require_channels(decays, decays[0].n_channels)
    modes = CoupledModel(tuple(terms), (0.0,) * len(terms)).n_coordinates
    free = [decay.free() for decay in decays]
    records = coupled_records(free, _ringing(free, modes), NUMERICS)
    followed = _followed(records, projection, weighted)
    _refuse_far(known, followed[0].oscillators.omega)
    best = _in_rounds(followed, terms, projection.rounds, solve)
    kept = best.kept
    held = {t.key for t, c in kept.items() if c > 0}
    lost = [k for i in range(modes) if (k := f"omega^2 [q{i + 1}]") not in held]
    if lost:
        raise ValueError(
            f"the regression has left no positive {lost[0]}: ask for stiffness of degree 1, lower"
            " the threshold of the optimizer, or use fewer terms"
        )
    unit = decays[0].unit
    return CoupledModel(tuple(kept), tuple(kept.values()), unit, _reach(followed)), best


def regressed_forced(
    terms: Sequence[Term],
    vibrations: Sequence[ForcedVibration],
    projection: WindowProjection,
    solve: Solve,
    weighted: bool = True,
) -> tuple[ReducedModel, Regression]:
    """Find coefficients of terms and gains of inputs, in rounds: the model, and the best round.

    Where nothing says what inputs do between their samples, it is what leaves least.

    Raises a ValueError if records have different units, an input looks like the displacement of the
    base, or the optimizer has dropped it.
    """
    projection.check()
    require_unit(vibrations, vibrations[0].unit)
    followed = _followed_forced(vibrations, projection, weighted)
    every = ((*terms, *inputs_in(vibrations, way)) for way in ways(vibrations))
    tried = [_in_rounds(followed, some, projection.rounds, solve) for some in every]
    best = min(tried, key=lambda rounds: rounds.left)
    _refuse_lost_inputs(best.terms, best.optimizer.coef_[0].tolist())
    kept = best.kept
    unit = vibrations[0].unit
    return ReducedModel(tuple(kept), tuple(kept.values()), unit, _reach(followed)), best


def _refuse_lost_inputs(terms: Sequence[Term], coef: Sequence[float]) -> None:
    for term, value in zip(terms, coef, strict=True):
        if isinstance(term, Input):
            refuse_displacement([term], [value])
            if not value:
                raise ValueError(
                    f"the regression has left no {term.key!r}: lower the optimizer's threshold, or"
                    " leave out the input"
                )


def _in_rounds(
    followed: Sequence[WindowMotion], terms: Sequence[Term], rounds: int, solve: Solve
) -> Regression:
    """Regress, follow the motion of the model found, and so on until nothing changes."""
    sizes, best = _sizes(followed), None
    for _ in range(rounds):
        rows = WindowRows.stacked([record.rows(terms) for record in followed])
        optimizer = solve(terms, rows)
        coef = optimizer.coef_[0]
        left = float(np.mean((rows.target - rows.theta @ coef) ** 2))
        settled = best is not None and abs(left - best.left) < _SETTLED * left
        if best is None or left < best.left:
            best = Regression(left, optimizer, tuple(terms), rows, followed[0].shapes)
        if settled:
            break
        followed = [record.following(terms, coef) for record in followed]
        if _runs_away(followed, sizes):
            break
        if len(followed[0].shapes) > 1:
            shapes = np.mean([record.mode_shapes for record in followed], axis=0)
            followed = [replace(record, shapes=shapes) for record in followed]
    assert best is not None
    return best


def _rows_about(
    followed: Sequence[WindowMotion], terms: Sequence[Term], coef: Array, rounds: int
) -> WindowRows:
    """Rows about the motion of a model that is known, where it leaves least of them."""
    sizes, found = _sizes(followed), []
    for _ in range(rounds):
        found.append(WindowRows.stacked([record.rows(terms) for record in followed]))
        followed = [record.following(terms, coef) for record in followed]
        if _runs_away(followed, sizes):
            break
    return min(found, key=lambda rows: float(np.sum((rows.target - rows.theta @ coef) ** 2)))


def rows_of(
    model: CoupledModel,
    decays: Sequence[Decay],
    projection: WindowProjection,
    mode_shapes: Array,
    weighted: bool = True,
) -> WindowRows:
    """Rows of a model that is known, for decays that may be others than those it came from.

    Raises a ValueError if a decay has other channels, or nothing rings near a mode of the model.
    """
    require_channels(decays, len(mode_shapes))
    main = [int(np.argmin(np.abs(column - 1))) for column in mode_shapes.T]
    found = [CoupledRecord.of(d.free(), small_frequencies(model), NUMERICS, main) for d in decays]
    records = [replace(record, shapes=mode_shapes) for record in found]
    followed = _followed(records, projection, weighted)
    return _rows_about(followed, model.terms, np.array(model.values), projection.rounds)


def rows_of_forced(
    model: ReducedModel,
    vibrations: Sequence[ForcedVibration],
    projection: WindowProjection,
    weighted: bool = True,
) -> WindowRows:
    """Rows of a model that is known, for records that may be others than those it came from."""
    followed = _followed_forced(vibrations, projection, weighted)
    return _rows_about(followed, model.terms, np.array(model.values), projection.rounds)


def _sizes(followed: Sequence[WindowMotion]) -> Array:
    """Largest displacement of a coordinate in each window of all records."""
    return np.concatenate([record.amplitude for record in followed])


def _reach(followed: Sequence[WindowMotion]) -> tuple[float, float]:
    """Least and largest of these."""
    sizes = _sizes(followed)
    return float(sizes.min()), float(sizes.max())


def _runs_away(followed: Sequence[WindowMotion], sizes: Array) -> bool:
    """Whether a model has led the motion far from what was measured; also where it is nan."""
    return not bool(_sizes(followed).max() < _AWAY * sizes.max())


def _ringing(decays: Sequence[Decay], modes: int) -> Array:
    """Frequencies, Hz, of the strongest vibrations of the ringing_in channel, lowest first."""
    most = ringing_in(decays)
    if len(most) < modes:
        raise ValueError(
            f"modes = {modes}, but what rings in the record is {names_of(most)}: ask for so many"
            " modes, or excite the others more"
        )
    return np.sort([v.small_frequency for v in most[:modes]])


def _refuse_far(known: Mapping[str, float], omega: Array) -> None:
    """Linear stiffness in other units than the data stands out by orders of magnitude."""
    for i, rate in enumerate(omega):
        value = known.get(f"omega^2 [q{i + 1}]", rate**2)
        if not 1 / _FAR < value / rate**2 < _FAR:
            raise ValueError(
                f"fixed['omega^2 [q{i + 1}]'] = {value:.6g} 1/s^2 contradicts the data, where that"
                f" coordinate has omega^2 = {rate**2:.4g}: omega^2 is in (rad/s)^2, 39.5 times Hz^2"
            )


def _followed(
    records: Sequence[CoupledRecord], projection: WindowProjection, weighted: bool
) -> list[WindowMotion]:
    given = Oscillators.of(records), projection.cycles, weighted
    return [WindowMotion.of(record, None, record.shapes, *given) for record in records]


def _followed_forced(
    vibrations: Sequence[ForcedVibration], projection: WindowProjection, weighted: bool
) -> list[WindowMotion]:
    records = [ForcedRecord.of(v, NUMERICS) for v in vibrations]
    given = _oscillators(records), projection.cycles, weighted
    return [WindowMotion.of(record, record.decay, np.ones((1, 1)), *given) for record in records]


def _oscillators(records: Sequence[ForcedRecord]) -> Oscillators:
    """The linear oscillator that comes nearest to the motions."""
    inputs = inputs_in([record.decay for record in records], "band-limited")
    linear = (Stiffness(1), PowerDamping(1))
    (stiffness, damping), _ = regressed_about_motion(linear, inputs, records)
    omega = float(np.sqrt(stiffness)) if stiffness > 0 else np.mean([r.rate for r in records])
    damping = np.clip(damping, _LEAST_DAMPING * omega, _MOST_DAMPING * omega)
    return Oscillators(np.array([omega]), np.array([damping]))
