"""Does another vibration take part in the motion of a model, or does it only ring along?

The coordinate of the model, q1, and that of the other vibration, q2, are fitted twice to the same
records, with and without terms that couple them. All coefficients are free, and every coordinate
may have further terms of its own: only coupling tells the two apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.effects.choices import KINDS, Kind, candidates
from romsindy.fit.coupled.choice import Stage
from romsindy.fit.coupled.rounds import FittedPieces, Progress, best_of, fitted, of_plainest_kind
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.pieces import cut
from romsindy.fit.kernel.prepared import part_of
from romsindy.fit.records.coupled import CoupledRecord, coupled_records, free_shapes
from romsindy.fit.records.resonance import resonances_in
from romsindy.fit.results.fitted import Fit, refined
from romsindy.fit.verdict import EXPLAINED, MODE, SURE, WORTH
from romsindy.physics.coupled import CoupledModel, linear_terms
from romsindy.physics.coupling import Along
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.vibrations import Resonance, Vibration
from romsindy.text import left_over, listed, percent, quantity, with_error

_ALONE = tuple(kind._replace(coupled=False) for kind in KINDS)
# Coupling that stores energy: what damps may stand for a damping of one coordinate that is missing.
_TOGETHER = tuple(kind._replace(coupled_damping=False) for kind in KINDS)


_MOST_COUPLINGS = 3  # the surest are told


@dataclass(frozen=True, eq=False)
class Interaction:
    """Two vibrations, fitted with and without coupling."""

    frequency: float  # Hz, of the other vibration where it is small
    slower: bool  # whether the modelled vibration is the slower one
    own: tuple[str, ...]  # terms of single coordinates that were added without coupling
    # Without and with coupling, to pieces of one length, over the same noise
    alone: FittedPieces
    together: FittedPieces
    longest: FittedPieces  # with coupling, over the longest pieces that it follows

    @property
    def couplings(self) -> tuple[Term, ...]:
        """The terms that couple the coordinates."""
        own = candidates(2, Kind(kinked=True, coupled=False))
        terms = self.longest.stage.model.terms
        return tuple(t for t in terms if not (isinstance(t, Along) or t in own))

    @property
    def pieces(self) -> str:
        """Over what the two were compared, in words."""
        return over_pieces(self.together)

    @property
    def before(self) -> float:
        """Rms of what is left without coupling, over the noise."""
        return self.alone.left

    @property
    def after(self) -> float:
        """The same with coupling."""
        return self.together.left

    @cached_property
    def left(self) -> tuple[str, str]:
        """Both in words."""
        both = (self.alone, self.together)
        alone, together = (left_over(part_of(f.records, f.residuals), f.left) for f in both)
        return alone, together

    @property
    def takes_part(self) -> bool:
        """Whether the coupling is needed: far beyond chance, and for a material part of the rest.

        Where more than noise is left with it, it must count as any effect must there.
        """
        if not (self.couplings and self.together.is_better(self.alone, self.together.records)):
            return False
        enough = self.after <= EXPLAINED or WORTH * self.after**2 < self.before**2
        return enough and self.after < (1 - MODE) * self.before

    @property
    def resonance(self) -> Resonance | None:
        """Where the frequencies come nearest to a ratio of small whole numbers, if they do."""
        return min(resonances_in(self.longest.records), key=lambda r: r.off, default=None)

    @cached_property
    def fit(self) -> Fit | None:
        """The model of both, refined over the longest pieces; None if it has no exact motion."""
        stage, best = self.longest.stage, self.longest
        pieces = tuple(piece for record in best.records for piece in cut(record, best.cycles))
        names = tuple(stage.model.coefficients)
        try:
            return refined(stage.model, names, pieces, stage.shapes, settled=True)
        except TrajectoryError:
            return None


def over_pieces(found: FittedPieces) -> str:
    """Over what a model was fitted, each piece from an initial state of its own."""
    if np.isinf(found.cycles):
        return "the whole decay"
    return f"pieces of {found.cycles:.0f} cycles"


def interaction_of(
    model: ReducedModel,
    decays: Sequence[Decay],
    own: Vibration,
    other: Vibration,
    floor: float,
    say: Callable[[str], None],
) -> Interaction | None:
    """Fit a model and another vibration, with and without coupling, to decays in which both ring.

    ``floor`` is the least noise, as a part of the largest sample: less than that does not matter.
    None where either follows the motion over no piece of the decays.
    """
    frequencies = np.array([own.small_frequency, other.small_frequency])
    records = coupled_records(decays, frequencies, floor)
    start, progress = Stage(_beside(model, other), free_shapes(records)), Progress(say, _pass)
    # Tall and narrow matrices: threads of the linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        alone = of_plainest_kind(start, records, _ALONE, progress)
        if alone is None:
            return None
        longest = alone
        if not alone.explained:
            together = _together(start, records, alone, progress)
            if together is None:
                return None
            alone = _alone_again(start, records, alone, together, progress)
            longest = alone if alone.explained else together
        cycles = min(alone.cycles, longest.cycles)
        pair = [_over(f, longest.records, cycles) for f in (alone, longest)]
    if pair[0] is None or pair[1] is None:
        return None
    own_terms = tuple(t.key for t in alone.stage.model.terms if t not in start.model.terms)
    slower = own.small_frequency < other.small_frequency
    return Interaction(other.small_frequency, slower, own_terms, pair[0], pair[1], longest)


def _together(
    start: Stage, records: Sequence[CoupledRecord], alone: FittedPieces, progress: Progress
) -> FittedPieces | None:
    """With coupling; where that has no motion from the start, from what was found without it."""
    found = of_plainest_kind(start, records, _TOGETHER, progress)
    return found or of_plainest_kind(alone.stage, alone.records, _TOGETHER, progress)


def _alone_again(
    start: Stage,
    records: Sequence[CoupledRecord],
    alone: FittedPieces,
    together: FittedPieces,
    progress: Progress,
) -> FittedPieces:
    """Without coupling, also from where coupling led: what was not found at first is no proof."""
    own = {*start.model.terms, *(t for kind in _ALONE for t in candidates(2, kind))}
    terms = zip(together.stage.model.terms, together.stage.model.values, strict=True)
    values = {term: value for term, value in terms if term in own}
    model = CoupledModel(tuple(values), tuple(values.values()), start.model.unit)
    pairs = zip(together.records, records, strict=True)
    moved = [replace(found, noise=given.noise) for found, given in pairs]
    again = of_plainest_kind(replace(together.stage, model=model), moved, _ALONE, progress)
    return again if again and best_of([alone, again]) is again else alone


def _over(
    found: FittedPieces, records: Sequence[CoupledRecord], cycles: float
) -> FittedPieces | None:
    """The same fitted to pieces so many cycles long, over the noise of some records."""
    pairs = list(zip(found.records, records, strict=True))
    if found.cycles == cycles and all(own.noise is other.noise for own, other in pairs):
        return found
    heard = found.with_noise_of(records)
    again = fitted(found.stage, heard.records, cycles)
    # What loses the motion where the noise is another one stands as it was fitted.
    return heard if again is None and found.cycles == cycles else again


def _pass(found: FittedPieces) -> None:
    """An interrupt ends the whole comparison: nothing of it is kept."""


def _beside(model: ReducedModel, other: Vibration) -> CoupledModel:
    """The model along q1, and beside it the frequency and damping of another vibration."""
    omega, zeta = 2 * np.pi * other.small_frequency, other.small_damping_ratio
    values = dict.fromkeys(linear_terms(2), 0.0)
    pairs = zip(model.terms, model.values, strict=True)
    values.update({Along.coordinate(term, 1): value for term, value in pairs})
    small = (omega**2, 2 * zeta * omega if zeta > 0 else 0.0)
    values.update(zip(linear_terms(2)[2:], small, strict=True))
    return CoupledModel(tuple(values), tuple(values.values()), model.unit)


# -- in words ------------------------------------------------------------------------------------


def takes_part(found: Interaction, fit: Fit) -> str:
    """That another mode takes part: by which resonance, where, and by what."""
    unit = fit.model.unit
    near = found.resonance
    through = ""
    if near is not None:
        lower = "" if found.slower else " of the lower mode"
        size = quantity(near.amplitude, unit or "[q]")
        through = f" through a {ratio(near)} resonance near {size}{lower}"
    values, errors = fit.model.coefficients, fit.standard_errors
    surest = sorted(found.couplings, key=lambda t: -abs(values[t.key]) / errors[t.key])
    told = [
        f"{t.key} = {' +- '.join(with_error(values[t.key], errors[t.key]))} {t.unit(unit)}".rstrip()
        for t in surest[:_MOST_COUPLINGS]
    ]
    more = len(surest) - len(told)
    text = ", ".join([*told, *([f"{more} more"] if more else [])])
    return f"a mode at {found.frequency:.4g} Hz takes part{through} ({text})"


def ratio(resonance: Resonance | None) -> str:
    """Of two frequencies, such as "1:3"; empty where they are near none."""
    return "" if resonance is None else f"{resonance.p}:{resonance.q}"


def footing(found: Interaction) -> str:
    """What one coordinate and two leave, over pieces of one length."""
    alone, together = found.left
    return (
        f"Of {found.pieces} one coordinate leaves {alone}, all its values free, and two leave"
        f" {together}."
    )


def values_that_moved(nominal: ReducedModel, fit: Fit) -> str:
    """By how much values of the simulation surely moved beside another mode."""
    errors, now = fit.standard_errors, fit.model.coefficients
    moved = []
    for term, was in zip(nominal.terms, nominal.values, strict=True):
        key = Along.coordinate(term, 1).key
        if was and abs(now[key] - was) > SURE * errors[key]:
            change = now[key] / was - 1
            moved.append(f"{term.key} by {'-' if change < 0 else ''}{percent(abs(change))}")
    return f" Beside it values of the simulation move: {listed(moved)}." if moved else ""


def footing_table(found: Interaction) -> list[list[str]]:
    """The same as rows of text, with the pieces that the two follow at most."""
    rows = [["followed", "one coordinate", "two"]]
    rows.append([found.pieces, f"{found.before:.3g}", f"{found.after:.3g}"])
    if found.longest.cycles != found.together.cycles:
        rows.append([over_pieces(found.longest), "lost", f"{found.longest.left:.3g}"])
    return rows


def rings_along(found: Interaction) -> str:
    """That another mode rings, but is not seen to take part."""
    alone, together = found.left
    if found.alone.explained:
        terms = f" and {listed(found.own)} added" if found.own else ""
        rest = f"with it beside the model, all values free{terms}, noise alone is left ({alone})"
    else:
        rest = (
            f"of {found.pieces} one coordinate with it beside leaves {alone}, and {together} with"
            " what could couple them"
        )
    return f"a mode at {found.frequency:.4g} Hz rings along, and is not seen to take part: {rest}."


def not_followed(other: Vibration) -> str:
    """That another mode rings, and nothing more can be said."""
    return (
        f"a mode at {other.small_frequency:.4g} Hz rings along; no equations of both modes were"
        " found that follow the records, so that its part is not known."
    )
