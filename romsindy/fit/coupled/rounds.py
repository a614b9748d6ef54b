"""Choose terms of several coordinates and fit them, round after round, until the choice stays.

The first rounds look at short pieces of the records, which become longer
(`romsindy.fit.kernel.shooting`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from romsindy.effects.choices import KINDS, Kind, candidates
from romsindy.fit.adequacy.independence import (
    Independence,
    by_noises,
    by_values,
    misses,
    of_decays,
    told,
)
from romsindy.fit.adequacy.verdicts import Adequacy, examine
from romsindy.fit.choice import Gram, Linearised, Trials, dragged, needed
from romsindy.fit.kernel.gauss_newton import linear_tables
from romsindy.fit.kernel.hypothesis import free_parts
from romsindy.fit.kernel.noises import Noises
from romsindy.fit.kernel.part import Part, Solution, extended
from romsindy.fit.kernel.prepared import CREEPS, SHARP, chi_squared_of, creeping, part_of
from romsindy.fit.kernel.shooting import cut, fit_pieces, lengths, moved
from romsindy.fit.records.coupled import CoupledRecord, CurvedShape, ModeShape, curved_shapes
from romsindy.fit.verdict import EXPLAINED, TERM
from romsindy.physics.coupled import CoupledModel, linear_terms
from romsindy.physics.term import Term
from romsindy.typing import Array, Indices

# Parts of the data that are left out in turn. With fewer records than the first, stretches of them
# are: so many, dealt out in turn, so that each part spans the amplitudes.
_FEWEST_RECORDS, _PARTS, _STRETCHES = 4, 4, 24


@dataclass(frozen=True)
class Stage:
    """What has been found so far: the model, and what channels show beyond what was read off.

    Coefficients whose names are ``fixed`` keep their values.
    """

    model: CoupledModel
    shapes: tuple[Part, ...]
    fixed: tuple[str, ...] = ()

    @property
    def free(self) -> list[str]:
        """Names of the coefficients that are fitted."""
        return [name for name in self.model.coefficients if name not in self.fixed]

    @property
    def n_values(self) -> int:
        """Coefficients, and what sensors show of products."""
        return len(self.free) + len(self.shapes)

    def is_like(self, other: Stage) -> bool:
        """Whether it has the terms of another, and sensors of its kind."""
        mine, others = ({*s.model.terms, *(p.effect for p in s.shapes)} for s in (self, other))
        return mine == others

    def with_values_of(self, other: Stage) -> Stage:
        """With the values of another; 0 where it has none."""
        values = other.model.coefficients
        at = tuple(values.get(term.key, 0.0) for term in self.model.terms)
        shown = {p.effect: p for p in other.shapes}
        shapes = (
            shown.get(p.effect, replace(p, strengths=np.zeros_like(p.strengths)))
            for p in self.shapes
        )
        return replace(self, model=replace(self.model, values=at), shapes=tuple(shapes))

    def summary(self, n_always: int) -> str:
        """The terms beyond the first ones, and products that sensors show, in a line."""
        names = [t.key for t in self.model.terms[n_always:]]
        shown = [p.effect.sentence for p in self.shapes if isinstance(p.effect, CurvedShape)]
        every = [*names, *dict.fromkeys(shown)]
        return f"terms: {', '.join(every) or 'no more than at the start'}"


class Choice(NamedTuple):
    """Terms that always take part, those that may, and what sensors may show of products.

    Parts of the data are ``left_out`` to judge them, as long as more than noise is left.
    """

    always: tuple[Term, ...]
    candidates: tuple[Term, ...]
    curved: list[tuple[Part, ...]]
    left_out: bool = True

    @property
    def terms(self) -> tuple[Term, ...]:
        return (*self.always, *(t for t in self.candidates if t not in self.always))


def choose(
    now: Stage,
    records: Sequence[CoupledRecord],
    cycles: float,
    choice: Choice,
    noises: Sequence[Noises] = (),
) -> Stage | None:
    """What always takes part, and terms that gain on data that took no part, about the motions.

    Values are those of the linearised equations: where a fit is to start. None where the equations
    have no motions near these. Whole records may be weighed by ``noises`` that are found in them.
    """
    found = linearised(now, records, cycles, choice, noises)
    return found and _stage(found, found.trials.chosen(found.present), now)


def _stage(found: Linearised, kept: Sequence[int], now: Stage) -> Stage:
    """What always takes part and some groups, with the values of the linearised equations."""
    there, values = {*found.trials.places(kept)}, found.trials.values(kept)
    shapes = [
        replace(p, strengths=np.full((1, 1), values[i]))
        for i, p in enumerate(found.sensors)
        if i in there
    ]
    terms = {t: value for t, value in now.model.pairs if t.key in now.fixed}
    terms |= {t: values[i] for i, t in enumerate(found.terms, len(found.sensors)) if i in there}
    return replace(now, model=now.model.with_terms(terms.items()), shapes=tuple(shapes))


def every_choice(stage: Stage, records: Sequence[CoupledRecord]) -> Linearised | None:
    """All candidates of the plainest kind that has the terms of a fit, about its motions."""
    r = stage.model.n_coordinates
    kinds = [candidates(r, kind) for kind in KINDS if kind.masses]
    enough = (k for k in kinds if {*stage.model.terms} <= {*linear_terms(r), *k})
    several = next(enough, kinds[-1])
    choice = Choice(linear_terms(r), several, curved_shapes(records[0]), left_out=False)
    return linearised(stage, records, np.inf, choice)


def linearised(
    now: Stage,
    records: Sequence[CoupledRecord],
    cycles: float,
    choice: Choice,
    noises: Sequence[Noises] = (),
) -> Linearised | None:
    """All of a choice about the motions of pieces; None where there are none near these."""
    everything, values = choice.terms, now.model.coefficients
    wide = tuple(values.get(t.key, 0.0) for t in everything)
    free = tuple(t for t in everything if t.key not in now.fixed)
    at = [values.get(t.key, 0.0) for t in free]
    model = CoupledModel(everything, wide, now.model.unit)
    model, own = free_parts(model, [t.key for t in free], records)
    shown = {p.effect: p for p in now.shapes}
    straight = [p for p in now.shapes if isinstance(p.effect, ModeShape)]
    sensors = (*straight, *(shown.get(p.effect, p) for group in choice.curved for p in group))
    parts = (*sensors, *own)
    start = np.array([*(p.values[0] for p in sensors), *at])
    grams: dict[int, list[Gram]] = {}
    for i, record in enumerate(records):
        pieces = cut(record, cycles)
        given = pieces, [piece.motion for piece in pieces], [i] * len(pieces)
        with np.errstate(all="ignore"):
            if noises:
                several = (by_values(model, parts, i, piece, piece.motion)[1] for piece in pieces)
                tables = [table.weighed(noises[i]).products for table in several]
            else:
                tables = [rows for _, rows in linear_tables(model, parts, *given)]
        for piece, table in zip(pieces, tables, strict=True):
            if not np.all(np.isfinite(table)):
                return None
            if noises:
                gram = Gram.of_products(table, start, len(piece.signal))
                grams.setdefault(0, []).append(gram)
                continue
            numbers = _parts(piece, record, i, len(records)) * choice.left_out
            for part in np.unique(numbers):
                grams.setdefault(int(part), []).append(Gram.of(table[numbers == part], start))
    first = len(sensors)
    n_always = sum(t in choice.always for t in free)
    always = [*range(len(straight)), *range(first, first + n_always)]
    ends = np.cumsum([len(straight), *(len(group) for group in choice.curved)])
    groups = [
        *(list(range(a, b)) for a, b in itertools.pairwise(ends)),
        *([i] for i in range(always[-1] + 1, len(parts))),
    ]
    what = [*(p.effect for p in sensors), *free]
    taken = {*now.model.terms, *shown}
    terms_of = {g: t for g, (i, *_) in enumerate(groups) if isinstance(t := what[i], Term)}
    # While more than noise is left, values stand for terms that are missing: mass is no judge yet.
    energy = {} if choice.left_out else dragged(free, [r.motion for r in records])
    kinetic = {g: energy[i - first] for g, (i, *_) in enumerate(groups) if i - first in energy}
    present = [g for g, (i, *_) in enumerate(groups) if what[i] in taken]
    sums = [Gram.sum(some) for some in grams.values()]
    trials = Trials.of(sums, always, groups, terms_of, kinetic)
    return Linearised(trials, sensors, free, present)


def _parts(piece: CoupledRecord, record: CoupledRecord, number: int, count: int) -> Indices:
    """With which part of the data each sample of a piece is left out, (c n,).

    ``number`` is that of the record among ``count``.
    """
    t = piece.decay.t
    if count >= _FEWEST_RECORDS:
        return np.full(len(t) * len(record.noise), number)
    place = (t - record.clock) / (record.t[-1] + record.decay.dt)
    return np.tile((place * _STRETCHES).astype(int) % _PARTS, len(record.noise))


# Choices and fits with pieces of one length.
_ROUNDS = 6
# What is left may grow so much as pieces do, of a model that is not lost; by more than the second
# factor, and terms are missing.
_LOST, _MISSED = 3.0, 1.5
_ROUNDED = 2e-3  # of the response: what friction leaves at most that turns round too slowly
# The lightest mass over the heaviest. Where nothing tells the masses, an equation times zero is
# fulfilled by every motion; of what sensors see of one structure, masses differ by far less.
_LIGHTEST = 1e-6


@dataclass(frozen=True)
class FittedPieces:
    """A stage fitted to pieces of the records."""

    stage: Stage
    start: CoupledModel  # beside the parts of the solution
    records: tuple[CoupledRecord, ...]  # whole, with their noise, and the motions of the fit
    # Length of the pieces, in cycles of the slowest coordinate; infinite for whole records
    cycles: float
    solution: Solution  # of whole records

    @property
    def residuals(self) -> tuple[Array, ...]:
        """What it leaves of every record, tuple of (c n,) arrays."""
        return self.solution.residuals

    @property
    def left(self) -> float:
        """Rms of what it leaves of the records, over their noise."""
        return self.left_over(self.records)

    @cached_property
    def explained(self) -> bool:
        """Whether it leaves noise alone, of whole records."""
        if np.isfinite(self.cycles) or told(self.heard, self.records):
            return bool(np.isinf(self.cycles))
        return by_noises(self.heard, self.solution, self.records, self.independence).explained

    @property
    def misses(self) -> bool:
        """Whether it leaves more than noise, by its level and whatever its colour."""
        return not told(self.heard, self.records) and misses(self.heard, self.independence)

    @cached_property
    def heard(self) -> Adequacy:
        """What it leaves, by the level of the noise."""
        return examine(self.records, self.residuals, self.solution.n_values)

    @cached_property
    def independence(self) -> Independence:
        """Whether what it leaves goes with the motion, and the noises that are found in it."""
        return of_decays(self.start, self.solution, self.records)[0]

    def left_over(self, records: Sequence[CoupledRecord]) -> float:
        """The same over the noise of other records."""
        return float(np.sqrt(np.mean(self._squares(records))))

    def is_better(self, before: FittedPieces, records: Sequence[CoupledRecord]) -> bool:
        """Whether its terms are worth more than those of another, by the noise of some records."""
        now, then = self._squares(records), before._squares(records)
        more = self.stage.n_values - before.stage.n_values
        least = min(now.sum(), then.sum())
        return bool(then.sum() - now.sum() > more * needed(then.size, least, 1))

    def is_alike(self, before: FittedPieces, records: Sequence[CoupledRecord]) -> bool:
        """Whether it leaves about as much as another, which a round more would do, too."""
        return bool(self._squares(records).sum() > (1 - TERM) * before._squares(records).sum())

    def with_noise_of(self, records: Sequence[CoupledRecord]) -> FittedPieces:
        """With the noise of other records in the place of its own."""
        pairs = list(zip(self.records, records, strict=True))
        if all(r.noise is o.noise for r, o in pairs):
            return self  # what was found out about it stands
        return replace(self, records=tuple(replace(r, noise=o.noise) for r, o in pairs))

    def heard_again(self) -> FittedPieces:
        """With the noise of the records as it is in what the fit leaves, where that is less."""
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


class Progress(NamedTuple):
    """What is told of the rounds, and the fits that an interrupt must not lose."""

    say: Callable[[str], None]
    keep: Callable[[FittedPieces], None]


def of_plainest_kind(
    start: Stage, given: Sequence[CoupledRecord], kinds: Sequence[Kind], progress: Progress
) -> FittedPieces | None:
    """The start with terms of the first kind that explains the records, or else of the best.

    None if it follows the motion over no piece. Every kind goes on from the one before, with the
    shortest pieces, until what is left there is noise; only then do pieces grow.
    """
    always, r, curved = start.model.terms, start.model.n_coordinates, curved_shapes(given[0])
    shortest, best = lengths(given)[0], None
    found: list[FittedPieces] = []
    for kind in kinds:
        # Where nothing tells the masses, terms beside them may gain all the same.
        for some in (kind, kind._replace(masses=False)) if kind.kinked else (kind,):
            choice = Choice(always, candidates(r, some), curved)
            now, records = (best.stage, best.records) if best else (start, given)
            best = settled(now, records, choice, progress, shortest, best) or best
            if best and best.left <= EXPLAINED:
                break
        last = kind is kinds[-1]
        if best is None or not (last or (kind.masses and best.left <= EXPLAINED)):
            continue
        # Longer pieces tell masses that short ones do not.
        choice = Choice(always, candidates(r, kind), curved)
        found.append(_whole(best, given, choice, progress))
        if found[-1].explained:
            break
    return best_of(found)


def best_of(found: Sequence[FittedPieces]) -> FittedPieces | None:
    """Of several fits the one that explains, or follows the motion for longest and leaves least."""
    if not found:
        return None
    longest = [f for f in found if f.cycles == max(f.cycles for f in found)]
    quietest = longest[-1].records
    explained = [f for f in longest if f.explained]
    # Of two alike the later: its noise was heard last.
    return min(reversed(explained or longest), key=lambda f: f.left_over(quietest))


def _whole(
    best: FittedPieces, given: Sequence[CoupledRecord], choice: Choice, progress: Progress
) -> FittedPieces:
    """Fitted to the longest pieces that it follows, with the noise of the given records."""
    best = _grown(best, choice, progress)
    choice = choice._replace(left_out=False)
    if np.isinf(best.cycles) and told(best.heard, best.records):
        best = settled(best.stage, best.records, choice, progress, best.cycles, best) or best
    elif np.isinf(best.cycles):
        best = _by_noises(best.with_noise_of(given), choice, progress)
    # The noise that was heard at first stands, unless less than it is left: that is a proof.
    best = best.with_noise_of(given)
    best = best.heard_again() if best.left < 1 else best
    progress.keep(best)
    return best


def _by_noises(best: FittedPieces, choice: Choice, progress: Progress) -> FittedPieces:
    """With the terms that whole records ask for by the noises that are found in what is left.

    By its level where it is loudest, noise with a colour hides terms. The last choice that explains
    the records is taken, if there is one.
    """
    kept, now, tried = best, best, [best.stage]
    while len(tried) <= _ROUNDS:
        start = choose(now.stage, now.records, np.inf, choice, now.independence.noises)
        if start is None or any(start.is_like(stage) for stage in tried):
            break
        tried.append(start)
        progress.say(start.summary(len(choice.always)))
        after = fitted(start, now.records, np.inf)
        if after is None:
            break
        kept, now = after if after.explained else kept, after
    return kept


def _grown(best: FittedPieces, choice: Choice, progress: Progress) -> FittedPieces:
    """Fitted to the longest pieces over which the model follows the motion.

    Terms are chosen again where longer pieces show that some are missing, and at the end.
    """
    # What is explained over few cycles may be so over all; else pieces grow by and by.
    if best.left <= EXPLAINED and (longer := _longer(best, np.inf)):
        return settled(longer.stage, longer.records, choice, progress, np.inf, longer) or longer
    for cycles in lengths(best.records)[1:]:
        longer = _longer(best, cycles)
        if longer is None:
            break
        misses = cycles == np.inf or longer.left > _MISSED * best.left
        best = longer
        if misses:
            best = settled(best.stage, best.records, choice, progress, cycles, best) or best
    return best


def _longer(now: FittedPieces, cycles: float) -> FittedPieces | None:
    """Fitted to longer pieces; None where the model loses the motion.

    What a wrong model misses grows with the length of the pieces; by much more, and it is lost.
    """
    found = fitted(now.stage, now.records, cycles)
    if found is None or found.left > _LOST * max(now.left, 1.0):
        return None
    return found


def settled(
    now: Stage,
    records: Sequence[CoupledRecord],
    choice: Choice,
    progress: Progress,
    cycles: float,
    best: FittedPieces | None = None,
) -> FittedPieces | None:
    """Rounds with pieces of one length, until the choice of terms stays; the best fit."""
    given, weighed = tuple(records), best.weighed_alike() if best else tuple(records)
    for _ in range(_ROUNDS):
        start = choose(now, weighed, cycles, choice)
        if start is None or (best and start.is_like(best.stage)):
            break
        progress.say(start.summary(len(choice.always)))
        found = _better(start, now, weighed, cycles, best)
        if found is None:
            break
        alike = best is not None and choice.left_out and found.is_alike(best, weighed)
        # The noise is that of the records, not what they were weighed by.
        now, best = found.stage, found.with_noise_of(given).heard_again()
        pairs = zip(best.records, given, strict=True)
        settled = alike and all(r.noise is g.noise for r, g in pairs)
        progress.keep(best)
        given, weighed = best.records, best.weighed_alike()
        if settled:
            break
    return best


def _better(
    start: Stage,
    now: Stage,
    records: Sequence[CoupledRecord],
    cycles: float,
    best: FittedPieces | None,
) -> FittedPieces | None:
    """A fit that is better than the best, or None.

    From the values of a start: those of the linearised equations may have no motion at all, then
    from those of now. Over long pieces a fit may lose the motion: then from that of short ones.
    """
    found = fitted(start, records, cycles) or fitted(start.with_values_of(now), records, cycles)
    if found and (best is None or found.is_better(best, records)):
        return found
    if found and best and found.left < _LOST * best.left_over(records):
        return None  # it has its motion, which is no better
    shortest = lengths(records)[0]
    if best is None or cycles == shortest:
        return None
    short = fitted(start, records, shortest)
    found = short and fitted(short.stage, short.records, cycles)
    return found if found and found.is_better(best, records) else None


def fitted(start: Stage, records: Sequence[CoupledRecord], cycles: float) -> FittedPieces | None:
    """The model fitted to pieces so many cycles long; None if it has no motion, or no masses."""
    base, own = free_parts(start.model, start.free, records)
    laws, jumps = replace(start.model, values=base.values), not all(t.smooth for t in base.terms)
    records = creeping([r.at_rest(start.model) for r in records])
    solution = fit_pieces(base, (*own, *start.shapes), records, cycles)
    if solution is None:
        return None
    model = extended(laws, solution.parts)
    for part in CREEPS[1:SHARP] if jumps and _near(solution, records) else ():
        still = [r.at_rest(model) for r in moved(records, solution.motions)]
        near = fit_pieces(base, solution.parts, creeping(still, part), cycles)
        if near is None or not near.converged:
            break
        records, solution, model = creeping(still, part), near, extended(laws, near.parts)
    masses = np.linalg.eigvalsh(model.inertia(np.zeros(model.n_coordinates)))
    if not masses[0] > _LIGHTEST * masses[-1]:  # or an equation vanishes
        return None
    stage = replace(start, model=model, shapes=solution.parts[len(own) :])
    followed = moved(records, solution.motions)
    return FittedPieces(stage, base, followed, cycles, solution)


def _near(solution: Solution, records: Sequence[CoupledRecord]) -> bool:
    """Whether so little is left that it may show how sharply friction turns round."""
    squares = chi_squared_of(records, solution.residuals)
    near = squares < _MISSED**2 * sum(len(r.signal) for r in records)
    return near or part_of(records, solution.residuals) < _ROUNDED
