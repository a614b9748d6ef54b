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
from romsindy.effects.memory import MemoryEffect
from romsindy.fit.adequacy import Adequacy, examine
from romsindy.fit.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.equation import equation_of
from romsindy.fit.fitted import Fit, concluded
from romsindy.fit.forced.adequacy import ForcedAdequacy, examine_forced
from romsindy.fit.forced.independence import Independence, examine_independence, judged
from romsindy.fit.gauss_newton import Solution, limits, linear_table, moved_parts
from romsindy.fit.gauss_newton import fit as follow
from romsindy.fit.linear_response import Response, sampled
from romsindy.fit.noises import Noises, NoiseTable, TwoNoises, found_noises
from romsindy.fit.normal_equations import NormalEquations
from romsindy.fit.part import Part, columns_of, in_orders, prior_cost
from romsindy.fit.record import Prepared
from romsindy.fit.verdict import EXPLAINED, FALSE_ALARM
from romsindy.physics.coupled import AnyModel
from romsindy.typing import Array, Indices

_STEPS = 8
# Of chi-square, by a step: what is settled, and the factor of a motion that goes astray.
_SETTLED, _FAR = 0.05, 10.0


def examined(fit: Fit) -> Fit:
    """The same with its verdict by what is left of its driven records, or of its decays.

    Where that is noise, the values and their errors are those that it weighs. Decays of which more
    is left keep their verdict: it says from which amplitude on.
    """
    driven = [(i, r) for i, r in enumerate(fit.records) if r.driven]
    pairs = driven or [*enumerate(fit.records)]
    if not driven and told(fit.verdict):
        return fit
    if not 0 < _size(fit, pairs).part < np.inf:
        return fit  # there is no motion, or nothing is left
    if driven:
        found = examine_independence(fit.start, fit.solution, pairs)
        first = judged(_size(fit, pairs), found, pairs)
        if first.structured:
            return replace(fit, verdict=first)
        moved = _settled(fit.start, fit.solution, fit.records, _by_record(pairs, found))
    else:
        found, moved = of_decays(fit.start, fit.solution, fit.records)
        if found.chance < fit.verdict.false_alarm and not fit.verdict.explained:
            return fit
    if moved is not None:
        fit = _weighed(fit, moved, _by_record(pairs, found))
    return replace(fit, verdict=judged(_size(fit, pairs), found, pairs))


def of_decays(
    model: AnyModel, solution: Solution, records: Sequence[Prepared]
) -> tuple[Independence, Solution | None]:
    """What goes with the motion of decays in that which a fit leaves, and the noises in it.

    It is looked for about the motions that forces move which nobody measured, those of the second
    if there is one: about a simulation that they led far off, what they do would go with it.
    """
    pairs, noises = [*enumerate(records)], {}
    for i, record in pairs:
        parts, motion = solution.parts, solution.motions[i]
        equation = equation_of(model, parts, i, record)
        two = TwoNoises.along(equation, parts, i, record, motion)
        noises[i] = found_noises(two, solution.residuals[i])
    moved = _settled(model, solution, records, noises)
    return examine_independence(model, moved or solution, pairs), moved


def examine_decays(
    model: AnyModel,
    solution: Solution,
    records: Sequence[Prepared],
    false_alarm: float = FALSE_ALARM,
) -> Adequacy:
    """What a hypothesis leaves of decays, by the noise that was heard, or that is found in it."""
    heard = examine(records, solution.residuals, solution.n_values, false_alarm)
    if told(heard) or not 0 < heard.part < np.inf:
        return heard
    return by_noises(heard, solution, records, of_decays(model, solution, records)[0])


def by_noises(
    heard: Adequacy, solution: Solution, records: Sequence[Prepared], found: Independence
) -> Adequacy:
    """The verdict by the noises that are found.

    Where more than noise is left that which was heard says from which amplitude on. Decays without
    noise tell the least of terms: there is no misfit that does not matter.
    """
    if found.chance < heard.false_alarm and not heard.explained:
        return heard
    size = examine_forced(records, solution.residuals, solution.n_values, heard.false_alarm)
    return judged(size, found, [*enumerate(records)])


def told(heard: Adequacy) -> bool:
    """Whether the level of the noise of decays explains them: it is that where they ring.

    Where much less is left, noise has a colour, and its level may hide what is missing.
    """
    return heard.explained and heard.ratio * EXPLAINED > 1


def _by_record(pairs: Sequence[tuple[int, Prepared]], found: Independence) -> dict[int, Noises]:
    return {i: own for (i, _), own in zip(pairs, found.noises, strict=True)}


def _size(fit: Fit, pairs: Sequence[tuple[int, Prepared]]) -> ForcedAdequacy:
    """How much is left."""
    if isinstance(fit.verdict, ForcedAdequacy):
        return fit.verdict
    records, left = zip(*((r, fit.residuals[i]) for i, r in pairs), strict=True)
    return examine_forced(records, left, fit.solution.n_values)


def _settled(
    model: AnyModel,
    solution: Solution,
    records: Sequence[Prepared],
    noises: Mapping[int, Noises],
) -> Solution | None:
    """The same by generalised least squares; ``noises`` are those of records, by their number.

    Steps of Gauss and Newton about the most likely motions, which the forces move; residuals are
    those of the motions without them. None where the steps do not settle or have no motion, and
    where forces remember.
    """
    parts, motions, last = solution.parts, solution.motions, np.inf
    if any(isinstance(p.effect, MemoryEffect) for p in parts):  # it would remember what they move
        return None
    for _ in range(_STEPS):
        try:
            with np.errstate(all="ignore"):
                step = _Step.about(model, records, parts, motions, noises)
        except LinAlgError:  # beyond what numbers hold
            return None
        if not step.left < _FAR * last:
            return None
        parts, motions = step.parts, step.motions
        if abs(last - step.left) < _SETTLED:
            return Solution(parts, motions, step.residuals, step.left, step.covariance, True)
        last = step.left
    return None


def _weighed(fit: Fit, moved: Solution, noises: Mapping[int, Noises]) -> Fit:
    """A fit with the values of one that forces move; as it is where that cannot be simulated."""
    parts = moved.parts
    found = follow(fit.start, parts, fit.records, moved.motions, fixed=True)
    if not found.converged:  # where motion is sensitive, it swings between two starts
        try:
            found = _simulated(fit, parts, moved.motions)
        except TrajectoryError:
            return fit
    own = fit.model.terms[: len(fit.start.terms)]
    model = replace(fit.model, terms=own, values=fit.start.values)
    both = [_of_inputs(part, fit.records, noises) for part in parts]
    found = replace(found, covariance=moved.covariance + np.diag(np.concatenate(both) ** 2 / 2))
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
    """Where a step leads, the covariance of the values, the chi-square that it leaves, and what the
    motion leaves without forces."""

    parts: tuple[Part, ...]
    motions: tuple[Trajectory, ...]
    covariance: Array
    left: float
    residuals: tuple[Array, ...]

    @classmethod
    def about(
        cls,
        model: AnyModel,
        records: Sequence[Prepared],
        parts: tuple[Part, ...],
        motions: Sequence[Trajectory],
        noises: Mapping[int, Noises],
    ) -> _Step:
        n_values = sum(p.size for p in parts)
        system = NormalEquations(n_values, len(motions), n_coordinates=model.n_coordinates)
        ways, left = [], []
        for i, (record, motion) in enumerate(zip(records, motions, strict=True)):
            response, rows = linear_table(model, parts, i, record, motion)
            left.append(rows[:, -1] * record.white)  # they come over white noise
            where = columns_of(parts, i)
            if i in noises:
                equation = equation_of(model, parts, i, record)
                two = TwoNoises.along(equation, parts, i, record, motion)
                own = rows[:, : len(where)] * record.white[:, None]
                table = two.table(np.column_stack([own, left[-1]]))
                system.add_products(where, table.weighed(noises[i]).products)
                ways.append(partial(_driven, response, where, table, noises[i]))
            else:
                where = np.append(where, system.states_of(i))
                system.add(where, rows)
                ways.append(partial(_free, response, where))
        system.add_priors(parts)
        if not system.finite:
            raise LinAlgError("the motion goes astray")
        step = system.bounded_step(np.zeros(n_values, bool), *limits(parts))
        return cls(
            moved_parts(parts, step[:n_values]),
            tuple(way(step) for way in ways),
            system.covariance()[:n_values, :n_values],
            system.chi_squared(step),
            tuple(left),
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
