"""The equations of driven records: the terms they need, and their values.

Terms are chosen by what each gains on stretches of the records that are left out in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from romsindy.effects.choices import KINDS, sought
from romsindy.effects.choices import candidates as coupled_candidates
from romsindy.fit.adequacy.verdicts import ForcedAdequacy
from romsindy.fit.choice import Gram, Linearised, Trials, dragged
from romsindy.fit.forced.refine import Look, decided
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError
from romsindy.fit.kernel.gauss_newton import linear_table
from romsindy.fit.kernel.hypothesis import free_parts
from romsindy.fit.kernel.part import LINEAR, Coefficient
from romsindy.fit.records.arguments import (
    free_names,
    listed_records,
    require_known,
    require_unit,
    small_frequencies,
)
from romsindy.fit.records.driven import inputs_in
from romsindy.fit.records.modes import Modes, mode_beside, modes_near, modes_of
from romsindy.fit.records.smooth import ways
from romsindy.fit.results.estimate import possible, stand_ins
from romsindy.fit.results.fitted import Fit, with_choice_error
from romsindy.fit.verdict import WIDEST_SIGNAL
from romsindy.physics.coupled import linear_terms
from romsindy.physics.equations import inputs_of, without_inputs
from romsindy.physics.inertia import Inertia
from romsindy.physics.input import Input
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.prediction import innovation
from romsindy.record.recording import Given
from romsindy.record.ringing import require_channels
from romsindy.text import percent
from romsindy.typing import Array

_ROUNDS = 5  # of choosing terms about the motions of those chosen before
_FAR = 0.05  # of the response, that a linear fit leaves which tells no terms
_LOST = 2.0  # times as much left as before: no choice of terms does that
_STRETCHES = 8  # in all, each left out in turn


def identify_forced(
    records: ForcedVibration | Sequence[ForcedVibration | Decay],
    order: int = 5,
    coordinates: int | str = 1,
    *,
    fixed: Mapping[str, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Identify the equations of motion from records with measured inputs, and decays beside them.

    Coefficients, gain and delay of each input, offsets of the sensors and initial states are fitted
    by simulation over the whole records. Terms are chosen by what each gains on stretches that took
    no part. What the input does between its samples is decided by the records, unless they say it.
    Arguments as those of `romsindy.identify`; the last terms of the model are the inputs. An input
    that looks like the displacement of the base is refused.
    """
    several, known = listed_records(records), dict(fixed or {})
    driven = Given.of(several).driven
    if not driven:
        raise ValueError("records hold no ForcedVibration: free decays alone are for identify()")
    require_unit(several, several[0].unit)
    say = progress or (lambda _: None)
    one = coordinates == 1 and all(v.n_channels == 1 for v in several)
    require_channels(several, several[0].n_channels)
    asked = order, known, say
    best, look = _searched(several, None if one else modes_of(driven, coordinates), *asked)
    if coordinates == "auto" and (other := _other(best)):
        # A motion that is strongly nonlinear hides a mode from a linear look.
        own = 2 * np.pi * float(small_frequencies(best.model)[0])
        say(f"another coordinate near {other[0] / (2 * np.pi):.4g} Hz")
        with suppress(TrajectoryError):
            more = _searched(
                several, modes_near(driven, np.sort([own, other[0]])).ordered(), *asked
            )
            if more[0].verdict.explained or _lost(best, more[0]):
                best, look = more
    notes = (*_beside(best), *best.notes, *stand_ins(best), *_hidden(best, look))
    return replace(best, notes=notes)


def _searched(
    several: Sequence[ForcedVibration | Decay],
    modes: Modes | None,
    order: int,
    known: Mapping[str, float],
    say: Callable[[str], None],
) -> tuple[Fit, Look]:
    """The equation of one coordinate, or of some modes, with the terms of the plainest kind."""
    if modes is None or (len(modes.omega) == 1 and modes.shapes.size == 1):
        modes = None
        kinds, linear = [candidates(order)], LINEAR
    else:
        r = len(modes.omega)
        kinds, linear = [coupled_candidates(r, kind) for kind in KINDS], linear_terms(r)
    require_known(known, [t.key for t in (*linear, *kinds[-1])])
    look = Look.of(several, modes)
    for laws in kinds:
        search = _TermSearch(laws, linear, known, look, say)
        best = _best(search, Given.of(several).driven)
        if best.verdict.explained:
            break
    return with_choice_error(best, search.every_choice(best)), look


def _other(fit: Fit) -> tuple[float, float] | None:
    """Rate of a further mode, rad/s, and the part that it explains of what one coordinate leaves.

    None where there is none, or several are modelled, or nothing is left.
    """
    verdict = fit.verdict
    assert isinstance(verdict, ForcedAdequacy)
    if verdict.explained or fit.model.n_coordinates > 1:
        return None
    pairs = [(r, e) for r, e in zip(fit.records, fit.residuals, strict=True) if r.driven]
    rest = [replace(r.decay, y=r.by_channel(e).T.reshape(r.decay.y.shape)) for r, e in pairs]
    found = mode_beside(rest, 2 * np.pi * float(small_frequencies(fit.model)[0]))
    if found is None and verdict.part > WIDEST_SIGNAL:
        # The other mode may have led the fit astray, which then leaves both.
        found = mode_beside([r.decay for r, _ in pairs])
    return found


def _beside(fit: Fit) -> tuple[str, ...]:
    """That a further mode moves in what one coordinate leaves, and what to ask for."""
    found = _other(fit)
    if found is None:
        return ()
    return (
        f"another mode rings near {found[0] / (2 * np.pi):.4g} Hz: as a linear one under the inputs"
        f" it explains {percent(found[1])} of the power of what is left; ask for coordinates=2"
        " (on the command line --coordinates 2)",
    )


def _hidden(fit: Fit, look: Look) -> tuple[str, ...]:
    """That linear modes may be wrong where fewer channels than coordinates show them."""
    modes, verdict = look.modes, fit.verdict
    assert isinstance(verdict, ForcedAdequacy)
    if modes is None or len(modes.shapes) >= len(modes.omega):
        return ()
    if verdict.explained or verdict.part < WIDEST_SIGNAL:
        return ()
    hertz = ", ".join(f"{w / (2 * np.pi):.4g} Hz" for w in modes.omega)
    return (
        f"fewer channels than coordinates ({len(modes.shapes)} and {len(modes.omega)}) are told"
        f" apart by their linear modes, found at {hertz}, and a strongly nonlinear motion hides"
        " these: give a channel for each coordinate, a smaller motion, or refine() a model that is"
        " near",
    )


def _best(search: _TermSearch, driven: Sequence[ForcedVibration]) -> Fit:
    """With the terms that are needed, whatever the inputs do between their samples."""
    hypotheses = [inputs_in(driven, way) for way in ways(driven)]
    needed, search = search.needed(hypotheses[0])
    best = search.decided(needed, hypotheses)
    inputs = inputs_of(best.model)
    if inputs[0].interpolation != hypotheses[0][0].interpolation:
        # Terms that were chosen with another input may stand for what was wrong with it.
        needed, search = search.needed(inputs_in(driven, inputs[0].interpolation))
        best = search.decided(needed, hypotheses)
    # They were chosen about motions that the fit has left.
    present = [t for t in search.candidates if t.key in best.model.coefficients]
    kept = possible(best, present)
    return best if kept == present else search.decided(kept, hypotheses)


@dataclass(frozen=True)
class _TermSearch:
    """For the terms that records need, among some laws; ``fixed`` coefficients are known."""

    laws: tuple[Term, ...]
    linear: tuple[Term, ...]
    fixed: Mapping[str, float]
    look: Look
    say: Callable[[str], None]

    def decided(self, terms: Sequence[Term], hypotheses: Sequence[Sequence[Input]]) -> Fit:
        """With some terms, and whatever the inputs do between their samples."""
        fits = []
        for inputs in hypotheses:
            self.say(f"{inputs[0].interpolation} input")
            fits.append(self.fitted(terms, inputs))
        return decided(fits, self.look.records)

    @property
    def candidates(self) -> list[Term]:
        """Laws that may be left out."""
        return [t for t in self.laws if t.key not in self.fixed]

    def every_choice(self, fit: Fit) -> Linearised:
        """All candidates about the motions of a fit."""
        return linearised(fit, fit.solution.motions, self.candidates, left_out=False)

    def needed(self, inputs: Sequence[Input]) -> tuple[tuple[Term, ...], _TermSearch]:
        """Those of the laws that are needed, about the motions of those found before.

        And the search from motions that do not lead them astray.
        """
        search, (fit, kept) = self, self.started(inputs)
        motions = [r.motion for r in fit.records]
        for number in range(_ROUNDS):
            self.say(f"terms, round {number + 1}")
            new = needed_terms(fit, motions, self.candidates)
            if new == kept:
                break
            try:
                after = search.fitted(new, inputs)
                if _lost(after, fit):
                    search = self.about(motions)
                    after = search.fitted(new, inputs)
            except TrajectoryError:  # chosen about motions that are too far off
                break
            if _lost(after, fit):
                break
            fit, kept, motions = after, new, list(after.solution.motions)
        return kept, search

    def started(self, inputs: Sequence[Input]) -> tuple[Fit, tuple[Term, ...]]:
        """Linear terms alone, or where these lose the motion those of the commonest bend beside."""
        plain, cubic = self.fitted((), inputs), tuple(t for t in self.laws if t == Stiffness(3))
        if cubic and plain.verdict.part > _FAR:
            with suppress(TrajectoryError):
                bent = self.fitted(cubic, inputs)
                if _lost(plain, bent):
                    return bent, cubic
        return plain, ()

    def about(self, motions: Sequence[Trajectory]) -> _TermSearch:
        """The same from other motions than those that were measured, where none are pieces."""
        records = self.look.records
        if len(motions) != len(records):
            return self
        near = tuple(r.with_motion(m) for r, m in zip(records, motions, strict=True))
        return replace(self, look=self.look._replace(records=near))

    def fitted(self, terms: Sequence[Term], inputs: Sequence[Input]) -> Fit:
        """From values by regression on the smooth motions, or those of linear modes."""
        known = [t for t in self.laws if t.key in self.fixed]
        own = tuple({t.key: t for t in (*self.linear, *known, *terms)}.values())
        model = self.look.model(own, inputs, self.fixed)
        return self.look.fit(free_names(without_inputs(model), self.fixed), model)


def _lost(fit: Fit, before: Fit) -> bool:
    """Whether a fit found another motion than the one before it, and a worse one."""
    parts = [f.verdict.part for f in (fit, before) if isinstance(f.verdict, ForcedAdequacy)]
    return parts[0] > _LOST * parts[1]


def stiffness_to(order: int) -> list[Term]:
    """Powers of the displacement from the second to this one.

    Raises a ValueError if the order is below 1.
    """
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < 1:
        raise ValueError(f"order = {order!r} must be a whole number, 1 or more")
    return [Stiffness(m) for m in range(2, order + 1)]


def candidates(order: int) -> tuple[Term, ...]:
    """Stiffness and inertia up to an order, and damping."""
    stiffness = stiffness_to(order)
    return (*stiffness, *sought("driven"), *[Inertia(k) for k in range(3, order + 1)])


def needed_terms(
    fit: Fit, motions: Sequence[Trajectory], several: Sequence[Term]
) -> tuple[Term, ...]:
    """Those of several terms that are needed beside the linear ones, about motions near a fit."""
    found = linearised(fit, motions, several)
    chosen = {found.name(g) for g in found.trials.chosen([])}
    return tuple(t for t in several if t.key in chosen)


def linearised(
    fit: Fit, motions: Sequence[Trajectory], several: Sequence[Term], *, left_out: bool = True
) -> Linearised:
    """All of several terms beside the linear ones, about motions near the records of a fit.

    Inputs, mode shapes and offsets are fitted beside any choice, as initial states are. What the
    fit holds fixed stays. Stretches are ``left_out`` in turn, or all data are one part.
    """
    model = without_inputs(fit.model)
    more = [p for p in fit.solution.parts if not isinstance(p.effect, Coefficient)]
    present = model.coefficients
    others = tuple(t for t in several if t.key not in present)
    wide = replace(
        model, terms=(*model.terms, *others), values=(*model.values, *np.zeros(len(others)))
    )
    linear = linear_terms(model.n_coordinates) if model.numbered else LINEAR
    always = [t for t in linear if t.key in fit.free]
    terms = tuple({t.key: t for t in (*always, *several)}.values())
    at = np.array([wide.coefficients[t.key] for t in terms])
    wide, own = free_parts(wide, [t.key for t in terms], fit.records)
    parts = (*own, *more)
    tables = [
        record.by_channel(linear_table(wide, parts, i, record, motion)[1])
        for i, (record, motion) in enumerate(zip(fit.records, motions, strict=True))
    ]
    total, grams = sum(table.shape[1] for table in tables), []
    for table in tables:
        pieces = max(round(_STRETCHES * table.shape[1] / total), 2)
        driven = np.concatenate([innovation(left)[0] for left in _left(table)])
        rows = table.swapaxes(0, 1).reshape(-1, table.shape[2])  # all channels of a time together
        grams += _stretches(rows / float(np.sqrt(np.mean(driven**2))), at, pieces)
    groups = dict(enumerate(terms[len(always) :]))
    trials = Trials.of(
        grams if left_out else [Gram.sum(grams)],
        range(len(always)),
        [[len(always) + g] for g in groups],
        groups,
        dragged(list(groups.values()), motions),
    )
    return Linearised(trials, (), terms, [g for g, law in groups.items() if law.key in present])


def _left(table: Array) -> Array:
    """What a fit of all candidates leaves of the misfit in the last column, (c, n) of (c, n, m)."""
    rows = table.reshape(-1, table.shape[2])
    scaled = rows[:, :-1] / np.maximum(np.linalg.norm(rows[:, :-1], axis=0), 1e-300)
    left = rows[:, -1] - scaled @ np.linalg.lstsq(scaled, rows[:, -1], rcond=None)[0]
    return left.reshape(table.shape[:2])


def _stretches(rows: Array, at: Array, pieces: int) -> list[Gram]:
    """A record in stretches; values beside the coefficients are fitted to all of it first."""
    m = len(at)
    nuisance = rows[:, m:-1]
    scale = np.maximum(np.linalg.norm(nuisance, axis=0), 1e-300)
    basis = np.linalg.svd(nuisance / scale, full_matrices=False)[0]
    clean = np.column_stack([rows[:, :m], rows[:, -1]])
    clean = clean - basis @ (basis.T @ clean)
    return [Gram.of(part, at) for part in np.array_split(clean, pieces)]
