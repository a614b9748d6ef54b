"""Records compared with an equation, window by window of a few cycles.

An equation with few functions is never exact: other modes move along, sensors drift. Over a whole
decay its small errors add up to a phase that is lost, and a fit that must follow it bends the
functions. Here every window of a few cycles has a start of its own, tied to the end of the window
before by a jump that is allowed: process noise. Without it this is the fit of one simulation to the
whole record (output error); with much of it, one of equations window by window (equation error).
How much there is follows from the data (`romsindy.fit.functions.evidence`). This is weak-constraint
data assimilation [1], linearised about the smoothed measurement, whose phase is right from the
beginning (`romsindy.fit.kernel.linear_response`).

[1] Y. Tremolet, "Accounting for an imperfect model in 4D-Var", Q. J. R. Meteorol. Soc. 132 (2006).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from romsindy.fit.functions.series import Series
from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.linear_response import Response, respond, sampled
from romsindy.fit.records.record import Record
from romsindy.typing import Array, Indices


@dataclass(frozen=True, eq=False)
class Window:
    """A few cycles of a record."""

    record: int
    rows: Indices  # its samples
    motion: Trajectory  # the present motion there, R = 1

    @property
    def amplitude(self) -> float:
        """Largest displacement of the motion."""
        return float(np.abs(self.motion.q).max())


def windows_of(records: Sequence[Record]) -> tuple[Window, ...]:
    """Windows of all records, in the order of time, with their smoothed motions."""
    return tuple(w for i, record in enumerate(records) for w in _of_record(i, record))


def _of_record(number: int, record: Record) -> list[Window]:
    at = record.motion.grid.sample_step
    return [
        Window(
            number, np.flatnonzero((at >= first) & (at < last)), record.motion.between(first, last)
        )
        for first, last in itertools.pairwise(record.window_steps.tolist())
    ]


@dataclass(frozen=True, eq=False)
class Block:
    """One window, linearised about its motion."""

    window: Window
    response: Response
    # (n, p + 2), derivatives of what the sensor shows by the values and by q and q_dot at the
    # start; none where it shows nothing
    change: Array
    signal: Array  # (n,), what these times values and start have to be
    # (2, p + 2), the same derivatives of the state at the end; with ``rest`` (2,) it is that state
    end: Array
    rest: Array  # (2,)

    def moved(self, step: Array) -> Window:
        """The window with its motion moved by changes of values and start, (p + 2,)."""
        return replace(self.window, motion=self.response.moved(np.concatenate([[1.0], step])))

    def size_of(self, step: Array) -> float:
        """Largest change of the motion by a step, in amplitudes."""
        change = self.response.q[:, 0] @ np.concatenate([[1.0], step])
        return float(np.abs(change).max()) / self.window.amplitude


def block(series: Series, window: Window, record: Record) -> Block:
    """A window of a record, linearised about its motion."""
    m, series = window.motion, series.near(window.amplitude)
    response = respond(series, m)
    x = sampled(m, record.derivative)[:, 0]
    shown, slope = series.shown(x, record.derivative, window.record)
    change = slope[:, None] * response.samples(record.derivative)[:, 0]
    change[:, 1:-2] += series.shown_by_value(x, record.derivative, window.record)
    there = np.concatenate([series.values, m.start])
    signal = record.signal[window.rows] - shown - change[:, 0] + change[:, 1:] @ there
    valid = record.valid[window.rows]
    end = np.stack([response.q[-1, 0], response.q_dot[-1, 0]])
    reached = np.array([m.q[-1, 0], m.q_dot[-1, 0]]) + end[:, 0] - end[:, 1:] @ there
    change, signal = change[:, 1:] * valid[:, None], signal * valid
    return Block(window, response, change, signal, end[:, 1:], reached)


@dataclass(frozen=True, eq=False)
class Linear:
    """All windows of one record, linearised, and what they say over the noise."""

    record: Record
    blocks: tuple[Block, ...]
    # (2 K + p + 1, 2 K + p + 1), of the starts of all windows, of the values and of the signal:
    # products with it are those of the whitened samples
    rows: Array

    @classmethod
    def of(cls, series: Series, windows: Sequence[Window], record: Record) -> Linear:
        """Linearise about the present motions."""
        blocks = tuple(block(series, w, record) for w in windows)
        tables = [np.column_stack([b.change, b.signal]) for b in blocks]
        rows = _alone if record.noise.alike or record.noise.one_by_one else _together
        return cls(record, blocks, rows(record, tables))

    def whitened(self, changes: Array) -> list[Array]:
        """Whitened samples of every window for columns of starts, values and signal, (.., m)."""
        tables = [np.column_stack([b.change, b.signal]) for b in self.blocks]
        return _like(tables, self.record.over_noise(_side_by_side(tables) @ changes))

    def left(self, values: Array, starts: Array) -> Array:
        """Misfit in the directions of ``rows``."""
        return self.rows @ np.concatenate([starts.ravel(), values, [-1.0]])


def _alone(record: Record, tables: Sequence[Array]) -> Array:
    """Rows as in `Linear`, of samples that are weighed one by one."""
    white = _like(tables, record.over_noise(np.concatenate(tables)))
    return _triangle(_side_by_side([_triangle(x) for x in white]))


def _together(record: Record, tables: Sequence[Array]) -> Array:
    """The same of noise that remembers, across windows, too: all samples are made white as one.

    They lie in few directions, which are found window by window.
    """
    own = [np.linalg.qr(x) for x in tables]
    triangles = [r for _, r in own]
    outer, inner = np.linalg.qr(_side_by_side(triangles))
    pairs = zip(own, _like(triangles, outer), strict=True)
    white = record.cosines(np.concatenate([q @ x for (q, _), x in pairs]))
    return root(white.T @ white, inner)


def root(products: Array, inner: Array) -> Array:
    """R (n, m) with R' R = inner' products inner, (n, m)."""
    if not np.all(np.isfinite(products)):  # the motion goes astray, and so will what follows
        return np.full_like(inner, np.nan)
    power, axes = np.linalg.eigh(products)
    return np.asarray(np.sqrt(np.maximum(power, 0.0))[:, None] * (axes.T @ inner))


def _like(tables: Sequence[Array], joined: Array) -> list[Array]:
    """Rows of all windows as those of each."""
    return np.split(joined, np.cumsum([len(t) for t in tables])[:-1])


def _side_by_side(tables: Sequence[Array]) -> Array:
    """Rows for values, a start and the signal of each window, as rows for all starts and values."""
    k, p = len(tables), tables[0].shape[1] - 3
    wide = np.zeros((sum(map(len, tables)), 2 * k + p + 1))
    for i, (table, rows) in enumerate(zip(tables, _like(tables, wide), strict=True)):
        rows[:, 2 * i : 2 * i + 2], rows[:, 2 * k : -1] = table[:, p : p + 2], table[:, :p]
        rows[:, -1] = table[:, -1]
    return wide


def linearised(
    series: Series, windows: Sequence[Window], records: Sequence[Record]
) -> tuple[Linear, ...]:
    """Every record linearised about the present motions of its windows."""
    several = itertools.groupby(windows, lambda w: w.record)
    return tuple(Linear.of(series, list(own), records[i]) for i, own in several)


def _triangle(rows: Array) -> Array:
    """Upper triangle R with R' R = rows' rows, square."""
    n = rows.shape[1]
    r = np.asarray(np.linalg.qr(rows, mode="r"))
    return r if len(r) == n else np.concatenate([r, np.zeros((n - len(r), n))])


@dataclass(frozen=True, eq=False)
class Reduced:
    """What all windows say of the values alone: starts eliminated, best ones as a function.

    ``rows`` (p + 1, p + 1) are the triangle for values and signal; minus the logarithm of the
    likelihood of values x is |rows (x, -1)|^2 / 2 + ``cost``. ``starts`` (2 K, p + 1) times
    (x, -1) is minus the best starts of each record.
    """

    rows: Array
    cost: float
    starts: tuple[Array, ...]

    def states(self, values: Array) -> list[Array]:
        """Best q and q_dot at the starts of the windows of every record, (K, 2) each."""
        return [(-s @ np.append(values, -1.0)).reshape(-1, 2) for s in self.starts]


def reduced(
    several: Sequence[Linear], rate: float, noise: float, jump: float, known: Array
) -> Reduced:
    """Eliminate the starts of all windows.

    ``rate`` is the angular frequency of the motion, rad/s, ``noise`` that of the whitened signals
    (1 where it is as known), ``jump`` the standard deviation of process noise from window to
    window, as a part of the amplitude; ``known`` (m, p + 1) are further rows for the values, over
    their error.
    """
    cost, starts, rows = 0.0, [], [known]
    for linear in several:
        # A force that moves the states at every step leaves no starts to be tied.
        ties, error = _ties(linear.blocks, rate, jump) if linear.blocks else (known[:0], np.ones(0))
        r = np.asarray(np.linalg.qr(np.concatenate([linear.rows / noise, ties]), mode="r"))
        k = 2 * len(linear.blocks)
        cost += float(np.sum(np.log(error)) + np.sum(np.log(np.abs(np.diag(r)[:k]))))
        starts.append(solve_triangular(r[:k, :k], r[:k, k:], check_finite=False))
        rows.append(r[k:, k:])
    return Reduced(_triangle(np.concatenate(rows)), cost, tuple(starts))


def _ties(blocks: Sequence[Block], rate: float, jump: float) -> tuple[Array, Array]:
    """Rows that tie the start of a window to the end of the one before, and their errors."""
    amplitude = np.array([b.window.amplitude for b in blocks[:-1]])
    error = (jump * amplitude[:, None] * np.array([1.0, rate])).ravel()
    ends = _side_by_side([np.column_stack([b.end, -b.rest]) for b in blocks])[:-2]
    at = np.arange(len(ends))
    ends[at, at + 2] -= 1.0
    return ends / error[:, None], error
