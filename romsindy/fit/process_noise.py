"""How likely data are where the equation of motion is only nearly right.

No equation is exact: other modes move along, a series ends too early. Its motion is allowed to
depart from it, from one window of a few cycles to the next, by jumps of the state: process noise. Jumps of size tau
are as large as if frequency (relatively) and damping ratio were off by tau over the window before.
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
from dataclasses import dataclass, replace

import numpy as np

from romsindy.fit.collocation import Trajectory
from romsindy.fit.gauss_newton import held_values, limits, table
from romsindy.fit.linear_response import Response, nodes, respond, sampled
from romsindy.fit.normal_equations import NormalEquations
from romsindy.fit.part import ExtendedEquation, Part, columns_of
from romsindy.fit.record import Record
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array, Indices

_LEAST_CYCLES, _MOST_WINDOWS = 3, 40
# Jumps are alike over so many e-folds of the amplitude.
_ALIKE = 1.0
_ROUNDS, _NEAR = 4, 0.03  # of linearisation, until motions change less, in amplitudes
# Sizes to choose from: from nothing to a phase that is lost.
_JUMPS = np.concatenate([[0.0], 10.0 ** np.arange(-7, -1.4, 0.25)])


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
    response : Response
    rows : (n, m + 3) array
        Whitened derivatives by m values and by both initial states, and the misfit.
    steps : (K + 1,) array of int
        At which windows begin, and where the last one ends.
    first : (K + 1,) array of int
        The same in samples.
    jumps : (K - 1, 2, 2) array
        Initial states that stand for a jump of unit size at the start of every later window.
    roots : (2 (K - 1), 2 (K - 1)) array
        Independent standard normal values times this are jumps of unit size.
    where : array of int
        Places of the columns among all values and states.
    """

    response: Response
    rows: Array
    steps: Indices
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
        phase = np.maximum(np.diff(record.phase(m.grid.step * steps)), 0.0)
        size = (amplitude * phase)[:-1]
        unit = size[:, None, None] * np.diag([1.0, record.rate])
        apart = np.log(amplitude[:-1, None] / amplitude[None, :-1])
        alike = np.exp(-np.abs(apart) / _ALIKE)
        roots = np.kron(np.linalg.cholesky(alike + 1e-9 * np.eye(len(alike))), np.eye(2))
        at_start = sum(p.size for p in parts) + 2 * i + np.arange(2)
        where = np.concatenate([columns_of(parts, i), at_start])
        first = np.searchsorted(m.grid.sample_step, steps)
        return cls(response, rows, steps, first, np.linalg.solve(states, unit), roots, where)

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

    def states(self, jumps: Array) -> Array:
        """Initial states that stand for each window after jumps (k,): (K, 2)."""
        later = (self.jumps @ jumps.reshape(-1, 2, 1))[..., 0]
        return np.cumsum(np.concatenate([np.zeros((1, 2)), later]), axis=0)

    def left(self, step: Array, jumps: Array) -> Array:
        """Whitened misfit (n,) after a change of values and states, and jumps."""
        each = np.repeat(self.states(jumps), np.diff(self.first), axis=0)
        joined = self.rows[:, -1] - self.rows[:, :-1] @ step[self.where]
        return joined - np.sum(self.rows[:, -3:-1] * each, axis=1)

    def moved(self, step: Array, jumps: Array) -> Trajectory:
        """The motion after a change of values and states, and jumps: it need not join."""
        m = self.response.moved(np.concatenate([[1.0], step[self.where]]))
        each = np.repeat(self.states(jumps), np.diff(self.steps), axis=0)
        ends = np.concatenate([each, each[-1:]])[:, :, None]
        own = self.response
        return replace(
            m,
            q=m.q + (own.q[..., -2:] @ ends)[..., 0],
            q_dot=m.q_dot + (own.q_dot[..., -2:] @ ends)[..., 0],
            q_ddot=m.q_ddot + (own.q_ddot[..., -2:] @ each[:, None, :, None])[..., 0],
        )


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
        return system, system.bounded_step(
            held_values(self.parts, False, False), *limits(self.parts)
        )

    def cost(self, jump: float, excess: float = 1.0) -> float:
        """Minus twice the logarithm of the likelihood of the best values, up to a constant."""
        system, step = self.solve(jump, excess)
        return system.chi_squared(step) + float(np.sum(np.log1p(jump**2 * self.powers / excess)))

    def jumps(self, several: Sequence[Windows], jump: float, step: Array) -> list[Array]:
        """Most probable jumps in every record, (k,) each, after a change of values and states."""
        found = []
        for windows in several:
            with_rows, each = windows.products()
            pull = windows.roots.T @ (with_rows[-1] - step[windows.where] @ with_rows[:-1])
            power = windows.roots.T @ each @ windows.roots
            matrix = np.eye(len(power)) + jump**2 * power
            found.append(windows.roots @ np.linalg.solve(matrix, jump**2 * pull))
        return found

    def needed(self) -> float:
        """Least size of jumps that the data do not tell from the most likely one."""
        costs = np.array([self.cost(jump) for jump in _JUMPS])
        return float(_JUMPS[np.argmax(costs <= costs.min() + EQUIVALENT)])


@dataclass(frozen=True, eq=False)
class Departures:
    """A fit whose motions may depart from their equation.

    Attributes
    ----------
    marginal : Marginal
    jump : float
        Least size of jumps that the data ask for.
    left : tuple of (n,) arrays
        Whitened misfit of every record that these jumps do not explain.
    """

    marginal: Marginal
    jump: float
    left: tuple[Array, ...]

    @classmethod
    def of(
        cls,
        model: ReducedModel,
        parts: tuple[Part, ...],
        records: Sequence[Record],
        motions: Sequence[Trajectory],
    ) -> Departures:
        """Start from the motions of a fit, and let them follow the records."""
        for _ in range(_ROUNDS):
            pairs = enumerate(zip(records, motions, strict=True))
            several = [Windows.of(model, parts, i, record, motion) for i, (record, motion) in pairs]
            marginal = Marginal.of(parts, several)
            jump = marginal.needed()
            step = marginal.solve(jump)[1]
            jumps = marginal.jumps(several, jump, step)
            left = tuple(w.left(step, s) for w, s in zip(several, jumps, strict=True))
            before = motions
            motions = [w.moved(step, s) for w, s in zip(several, jumps, strict=True)]
            changes = zip(records, before, motions, strict=True)
            # The linear problem holds near its motion: elsewhere it is set up anew.
            if all(np.abs(b.q - a.q).max() < _NEAR * r.amplitude for r, a, b in changes):
                break
        return cls(marginal, jump, left)
