"""Two noises of one record: a force that nobody measured, and that of the sensor, with a colour.

    model(q, q_dot, q_ddot) = inputs + w(t)        w: white, of some intensity on each coordinate
    y = reading(q) + n                             n: each sample keeps a part of the one before it

A force that is not known moves the state a little at every step, and the linearised equation
carries that on. What is left of a record is then the smallest sum of such moves that the noise of
the sensor allows: weak-constraint variational assimilation [1], a banded system. The covariance of
the residual is never formed; all sizes and colours are those of the largest likelihood.

[1] Y. Tremolet, Q. J. R. Meteorol. Soc. 132 (2006) 2483.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.optimize import minimize
from scipy.sparse import bsr_matrix, csr_matrix, spmatrix
from scipy.stats import chi2

from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.linear_response import sampled, states_shown
from romsindy.fit.kernel.linear_steps import Equation, LinearSteps
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.prepared import Prepared
from romsindy.typing import Array

# Where the search for the noises starts: colours, and intensities of the force, as powers of e on
# the one whose response has the power of the sensor's noise.
_COLOURS, _FORCES = (0.0, 0.9), (-12.0, -7.0, -3.0, 1.0, 5.0, 10.0)
# The least of these moves a structure by 1/400 of the noise, and rounding would tell no less.
_LEAST = _FORCES[0]
_WIDEST, _WHITEST = 22.0, 3.0  # powers of e, and of the inverse hyperbolic tangent of the colour
# Samples that tell the noises of one coordinate, fewer of several, and windows of a longer record.
_ENOUGH, _WINDOWS = 8000, 4
_ROUNDING = 1e-14  # of the information on a state
_NEVER = 1e100  # of less than any likelihood
# Quarters of a record that have each a force of their own, as parts of the one of all.
_QUARTERS, _OTHER = 4, np.exp(np.arange(-6.0, 6.1, 0.5))
# Slopes of the likelihood by several sizes are taken over so much; steps down them, at most.
_SLOPES = {"eps": 1e-3, "maxiter": 12}
# The covariance of q and h q_dot at the end of a step of length 1 by a white force in it, inverted
# and as a square.
_MOVED = np.linalg.cholesky(np.linalg.inv([[1 / 3, 1 / 2], [1 / 2, 1.0]])).T


@dataclass(frozen=True, eq=False)
class Noises:
    """Sizes of all noises.

    ``force`` (R,) is the intensity of the force on each coordinate, (unit of q / s^2)^2 s,
    ``sensor`` (c,) the standard deviation of what a sample of each channel adds, measured unit,
    ``colour`` (c,) the correlation with the one before.
    """

    force: Array
    sensor: Array
    colour: Array

    @property
    def shown(self) -> Array:
        """Standard deviation of the noise of each sensor, measured unit, (c,)."""
        return self.sensor / np.sqrt(1 - self.colour**2)

    def louder(self, by: float) -> Noises:
        """All of them so many times as large."""
        return replace(self, force=self.force * by**2, sensor=self.sensor * by)


class WeighedProducts(NamedTuple):
    """Products of columns, weighed by the inverse of a covariance, and its log-determinant."""

    products: Array
    log_determinant: float


class _OneLag(NamedTuple):
    """A sum over samples as it depends on the colour a: same - a lagged + a^2 inner."""

    same: Array
    lagged: Array
    inner: Array

    @classmethod
    def of(cls, a: Any, b: Any) -> _OneLag:
        """Products of the columns of two tables, (n, ...) each, dense or sparse."""
        return cls(a.T @ b, a[1:].T @ b[:-1] + a[:-1].T @ b[1:], a[1:-1].T @ b[1:-1])

    def at(self, colour: float) -> Array:
        return self.same - colour * self.lagged + colour**2 * self.inner


def _over(channels: Iterable[_OneLag], noises: Noises) -> Array:
    """The sum over channels, each by the noise of its sensor."""
    own = zip(channels, noises.sensor, noises.colour, strict=True)
    return np.asarray(sum(sums.at(colour) / size**2 for sums, size, colour in own))


@dataclass(frozen=True, eq=False)
class TwoNoises:
    """The covariance of what is left of one record, whatever the sizes of its noises."""

    # c of (n, n_unknowns): what samples of each channel show of the states at the steps
    shown: tuple[spmatrix, ...]
    # R of (2 n_steps, n_unknowns): moves of the states from step to step by a force on each
    # coordinate, over their size where it has intensity 1
    moves: tuple[spmatrix, ...]
    # (n_steps, 3 R, 2 R), what a state at the start of a step does to the accelerations in it
    inside: Array
    heard: Array  # (R, c), power of what each force moves in each channel, at intensity 1

    @classmethod
    def along(
        cls,
        equation: Equation,
        parts: Sequence[Part],
        number: int,
        record: Prepared,
        motion: Trajectory,
    ) -> TwoNoises:
        """About a motion of a hypothesis in the record that has this number."""
        grid, r = motion.grid, motion.q.shape[1]
        t = grid.node_times(0, grid.n_steps)
        system = LinearSteps.at(
            equation, grid.step, t, motion.q, motion.q_dot, motion.q_ddot, False
        )
        unit = np.repeat([1.0, grid.step], r)  # states are q and h q_dot
        at, _ = states_shown(grid, system, record.orders(parts)[0])
        change = record.in_orders(parts, lambda order: states_shown(grid, system, order)[1]) / unit
        reading = record.shown(parts, number, partial(sampled, motion))
        seen = record.by_channel(reading.by_motion(change))  # (c, n, 2 R)
        places = at[:, None] * 2 * r + np.arange(2 * r)
        ends = np.arange(0, places.size + 1, 2 * r)
        shape = (len(places), 2 * r * (grid.n_steps + 1))
        shown = tuple(csr_matrix((x.ravel(), places.ravel(), ends), shape=shape) for x in seen)
        transition = unit[:, None] * system.transition / unit
        mass = system.mass.reshape(-1, 3, r, r)[:, 1]
        size = np.einsum("ij,nab->naijb", _MOVED, mass).reshape(-1, r, 2, 2 * r)
        size /= grid.step**1.5
        moves = tuple(_moves(own, transition) for own in size.swapaxes(0, 1))
        return cls(shown, moves, system.by_start / unit, _heard(transition, seen, grid.step))

    @property
    def n_states(self) -> int:
        """Unknowns that no move tells: those of the start."""
        return int(self.moves[0].shape[1] - sum(moves.shape[0] for moves in self.moves))

    def between(self, first: int, last: int) -> TwoNoises:
        """Samples first to last - 1, from a state of their own on."""
        places = np.concatenate([shown[first:last].indices for shown in self.shown])
        wide = self.n_states
        low, high = places.min() // wide * wide, (places.max() // wide + 1) * wide
        ends = slice(2 * (low // wide), 2 * (high // wide - 1))
        shown = tuple(shown[first:last, low:high] for shown in self.shown)
        moves = tuple(m[ends, low:high] for m in self.moves)
        inside = self.inside[low // wide : high // wide - 1]
        return replace(self, shown=shown, moves=moves, inside=inside)

    @cached_property
    def _bands(self) -> tuple[list[_OneLag], list[Array]]:
        sums = [_OneLag.of(h, h) for h in self.shown]
        return [_OneLag(*map(_band, own)) for own in sums], [_band(m.T @ m) for m in self.moves]

    def information(self, noises: Noises) -> Array:
        """The inverse covariance of the states, in bands as LAPACK takes them."""
        shown, moved = self._bands
        pairs = list(zip(1 / noises.force, moved, strict=True))
        for own, size, colour in zip(shown, noises.sensor, noises.colour, strict=True):
            weights = np.array([1.0, -colour, colour**2]) / size**2
            pairs += zip(weights, own, strict=True)
        found = np.zeros((max(len(band) for _, band in pairs), pairs[0][1].shape[1]))
        for weight, band in pairs:  # most of them are narrow
            found[: len(band)] += weight * band
        return found

    def moved(self, motion: Trajectory, states: Array) -> Trajectory:
        """A motion with these states (n_unknowns,) added, from step to step."""
        states = states.reshape(len(motion.q), -1)
        q, late = np.split(states, 2, axis=1)  # q and h q_dot
        q_ddot = motion.q_ddot + np.reshape(
            np.einsum("nij,nj->ni", self.inside, states[:-1]), motion.q_ddot.shape
        )
        q_dot = motion.q_dot + late / motion.grid.step
        return replace(motion, q=motion.q + q, q_dot=q_dot, q_ddot=q_ddot)

    def table(self, columns: Array) -> NoiseTable:
        """Columns (c n, m) that are weighed by some noises or others."""
        return NoiseTable(self, np.split(columns, len(self.shown)))


@dataclass(frozen=True, eq=False)
class NoiseTable:
    """Columns of one record, channel by channel, and what they say of the states."""

    noises: TwoNoises
    channels: Sequence[Array]

    @property
    def left(self) -> Array:
        """The last column, (c n,)."""
        return np.concatenate([y[:, -1] for y in self.channels])

    @property
    def fitted(self) -> Array:
        """The other columns, (c n, m - 1)."""
        return np.concatenate([y[:, :-1] for y in self.channels])

    @cached_property
    def _crossed(self) -> list[_OneLag]:
        return [_OneLag.of(h, y) for h, y in zip(self.noises.shown, self.channels, strict=True)]

    def weighed(self, noises: Noises) -> WeighedProducts:
        """By the inverse of the covariance; all sizes are above 0."""
        two = self.noises
        factor, states = self._states(noises)
        # What the best states leave, not the difference of two large numbers.
        left = (y - h @ states for h, y in zip(two.shown, self.channels, strict=True))
        products = _over((_OneLag.of(e, e) for e in left), noises)
        for moves, f in zip(two.moves, noises.force, strict=True):
            pushed = moves @ states
            products = products + pushed.T @ pushed / f
        spread = 2 * np.sum(np.log(factor[0])) - np.sum(np.log(1 - noises.colour**2))
        spread += two.moves[0].shape[0] * np.sum(np.log(noises.force))
        spread += 2 * two.shown[0].shape[0] * np.sum(np.log(noises.sensor))
        return WeighedProducts(products, float(spread))

    def states(self, noises: Noises) -> Array:
        """The most likely states behind each column, (n_unknowns, m)."""
        return self._states(noises)[1]

    def _states(self, noises: Noises) -> tuple[Array, Array]:
        """The factor of their information before them."""
        factor = _factor(self.noises.information(noises))
        return factor, cho_solve_banded((factor, True), _over(self._crossed, noises))


def _factor(information: Array) -> Array:
    """That of Cholesky; rounding of its diagonal may have left it below zero by a few digits."""
    try:
        return np.asarray(cholesky_banded(information, lower=True))
    except LinAlgError:
        information[0] *= 1 + _ROUNDING
        return np.asarray(cholesky_banded(information, lower=True))


def steady(noises: TwoNoises, left: Array, found: Noises) -> float:
    """Probability that a force which is noise differs as much between quarters of a record.

    A likelihood ratio; ``left`` (c n,) as in `found_noises`, which has ``found`` these.
    """
    channels = left.reshape(len(noises.shown), -1)
    costs = []
    for quarter in np.array_split(np.arange(channels.shape[1]), _QUARTERS):
        first, last = int(quarter[0]), int(quarter[-1]) + 1
        own = noises.between(first, last).table(channels[:, first:last].reshape(-1, 1))
        each = [own.weighed(replace(found, force=found.force * f)) for f in _OTHER]
        costs.append([float(w.products[0, 0]) + w.log_determinant for w in each])
    each, together = np.min(costs, axis=1), np.sum(costs, axis=0)
    return float(chi2.sf(np.min(together) - np.sum(each), _QUARTERS - 1))


def found_noises(noises: TwoNoises, left: Array) -> Noises:
    """Noises of the largest likelihood in what a fit leaves of a record, (c n,), measured unit."""
    search = _NoiseSearch.of(noises, left)
    starts = [search.alike(f, np.arctanh(c)) for f in _FORCES for c in _COLOURS]
    best = min(starts, key=search.cost)
    both = np.stack([search.alike(1.0, 0.0), search.alike(0.0, 1.0)], axis=1)

    def cost(x: Array) -> float:
        return search.cost(best + both @ x)

    simplex = np.array([[0.0, 0.0], [1.5, 0.0], [0.0, 0.3]])
    options = {"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.05, "maxiter": 60}
    best = best + both @ minimize(cost, np.zeros(2), method="Nelder-Mead", options=options).x
    if search.n_forces + search.n_channels > 2:
        low = search.alike(_LEAST, -_WHITEST) + search.louder(-_WIDEST)
        high = search.alike(_WIDEST, _WHITEST) + search.louder(_WIDEST)
        within = [*zip(low, high, strict=True)]
        start, how = np.clip(best, low, high), {"method": "L-BFGS-B", "options": _SLOPES}
        best = minimize(search.cost, start, bounds=within, **how).x
    found = search.noises(best)  # with the size that leaves a chi-square of its freedom
    return found.louder(float(np.sqrt(search.weighed(found)[0] / search.freedom)))


def usual_noises(noises: TwoNoises, left: Array) -> Noises:
    """Without a search: what is left is of the sensors, and a force moves as much."""
    search = _NoiseSearch.of(noises, left)
    return search.noises(search.alike(0.0, 0.0))


@dataclass(frozen=True)
class _NoiseSearch:
    """For noises, by powers of e on the usual force, arctanh of colours, powers of e on sensors.

    ``usual`` (R,) is the force that moves as much as the sensors add where these add ``sensor``
    (c,), which is what is left of each channel.
    """

    tables: tuple[NoiseTable, ...]
    usual: Array
    sensor: Array
    freedom: int

    @classmethod
    def of(cls, noises: TwoNoises, left: Array) -> _NoiseSearch:
        channels = left.reshape(len(noises.shown), -1)
        n = channels.shape[1]
        enough = _ENOUGH // len(noises.moves)
        some = [slice(0, n)] if n <= enough else _windows(n, enough // _WINDOWS)
        tables = tuple(
            noises.between(w.start, w.stop).table(channels[:, w].reshape(-1, 1)) for w in some
        )
        sensor = np.sqrt(np.mean(channels**2, axis=1))
        sensor = np.maximum(sensor, 1e-9 * sensor.max())
        usual = 1 / np.maximum(np.mean(noises.heard / sensor**2, axis=1), 1e-300)
        freedom = sum(channels[:, w].size - noises.n_states for w in some)
        return cls(tables, usual, sensor, freedom)

    @property
    def n_forces(self) -> int:
        return len(self.usual)

    @property
    def n_channels(self) -> int:
        return len(self.sensor)

    def alike(self, force: float, colour: float) -> Array:
        """The same for all coordinates and channels."""
        return np.repeat([force, colour, 0.0], [self.n_forces, self.n_channels, self.n_channels])

    def louder(self, sensors: float) -> Array:
        """Sensors by so many powers of e."""
        return np.repeat([0.0, sensors], [self.n_forces + self.n_channels, self.n_channels])

    def noises(self, x: Array) -> Noises:
        force, colour, sensor = np.split(x, np.cumsum([self.n_forces, self.n_channels]))
        return Noises(np.exp(force) * self.usual, np.exp(sensor) * self.sensor, np.tanh(colour))

    def weighed(self, noises: Noises) -> tuple[float, float]:
        """Chi-square of what is left, and the log-determinant."""
        found = [table.weighed(noises) for table in self.tables]
        return (sum(float(w.products[0, 0]) for w in found), sum(w.log_determinant for w in found))

    def cost(self, x: Array) -> float:
        """-2 log likelihood, whatever the size of all noises together."""
        if min(x[: self.n_forces]) < _LEAST or max(abs(x)) > _WIDEST:
            return _NEVER
        if max(abs(x[self.n_forces :][: self.n_channels])) > _WHITEST:
            return _NEVER
        try:
            chi_squared, spread = self.weighed(self.noises(x))
        except LinAlgError:
            return _NEVER
        return self.freedom * float(np.log(chi_squared)) + spread if chi_squared > 0 else _NEVER


def _windows(n: int, length: int) -> list[slice]:
    """Spread over n samples."""
    starts = np.linspace(0, n - length, _WINDOWS).round().astype(int)
    return [slice(int(a), int(a) + length) for a in starts]


def _moves(size: Array, transition: Array) -> spmatrix:
    """Those of one coordinate, (2 n_steps, n_unknowns), by sizes (n_steps, 2, 2 R)."""
    n, wide = len(size), size.shape[2]
    blocks = np.stack([-size @ transition, size], axis=1).reshape(-1, 2, wide)
    columns = np.arange(n)[:, None] + np.arange(2)
    shape = (2 * n, wide * (n + 1))
    return bsr_matrix((blocks, columns.ravel(), 2 * np.arange(n + 1)), shape=shape).tocsr()


def _heard(transition: Array, seen: Array, step: float) -> Array:
    """By the responses of single oscillators, of variance S / (4 zeta omega^3) in q, (R, c)."""
    r = transition.shape[1] // 2
    found = np.empty((r, len(seen)))
    for i in range(r):
        own = transition[:, i::r, i::r]
        decay = -float(np.mean(np.linalg.slogdet(own)[1])) / (2 * step)
        turn = np.abs(np.angle(np.linalg.eigvals(own).astype(complex)))
        omega = max(float(np.mean(turn)) / step, 1e-12)
        q = np.mean(np.sum(seen[:, :, i::r] ** 2, axis=2), axis=1)  # a sample for a state of 1
        found[i] = q / (4 * max(decay, 1e-3 * omega) * omega**2)
    return found


def _band(a: spmatrix) -> Array:
    """Lower diagonals of a symmetric matrix, (wide + 1, n)."""
    entries = a.tocoo()
    wide = int(np.abs(entries.row - entries.col).max(initial=0))
    band = np.zeros((wide + 1, a.shape[0]))
    low = entries.row >= entries.col
    rows, columns = entries.row[low], entries.col[low]
    band[rows - columns, columns] = entries.data[low]
    return band
