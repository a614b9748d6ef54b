"""Fits whose motions satisfy the equation exactly: each follows from its initial state.

`romsindy.fit.kernel.gauss_newton` starts from the measured motion and needs no good guess, but its
motions come to satisfy the equation only as it converges. From where it ends, single shooting goes
on with motions that always do. It forgives outliers, and it settles where a structure is wrong.

Fits to parts of the records, which become longer until the records are whole.

Over few cycles no phase is lost, whatever is still missing from the model. Pieces have each an
initial state of its own: multiple shooting [1]. Where a structure is wrong and Gauss-Newton's
method about the measured motion does not settle, the first cycles are fitted alone: values found
there start the fit of a few cycles more.

[1] H. G. Bock, "Recent Advances in Parameter Identification Techniques for O.D.E.", in: Numerical
Treatment of Inverse Problems in Differential and Integral Equations, 1983.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.optimize import least_squares

from romsindy.fit.kernel.collocation import GROWN, Trajectory, TrajectoryError, integrate
from romsindy.fit.kernel.equation import ExtendedEquation, equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.hypothesis import NormalEquations
from romsindy.fit.kernel.linear_response import nodes, sensitivity
from romsindy.fit.kernel.part import (
    Part,
    Solution,
    columns_of,
    extended,
    held_values,
    limits,
    moved_parts,
    prior_cost,
    priors,
)
from romsindy.fit.kernel.prepared import ACCELERATION, Prepared, chi_squared_of
from romsindy.physics.equations import Equations
from romsindy.typing import Array, Indices

_EVALUATIONS = 40
# Chi-square is about the number of samples: a change of it by this part is far below one.
TOLERANCE = 1e-6
_OUTLIER = 3.0  # residual over noise from which a robust loss forgives
# A simulated motion this many times the noise away is as bad as none.
_FAR = 1e9
LOSSES = ("linear", "soft_l1")


@dataclass
class _Problem:
    """Whitened misfits as a function of the values of all parts, then of the initial states."""

    model: Equations
    parts: tuple[Part, ...]
    records: Sequence[Prepared]
    motions: list[Trajectory]  # the last ones, from which the next are found
    say: Callable[[str], None]

    def __post_init__(self) -> None:
        self.n_values = sum(p.size for p in self.parts)
        start = [p.values for p in self.parts]
        self.start = np.concatenate([*start, *(m.start for m in self.motions)])
        self._simulated: Array | None = None  # values of the last motions

    def at(self, values: Array) -> tuple[tuple[Part, ...], list[ExtendedEquation]]:
        """Parts and equations with other values."""
        parts = moved_parts(self.parts, values[: self.n_values] - self.start[: self.n_values])
        return parts, [equation_of(self.model, parts, i, r) for i, r in enumerate(self.records)]

    def simulate(self, values: Array) -> list[Trajectory]:
        """Motions from the initial states among the values."""
        if self._simulated is not None and np.array_equal(values, self._simulated):
            return self.motions
        _, equations = self.at(values)
        states = values[self.n_values :].reshape(len(self.records), -1)
        triples = zip(equations, states, self.records, self.motions, strict=True)
        self.motions = [integrate(e, s, r.motion.grid, m) for e, s, r, m in triples]
        self._simulated = values.copy()
        return self.motions

    def residuals(self, values: Array) -> list[Array]:
        """Measured minus simulated, (n,) of each record."""
        parts, equations = self.at(values)
        motions = zip(self.records, equations, self.simulate(values), strict=True)
        return [r.missed(parts, i, partial(_shown, e, m)) for i, (r, e, m) in enumerate(motions)]

    def misfit(self, values: Array) -> Array:
        """Whitened residuals, and what was known beforehand."""
        self.say("simulation")
        try:
            pairs = zip(self.records, self.residuals(values), strict=True)
            rows = np.concatenate([r.whitened(e) for r, e in pairs])
        except TrajectoryError:
            rows = np.array([np.inf])
        if np.abs(rows).max() > _FAR:  # nan is a step too far: the solver shortens it
            return np.full(
                sum(len(r.signal) for r in self.records) + len(priors(self.parts)), np.nan
            )
        known = [off / spread for _, off, spread in priors(self.at(values)[0])]
        return np.concatenate([rows, known])

    def tables(self, values: Array) -> list[tuple[Indices, Array]]:
        """Sensitivities and misfit over noise about the simulated motions, for each record.

        Before them places of their columns among the values of all parts, then the states.
        """
        parts, equations = self.at(values)
        motions = zip(self.records, equations, self.simulate(values), strict=True)
        found: list[tuple[Indices, Array]] = []
        for i, (record, equation, motion) in enumerate(motions):
            with np.errstate(all="ignore"):
                slopes = record.in_orders(parts, partial(sensitivity, equation, motion))
            if not np.all(np.abs(slopes) < GROWN):  # nan is not
                raise TrajectoryError("small disturbances of the motion grow without bound", motion)
            x = record.in_orders(parts, partial(_shown, equation, motion))
            n = len(motion.start)
            states = self.n_values + n * i + np.arange(n)
            where = np.concatenate([columns_of(parts, i), states])
            found.append((where, record.table(parts, i, x, slopes)))
        return found

    def jacobian(self, values: Array) -> Array:
        """Derivatives of `misfit`."""
        known = [-np.eye(1, len(values), at) / spread for at, _, spread in priors(self.parts)]
        own = []
        for where, rows in self.tables(values):
            wide = np.zeros((len(rows), len(values)))
            wide[:, where] = -rows[:, :-1]
            own.append(wide)
        return np.concatenate([*own, *known])


def simulated(
    model: Equations,
    parts: Sequence[Part],
    records: Sequence[Prepared],
    motions: Sequence[Trajectory],
) -> tuple[list[Trajectory], list[Array]]:
    """Motions from the initial states of some, and what they leave of the records.

    Raises a TrajectoryError if there is no such motion.
    """
    problem = _Problem(model, tuple(parts), records, list(motions), lambda _: None)
    return problem.simulate(problem.start), problem.residuals(problem.start)


def resimulated(model: Equations, solution: Solution, records: Sequence[Prepared]) -> Solution:
    """A solution with motions that satisfy its equation, from the initial states of its own.

    Raises a TrajectoryError if there are none.
    """
    motions, left = simulated(model, solution.parts, records, solution.motions)
    total = chi_squared_of(records, left) + prior_cost(solution.parts)
    return replace(
        solution, motions=tuple(motions), residuals=tuple(left), chi_squared=total, converged=True
    )


def _shown(equation: ExtendedEquation, motion: Trajectory, derivative: int) -> Array:
    if derivative == ACCELERATION and equation.jumping:
        return equation.sampled(motion, derivative)
    return motion.samples(equation, derivative)


def simulated_misfit(
    model: Equations,
    parts: Sequence[Part],
    records: Sequence[Prepared],
    motions: Sequence[Trajectory],
) -> Array:
    """Whitened misfit of all records, simulated from the initial states of some motions."""
    problem = _Problem(model, tuple(parts), records, list(motions), lambda _: None)
    rows = problem.misfit(problem.start)
    if not np.all(np.isfinite(rows)):
        raise TrajectoryError("the first motions cannot be simulated, or lead far away")
    return rows


def shoot(
    model: Equations,
    parts: Sequence[Part],
    records: Sequence[Prepared],
    motions: Sequence[Trajectory],
    *,
    fixed: bool = False,
    loss: str = "linear",
    evaluations: int = _EVALUATIONS,
    tolerance: float = TOLERANCE,
    progress: Callable[[str], None] | None = None,
) -> tuple[Solution, Array]:
    """Fit the values of all parts and the initial states, from those of some motions on.

    As `romsindy.fit.kernel.gauss_newton.fit`; a ``loss`` "soft_l1" forgives outliers. It ends at a
    relative change of chi-square by the ``tolerance``, or after so many ``evaluations``, each a
    simulation, and gives the covariance of the values (n_values, n_values) for the colour that the
    residuals really have. Raises a TrajectoryError if the first motions cannot be simulated, or
    small disturbances of one grow beyond all numbers.
    """
    parts = tuple(parts)
    problem = _Problem(model, parts, records, list(motions), progress or (lambda _: None))
    simulated_misfit(model, parts, records, motions)
    free = np.ones(len(problem.start), bool)
    free[: problem.n_values] = ~held_values(parts, fixed, first=False)
    low, high = np.full((2, len(free)), np.inf) * np.array([[-1], [1]])
    for end, change in zip((low, high), limits(parts), strict=True):
        end[: problem.n_values] = problem.start[: problem.n_values] + change
    free &= low < high

    def whole(x: Array) -> Array:
        values = problem.start.copy()
        values[free] = x
        return values

    converged = interrupted = False
    try:
        result = least_squares(
            lambda x: problem.misfit(whole(x)),
            np.clip(problem.start, low, high)[free],
            lambda x: problem.jacobian(whole(x))[:, free],
            bounds=(low[free], high[free]),
            x_scale="jac",
            loss=loss,
            f_scale=_OUTLIER,
            ftol=tolerance,
            xtol=1e-9,
            max_nfev=evaluations,
        )
        values, converged = whole(result.x), bool(result.success)
    except KeyboardInterrupt:
        values, interrupted = problem.start, True
    n = problem.n_values
    system = NormalEquations(n, len(records), n_coordinates=model.n_coordinates)
    tables = problem.tables(values)
    for where, rows in tables:
        system.add(where, rows)
    system.add_priors(problem.at(values)[0])
    solution = Solution(
        problem.at(values)[0],
        tuple(problem.motions),
        tuple(problem.residuals(values)),
        system.power,
        system.covariance()[:n, :n],
        converged,
        interrupted,
    )
    return solution, system.coloured(tables)[:n, :n]


R = TypeVar("R", bound=Prepared)
# Cycles of the slowest coordinate in the first pieces, and at least so many beats of the two that
# are nearest; by about how much they grow.
_CYCLES, _BEATS, _GROWTH = 10.0, 2.0, 2.0
_ROUGH = 1e-3  # change of chi-square, of what is left beyond the noise, at which a fit ends
# In cycles: a wrong frequency shows as a phase that drifts, and must not drift far before it is
# corrected. Where a structure is wrong, longer strides (1.6) were seen to lose the motion.
_FIRST, _LONGER = 2.5, 1.4
# Until the whole record is in sight, no term may change the acceleration by more than about this
# part of it: few cycles do not tell coefficients apart.
_LEASH = 0.01
_LEADS = 1e-2  # tolerance of chi-square: shorter horizons only lead on


def cut(record: R, cycles: float) -> list[R]:
    """A record in pieces about so many cycles of its slowest coordinate long."""
    return record.pieces(max(1, round(record.turns / cycles)))


def lengths(records: Sequence[Prepared]) -> list[float]:
    """Of pieces, in cycles, until no record is cut; infinite at the end."""
    first = shortest(*(r.frequencies for r in records))
    more = max(max(record.turns for record in records) / first, 1.0)
    count = round(np.log(more) / np.log(_GROWTH))
    return [*(first * more ** (k / count) for k in range(count)), np.inf]


def shortest(*several: Array) -> float:
    """Cycles of the slowest frequency in which all are told apart, in that of several records."""
    apart = max(float(np.min(np.diff(np.sort(f)), initial=np.inf) / f.min()) for f in several)
    return max(_CYCLES, _BEATS / apart) if apart > 0 else _CYCLES


def fit_pieces(
    model: Equations, parts: Sequence[Part], records: Sequence[Prepared], cycles: float
) -> Solution | None:
    """The model fitted to pieces so many cycles long, from the motions of the records.

    Motions and residuals of the solution are those of whole records. None if there is no motion.
    """
    several = [cut(record, cycles) for record in records]
    every = [piece for own in several for piece in own]
    solution = fit(model, parts, every, rough=_ROUGH)
    if not solution.finite:
        return None
    motions, residuals = list(solution.motions), list(solution.residuals)
    if not solution.converged:  # then the motions are not yet those of the model
        try:
            motions, residuals = simulated(model, solution.parts, every, motions)
        except TrajectoryError:
            return None
    whole, left, first = [], [], 0
    for record, own in zip(records, several, strict=True):
        here = slice(first, first + len(own))
        whole.append(Trajectory.joined(record.motion.grid, motions[here]))
        pieces = zip(own, residuals[here], strict=True)
        left.append(np.concatenate([piece.by_channel(x) for piece, x in pieces], axis=1).ravel())
        first += len(own)
    return replace(solution, motions=tuple(whole), residuals=tuple(left))


def moved(records: Sequence[R], motions: Sequence[Trajectory]) -> tuple[R, ...]:
    """Records with other motions behind them."""
    return tuple(r.with_motion(m) for r, m in zip(records, motions, strict=True))


def fit_growing(
    model: Equations, parts: Sequence[Part], records: Sequence[Prepared]
) -> tuple[tuple[Part, ...], tuple[Trajectory, ...]]:
    """Values, and motions over most of the records, from which a fit over all of them may start.

    Of parts whose shapes have no values. Raises a TrajectoryError if the model cannot be simulated
    over the first cycles.
    """
    longest = max(float(r.t[-1]) for r in records)
    horizon = _FIRST * max(2 * np.pi / r.rate for r in records)
    found, motions = tuple(parts), tuple(r.motion for r in records)
    while horizon < longest:
        found, motions = _step(model, found, [r.until(horizon) for r in records], motions)
        horizon *= _LONGER
    return found, motions


def _step(
    model: Equations,
    parts: tuple[Part, ...],
    records: Sequence[Prepared],
    motions: tuple[Trajectory, ...],
) -> tuple[tuple[Part, ...], tuple[Trajectory, ...]]:
    """Fit the first part of the records; coefficients are held near their present values."""
    here = extended(model, parts)
    still = tuple(replace(p, strengths=0 * p.strengths) if _is_law(p) else p for p in parts)
    leashes = _leashes(here, still, records[0])
    # Where the model misses more than the noise, its misfit takes the place of the noise.
    missed = max(float(np.median(np.abs(simulated_misfit(here, still, records, motions)))), 1.0)
    leashed = [
        replace(p, tolerance=leash / missed) if _is_law(p) else p
        for p, leash in zip(still, leashes, strict=True)
    ]
    solution = shoot(here, leashed, records, motions, tolerance=_LEADS)[0]
    moved = tuple(
        replace(p, strengths=p.strengths + new.strengths) if _is_law(p) else new
        for p, new in zip(parts, solution.parts, strict=True)
    )
    return moved, solution.motions


def _is_law(part: Part) -> bool:
    return part.effect.term() is not None


def _leashes(model: Equations, parts: tuple[Part, ...], record: Prepared) -> Array:
    """Strength of each part that changes the acceleration by one part in a hundred."""
    motion = record.motion
    slopes = equation_of(model, parts, 0, record).by_parameter(*nodes(motion))
    sizes = np.maximum(np.sqrt(np.mean(slopes**2, axis=(1, 2))), 1e-300)
    return _LEASH * float(np.sqrt(np.mean(motion.q_ddot**2))) / sizes
