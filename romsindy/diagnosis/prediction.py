"""What a simulation says, before and after, about a record that took no part in its fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.gap import Prediction, name_of
from romsindy.diagnosis.unsure import offsets
from romsindy.effects import Bias
from romsindy.fit.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.equation import ExtendedEquation
from romsindy.fit.gauss_newton import fit
from romsindy.fit.linear_response import sampled
from romsindy.fit.part import Part, read
from romsindy.fit.record import Record
from romsindy.fit.shooting import shoot
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

_ITERATIONS = 25
_POLISH = 12  # simulations to find the initial state of a record whose fit does not settle
_FAR = 1e6  # amplitudes, beyond which it does not matter how far a motion has run away
# A motion that leaves this part of the signal's square has lost the phase: its misfit has as many
# minima as there are cycles, and no initial state is the best.
_LOST = 0.5


def predict(
    model: ReducedModel,
    parts: Sequence[Part],
    record: Record,
    name: str = name_of(0),
    near: Trajectory | None = None,
) -> Prediction:
    """What the simulation before and after says about a record; only its start follows it.

    The motion after is ``near`` one that is known, if any: that of other samples of the record.
    """
    before = _followed(model, (), record, None)
    known = {} if near is None else {name: near}
    return follow(Prediction(record, before, before, name), model, parts, known)


def follow(
    before: Prediction,
    model: ReducedModel,
    parts: Sequence[Part],
    near: Mapping[str, Trajectory],
) -> Prediction:
    """The same with what the simulation says with some parts."""
    if not parts:
        return before
    after = _followed(model, parts, before.record, near.get(before.name))
    return replace(before, after=after)


def misfit_of(
    model: ReducedModel,
    hypothesis: Hypothesis,
    tests: Mapping[str, Record],
    parts: Sequence[Part] | None = None,
) -> Array:
    """What a hypothesis, or some of its parts, leaves of records, over noise.

    Only their starts follow them.
    """
    near, parts = motions_of(hypothesis), hypothesis.parts if parts is None else parts
    left = [
        r.whitened(r.signal - _followed(model, parts, r, near.get(name)))
        for name, r in tests.items()
    ]
    return np.concatenate(left)


def motions_of(hypothesis: Hypothesis) -> dict[str, Trajectory]:
    """Fitted motions by the names of their records."""
    return {name_of(i): m for i, m in enumerate(hypothesis.solution.motions)}


def _followed(
    model: ReducedModel, parts: Sequence[Part], record: Record, near: Trajectory | None
) -> Array:
    same = [p.elsewhere(record.t) for p in parts]
    # The zero of the sensor is as free as the start.
    if not any(isinstance(p.effect, Bias) for p in same):
        same.append(offsets([record]))
    with np.errstate(all="ignore"):  # what explains nothing may lead to no motion at all
        found = _simulated(model, same, record, near)
    most = _FAR * float(np.abs(record.signal).max())
    return np.clip(found, -most, most)


def _simulated(
    model: ReducedModel, parts: Sequence[Part], record: Record, near: Trajectory | None = None
) -> Array:
    # Strengths that differ from record to record, such as the phase of an excitation, are fitted.
    start = None if near is None else [near]
    solution = fit(model, parts, [record], start, fixed=True, iterations=_ITERATIONS)
    if solution.finite and solution.converged:
        return record.signal - solution.residuals[0]
    # Where the phase is lost, or jumps keep the fit from settling: simulate, from the fitted or the
    # measured initial state on.
    fitted = solution.motions if solution.finite else ()
    near_by = (*fitted, *(() if near is None else (near,)), record.motion)
    said = [_run(model, solution.parts, record, motion) for motion in near_by]
    left = [float(np.sum(record.whitened(record.signal - x) ** 2)) for x in said]
    i = int(np.argmin(np.nan_to_num(left, nan=np.inf)))
    if not left[i] < _LOST * np.sum(record.whitened(record.signal) ** 2):
        return said[i]
    given = (model, solution.parts, [record], [near_by[i]])
    try:
        return record.signal - shoot(*given, fixed=True, evaluations=_POLISH)[0].residuals[0]
    except TrajectoryError:
        return said[i]


def _run(model: ReducedModel, parts: Sequence[Part], record: Record, near: Trajectory) -> Array:
    """As far as the motion can be followed from the initial state of another one."""
    grid = record.motion.grid
    equation = ExtendedEquation(model, tuple(parts), 0, grid.step, record.clock)
    try:
        motion = integrate(equation, near.start, grid, near)
    except TrajectoryError as error:
        if error.motion is None:
            return np.zeros_like(record.signal)
        motion = error.motion
    x = sampled(motion, record.derivative)
    # A motion that cannot be followed further stays where it is.
    held = x[-1:] if record.derivative == 0 else np.zeros((1, 1))
    x = np.concatenate([x, np.repeat(held, len(record.t) - len(x), axis=0)])
    return read(parts, 0, record.t, x)[0]
