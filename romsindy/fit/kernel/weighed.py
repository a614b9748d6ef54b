"""Values of a fit, weighed by the noises that are in the records.

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
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import fit, linear_table
from romsindy.fit.kernel.linear_response import Response
from romsindy.fit.kernel.noises import Noises, NoiseTable, TwoNoises
from romsindy.fit.kernel.normal_equations import NormalEquations
from romsindy.fit.kernel.part import (
    Part,
    Solution,
    columns_of,
    limits,
    moved_parts,
)
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.kernel.shooting import resimulated
from romsindy.physics.equations import Equations
from romsindy.typing import Array, Indices

_STEPS = 8
_SETTLED = 0.05  # of chi-square, by a step


def weighed(
    model: Equations,
    solution: Solution,
    records: Sequence[Prepared],
    noises: Mapping[int, Noises],
) -> Solution | None:
    """The same by generalised least squares; ``noises`` are those of records, by their number.

    Steps of Gauss and Newton about the most likely motions, which the forces move. None where they
    do not settle or have no motion, and where forces remember.
    """
    if model.memories:  # what a force moves would be remembered
        return None
    parts, motions, last = solution.parts, solution.motions, np.inf
    for _ in range(_STEPS):
        try:
            step = _Step.about(model, parts, records, motions, noises)
        except LinAlgError:  # forces that grow beyond what numbers hold
            return None
        parts, motions = step.parts, step.motions
        if abs(last - step.left) < _SETTLED:
            break
        last = step.left
    else:
        return None
    found = fit(model, parts, records, motions, fixed=True)
    if not found.converged:  # where motion is sensitive, it swings between two starts
        try:
            ended = replace(solution, parts=parts, motions=motions)
            found = resimulated(model, ended, records)
        except TrajectoryError:
            return None
    both = [_of_inputs(part, records, noises) for part in parts]
    return replace(found, covariance=step.covariance + np.diag(np.concatenate(both) ** 2 / 2))


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
        model: Equations,
        parts: tuple[Part, ...],
        records: Sequence[Prepared],
        motions: Sequence[Trajectory],
        noises: Mapping[int, Noises],
    ) -> _Step:
        n_values = sum(p.size for p in parts)
        system = NormalEquations(n_values, len(motions), n_coordinates=model.n_coordinates)
        ways = []
        for i, (record, motion) in enumerate(zip(records, motions, strict=True)):
            response, rows = linear_table(model, parts, i, record, motion)
            where = columns_of(parts, i)
            if i in noises:
                equation = equation_of(model, parts, i, record)
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
