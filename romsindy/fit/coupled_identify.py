"""Identify the equations of several coordinates from free decays.

The vibrations that ring say how many coordinates there are, how fast and how damped small motions
are. Candidates are chosen by what they gain on data that took no part (`romsindy.fit.
coupled_terms`), about the measured motion first and then about that of the model, until the choice
stays. No ratio of frequencies is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.fit.adequacy import examine
from romsindy.fit.coefficient import extended, free_coefficients
from romsindy.fit.collocation import Trajectory
from romsindy.fit.coupled_record import (
    CoupledRecord,
    coupled_records,
    free_shapes,
    tones_of,
)
from romsindy.fit.coupled_terms import KINDS, Gram, Kind, candidates, chosen, linear_terms, needed
from romsindy.fit.gauss_newton import Solution, fit, linear_table
from romsindy.fit.part import Part
from romsindy.fit.refine import NUMERICS, Fit, refined, require_unit, several_decays
from romsindy.fit.verdict import MODE, TERM
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import Along, SlavedInertia
from romsindy.physics.inertia import AddedMass
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.vibrations import Vibration
from romsindy.typing import Array

# Choices and fits; the first start from a motion that is not yet the model's, and so may be worse.
_ROUNDS, _PATIENCE = 12, 1
# Parts of the data that are left out in turn. With fewer records than the first, stretches of them
# are: so many, dealt out in turn, so that each part spans the amplitudes.
_FEWEST_RECORDS, _PARTS, _STRETCHES = 4, 4, 24


def identify_coupled(
    decays: Decay | Sequence[Decay],
    coordinates: int | str = "auto",
    *,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Identify a model of the vibrations that ring together, with the terms that the data need.

    Parameters
    ----------
    decays : Decay or sequence of Decay
        One channel or several, in one unit; the free part is used, in the quantity that was
        measured.
    coordinates : int or "auto"
        How many vibrations are modelled: the strongest, or as many as the data need.
    progress : callable, optional
        Called with a line of text at every step.

    Returns
    -------
    Fit
        As `refine` gives it: model, errors, mode shapes at the channels, verdict.

    Raises
    ------
    ValueError
        If fewer vibrations ring than coordinates are asked for.
    TrajectoryError
        If no motion of the model follows the measured one.
    """
    say = progress or (lambda line: None)
    several = several_decays(decays)
    require_unit(several, several[0].unit)
    free = [decay.free() for decay in several]
    ringing, fewest = _ringing(free, coordinates)
    best: _Found | None = None
    # Tall and narrow matrices: threads of the linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        for count in range(fewest, len(ringing) + 1):
            found = _identified(ringing[:count], free, say)
            # A further coordinate must be needed: harmonics and combinations look like one.
            if best is not None and not found.left < (1 - MODE) * best.left:
                break
            best = found
            if best.explained:
                break
    assert best is not None
    names = tuple(best.model.coefficients)
    return refined(best.model, names, best.records, free_shapes(best.records), progress=progress)


def _ringing(decays: Sequence[Decay], coordinates: int | str) -> tuple[list[Vibration], int]:
    """What may be modelled, strongest first, and how many at least; of the richest channel."""
    channels = [
        tones_of(x, d.dt, d.derivative) for d in decays for x in d.signal.reshape(len(d.t), -1).T
    ]
    most = max(channels, key=lambda found: (len(found), sum(v.share for v in found)))
    heard = ", ".join(f"{v.mean_frequency:.4g} Hz" for v in most) or "nothing"
    if coordinates == "auto" and most:
        return most, min(2, len(most))
    if isinstance(coordinates, bool) or not isinstance(coordinates, int) or coordinates < 1:
        raise ValueError(
            f"coordinates = {coordinates!r}: give 'auto' or a whole number of at least 1; what"
            f" rings is {heard}"
        )
    if coordinates > len(most):
        raise ValueError(
            f"coordinates = {coordinates}, but {len(most)} vibrations ring in the record ({heard}):"
            " ask for as many at most"
        )
    return most[:coordinates], coordinates


def _linear(ringing: Sequence[Vibration], unit: str | None) -> CoupledModel:
    """Frequencies and damping of small vibrations, as the quietest third of each shows them."""
    values: list[float] = []
    for v in ringing:
        quiet = np.argsort(v.tone.amplitude)[: max(len(v.frequency) // 3, 1)]
        omega = 2 * np.pi * float(v.frequency[quiet].mean())
        zeta = v.damping_ratio[1]
        values += [omega**2, 2 * zeta * omega if zeta > 0 else 0.0]
    return CoupledModel(linear_terms(len(ringing)), tuple(values), unit)


@dataclass(frozen=True)
class _Stage:
    """What has been found so far: the model, its mode shapes at the channels, its motions."""

    model: CoupledModel
    shapes: tuple[Part, ...]
    motions: tuple[Trajectory, ...]


class _Found(NamedTuple):
    """A model, what its fit leaves of the decays over their noise, and whether that is noise.

    The records have the motions and mode shapes of the fit.
    """

    model: CoupledModel
    records: tuple[CoupledRecord, ...]
    left: float
    explained: bool


def _identified(
    strongest: Sequence[Vibration], decays: Sequence[Decay], say: Callable[[str], None]
) -> _Found:
    """The model of some vibrations, with candidates of the plainest kind that explains them."""
    ringing = sorted(strongest, key=lambda v: v.mean_frequency)
    linear = _linear(ringing, decays[0].unit)
    frequency = np.array([v.mean_frequency for v in ringing])
    say(f"coordinates at {', '.join(f'{f:.5g} Hz' for f in frequency)}")
    records = coupled_records(decays, frequency, NUMERICS)
    start = _Stage(linear, free_shapes(records), tuple(r.motion for r in records))
    found: list[_Found] = []
    for kind in KINDS:
        found.append(_with_terms(start, records, kind, say))
        if found[-1].explained:
            return found[-1]
    return min(found, key=lambda f: f.left)


def _with_terms(
    now: _Stage, given: Sequence[CoupledRecord], kind: Kind, say: Callable[[str], None]
) -> _Found:
    """The model with the terms that the records need, fitted to them."""
    records, failures, linear = tuple(given), 0, now
    best: tuple[CoupledModel, Solution] | None = None
    for number in range(_ROUNDS):
        start = _chosen(now, records, kind)
        if start is None:  # the model so far runs away from its motions: a linear one does not
            start, failures = replace(linear, motions=now.motions), failures + 1
        more = start.model.terms[2 * start.model.n_coordinates :]
        say(f"terms: {', '.join(t.key for t in more) or 'none beside the linear ones'}")
        solution, now = _fitted(start, records, measured=number == 0)
        if not (solution.finite and _has_masses(now.model)):
            solution, now = _fitted(linear, records, measured=True)
        if best is None or _is_better(now.model, solution, *best, records):
            settled = best is not None and _is_alike(solution, best[1], records)
            best, failures = (now.model, solution), 0
            records = _weighed_alike(records, solution)
        else:
            settled, failures = False, failures + 1
        if settled or failures > _PATIENCE:
            break
    assert best is not None
    model, solution = best
    explained = examine(given, solution.residuals, solution.n_values).explained
    moved = tuple(
        replace(r, motion=m, shapes=r.read(solution.parts, i, m.q[:1]).slope)
        for i, (r, m) in enumerate(zip(given, solution.motions, strict=True))
    )
    return _Found(model, moved, float(np.sqrt(np.mean(_left(given, solution)))), explained)


def _left(records: Sequence[CoupledRecord], solution: Solution) -> Array:
    """Squares of what a fit leaves of all records, over their noise."""
    pairs = zip(records, solution.residuals, strict=True)
    return np.concatenate([record.whitened(residual) ** 2 for record, residual in pairs])


def _is_better(
    model: CoupledModel,
    solution: Solution,
    before: CoupledModel,
    former: Solution,
    records: Sequence[CoupledRecord],
) -> bool:
    """Whether the terms of a fit are worth more than those of the one before."""
    now, then = _left(records, solution), _left(records, former)
    more = len(model.terms) - len(before.terms)
    least = min(now.sum(), then.sum())
    return bool(then.sum() - now.sum() > more * needed(then.size, least, 1))


def _is_alike(solution: Solution, former: Solution, records: Sequence[CoupledRecord]) -> bool:
    """Whether a fit leaves about as much as the one before, which another round would do, too."""
    return bool(_left(records, solution).sum() > (1 - TERM) * _left(records, former).sum())


def _chosen(now: _Stage, records: Sequence[CoupledRecord], kind: Kind) -> _Stage | None:
    """The linear terms, and candidates that gain on data that took no part, about the motions.

    Values are those of the linearised equations: where a fit is to start. None where the equations
    have no motions near these.
    """
    r = now.model.n_coordinates
    values = now.model.coefficients
    everything = (*linear_terms(r), *candidates(r, kind))
    at = np.array([values.get(t.key, 0.0) for t in everything])
    model = CoupledModel(everything, tuple(at), now.model.unit)
    free = free_coefficients(model, [t.key for t in everything])
    parts = (*now.shapes, *free)
    found = np.concatenate([[p.values[0] for p in now.shapes], at])
    n = len(now.shapes)
    least = {n + i: low for i, t in enumerate(everything) if (low := _least(t)) is not None}
    with np.errstate(all="ignore"):
        tables = [
            linear_table(model, parts, i, record, motion)[1]
            for i, (record, motion) in enumerate(zip(records, now.motions, strict=True))
        ]
    if not all(np.all(np.isfinite(table)) for table in tables):
        return None
    pieces = [Gram.of(rows, found) for table in tables for rows in _pieces(table, records)]
    kept, start = chosen(pieces, n + 2 * r, least)
    terms = tuple(everything[i - n] for i in kept[n:])
    shapes = tuple(
        replace(p, strengths=np.full((1, 1), v)) for p, v in zip(now.shapes, start, strict=False)
    )
    return _Stage(CoupledModel(terms, tuple(start[n:]), now.model.unit), shapes, now.motions)


def _has_masses(model: CoupledModel) -> bool:
    """Whether the inertia at rest is positive, as that of all masses."""
    inertia = model.inertia(np.zeros(model.n_coordinates))
    return bool(np.linalg.eigvalsh(inertia)[0] > 0)


def _least(term: Term) -> float | None:
    """What its coefficient must exceed: squares and masses are positive."""
    if isinstance(term, SlavedInertia) and term.first == term.second:
        return 0.0
    return -1.0 if isinstance(term, Along) and isinstance(term.law, AddedMass) else None


def _pieces(table: Array, records: Sequence[CoupledRecord]) -> list[Array]:
    """The rows of a record, or of parts of it that all span its amplitudes."""
    if len(records) >= _FEWEST_RECORDS:
        return [table]
    n = len(table) // len(records[0].noise)  # of every channel
    stretch = np.arange(len(table)) % n * _STRETCHES // n
    return [table[stretch % _PARTS == k] for k in range(_PARTS)]


def _fitted(
    start: _Stage, records: Sequence[CoupledRecord], measured: bool
) -> tuple[Solution, _Stage]:
    """The model fitted, from the measured motions or from those of the stage before."""
    names = list(start.model.coefficients)
    parts = (*free_coefficients(start.model, names), *start.shapes)
    solution = fit(start.model, parts, records, None if measured else start.motions)
    shapes = solution.parts[len(names) :]
    return solution, _Stage(extended(start.model, solution.parts), shapes, solution.motions)


def _weighed_alike(
    records: Sequence[CoupledRecord], solution: Solution
) -> tuple[CoupledRecord, ...]:
    """Records with the noise that they have, or with what the model leaves where that is more.

    Where the form of the model decides, no record may decide alone because its noise is least.
    """
    left = [
        float(np.sqrt(np.mean(record.whitened(e) ** 2)))
        for record, e in zip(records, solution.residuals, strict=True)
    ]
    return tuple(r.louder(max(x, 1.0)) for r, x in zip(records, left, strict=True))
