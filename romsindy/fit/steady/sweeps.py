"""Sweeps of frequency, up and down, as steady states: without their lag, and with their jumps.

A sweep at a steady rate is late. Where it follows a branch, the motion lags behind the orbit of its
frequency, to first order by what the change of the orbit needs in force. Where the branch ends in a
fold it jumps, late (`romsindy.orbits.sweeps`): the fold is where it jumped less that delay, within
the distance of two rows. At a fold the force does not change with the amplitude, so it says which
force an orbit needs that folds at this frequency. Both follow from a model, and are repeated with
the next one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from romsindy.fit.steady.balance import SteadyPoints
from romsindy.fit.steady.solve import SteadySolution
from romsindy.orbits.continuation import ContinuationError
from romsindy.orbits.curves import forced_response
from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.orbits.sweeps import LATE, jumps
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array, Indices

CREEP = 0.05  # of the largest velocity, below which dry friction creeps in a response
_FEWEST = 12  # rows of a sweep
_ROWS = 3  # over which a change is a jump, if it is so many times that of as many before it
_STEEPER = 2.0
_UNKNOWN = 3, 8  # rows before and after a jump that do not count, before there is a model
_SETTLES = 7.0  # decay times after the start and after a jump
_EARLY = 2.5  # delays before a jump, in which the lag is not small
_LARGEST = 0.2  # lag, as a part of the amplitude
_SIGMAS = 3.0  # of the noise, within which no fold may be
_AROUND = 0.4, 1.8, 141  # amplitudes of a fold over that before its jump
_MARGIN, HARMONICS, _ORBITS, _NEWTON = 0.05, 5, 60, 5
_SCATTER = 10  # rows on each side by whose scatter a noise is told


@dataclass(frozen=True, eq=False)
class SweptRows:
    """One sweep: its rows, and between which of them it jumps."""

    rows: Indices  # in the order of time
    rate: float  # rad/s^2, negative where the frequency falls
    last: int | None = None  # row before the jump
    jump: float = np.nan  # rad/s, in the middle between two rows
    std: float = np.nan


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Sweeps known by amplitude, one after the other."""

    points: SteadyPoints
    each: tuple[SweptRows, ...]

    @classmethod
    def of(cls, points: SteadyPoints, rate: ArrayLike) -> Sweeps:
        """Sweeps of which the rate is known, rad/s^2, or (n,) with its sign.

        Raises a ValueError if the rate is not positive, or has no sign where it must; if phases are
        given; if the order of the points says no direction.
        """
        if points.phased:
            raise ValueError(
                "response is complex, and sweeps are known by their amplitude: give abs(response),"
                " or leave out sweep_rate for a slow, stepped sine"
            )
        signed = np.asarray(rate, float)
        if signed.ndim:
            if signed.shape != (len(points),) or not np.all(np.isfinite(signed) & (signed != 0)):
                raise ValueError(
                    f"sweep_rate must be a number, or {len(points)} that are finite and not 0:"
                    " positive where the frequency rises, in rad/s^2"
                )
            order = np.lexsort((np.sign(signed) * points.frequency, -signed, points.level))
            points, signed = points.some(order), signed[order]
        elif not 0 < signed < np.inf:
            raise ValueError(
                f"sweep_rate = {rate!r} must be positive and finite, in rad/s^2: whether a sweep"
                " rises or falls follows from the order of its points"
            )
        size = np.abs(np.broadcast_to(signed, len(points)))
        found = []
        for rows in _in_order(points):
            way = np.sign(points.frequency[rows[1]] - points.frequency[rows[0]])
            found.append(_with_jump(points, SweptRows(rows, float(way * size[rows[0]]))))
        if not np.any(points.std):
            points = replace(points, std=_scatter(points))
        return cls(points, tuple(found))

    def started(self) -> SteadyPoints:
        """What may be steady, before there is a model."""
        keep = np.ones(len(self.points), bool)
        before, after = _UNKNOWN
        for sweep in self.each:
            keep[sweep.rows[:before]] = False
            if sweep.last is not None:
                keep[max(sweep.last - before, sweep.rows[0]) : sweep.last + after] = False
        return self.points.some(keep)

    def steady(self, solution: SteadySolution, folded: bool) -> tuple[SteadyPoints, list[str]]:
        """Points without their lag and, if so said, folds; and notes on jumps that are none."""
        points, w = self.points, self.points.frequency.copy()
        rate, std, q = np.zeros(len(w)), np.zeros(len(w)), points.q.copy()
        for sweep in self.each:
            rate[sweep.rows] = sweep.rate
        balance = HarmonicBalance(solution.model, HARMONICS)
        c, force = orbits_of(balance, w, points.amplitude)
        lag, decay = _lag(balance, c, w, rate)
        off = _SIGMAS * points.std[:, 0]
        less, more = (orbits_of(balance, w, points.amplitude + x)[1] for x in (-off, off))
        keep = (np.abs(lag) < _LARGEST * points.amplitude) & ((more - force) * (force - less) > 0)
        q[:, 0] -= lag
        notes = []
        for sweep in self.each:
            rows, last = sweep.rows, sweep.last
            jumped = rows > (np.inf if last is None else last)
            time = (points.frequency[rows] - np.where(jumped, sweep.jump, w[rows[0]])) / sweep.rate
            keep[rows] &= time * decay[rows] > _SETTLES
            late = self._late(sweep, solution)
            if last is None:  # a jump that is hardly one is not seen as such
                for fold, delay in late:
                    since = (points.frequency[rows] - fold - delay) / sweep.rate
                    keep[rows] &= (-since > _EARLY * delay / sweep.rate) | (
                        since * decay[rows] > _SETTLES
                    )
                continue
            size, delay = self._fold(sweep, last, solution, late)
            early = (sweep.jump - points.frequency[rows]) / sweep.rate
            keep[rows] &= jumped | (early > _EARLY * abs(delay / sweep.rate))
            if size and folded:
                keep[last], q[last, 0], w[last] = True, size, sweep.jump - delay
                std[last] = np.hypot(sweep.std, LATE * delay)
            elif not size:
                notes.append(
                    f"at {sweep.jump / (2 * np.pi):.6g} Hz the amplitude changes as in a jump,"
                    f" where the model has none at {abs(points.force[last]):.3g}: it took no part"
                )
        return replace(points, q=q, frequency=w, frequency_std=std).some(keep), notes

    def _late(self, sweep: SweptRows, solution: SteadySolution) -> list[tuple[float, float]]:
        """Folds that the model passes in a sweep, and delays of the jumps there, rad/s."""
        points = self.points
        size = float(np.abs(solution.chain.force(points.force[sweep.rows[:1]]))[0])
        w = points.frequency[points.level == points.level[sweep.rows[0]]]
        ends = float(w.min() * (1 - _MARGIN)), float(w.max() * (1 + _MARGIN))
        model = smoothed(solution.model, points)
        try:
            response = forced_response(model, size, ends, HARMONICS, n_points=_ORBITS)
        except ContinuationError:  # no response of such a model there: nor a fold
            return []
        late = jumps(model, response, sweep.rate)
        return [(float(response.frequency[one.fold]), one.delay) for one in late]

    def _fold(
        self,
        sweep: SweptRows,
        last: int,
        solution: SteadySolution,
        late: Sequence[tuple[float, float]],
    ) -> tuple[float, float]:
        """Amplitude at a fold, 0 where the model has none, and the delay of the jump, rad/s."""
        if not late:
            return 0.0, 0.0
        points = self.points
        _, delay = min(late, key=lambda one: abs(sum(one) - sweep.jump))
        # At the frequency of a fold, the force that an orbit needs turns round with its amplitude.
        before, after = points.amplitude[last : last + 2]
        sizes = before * np.linspace(*_AROUND)
        balance = HarmonicBalance(solution.model, HARMONICS)
        force = orbits_of(balance, np.full(len(sizes), sweep.jump - delay), sizes)[1]
        growth = np.sign(after - before) * np.diff(force)
        turns = np.flatnonzero((growth[:-1] > 0) & (growth[1:] <= 0)) + 1
        size = min(sizes[turns], key=lambda x: abs(np.log(x / before)), default=0.0)
        return float(size), delay


def smoothed(model: ReducedModel, points: SteadyPoints) -> ReducedModel:
    """A model whose dry friction does not jump, for responses of the size of the points."""
    return model.regularised(CREEP * float(np.max(points.frequency * points.amplitude)))


def _in_order(points: SteadyPoints) -> list[Indices]:
    """The runs of the points, of which each is a sweep."""
    for rows in (found := points.runs):
        if len(rows) < _FEWEST:
            raise ValueError(
                f"sweep_rate is given, but from {points.frequency[rows[0]] / (2 * np.pi):.6g} Hz at"
                f" a force of {abs(points.force[rows[0]]):.3g} the frequency neither rises nor"
                f" falls over {_FEWEST} points: give the points of a sweep in the order of time,"
                " one sweep after the other, or a signed rate for every point"
            )
    return found


def _with_jump(points: SteadyPoints, sweep: SweptRows) -> SweptRows:
    """The same with its jump, if some rows differ by far more than as many before them do."""
    rows = sweep.rows
    x, w = (points.amplitude * points.frequency**points.rate)[rows], points.frequency[rows]
    change = x[_ROWS:] - x[:-_ROWS]
    at = int(np.argmax(np.abs(change)))
    if at < 2 * _ROWS or abs(change[at]) < _STEEPER * np.abs(change[: at - _ROWS]).max():
        return sweep
    last = at + int(np.argmax(np.sign(change[at]) * np.diff(x[at : at + _ROWS + 1])))
    middle, wide = (w[last] + w[last + 1]) / 2, abs(w[last + 1] - w[last])
    return replace(sweep, last=int(rows[last]), jump=float(middle), std=float(wide / np.sqrt(12)))


def _scatter(points: SteadyPoints) -> Array:
    """Noise, (n, 1), by third differences of the rows nearby."""
    third = np.pad(np.abs(np.diff(points.amplitude, 3)) / np.sqrt(20), (2, 1), "edge")
    near = np.lib.stride_tricks.sliding_window_view(
        np.pad(third, _SCATTER, "edge"), 2 * _SCATTER + 1
    )
    return (np.median(near, axis=1) / 0.6745)[:, None]  # of a normal distribution


def orbits_of(balance: HarmonicBalance, omega: Array, amplitude: Array) -> tuple[Array, Array]:
    """Orbits of these amplitudes, (n, 2 H + 1), and the force that they need, (n,)."""
    c = np.zeros((len(omega), 2 * balance.n_harmonics + 1))
    c[:, 1] = amplitude
    others = np.delete(np.arange(c.shape[1]), [1, 2])
    for _ in range(_NEWTON):
        force, by_c, _ = balance.linearise(c[..., None], omega)
        step = np.linalg.solve(by_c[:, others[:, None], others], force[:, others, None])
        c[:, others] -= step[..., 0]
    return c, np.linalg.norm(force[:, 1:3], axis=1)


def _lag(balance: HarmonicBalance, c: Array, omega: Array, rate: Array) -> tuple[Array, Array]:
    """By how much amplitudes exceed those of orbits, (n,), and how fast what is off decays, 1/s."""
    _, by_c, by_omega = balance.linearise(c[..., None], omega)
    by_rate = balance.by_rate(c[..., None], omega)
    change = -np.linalg.solve(by_c, (rate[:, None] * by_omega)[..., None])
    off = -np.linalg.solve(by_c, by_rate @ change)[..., 0]
    return off[:, 1], by_rate[:, 0, 0] / 2  # the mean of the damping
