"""What a simulation says, before and after, about a record that took no part in its fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from romsindy.diagnosis.gap import Prediction, held_out_solution
from romsindy.fit.collocation import TrajectoryError, integrate
from romsindy.fit.gauss_newton import Solution
from romsindy.fit.linear_response import sampled
from romsindy.fit.measured import Measured
from romsindy.fit.part import ExtendedEquation, Part, read
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

_POLISH = 12  # simulations to find the initial state of a record whose fit does not settle


def predict(model: ReducedModel, parts: Sequence[Part], record: Measured) -> Prediction:
    """What the simulation before and after says about a record that took no part."""
    before = _simulated(model, (), record, held_out_solution(model, (), record))
    after = before
    if parts:
        own = [replace(p, strengths=p.strengths[:1]) for p in parts]
        after = _simulated(model, own, record, held_out_solution(model, own, record))
    return Prediction(record, before, after)


def _simulated(
    model: ReducedModel, parts: Sequence[Part], record: Measured, solution: Solution
) -> Array:
    if np.isfinite(solution.chi_squared) and solution.converged:
        return record.signal - solution.residuals[0]
    # Where the phase is lost, or jumps keep the fit from settling: simulate, from the better of the
    # fitted and the measured initial state on.
    starts = [
        np.array([m.q[0], m.q_dot[0]])
        for m in (solution.motions[0], record.motion)
        if np.isfinite(m.q[0])
    ]

    def misfit(state: Array) -> Array:
        return record.noise(record.signal - _run(model, solution.parts, record, state))

    best = min(starts, key=lambda state: float(np.sum(misfit(state) ** 2)))
    scale = np.abs(best) + 1e-3 * record.amplitude * np.array([1.0, _rate(record)])
    polished = least_squares(misfit, best, x_scale=scale, diff_step=1e-5, max_nfev=_POLISH)
    return _run(model, solution.parts, record, polished.x)


def _rate(record: Measured) -> float:
    return float(record.spline.phase(record.t, 1).mean())


def _run(model: ReducedModel, parts: Sequence[Part], record: Measured, state: Array) -> Array:
    grid = record.motion.grid
    equation = ExtendedEquation(model, tuple(parts), 0, grid.step)
    try:
        motion = integrate(equation, state.tolist(), grid)
    except TrajectoryError as error:
        if error.motion is None:
            return np.zeros_like(record.signal)
        motion = error.motion
    x = sampled(motion, record.derivative)
    # Friction that is about to hold the motion cannot be followed: it stays where it is.
    held = x[-1] if record.derivative == 0 else 0.0
    x = np.concatenate([x, np.full(len(record.t) - len(x), held)])
    return read(parts, 0, record.t, x)[0]
