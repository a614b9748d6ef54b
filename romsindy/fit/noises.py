"""Two noises of one record: a force that nobody measured, and that of the sensor, with a colour.

    model(q, q_dot, q_ddot) = inputs + w(t)        w: white, of some intensity
    y = reading(q) + n                             n: each sample keeps a part of the one before it

A force that is not known moves the state a little at every step, and the linearised equation
carries that on. What is left of a record is then the smallest sum of such moves that the noise of
the sensor allows: weak-constraint variational assimilation [1], a banded system. The covariance of
the residual is never formed; both sizes and the colour are those of the largest likelihood.

[1] Y. Tremolet, Q. J. R. Meteorol. Soc. 132 (2006) 2483.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.optimize import minimize
from scipy.sparse import bsr_matrix, csr_matrix, spmatrix

from romsindy.fit.any_record import AnyRecord
from romsindy.fit.collocation import Trajectory
from romsindy.fit.linear_response import sampled, states_shown
from romsindy.fit.linear_steps import Equation, LinearSteps
from romsindy.fit.part import Part, in_orders
from romsindy.typing import Array

# Where the search for the noises starts: colours, and intensities of the force, as powers of e on
# the one whose response has the power of the sensor's noise.
_COLOURS, _FORCES = (0.0, 0.9), (-16.0, -8.0, -3.0, 1.0, 5.0, 10.0)
_WIDEST, _WHITEST = 22.0, 3.0  # powers of e, and of the inverse hyperbolic tangent of the colour
# Samples that tell the noises, and windows of a longer record in which they are.
_ENOUGH, _WINDOWS = 8000, 4
# The covariance of q and h q_dot at the end of a step of length 1 by a white force in it, inverted
# and as a square.
_MOVED = np.linalg.cholesky(np.linalg.inv([[1 / 3, 1 / 2], [1 / 2, 1.0]])).T


class Noises(NamedTuple):
    """Sizes of both noises.

    ``force`` is the intensity of the force, (unit of q / s^2)^2 s, ``sensor`` the standard
    deviation of what a sample adds, measured unit, ``colour`` the correlation with the one before.
    """

    force: float
    sensor: float
    colour: float

    @property
    def shown(self) -> float:
        """Standard deviation of the sensor's noise, measured unit."""
        return self.sensor / float(np.sqrt(1 - self.colour**2))


class Weighed(NamedTuple):
    """Products of columns, weighed by the inverse of a covariance, and its log-determinant."""

    products: Array
    log_determinant: float


class _OneLag(NamedTuple):
    """A sum over samples as it depends on the colour a: same - a lagged + a^2 inner."""

    same: Array
    lagged: Array
    inner: Array

    def at(self, colour: float) -> Array:
        return self.same - colour * self.lagged + colour**2 * self.inner


@dataclass(frozen=True, eq=False)
class TwoNoises:
    """The covariance of what is left of one record, whatever the sizes of its noises.

    Parameters
    ----------
    shown : (n, n_unknowns) sparse array
        What samples show of the states at the steps.
    moves : (n_unknowns - 2 R, n_unknowns) sparse array
        Moves of the states from step to step, over their size by a force of intensity 1.
    usual : float
        Intensity of the force whose response has the power of a sensor's noise of 1.
    """

    shown: spmatrix
    moves: spmatrix
    usual: float

    @classmethod
    def along(
        cls,
        equation: Equation,
        parts: Sequence[Part],
        number: int,
        record: AnyRecord,
        motion: Trajectory,
    ) -> TwoNoises:
        """About a motion of a hypothesis in the record that has this number."""
        grid, r = motion.grid, motion.q.shape[1]
        t = grid.node_times(0, grid.n_steps)
        system = LinearSteps.at(equation, grid.step, t, motion.q, motion.q_dot, motion.q_ddot)
        unit = np.repeat([1.0, grid.step], r)  # states are q and h q_dot
        orders = record.orders(parts)
        at, _ = states_shown(grid, system, orders[0])
        change = in_orders(orders, lambda order: states_shown(grid, system, order)[1]) / unit
        x = in_orders(orders, partial(sampled, motion))
        seen = record.read(parts, number, x).by_motion(change)
        places = at[:, None] * 2 * r + np.arange(2 * r)
        ends = np.arange(0, seen.size + 1, 2 * r)
        shape = (len(seen), 2 * r * (grid.n_steps + 1))
        shown = csr_matrix((seen.ravel(), places.ravel(), ends), shape=shape)
        transition = unit[:, None] * system.transition / unit
        mass = system.mass.reshape(-1, 3, r, r)[:, 1]
        size = np.einsum("ij,nab->niajb", _MOVED, mass).reshape(-1, 2 * r, 2 * r)
        size /= grid.step**1.5
        blocks = np.stack([-size @ transition, size], axis=1).reshape(-1, 2 * r, 2 * r)
        columns = np.arange(grid.n_steps)[:, None] + np.arange(2)
        rows = 2 * np.arange(grid.n_steps + 1)
        moves = bsr_matrix((blocks, columns.ravel(), rows)).tocsr()
        return cls(shown, moves, _usual(transition, seen, grid.step))

    def between(self, first: int, last: int) -> TwoNoises:
        """Samples first to last - 1, from a state of their own on."""
        places = self.shown[first:last].indices
        wide = self.moves.shape[1] - self.moves.shape[0]  # of a state
        low, high = places.min() // wide * wide, (places.max() // wide + 1) * wide
        shown = self.shown[first:last, low:high]
        return replace(self, shown=shown, moves=self.moves[low : high - wide, low:high])

    @cached_property
    def _bands(self) -> tuple[_OneLag, Array]:
        h = self.shown
        lagged = h[1:].T @ h[:-1]
        sums = [h.T @ h, lagged + lagged.T, h[1:-1].T @ h[1:-1], self.moves.T @ self.moves]
        wide = max(int(_offsets(s).max(initial=0)) for s in sums)
        *own, moved = (_band(s, wide) for s in sums)
        return _OneLag(*own), moved

    def table(self, columns: Array) -> Table:
        """Columns (n, m) that are weighed, for some noises or others."""
        h, y = self.shown, columns
        lagged = y[1:].T @ y[:-1]
        own = _OneLag(y.T @ y, lagged + lagged.T, y[1:-1].T @ y[1:-1])
        crossed = h[1:].T @ y[:-1] + h[:-1].T @ y[1:]
        return Table(self, own, _OneLag(h.T @ y, crossed, h[1:-1].T @ y[1:-1]))


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one record, of which the last is what is left of it."""

    noises: TwoNoises
    own: _OneLag
    crossed: _OneLag

    def products(self, noises: Noises) -> Array:
        """Of all columns, over these noises."""
        relative = noises.force / noises.sensor**2
        return self.weighed(relative, noises.colour).products / noises.sensor**2

    def weighed(self, force: float, colour: float) -> Weighed:
        """By the inverse of the covariance; the sensor adds 1 at each sample, ``force`` > 0."""
        bands, moved = self.noises._bands
        factor = cholesky_banded(bands.at(colour) + moved / force, lower=True)
        crossed = self.crossed.at(colour)
        products = self.own.at(colour) - crossed.T @ cho_solve_banded((factor, True), crossed)
        moves = self.noises.moves.shape[0]
        spread = 2 * np.sum(np.log(factor[0])) + moves * np.log(force) - np.log(1 - colour**2)
        return Weighed(products, float(spread))


def found_noises(noises: TwoNoises, left: Array) -> Noises:
    """Noises of the largest likelihood in what a fit leaves of a record, (n,), measured unit."""
    some = [slice(0, len(left))] if len(left) <= _ENOUGH else _windows(len(left))
    tables = [noises.between(w.start, w.stop).table(left[w, None]) for w in some]
    states = noises.shown.shape[1] - noises.moves.shape[0]
    freedom = sum(len(left[w]) - states for w in some)
    usual = np.log(noises.usual)

    def weighed(force: float, colour: float) -> tuple[float, float]:
        both = [t.weighed(np.exp(force + usual), np.tanh(colour)) for t in tables]
        return sum(float(w.products[0, 0]) for w in both), sum(w.log_determinant for w in both)

    def cost(at: Sequence[float] | Array) -> float:
        force, colour = at
        if abs(force) > _WIDEST or abs(colour) > _WHITEST:
            return np.inf
        try:
            chi_squared, spread = weighed(force, colour)
        except LinAlgError:
            return np.inf
        return freedom * float(np.log(chi_squared)) + spread if chi_squared > 0 else np.inf

    best = min(((f, np.arctanh(c)) for f in _FORCES for c in _COLOURS), key=cost)
    simplex = np.add(best, [[0.0, 0.0], [1.5, 0.0], [0.0, 0.3]])
    options = {"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.05, "maxiter": 60}
    force, colour = minimize(cost, best, method="Nelder-Mead", options=options).x
    sensor = np.sqrt(weighed(force, colour)[0] / freedom)
    return Noises(float(np.exp(force + usual) * sensor**2), float(sensor), float(np.tanh(colour)))


def _windows(n: int) -> list[slice]:
    """Spread over n samples."""
    length = _ENOUGH // _WINDOWS
    starts = np.linspace(0, n - length, _WINDOWS).round().astype(int)
    return [slice(int(a), int(a) + length) for a in starts]


def _usual(transition: Array, seen: Array, step: float) -> float:
    """By the response of an oscillator, of variance S / (4 zeta omega^3) in q."""
    decay = -float(np.mean(np.linalg.slogdet(transition)[1])) / (len(transition[0]) * step)
    turn = np.abs(np.angle(np.linalg.eigvals(transition).astype(complex)))
    omega = max(float(np.mean(turn)) / step, 1e-12)
    q = np.sqrt(np.mean(np.sum(seen**2, axis=-1)))  # a sample for a state of 1
    return 4 * max(decay, 1e-3 * omega) * omega**2 / max(float(q) ** 2, 1e-300)


def _offsets(a: spmatrix) -> Array:
    entries = a.tocoo()
    return np.abs(entries.row - entries.col)


def _band(a: spmatrix, wide: int) -> Array:
    """Lower diagonals of a symmetric matrix, (wide + 1, n), as LAPACK takes them."""
    entries, band = a.tocoo(), np.zeros((wide + 1, a.shape[0]))
    low = entries.row >= entries.col
    rows, columns = entries.row[low], entries.col[low]
    band[rows - columns, columns] = entries.data[low]
    return band
