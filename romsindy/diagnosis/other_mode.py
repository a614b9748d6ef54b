"""Does another vibration take part in the motion of a model, or does it only ring along?

It is asked where what one coordinate explains of records is in doubt.

The coordinate of the model, q1, and that of the other vibration, q2, are fitted twice to the same
records, with and without terms that couple them. All coefficients are free, and every coordinate
may have further terms of its own: only coupling tells the two apart.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.diagnosis import words
from romsindy.diagnosis.gap import Gap, Prediction, name_of, predict
from romsindy.diagnosis.report import TABLE_HEAD, BesideDecays, DiagnosisReport, Written, page_of
from romsindy.diagnosis.search import Options
from romsindy.diagnosis.verdict import Left, Verdict
from romsindy.effects import CATALOGUE, look_alikes
from romsindy.effects.choices import KINDS, Kind, candidates
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.coupled.rounds import (
    FittedPieces,
    Progress,
    Stage,
    best_of,
    fitted,
    of_plainest_kind,
)
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.prepared import part_of
from romsindy.fit.kernel.shooting import cut
from romsindy.fit.records.coupled import CoupledRecord, coupled_records, free_shapes
from romsindy.fit.records.record import Record
from romsindy.fit.results.fitted import Fit, refined, resonances_in
from romsindy.fit.verdict import EXPLAINED, LEFT_OVER, MODE, SURE, WORTH
from romsindy.physics.coupled import CoupledModel, linear_terms
from romsindy.physics.coupling import Along
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.signals import rest_level
from romsindy.record.vibrations import Resonance, Vibration, find_vibrations
from romsindy.text import TextTable, left_over, listed, percent, quantity, with_error

if TYPE_CHECKING:
    from romsindy.show.page import Picture

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
    return "the whole decay" if np.isinf(found.cycles) else f"pieces of {found.cycles:.0f} cycles"


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
    records = coupled_records(decays, np.array([own.small_frequency, other.small_frequency]), floor)
    start = Stage(_beside(model, other), free_shapes(records))
    # An interrupt ends the whole comparison: nothing of it is kept.
    progress = Progress(say, lambda _: None)
    # Tall and narrow matrices: threads of the linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        alone = of_plainest_kind(start, records, _ALONE, progress)
        if alone is None:
            return None
        longest = alone
        if not alone.explained:
            found = of_plainest_kind(start, records, _TOGETHER, progress)
            # Where that has no motion from the start: from what was found without coupling.
            together = found or of_plainest_kind(alone.stage, alone.records, _TOGETHER, progress)
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


def _alone_again(
    start: Stage,
    records: Sequence[CoupledRecord],
    alone: FittedPieces,
    together: FittedPieces,
    progress: Progress,
) -> FittedPieces:
    """Without coupling, also from where coupling led: what was not found at first is no proof."""
    own = {*start.model.terms, *(t for kind in _ALONE for t in candidates(2, kind))}
    there = together.stage.model
    kept = there.with_terms(pair for pair in there.pairs if pair[0] in own)
    model = replace(kept, unit=start.model.unit, amplitude_range=None)
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


def _beside(model: ReducedModel, other: Vibration) -> CoupledModel:
    """The model along q1, and beside it the frequency and damping of another vibration."""
    omega, zeta = 2 * np.pi * other.small_frequency, other.small_damping_ratio
    values = dict.fromkeys(linear_terms(2), 0.0)
    values.update({Along.coordinate(term, 1): value for term, value in model.pairs})
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
    for term, was in nominal.pairs:
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


@dataclass(frozen=True, kw_only=True, repr=False)
class InteractionReport(BesideDecays, Written):
    """What a simulation of one coordinate lacks, where another mode takes part.

    The gap is that of the records in which both modes ring, none of which was held out; after, they
    are followed in pieces of ``interaction.longest.cycles`` cycles. ``effects`` is empty: values of
    the simulation were all fitted anew, and nothing but the other mode is missing.

    Attributes
    ----------
    one_coordinate : DiagnosisReport
        What was found by effects of one coordinate, which was not enough.
    interaction : Interaction
        What one coordinate and two leave.
    fit : Fit
        Of the model, with the errors of its coefficients.
    gap, differences, tolerance, records
        As those of a `DiagnosisReport`.
    notes : tuple of str
        What else was found, a sentence each.
    """

    one_coordinate: DiagnosisReport
    interaction: Interaction
    fit: Fit
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, report: DiagnosisReport, interaction: Interaction, fit: Fit, gap: Gap
    ) -> InteractionReport:
        """Of a mode that takes part in some records, beside what one coordinate said."""
        same = {k: getattr(report, k) for k in ("differences", "tolerance", "records", "notes")}
        return cls(gap=gap, one_coordinate=report, interaction=interaction, fit=fit, **same)

    @property
    def verdict(self) -> Verdict:
        """Always "named": the other mode."""
        return "named"

    @property
    def interrupted(self) -> bool:
        """Whether the search was stopped before its end."""
        return self.one_coordinate.interrupted

    @property
    def nominal(self) -> ReducedModel:
        """The simulation."""
        return self.one_coordinate.nominal

    @property
    def model(self) -> Equations:
        """Of both modes: the simulation along q1, the other as q2, and what couples them."""
        return self.fit.model

    @property
    def remainder(self) -> Adequacy:
        """What the model of both leaves."""
        return self.fit.verdict

    @property
    def left(self) -> Left:
        """Noise, or a further effect."""
        return "noise" if self.remainder.explained else "effect"

    @property
    def sentence(self) -> str:
        """The finding, a line for each question: do they differ, what is missing, what is left?"""
        found = takes_part(self.interaction, self.fit)
        moved = values_that_moved(self.nominal, self.fit)
        missing = f"{found}. {self._closing('It closes')} {footing(self.interaction)}{moved}"
        lines = [self.one_coordinate.opening, f"Missing: {missing}"]
        lines.append(f"Left: {words.remainder(self.gap, self.left)}")
        return "\n".join([*lines, *self._noted(self.notes)])

    # -- tables and files ------------------------------------------------------------------------

    def table(self) -> list[list[str]]:
        """Rows of text: what couples the modes, with its values."""
        near = ratio(self.interaction.resonance)
        values, errors = self.fit.model.coefficients, self.fit.standard_errors
        rows = [list(TABLE_HEAD)]
        for t in self.interaction.couplings:
            numbers = [f"{values[t.key]:.6g}", f"{errors[t.key]:.2g}", t.unit(self.nominal.unit)]
            rows.append(["another mode", near, t.key, *numbers, ""])
        return rows

    def _content(self) -> dict[str, Any]:
        found, resonance = self.interaction, self.interaction.resonance
        return {
            **super()._content(),
            **self._sizes(self.remainder),
            "effects": [],
            "moved": [],
            "equivalent": [],
            "odds": None,
            "left": self.left,
            "next": None,
            "model": json.loads(self.model.to_json()),
            "interaction": {
                "frequency": found.frequency,
                "resonance": resonance and vars(resonance),
                "couplings": [t.key for t in found.couplings],
                "cycles": found.together.cycles,
                "one_coordinate": found.before,
                "two_coordinates": found.after,
            },
        }

    def pictures(self) -> dict[str, Picture]:
        """Pictures by name: "gap", "amplitude" and "time" as elsewhere, and "coordinates"."""
        from romsindy.diagnosis.pictures import pictures_of_two

        found = self.interaction
        alone, together = ((f.records, f.residuals) for f in (found.alone, found.together))
        return {p.name: p for p in pictures_of_two(self.gap, alone, together, footing(found))}

    def page(self) -> dict[str, Any]:
        page = page_of(self, "The simulation and the other mode", self.records)
        more = [TextTable("One coordinate and two", footing_table(self.interaction))]
        more += [TextTable("Coefficients", self.fit.table())]
        return {**page, "tables": [*page["tables"], *more]}


# The same mode in two records: its small frequencies differ by less, as a ratio.
_SAME = 1.2
# So many other vibrations are tried, the loudest first: a faint one may be a combination of two.
_MOST = 2

_Heard = tuple[Vibration, list[Vibration]]  # that of the model, and those beside it


class _Ringing(NamedTuple):
    """The vibration of a model and another one, and the numbers of the records that hold both."""

    own: Vibration
    other: Vibration
    numbers: tuple[int, ...]


def with_other_mode(
    report: DiagnosisReport, options: Options
) -> DiagnosisReport | InteractionReport:
    """The report; or what another mode explains, where what one coordinate explains is in doubt."""
    unknown = report.verdict == "unknown"
    if report.interrupted or not (unknown or _in_doubt(report)):
        return report
    open_ = unknown or report.gap.after > LEFT_OVER
    model, notes = report.nominal if open_ else report.model, []
    for ringing in _ringing(report.records)[:_MOST]:
        decays = [_at_rest(report.records[i].decay) for i in ringing.numbers]
        own, other, _ = ringing
        found = interaction_of(model, decays, own, other, options.floor, options.progress)
        if found is None:
            notes.append(
                f"a mode at {other.small_frequency:.4g} Hz rings along; no equations of both"
                " modes were found that follow the records, so that its part is not known."
            )
            continue
        if found.takes_part and found.fit is not None:
            gap = _gap(report.nominal, report.records, ringing.numbers, found)
            return InteractionReport.of(report, found, found.fit, gap)
        notes.append(rings_along(found))
    return replace(report, notes=tuple(notes)) if unknown else report


def _in_doubt(report: DiagnosisReport) -> bool:
    """Whether what stands for another vibration explains the records beside other effects alone.

    Or whether it leaves much, although that is tolerated: a mode in resonance comes and goes.
    """
    names = {part.effect.name for part in report.best.effects}
    beside = {"second_mode"} | look_alikes("second_mode", CATALOGUE)
    found = report.verdict in ("named", "ambiguous")
    much = len(names) > 1 or report.gap.after > LEFT_OVER
    return found and much and bool(names & beside)


def _ringing(records: Sequence[Record]) -> list[_Ringing]:
    """What rings beside the vibration of the model, the loudest first."""
    heard = [_heard(record) for record in records]
    pairs = [(own, other) for own, others in filter(None, heard) for other in others]
    found: list[_Ringing] = []
    for own, other in sorted(pairs, key=lambda pair: -pair[1].share):
        if not any(_same(other, known.other) for known in found):
            numbers = (i for i, of in enumerate(heard) if of and _holds(of, own, other))
            found.append(_Ringing(own, other, tuple(numbers)))
    return found


def _holds(heard: _Heard, own: Vibration, other: Vibration) -> bool:
    """Whether what was heard of a record has both vibrations."""
    return _same(own, heard[0]) and any(_same(other, v) for v in heard[1])


def _heard(record: Record) -> _Heard | None:
    """The vibration of the model, and those that decay beside it."""
    decay = _at_rest(record.decay)
    every = find_vibrations(decay.signal, decay.dt, decay.derivative)
    found = [v for v in every if not (v.steady or v.faint)]
    if not found:
        return None
    hz = record.rate / (2 * np.pi)
    own = min(found, key=lambda v: abs(np.log(v.mean_frequency / hz)))
    return own, [v for v in found if v is not own]


def _same(a: Vibration, b: Vibration) -> bool:
    return 1 / _SAME < a.small_frequency / b.small_frequency < _SAME


def _at_rest(decay: Decay) -> Decay:
    """Free of an offset, as all that rings is looked for."""
    if decay.measured != "displacement":
        return replace(decay, stage="free")
    return replace(decay, q=decay.q - rest_level(decay.q, decay.dt), stage="free")


def _gap(
    model: ReducedModel, records: Sequence[Record], numbers: Sequence[int], found: Interaction
) -> Gap:
    """Before and after, on the records in which both ring: nothing of them was held out."""
    predictions = []
    for i, left in zip(numbers, found.longest.residuals, strict=True):
        whole = replace(records[i], part=None)
        before = predict(model, (), whole, name_of(i)).before
        predictions.append(Prediction(whole, before, whole.signal - left, name_of(i)))
    return Gap(tuple(predictions), unseen=False)
