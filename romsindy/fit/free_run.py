"""What a fitted model says of another record, of which only the first samples are looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import expm

from romsindy.fit.collocation import TrajectoryError, integrate
from romsindy.fit.coupled_record import CoupledRecord
from romsindy.fit.equation import equation_of
from romsindy.fit.fitted import Fit
from romsindy.fit.forced.run import forced_run
from romsindy.fit.gauss_newton import Solution
from romsindy.fit.measured import NUMERICS, small_frequencies
from romsindy.fit.mode_shape import CurvedShape
from romsindy.fit.part import Part, in_orders
from romsindy.fit.shooting import shoot
from romsindy.physics.coupled import CoupledModel
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.typing import Array

# Samples for each coordinate and cycles of the slowest that give a first state; how they grow.
_SAMPLES, _CYCLES, _GROWTH = 4, (0.5, 1.0, 2.0, 4.0), 2.0


def free_run(fit: Fit, decay: Decay | ForcedVibration, samples: int) -> Array:
    """Simulate a record that took no part in a fit, from the state that its first samples show.

    Parameters
    ----------
    fit : Fit
        Of several coordinates, or of one with inputs.
    decay : Decay or ForcedVibration
        Free, with the channels of the decays behind the fit; or with its inputs.
    samples : int
        So many, of every channel, give the state: at least 4 for each coordinate.

    Returns
    -------
    array like the measured signal
        (n,) or (n, n_channels), in the measured quantity.

    Raises
    ------
    ValueError
        If a model of one coordinate has no inputs, the channels or inputs differ, or the samples
        are too few or too many.
    TrajectoryError
        If the model has no motion that long from there.
    """
    model = fit.model
    least, n = _SAMPLES * model.n_coordinates, len(decay.t)
    if not least <= samples <= n:
        raise ValueError(f"samples = {samples!r} must be from {least} to the {n} of the record")
    if isinstance(decay, ForcedVibration):
        return forced_run(fit, decay, samples)
    if not isinstance(model, CoupledModel):
        raise ValueError(
            "the model has one coordinate: free_run is for those of several, and for forced ones"
        )
    if decay.n_channels != len(fit.mode_shapes):
        raise ValueError(
            f"the decay has {decay.n_channels} channels, the fit {len(fit.mode_shapes)}: give the"
            " same sensors in the same order"
        )
    main = [int(i) for i in np.argmax(fit.mode_shapes == 1.0, axis=0)]
    found = CoupledRecord.of(decay, small_frequencies(model), NUMERICS, main)
    record = replace(found, shapes=fit.mode_shapes)
    curved = tuple(p for p in fit.solution.parts if isinstance(p.effect, CurvedShape))
    start = _start(model, curved, record, samples)
    grid = record.motion.grid
    equation = equation_of(model, (), 0, record)
    motion = integrate(equation, start, grid, record.motion)
    x = in_orders(record.orders(curved), partial(motion.samples, equation))
    shown = record.read(curved, 0, x).shown
    return shown.reshape(decay.n_channels, -1).T.reshape(decay.signal.shape)


def _start(
    model: CoupledModel, curved: Sequence[Part], record: CoupledRecord, samples: int
) -> Array:
    """State that the first samples show, (2 R,): of few cycles, and then of more and more.

    From a state that is far off, a fit over many cycles would not find its way. Vibrations that
    beat have several states that show few cycles well: the best of some is taken.
    """
    cycle = len(record.t) / record.cycles
    fewest = _SAMPLES * model.n_coordinates
    firsts = sorted({min(max(int(c * cycle), fewest), samples) for c in _CYCLES})
    found: list[Solution] = []
    for first in firsts:
        try:
            found.append(_grown(model, curved, record, first, samples))
        except TrajectoryError as trouble:
            if first == firsts[-1] and not found:
                raise trouble from None
    return min(found, key=lambda solution: solution.chi_squared).motions[0].start


def _grown(
    model: CoupledModel, curved: Sequence[Part], record: CoupledRecord, first: int, samples: int
) -> Solution:
    """The initial state of all samples, from that of the first ones."""
    few, equation = record.until(first), equation_of(model, (), 0, record)
    motions = [integrate(equation, _linear_state(model, few), few.motion.grid)]
    counts = first * _GROWTH ** np.arange(np.log(samples / first) / np.log(_GROWTH))
    for n in counts.astype(int):
        motions = list(shoot(model, curved, [record.until(n)], motions, fixed=True)[0].motions)
    return shoot(model, curved, [record.until(samples)], motions, fixed=True)[0]


def _linear_state(model: CoupledModel, record: CoupledRecord) -> Array:
    """The state from which small vibrations of the model would show the record best, (2 R,)."""
    r, rest = model.n_coordinates, np.zeros((1, model.n_coordinates))
    _, by_q, by_q_dot, by_q_ddot = model.linearise(rest, rest, rest)
    rates = -np.linalg.solve(by_q_ddot[0], np.concatenate([by_q[0], by_q_dot[0]], axis=1))
    a = np.block([[np.zeros((r, r)), np.eye(r)], [rates]])
    shown = record.shapes @ np.linalg.matrix_power(a, record.derivative)[:r]
    later = expm(a * (record.decay.t - record.decay.t[0])[:, None, None])
    table = np.einsum("cs,nsk->cnk", shown, later).reshape(-1, 2 * r)
    return np.linalg.lstsq(table, record.signal, rcond=None)[0]
