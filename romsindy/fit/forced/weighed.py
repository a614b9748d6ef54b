"""Values of a fit to driven records, weighed by the noises that are in them.

Least squares over a simulation take what is left for white. Where a force that nobody measured
moves the structure, or the noise of the sensor has a colour, generalised least squares tell the
values better, and theirs is the covariance that they have. The motion is then one that these forces
move as is most likely, so that a sensitive one does not go astray.

Noise of the sensor of an input looks the same as a force that was not measured. The gain that
follows the motion best is then too small, by the part of the power of the input that is noise [1]:
its error counts both.

[1] W. A. Fuller, "Measurement Error Models", Wiley 1987, section 1.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError

from romsindy.effects.drive import Drive
from romsindy.fit.adequacy.driven import ForcedAdequacy, examine_forced
from romsindy.fit.adequacy.independence import examine_independence, judged
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import fit as follow
from romsindy.fit.kernel.gauss_newton import linear_table
from romsindy.fit.kernel.linear_response import Response, sampled
from romsindy.fit.kernel.noises import Noises, NoiseTable, TwoNoises
from romsindy.fit.kernel.normal_equations import NormalEquations
from romsindy.fit.kernel.part import (
    Part,
    Solution,
    columns_of,
    in_orders,
    limits,
    moved_parts,
    prior_cost,
)
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.results.fitted import Fit, concluded
from romsindy.typing import Array, Indices

_STEPS = 8
_SETTLED = 0.05  # of chi-square, by a step


def examined(fit: Fit) -> Fit:
    """The same with its verdict by what is left of its driven records, or of its decays.

    Where that is noise, the values and their errors are those that it weighs. Decays of which more
    is left keep their verdict: it says from which amplitude on.
    """
    driven = [(i, r) for i, r in enumerate(fit.records) if r.driven]
    pairs = driven or [*enumerate(fit.records)]
    if not 0 < _size(fit, pairs).part < np.inf:
        return fit  # there is no motion, or nothing is left
    found = examine_independence(fit.start, fit.solution, pairs)
    first = judged(_size(fit, pairs), found, pairs)
    # Decays without noise tell the least of terms: there is no misfit that does not matter.
    if not driven and found.p_value < first.false_alarm:
        return fit
    if first.structured:
        return replace(fit, verdict=first) if driven else fit
    fit = weighed(fit, {i: own for (i, _), own in zip(pairs, found.noises, strict=True)})
    return replace(fit, verdict=judged(_size(fit, pairs), found, pairs))


def _size(fit: Fit, pairs: Sequence[tuple[int, Prepared]]) -> ForcedAdequacy:
    """How much is left."""
    if isinstance(fit.verdict, ForcedAdequacy):
        return fit.verdict
    records, left = zip(*((r, fit.residuals[i]) for i, r in pairs), strict=True)
    return examine_forced(records, left, fit.solution.n_values)


def weighed(fit: Fit, noises: Mapping[int, Noises]) -> Fit:
    """The same by generalised least squares; ``noises`` are those of records, by their number.

    Steps of Gauss and Newton about the most likely motions, which the forces move. Where they do
    not settle or have no motion, and where forces remember, the fit stays as it is.
    """
    if fit.model.memories:  # what a force moves would be remembered
        return fit
    parts, motions, last = fit.solution.parts, fit.solution.motions, np.inf
    for _ in range(_STEPS):
        try:
            step = _Step.about(fit, parts, motions, noises)
        except LinAlgError:  # forces that grow beyond what numbers hold
            return fit
        parts, motions = step.parts, step.motions
        if abs(last - step.left) < _SETTLED:
            break
        last = step.left
    else:
        return fit
    found = follow(fit.start, parts, fit.records, motions, fixed=True)
    if not found.converged:  # where motion is sensitive, it swings between two starts
        try:
            found = _simulated(fit, parts, motions)
        except TrajectoryError:
            return fit
    own = fit.model.terms[: len(fit.start.terms)]
    model = replace(fit.model, terms=own, values=fit.start.values)
    both = [_of_inputs(part, fit.records, noises) for part in parts]
    found = replace(found, covariance=step.covariance + np.diag(np.concatenate(both) ** 2 / 2))
    return replace(concluded(model, fit.start, fit.records, found), notes=fit.notes)


def _simulated(fit: Fit, parts: tuple[Part, ...], motions: Sequence[Trajectory]) -> Solution:
    """What simulations leave that start as these motions do, without forces that move them."""
    own, left = [], []
    for i, (record, motion) in enumerate(zip(fit.records, motions, strict=True)):
        equation = equation_of(fit.start, parts, i, record)
        own.append(integrate(equation, motion.start, motion.grid, motion))
        x = in_orders(record.orders(parts), partial(sampled, own[-1]))
        left.append(record.signal - record.read(parts, i, x).shown)
    pairs = zip(fit.records, left, strict=True)
    total = sum(float(np.sum(r.whitened(e) ** 2)) for r, e in pairs) + prior_cost(parts)
    return Solution(parts, tuple(own), tuple(left), total, fit.solution.covariance, True)


def _of_inputs(part: Part, records: Sequence[Prepared], noises: Mapping[int, Noises]) -> Array:
    """By how much the values of a part change where forces are noise of the sensor of its input."""
    change = np.zeros(part.size)
    if not isinstance(part.effect, Drive):
        return change
    source, gain, noisy = part.effect.of.source, part.strengths.ravel(), []  # parts of its power
    weights = np.square(part.effect.directions)
    for i, noise in noises.items():
        measured = records[i].decay
        if source in measured.names:
            u = measured.u[:, measured.names.index(source)]
            power = measured.dt * float(np.var(u)) * np.maximum(gain**2, 1e-300)
            # Its noise moves all coordinates: no more than is found at the least of them.
            noisy.append(min(1.0, float(np.min(weights @ noise.force / power))))
    change[: len(gain)] = float(np.mean(noisy)) * np.abs(gain)
    return change


class _Step(NamedTuple):
    """Where a step leads, the covariance of the values, and the chi-square that it leaves."""

    parts: tuple[Part, ...]
    motions: tuple[Trajectory, ...]
    covariance: Array
    left: float

    @classmethod
    def about(
        cls,
        fit: Fit,
        parts: tuple[Part, ...],
        motions: Sequence[Trajectory],
        noises: Mapping[int, Noises],
    ) -> _Step:
        n_values = sum(p.size for p in parts)
        system = NormalEquations(n_values, len(motions), n_coordinates=fit.start.n_coordinates)
        ways = []
        for i, (record, motion) in enumerate(zip(fit.records, motions, strict=True)):
            response, rows = linear_table(fit.start, parts, i, record, motion)
            where = columns_of(parts, i)
            if i in noises:
                equation = equation_of(fit.start, parts, i, record)
                two = TwoNoises.along(equation, parts, i, record, motion)
                own = rows[:, [*range(len(where)), -1]]
                table = two.table(own * record.white[:, None])  # they come over white noise
                system.add_products(where, table.weighed(noises[i]).products)
                ways.append(partial(_driven, response, where, table, noises[i]))
            else:
                where = np.append(where, system.states_of(i))
                system.add(where, rows)
                ways.append(partial(_free, response, where))
        system.add_priors(parts)
        step = system.bounded_step(np.zeros(n_values, bool), *limits(parts))
        return cls(
            moved_parts(parts, step[:n_values]),
            tuple(way(step) for way in ways),
            system.covariance()[:n_values, :n_values],
            system.chi_squared(step),
        )


def _free(response: Response, where: Indices, step: Array) -> Trajectory:
    return response.moved(np.concatenate([[1.0], step[where]]))


def _driven(
    response: Response, where: Indices, table: NoiseTable, noises: Noises, step: Array
) -> Trajectory:
    """With what forces that were not measured move."""
    states = table.states(noises) @ np.append(-step[where], 1.0)
    at_start = np.zeros(2 * response.q.shape[1])
    motion = response.moved(np.concatenate([[1.0], step[where], at_start]))
    return table.noises.moved(motion, states)
