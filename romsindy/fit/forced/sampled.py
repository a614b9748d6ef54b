"""A measured input at the times of a simulation."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from romsindy.fit.collocation import Grid
from romsindy.fit.linear_steps import NODES
from romsindy.physics.input import Input
from romsindy.record.interpolation import of_steps
from romsindy.typing import Array

_PLACES = np.array([0.0, *NODES, 1.0])  # where a simulation asks for it, in a step
_KEPT = 4  # tables: a fit asks for the same one again and again


@dataclass(frozen=True, eq=False)
class Sampled:
    """Samples (n,) of an input, ``dt`` seconds apart from the start of the record, on a grid."""

    u: Array
    dt: float
    grid: Grid
    tables: dict[Input, Array] = field(default_factory=dict, repr=False)

    def at(self, t: Array, term: Input) -> Array:
        """What acts of it at times of the simulation, (n,).

        At Gauss points, those values that stand for their step, see `of_steps`.
        """
        table = self._table(term)
        place = (t - self.grid.start) / self.grid.step
        step = np.floor(place + 1e-6).astype(int)
        column = np.argmin(np.abs((place - step)[:, None] - _PLACES), axis=1)
        return table[step + column // 4, column % 4]

    def _table(self, term: Input) -> Array:
        """At the start and the Gauss points of each step, (n_steps + 1, 4)."""
        if term not in self.tables:
            grid, length = self.grid, self.grid.step / self.dt
            starts = (grid.start - term.delay) / self.dt + length * np.arange(grid.n_steps + 1)
            values = partial(term.at, self.u, dt=self.dt)
            inside = of_steps(values, starts, length, NODES, term.interpolation == "band-limited")
            while len(self.tables) >= _KEPT:
                self.tables.pop(next(iter(self.tables)))
            self.tables[term] = np.column_stack([values(starts), inside])
        return self.tables[term]
