"""The gap between simulation and measurement, before and after, if it can on what took no part."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from romsindy.diagnosis.difference import Difference, Tolerance
from romsindy.diagnosis.evidence import Hypothesis, offsets
from romsindy.effects import Bias
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import fit, linear_table
from romsindy.fit.kernel.part import Part, read
from romsindy.fit.kernel.prepared import Prepared, part_of
from romsindy.fit.kernel.shooting import shoot
from romsindy.fit.records.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay, Stage
from romsindy.text import Shown, left_over
from romsindy.typing import Array

HELD_OUT, UNSEEN = "the held-out record", "the record that took no part"


def name_of(record: int) -> str:
    """What a measured record is called: they are counted from 1."""
    return f"record {record + 1}"


@dataclass(frozen=True)
class Prediction:
    """A held-out record beside the simulation before and after, (n,) signals."""

    record: Record
    before: Array
    after: Array
    name: str = name_of(0)

    @property
    def title(self) -> str:
        """Name of the record, or of its stretches that were held out."""
        return self.name if self.record.part is None else f"{self.name}, held out"

    def difference(self, simulated: Array) -> Difference:
        """What a simulation differs by, (n,)."""
        # Where the sensor drifts, weights tell the zero badly that the simulation was fitted with.
        zero = np.mean(self.record.signal - simulated)
        return replace(Difference.of(self.record, simulated + zero), name=self.name)

    def error(self, simulated: Array) -> float:
        """Rms of the misfit over the noise; 1 is perfect."""
        misfit = self.record.whitened(self.record.signal - simulated)
        return float(np.sqrt(np.sum(misfit**2) / self.record.count))

    @property
    def change(self) -> Difference:
        """How the simulation before differs from that after, in the place of the record."""
        after = replace(self.record, signal=self.after, part=None)
        return replace(Difference.of(after, self.before, exact=True), name=self.name)

    def misfit(self, simulated: Array) -> Array:
        """Measured minus simulated, (n,); nan where a sample takes no part."""
        part = self.record.part
        misfit = self.record.signal - simulated
        return misfit if part is None else np.where(part, misfit, np.nan)

    def of_response(self, simulated: Array) -> float:
        """Rms of the misfit over that of the response."""
        misfit = self.misfit(simulated)
        response = float(np.std(self.record.signal[~np.isnan(misfit)]))
        return float(np.sqrt(np.nanmean(misfit**2))) / response

    def left(self, simulated: Array) -> str:
        """Both in words."""
        return left_over(self.of_response(simulated), self.error(simulated))

    def backbone(self, signal: Array) -> Backbone | None:
        """Backbone of a signal (n,); None where it dies out at once, so that it has no cycles."""
        # What was measured is free as it is; a simulation may die on the way.
        stage: Stage = "free" if signal is self.record.signal else "raw"
        unit = self.record.decay.unit
        try:
            return extract_backbone(Decay(self.record.t, signal, unit=unit, stage=stage))
        except ValueError:
            return None


class LoudAndQuiet(NamedTuple):
    """Rms of what is left over the noise, in cycles above and below half of the largest amplitude.

    ``half`` is that amplitude.
    """

    loud: float
    quiet: float
    half: float


@dataclass(frozen=True, repr=False)
class Gap:
    """Before and after, on what took no part in the fit."""

    predictions: tuple[Prediction, ...]
    unseen: bool  # False where records were too short to hold any part out
    sensor: Shown | None = None  # that tells amplitudes, if the coordinate itself does not

    @property
    def shown(self) -> Shown:
        """How amplitudes are told."""
        return self.sensor or Shown(self.predictions[0].record.decay.unit or "[q]")

    @property
    def where(self) -> str:
        """What it was measured on, in words."""
        if not self.unseen:
            return "the records themselves (nothing that took no part can tell)"
        whole = {p.record.part is None for p in self.predictions}
        what = " and ".join(["the stretches"] * (False in whole) + ["the record"] * (True in whole))
        return f"{what} that took no part"

    @property
    def worst(self) -> int:
        """Number of the record with the largest error afterwards."""
        return int(np.argmax([p.error(p.after) for p in self.predictions]))

    @property
    def loud_and_quiet(self) -> LoudAndQuiet | None:
        """What is left by amplitude, where that is most; None where all cycles are alike."""
        p = self.predictions[self.worst]
        cycles = p.backbone(p.record.signal)
        if cycles is None:
            return None
        top = int(np.argmax(cycles.amplitude))
        half = float(cycles.amplitude[top]) / 2
        loud = np.interp(p.record.t, cycles.t, cycles.amplitude) > half
        misfit = p.misfit(p.after) / p.record.noise.std
        left = [x[~np.isnan(x)] for x in (misfit[loud], misfit[~loud])]
        if min(map(len, left)) == 0:
            return None
        above, below = (float(np.sqrt(np.mean(x**2))) for x in left)
        # As an amplitude of q, whatever was measured of it.
        rate = float(cycles.frequency[top]) ** p.record.decay.derivative
        return LoudAndQuiet(above, below, half / rate)

    @property
    def before(self) -> float:
        """Displacement error over noise of the simulation as it was."""
        return max(p.error(p.before) for p in self.predictions)

    @property
    def after(self) -> float:
        """Displacement error over noise with the effects added."""
        return max(p.error(p.after) for p in self.predictions)

    @property
    def closed(self) -> float:
        """Part of the squared error beyond the noise that is closed, 0 to 1."""
        n = sum(p.record.count for p in self.predictions)

        def squared(signals: list[Array]) -> float:
            pairs = zip(self.predictions, signals, strict=True)
            return sum(p.record.count * p.error(x) ** 2 for p, x in pairs) / n

        before = squared([p.before for p in self.predictions])
        return _closed(before, squared([p.after for p in self.predictions]), 1.0)

    @cached_property
    def differences_before(self) -> tuple[Difference, ...]:
        """Of the simulation as it was, one a record."""
        return tuple(p.difference(p.before) for p in self.predictions)

    @cached_property
    def differences_after(self) -> tuple[Difference, ...]:
        """With the effects added, one a record."""
        return tuple(p.difference(p.after) for p in self.predictions)

    def unchanged(self) -> Gap:
        """The same with nothing added."""
        unchanged = tuple(replace(p, after=p.before) for p in self.predictions)
        return replace(self, predictions=unchanged)

    @cached_property
    def changes(self) -> tuple[Difference, ...]:
        """What the effects change: from before to after, one a record. Neither has noise."""
        return tuple(p.change for p in self.predictions)

    def changes_from(self, other: Gap) -> tuple[Difference, ...]:
        """The same, from what another one says afterwards."""
        pairs = zip(self.predictions, other.predictions, strict=True)
        return tuple(replace(p, before=q.after).change for p, q in pairs)

    def within(self, tolerance: Tolerance) -> bool:
        """Whether the simulation as it was is within a tolerance, and no part surely beyond."""
        return within(self.differences_before, tolerance)

    def leaves_within(self, tolerance: Tolerance) -> bool:
        """The same with the effects added."""
        return within(self.differences_after, tolerance)

    def __repr__(self) -> str:
        where = "held out" if self.unseen else "fitted"
        return f"<Gap: error over noise {self.before:.3g} to {self.after:.3g}, {where}>"

    def table(self) -> list[list[str]]:
        """Rows of text: what, before, after."""
        rows = [[f"on {self.where}" if self.unseen else "fitted", "before", "after"]]
        both = (self.differences_before, self.differences_after)
        for p, *differences in zip(self.predictions, *both, strict=True):
            name = f"{p.title}: " if len(self.predictions) > 1 else ""
            errors = [f"{p.error(x):.3g}" for x in (p.before, p.after)]
            rows.append([f"{name}error over noise", *errors])
            shown = self.shown
            sizes = (_amplitudes(d, shown) for d in differences)
            rows.append([f"{name}amplitudes compared, {shown.unit}{shown.at}", *sizes])
            for kind, title in _ROWS.items():
                rows.append([f"{name}{title}", *(_percent(d, kind) for d in differences)])
        return rows


def within(differences: Sequence[Difference], tolerance: Tolerance) -> bool:
    """Whether all differences are within a tolerance, and no part is surely beyond."""
    return all(d.within(tolerance) and not d.exceeds(tolerance) for d in differences)


_ROWS = {
    "frequency": "frequency, % off",
    "damping": "damping ratio, % off",
    "signal": "waveform, % of amplitude",
}


def _amplitudes(difference: Difference, shown: Shown) -> str:
    if difference.apart:
        return "hardly any in common"
    return shown._replace(unit="", sensor="").told(*difference.amplitude).rstrip()


def _percent(difference: Difference, kind: str) -> str:
    if difference.apart and kind != "signal":
        return "-"
    value, error = (100 * getattr(difference, k) for k in (kind, f"{kind}_std"))
    what = " (all that differs)" if difference.apart else ""
    return f"{value:.3g} +- {error:.1g}{what}"


# -- what a simulation says of a record; only its start follows it ---------------------------------

_ITERATIONS = 25
_POLISH = 12  # simulations to find the initial state of a record whose fit does not settle
_FAR = 1e6  # amplitudes, beyond which it does not matter how far a motion has run away
# A motion that leaves this part of the signal's square has lost the phase: its misfit has as many
# minima as there are cycles, and no initial state is the best.
_LOST = 0.5


def predict(
    model: ReducedModel, parts: Sequence[Part], record: Record, name: str = name_of(0)
) -> Prediction:
    """What the simulation before and after says about a record; only its start follows it."""
    before = _followed(model, (), record, None)
    return follow(Prediction(record, before, before, name), model, parts, {})


def follow(
    before: Prediction, model: ReducedModel, parts: Sequence[Part], near: Mapping[str, Trajectory]
) -> Prediction:
    """The same with what the simulation says with some parts.

    Its motion is ``near`` one that is known, if any: that of other samples of the record.
    """
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


def foretold(model: ReducedModel, hypothesis: Hypothesis, tests: Mapping[str, Record]) -> float:
    """Minus twice the log likelihood of records by what fits to others say, but for a constant.

    Chi-square where values may be off as far as their errors let them, and what these leave open:
    log det(1 + S G), with S their covariance and G what the records say of them. Where a motion is
    lost the values stand as they are. A value that a record has for itself, as the sizes of a hum,
    takes one of chi-square by chance.
    """
    near, n = motions_of(hypothesis), len(hypothesis.covariance)
    products, own = np.zeros((n + 1, n + 1)), 0
    parts = [p for p in hypothesis.parts if not isinstance(p.effect, Bias)]  # all have a zero
    for part, record in itertools.product(parts, tests.values()):
        strengths = part.elsewhere(record.t).strengths.size
        own += strengths - int(np.sum(part.shared[:strengths]))
    for name, record in tests.items():
        rows = _rows_of(model, hypothesis.parts, record, near.get(name))
        if rows is None:
            return float(np.sum(misfit_of(model, hypothesis, tests) ** 2)) + own
        products += rows.T @ rows
    sizes, axes = np.linalg.eigh(hypothesis.covariance)
    root = axes * np.sqrt(np.maximum(sizes, 0.0))
    whole, pull = np.eye(n) + root.T @ products[:n, :n] @ root, root.T @ products[:n, n]
    least = products[n, n] - pull @ np.linalg.solve(whole, pull)
    return float(least + np.linalg.slogdet(whole)[1]) + own


def _rows_of(
    model: ReducedModel, parts: Sequence[Part], record: Record, near: Trajectory | None
) -> Array | None:
    """Derivatives of a record by all values, then its misfit, (n, m + 1): what its own fit leaves.

    Its start, its zero and what is its own of the parts are fitted. None where a motion is lost.
    """
    same = [p.elsewhere(record.t) for p in parts]
    start = None if near is None else [near]
    with np.errstate(all="ignore"):
        given = (model, _with_zero(same, record), [record], start)
        found = fit(*given, fixed=True, iterations=_ITERATIONS)
        table = linear_table(model, found.parts, 0, record, found.motions[0])[1]
    if not (found.converged and np.all(np.isfinite(table))):
        return None
    rows, at, first = np.zeros((len(table), sum(p.size for p in parts) + 1)), 0, 0
    rows[:, -1], own = table[:, -1], np.ones(table.shape[1] - 1, bool)
    for part, there in zip(parts, same, strict=True):
        n, k = part.strengths.size, there.strengths.size
        strengths = np.flatnonzero(part.shared[:k])
        columns = np.concatenate([strengths, k + np.arange(part.shape.size)])
        places = np.concatenate([strengths, n + np.arange(part.shape.size)])
        rows[:, first + places], own[at + columns] = table[:, at + columns], False
        first, at = first + part.size, at + there.size
    fitted = table[:, :-1][:, own]
    basis = np.linalg.svd(fitted / np.maximum(np.linalg.norm(fitted, axis=0), 1e-300), False)[0]
    return np.asarray(rows - basis @ (basis.T @ rows))


def _with_zero(parts: Sequence[Part], record: Record) -> list[Part]:
    """The zero of the sensor is as free as the start."""
    if any(isinstance(p.effect, Bias) for p in parts):
        return [*parts]
    return [*parts, offsets([record])]


def motions_of(hypothesis: Hypothesis) -> dict[str, Trajectory]:
    """Fitted motions by the names of their records."""
    return {name_of(i): m for i, m in enumerate(hypothesis.solution.motions)}


def _followed(
    model: ReducedModel, parts: Sequence[Part], record: Record, near: Trajectory | None
) -> Array:
    same = _with_zero([p.elsewhere(record.t) for p in parts], record)
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
    equation = equation_of(model, parts, 0, record)
    try:
        motion = integrate(equation, near.start, grid, near)
    except TrajectoryError as error:
        if error.motion is None:
            return np.zeros_like(record.signal)
        motion = error.motion
    x = equation.sampled(motion, record.derivative)
    # A motion that cannot be followed further stays where it is.
    held = x[-1:] if record.derivative == 0 else np.zeros((1, 1))
    x = np.concatenate([x, np.repeat(held, len(record.t) - len(x), axis=0)])
    return read(parts, 0, record.t, x)[0]


# -- the gap by what is left -----------------------------------------------------------------------


def noise_std(record: Prepared) -> float:
    """Rms of the noise of a record, over all its channels, unit of the measured quantity."""
    return float(np.sqrt(np.mean([noise.std**2 for noise in record.noises])))


@dataclass(frozen=True)
class ResidualGap:
    """What a simulation leaves of the records, without and with what was found."""

    records: tuple[Prepared, ...]  # on which it was measured
    # Measured minus simulated, (n,) of each record
    residuals_before: tuple[Array, ...]
    residuals_after: tuple[Array, ...]
    # Of all records, unit of the measured quantity
    rms_before: float
    rms_after: float
    # The same as a part of the rms of the response
    before: float
    after: float
    closed: float  # part of the squared gap beyond the noise that is closed, 0 to 1
    unit: str  # of the rms
    where: str = "the records themselves"  # what it was measured on, in words

    @classmethod
    def of(
        cls,
        records: Sequence[Prepared],
        before: Sequence[Array],
        after: Sequence[Array],
        where: str = "the records themselves",
    ) -> ResidualGap:
        """Compare residuals of records, which are called ``where``."""
        n = sum(len(r.signal) for r in records)
        noise = sum(len(r.signal) * noise_std(r) ** 2 for r in records) / n
        old, new = (sum(float(e @ e) for e in several) / n for several in (before, after))
        return cls(
            tuple(records),
            tuple(before),
            tuple(after),
            rms_before=old**0.5,
            rms_after=new**0.5,
            before=part_of(records, before),
            after=part_of(records, after),
            closed=_closed(old, new, noise),
            unit=records[0].decay.signal_unit,
            where=where,
        )

    def table(self) -> list[list[str]]:
        """Rows of text: what, before, after."""
        pairs = {
            f"rms left, {self.unit}": (self.rms_before, self.rms_after),
            "rms left, % of the response": (100 * self.before, 100 * self.after),
        }
        rows = [[name, *(f"{x:.3g}" for x in pair)] for name, pair in pairs.items()]
        return [[f"on {UNSEEN}" if self.where == UNSEEN else "fitted", "before", "after"], *rows]


def _closed(before: float, after: float, noise: float) -> float:
    """Part of a mean square beyond the noise that is closed, 0 to 1."""
    if not np.isfinite(before):
        return 1.0 if np.isfinite(after) else 0.0
    beyond = before - min(after, noise)  # the noise is no larger than what is left
    return float(np.clip((before - after) / beyond, 0.0, 1.0)) if beyond > 0 else 0.0


def beyond_noise(records: Sequence[Prepared], residuals: Sequence[Array]) -> float:
    """The most that is left of a record: rms without noise, over its largest value."""
    sizes = []
    for record, e in zip(records, residuals, strict=True):
        peak = float(np.abs(record.signal - record.signal.mean()).max())
        sizes.append(max(float(np.mean(e**2)) - noise_std(record) ** 2, 0.0) ** 0.5 / peak)
    return max(sizes)
