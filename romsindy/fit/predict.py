"""What a model says of another record, of which only the first samples are looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from romsindy.effects.outside import Bias
from romsindy.fit.collocation import TrajectoryError, integrate
from romsindy.fit.coupled_record import CoupledRecord
from romsindy.fit.equation import equation_of
from romsindy.fit.forced.modes import modes_in
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.friction import smoothed
from romsindy.fit.gauss_newton import Solution, fit
from romsindy.fit.measured import NUMERICS, ready_along, require_unit
from romsindy.fit.part import Part, in_orders
from romsindy.fit.record import Prepared, Record
from romsindy.fit.remembering import memory_parts
from romsindy.fit.shooting import shoot
from romsindy.physics.coupled import AnyModel, CoupledModel
from romsindy.physics.equations import inputs_of, without_inputs
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.typing import Array

# Samples for each coordinate and cycles of the slowest that give a first state; how they grow.
_SAMPLES, _CYCLES, _GROWTH = 4, (0.5, 1.0, 2.0, 4.0), 2.0


class Sensors(NamedTuple):
    """What is known of the sensors of a fit.

    Attributes
    ----------
    offset : float or (n_channels,) array
        Of the sensors, unit of the measured quantity.
    shapes : (n_channels, R) array, optional
        What each channel shows of each of several coordinates.
    curved : tuple of Part
        What channels show of products of coordinates.
    """

    offset: Array | float = 0.0
    shapes: Array | None = None
    curved: tuple[Part, ...] = ()


def predicted(
    model: AnyModel, sensors: Sensors, record: Decay | ForcedVibration, samples: int
) -> Array:
    """Simulate a record from the state that its first samples show: see `Estimate.predict`."""
    if not isinstance(record, (Decay, ForcedVibration)):
        raise ValueError(
            f"record is {type(record).__name__}: give one Decay, or one ForcedVibration with inputs"
        )
    require_unit([record], model.unit)
    least, n = _SAMPLES * model.n_coordinates, len(record.t)
    whole = isinstance(samples, (int, np.integer)) and not isinstance(samples, bool)
    if not (whole and least <= samples <= n):
        raise ValueError(
            f"samples = {samples!r} must be a whole number from {least} to the {n} of the record"
        )
    of = _of_several if model.numbered else _of_one
    return of(_acting(model, record), sensors, record, samples)


def _acting(model: AnyModel, record: Decay | ForcedVibration) -> Any:
    """The model as it moves in a record: without its inputs in a decay."""
    if isinstance(record, Decay):
        return without_inputs(model)
    names = dict.fromkeys(term.source for term in inputs_of(model))
    missing = [name for name in names if name not in record.names]
    if missing:
        raise ValueError(
            f"the model is driven by {missing}, and the record has {list(record.names)}: give all"
            " inputs under the names of the fit"
        )
    return model


def _of_one(
    model: ReducedModel, sensors: Sensors, record: Decay | ForcedVibration, samples: int
) -> Array:
    offset = float(sensors.offset)
    seen: Prepared
    if isinstance(record, ForcedVibration):
        seen = _from_zero(ForcedRecord.of(record, NUMERICS), offset)
    else:
        seen = Record.of(record.single(), NUMERICS)
    bias = (Part(Bias(), (), np.full((1, 1), offset)),) if offset else ()
    smooth, parts = smoothed(model, [seen]), (*bias, *memory_parts(model, [seen]))
    known = fit(smooth, parts, [seen.beginning(samples)], fixed=True)
    return _shown(smooth, known.parts, seen, known.motions[0].start)


def _shown(model: AnyModel, parts: Sequence[Part], record: Prepared, start: Array) -> Array:
    """What the channels show of the motion from a state, (c n,)."""
    equation = equation_of(model, parts, 0, record)
    motion = integrate(equation, start, record.motion.grid, record.motion)
    x = in_orders(record.orders(parts), partial(motion.samples, equation))
    return record.read(parts, 0, x).shown


def _from_zero(record: ForcedRecord, offset: float) -> ForcedRecord:
    """The smooth motion about the zero of the sensor, not about its mean."""
    if record.derivative:
        return record
    m = record.motion
    return replace(record, motion=replace(m, q=m.q + record.signal.mean() - offset))


def _of_several(
    model: CoupledModel, sensors: Sensors, measured: Decay | ForcedVibration, samples: int
) -> Array:
    shapes, curved = sensors.shapes, sensors.curved
    if shapes is None:
        raise ValueError(
            "what the channels show of several coordinates is not known: predict with the fit"
            " itself, not with what was saved of it"
        )
    if measured.n_channels != len(shapes):
        raise ValueError(
            f"the record has {measured.n_channels} channels, the fit {len(shapes)}: give the same"
            " sensors in the same order"
        )
    offset = np.repeat(np.broadcast_to(sensors.offset, len(shapes)), len(measured.t))
    record = ready_along([measured], modes_in(model, shapes))[0]
    record = record.with_signal(record.signal - offset)
    model = smoothed(model, [record])
    if record.driven:  # inputs keep the phase
        first = record.beginning(samples)
        start = fit(model, curved, [first], fixed=True).motions[0].start
    else:
        start = _start(model, curved, record, samples)
    shown = _shown(model, curved, record, start) + offset
    like = measured.y if isinstance(measured, ForcedVibration) else measured.signal
    return record.by_channel(shown).T.reshape(like.shape)


def _start(
    model: CoupledModel, curved: Sequence[Part], record: CoupledRecord, samples: int
) -> Array:
    """State that the first samples show, (2 R,): of few cycles, and then of more and more.

    From a state that is far off, a fit over many cycles would not find its way. Vibrations that
    beat have several states that show few cycles well: the best of some is taken.
    """
    cycle = len(record.t) / record.turns
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
    few, equation = record.beginning(first), equation_of(model, (), 0, record)
    motions = [integrate(equation, _linear_state(model, few), few.motion.grid)]
    counts = first * _GROWTH ** np.arange(np.log(samples / first) / np.log(_GROWTH))
    for n in counts.astype(int):
        motions = list(shoot(model, curved, [record.beginning(n)], motions, fixed=True)[0].motions)
    return shoot(model, curved, [record.beginning(samples)], motions, fixed=True)[0]


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
