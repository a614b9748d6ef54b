"""Identify the equations of several coordinates from free decays.

The vibrations that ring say how many coordinates there are, how fast and how damped small motions
are. Candidates are chosen by what they gain on data that took no part
(`romsindy.fit.choice`), about the measured motion first and then about that of the model,
until the choice stays. No ratio of frequencies is asked for.

Vibrations that are close in frequency beat where they are large and exchange energy, and what is
followed of each in the channels is wrong there. Where they are quieter it is right. A model of the
quiet part has a motion before it, too: stride by stride that is taken as the motion from which a
longer part is fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.effects.choices import KINDS, Kind, candidates
from romsindy.fit.coupled.rounds import (
    Choice,
    FittedPieces,
    Progress,
    Stage,
    best_of,
    every_choice,
    of_plainest_kind,
    settled,
)
from romsindy.fit.kernel.collocation import TrajectoryError, integrate
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.shooting import cut, moved, shortest
from romsindy.fit.records.arguments import (
    require_known,
    require_unit,
    several_decays,
    small_frequencies,
)
from romsindy.fit.records.coupled import CoupledRecord, coupled_records, curved_shapes, free_shapes
from romsindy.fit.records.modes import modes_of
from romsindy.fit.records.record import NUMERICS, mixture
from romsindy.fit.results.estimate import stand_ins
from romsindy.fit.results.fitted import Fit, examined, refined, with_choice_error
from romsindy.fit.verdict import MODE
from romsindy.physics.coupled import CoupledModel, linear_model, linear_terms
from romsindy.physics.coupling import CoupledTerm
from romsindy.physics.equations import SingularInertiaError
from romsindy.physics.integration import EscapeError
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Given
from romsindy.record.ringing import LOUD, NEAR, beside, names_of, ringing_in
from romsindy.record.vibrations import Vibration
from romsindy.typing import Array

_TIMES = 50  # of a stride: its end alone is asked for


def identify_coupled(
    decays: Decay | Sequence[Decay],
    coordinates: int | str = "auto",
    *,
    fixed: Mapping[str, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Identify a model of the vibrations that ring together, with the terms that the data need.

    Arguments as those of `romsindy.identify`; ``coordinates`` are the strongest vibrations, or as
    many as the data need. After an interrupt (Ctrl-C) the best of what had been tried.
    """
    say = progress or (lambda line: None)
    several = several_decays(decays)
    require_unit(several, several[0].unit)
    free = [decay.free() for decay in several]
    ringing, fewest = _ringing(free, coordinates)
    known = dict(fixed or {})
    require_known(known, [*_laws(fewest)])
    best: FittedPieces | None = None
    kept: list[FittedPieces] = []  # of the present coordinates
    interrupted = False
    # Tall and narrow matrices: threads of the linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            for count in range(fewest, len(ringing) + 1):
                if best is not None and not _loud_enough(ringing[count - 1], best):
                    break
                kept.clear()
                told = Progress(say, kept.append)
                found = _identified(ringing[:count], free, known, told)
                if found is None or not found.explained:
                    found = _from_quieter(free, count, known, told) or found
                # A further coordinate must be needed: harmonics and combinations look like one.
                if best is not None and not (found and _needed(found, best)):
                    break
                best = found
                if best is not None and best.explained:
                    best = _in_order(best, known, told)
                    break
        except KeyboardInterrupt:
            best, interrupted = best or best_of(kept), True
            if best is None:
                raise
    if best is None:
        raise TrajectoryError(
            f"no model of {len(ringing)} coordinates has a motion near the measured one: take"
            " quieter parts of the decays, by decay.between(start, end), or decays of less"
            " amplitude"
        )
    stage, names = best.stage, tuple(best.stage.free)
    records = _with_tones_of(stage.model, best.records, free)
    pieces = tuple(piece for record in records for piece in cut(record, best.cycles))
    fit = refined(stage.model, names, pieces, stage.shapes, settled=True, progress=progress)
    fit = fit if best.cycles < np.inf or best.misses else examined(fit)
    model = replace(stage.model, values=fit.model.values)
    reached = replace(stage, model=model, shapes=fit.solution.parts[len(names) :])
    every = every_choice(reached, moved(pieces, fit.solution.motions))
    fit = with_choice_error(fit, every) if every else fit
    solution = replace(fit.solution, interrupted=fit.solution.interrupted or interrupted)
    both = max(beside(decay, small_frequencies(fit.model)) for decay in free)
    notes = (*fit.notes, *_notes(best, fit.curved_shapes, interrupted), *mixture(both))
    notes = (*notes, *stand_ins(fit))
    return replace(fit, solution=solution, notes=notes)


def model_with_terms(
    records: Sequence[Decay | ForcedVibration],
    coordinates: int | str,
    terms: Sequence[Term],
    fixed: Mapping[str, float],
) -> CoupledModel:
    """The small vibrations that ring, or are driven, with terms beside them: 0, or what is known.

    Raises a ValueError if the number of coordinates is not given, a term is of one coordinate
    without saying of which, or for names or values in ``fixed`` that cannot be.
    """
    if not isinstance(coordinates, int):
        raise ValueError(f"coordinates = {coordinates!r} must be a number where terms are given")
    wrong = [t for t in terms if not isinstance(t, CoupledTerm)]
    if wrong:
        raise ValueError(
            f"terms hold {wrong}, and there are {coordinates} coordinates: say which coordinate"
            " each is of, as Along.coordinate(Stiffness(3), 1) of romsindy.physics.coupling"
        )
    unit = records[0].unit
    if driven := Given.of(records).driven:
        modes = modes_of(driven, coordinates)
        linear = linear_model(modes.omega, modes.ratios, unit)
    else:
        decays = [d.free() for d in several_decays(records)]
        linear = _small(_ringing(decays, coordinates)[0], unit)
    by_name = {t.key: t for t in (*linear_terms(coordinates), *terms)}
    require_known(fixed, [*by_name])
    values = dict.fromkeys(by_name, 0.0) | linear.coefficients | dict(fixed)
    return replace(linear, terms=tuple(by_name.values()), values=tuple(values.values()))


def _from_quieter(
    decays: Sequence[Decay], count: int, fixed: Mapping[str, float], progress: Progress
) -> FittedPieces | None:
    """Where vibrations beat: the model of the quieter parts, followed back to the start."""
    for part in LOUD:
        quieter = [d.between(d.t[0] + part * (d.t[-1] - d.t[0])) for d in decays]
        strongest = ringing_in(quieter)[:count]
        rates = np.sort([v.small_frequency for v in strongest])
        if len(strongest) < count or np.all(rates[1:] >= NEAR * rates[:-1]):
            continue
        progress.say(f"from {100 * part:.0f} per cent of the decays on")
        silent = progress._replace(keep=lambda _: None)
        quiet = _identified(strongest, quieter, fixed, silent)
        if quiet and quiet.explained:
            return followed_back(quiet, decays, progress)
    return None


def _with_tones_of(
    model: CoupledModel, records: Sequence[CoupledRecord], decays: Sequence[Decay]
) -> list[CoupledRecord]:
    """With tones near the small vibrations of the model, where the first look saw shorter ones."""
    frequencies = small_frequencies(model)
    found = []
    for record, decay in zip(records, decays, strict=True):
        heard = CoupledRecord.of(decay, frequencies, NUMERICS, record.main).tones
        pairs = zip(record.tones, heard, strict=True)
        tones = tuple(
            max(pair, key=lambda t: t.end - t.start if np.any(t.amplitude) else 0.0)
            for pair in pairs
        )
        found.append(replace(record, tones=tones))
    return found


def _loud_enough(more: Vibration, best: FittedPieces) -> bool:
    """Whether as much of what is left may be one more vibration as a coordinate must explain.

    Of pieces nobody knows: the motion may be followed longer with it.
    """
    heard = sum(float(np.sum(r.signal**2)) for r in best.records)
    left = sum(float(np.sum(e**2)) for e in best.residuals) / heard
    return bool(best.cycles < np.inf or more.share > (1 - (1 - MODE) ** 2) * left)


def _needed(found: FittedPieces, before: FittedPieces) -> bool:
    """Whether a further coordinate is: with it the motion is followed longer, or much better."""
    longer = found.cycles > before.cycles
    return longer or found.left_over(before.records) < (1 - MODE) * before.left


def _notes(best: FittedPieces, products: Collection[str], interrupted: bool) -> list[str]:
    """What the reader must know of how it was found."""
    notes = ["interrupted: the best of what had been tried"] if interrupted else []
    if products:
        notes.append(f"sensors show products of coordinates as well: {', '.join(products)}")
    if best.cycles < np.inf:
        notes.append(
            f"the model follows the motion over pieces of {best.cycles:.0f} cycles of the slowest"
            " coordinate, not over the whole of the decays: it was fitted to such pieces, each from"
            " an initial state of its own"
        )
    return notes


def _ringing(decays: Sequence[Decay], coordinates: int | str) -> tuple[list[Vibration], int]:
    """What may be modelled, strongest first, and how many at least."""
    whole = not isinstance(coordinates, (str, bool)) and coordinates >= 1
    if coordinates != "auto" and not (whole and isinstance(coordinates, int)):
        raise ValueError(
            f"coordinates = {coordinates!r}: give 'auto' or a whole number of at least 1"
        )
    found = ringing_in(decays)
    if not found:
        raise ValueError("nothing rings in the decays: give records in which a vibration dies away")
    if not isinstance(coordinates, int):
        return found, min(2, len(found))
    if coordinates > len(found):
        raise ValueError(
            f"coordinates = {coordinates}, but what rings in the record is {names_of(found)}: ask"
            " for as many at most, or excite the others more; modes closer than their bandwidth"
            " ring as one"
        )
    return found[:coordinates], coordinates


def _small(several: Sequence[Vibration], unit: str | None) -> CoupledModel:
    """Small vibrations by frequency, as the quietest third of each shows them."""
    ringing = sorted(several, key=lambda v: v.small_frequency)
    omega = 2 * np.pi * np.array([v.small_frequency for v in ringing])
    return linear_model(omega, np.nan_to_num([v.small_damping_ratio for v in ringing]), unit)


def _laws(count: int) -> dict[str, CoupledTerm]:
    """All terms that so many coordinates may have, by name."""
    return {t.key: t for t in (*linear_terms(count), *candidates(count, KINDS[-1]))}


def _start(
    linear: CoupledModel, records: Sequence[CoupledRecord], fixed: Mapping[str, float]
) -> Stage:
    """Small vibrations, with what is known of the coefficients."""
    laws = _laws(linear.n_coordinates)
    known = [(laws[name], value) for name, value in fixed.items()]
    return Stage(linear.with_terms([*linear.pairs, *known]), free_shapes(records), tuple(fixed))


def _identified(
    strongest: Sequence[Vibration],
    decays: Sequence[Decay],
    fixed: Mapping[str, float],
    progress: Progress,
) -> FittedPieces | None:
    """The model of some vibrations."""
    ringing = sorted(strongest, key=lambda v: v.small_frequency)
    progress.say(f"coordinates at {names_of(ringing)}")
    records = coupled_records(decays, np.array([v.small_frequency for v in ringing]), NUMERICS)
    start = _start(_small(ringing, decays[0].unit), records, fixed)
    return of_plainest_kind(start, records, KINDS, progress)


def _in_order(found: FittedPieces, fixed: Mapping[str, float], progress: Progress) -> FittedPieces:
    """The same with its coordinates by frequency: close vibrations may have been mistaken."""
    model = found.stage.model
    order = np.argsort(small_frequencies(model))
    if np.all(np.diff(order) > 0):
        return found
    progress.say("coordinates by frequency")
    records = tuple(record.with_coordinates(order) for record in found.records)
    linear = linear_model(model.linear_modes[0], model.linear_damping_ratios, model.unit)
    again = of_plainest_kind(_start(linear, records, fixed), records, KINDS, progress)
    return again if again and again.explained else found


def followed_back(
    quiet: FittedPieces, decays: Sequence[Decay], progress: Progress
) -> FittedPieces | None:
    """A model of whole decays, from one that explains the last part of each.

    None where no motion of the model leads back to the start.
    """
    stage, frequencies = quiet.stage, small_frequencies(quiet.stage.model)
    whole = []
    for last, decay in zip(quiet.records, decays, strict=True):
        record = CoupledRecord.of(decay, frequencies, NUMERICS, last.main)
        whole.append(replace(record, shapes=last.shapes, noise=last.noise))
    r, stride = len(frequencies), shortest(frequencies)
    known = (t for t in stage.model.terms if t.key in stage.fixed)
    always = tuple(dict.fromkeys([*known, *linear_terms(r)]))
    choice = Choice(always, candidates(r, Kind(masses=True)), curved_shapes(whole[0]))
    states = [record.motion.start for record in quiet.records]
    times = [q.decay.t[0] - d.t[0] for q, d in zip(quiet.records, decays, strict=True)]
    records = tuple(quiet.records)
    while max(times) > 0:
        several = zip(whole, states, times, strict=True)
        try:
            earlier = [_earlier(stage.model, *each, stride / frequencies.min()) for each in several]
        except (EscapeError, SingularInertiaError, TrajectoryError):
            return None
        records = tuple(record for record, _ in earlier)
        best = settled(stage, records, choice, progress, stride)
        if best is None:
            return None
        stage, records, times = best.stage, best.records, [t for _, t in earlier]
        states = [record.motion.start for record in records]
    return of_plainest_kind(stage, records, KINDS, progress)


def _earlier(
    model: CoupledModel, whole: CoupledRecord, state: Array, time: float, stride: float
) -> tuple[CoupledRecord, float]:
    """A record from a stride (s) before a time on, with the motion that is in a state then."""
    grid = whole.motion.grid
    first = max(int(np.ceil((time - stride) / grid.step)), 0)
    since = first * grid.step
    record = whole.between_steps(first, whole.motion.grid.n_steps)
    before = state_before(model, state, time - since)
    motion = integrate(equation_of(model, (), 0, record), before, record.motion.grid)
    return replace(record, motion=motion), since


def state_before(model: CoupledModel, state: Array, seconds: float) -> Array:
    """The state so long before: damping drives a motion whose time runs backwards."""
    if seconds <= 0:
        return state
    values = (v if term.undamped() == term else -v for term, v in model.pairs)
    backwards = replace(model, values=tuple(values))
    q, q_dot = np.split(state, 2)
    past = backwards.simulate(q, -q_dot, np.linspace(0, seconds, _TIMES))
    return np.concatenate([past.q[-1], -np.asarray(past.q_dot)[-1]])
