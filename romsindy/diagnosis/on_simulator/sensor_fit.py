"""Least squares on all sensors: values and effects in a simulator, and how each record begins.

A linear equation of one mode is not asked: the simulator itself is, with a little of each change to
either side. Where another mode is detuned it loses step within few cycles, and no step leads from
there. So first cycles are fitted first, and ever more of them, in which it has ever less to say.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from romsindy.diagnosis.all_sensors import GAINS, FirstMode, Readings, by_gains, detuned
from romsindy.diagnosis.on_simulator.seen import (
    Beginning,
    Failure,
    OnSimulator,
    ValueEffect,
    moved_together,
)
from romsindy.diagnosis.structure import AskedMotion, key_of
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.part import Part, moved_parts, prior_cost, priors
from romsindy.fit.records.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.simulator.simulator import whole
from romsindy.typing import Array

_LARGER = 1e-3  # beginning of a record, for what a change of it does
_STEP = 0.01  # of a value, for what a change of it does
_TURN = 0.02  # radians by which a change of a stated value may turn the slow mode by the end
# Cycles of the first look at all sensors, steps of each at most, and how much longer the next is
_FIRST, _STEPS, _LONGER = 1.0, 6, 2.0
_SHARES = (1.0, 0.5, 0.2)  # of a step: the best is taken
_LITTLE = 0.02  # of chi-square beside noise: what takes off less is no nearer
# Of what values do together: less than this part is an error of differences, a sixth of the square
# of what they turn, and tells nothing of values that do the same
_TOLD = 1e-4


class Now(NamedTuple):
    """A simulated motion: what the sensors read, (n, n_sensors), and how it begins."""

    readings: Array
    start: tuple[float, float]
    release: Beginning
    measured: Readings

    @property
    def left(self) -> Array:
        """What the motion leaves of what was measured, (m,), as cosines over what is not known."""
        own = self.measured
        return own.cosines(own.measured[: len(self.readings)] - self.readings)

    def allowed(self, here: OnSimulator, t: Array) -> Array:
        """What gains of sensors and frequencies of other modes may change, (m, k)."""
        x, t = self.readings, t[: len(self.readings)]
        rung = x - FirstMode.of(here.coordinate(x), x, t).readings
        columns = [*(GAINS * y for y in by_gains(x)), *detuned(rung, t)]
        return self.measured.cosines(np.stack(columns, axis=-1))


class LinearReadings(NamedTuple):
    """What is left of a record, (m,) over the noise, and what it follows, (m, k) each.

    Values of the simulator; the size and the time with which the record begins.
    """

    left: Array
    by_value: Array
    by_start: Array


class FitStep(NamedTuple):
    """A change of all values, and how many times larger each record begins.

    ``variances`` of values are those by all sensors; ``there`` says that none of them changes by
    more than its error.
    """

    change: Array
    larger: Array
    variances: Mapping[tuple[str, str], Array]
    there: bool


class FittedSimulator(NamedTuple):
    """Parts and motions after a step of least squares."""

    parts: tuple[Part, ...]
    now: list[Now]
    step: FitStep

    @property
    def releases(self) -> list[Beginning]:
        """How each record begins."""
        return [n.release for n in self.now]


@dataclass(frozen=True, eq=False)
class SensorFit:
    """A simulator beside what all sensors measured in some records; the first are learnt from."""

    here: OnSimulator
    model: ReducedModel
    records: Sequence[Record]  # of the coordinate
    measured: Sequence[Readings]
    n_training: int

    def grown(
        self, parts: tuple[Part, ...], begins: Sequence[Beginning], longest: float = np.inf
    ) -> FittedSimulator:
        """Parts fitted to the first cycles of all sensors, and to ever more.

        Raises a failure of the simulator where some of them lead to no motion.
        """
        longest = min(longest, max(float(r.t[-1]) for r in self.records))
        end = self.first
        while True:
            now = [*map(whole, self.moved([(self.here, parts, begins)], end)[0])]
            left = self._misfit(parts, now)
            for _ in range(_STEPS):
                parts, now, _ = fitted = self.after_step(parts, now, end)
                last, left = left, self._misfit(parts, now)
                noise = sum(n.left.size for n in now[: self.n_training])
                if last - left < max(_LITTLE * (left - noise), 1.0):
                    break
            begins = fitted.releases
            if end >= longest:
                return fitted
            end *= _LONGER

    @property
    def first(self) -> float:
        """End of the first cycles, s."""
        return float(_FIRST * 2 * np.pi / min(r.rate for r in self.records))

    def after_step(
        self, parts: tuple[Part, ...], now: Sequence[Now], end: float = np.inf
    ) -> FittedSimulator:
        """Parts and motions after a step of least squares, or after the part of it that is best.

        Raises a failure where no part of it leads to a motion.
        """
        step = self._step(parts, now, end)
        tried = [moved_parts(parts, share * step.change) for share in _SHARES]
        asked = [
            (
                self.here,
                there,
                [
                    n.release.larger(n.start, 1 + share * (by - 1))
                    for n, by in zip(now, step.larger, strict=True)
                ],
            )
            for share, there in zip(_SHARES, tried, strict=True)
        ]
        found: list[tuple[float, tuple[Part, ...], list[Now]]] = []
        failed: list[Failure] = []
        for there, moved in zip(tried, self.moved(asked, end), strict=True):
            failed += [m for m in moved if isinstance(m, Failure)]
            own = [m for m in moved if not isinstance(m, Failure)]
            if len(own) == len(now):
                found.append((self._misfit(there, own), there, own))
        if not found:
            whole(failed[0])
        _, there, own = min(found, key=lambda row: row[0])
        return FittedSimulator(there, own, step)

    def moved(
        self,
        asked: Sequence[tuple[OnSimulator, tuple[Part, ...], Sequence[Beginning]]],
        end: float = np.inf,
    ) -> list[list[Now | Failure]]:
        """Motions of the first records with some parts, from where these begin, up to a time.

        All of them are simulated at once.
        """
        questions, measured = [], []
        for there, parts, begins in asked:
            for i, release in enumerate(begins):
                record = self.records[i].until(end)
                equation = equation_of(self.model, parts, i, record)
                assert release.state is not None
                motion = AskedMotion(equation, parts, record, release.state, release)
                questions.append((there, motion))
                measured.append(self.measured[i])
        found: list[Now | Failure] = []
        for m, (_, q), own in zip(moved_together(questions), questions, measured, strict=True):
            if isinstance(m, Failure):
                found.append(m)
            else:
                found.append(Now(m.readings[q.record.derivative], m.start, m.release, own))
        each = iter(found)
        return [[next(each) for _ in begins] for _, _, begins in asked]

    def _misfit(self, parts: Sequence[Part], now: Sequence[Now]) -> float:
        """Chi-square of what motions leave of records to learn from, and of values."""
        left = sum(float(np.sum(n.left**2)) for n in now[: self.n_training])
        return left + prior_cost(parts)

    def _step(self, parts: tuple[Part, ...], now: Sequence[Now], end: float) -> FitStep:
        """A change of all values by least squares on what is left of records, up to a time.

        Beside it each record may begin a little later, or so many times larger, which is second.
        """
        rows = self.linear(now, parts, end)
        n_values = sum(p.size for p in parts)
        change = np.zeros(n_values)
        learnt = rows[: self.n_training]
        for own in (learnt, rows):  # what took no part says how it begins alone
            left: list[Array] = [r.left - r.by_value @ change for r in own]
            matrix = block_diag(*(r.by_start for r in own))
            free = own is learnt
            if free:
                both = told(np.hstack([np.concatenate([r.by_value for r in own]), matrix]))
                prior, off = known_rows(parts, both.shape[1])
                matrix, left = np.vstack([both, prior]), [*left, off]
            # A value that is held, or at its limit, moves nothing: it stays.
            size = np.linalg.norm(matrix, axis=0)
            scale = np.where(size > 0, size, 1.0)
            scaled = matrix / scale
            found = np.linalg.lstsq(scaled, np.concatenate(left))[0] / scale
            if free:
                change = found[:n_values]
                known_to = np.diag(np.linalg.pinv(scaled.T @ scaled, hermitian=True)) / scale**2
        *each, _ = np.split(known_to, np.cumsum([p.size for p in parts], dtype=int))
        variances = {key_of(p): x for p, x in zip(parts, each, strict=True)}
        there = bool(np.all(change**2 <= known_to[:n_values]))
        return FitStep(change, 1 + found[: 2 * len(now) : 2], variances, there)

    def _small(self, part: Part, end: float) -> Array:
        """Changes of the values of a part, for what they do until a time of the records."""
        values = np.where(part.values == 0, 1.0, np.abs(part.values))
        if not isinstance(part.effect, ValueEffect):
            return np.asarray(_STEP * values)
        turned = max(r.rate * min(float(r.t[-1]), end) for r in self.records)
        return np.full(1, _TURN / turned * part.effect.scale)

    def linear(
        self, now: Sequence[Now], parts: tuple[Part, ...], end: float
    ) -> list[LinearReadings]:
        """What readings of each record follow, by simulations with small changes."""
        steps = np.concatenate([np.zeros(0), *(self._small(p, end) for p in parts)])
        # To both sides: values that nearly do the same are told apart by what is left of both.
        changes = [x * one for x, one in zip(steps, np.eye(len(steps)), strict=True)]
        tried = [moved_parts(parts, sign * x) for x in changes for sign in (1, -1)]
        same, larger = ([n.release.larger(n.start, by) for n in now] for by in (1.0, 1 + _LARGER))
        asked = [*((self.here, p, same) for p in tried), (self.here, parts, larger)]
        *moved, begun = [[*map(whole, several)] for several in self.moved(asked, end)]
        rows = []
        for i, n in enumerate(now):
            by_value = [
                (more[i].readings - less[i].readings) / (2 * step)
                for more, less, step in zip(moved[::2], moved[1::2], steps, strict=True)
            ]
            by_size = (begun[i].readings - n.readings) / _LARGER
            later = np.gradient(n.readings, self.records[i].decay.dt, axis=0)
            table = n.measured.cosines(np.stack([*by_value, by_size, later], axis=-1))
            rows.append(LinearReadings(n.left, table[:, :-2], table[:, -2:]))
        return rows


def known_rows(parts: Sequence[Part], unknowns: int) -> tuple[Array, Array]:
    """What is known of values beforehand as rows of least squares, (k, unknowns), and what is left.

    Values of all parts are the first of the unknowns.
    """
    known = priors(parts)
    rows = np.zeros((len(known), unknowns))
    for row, (at, _, spread) in zip(rows, known, strict=True):
        row[at] = 1 / spread
    return rows, np.array([off / spread for _, off, spread in known])


def told(columns: Array) -> Array:
    """Columns (m, k) without what they do together that is no more than their error.

    Stiffness, density and an added mass in proportion leave every motion as it is. Beside what is
    left of strong records the little that differences make of it would outdo what is known of them.
    """
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    u, s, vt = np.linalg.svd(columns / size, full_matrices=False)
    return np.asarray((u * np.where(s > _TOLD * s[0], s, 0.0)) @ vt * size)
