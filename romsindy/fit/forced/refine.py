"""Fits of a given model to driven records, alone or together with decays.

Inputs keep the phase of a simulation, so that most records are fitted as a whole. Where the motion
is sensitive, a small error of the start grows, and the misfit has many minima; over few cycles it
has not: there they are fitted in pieces (`romsindy.fit.kernel.shooting`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, cast

import numpy as np

from romsindy.effects.base import Effect
from romsindy.effects.outside import Drive, Impulses
from romsindy.fit.adequacy.verdicts import ForcedAdequacy
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import linear_table
from romsindy.fit.kernel.part import Coefficient, Part
from romsindy.fit.kernel.prepared import CREEPS, Prepared, creeping
from romsindy.fit.records.arguments import (
    free_names,
    ready,
    ready_along,
    require_unit,
    small_frequencies,
)
from romsindy.fit.records.coupled import Offset, free_offsets, free_shapes
from romsindy.fit.records.driven import (
    drives_of,
    impulses_of,
    inputs_in,
    refuse_displacement,
    regressed,
)
from romsindy.fit.records.modes import Modes, modes_near
from romsindy.fit.records.smooth import Rivals, rated, ways
from romsindy.fit.results.fitted import Fit, examined, refined
from romsindy.physics.coupled import CoupledModel, linear_model
from romsindy.physics.equations import Equations, inputs_of, with_inputs, without_inputs
from romsindy.physics.input import Input, input_in
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import Interpolation
from romsindy.record.recording import Given
from romsindy.record.ringing import require_channels
from romsindy.typing import Array

_CYCLES, _AFTER_HIT = 20.0, 5.0  # in the shortest pieces; of free ones few tell as much
_MOST = 40  # pieces
# A whole record is fitted at another minimum where short pieces leave so much less of it; a little
# less they always leave where the form of the equation is not quite right.
_ASTRAY = 0.7
_CHANCE = 3.0  # standard deviations of what values too many take from the noise
# A motion is sensitive where what its start does to it, at the end, is this part of the beginning.
_SENSITIVE, _PARTS = 0.1, 10
_OF_RECORDS = (Coefficient, Offset, Impulses)  # parts that every fit to other records makes anew


def refined_forced(
    model: Equations,
    several: Sequence[ForcedVibration | Decay],
    fixed: Collection[str] = (),
    *,
    loss: str = "linear",
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """`romsindy.refine` where inputs drive the motion, in some records at least.

    A model without inputs is given those of the records. Where nothing says what they do between
    their samples, each way is tried.
    """
    require_unit(several, model.unit)
    own = {t.key: i for t in model.terms if (i := input_in(t)) is not None}
    free_model, known = without_inputs(model), sorted({*fixed} & {*own})
    if known:
        raise ValueError(
            f"fixed names {known}, and gains of inputs are always fitted: leave them out, and scale"
            " the mass instead"
        )
    names = free_names(free_model, fixed)
    look = Look.near(free_model, several)
    if own:
        return decided([look.fit(names, model, loss, progress)], look.records)
    fits: list[Fit] = []
    for way in ways(look.measured):
        inputs = inputs_in(look.measured, way)
        driven = with_inputs(free_model, inputs, look.gains(free_model.terms, inputs))
        fits.append(look.fit(names, driven, loss, progress))
    return decided(fits, look.records)


class Look(NamedTuple):
    """A first look at records, some of them driven.

    ``shapes`` are what channels show of several coordinates, as parts that are fitted, ``modes``
    the linear modes that the inputs move.
    """

    records: tuple[Prepared, ...]
    shapes: tuple[Part, ...] = ()
    modes: Modes | None = None

    @classmethod
    def of(cls, several: Sequence[ForcedVibration | Decay], modes: Modes | None) -> Look:
        """For one coordinate, or those of some modes."""
        if modes is None:
            return cls(ready(several))
        free = [v if v.driven else cast(Decay, v).free() for v in several]
        records = ready_along(free, modes)
        return cls(records, free_shapes(records), modes)

    @classmethod
    def near(cls, model: Equations, several: Sequence[ForcedVibration | Decay]) -> Look:
        """For a model without inputs, with frequencies near those of the records."""
        if not model.numbered:
            return cls.of(several, None)
        require_channels(several, several[0].n_channels)
        omega = 2 * np.pi * small_frequencies(model)
        modes = modes_near(Given.of(several).driven, omega, model.linear_damping_ratios)
        return cls.of(several, modes)

    @property
    def driven(self) -> list[Prepared]:
        """Those with inputs."""
        return [r for r in self.records if r.driven]

    @property
    def measured(self) -> list[ForcedVibration]:
        """What was measured of these."""
        return [r.decay for r in self.driven]

    def gains(self, terms: Sequence[Term], inputs: Sequence[Input]) -> list:
        """Of inputs beside some terms, from which a fit may start."""
        if self.modes is not None:
            return [self.modes.gains[term.source] for term in inputs]
        return regressed(terms, inputs, self.driven)[1].tolist()

    def model(
        self, terms: tuple[Term, ...], inputs: Sequence[Input], fixed: Mapping[str, float]
    ) -> Equations:
        """Terms and inputs with values from which a fit may start; ``fixed`` ones are known."""
        unit = self.records[0].decay.unit
        if self.modes is None:
            found, gains = regressed(terms, inputs, self.driven, fixed)
            model = ReducedModel(terms, tuple(found.tolist()), unit)
            return with_inputs(model, inputs, gains.tolist())
        linear = linear_model(self.modes.omega, self.modes.ratios, unit)
        values = linear.coefficients | dict(fixed)
        at = tuple(values.get(t.key, 0.0) for t in terms)
        return with_inputs(CoupledModel(terms, at, unit), inputs, self.gains(terms, inputs))

    def fit(
        self,
        names: tuple[str, ...],
        model: Equations,
        loss: str = "linear",
        progress: Callable[[str], None] | None = None,
    ) -> Fit:
        """Coefficients of these names, from a model with its inputs on."""
        acting = [(i, gain) for t, gain in model.pairs if (i := input_in(t)) is not None]
        refuse_displacement(*zip(*acting, strict=True))
        beside = (*drives_of(model, self.driven), *self.shapes)
        return Driven(names, self.records, loss, progress).fit(without_inputs(model), beside)


def decided(fits: Sequence[Fit], records: Sequence[Prepared]) -> Fit:
    """The best of fits that differ in what inputs do between their samples, with its verdict.

    Where the records cannot tell, the errors cover what the others say: the covariance of the
    average over all, by their likelihoods (J. Hoeting and others, Statistical Science 14, 1999).
    """
    if len(fits) == 1:
        return beside_the_whole(examined(fits[0]), records)
    names = [inputs_of(fit.model)[0].interpolation for fit in fits]
    left = [
        [e for r, x in zip(fit.records, fit.residuals, strict=True) for e in r.by_channel(x)]
        for fit in fits
    ]
    misses = dict(zip(names, left, strict=True))
    rivals, best = _examined(dict(zip(names, fits, strict=True)), misses)
    weights = np.array([rivals.weights.get(name, 0.0) for name in names])

    def spread(values: Sequence[Array]) -> Array:
        off = np.array(values) - values[names.index(rivals.best)]
        return (weights * off.T) @ off

    by_coefficient = spread([np.array([f.model.coefficients[n] for n in best.free]) for f in fits])
    # What is held acts half a sample late: where nobody knows whether it is, no delay is sharper.
    by_delay = spread([np.array([delay for delay, _ in f.delays.values()]) for f in fits])
    own = zip(best.solution.parts, best.solution.slices(), strict=True)
    at = [place.stop - 1 for part, place in own if isinstance(part.effect, Drive)]
    everything = best.solution.covariance.copy()
    everything[np.ix_(at, at)] += by_delay
    best = beside_the_whole(best, records)
    return replace(
        best,
        covariance=best.covariance + by_coefficient,
        solution=replace(best.solution, covariance=everything),
        notes=(str(rivals), *best.notes),
    )


def _examined(
    fits: Mapping[Interpolation, Fit], left: Mapping[Interpolation, Sequence[Array]]
) -> tuple[Rivals, Fit]:
    """The likeliest way that leaves noise, with its verdict; the likeliest of all where none does.

    A way that smooths the noise of the sensor of an input leaves less of it without being right.
    And what goes with the motion may stand for what the input does between its samples.
    """
    rivals, seen = rated(left), {}
    for way in rivals.tried:
        fit = seen[way] = examined(fits[way])
        if not (isinstance(fit.verdict, ForcedAdequacy) and fit.verdict.structured):
            sure = replace(rivals, best=way, weights={way: 1.0})
            return (rivals if way == rivals.best else sure), fit
    best = seen[rivals.best]
    return rated(left, best.verdict.structure), best


@dataclass(frozen=True)
class Driven:
    """What is fitted: coefficients with these names, inputs and sensors, to these records."""

    names: tuple[str, ...]
    records: Sequence[Prepared]
    loss: str = "linear"
    progress: Callable[[str], None] | None = None

    def fit(self, model: Equations, beside: Sequence[Part]) -> Fit:
        """From the values of a model on, and of the inputs and mode shapes beside it.

        Raises a TrajectoryError if no motion of the model follows even some cycles.
        """
        whole, failure = None, TrajectoryError("")
        try:
            whole = self._fit(model, beside, self.records)
        except TrajectoryError as error:
            failure = error
        # Else it may be at the wrong one of several minima.
        sure = whole is not None and whole.solution.converged and _felt(whole) <= _SENSITIVE
        if whole is not None and (whole.solution.interrupted or sure):
            return whole
        count = min(round(_turns(self.records) / (_AFTER_HIT if self._hit else _CYCLES)), _MOST)
        short = None
        if count > 1 and not model.memories:  # what is remembered goes from piece to piece
            with suppress(TrajectoryError):
                short = self._fit(model, beside, _cut(self.records, count))
        if short is None:
            if whole is None:
                raise failure
            return whole
        if whole is not None and not self._chaotic(whole) and _as_well(whole, short):
            return whole
        return self._longer(short, count)

    @property
    def _hit(self) -> bool:
        return any(force.spans for r in self.records for force in r.inputs.values())

    def _chaotic(self, fit: Fit) -> bool:
        """Whether small errors of a start grow. Between hits a phase goes astray, and no faster."""
        return not self._hit and _felt(fit) > 1

    def _longer(self, short: Fit, count: int) -> Fit:
        """In the longest pieces over which the model follows as well as over short ones."""
        best = short
        while count > 1:
            model, beside = without_inputs(best.model), _but(_OF_RECORDS, best)
            try:
                fit = self._fit(model, beside, _cut(self._seen(best), count // 2))
            except TrajectoryError:
                break
            # Where the motion is chaotic, longer pieces seem to say more than they do.
            if self._chaotic(fit) or not _by_chance(fit, short):
                break
            best, count = fit, count // 2
        return best

    def _fit(self, model: Equations, beside: Sequence[Part], records: Sequence[Prepared]) -> Fit:
        fit = self._once(model, beside, records)
        if not any(isinstance(p.effect, Impulses) for p in fit.solution.parts):
            return fit
        # Hits are off by parts of what they do with the gain that was found, not the first one.
        pairs = zip(records, fit.solution.motions, strict=True)
        near, more = [r.with_motion(m) for r, m in pairs], _but(_OF_RECORDS, fit)
        return replace(self._once(without_inputs(fit.model), more, near), records=tuple(records))

    def _once(self, model: Equations, beside: Sequence[Part], records: Sequence[Prepared]) -> Fit:
        offsets = [free_offsets(records, c) for c in range(records[0].n_channels)]
        offsets += impulses_of(beside, records)
        followed = partial(refined, free=self.names, loss=self.loss, progress=self.progress)
        if all(term.smooth for term in model.terms):
            return followed(model, records=records, more=(*beside, *offsets))
        # Across a jump steps lead astray, or go round for ever: first it is spread over a velocity.
        first, *sharper = CREEPS
        fit = followed(model, records=creeping(records, first), more=(*beside, *offsets))
        for part in sharper:
            pairs = zip(records, fit.solution.motions, strict=True)
            at = creeping([record.with_motion(motion) for record, motion in pairs], part)
            more = _but(Coefficient, fit)
            try:
                near = followed(without_inputs(fit.model), records=at, more=more)
            except TrajectoryError:
                break
            if not near.solution.converged:
                break
            fit = near
        return fit

    def _seen(self, fit: Fit) -> list[Prepared]:
        """The records with the motions of a fit to pieces of them behind them."""
        left, seen = list(fit.solution.motions), []
        for record in self.records:
            steps, own = 0, []
            while steps < record.motion.grid.n_steps:
                own.append(left.pop(0))
                steps += own[-1].grid.n_steps
            seen.append(record.with_motion(Trajectory.joined(record.motion.grid, own)))
        return seen


def _but(kinds: type[Effect] | tuple[type[Effect], ...], fit: Fit) -> tuple[Part, ...]:
    """Parts of a fit but for those of some kinds of effect."""
    return tuple(p for p in fit.solution.parts if not isinstance(p.effect, kinds))


def _cut(records: Sequence[Prepared], count: int) -> list[Prepared]:
    """Driven records in so many pieces; decays are whole."""
    cut = (r.pieces(count) if r.driven and count > 1 else [r] for r in records)
    return [piece for several in cut for piece in several]


def beside_the_whole(fit: Fit, records: Sequence[Prepared]) -> Fit:
    """The same with what one simulation of each record leaves, where it was followed in pieces."""
    verdict, more = fit.verdict, len(fit.records) - len(records)
    if not (isinstance(verdict, ForcedAdequacy) and more):
        return fit
    count = 1 + more // sum(r.driven for r in records)
    cycles = _turns(records) / count
    note = (
        f"the model follows the motion over pieces of {cycles:.0f} cycles, each with an initial"
        " state of its own; in longer ones small errors grow, as they do in chaos or where the"
        " equation is of another form"
    )
    verdict = replace(verdict, piece=cycles, whole=_left_by_one(fit, records, count))
    return replace(fit, verdict=verdict, notes=(*fit.notes, note))


def _turns(records: Sequence[Prepared]) -> float:
    """Cycles in the longest of the driven records."""
    return max(r.turns for r in records if r.driven)


def _left_by_one(fit: Fit, records: Sequence[Prepared], count: int) -> float:
    """What one simulation of each driven record leaves, as a part of the response; nan without."""
    left, heard, number = 0.0, 0.0, 0
    for record in records:
        if not record.driven:
            number += 1
            continue
        equation = equation_of(fit.start, fit.solution.parts, number, record)
        start = fit.solution.motions[number].start  # of its first piece
        try:
            motion = integrate(equation, start, record.motion.grid, record.motion)
        except TrajectoryError:
            return np.nan
        missed = record.missed(fit.solution.parts, number, partial(motion.samples, equation))
        left += float(missed @ missed)
        heard += record.power
        number += count
    return float(np.sqrt(left / heard))


def _felt(fit: Fit) -> float:
    """How much of what the start of a record does to its beginning is felt at its end."""
    felt, s = 0.0, fit.solution
    for i, (record, motion) in enumerate(zip(fit.records, s.motions, strict=True)):
        if record.driven:
            rows = linear_table(fit.start, s.parts, i, record, motion)[1]
            by_start = rows[:, -1 - len(motion.start) : -1] ** 2
            rms = np.sqrt(np.mean(record.by_channel(by_start), axis=(0, 2)))
            first, *_, last = np.array_split(rms, _PARTS)
            felt = max(felt, float(last.max() / first.max()))
    return felt


def _as_well(whole: Fit, short: Fit) -> bool:
    """Whether a fit of whole records is at the right minimum, by what short pieces leave.

    A step across a jump, such as friction's, keeps a fit from settling also where nothing is left
    to gain; a fit that has settled may leave a little more, where the form is not quite right.
    """
    settled = whole.solution.converged and _power(short) > _ASTRAY * _power(whole)
    return settled or _by_chance(whole, short)


def _by_chance(longer: Fit, short: Fit) -> bool:
    """Whether long pieces leave no more than short ones, which take more values from the noise."""
    more = short.solution.n_values - longer.solution.n_values
    chance = _CHANCE * np.sqrt(2 * more) / sum(map(len, longer.residuals))
    return _power(longer) <= (1 + chance) * _power(short)


def _power(fit: Fit) -> float:
    """Of what is left of the forced records, for each value that could have been noise."""
    pairs = zip(fit.records, fit.residuals, strict=True)
    left = [e for r, e in pairs if r.driven]
    return sum(float(e @ e) for e in left) / (sum(map(len, left)) - fit.solution.n_values)
