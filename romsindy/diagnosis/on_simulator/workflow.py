"""What a user's own simulator lacks, from measured decays: releases, equation, rounds, report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from romsindy.diagnosis.arguments import FREE
from romsindy.diagnosis.on_simulator.effects import ForceScale, ValueEffect
from romsindy.diagnosis.on_simulator.report import SimulatorReport
from romsindy.diagnosis.on_simulator.seen import Beginning, OnSimulator
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.rounds import Outcome, Rounds
from romsindy.diagnosis.search import Options
from romsindy.diagnosis.simulated import SimulationModel, model_of_simulation
from romsindy.diagnosis.structure import Corrected, key_of
from romsindy.diagnosis.structure_report import sensor_errors
from romsindy.diagnosis.workflow import diagnose_model
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.base import Effect
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Coefficient, Part, Solution, moved_parts
from romsindy.fit.records.record import Record, scales
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Combination
from romsindy.record.backbone import extract_backbone
from romsindy.record.decay import SIGNALS, Decay
from romsindy.record.spectrum import noise_std
from romsindy.simulator.force import LawForce
from romsindy.simulator.simulator import SimulatedDecay, Simulator, SimulatorError, times
from romsindy.typing import Array

Values = Mapping[str, tuple[float, float | None]]  # as assumed, and a relative standard deviation

_MOST_RELEASES = 20
_NEXT, _DOWN_TO = 0.6, 1.5  # of the release before; of the least amplitude of the records
_MOVES = 0.1  # of the largest channel: the first must tell where the structure is let go
_LINEAR: Mapping[str, Effect] = {"omega^2": LinearFrequency(), "c_linear": Viscous()}
_PROBE = 2e-2  # change of omega^2 by a spring, which tells what a force does
_FELT, _MOST_TRIED, _FARTHEST = 1e-6, 12, 1e4
_CYCLES = 20  # that are simulated with a probe
_FIRST_SENSOR = 2e-3  # a point that moves as it does within this is that of the sensor
_CLOSE, _POLISHED = 1.05, 3  # own error over the noise that is good enough; rounds towards it
_LARGER = 1e-3  # beginning of a record, for what a change of it does
_STEP = 0.01  # of a value, for what a change of it does


def diagnose_simulator(
    simulator: Simulator,
    measured: Sequence[Decay],
    held_out: Decay | None,
    free: Sequence[str | Effect] | None,
    parameters: Values,
    options: Options,
) -> SimulatorReport:
    """Find, name and add what a simulator lacks; arguments as those of `diagnose`.

    The simulator is let go from where the records are, and as often below as tells its stiffness,
    inertia and damping over their range. An equation of one coordinate stands for it; what it does
    beside the equation is taken off, and what is found goes into it as far as it takes a force or
    the values.
    """
    simulator.check_values([*parameters])
    _check(measured, free)
    decays = [*measured, *([held_out] if held_out is not None else [])]
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
    # Values that are stated stand for what the simulation is unsure of.
    free = (() if parameters else FREE) if free is None else free
    unsure: list[Effect] = [_LINEAR[f] if isinstance(f, str) else f for f in free]
    records = [Record.loud(on.decay(d), options.floor) for d in decays]
    amplitude, omega = scales(records)[:2]
    on = replace(on, reach=(amplitude, amplitude * omega))
    looked_for = [*options.catalogue, *(e for e in own if e.tolerance is None)]
    rounds = SimulatorRounds(
        *(on, diagnose_model, model, records, decays, held_out is not None),
        *([*unsure, *near], looked_for, options, [None] * len(records)),
    )
    try:
        before = rounds.begin()
    except TrajectoryError as error:
        raise ValueError(
            f"the equation of simulator {simulator.name} has no motion near the records ({error}):"
            " compare its frequency with theirs, and check units"
        ) from error
    found = rounds.run((), before)
    report = SimulatorReport(
        reduced=rounds.with_values_of_simulator(found.report, found.parts),
        parts=found.parts,
        sensor_errors=(),
        trouble=found.trouble,
        seen=on,
        missed=known.missed,
    )
    if report.not_there:  # the simulator is what it was
        return report
    last = decays[-1].between(rounds.calm[-1])
    names = [f"channel {i + 1}" for i in range(len(on.shape))]
    errors = sensor_errors(names, last, (before[-1], found.corrected[-1]))
    if max(e.after for e in errors) > max(e.before for e in errors):  # nothing makes it worse
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


def _check(measured: Sequence[Decay], free: Sequence[str | Effect] | None) -> None:
    if not measured:
        raise ValueError("measured is empty: give at least one Decay")
    unknown = [f for f in free or () if not isinstance(f, Effect) and f not in _LINEAR]
    if unknown:
        raise ValueError(
            f"free = {list(free or ())}: of a simulator, {list(_LINEAR)} can be free; name its own"
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


@dataclass(eq=False)
class SimulatorRounds(Rounds):
    """A simulator and its equation beside records.

    The equation follows what the simulator does with its own values of what was added: a strong
    effect bends the structure otherwise than its slow mode, and the equation needs another one for
    the same motion. What is measured is compared with that, and the simulator is changed by the
    difference (indirect inference, [1]).

    [1] C. Gourieroux, A. Monfort, E. Renault, Indirect inference, J. Appl. Econometrics 8 (1993).
    """

    own: tuple[Part, ...] = ()  # in the equation, for what is in the simulator

    def simulate(self, parts: Sequence[Part], *, begun: bool = False) -> list[Corrected]:
        """Simulate with what was found, and let the equation follow.

        How records begin is looked at anew, unless that is known by now.
        """
        if not begun:
            self.releases = [None] * len(self.records)
        found = super().simulate(parts)
        seen = [
            _as_measured(r, self.structure.coordinate(c.readings))
            for r, c in zip(self.records, found, strict=True)
        ]
        followed = fit(self.model, parts, seen, iterations=30)
        if not followed.finite:
            raise TrajectoryError("no motion of its equation follows it")
        self.own = followed.parts
        left = followed.residuals
        return [
            c._replace(decay=_with_signal(c.decay, r.signal - beside))
            for r, c, beside in zip(self.records, found, left, strict=True)
        ]

    def with_values_of_simulator(
        self, report: DiagnosisReport, parts: Sequence[Part]
    ) -> DiagnosisReport:
        """The same with the values that its best has in the simulator."""
        found = {key_of(p): p.values for p in report.best.parts}
        more = {key_of(p): p.values - found[key_of(p)] for p in parts if key_of(p) in found}
        best = replace(report.best, weighed=InSimulator(report.best.weighed, more))
        rivals = tuple(best if h is report.best else h for h in report.rivals)
        return replace(report, best=best, rivals=rivals) if more else report

    def in_equation(self, parts: Sequence[Part]) -> Sequence[Part]:
        return self.own

    def run(
        self, effects: Sequence[Effect], before: list[Corrected], parts: tuple[Part, ...] = ()
    ) -> Outcome:
        """As every structure; then the simulator itself comes as near to the records as it can."""
        best = super().run(effects, before, parts)
        for _ in range(_POLISHED):
            if best.trouble or not best.parts or self.own_error(best.corrected) <= _CLOSE:
                break
            self.options.progress(f"{self.structure.what} nearer to the records")
            try:
                changed = self._nearer(best)
                found = self.simulate(changed, begun=True)
            except self.structure.failures:  # what was found stands, and so does its error
                break
            report = self._look(effects, found, len(best.report.best.effects))
            nearer = self.own_error(found) < self.own_error(best.corrected)
            if not nearer or report.best.names != best.report.best.names:
                break
            best = Outcome(report, changed, found)
        return best

    def own_error(self, found: Sequence[Corrected]) -> float:
        """Rms of measured minus simulated over the noise, at the worst sensor of all records."""
        rows = zip(found, self.raw, strict=True)
        names = [""] * len(self.structure.shape)
        errors = [
            sensor_errors(names, raw.between(c.decay.t[0], c.decay.t[-1]), (c, c))
            for c, raw in rows
        ]
        return max(e.after for several in errors for e in several)

    def _nearer(self, best: Outcome) -> tuple[Part, ...]:
        """What is in the simulator, changed by one step of least squares on its own readings.

        Beside it each record may begin a little larger, or later.
        """
        values = np.concatenate([p.values for p in best.parts])
        steps = _STEP * np.where(values == 0, 1.0, np.abs(values))
        rows = [self._linear(i, c, best.parts, steps) for i, c in enumerate(best.corrected)]
        change = np.zeros(len(steps))
        learnt = rows[: self.n_training]
        for own in (learnt, rows):  # what took no part says how it begins alone
            left = [r.left - r.by_value @ change for r in own]
            blocks = block_diag(*(r.by_start for r in own))
            free = own is learnt
            matrix = (
                np.hstack([np.concatenate([r.by_value for r in own]), blocks]) if free else blocks
            )
            # A value that is held, or at its limit, moves nothing: it stays.
            size = np.linalg.norm(matrix, axis=0)
            scale = np.where(size > 0, size, 1.0)
            found = np.linalg.lstsq(matrix / scale, np.concatenate(left))[0] / scale
            change = found[: len(steps)] if free else change
        for i, c in enumerate(best.corrected):
            size = c.release.size * (1 + found[2 * i])
            self.releases[i] = c.release._replace(size=float(size))
        return moved_parts(best.parts, change)

    def _linear(
        self, i: int, c: Corrected, parts: tuple[Part, ...], steps: Array
    ) -> LinearReadings:
        """What readings of a record follow, by simulations with small changes."""
        record, raw = self.records[i], self.raw[i]
        own = raw.between(c.decay.t[0], c.decay.t[-1])
        measured = own.signal.reshape(len(own.t), -1)
        noise = np.array([noise_std(y) for y in measured.T])

        def change(there: tuple[Part, ...], release: Beginning, step: float) -> Array:
            equation = equation_of(self.model, there, i, record)
            start = tuple(x / c.release.size for x in c.start)
            moved = self.structure.moved(equation, there, record, raw, start, release)
            return ((moved.readings[record.derivative] - c.readings) / step / noise).ravel()

        by_value = [
            change(moved_parts(parts, step * one), c.release, step)
            for step, one in zip(steps, np.eye(len(steps)), strict=True)
        ]
        larger = c.release._replace(size=c.release.size * (1 + _LARGER))
        later = np.gradient(c.readings, record.decay.dt, axis=0) / noise
        by_start = [change(parts, larger, _LARGER), later.ravel()]
        left = ((measured - c.readings) / noise).ravel()
        return LinearReadings(left, np.stack(by_value, axis=1), np.stack(by_start, axis=1))

    def next_parts(self, parts: Sequence[Part], found: Sequence[Part]) -> tuple[Part, ...]:
        """What was found, less what the equation needs for what is in the simulator."""
        there = {key_of(p): p for p in parts}
        own = {key_of(p): p for p in self.own}
        return tuple(
            there[key].moved(p.values - own[key].values) if (key := key_of(p)) in there else p
            for p in self.structure.with_effects(found)
        )


class LinearReadings(NamedTuple):
    """What is left of a record, (m,) over the noise, and what it follows, (m, k) each.

    Values of the simulator; the size and the time with which the record begins.
    """

    left: Array
    by_value: Array
    by_start: Array


@dataclass(frozen=True)
class InSimulator:
    """What a fit says of the values in a simulator: those in its equation, and by how much more."""

    weighed: Any  # what it says of those in the equation, a `Weighing`
    more: Mapping[tuple[str, str], Array]

    @property
    def needed(self) -> Any:
        return self.weighed.needed

    def excess(self, noise: Any) -> float:
        return float(self.weighed.excess(noise))

    def solved(self, solution: Solution, noise: Any) -> Any:
        found = self.weighed.solved(solution, noise)
        there = [
            p.moved(self.more[key]) if (key := key_of(p)) in self.more else p for p in found.parts
        ]
        return found._replace(parts=tuple(there))


def _with_signal(decay: Decay, signal: Array) -> Decay:
    """The same with another signal (n,) in the place of what its sensor gave."""
    given: dict[str, Any] = {SIGNALS[decay.derivative]: signal}
    return replace(decay, **given)


def _as_measured(record: Record, simulated: Array) -> Record:
    """A record of a simulated signal (n,), with the noise of a measured one: as much is learnt."""
    own = Record.of(_with_signal(record.decay, simulated), 1e-4)
    return replace(own, noise=record.noise, doubts=record.doubts, first=record.first)


# -- releases --------------------------------------------------------------------------------------


def _reduced(
    simulator: Simulator, decays: Sequence[Decay], values: Mapping[str, float], options: Options
) -> tuple[OnSimulator, SimulationModel]:
    """The simulator in its coordinate, and its equation over the range of some records."""
    n, records = decays[0].n_channels, [_first(d) for d in decays]
    rate = float(np.mean([r.rate for r in records]))
    longest = max(records, key=lambda r: float(r.t[-1]))
    t = times(float(longest.t[-1]), longest.decay.dt, rate)
    reaches = [_reach(r) for r in records]
    release = max(reaches, key=abs)
    least = min(float(extract_backbone(r.decay.single()).amplitude.min()) for r in records)
    largest = simulator.decay(release, t, n, values=values)
    simulator.check_again(release, t, n, values)
    on = OnSimulator(simulator, _shape(largest.displacements), values)
    answers = [largest]
    for release in _below(on, largest, least):
        options.progress(f"simulator {simulator.name}: released from {release:.4g}")
        answers.append(simulator.decay(release, t, n, values=values))
    series = [on.decay(Decay(a.t, a.displacements, unit=decays[0].unit)) for a in answers]
    try:
        known = model_of_simulation(series)
    except ValueError as error:
        raise ValueError(
            f"simulator {simulator.name}, released from {largest.release:.4g}: {error}"
        ) from error
    model = replace(known.model, amplitude_range=None)
    begins = [on.start(model, (), Record.of(s, options.floor))[0] for s in series]
    on.released.extend(zip([a.release for a in answers], begins, strict=True))
    return on, known


def _reach(record: Record) -> float:
    """The first extreme of a record, with its sign."""
    x = record.signal - record.signal.mean()
    first = x[: int(2 * np.pi / record.rate / record.decay.dt) + 1]
    return float(first[np.argmax(np.abs(first))])


def _shape(x: Array) -> Array:
    """Shape (n_sensors,) of what moves most in displacements (n, n_sensors), 1 at the first."""
    later = x[len(x) // 3 :]  # fast modes die first
    _, _, modes = np.linalg.svd(later - later.mean(axis=0), full_matrices=False)
    if abs(modes[0, 0]) < _MOVES * np.abs(modes[0]).max():
        raise ValueError(
            "the first channel hardly moves in the simulation: give one first that moves more,"
            " for a release is its displacement"
        )
    return np.asarray(modes[0] / modes[0, 0])


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
    whole = on.simulated(q, next(a.t for a in on.simulator.computed if a.release == release))
    t = whole.t[: int(np.searchsorted(whole.t, cycles))]
    base = _linear_change(on, model, whole.displacements[: len(t)], t)
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
    per_q = _per_q(on, moved, spring.seen)
    return ForceScale(stiffness * per_q**2 / (change * omega2), per_q)


@dataclass
class ProbeSpring:
    """A force -k x that keeps when (s) it was asked, and at which displacement of its point."""

    stiffness: float
    seen: list[tuple[float, float]] = field(default_factory=list)

    def __call__(self, t: float, x: float, v: float) -> float:
        self.seen.append((float(t), float(x)))
        return -self.stiffness * float(x)

    def code(self, language: str) -> str:
        """As that of every force."""
        return LawForce(((Stiffness(1), self.stiffness),), 1.0).code(language)


def _linear_change(on: OnSimulator, model: ReducedModel, x: Array, t: Array) -> float:
    """Change of omega^2 of the equation that a simulated motion (n, n_sensors) shows."""
    record = Record.of(Decay(t, on.coordinate(x)), 1e-6)
    parts = [Part.of(e, scales([record]), 1) for e in _LINEAR.values()]
    solution = fit(model, parts, [record], iterations=30)
    return float(solution.parts[0].strengths[0, 0])


def _per_q(on: OnSimulator, moved: SimulatedDecay, seen: Sequence[tuple[float, float]]) -> float:
    """How far the point of a force moves where the coordinate moves by 1.

    A program reads a file, and nobody sees where: it is taken for the first sensor.
    """
    inside = np.array([row for row in seen if moved.t[0] <= row[0] <= moved.t[-1]])
    if not len(inside):
        return 1.0
    order = np.argsort(inside[:, 0])
    at, x = inside[order].T
    q = on.coordinate(moved.at(at))
    per_q = float(q @ x / (q @ q))
    return 1.0 if abs(per_q - 1) < _FIRST_SENSOR else per_q


def _value_effect(
    on: OnSimulator, model: ReducedModel, name: str, tolerance: float | None
) -> ValueEffect:
    """What a change of a value of the simulator does to its equation."""
    value = on.values[name]
    if value == 0:
        raise ValueError(
            f"parameters of {name!r} = 0: a part of it is 0 as well; give it the size that it may"
            " have"
        )
    step = _STEP * value
    release, q = max(on.released, key=lambda pair: abs(pair[0]))
    base = next(a for a in on.simulator.computed if a.release == release)
    there = on.simulated(q, base.t, values={**on.values, name: value + step})
    slopes = (
        _coefficients(on, model, there.displacements, base.t)
        - _coefficients(on, model, base.displacements, base.t)
    ) / step
    direction = Combination(name, model.terms, tuple(slopes.tolist()))
    deviation = None if tolerance is None else tolerance * abs(value)
    return ValueEffect(name, value, direction, deviation)


def _coefficients(on: OnSimulator, model: ReducedModel, x: Array, t: Array) -> Array:
    """Changes of all coefficients of the equation that a simulated motion shows."""
    record = Record.of(Decay(t, on.coordinate(x)), 1e-6)
    parts = [Part(Coefficient(term), (), np.zeros((1, 1))) for term in model.terms]
    solution = fit(model, parts, [record], iterations=30)
    return np.array([p.strengths[0, 0] for p in solution.parts])
