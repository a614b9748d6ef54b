"""What a model says of another record, of which only the first samples are looked at.

And what the records behind a model say of its form, which the band of a forecast counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.linalg import expm
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from romsindy.effects.outside import Bias
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.kernel.equation import ExtendedEquation, equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.hypothesis import free_parts, laws_in
from romsindy.fit.kernel.linear_response import respond
from romsindy.fit.kernel.part import LINEAR, Coefficient, Part, Reading, Solution
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.kernel.shooting import shoot
from romsindy.fit.process_noise import (
    GROWS,
    SIGMAS,
    TAILS,
    Form,
    Marginal,
    Windows,
    as_coefficients,
    grown,
    scatter,
)
from romsindy.fit.records.arguments import require_unit
from romsindy.fit.records.coupled import CoupledRecord, record_along
from romsindy.fit.records.driven import ForcedRecord
from romsindy.fit.records.modes import modes_in
from romsindy.fit.records.record import NUMERICS, Record
from romsindy.fit.verdict import FALSE_ALARM, SAME_DAMPING, SAME_FREQUENCY
from romsindy.physics.equations import Equations, inputs_of, without_inputs
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Measurement
from romsindy.text import percent
from romsindy.typing import Array

# Samples for each coordinate and cycles of the slowest that give a first state; how they grow.
_SAMPLES, _CYCLES, _GROWTH = 4, (0.5, 1.0, 2.0, 4.0), 2.0
_AT_ONCE = 4096  # samples of which all draws are held at a time


class Sensors(NamedTuple):
    """What is known of the sensors of a fit."""

    offset: Array | float = 0.0  # of the sensors, unit of the measured quantity
    # (n_channels, R), what each channel shows of each of several coordinates
    shapes: Array | None = None
    curved: tuple[Part, ...] = ()  # what channels show of products of coordinates


class Forecast(NamedTuple):
    """What will be measured, with its 95 % band.

    Attributes
    ----------
    value, low, high : arrays like the measured signal
        In the measured quantity.
    notes : tuple of str
        What the reader must know of the band.
    """

    value: Array
    low: Array
    high: Array
    notes: tuple[str, ...]


class Simulated(NamedTuple):
    """A record that the model follows from the state that its first samples show."""

    model: Equations
    parts: tuple[Part, ...]  # beside it, with coefficients that may err
    record: Prepared
    start: Array  # (2 R,)
    offset: Array | float = 0.0  # of the sensors, (c n,), where no part has it

    @property
    def equation(self) -> ExtendedEquation:
        return equation_of(self.model, self.parts, 0, self.record)

    def motion(self) -> Trajectory:
        return integrate(self.equation, self.start, self.record.motion.grid, self.record.motion)

    def reading(self, motion: Trajectory) -> Reading:
        """What the channels show of it."""
        return self.record.shown(self.parts, 0, partial(motion.samples, self.equation))


def predicted(
    model: Equations, sensors: Sensors, record: Decay | ForcedVibration, samples: int
) -> Array:
    """Simulate a record from the state that its first samples show: see `Estimate.predict`."""
    found = _followed(model, (), sensors, record, samples)
    return _like(record, found, found.reading(found.motion()).shown + found.offset)


def _like(measured: Decay | ForcedVibration, found: Simulated, shown: Array) -> Array:
    """Channels that stand one after the other, as they were measured."""
    return found.record.by_channel(shown).T.reshape(measured.response.shape)


def foretold(
    model: Equations,
    names: tuple[str, ...],
    changes: Array,
    sensors: Sensors,
    verdict: Adequacy,
    record: Decay | ForcedVibration,
    samples: int,
) -> Forecast:
    """The same with its band: see `Estimate.forecast`."""
    found = _followed(model, names, sensors, record, samples)
    motion, reach = found.motion(), (model.amplitude_range or (0.0, np.inf))[1]
    value = found.reading(motion).shown
    of = _spread if found.record.driven or model.numbered else _turned
    ends = of(found, motion, _named(found, names, changes), verdict, reach, samples)
    low, high = (_like(record, found, x + found.offset) for x in ends)
    largest, notes = float(np.abs(motion.q).max()), []
    if largest > reach:
        unit = model.unit or "[q]"
        notes.append(
            f"the motion reaches {largest:.3g} {unit}, and the data only {reach:.3g}: {GROWS}"
        )
    return Forecast(_like(record, found, value + found.offset), low, high, tuple(notes))


def _followed(
    model: Equations,
    names: tuple[str, ...],
    sensors: Sensors,
    record: Decay | ForcedVibration,
    samples: int,
) -> Simulated:
    if not isinstance(record, Measurement):
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
    acting = _acting(model, record)
    return of(acting, [n for n in names if n in acting.coefficients], sensors, record, samples)


def _acting(model: Equations, record: Decay | ForcedVibration) -> Any:
    """The model as it moves in a record: without its inputs in a decay."""
    if not record.driven:
        return without_inputs(model)
    names = dict.fromkeys(term.source for term in inputs_of(model))
    if not names:
        raise ValueError(
            f"the record is driven by {list(record.names)}, and the model has no input: fit it to a"
            " driven record as well, which tells the gain, or give a free decay"
        )
    missing = [name for name in names if name not in record.names]
    if missing:
        raise ValueError(
            f"the model is driven by {missing}, and the record has {list(record.names)}: give all"
            " inputs under the names of the fit"
        )
    return model


def _of_one(
    model: ReducedModel,
    names: Sequence[str],
    sensors: Sensors,
    record: Decay | ForcedVibration,
    samples: int,
) -> Simulated:
    offset = float(sensors.offset)
    seen: Prepared
    if record.driven:
        seen = _from_zero(ForcedRecord.of(cast(ForcedVibration, record), NUMERICS), offset)
    else:
        seen = Record.of(cast(Decay, record).single(), NUMERICS)
    bias = (Part(Bias(), (), np.full((1, 1), offset)),) if offset else ()
    smooth, own = free_parts(model, names, [seen])
    known = fit(smooth, (*own, *bias), [seen.beginning(samples)], fixed=True)
    return Simulated(smooth, known.parts, seen, known.motions[0].start)


def _from_zero(record: ForcedRecord, offset: float) -> ForcedRecord:
    """The smooth motion about the zero of the sensor, not about its mean."""
    if record.derivative:
        return record
    m = record.motion
    return replace(record, motion=replace(m, q=m.q + record.signal.mean() - offset))


def _of_several(
    model: Equations,
    names: Sequence[str],
    sensors: Sensors,
    measured: Decay | ForcedVibration,
    samples: int,
) -> Simulated:
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
    record = record_along(measured, modes_in(model, shapes))
    record = record.with_signal(record.signal - offset)
    smooth, own = free_parts(model, names, [record])
    if record.driven:  # inputs keep the phase
        first = record.beginning(samples)
        start = fit(smooth, (*own, *curved), [first], fixed=True).motions[0].start
    else:
        start = _start(smooth, curved, record, samples)
    return Simulated(smooth, (*own, *curved), record, start, offset)


def _start(model: Equations, curved: Sequence[Part], record: CoupledRecord, samples: int) -> Array:
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
    model: Equations, curved: Sequence[Part], record: CoupledRecord, first: int, samples: int
) -> Solution:
    """The initial state of all samples, from that of the first ones."""
    few, equation = record.beginning(first), equation_of(model, (), 0, record)
    motions = [integrate(equation, _linear_state(model, few), few.motion.grid)]
    counts = first * _GROWTH ** np.arange(np.log(samples / first) / np.log(_GROWTH))
    for n in counts.astype(int):
        motions = list(shoot(model, curved, [record.beginning(n)], motions, fixed=True)[0].motions)
    return shoot(model, curved, [record.beginning(samples)], motions, fixed=True)[0]


def _linear_state(model: Equations, record: CoupledRecord) -> Array:
    """The state from which small vibrations of the model would show the record best, (2 R,)."""
    r, rest = model.n_coordinates, np.zeros((1, model.n_coordinates))
    _, by_q, by_q_dot, by_q_ddot = model.residual_and_slopes(rest, rest, rest)
    rates = -np.linalg.solve(by_q_ddot[0], np.concatenate([by_q[0], by_q_dot[0]], axis=1))
    a = np.block([[np.zeros((r, r)), np.eye(r)], [rates]])
    shown = record.shapes @ np.linalg.matrix_power(a, record.derivative)[:r]
    later = expm(a * (record.decay.t - record.decay.t[0])[:, None, None])
    table = np.einsum("cs,nsk->cnk", shown, later).reshape(-1, 2 * r)
    return np.linalg.lstsq(table, record.signal, rcond=None)[0]


def _named(found: Simulated, names: Sequence[str], changes: Array) -> Array:
    """Changes of coefficients, (n_draws, m), as those of all values of the parts: (k, n_draws)."""
    first = np.cumsum([0, *(p.size for p in found.parts)])
    every = np.zeros((first[-1], len(changes)))
    for start, part in zip(first, found.parts, strict=False):
        for k, law in enumerate(laws_in(part.effect)):
            if law.key in names:
                every[start + k] = changes[:, names.index(law.key)]
    return every


def _with_state(by_start: Array, errors: Array, first: Prepared, rng: np.random.Generator) -> Array:
    """How far the state is off that first samples show, (2 R, n_draws).

    ``by_start`` (n, 2 R) are derivatives of these samples by it, ``errors`` (n, n_draws) what they
    are off by for other reasons than their noise.
    """
    noise = np.stack([first.drawn(rng) for _ in range(errors.shape[1])], axis=1)
    white = first.whitened(np.column_stack([by_start, errors + noise]))
    n = by_start.shape[1]
    return -np.linalg.lstsq(white[:, :n], white[:, n:], rcond=None)[0]


def _spread(
    found: Simulated,
    motion: Trajectory,
    changes: Array,
    verdict: Adequacy,
    reach: float,
    samples: int,
) -> tuple[Array, Array]:
    """Ends of the band where inputs keep the phase, or several coordinates move.

    What the fit left beyond the noise is expected again, as a part of the response at the time.
    """
    record, rng = found.record, np.random.default_rng(0)
    shown, slopes = _slopes(found, motion)
    n, first = len(changes), record.beginning(samples)
    rows = np.tile(np.arange(len(record.t)) < len(first.t), record.n_channels)
    start = _with_state(slopes[rows, n:], slopes[rows, :n] @ changes, first, rng)
    variance = np.var(slopes @ np.concatenate([changes, start]), axis=1)
    cycle = max(round(len(record.t) / record.turns), 1)
    size = uniform_filter1d(record.by_channel(shown) ** 2, 2 * cycle, axis=1).ravel()
    left = verdict.beyond_noise * float(grown(record.peak, reach))
    noise = np.maximum(record.white, verdict.everywhere)
    half = SIGMAS * np.sqrt(variance + left**2 * size + noise**2)
    return shown - half, shown + half


def _slopes(found: Simulated, motion: Trajectory) -> tuple[Array, Array]:
    """What the channels show, (c n,), and its derivatives by all values and by the state."""
    response = respond(found.equation, motion)
    reading = found.reading(motion)
    change = found.record.in_orders(found.parts, response.samples)[..., 1:]
    return reading.shown, reading.by_all(change)


def _turned(
    found: Simulated,
    motion: Trajectory,
    changes: Array,
    verdict: Adequacy,
    reach: float,
    samples: int,
) -> tuple[Array, Array]:
    """Ends of the band of a decay: its phase may be lost, so errors turn and stretch the motion."""
    record, rng = cast(Record, found.record), np.random.default_rng(0)
    own = tuple(Part(Coefficient(law), (), np.zeros((1, 1))) for law in LINEAR)
    found = found._replace(parts=(*found.parts, *own))
    windows = Windows.of(cast(Any, found.model), found.parts, 0, record, motion, reach)
    shown, slopes = _slopes(found, motion)
    n, first = len(changes) + len(own), record.beginning(samples)
    by_form = windows.departed(record.derivative)
    moves = as_coefficients(verdict.frequency, verdict.damping, record.rate)
    size = np.concatenate([moves, np.full(by_form.shape[1], verdict.departure)])
    form = size[:, None] * rng.standard_normal((len(size), changes.shape[1]))
    errors = np.concatenate([changes, form])
    early = slice(len(first.t))
    missed = np.column_stack([slopes[early, :n], by_form[early]]) @ errors
    start = _with_state(slopes[early, n:], missed, first, rng)
    errors = np.concatenate([errors[:n], start, errors[n:]])
    # A sine and its slope turn as one complex number.
    turn = -1j / record.rate
    q = [motion.samples(found.equation, d)[:, 0] for d in (0, 1)]
    by = [
        np.column_stack([windows.response.samples(d)[:, 0, 1:], windows.departed(d)])
        for d in (0, 1)
    ]
    table = (by[0] + turn * by[1]) / (q[0] + turn * q[1])[:, None]
    noise, ends = float(np.std(record.drawn(rng))), []
    for rows in np.array_split(np.arange(len(shown)), len(shown) // _AT_ONCE + 1):
        change = table[rows] @ errors
        later = record.t[rows, None] + change.imag / record.rate
        drawn = np.exp(np.clip(change.real, -1.0, 1.0)) * np.interp(later, record.t, shown)
        drawn += noise * rng.standard_normal(drawn.shape)
        ends.append(np.quantile(drawn, TAILS, axis=1))
    low, high = np.concatenate(ends, axis=1)
    return np.minimum(low, shown), np.maximum(high, shown)


class _Own(Coefficient):
    """Another value of a coefficient in each record."""

    per_record = True


def form_of(
    model: ReducedModel,
    parts: tuple[Part, ...],
    records: Sequence[Record],
    motions: Sequence[Trajectory],
) -> Form:
    """What records say of an equation that was fitted to them; nothing where it goes astray.

    Where there are several, each has a frequency and a damping of its own beside the common values.
    """
    moved = Form()
    try:
        if len(records) > 1:
            own = tuple(Part(_Own(law), (), np.zeros((len(records), 1))) for law in LINEAR)
            found = fit(model, (*parts, *own), records, motions)
            if found.finite:
                moved, parts, motions = _moved(found, records), found.parts, found.motions
        pairs = enumerate(zip(records, motions, strict=True))
        windows = [Windows.of(model, parts, i, *pair) for i, pair in pairs]
    except TrajectoryError:
        return moved
    return moved._replace(departure=Marginal.of(parts, windows).allowed())


def _loss(record: Record) -> float:
    """Damping ratio, by the amplitudes at begin and end."""
    first, *_, last = np.hypot(record.motion.q[:, 0], record.motion.q_dot[:, 0] / record.rate)
    turned = float(np.ptp(record.phase(record.t[[0, -1]])))
    return float(abs(np.log(first / last))) / turned


def _moved(found: Solution, records: Sequence[Record]) -> Form:
    """From the linear stiffness and damping of each record, the last two parts of a fit."""
    n, damping = len(records), float(np.mean([_loss(r) for r in records]))
    unit = as_coefficients(1.0, 1.0, float(np.mean([r.rate for r in records])))[:, None]
    variance = np.diag(found.covariance)[-2 * n :].reshape(2, n) / unit**2
    moves = np.array([p.strengths[:, 0] for p in found.parts[-2:]]) / unit
    moves -= moves.mean(axis=1, keepdims=True)
    if np.sum(moves**2 / variance) < chi2.isf(FALSE_ALARM, 2 * (n - 1)):
        return Form()
    # Two tests differ by the root of two times their scatter, and by two of these at most.
    usual = np.array([SAME_FREQUENCY, SAME_DAMPING * damping]) / (np.sqrt(2) * SIGMAS)
    frequency, loss = (scatter(*x) for x in zip(moves, variance, usual, strict=True))
    seen = np.std(moves, axis=1, ddof=1)
    note = (
        f"the records disagree: from one to another the frequency moves by {percent(seen[0])} and"
        f" the damping by {percent(seen[1] / damping)} (standard deviations of {n} records); the"
        " band of a forecast counts it"
    )
    return Form(0.0, frequency, loss, note)
