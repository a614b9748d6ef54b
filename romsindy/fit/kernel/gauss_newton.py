"""Fits by simulation that start from the measured motion.

A hypothesis is a model and the effects added to it. Gauss-Newton's method finds strengths, shapes
and initial states together with the motion itself: every step solves the equation linearised about
the present motion (see `romsindy.fit.kernel.linear_response`), which at first is the smoothed
measurement. Values that make up for one another lie in a curved valley, which a whole step leaves:
a step that makes the misfit worse is taken again, damped as by Levenberg and Marquardt [1].

[1] H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05, DTU (1999).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.equation import ExtendedEquation, equation_of
from romsindy.fit.kernel.hypothesis import NormalEquations
from romsindy.fit.kernel.linear_response import Response, respond_together
from romsindy.fit.kernel.part import (
    Part,
    Solution,
    columns_of,
    held_values,
    limits,
    moved_parts,
    prior_cost,
)
from romsindy.fit.kernel.prepared import Prepared, chi_squared_of
from romsindy.fit.verdict import EXPLAINED
from romsindy.physics.equations import Equations
from romsindy.typing import Array, Indices

_ITERATIONS = 16
# Largest change of the motion in one step, in amplitudes, and the least part of a step.
_LEASH, _SHORTEST = 0.3, 0.02
# Damping of a step that makes the misfit worse: the first, least and largest, and how it grows.
_DAMPED, _LEAST, _MOST, _MORE = 1e-4, 1e-7, 10.0, 4.0
# So much worse a motion may be: far from its end, and near it, for where a force jumps an iterate
# that is no motion of the equation yet looks better than it is.
_FAR, _WORSE = 1.5, 1.05
_OFF_THE_FLOOR, _NEAR = 1.0, 0.02  # of chi-square
_TOGETHER = 2000  # steps of motions that are linearised at once: what a cache holds
_LOST = 1e4  # a linearised motion that goes further than this leads nowhere


def fit(
    model: Equations,
    parts: Sequence[Part],
    records: Sequence[Prepared],
    motions: Sequence[Trajectory] | None = None,
    *,
    fixed: bool = False,
    iterations: int = _ITERATIONS,
    rough: float = 0.0,
) -> Solution:
    """Fit the values of all parts, and the initial states, to all records.

    It starts from the values of the parts, and from some motions: by default the smoothed
    measurement. ``fixed``: initial states, and strengths that differ between records, only. It ends
    where a step, or one that had to be shortened, changes chi-square by less than the ``rough``
    part of what is left beyond the noise: where the form of the equation decides, no digit of its
    values matters.
    """
    parts = tuple(parts)
    motions = list(motions or [r.motion for r in records])
    n_values = sum(p.size for p in parts)
    last, converged, n_samples = np.inf, False, sum(len(r.signal) for r in records)
    loudest = max(r.amplitude for r in records)
    kept: _Iterate | None = None
    back, steps = False, 0  # whether the last step was taken back; those that were not
    damping, more = 0.0, _MORE  # and by how much it grows

    def little(chi_squared: float) -> float:
        return rough * max(chi_squared - EXPLAINED**2 * n_samples, 0.0)

    for _ in range(iterations):
        with np.errstate(all="ignore"):
            system, responses, _ = _linearised(model, parts, records, motions)
            far = kept is not None and (steps == 1 or kept.short < 1)
            worse = _FAR if far or rough else _WORSE
            if kept is not None and not system.power <= worse * kept.system.power:
                system, back = kept.system, True
                if damping >= _MOST or (rough and kept.short < _SHORTEST):
                    break
                if rough:  # the form decides: a shorter step tells as much as one along a valley
                    kept = replace(kept, short=0.3 * kept.short)
                else:
                    damping, more = max(_DAMPED, more * damping), 2 * more
                    kept = kept.again(records, loudest, damping)
                parts, motions = kept.moved()
                continue
            gained = np.inf if kept is None else kept.system.power - system.power
            was_back, back = back, False
            if kept is not None and was_back and max(gained, 0.0) < little(kept.system.power):
                break  # long steps lead astray, and short ones nowhere
            if not system.finite:
                return _failed(parts, motions, n_values)
            if kept is not None and steps > 1 and not rough:
                damping, more = kept.trusted(system.power, damping), _MORE
            held = held_values(parts, fixed, first=steps == 0)
            steps += 1
            start = _Iterate(parts, tuple(responses), system, held)
            kept = start.again(records, loudest, damping)
            if not kept.largest <= _LOST:
                return _failed(parts, motions, n_values)
            parts, motions = kept.moved()
        chi_squared = system.chi_squared(kept.step)
        beyond = little(chi_squared)
        near = abs(last - chi_squared) < _settled(chi_squared) + beyond
        # Along a valley of values that make up for one another a step leaves the curved floor.
        if near and damping:  # of what is damped a whole step would gain next to nothing as well
            near = abs(gained) < _settled(system.power) and kept.to_gain < _OFF_THE_FLOOR
        settles = kept.short == 1.0 and near
        converged = settles and system.power < last + _OFF_THE_FLOOR + beyond
        if converged:
            break
        last = chi_squared
    # The last step led nowhere better than to where it set out from: but for the measured motion,
    # which is none of the equation.
    if back and kept is not None and steps > 1:
        parts, motions = kept.parts, [r.motion for r in kept.responses]
    residuals = tuple(
        r.missed(parts, i, partial(equation_of(model, parts, i, r).sampled, m))
        for i, (r, m) in enumerate(zip(records, motions, strict=True))
    )
    pairs = list(zip(records, residuals, strict=True))
    if any(not float(np.abs(e).max()) <= _LOST * float(np.abs(r.signal).max()) for r, e in pairs):
        return _failed(parts, motions, n_values)  # the last step led nowhere, or to nan
    return Solution(
        parts,
        tuple(motions),
        residuals,
        chi_squared_of(records, residuals) + prior_cost(parts),
        system.covariance()[:n_values, :n_values],
        converged,
    )


def _settled(chi_squared: float) -> float:
    """By how much chi-square may still change."""
    return _NEAR + 1e-6 * chi_squared


@dataclass(frozen=True)
class _Iterate:
    """Where a step started, with the misfit there in its system, and the step."""

    parts: tuple[Part, ...]
    responses: tuple[Response, ...]
    system: NormalEquations
    held: NDArray[np.bool_]
    step: Array = field(default_factory=lambda: np.zeros(0))
    weights: tuple[Array, ...] = ()
    largest: float = 0.0  # change of a motion, in amplitudes
    short: float = 1.0  # part of the step that is gone

    def again(self, records: Sequence[Prepared], loudest: float, damping: float) -> _Iterate:
        """The same with its step, or another one from there."""
        step = self.system.bounded_step(self.held, *limits(self.parts), damping)
        weights = tuple(
            np.concatenate([[1.0], step[columns_of(self.parts, i)], step[self.system.states_of(i)]])
            for i in range(len(records))
        )
        largest = max(  # in a piece where nothing rings any more, of the loudest
            float(np.abs(r.q @ w).max()) / (record.amplitude or loudest)
            for r, w, record in zip(self.responses, weights, records, strict=True)
        )
        short = min(1.0, _LEASH / max(largest, 1e-300))
        return replace(self, step=step, weights=weights, largest=largest, short=short)

    def trusted(self, power: float, damping: float) -> float:
        """The next damping, by what the step gained over what was expected ([1], eq. 2.5)."""
        gained = self.system.power - power
        if gained < -_settled(power):  # back and forth
            return max(_DAMPED, 2 * damping)
        expected = self.system.power - self.system.chi_squared(self.short * self.step)
        part = gained / max(expected, 1e-300)
        less = damping * float(np.clip(1 - (2 * part - 1) ** 3, 0.1, 2.0))
        return less if less > _LEAST else 0.0

    @property
    def to_gain(self) -> float:
        """By how much a whole step would lower chi-square, were all linear."""
        step = self.system.bounded_step(self.held, *limits(self.parts))
        return self.system.power - self.system.chi_squared(step)

    def moved(self) -> tuple[tuple[Part, ...], list[Trajectory]]:
        """Values and motions after the step."""
        pairs = zip(self.responses, self.weights, strict=True)
        values = self.step[: self.system.n_values]
        motions = [r.moved(self.short * w) for r, w in pairs]
        return moved_parts(self.parts, self.short * values), motions


def _linearised(
    model: Equations,
    parts: tuple[Part, ...],
    records: Sequence[Prepared],
    motions: Sequence[Trajectory],
) -> tuple[NormalEquations, list[Response], list[tuple[Indices, Array]]]:
    """Normal equations about the present motions, the responses and the rows that they combine."""
    n_values = sum(p.size for p in parts)
    system = NormalEquations(n_values, len(records), n_coordinates=model.n_coordinates)
    responses, tables = [], []
    several = linear_tables(model, parts, records, motions)
    for i, (response, rows) in enumerate(several):
        where = np.concatenate([columns_of(parts, i), system.states_of(i)])
        system.add(where, rows)
        responses.append(response)
        tables.append((where, rows))
    system.add_priors(parts)
    return system, responses, tables


def coloured_covariance(model: Equations, solution: Solution, records: Sequence[Prepared]) -> Array:
    """Covariance of the values of a fit that converged, for the colour of what it leaves.

    nan where the motion leads far away with a further step.
    """
    system, _, tables = _linearised(model, solution.parts, records, solution.motions)
    n = system.n_values
    return system.coloured(tables)[:n, :n] if system.finite else np.full((n, n), np.nan)


def linear_table(
    model: Equations, parts: tuple[Part, ...], i: int, record: Prepared, motion: Trajectory
) -> tuple[Response, Array]:
    """Response of a motion to all values, and `table` of where it leads, in record i."""
    return next(linear_tables(model, parts, [record], [motion], [i]))


def linear_tables(
    model: Equations,
    parts: tuple[Part, ...],
    records: Sequence[Prepared],
    motions: Sequence[Trajectory],
    numbers: Sequence[int] | None = None,
) -> Iterator[tuple[Response, Array]]:
    """The same of many records, by default numbered as they stand."""
    numbers = numbers or range(len(records))
    pairs = zip(numbers, records, strict=True)
    equations = [equation_of(model, parts, i, record) for i, record in pairs]
    for some in _alike(equations, motions):
        responses = respond_together(equations[some[0]], [motions[k] for k in some])
        for k, response in zip(some, responses, strict=True):
            i, record = numbers[k], records[k]
            change = record.in_orders(parts, response.samples)
            now = record.in_orders(parts, partial(equations[k].sampled, motions[k]))
            x = now + change[..., 0]
            yield response, record.table(parts, i, x, change[..., 1:])


def _alike(
    equations: Sequence[ExtendedEquation], motions: Sequence[Trajectory]
) -> Iterator[list[int]]:
    """Places of motions of one equation that follow each other, as many as a cache holds."""
    some, steps = [0], motions[0].grid.n_steps
    for k, motion in enumerate(motions[1:], 1):
        steps += motion.grid.n_steps
        if steps > _TOGETHER or not equations[some[0]].is_like(equations[k]):
            yield some
            some, steps = [], motion.grid.n_steps
        some.append(k)
    yield some


def _failed(parts: tuple[Part, ...], motions: Sequence[Trajectory], n_values: int) -> Solution:
    """A hypothesis whose motion goes astray: nothing could be worse."""
    residuals = tuple(np.full(len(m.grid.fraction), np.inf) for m in motions)
    nothing = np.zeros((n_values, n_values))
    return Solution(parts, tuple(motions), residuals, np.inf, nothing, False)
