"""How likely data are where the equation of motion is only nearly right.

No equation is exact: other modes move along, a series ends too early. Its motion is allowed to
depart from it: process noise that changes the state over every window of a few cycles. Departures
of size tau turn and stretch the state as if frequency (relatively) and damping ratio were off by
tau in the window. Integrated out of a fit that is linear about its motion, departures B s with
s ~ N(0, tau^2 A) leave

    r ~ N(J x, I + tau^2 B A B')

of the whitened misfit r, for any size tau at the cost of small matrices. What makes a motion depart
changes slowly with amplitude: neighbouring windows depart alike, so that a misfit that grows over a
whole decay counts once. With tau = 0 this is the chi-square of the fit. It is weak-constraint data
assimilation [1].

In forecasts of all kinds such an equation errs in frequency, relatively, and in damping ratio;
within the data by as much as their likelihood asks for. What it leaves out is of a higher power of
the amplitude than what it has, by two where the structure is symmetric: beyond the data it grows
with the square of the amplitude. Records of one structure differ by more than their noise:
temperature, a clamp, wear. Few records tell their scatter badly, so what tests are known to repeat
to counts with it.

[1] Y. Tremolet, "Accounting for an imperfect model in 4D-Var", Q. J. R. Meteorol. Soc. 132 (2006).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t

from romsindy.fit.kernel.collocation import GROWN, Trajectory, TrajectoryError
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.hypothesis import NormalEquations
from romsindy.fit.kernel.linear_response import Response, respond
from romsindy.fit.kernel.part import Part, columns_of, held_values, limits, moved_parts
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array, Indices

DRAWS = 400
GROWS = "what the model lacks is not known there, and the band grows as the square of the amplitude"
KNOWN = 2.0  # degrees of freedom for which what is known beforehand counts
SIGMAS, TAILS = 1.96, (0.025, 0.975)  # of a 95 % band
# Departures are alike over so many e-folds of the amplitude.
_ALIKE = 1.0
_ROUNDS, _NEAR = 4, 0.03  # of linearisation, until motions change less, in amplitudes
_ASTRAY = 2.0  # times the misfit of the best of them
_ROUNDING = 1e-13  # of products, by which they must not become negative
_LOST = 1e5  # growth of a small disturbance, or distance in amplitudes, that leads nowhere
# Sizes to choose from: from nothing to more than is linear about a motion.
_JUMPS = np.concatenate([[0.0], 10.0 ** np.arange(-7, -2.4, 0.25)])


class Form(NamedTuple):
    """Errors of an equation, as standard deviations."""

    departure: float = 0.0  # of frequency, relative, and damping ratio, as amplitude changes
    frequency: float = 0.0  # by how much these move from record to record: 0 where none disagree
    damping: float = 0.0
    note: str = ""  # what is to be told of that


def grown(amplitude: ArrayLike, reach: float) -> Array:
    """Factor by which an equation errs more at an amplitude than within the reach of its data."""
    return np.maximum(np.asarray(amplitude) / reach, 1.0) ** 2


def as_coefficients(frequency: float, damping: float, rate: float) -> Array:
    """What relative frequency and damping ratio are in linear stiffness and damping, (2,)."""
    return np.array([2 * rate**2 * frequency, 2 * rate * damping])


def normal_draws(covariance: Array, rng: np.random.Generator) -> Array:
    """Errors of a known covariance, (DRAWS, m).

    Coefficients differ by many powers of ten: only their correlations are near one another.
    """
    size = np.sqrt(np.diag(covariance))
    unit = np.where(size > 0, size, 1.0)
    correlation, nothing = covariance / unit / unit[:, None], np.zeros(len(size))
    return np.asarray(size * rng.multivariate_normal(nothing, correlation, DRAWS, method="svd"))


def scatter(moves: Array, variance: Array, expected: float) -> float:
    """Standard deviation of a further move, widened for how badly few tell it.

    ``moves`` (n,) were seen, about any mean, with the ``variance`` (n,) of their errors; what is
    ``expected`` beforehand counts for two of them.
    """
    n, freedom = len(moves), KNOWN + len(moves) - 1
    own = max(float(np.sum((moves - moves.mean()) ** 2 - variance)), 0.0)
    return float(np.sqrt((KNOWN * expected**2 + own) / freedom * (1 + 1 / n))) * wider(freedom)


def wider(freedom: float) -> float:
    """A 95 % band of a deviation known by so many degrees of freedom, over that of a known one."""
    return float(t.isf(0.025, freedom)) / SIGMAS


@dataclass(frozen=True, eq=False)
class Windows:
    """The linearised fit of one record, cut in windows."""

    response: Response
    # (n, m + 3), whitened derivatives by m values and by both initial states, and the misfit
    rows: Array
    steps: Indices  # (K + 1,), at which windows begin, and where the last one ends
    window: Indices  # (n,), window of each sample
    # (K, 2, 2), changes of the initial state that stand for a departure of unit size in each window
    jumps: Array
    # (2 K, 2 K), independent standard normal values times this are departures of unit size
    roots: Array
    where: Indices  # places of the columns among all values and states

    @classmethod
    def of(
        cls,
        model: ReducedModel,
        parts: tuple[Part, ...],
        i: int,
        record: Record,
        m: Trajectory,
        reach: float = np.inf,
    ) -> Windows:
        """Linearise a fit to record ``i`` about a motion; beyond amplitudes departures grow.

        Raises a TrajectoryError if small disturbances of the motion grow, or fade, without bound.
        """
        equation = equation_of(model, parts, i, record)
        with np.errstate(all="ignore"):
            response = respond(equation, m)
            distance = np.abs(response.q[:, 0, [0, -2]] / [record.amplitude, 1.0]).max()
        steps = record.window_steps
        starts = steps[:-1]
        states = np.stack([response.q[starts, 0, -2:], response.q_dot[starts, 0, -2:]], axis=1)
        in_rates = states * [[1.0, record.rate], [1 / record.rate, 1.0]]
        if not distance < _LOST or not np.linalg.cond(in_rates).max() < _LOST:
            raise TrajectoryError("small disturbances of the motion grow without bound")
        change = response.samples(record.derivative)
        x = equation.sampled(m, record.derivative) + change[..., 0]
        rows = record.table(parts, i, x, change[..., 1:])
        # A departure turns the state, and stretches it.
        q, v = m.q[starts, 0], m.q_dot[starts, 0] / record.rate
        unit = np.array([[v, q], [-record.rate * q, record.rate * v]]).transpose(2, 0, 1)
        unit *= np.diff(record.phase(m.grid.step * steps))[:, None, None]
        jumps = np.linalg.solve(states, unit)
        # Of a motion that has died out no change of its start is a departure; nan is no less.
        if not all(np.all(np.abs(x) < GROWN) for x in (rows, jumps)):
            raise TrajectoryError("small disturbances of the motion grow, or fade, without bound")
        amplitude = np.hypot(q, v)
        apart = np.log(amplitude[:, None] / amplitude)
        alike = np.exp(-np.abs(apart) / _ALIKE) + 1e-9 * np.eye(len(starts))
        at_start = sum(p.size for p in parts) + 2 * i + np.arange(2)
        return cls(
            response,
            rows,
            steps,
            np.searchsorted(starts, m.grid.sample_step, side="right") - 1,
            jumps,
            np.kron(grown(amplitude, reach)[:, None] * np.linalg.cholesky(alike), np.eye(2)),
            np.concatenate([columns_of(parts, i), at_start]),
        )

    def departed(self, derivative: int) -> Array:
        """Changes of q, q_dot or q_ddot at the samples by independent unit departures, (n, 2 K)."""
        by_state = self.response.samples(derivative)[:, 0, -2:]
        k, own = np.arange(len(self.jumps)), self.window[:, None]
        gathered = np.where(k == own, self._ramp[:, None], 1.0 * (k < own))
        each = np.einsum("nq,kqj,nk->nkj", by_state, self.jumps, gathered)
        return np.asarray(each.reshape(len(own), -1) @ self.roots)

    @property
    def _ramp(self) -> Array:
        """How much of the departure in its window has gathered at each sample, (n,)."""
        grid = self.response.motion.grid
        place = grid.sample_step + grid.fraction - self.steps[self.window]
        return np.asarray(place / np.diff(self.steps)[self.window])

    def products(self) -> tuple[Array, Array]:
        """Products of the rows, and of the departures, with the departures: (m + 3, k), (k, k)."""
        wide = np.column_stack([self.rows, self._ramp[:, None] * self.rows[:, -3:-1]])
        n, m = len(self.jumps), self.rows.shape[1]
        first = np.searchsorted(self.window, np.arange(1, n))
        grams = np.array([x.T @ x for x in np.split(wide, first)])
        # A departure gathers in its window and stays: sums from the end.
        later = np.cumsum(grams[::-1], axis=0)[::-1] - grams
        whole, part = slice(m - 3, m - 1), slice(m, m + 2)
        with_rows = (grams[:, :m, part] + later[:, :m, whole]) @ self.jumps
        k, last = np.arange(n), np.maximum.outer(np.arange(n), np.arange(n))
        inner = (grams[:, whole, part] + later[:, whole, whole])[last]
        inner = np.where(np.less.outer(k, k)[..., None, None], inner, inner.swapaxes(2, 3))
        inner[k, k] = grams[:, part, part] + later[:, whole, whole]
        each = np.einsum("kpi,klpq,lqj->kilj", self.jumps, inner, self.jumps)
        return with_rows.transpose(1, 0, 2).reshape(m, 2 * n), each.reshape(2 * n, 2 * n)

    def states(self, departures: Array) -> tuple[Array, Array]:
        """Changes of the initial state that act from each window on, and those in it: (K, 2)."""
        own = (self.jumps @ departures.reshape(-1, 2, 1))[..., 0]
        return np.cumsum(own, axis=0) - own, own

    def left(self, step: Array, departures: Array) -> Array:
        """Whitened misfit (n,) after a change of values and states, and departures."""
        before, own = self.states(departures)
        state = before[self.window] + self._ramp[:, None] * own[self.window]
        joined = self.rows[:, -1] - self.rows[:, :-1] @ step[self.where]
        return joined - np.sum(self.rows[:, -3:-1] * state, axis=1)

    def moved(self, step: Array, departures: Array) -> Trajectory:
        """The motion after a change of values and states, and departures: it need not join."""
        whole = self.response
        m = whole.moved(np.concatenate([[1.0], step[self.where]]))
        before, own = self.states(departures)
        ends = np.concatenate([before, before[-1:] + own[-1:]])
        at = np.arange(self.steps[-1] + 1)
        state = np.stack([np.interp(at, self.steps, x) for x in ends.T], axis=1)
        return replace(
            m,
            q=m.q + np.einsum("trp,tp->tr", whole.q[..., -2:], state),
            q_dot=m.q_dot + np.einsum("trp,tp->tr", whole.q_dot[..., -2:], state),
            q_ddot=m.q_ddot + np.einsum("tnrp,tp->tnr", whole.q_ddot[..., -2:], state[:-1]),
        )


@dataclass(frozen=True, eq=False)
class Marginal:
    """Likelihood of the values of a fit, with departures from its equation integrated out."""

    parts: tuple[Part, ...]
    n_records: int
    # (m + 1, m + 1), products of all columns: derivatives by values and states, and the misfit
    gram: Array
    # (m + 1, k), products of these with departures of unit size, in their principal directions
    shared: Array
    powers: Array  # (k,), products of the departures with themselves

    @classmethod
    def of(cls, parts: tuple[Part, ...], several: Sequence[Windows]) -> Marginal:
        """Join the records of one fit."""
        n = sum(p.size for p in parts) + 2 * len(several) + 1
        gram, shared, powers = np.zeros((n, n)), [], []
        for windows in several:
            at = np.append(windows.where, n - 1)
            gram[np.ix_(at, at)] += windows.rows.T @ windows.rows
            with_rows, each = windows.products()
            power, principal = np.linalg.eigh(windows.roots.T @ each @ windows.roots)
            own = np.zeros((n, len(power)))
            own[at] = with_rows @ windows.roots @ principal
            shared.append(own)
            powers.append(np.maximum(power, _ROUNDING * power[-1]))
        return cls(parts, len(several), gram, np.hstack(shared), np.concatenate(powers))

    def equations(self, jump: float, excess: float) -> NormalEquations:
        """Of all values and states; noise has ``excess`` times its power."""
        system = NormalEquations(sum(p.size for p in self.parts), self.n_records)
        weight = jump**2 / (excess + jump**2 * self.powers)
        rounding = _ROUNDING * np.diag(np.diag(self.gram))
        gram = (self.gram - (self.shared * weight) @ self.shared.T + rounding) / excess
        system.matrix, system.right, system.power = gram[:-1, :-1], gram[:-1, -1], gram[-1, -1]
        system.add_priors(self.parts)
        return system

    def solve(self, jump: float, excess: float = 1.0) -> tuple[NormalEquations, Array]:
        """The equations, and the change of all values and states that solves them."""
        system = self.equations(jump, excess)
        held = held_values(self.parts, fixed=False, first=False)
        return system, system.bounded_step(held, *limits(self.parts))

    def cost(self, jump: float, excess: float = 1.0) -> float:
        """Minus twice the logarithm of the likelihood of the best values, up to a constant."""
        system, step = self.solve(jump, excess)
        return system.chi_squared(step) + float(np.sum(np.log1p(jump**2 * self.powers / excess)))

    def departures(self, several: Sequence[Windows], jump: float, step: Array) -> list[Array]:
        """Most probable ones of every record, (k,), after a change of values and states."""
        found = []
        for windows in several:
            with_rows, each = windows.products()
            pull = windows.roots.T @ (with_rows[-1] - step[windows.where] @ with_rows[:-1])
            power = windows.roots.T @ each @ windows.roots
            matrix = np.eye(len(power)) + jump**2 * power
            found.append(windows.roots @ np.linalg.solve(matrix, jump**2 * pull))
        return found

    def needed(self) -> float:
        """Least size of departures that the data do not tell from the most likely one."""
        costs = self._costs()
        return float(_JUMPS[np.argmax(costs <= costs.min() + EQUIVALENT)])

    def allowed(self) -> float:
        """Size of departures that the data let expect: rms over all, by their likelihood."""
        costs = self._costs()
        return float(np.sqrt(np.average(_JUMPS**2, weights=np.exp((costs.min() - costs) / 2))))

    def _costs(self) -> Array:
        return np.array([self.cost(jump) for jump in _JUMPS])


@dataclass(frozen=True, eq=False)
class Departures:
    """A fit whose motions may depart from their equation."""

    marginal: Marginal
    jump: float  # least size that the data ask for
    # Tuple of (n,) arrays: whitened misfit of every record that these departures do not explain
    left: tuple[Array, ...]

    @classmethod
    def of(
        cls,
        model: ReducedModel,
        parts: tuple[Part, ...],
        records: Sequence[Record],
        motions: Sequence[Trajectory],
    ) -> Departures | None:
        """Start from the values and motions of a fit, and let them follow the records.

        The likeliest on the way where they go astray, as where a force jumps. None where small
        disturbances of the motions grow without bound.
        """
        tried: list[Departures] = []
        for _ in range(_ROUNDS):
            pairs = enumerate(zip(records, motions, strict=True))
            try:
                several = [Windows.of(model, parts, i, *pair) for i, pair in pairs]
            except TrajectoryError:
                break
            marginal = Marginal.of(parts, several)
            jump = marginal.needed()
            system, step = marginal.solve(jump)
            try:
                own = marginal.departures(several, jump, step)
            except np.linalg.LinAlgError:  # to rounding they grow without bound, too
                break
            left = tuple(w.left(step, s) for w, s in zip(several, own, strict=True))
            tried.append(cls(marginal, jump, left))
            parts, before = moved_parts(parts, step), motions
            motions = [w.moved(step, s) for w, s in zip(several, own, strict=True)]
            changes = zip(records, before, motions, strict=True)
            near = all(np.abs(b.q - a.q).max() < _NEAR * r.amplitude for r, a, b in changes)
            # The linear problem holds near its motion and values: elsewhere it is set up anew.
            if near and np.all(np.abs(step) <= np.sqrt(np.diag(system.covariance()))):
                return tried[-1]
        costs = [d.marginal.cost(d.jump) for d in tried]
        astray = bool(costs) and costs[-1] > _ASTRAY * min(costs)
        return tried[int(np.argmin(costs))] if astray else next(reversed(tried), None)
