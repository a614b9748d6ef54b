"""What a user's own simulator lacks, from measured decays: releases, equation, rounds, report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from romsindy.diagnosis.on_simulator.report import SimulatorReport
from romsindy.diagnosis.on_simulator.seen import ForceScale, OnSimulator, ProbeSpring, ValueEffect
from romsindy.diagnosis.on_simulator.simulator_rounds import SimulatorRounds
from romsindy.diagnosis.search import LINEAR, Options, Request
from romsindy.diagnosis.simulated import SimulationModel, model_of_simulation
from romsindy.diagnosis.structure import linear_parts, sensor_errors
from romsindy.diagnosis.workflow import diagnose_model
from romsindy.effects.base import Effect
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Coefficient, Part
from romsindy.fit.records.record import Record, scales
from romsindy.fit.verdict import LEFT_OVER
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Combination
from romsindy.record.backbone import extract_backbone
from romsindy.record.decay import Decay
from romsindy.simulator.simulator import SimulatedDecay, Simulator, SimulatorError, times, whole
from romsindy.typing import Array

# As assumed, and a standard deviation: relative, but for what is zero.
Values = Mapping[str, tuple[float, float | None]]

_MOST_RELEASES = 20
_NEXT, _DOWN_TO = 0.6, 1.5  # of the release before; of the least amplitude of the records
_MOVES = 0.1  # of the largest channel: the first must tell where the structure is let go
_PROBE = 2e-2  # change of omega^2 by a spring, which tells what a force does
_FELT, _MOST_TRIED, _FARTHEST = 1e-6, 12, 1e4
_CYCLES = 20  # that are simulated with a probe
_TOGETHER = 1e-4  # of the largest motion: what channels do beside it, at least, tells modes apart
_LOUDER = 3.0  # times the noise, at the most, where other modes do not show
_VIBRATES = 6  # crossings: what has fewer is no vibration, and is refused as that
_OTHER_RATE = 5.0  # times the frequency: no value that is known to some per cent makes that
_STEP = 0.03  # of a value, for what a change of it does
# Of the response of a sensor: where nothing changes the first mode, and so much is left, something
# changes other modes
_ELSEWHERE = 0.05


def diagnose_simulator(
    simulator: Simulator, request: Request, parameters: Values
) -> SimulatorReport:
    """Find, name and add what a simulator lacks.

    The simulator is let go from where the records are, and as often below as tells its stiffness,
    inertia and damping over their range. An equation of one coordinate stands for it; what it does
    beside the equation is taken off, and what is found goes into it as far as it takes a force or
    the values.
    """
    simulator.check_values([*parameters])
    _check(request)
    decays, options = request.everything, request.options
    _check_channels(decays)
    say = options.progress
    values = {name: float(value) for name, (value, _) in parameters.items()}
    say(f"simulator {simulator.name}: releases over the range of the records")
    on, known = _reduced(simulator, decays, values, options)
    model = replace(known.model, amplitude_range=None)
    if simulator.takes_force:
        say(f"simulator {simulator.name}: what a force does")
        on = replace(on, scale=_force_scale(on, model))
    own = [_value_effect(on, model, name, tolerance) for name, (_, tolerance) in parameters.items()]
    near = [e for e in own if e.tolerance is not None]
    unsure: list[Effect] = [LINEAR[f] if isinstance(f, str) else f for f in request.free]
    records = [Record.loud(on.decay(d), options.floor) for d in decays]
    amplitude, omega = scales(records)[:2]
    on = replace(on, reach=(amplitude, amplitude * omega))
    looked_for = [*options.catalogue, *(e for e in own if e.tolerance is None)]
    rounds = SimulatorRounds(
        *(on, diagnose_model, model, records, decays, request.held_out is not None),
        *([*unsure, *near], looked_for, options, [None] * len(records)),
    )
    try:
        before = rounds.begin()
    except TrajectoryError as error:
        raise ValueError(
            f"the equation of simulator {simulator.name} has no motion near the records ({error}):"
            " compare its frequency with theirs, and check units"
        ) from error
    found = rounds.right(rounds.over_all_sensors(rounds.run((), before))).or_before(before)
    on = rounds.structure
    report = SimulatorReport(
        reduced=rounds.with_values_of_simulator(found),
        parts=found.parts,
        sensor_errors=(),
        trouble=found.trouble,
        seen=on,
        missed=known.missed,
        place=rounds.place_of(found.parts),
    )
    if report.not_there or report.trouble:  # the simulator is what it was
        return replace(report, parts=())
    last = decays[-1].between(rounds.calm[-1])
    names = [f"channel {i + 1}" for i in range(len(on.shape))]
    errors = sensor_errors(names, last, (before[-1], found.corrected[-1]))
    much = max(e.part for e in errors) > _ELSEWHERE
    if report.verdict == "none" and much and rounds.left_beside(found.corrected) > LEFT_OVER:
        report = replace(report, reduced=replace(report.reduced, verdict="unknown"))
    worse = max(e.after for e in errors) > max(e.before for e in errors)  # nothing makes it that
    if worse or report.reduced.refused:
        errors = sensor_errors(names, last, (before[-1], before[-1]))
        report = replace(report, parts=())
    return replace(report, sensor_errors=errors)


def checked_values(given: Mapping[str, float | tuple[float, float]]) -> Values:
    """Values of a simulator with their relative standard deviations, None where there is none.

    Raises a ValueError for what is neither.
    """
    found: dict[str, tuple[float, float | None]] = {}
    for name, said in given.items():
        pair = said if isinstance(said, (tuple, list)) else (said, None)
        numbers = [x for x in pair if x is not None]
        right = len(pair) == 2 and all(isinstance(x, (int, float)) for x in numbers)
        if not (right and np.all(np.isfinite(numbers)) and (pair[1] is None or pair[1] > 0)):
            raise ValueError(
                f"parameters of {name!r} = {said!r} must be a value, or a value and its relative"
                " standard deviation, such as (1000.0, 0.05)"
            )
        found[name] = (float(pair[0]), pair[1])
    return found


def _check(request: Request) -> None:
    if not request.measured:
        raise ValueError("measured is empty: give at least one Decay")
    if any(not isinstance(f, Effect) and f not in LINEAR for f in request.free):
        raise ValueError(
            f"free = {list(request.free)}: of a simulator, {list(LINEAR)} can be free; name its own"
            " values in parameters"
        )


def _check_channels(decays: Sequence[Decay]) -> None:
    """Raise a ValueError for records that differ in channels or units."""
    for i, decay in enumerate(decays):
        if decay.n_channels != decays[0].n_channels or decay.unit != decays[0].unit:
            raise ValueError(
                f"decay {i} has {decay.n_channels} channels in {decay.unit}, and decay 0"
                f" {decays[0].n_channels} in {decays[0].unit}: give the same of all"
            )


def _first(decay: Decay) -> Record:
    """A record in its first channel, of which releases are."""
    x = decay.q.reshape(len(decay.t), -1)
    sizes = np.ptp(x, axis=0)
    if sizes[0] < _MOVES * sizes.max():
        raise ValueError(
            f"the first channel moves by {sizes[0]:.3g}, the largest by {sizes.max():.3g}: give one"
            " first that moves more, for a release is its displacement; and in the simulator, too"
        )
    return Record.loud(Decay(decay.t, x[:, 0], unit=decay.unit), 0.0)


# -- releases --------------------------------------------------------------------------------------


def _reduced(
    simulator: Simulator, decays: Sequence[Decay], values: Mapping[str, float], options: Options
) -> tuple[OnSimulator, SimulationModel]:
    """The simulator in its coordinate, and its equation over the range of some records."""
    n, records = decays[0].n_channels, [_first(d) for d in decays]
    rate = float(np.mean([r.rate for r in records]))
    longest = max(records, key=lambda r: float(r.t[-1]))
    t = times(float(longest.t[-1]), longest.decay.dt, rate)
    release = max([_reach(r) for r in records], key=abs)
    least = min(float(extract_backbone(r.decay.single()).amplitude.min()) for r in records)
    largest = simulator.decay(release, t, n, values=values)
    _check_rate(simulator, largest, rate)
    simulator.check_again(release, t, n, values)
    answers = [largest]
    try:
        on = OnSimulator(simulator, *_shape(largest.displacements), values)
        for release in _below(on, largest, least):
            options.progress(f"simulator {simulator.name}: released from {release:.4g}")
            answers.append(simulator.decay(release, t, n, values=values))
        series = [on.decay(Decay(a.t, a.displacements, unit=decays[0].unit)) for a in answers]
        known = model_of_simulation(series)
    except SimulatorError:
        raise
    except ValueError as error:
        raise ValueError(
            f"what simulator {simulator.name} gives, released from {answers[-1].release:.4g}, is no"
            f" free decay like the measured one: {error}"
        ) from error
    model = replace(known.model, amplitude_range=None)
    begins = [on.start(model, (), Record.of(s, options.floor))[0] for s in series]
    on.released.extend(zip([a.release for a in answers], begins, strict=True))
    return on, known


def _check_rate(simulator: Simulator, answer: SimulatedDecay, rate: float) -> None:
    """Raise a ValueError for a motion that is by far faster or slower than the records."""
    x = answer.displacements[:, 0] - answer.displacements[:, 0].mean()
    crossings = np.count_nonzero(np.diff(np.signbit(x)))
    own = np.pi * crossings / float(answer.t[-1])
    if crossings >= _VIBRATES and not 1 / _OTHER_RATE < own / rate < _OTHER_RATE:
        raise ValueError(
            f"simulator {simulator.name} vibrates at about {own / (2 * np.pi):.3g} Hz, the records"
            f" at {rate / (2 * np.pi):.3g} Hz: check its units (of a deck mm,t,s or m,kg,s), its"
            " stiffness and mass, and which mode was measured"
        )


def _reach(record: Record) -> float:
    """The first extreme of a record, with its sign."""
    x = record.signal - record.signal.mean()
    first = x[: int(2 * np.pi / record.rate / record.decay.dt) + 1]
    return float(first[np.argmax(np.abs(first))])


def _shape(x: Array) -> tuple[Array, Array]:
    """Shape (n_sensors,) of what moves most in displacements (n, n_sensors), 1 at the first.

    Beside it, weights of the channels in which other modes do not show: by smooth orthogonal
    decomposition [1], where noise does not grow by much for it, else by least squares.

    [1] D. Chelidze, W. Zhou, "Smooth orthogonal decomposition-based vibration mode
        identification", J. Sound Vib. 292 (2006), doi 10.1016/j.jsv.2005.08.006.
    """
    later = x[len(x) // 3 :]  # fast modes die first
    _, _, modes = np.linalg.svd(later - later.mean(axis=0), full_matrices=False)
    if abs(modes[0, 0]) < _MOVES * np.abs(modes[0]).max():
        raise ValueError(
            "the first channel hardly moves in the simulation: give one first that moves more,"
            " for a release is its displacement"
        )
    shape = modes[0] / modes[0, 0]
    plain = shape / (shape @ shape)
    away = x - x.mean(axis=0)
    _, sizes, axes = np.linalg.svd(away, full_matrices=False)
    axes = axes[sizes > _TOGETHER * sizes[0]]  # channels that move as one tell no modes apart
    moved = away @ axes.T
    fast = np.gradient(moved, axis=0)
    apart = axes.T @ eigh(fast.T @ fast, moved.T @ moved)[1]  # weights, a column for each mode
    shapes = np.linalg.pinv(apart)
    loudest = int(np.argmax(np.std(away @ apart, axis=0) * np.linalg.norm(shapes, axis=1)))
    first = shapes[loudest, 0]
    reading, own = apart[:, loudest] * first, shapes[loudest] / first
    if np.linalg.norm(reading) > _LOUDER * np.linalg.norm(plain):
        return shape, plain
    return np.asarray(own), np.asarray(reading)


def _below(on: OnSimulator, largest: SimulatedDecay, least: float) -> Iterator[float]:
    """Further releases down to where the records end."""
    decay = on.decay(Decay(largest.t, largest.displacements))
    end = float(extract_backbone(decay).amplitude.min())
    release = abs(largest.release)
    for _ in range(_MOST_RELEASES - 1):
        if end <= _DOWN_TO * least:
            return
        # It falls by as much again from there.
        fall, release = end / release, max(_NEXT * release, min(end, release), _DOWN_TO * least)
        release = min(release, _NEXT * abs(largest.release))
        yield float(np.copysign(release, largest.release))
        end = fall * release


# -- the way in ------------------------------------------------------------------------------------


def _force_scale(on: OnSimulator, model: ReducedModel) -> ForceScale:
    """What a force does, from the frequency beside a spring that is added at its point.

    Raises a SimulatorError where a force does nothing, or the opposite.
    """
    release, q = max(on.released, key=lambda pair: abs(pair[0]))
    omega2 = model.coefficients["omega^2"]
    cycles = _CYCLES * 2 * np.pi / omega2**0.5
    free = on.simulated(q, next(a.t for a in on.simulator.computed if a.release == release))
    t = free.t[: int(np.searchsorted(free.t, cycles))]
    base = _linear_change(on, model, free.displacements[: len(t)], t)
    stiffness = _PROBE * omega2  # of a modal mass of 1
    for _ in range(_MOST_TRIED):
        spring = ProbeSpring(stiffness)
        moved = on.simulated(q, t, spring)
        change = (_linear_change(on, model, moved.displacements, t) - base) / omega2
        if abs(change) > _FELT and 0.3 < abs(change) / _PROBE < 3:
            break
        factor = _PROBE / abs(change) if abs(change) > _FELT else _FARTHEST
        stiffness *= float(np.clip(factor, 1 / _FARTHEST, _FARTHEST))
    else:
        raise SimulatorError(
            f"simulator {on.simulator.name}: a force -k x changes its frequency by a part of"
            f" {change:.2g} with k = {stiffness:.3g}: add force(t, x, v) to the forces on the point"
            " whose displacement x and velocity v it takes"
        )
    if change < 0:
        raise SimulatorError(
            f"simulator {on.simulator.name}: a force -k x makes it softer: add force(t, x, v) to"
            " the forces that push the point, not to those that hold it"
        )
    per_q = on.per_q(moved, spring.seen)
    return ForceScale(stiffness * per_q**2 / (change * omega2), per_q)


def _linear_change(on: OnSimulator, model: ReducedModel, x: Array, t: Array) -> float:
    """Change of omega^2 of the equation that a simulated motion (n, n_sensors) shows."""
    record = Record.of(Decay(t, on.coordinate(x)), 1e-6)
    return float(_changes(model, linear_parts(record), [record])[0])


def _value_effect(
    on: OnSimulator, model: ReducedModel, name: str, tolerance: float | None
) -> ValueEffect:
    """What a change of a value of the simulator does to its equation."""
    value, zero = on.values[name], on.simulator.steps.get(name, 0.0)
    if value == 0 == zero:
        raise ValueError(
            f"parameters of {name!r} = 0: a part of it is 0 as well; give it the size that it may"
            " have"
        )
    step = _STEP * value or zero
    changed = {**on.values, name: value + step}
    # From all releases: one does not tell a linear coefficient from a nonlinear one.
    base = [next(a for a in on.simulator.computed if a.release == r) for r, _ in on.released]
    rows = zip(on.released, base, strict=True)
    asked = [on.question(q, a.t, values=changed) for (_, q), a in rows]
    there = [whole(a) for a in on.simulator.decays(asked, len(on.shape))]
    slopes = (_coefficients(on, model, there) - _coefficients(on, model, base)) / step
    direction = Combination(name, model.terms, tuple(slopes.tolist()))
    deviation = None if tolerance is None else tolerance * (abs(value) or 1.0)
    return ValueEffect(name, value, direction, deviation, zero)


def _coefficients(on: OnSimulator, model: ReducedModel, answers: Sequence[SimulatedDecay]) -> Array:
    """Changes of all coefficients of the equation that simulated motions show."""
    parts = [Part(Coefficient(term), (), np.zeros((1, 1))) for term in model.terms]
    decays = [Decay(a.t, on.coordinate(a.displacements)) for a in answers]
    return _changes(model, parts, [Record.of(d, 1e-6) for d in decays])


def _changes(model: ReducedModel, parts: Sequence[Part], records: Sequence[Record]) -> Array:
    """Strengths of parts, one each, that make an equation follow records."""
    solution = fit(model, parts, records, iterations=30)
    return np.array([p.strengths[0, 0] for p in solution.parts])
