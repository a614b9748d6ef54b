"""How likely data are where the equation of motion is only nearly right.

No equation is exact: other modes move along, a series ends too early. Its motion is allowed to
depart from it, from one window of a few cycles to the next, by jumps of the state: process noise.
Integrated out of a fit that is linear about its motion, jumps B s with s ~ N(0, tau^2 A) leave

    r ~ N(J x, I + tau^2 B A B')

of the whitened misfit r, for any size tau at the cost of small matrices. What makes a motion depart
changes slowly with amplitude: jumps of neighbouring windows are correlated, so that a misfit that
grows over a whole decay counts once. With tau = 0 this is the chi-square of the fit. It is
weak-constraint data assimilation [1].

[1] Y. Tremolet, "Accounting for an imperfect model in 4D-Var", Q. J. R. Meteorol. Soc. 132 (2006).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.fit.collocation import Trajectory
from romsindy.fit.gauss_newton import held_values, limits, table
from romsindy.fit.linear_response import nodes, respond, sampled
from romsindy.fit.normal_equations import NormalEquations
from romsindy.fit.part import ExtendedEquation, Part, columns_of
from romsindy.fit.record import Record
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array, Indices

_LEAST_CYCLES, _MOST_WINDOWS = 3, 40
# Jumps are alike over so many e-folds of the amplitude.
_ALIKE = 1.0
# Sizes to choose from, in amplitudes a cycle: from nothing to a phase that is lost.
_JUMPS = np.concatenate([[0.0], 10.0 ** np.arange(-6, -0.4, 0.25)])


def window_steps(record: Record) -> Indices:
    """Steps of the motion at which windows of a few cycles begin, and where the last one ends."""
    cycles, grid = record.cycles, record.motion.grid
    size = max(_LEAST_CYCLES, int(np.ceil(len(cycles) / _MOST_WINDOWS)))
    # The first and the last window are no shorter than the others.
    inner = grid.sample_step[cycles[size : max(len(cycles) - size, 0) : size]]
    return np.unique([0, *inner, grid.n_steps])


@dataclass(frozen=True, eq=False)
class Windows:
    """The linearised fit of one record, cut in windows.

    Attributes
    ----------
    rows : (n, m + 3) array
        Whitened derivatives by m values and by both initial states, and the misfit.
    first : (K + 1,) array of int
        Samples at which windows begin, and where the last one ends.
    jumps : (K - 1, 2, 2) array
        Initial states that stand for a jump of unit size at the start of every later window.
    roots : (2 (K - 1), 2 (K - 1)) array
        Independent standard normal values times this are jumps of unit size.
    where : array of int
        Places of the columns among all values and states.
    """

    rows: Array
    first: Indices
    jumps: Array
    roots: Array
    where: Indices

    @classmethod
    def of(
        cls, model: ReducedModel, parts: tuple[Part, ...], i: int, record: Record, m: Trajectory
    ) -> Windows:
        """Linearise a fit to record ``i`` about a motion, which need not be its own."""
        equation = ExtendedEquation(model, parts, i, m.grid.step)
        response = respond(equation, m, equation.by_parameter(*nodes(m)))
        change = response.samples(record.derivative)
        x = sampled(m, record.derivative) + change[..., 0]
        rows = table(parts, i, record, x, change[..., 1:])
        steps = window_steps(record)
        later = steps[1:-1]
        states = np.stack([response.q[later, 0, -2:], response.q_dot[later, 0, -2:]], axis=1)
        amplitude = np.array(
            [np.abs(m.q[a:b]).max() for a, b in zip(steps[:-1], steps[1:], strict=True)]
        )
        turns = np.diff(record.phase(m.grid.step * steps)) / (2 * np.pi)
        # Jumps gather from cycle to cycle like the steps of a random walk.
        size = (amplitude * np.sqrt(np.maximum(turns, 0.0)))[:-1]
        unit = size[:, None, None] * np.diag([1.0, record.rate])
        apart = np.log(amplitude[:-1, None] / amplitude[None, :-1])
        alike = np.exp(-np.abs(apart) / _ALIKE)
        roots = np.kron(np.linalg.cholesky(alike + 1e-9 * np.eye(len(alike))), np.eye(2))
        at_start = sum(p.size for p in parts) + 2 * i + np.arange(2)
        where = np.concatenate([columns_of(parts, i), at_start])
        first = np.searchsorted(m.grid.sample_step, steps)
        return cls(rows, first, np.linalg.solve(states, unit), roots, where)

    def products(self) -> tuple[Array, Array]:
        """Products of the rows, and of the jumps, with the jumps: (m + 3, k) and (k, k)."""
        grams = np.array([x.T @ x for x in np.split(self.rows, self.first[1:-1])])
        # A jump acts from its window on: sums from the end.
        later = np.cumsum(grams[1:][::-1], axis=0)[::-1]
        m, n = self.rows.shape[1], len(later)
        with_rows = later[:, :, -3:-1] @ self.jumps
        last = np.maximum.outer(np.arange(n), np.arange(n))
        inner = later[last][..., -3:-1, -3:-1]
        each = np.einsum("kpi,klpq,lqj->kilj", self.jumps, inner, self.jumps)
        return with_rows.transpose(1, 0, 2).reshape(m, 2 * n), each.reshape(2 * n, 2 * n)

    def moved(self, jumps: Array) -> Array:
        """Whitened change of the signal by jumps (k,)."""
        states = np.cumsum((self.jumps @ jumps.reshape(-1, 2, 1))[..., 0], axis=0)
        states = np.concatenate([np.zeros((1, 2)), states])
        return np.sum(self.rows[:, -3:-1] * np.repeat(states, np.diff(self.first), axis=0), axis=1)


def linearised(
    model: ReducedModel,
    parts: tuple[Part, ...],
    records: Sequence[Record],
    motions: Sequence[Trajectory],
) -> list[Windows]:
    """Linearise a fit to several records about its motions."""
    pairs = enumerate(zip(records, motions, strict=True))
    return [Windows.of(model, parts, i, record, motion) for i, (record, motion) in pairs]


@dataclass(frozen=True, eq=False)
class Marginal:
    """Likelihood of the values of a fit, with departures from its equation integrated out.

    Attributes
    ----------
    parts : tuple of Part
    n_records : int
    gram : (m + 1, m + 1) array
        Products of all columns: derivatives by values and states, and the misfit.
    shared : (m + 1, k) array
        Products of these with jumps of unit size, in their principal directions.
    powers : (k,) array
        Products of the jumps with themselves.
    """

    parts: tuple[Part, ...]
    n_records: int
    gram: Array
    shared: Array
    powers: Array

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
            powers.append(np.maximum(power, 0.0))
        return cls(parts, len(several), gram, np.hstack(shared), np.concatenate(powers))

    def equations(self, jump: float, excess: float) -> NormalEquations:
        """Of all values and states, with jumps of a size and noise of ``excess`` times its power."""
        system = NormalEquations(sum(p.size for p in self.parts), self.n_records)
        weight = jump**2 / (excess + jump**2 * self.powers)
        gram = (self.gram - (self.shared * weight) @ self.shared.T) / excess
        system.matrix, system.right, system.power = gram[:-1, :-1], gram[:-1, -1], gram[-1, -1]
        system.add_priors(self.parts)
        return system

    def solve(self, jump: float, excess: float = 1.0) -> tuple[NormalEquations, Array]:
        """The equations, and the change of all values and states that solves them."""
        system = self.equations(jump, excess)
        return system, system.bounded_step(held_values(self.parts, False, False), *limits(self.parts))

    def cost(self, jump: float, excess: float = 1.0) -> float:
        """Minus twice the logarithm of the likelihood of the best values, up to a constant."""
        system, step = self.solve(jump, excess)
        return system.chi_squared(step) + float(np.sum(np.log1p(jump**2 * self.powers / excess)))

    def left(self, several: Sequence[Windows], jump: float) -> list[Array]:
        """Whitened misfit of every record, (n,), that jumps of a size do not explain."""
        step = self.solve(jump)[1] - self.solve(0.0)[1]
        found: list[Array] = []
        for windows in several:
            rest = windows.rows[:, -1] - windows.rows[:, :-1] @ step[windows.where]
            with_rows, each = windows.products()
            pull = windows.roots.T @ (with_rows[-1] - step[windows.where] @ with_rows[:-1])
            power = windows.roots.T @ each @ windows.roots
            jumps = np.linalg.solve(np.eye(len(power)) + jump**2 * power, jump**2 * pull)
            found.append(rest - windows.moved(windows.roots @ jumps))
        return found

    def needed(self) -> float:
        """Least size of jumps that the data do not tell from the most likely one."""
        costs = np.array([self.cost(jump) for jump in _JUMPS])
        return float(_JUMPS[np.argmax(costs <= costs.min() + EQUIVALENT)])
