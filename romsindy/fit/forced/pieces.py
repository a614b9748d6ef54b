"""Fits of forced vibrations as a whole and, where that goes astray, in pieces: multiple shooting.

Inputs keep the phase of a simulation, so that most records are fitted as a whole. Where the motion
is sensitive, a small error of the start grows, and the misfit has many minima; over few cycles it
has not (`romsindy.fit.pieces`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from romsindy.fit.coefficient import Coefficient
from romsindy.fit.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.equation import equation_of
from romsindy.fit.fitted import Fit, refined
from romsindy.fit.forced.adequacy import ForcedAdequacy
from romsindy.fit.gauss_newton import linear_table
from romsindy.fit.measured import free_offsets
from romsindy.fit.mode_shape import Offset
from romsindy.fit.part import Part, in_orders
from romsindy.fit.record import Prepared
from romsindy.physics.coupled import AnyModel
from romsindy.physics.equations import without_inputs

_CYCLES = 20.0  # in the shortest pieces
_MOST = 40  # pieces
# A whole record is fitted at another minimum where short pieces leave so much less of it; a little
# less they always leave where the form of the equation is not quite right.
_ASTRAY = 0.7
_CHANCE = 3.0  # standard deviations of what values too many take from the noise
# A motion is sensitive where what its start does to it, at the end, is this part of the beginning.
_SENSITIVE, _PARTS = 0.1, 10


@dataclass(frozen=True)
class Driven:
    """What is fitted: coefficients with these names, inputs and sensors, to these records."""

    names: tuple[str, ...]
    records: Sequence[Prepared]
    loss: str = "linear"
    progress: Callable[[str], None] | None = None

    def fit(self, model: AnyModel, beside: Sequence[Part]) -> Fit:
        """From the values of a model on, and of the inputs and mode shapes beside it.

        Raises
        ------
        TrajectoryError
            If no motion of the model follows even some cycles.
        """
        whole, failure = None, TrajectoryError("")
        try:
            whole = self._fit(model, beside, self.records)
        except TrajectoryError as error:
            failure = error
        if whole is not None and (whole.solution.interrupted or not _astray(whole)):
            return whole
        count = min(round(_turns(self.records) / _CYCLES), _MOST)
        if count < 2 or model.memories:  # what is remembered goes from piece to piece
            return _or_raised(whole, failure)
        try:
            short = self._fit(model, beside, _cut(self.records, count))
        except TrajectoryError:
            return _or_raised(whole, failure)
        stays = whole is not None and whole.solution.converged and _felt(whole) <= 1
        if whole is not None and stays and _power(short) > _ASTRAY * _power(whole):
            return whole
        return self._longer(short, count)

    def _longer(self, short: Fit, count: int) -> Fit:
        """In the longest pieces over which the model follows as well as over short ones."""
        best = short
        while count > 1:
            model = without_inputs(best.model)
            others = (Coefficient, Offset)
            beside = [p for p in best.solution.parts if not isinstance(p.effect, others)]
            try:
                fit = self._fit(model, beside, _cut(self._seen(best), count // 2))
            except TrajectoryError:
                break
            more = short.solution.n_values - fit.solution.n_values
            chance = _CHANCE * np.sqrt(2 * more) / sum(map(len, fit.residuals))
            # Where the motion is chaotic, longer pieces seem to say more than they do.
            if not fit.solution.converged or _felt(fit) > 1:
                break
            if _power(fit) > (1 + chance) * _power(short):
                break
            best, count = fit, count // 2
        return best

    def _fit(self, model: AnyModel, beside: Sequence[Part], records: Sequence[Prepared]) -> Fit:
        offsets = (free_offsets(records, c) for c in range(records[0].n_channels))
        more = (*beside, *offsets)
        return refined(model, self.names, records, more, loss=self.loss, progress=self.progress)

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
        parts = fit.solution.parts
        x = in_orders(record.orders(parts), partial(motion.samples, equation))
        missed = record.signal - record.read(parts, number, x).shown
        left += float(missed @ missed)
        heard += record.power
        number += count
    return float(np.sqrt(left / heard))


def _astray(fit: Fit) -> bool:
    """Whether a fit of whole records may be at the wrong one of several minima."""
    return not fit.solution.converged or _felt(fit) > _SENSITIVE


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


def _power(fit: Fit) -> float:
    """Of what is left of the forced records, for each value that could have been noise."""
    pairs = zip(fit.records, fit.residuals, strict=True)
    left = [e for r, e in pairs if r.driven]
    return sum(float(e @ e) for e in left) / (sum(map(len, left)) - fit.solution.n_values)


def _or_raised(fit: Fit | None, failure: TrajectoryError) -> Fit:
    if fit is None:
        raise failure
    return fit
