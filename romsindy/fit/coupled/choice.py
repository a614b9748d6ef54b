"""Choose terms of several coordinates about the motions of the records, which are cut in pieces."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from romsindy.effects.choices import KINDS, candidates
from romsindy.fit.adequacy.independence import by_values
from romsindy.fit.choice import Gram, Linearised, Trials, dragged
from romsindy.fit.kernel.gauss_newton import linear_table
from romsindy.fit.kernel.hypothesis import free_parts
from romsindy.fit.kernel.noises import Noises
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.pieces import cut
from romsindy.fit.records.coupled import CoupledRecord, curved_shapes
from romsindy.fit.records.mode_shape import CurvedShape, ModeShape
from romsindy.physics.coupled import CoupledModel, linear_terms
from romsindy.physics.term import Term
from romsindy.typing import Indices

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
    pairs = zip(now.model.terms, now.model.values, strict=True)
    terms = {t: value for t, value in pairs if t.key in now.fixed}
    terms |= {t: values[i] for i, t in enumerate(found.terms, len(found.sensors)) if i in there}
    model = replace(now.model, terms=tuple(terms), values=tuple(terms.values()))
    return replace(now, model=model, shapes=tuple(shapes))


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
        for piece in cut(record, cycles):
            about = model, parts, i, piece, piece.motion
            with np.errstate(all="ignore"):
                products = by_values(*about)[1].weighed(noises[i]).products if noises else None
                table = linear_table(*about)[1] if products is None else products
            if not np.all(np.isfinite(table)):
                return None
            if products is not None:
                gram = Gram.of_products(products, start, len(piece.signal))
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
