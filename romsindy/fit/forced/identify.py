"""The equation of a forced vibration from its record: the terms it needs, and their values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from romsindy.fit.choice_error import with_choice_error
from romsindy.fit.fitted import Fit
from romsindy.fit.forced.between_samples import ways
from romsindy.fit.forced.drives import free_drives, inputs_in, refuse_displacement, regressed
from romsindy.fit.forced.pieces import Driven
from romsindy.fit.forced.refine import decided
from romsindy.fit.forced.terms import LINEAR, candidates, linearised, needed_terms
from romsindy.fit.measured import (
    free_names,
    listed_records,
    ready,
    require_known,
    require_unit,
)
from romsindy.fit.record import Prepared
from romsindy.fit.selection import Linearised
from romsindy.fit.signs import stand_ins
from romsindy.physics.driven import inputs_of
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration

_ROUNDS = 5  # of choosing terms about the motions of those chosen before


def identify_forced(
    records: ForcedVibration | Sequence[ForcedVibration | Decay],
    order: int = 5,
    *,
    fixed: Mapping[str, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Identify the equation of motion of one coordinate from records with measured inputs.

    Coefficients, gain and delay of each input, the offset of the sensor and the initial states are
    fitted by simulation over the whole records. Terms are chosen by what each gains on stretches
    that took no part. What the input does between its samples is decided by the records, unless
    they say it.

    Parameters
    ----------
    records : ForcedVibration or sequence of ForcedVibration and Decay
        At least one with an input; decays are fitted together with it.
    order : int
        Highest order of the candidates for stiffness and inertia.
    fixed : mapping, optional
        Known coefficients, in the unit of the records and seconds.
    progress : callable, optional
        Called with a line of text at every step.

    Returns
    -------
    Fit
        As `refine` gives it; the last terms of its model are the inputs.

    Raises
    ------
    ValueError
        For no input, units that differ, an order below 1, names or values in ``fixed`` that
        cannot be, or an input that looks like the displacement of the base.
    TrajectoryError
        If no motion of the model follows the measured one.
    """
    several = listed_records(records)
    if not any(isinstance(v, ForcedVibration) for v in several):
        raise ValueError("records hold no ForcedVibration: free decays alone are for identify()")
    require_unit(several, several[0].unit)
    laws, known = (*LINEAR, *candidates(order)), dict(fixed or {})
    require_known(known, [t.key for t in laws])
    found = ready(several)
    measured = [r.decay for r in found if r.driven]
    say = progress or (lambda _: None)
    hypotheses = [inputs_in(measured, way) for way in ways(measured)]
    search = _Search(laws, known, found, say)
    best = search.decided(search.needed(hypotheses[0]), hypotheses)
    inputs = inputs_of(best.model)
    if inputs[0].interpolation != hypotheses[0][0].interpolation:
        # Terms that were chosen with another input may stand for what was wrong with it.
        best = search.decided(search.needed(inputs), hypotheses)
    best = with_choice_error(best, search.every_choice(best))
    return replace(best, notes=(*best.notes, *stand_ins(best)))


@dataclass(frozen=True)
class _Search:
    """For the terms that records need, among some laws; ``fixed`` coefficients are known."""

    laws: tuple[Term, ...]
    fixed: Mapping[str, float]
    records: Sequence[Prepared]
    say: Callable[[str], None]

    def decided(self, terms: Sequence[Term], hypotheses: Sequence[Sequence[Input]]) -> Fit:
        """With some terms, and whatever the inputs do between their samples."""
        fits = []
        for inputs in hypotheses:
            self.say(f"{inputs[0].interpolation} input")
            fits.append(self.fitted(terms, inputs))
        return decided(fits)

    @property
    def candidates(self) -> list[Term]:
        """Laws that may be left out."""
        return [t for t in self.laws if not (t in LINEAR or t.key in self.fixed)]

    def every_choice(self, fit: Fit) -> Linearised:
        """All candidates about the motions of a fit."""
        return linearised(fit, fit.solution.motions, self.candidates, left_out=False)

    def needed(self, inputs: Sequence[Input]) -> tuple[Term, ...]:
        """Those of the laws that are needed, about the motions of those found before."""
        kept: tuple[Term, ...] = ()
        fit = self.fitted(kept, inputs)
        motions = [r.motion for r in fit.records]
        for number in range(_ROUNDS):
            self.say(f"terms, round {number + 1}")
            new = needed_terms(fit, motions, self.candidates)
            if new == kept:
                break
            fit, kept = self.fitted(new, inputs), new
            motions = list(fit.solution.motions)
        return kept

    def fitted(self, terms: Sequence[Term], inputs: Sequence[Input]) -> Fit:
        """From values by regression on the smooth motions."""
        known = [t for t in self.laws if t.key in self.fixed]
        own = tuple({t.key: t for t in (*LINEAR, *known, *terms)}.values())
        driven = [r for r in self.records if r.driven]
        values, gains = regressed(own, inputs, driven, self.fixed)
        refuse_displacement(inputs, gains.tolist())
        model = ReducedModel(own, tuple(values.tolist()), self.records[0].decay.unit)
        drives = free_drives(inputs, gains.tolist(), driven)
        names = free_names(model, self.fixed)
        return Driven(names, self.records).fit(model, drives)
