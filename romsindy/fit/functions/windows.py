"""Records compared with an equation, window by window of a few cycles.

An equation with few functions is never exact: other modes move along, sensors drift. Over a whole
decay its small errors add up to a phase that is lost, and a fit that must follow it bends the
functions. Here every window of a few cycles has a start of its own, tied to the end of the window
before by a jump that is allowed: process noise. Without it this is the fit of one simulation to the
whole record (output error); with much of it, one of equations window by window (equation error).
How much there is follows from the data (`romsindy.fit.functions.evidence`). This is weak-constraint
data assimilation [1], linearised about the smoothed measurement, whose phase is right from the
beginning (`romsindy.fit.linear_response`).

[1] Y. Tremolet, "Accounting for an imperfect model in 4D-Var", Q. J. R. Meteorol. Soc. 132 (2006).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from romsindy.fit.collocation import Grid, Trajectory
from romsindy.fit.functions.series import Series
from romsindy.fit.linear_response import Response, nodes, respond, sampled
from romsindy.fit.record import Record
from romsindy.typing import Array, Indices

_LEAST_CYCLES, _MOST_WINDOWS = 3, 40


@dataclass(frozen=True, eq=False)
class Window:
    """A few cycles of a record.

    Attributes
    ----------
    record : int
    rows : array of int
        Its samples.
    motion : Trajectory
        The present motion there, R = 1.
    """

    record: int
    rows: Indices
    motion: Trajectory

    @property
    def amplitude(self) -> float:
        """Largest displacement of the motion."""
        return float(np.abs(self.motion.q).max())


def windows_of(records: Sequence[Record]) -> tuple[Window, ...]:
    """Windows of all records, in the order of time, with their smoothed motions."""
    return tuple(w for i, record in enumerate(records) for w in _of_record(i, record))


def _of_record(number: int, record: Record) -> list[Window]:
    grid, m, cycles = record.motion.grid, record.motion, record.cycles
    size = max(_LEAST_CYCLES, int(np.ceil(len(cycles) / _MOST_WINDOWS)))
    # The first and the last window are no shorter than the others.
    inner = grid.sample_step[cycles[size : max(len(cycles) - size, 0) : size]]
    windows = []
    for first, last in itertools.pairwise(np.unique([0, *inner, grid.n_steps])):
        rows = np.flatnonzero((grid.sample_step >= first) & (grid.sample_step < last))
        own = Grid(
            grid.start + first * grid.step,
            grid.step,
            int(last - first),
            grid.sample_step[rows] - first,
            grid.fraction[rows],
        )
        states = slice(first, last + 1)
        motion = Trajectory(own, m.q[states], m.q_dot[states], m.q_ddot[first:last])
        windows.append(Window(number, rows, motion))
    return windows


@dataclass(frozen=True, eq=False)
class Block:
    """What one window says, linearised: rows for the values, its start, and the signal.

    ``rows`` (p + 3, p + 3) are the triangle of derivatives by values and by q and q_dot at the
    start, and of the signal (absolute, in whitened samples). The state at the end is ``end`` (2,
    p + 2) times values and start, plus ``rest`` (2,).
    """

    window: Window
    response: Response
    rows: Array
    end: Array
    rest: Array

    def moved(self, step: Array) -> Window:
        """The window with its motion moved by changes of values and start, (p + 2,)."""
        return replace(self.window, motion=self.response.moved(np.concatenate([[1.0], step])))

    def change(self, step: Array) -> float:
        """Largest change of the motion by a step, in amplitudes."""
        change = self.response.q[:, 0] @ np.concatenate([[1.0], step])
        return float(np.abs(change).max()) / self.window.amplitude


def linearised(
    series: Series, windows: Sequence[Window], records: Sequence[Record]
) -> tuple[Block, ...]:
    """Every window linearised about its present motion."""
    return tuple(_block(series, w, records[w.record]) for w in windows)


def _block(series: Series, window: Window, record: Record) -> Block:
    m, series = window.motion, series.near(window.amplitude)
    response = respond(series, m, series.by_parameter(*nodes(m)))
    x = sampled(m, record.derivative)[:, 0]
    shown, slope = series.shown(x, record.derivative, window.record)
    change = slope[:, None] * response.samples(record.derivative)[:, 0]
    change[:, 1:-2] += series.shown_by_value(x, record.derivative, window.record)
    there = np.concatenate([series.values, m.start])
    target = record.signal[window.rows] - shown - change[:, 0]
    rows = np.column_stack([change[:, 1:], target + change[:, 1:] @ there])
    rows *= (record.valid[window.rows] / record.noise.std)[:, None]
    end = np.stack([response.q[-1, 0], response.q_dot[-1, 0]])
    reached = np.array([m.q[-1, 0], m.q_dot[-1, 0]]) + end[:, 0] - end[:, 1:] @ there
    return Block(window, response, _triangle(rows), end[:, 1:], reached)


def _triangle(rows: Array) -> Array:
    """Upper triangle R with R' R = rows' rows, square."""
    n = rows.shape[1]
    r = np.asarray(np.linalg.qr(rows, mode="r"))
    return r if len(r) == n else np.concatenate([r, np.zeros((n - len(r), n))])


@dataclass(frozen=True, eq=False)
class Reduced:
    """What all windows say of the values alone: starts eliminated, best ones as a function.

    ``rows`` (p + 1, p + 1) are the triangle for values and signal; minus the logarithm of the
    likelihood of values x is |rows (x, -1)|^2 / 2 + ``cost``.
    """

    rows: Array
    cost: float
    starts: tuple[Array, ...]  # (2, 2 + [2] + p + 1) of each window

    def states(self, values: Array) -> list[Array]:
        """Best q and q_dot at the start of every window, (2,) each."""
        found: list[Array] = []
        for rows in reversed(self.starts):
            known = values if rows.shape[1] == len(values) + 3 else np.r_[found[-1], values]
            found.append(np.linalg.solve(rows[:, :2], rows[:, -1] - rows[:, 2:-1] @ known))
        return found[::-1]


def reduced(
    blocks: Sequence[Block], rate: float, noise: float, jump: float, known: Array
) -> Reduced:
    """Eliminate the starts of all windows, one after the other.

    Parameters
    ----------
    blocks : sequence of Block
    rate : float
        Angular frequency of the motion, rad/s.
    noise : float
        Of the whitened signals, 1 where their noise is as known.
    jump : float
        Standard deviation of process noise from window to window, as a part of the amplitude.
    known : (m, p + 1) array
        Further rows for the values: what is known beforehand, over its error.
    """
    p = blocks[0].rows.shape[1] - 3
    carry = np.zeros((p + 1, p + 3))  # columns: start of the window, values, signal
    carry[:, 2:] = _triangle(np.concatenate([known, np.zeros((p + 1, p + 1))]))
    cost = 0.0
    starts: list[Array] = []
    for block, after in itertools.zip_longest(blocks, blocks[1:]):
        own = block.rows[:, [p, p + 1, *range(p), p + 2]] / noise
        rows = np.concatenate([carry, own])
        if after is not None and after.window.record == block.window.record:
            error = jump * block.window.amplitude * np.array([1.0, rate])
            tie = np.column_stack([block.end[:, p:], -np.eye(2), block.end[:, :p], -block.rest])
            wide = np.concatenate([rows[:, :2], np.zeros((len(rows), 2)), rows[:, 2:]], axis=1)
            rows = np.concatenate([wide, tie / error[:, None]])
            cost += float(np.sum(np.log(error)))
        r = np.asarray(np.linalg.qr(rows, mode="r"))
        cost += float(np.sum(np.log(np.abs(np.diag(r)[:2]))))
        starts.append(r[:2])
        left = r[2:, 2:]
        # The next window of another record starts afresh.
        carry = left if left.shape[1] == p + 3 else np.pad(left, ((0, 0), (2, 0)))
    return Reduced(carry[: p + 1, 2:], cost, tuple(starts))
