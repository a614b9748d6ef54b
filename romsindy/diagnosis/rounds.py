"""Rounds of a diagnosis on a structure that is simulated: a beam, or a user's own simulator.

Evidence is that of an equation of one coordinate. What the structure does beside its equation is
simulated with what was found, and taken off, until the findings stay: they are then fitted to the
structure itself (defect correction).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from joblib import Parallel, delayed

from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError, Hypothesis
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.search import Options
from romsindy.effects.base import Effect
from romsindy.fit.kernel.collocation import integrate
from romsindy.fit.kernel.equation import ExtendedEquation, equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.linear_response import sampled
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import SIGNALS, Decay
from romsindy.typing import Array

_ROUNDS = 5
_ELSEWHERE = 0.016  # of the noise: higher modes turn several times as far, so a tenth of the noise
_SETTLED = 3.0  # standard errors: the defect changes by less than a hundredth of such a change
# A cycle is left out that differs by so many times the median of so many later ones.
_RESTLESS, _NEXT = 1.3, 8


class Moved(NamedTuple):
    """A simulated motion over a record."""

    readings: Sequence[Array]  # displacements, velocities, accelerations, (n, n_sensors) each
    start: tuple[float, float]  # coordinate and its rate, as they were simulated
    release: Any  # what is known of the start from now on


class Corrected(NamedTuple):
    """A decay without the defect, what the sensors of the structure in it read, and its release."""

    decay: Decay
    readings: Array  # (n, n_sensors), in what was measured
    start: tuple[float, float]  # coordinate and its rate
    release: Any


class SimulatedStructure(Protocol):
    """What is simulated beside its equation of one coordinate."""

    @property
    def what(self) -> str:
        """What progress calls it."""

    @property
    def failures(self) -> tuple[type[Exception], ...]:
        """What is raised where it cannot be simulated."""

    @property
    def apart(self) -> bool:
        """Whether records may be simulated in processes of their own."""

    def coordinate(self, displacements: Array) -> Array:
        """The coordinate of its equation, (...,), from sensors (..., n_sensors)."""

    def with_effects(self, parts: Sequence[Part]) -> tuple[Part, ...]:
        """Parts that can be on it, and are there."""

    def start(
        self, model: ReducedModel, parts: Sequence[Part], record: Record
    ) -> tuple[float, float]:
        """Coordinate and its rate at the start of a record."""

    def moved(
        self,
        equation: ExtendedEquation,
        parts: Sequence[Part],
        record: Record,
        decay: Decay,
        start: tuple[float, float],
        release: Any,
    ) -> Moved:
        """Simulate it with some parts from a state of the coordinate, over a record.

        ``equation`` is that of the coordinate with the same parts, ``decay`` what all sensors
        measured in the record, ``release`` what was found before, or None.
        """


class Outcome(NamedTuple):
    """What was found, what is on the structure that was simulated, and this.

    Where the structure cannot be simulated with what was found, ``trouble`` says why.
    """

    report: DiagnosisReport
    parts: tuple[Part, ...]
    corrected: list[Corrected]
    trouble: str = ""


@dataclass(eq=False)
class Rounds:
    """A structure and its equation beside records."""

    structure: Any  # a `SimulatedStructure`
    look: Callable[..., DiagnosisReport]  # at decays of the coordinate: `diagnose_model`
    model: ReducedModel
    records: list[Record]  # of the coordinate
    raw: list[Decay]  # what the sensors measured in each, as fast as they did
    held_out: bool  # whether the last takes no part
    # What follows the data; what is looked for beside effects that it can have
    unsure: Sequence[Effect]
    general: Sequence[Effect]
    options: Options
    # How each record started; None is found
    releases: list[Any]
    form: FormError = NO_FORM_ERROR  # of the structure, as its reference records show it
    smooth: list[Record] = field(init=False)  # without what the higher modes add
    calm: list[float] = field(init=False)  # when fast modes have died, s

    def __post_init__(self) -> None:
        self.smooth = list(self.records)
        self.parallel = Parallel(self.options.n_jobs if self.structure.apart else 1)

    @property
    def n_training(self) -> int:
        """Number of records to learn from."""
        return len(self.records) - self.held_out

    def begin(self) -> list[Corrected]:
        """Simulate the structure as it is."""
        found = self.simulate(())
        if any(self._depends_on_start(*row) for row in zip(found, self.records, strict=True)):
            found = self.simulate(())  # from starts that are read without the ringing
        sensed = [self.structure.coordinate(c.readings) for c in found]
        self.calm = [calm_from(*pair) for pair in zip(self.records, sensed, strict=True)]
        return found

    def _depends_on_start(self, found: Corrected, record: Record) -> bool:
        """Whether what was taken off would be another from a start that is read without it.

        Both the structure and its equation start there: the defect follows the start in proportion.
        """
        smooth = Record.of(found.decay, self.options.floor)
        q, q_dot = np.subtract(self.structure.start(self.model, (), smooth), found.start)
        moved = np.hypot(q, q_dot / smooth.rate) / smooth.amplitude
        defect = np.std(record.signal - found.decay.signal)
        return bool(moved * defect > _ELSEWHERE * record.noise.std)

    def simulate(self, parts: Sequence[Part]) -> list[Corrected]:
        """Simulate the structure with what was found."""
        added = " + ".join(p.effect.name for p in parts) or "nothing more"
        self.options.progress(f"{self.structure.what} with {added}")
        rows = zip(self.records, self.raw, self.releases, self.smooth, strict=True)
        tasks = (delayed(corrected)(self.structure, self.model, parts, *row) for row in rows)
        found: list[Corrected] = list(self.parallel(tasks))
        self.releases = [c.release for c in found]
        self.smooth = [Record.of(c.decay, self.options.floor) for c in found]
        return found

    def run(
        self, effects: Sequence[Effect], before: list[Corrected], parts: tuple[Part, ...] = ()
    ) -> Outcome:
        """Simulate what was found, take the defect off and look again, until nothing changes.

        One effect that closes the gap counts more than several that fit a little better. ``parts``
        are on the structure that was simulated before.
        """
        most, found = 1, before
        for _ in range(_ROUNDS + 1):
            report = self._look(effects, found, most)
            if report.interrupted:
                return Outcome(report, (), before, "interrupted")
            if self._settled(parts, report):
                if report.verdict != "unknown" or most == self.options.max_effects:
                    break
                most = self.options.max_effects
                continue
            parts = self.next_parts(parts, self._simulated_of(report).parts)
            try:
                found = self.simulate(parts)
            except self.structure.failures as error:
                return Outcome(report, (), before, str(error))
        return Outcome(report, parts, found)

    def in_equation(self, parts: Sequence[Part]) -> Sequence[Part]:
        """What stands in the equation for parts that are on the structure."""
        return parts

    def next_parts(self, parts: Sequence[Part], found: Sequence[Part]) -> tuple[Part, ...]:
        """What is put on the structure next, where ``parts`` are and some were ``found``."""
        return self.structure.with_effects(found)

    def _look(
        self, effects: Sequence[Effect], found: Sequence[Corrected], most: int
    ) -> DiagnosisReport:
        decays = [c.decay.between(start) for c, start in zip(found, self.calm, strict=True)]
        test = decays[-1] if self.held_out else None
        chosen = replace(self.options, max_effects=most, catalogue=(*self.general, *effects))
        training = decays[: self.n_training]
        known = chosen, self.form, False
        return self.look(self.model, training, test, self.unsure, {}, *known)

    def _simulated_of(self, report: DiagnosisReport) -> Hypothesis:
        """The best, or the first that is as good and whose effects can all be simulated."""
        for rival in report.rivals:
            if len(self.structure.with_effects(rival.effects)) == len(rival.effects):
                return rival
        return report.best

    def _settled(self, parts: Sequence[Part], report: DiagnosisReport) -> bool:
        """Whether the effects that were simulated are those found, within some standard errors.

        Values that the simulation was unsure of count as well.
        """
        chosen = self._simulated_of(report)
        errors = np.sqrt(np.diag(chosen.covariance))
        rows = zip(chosen.parts, chosen.solution.slices(), strict=True)
        there = [(p, own) for p, own in rows if self.structure.with_effects([p])]
        after = {key_of(p): (p.values, errors[own]) for p, own in there}
        before = {key_of(p): p.values for p in self.in_equation(parts)}
        if set(before) != set(after):
            return False
        return all(np.all(np.abs(before[k] - x) <= _SETTLED * e) for k, (x, e) in after.items())


def corrected(
    structure: SimulatedStructure,
    model: ReducedModel,
    parts: Sequence[Part],
    record: Record,
    decay: Decay,
    release: Any,
    smooth: Record,
) -> Corrected:
    """Simulate a structure and its equation, both with the parts that it can have.

    Only the coordinate and its rate at the start are fitted: to the record of the coordinate, or to
    one that was corrected before, ``smooth``, from which higher modes are gone. The decay holds
    what all sensors measured, as fast as they did.
    """
    parts = structure.with_effects(parts)
    equation = equation_of(model, parts, 0, record)
    start = structure.start(model, parts, smooth)
    moved, start, release = structure.moved(equation, parts, record, decay, start, release)
    reduced = integrate(equation, np.array(start), record.motion.grid)
    signals: dict[str, Any] = {}
    for name, measured in record.decay.signals.items():
        order = SIGNALS.index(name)
        beside = structure.coordinate(moved[order]) - sampled(reduced, order)[:, 0]
        signals[name] = measured - beside
    own = replace(record.decay, **signals)
    return Corrected(own, moved[record.derivative], start, release)


def key_of(part: Part) -> tuple[str, str]:
    """What tells parts of a hypothesis apart."""
    return part.effect.name, part.effect.variant


def start_of(
    model: ReducedModel, parts: Sequence[Part], record: Record, *, fixed: bool = True
) -> tuple[float, float]:
    """Coordinate and its rate at the start of a record, which the equation follows.

    Unless they are ``fixed``, values of the parts follow the record as well.
    """
    solution = fit(model, parts, [record], fixed=fixed, iterations=25)
    q, q_dot = (solution.motions[0] if solution.finite else record.motion).start
    return float(q), float(q_dot)


def calm_from(record: Record, readings: Array) -> float:
    """Time from which on a simulated beam, seen in the coordinate, follows a record well.

    Modes that are too fast to be read from the sensors ring in the first cycles.
    """
    cycles = np.split(readings - record.signal, record.cycles)
    rms = np.array([np.std(x) for x in cycles[1:-1]])
    first = 0
    while first < len(rms) // 4 and rms[first] > _RESTLESS * np.median(rms[first + 1 :][:_NEXT]):
        first += 1
    return float(record.decay.t[record.cycles[first] if first else 0])
