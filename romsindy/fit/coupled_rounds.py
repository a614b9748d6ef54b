"""Choose terms of several coordinates and fit them, round after round, until the choice stays.

The first rounds look at short pieces of the records, each with an initial state of its own: over
few cycles no phase is lost, whatever is still missing from the model. Pieces become longer, until
the records are whole (multiple shooting: H. G. Bock, "Recent Advances in Parameter Identification
Techniques for O.D.E.", 1983).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from romsindy.fit.adequacy import examine
from romsindy.fit.coefficient import extended, free_coefficients
from romsindy.fit.collocation import Trajectory, TrajectoryError
from romsindy.fit.coupled_record import CoupledRecord
from romsindy.fit.coupled_terms import Gram, Kind, candidates, chosen, needed
from romsindy.fit.gauss_newton import fit, linear_table
from romsindy.fit.part import Part
from romsindy.fit.shooting import simulated
from romsindy.fit.verdict import EXPLAINED, TERM
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import Along, SlavedInertia
from romsindy.physics.inertia import AddedMass
from romsindy.physics.term import Term
from romsindy.typing import Array, Indices

# Choices and fits with pieces of one length.
_ROUNDS = 6
# What is left may grow so much as pieces do, of a model that is not lost.
_LOST = 3.0
# Cycles of the slowest coordinate in the first pieces, and by how much they grow.
_CYCLES, _GROWTH = 10.0, 2
# Parts of the data that are left out in turn. With fewer records than the first, stretches of them
# are: so many, dealt out in turn, so that each part spans the amplitudes.
_FEWEST_RECORDS, _PARTS, _STRETCHES = 4, 4, 24


@dataclass(frozen=True)
class Stage:
    """What has been found so far: the model, its mode shapes at the channels, its motions."""

    model: CoupledModel
    shapes: tuple[Part, ...]
    motions: tuple[Trajectory, ...]


@dataclass(frozen=True)
class Fitted:
    """A stage fitted to pieces of the records.

    Attributes
    ----------
    stage : Stage
    records : tuple of CoupledRecord
        Whole, with their noise.
    cycles : float
        Length of the pieces, in cycles of the slowest coordinate; infinite for whole records.
    residuals : tuple of (c n,) arrays
        What it leaves of every record.
    n_values : int
        Fitted values, initial states of all pieces included.
    """

    stage: Stage
    records: tuple[CoupledRecord, ...]
    cycles: float
    residuals: tuple[Array, ...]
    n_values: int

    @property
    def left(self) -> float:
        """Rms of what it leaves of the records, over their noise."""
        return self.left_over(self.records)

    @cached_property
    def explained(self) -> bool:
        """Whether it leaves noise alone, of whole records."""
        whole = np.isinf(self.cycles)
        return whole and examine(self.records, self.residuals, self.n_values).explained

    def left_over(self, records: Sequence[CoupledRecord]) -> float:
        """The same over the noise of other records."""
        return float(np.sqrt(np.mean(self._squares(records))))

    def is_better(self, before: Fitted, records: Sequence[CoupledRecord]) -> bool:
        """Whether its terms are worth more than those of another, by the noise of some records."""
        now, then = self._squares(records), before._squares(records)
        more = len(self.stage.model.terms) - len(before.stage.model.terms)
        least = min(now.sum(), then.sum())
        return bool(then.sum() - now.sum() > more * needed(then.size, least, 1))

    def is_alike(self, before: Fitted, records: Sequence[CoupledRecord]) -> bool:
        """Whether it leaves about as much as another, which a round more would do, too."""
        return bool(self._squares(records).sum() > (1 - TERM) * before._squares(records).sum())

    def heard_again(self) -> Fitted:
        """With the noise of the records as it is in what the fit leaves."""
        pairs = zip(self.records, self.residuals, strict=True)
        return replace(self, records=tuple(r.heard_again(e) for r, e in pairs))

    def weighed_alike(self) -> tuple[CoupledRecord, ...]:
        """Records with the noise that they have, or with what is left of them where that is more.

        Where the form of the model decides, no record may decide alone because its noise is least.
        """
        left = [
            float(np.sqrt(np.mean(record.whitened(e) ** 2)))
            for record, e in zip(self.records, self.residuals, strict=True)
        ]
        pairs = zip(self.records, left, strict=True)
        return tuple(record.louder(max(x, 1.0)) for record, x in pairs)

    def _squares(self, records: Sequence[CoupledRecord]) -> Array:
        pairs = zip(records, self.residuals, strict=True)
        return np.concatenate([record.whitened(residual) ** 2 for record, residual in pairs])


class _Choice(NamedTuple):
    """Terms that always take part, and those that may."""

    always: tuple[Term, ...]
    candidates: tuple[Term, ...]

    @property
    def terms(self) -> tuple[Term, ...]:
        return (*self.always, *(t for t in self.candidates if t not in self.always))


class _Piece(NamedTuple):
    """A piece of a record, the number of that, and the part of the data of its samples, (n,)."""

    record: CoupledRecord
    number: int
    part: Indices


def with_terms(
    start: Stage, given: Sequence[CoupledRecord], kind: Kind, say: Callable[[str], None]
) -> Fitted | None:
    """The start with the terms that the records need, fitted to the longest pieces it follows.

    None if it follows the motion over no piece. Masses come last: they show where what couples is
    known well, not beside everything else.
    """
    always, r = start.model.terms, start.model.n_coordinates
    best = _settled(start, given, _Choice(always, candidates(r, kind)), say, _CYCLES)
    if best is None:
        return None
    best = _grown(best, _Choice(always, candidates(r, kind)), say)
    more = _Choice(always, candidates(r, kind._replace(masses=True)))
    return _settled(best.stage, best.records, more, say, best.cycles, best) or best


def _grown(best: Fitted, choice: _Choice, say: Callable[[str], None]) -> Fitted:
    """Fitted to the longest pieces over which the model follows the motion."""
    # What is explained over few cycles may be so over all; else pieces grow by and by.
    if best.left <= EXPLAINED and (longer := _longer(best, np.inf)):
        return _settled(longer.stage, longer.records, choice, say, np.inf, longer) or longer
    for cycles in _lengths(best.records):
        longer = _longer(best, cycles)
        if longer is None:
            break
        best = _settled(longer.stage, longer.records, choice, say, cycles, longer) or longer
    return best


def _longer(now: Fitted, cycles: float) -> Fitted | None:
    """Fitted to longer pieces; None where the model loses the motion.

    What a wrong model misses grows with the length of the pieces; by much more, and it is lost.
    """
    found = fitted(now.stage, now.records, cycles)
    if found is None or found.left > _LOST * max(now.left, 1.0):
        return None
    return found


def _settled(
    now: Stage,
    records: Sequence[CoupledRecord],
    choice: _Choice,
    say: Callable[[str], None],
    cycles: float,
    best: Fitted | None = None,
) -> Fitted | None:
    """Rounds with pieces of one length, until the choice of terms stays; the best fit."""
    given, weighed = tuple(records), best.weighed_alike() if best else tuple(records)
    for _ in range(_ROUNDS):
        start = _chosen(now, cut(now, weighed, cycles), choice)
        if start is None or (best and {*start.model.terms} == {*best.stage.model.terms}):
            break
        more = start.model.terms[len(choice.always) :]
        say(f"terms: {', '.join(t.key for t in more) or 'no more than at the start'}")
        found = fitted(start, weighed, cycles)
        if found is None or (best and not found.is_better(best, weighed)):
            break
        settled = best is not None and found.is_alike(best, weighed)
        now, best = found.stage, replace(found, records=given).heard_again()
        settled = settled and all(a is b for a, b in zip(best.records, given, strict=True))
        given = best.records
        weighed = best.weighed_alike()
        if settled:
            break
    return best


def fitted(start: Stage, records: Sequence[CoupledRecord], cycles: float) -> Fitted | None:
    """The model fitted to pieces so many cycles long; None if it has no motion, or no masses."""
    names = list(start.model.coefficients)
    parts = (*free_coefficients(start.model, names), *start.shapes)
    pieces = cut(start, records, cycles)
    several = [piece.record for piece in pieces]
    solution = fit(start.model, parts, several)
    model = extended(start.model, solution.parts)
    if not (solution.finite and _has_masses(model)):
        return None
    every, left = list(solution.motions), list(solution.residuals)
    if not solution.converged:  # then the motions are not yet those of the model
        try:
            every, left = simulated(start.model, solution.parts, several, every)
        except TrajectoryError:
            return None
    motions, residuals = [], []
    for i, record in enumerate(records):
        own = [k for k, piece in enumerate(pieces) if piece.number == i]
        grid, channels = record.motion.grid, len(record.noise)
        motions.append(Trajectory.joined(grid, [every[k] for k in own]))
        apart = [left[k].reshape(channels, -1) for k in own]
        residuals.append(np.concatenate(apart, axis=1).ravel())
    stage = Stage(model, solution.parts[len(names) :], tuple(motions))
    return Fitted(stage, tuple(records), cycles, tuple(residuals), solution.n_values)


def _lengths(records: Sequence[CoupledRecord]) -> list[float]:
    """Of the pieces after the first, in cycles, until no record is cut."""
    longest = max(_turns(record) for record in records)
    count = int(np.ceil(np.log(max(longest / _CYCLES, 1.0)) / np.log(_GROWTH)))
    return [*(_CYCLES * _GROWTH**k for k in range(1, count)), np.inf]


def _turns(record: CoupledRecord) -> float:
    """Cycles of the slowest coordinate."""
    return float(record.t[-1]) * min(float(np.median(tone.frequency)) for tone in record.tones)


def cut(now: Stage, records: Sequence[CoupledRecord], cycles: float) -> list[_Piece]:
    """The records with the motions of a stage, in pieces."""
    found = []
    for i, (record, motion) in enumerate(zip(records, now.motions, strict=True)):
        n = max(1, round(_turns(record) / cycles))
        for piece in replace(record, motion=motion).pieces(n):
            if len(records) >= _FEWEST_RECORDS:
                part = np.full(len(piece.decay.t), i)
            else:
                place = (piece.decay.t - record.clock) / (record.t[-1] + record.decay.dt)
                part = (place * _STRETCHES).astype(int) % _PARTS
            found.append(_Piece(piece, i, np.tile(part, len(record.noise))))
    return found


def _chosen(now: Stage, pieces: Sequence[_Piece], choice: _Choice) -> Stage | None:
    """What always takes part, and terms that gain on data that took no part, about the motions.

    Values are those of the linearised equations: where a fit is to start. None where the equations
    have no motions near these.
    """
    values, everything = now.model.coefficients, choice.terms
    at = np.array([values.get(t.key, 0.0) for t in everything])
    model = CoupledModel(everything, tuple(at), now.model.unit)
    free = free_coefficients(model, [t.key for t in everything])
    parts = (*now.shapes, *free)
    start = np.concatenate([[p.values[0] for p in now.shapes], at])
    n = len(now.shapes)
    least = {n + i: low for i, t in enumerate(everything) if (low := _least(t)) is not None}
    grams: dict[int, list[Gram]] = {}
    for piece in pieces:
        with np.errstate(all="ignore"):
            table = linear_table(model, parts, piece.number, piece.record, piece.record.motion)[1]
        if not np.all(np.isfinite(table)):
            return None
        for part in np.unique(piece.part):
            grams.setdefault(int(part), []).append(Gram.of(table[piece.part == part], start))
    kept, there = chosen([Gram.sum(some) for some in grams.values()], n + len(choice.always), least)
    terms = tuple(everything[i - n] for i in kept[n:])
    shapes = tuple(
        replace(p, strengths=np.full((1, 1), v)) for p, v in zip(now.shapes, there, strict=False)
    )
    return Stage(CoupledModel(terms, tuple(there[n:]), now.model.unit), shapes, now.motions)


def _has_masses(model: CoupledModel) -> bool:
    """Whether the inertia at rest is positive, as that of all masses."""
    inertia = model.inertia(np.zeros(model.n_coordinates))
    return bool(np.linalg.eigvalsh(inertia)[0] > 0)


def _least(term: Term) -> float | None:
    """What its coefficient must exceed: squares and masses are positive."""
    if isinstance(term, SlavedInertia) and term.first == term.second:
        return 0.0
    return -1.0 if isinstance(term, Along) and isinstance(term.law, AddedMass) else None
