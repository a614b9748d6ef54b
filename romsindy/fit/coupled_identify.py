"""Identify the equations of several coordinates from free decays.

The vibrations that ring say how many coordinates there are, how fast and how damped small motions
are. Candidates are chosen by what they gain on data that took no part (`romsindy.fit.
coupled_terms`), about the measured motion first and then about that of the model, until the choice
stays. No ratio of frequencies is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.fit.coefficient import extended, free_coefficients
from romsindy.fit.collocation import Trajectory
from romsindy.fit.coupled_record import CoupledRecord, coupled_records, free_shapes
from romsindy.fit.coupled_terms import Gram, candidates, chosen, linear_terms, needed
from romsindy.fit.gauss_newton import Solution, fit, linear_table
from romsindy.fit.part import Part
from romsindy.fit.refine import NUMERICS, Fit, refine, require_unit, several_decays
from romsindy.fit.verdict import EXPLAINED, MODE
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import CoupledTerm, SlavedInertia
from romsindy.record.decay import Decay
from romsindy.record.vibrations import Vibration, find_vibrations
from romsindy.typing import Array

_ROUNDS = 6  # of choices and fits
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
        How many vibrations are modelled: the strongest, or all that are no harmonics, no hum and
        no noise.
    progress : callable, optional
        Called with a line of text at every step.

    Returns
    -------
    Fit
        As `refine` gives it: model, errors, mode shapes at the channels, verdict.

    Raises
    ------
    ValueError
        If fewer vibrations ring than coordinates are asked for, or only one does.
    TrajectoryError
        If no motion of the model follows the measured one.
    """
    say = progress or (lambda line: None)
    several = several_decays(decays)
    require_unit(several, several[0].unit)
    free = [decay.free() for decay in several]
    ringing = _ringing(free, coordinates)
    fewest = len(ringing) if coordinates != "auto" else 2
    best: tuple[CoupledModel, float] | None = None
    # Tall and narrow matrices: threads of the linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        for count in range(fewest, len(ringing) + 1):
            model, left = _with_terms(ringing[:count], free, say)
            # A further coordinate must be needed: harmonics and combinations look like one.
            if best is not None and not left < (1 - MODE) * best[1]:
                break
            best = model, left
            if left < EXPLAINED:
                break
    assert best is not None
    return refine(best[0], free, progress=progress)


def _ringing(decays: Sequence[Decay], coordinates: int | str) -> list[Vibration]:
    """The vibrations to be modelled, strongest first: of the channel that shows most of them."""
    channels = [
        [v for v in find_vibrations(x, d.dt, d.derivative) if not (v.steady or v.faint)]
        for d in decays
        for x in d.signal.reshape(len(d.t), -1).T
    ]
    most = max(channels, key=lambda found: (len(found), sum(v.share for v in found)))
    heard = ", ".join(f"{v.mean_frequency:.4g} Hz" for v in most) or "none"
    wanted = len(most) if coordinates == "auto" else coordinates
    if isinstance(wanted, bool) or not isinstance(wanted, int) or wanted < 2:
        raise ValueError(
            f"coordinates = {coordinates!r}: give a whole number of at least 2, or 'auto' where at"
            f" least two vibrations ring (here: {heard}); identify() is for a single one"
        )
    if wanted > len(most):
        raise ValueError(
            f"coordinates = {wanted}, but {len(most)} vibrations ring in the record ({heard}): ask"
            " for as many at most"
        )
    return sorted(most, key=lambda v: -v.share)[:wanted]


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

    @property
    def linear(self) -> int:
        """How many values always take part."""
        return 2 * self.model.n_coordinates + len(self.shapes)


def _with_terms(
    strongest: Sequence[Vibration], decays: Sequence[Decay], say: Callable[[str], None]
) -> tuple[CoupledModel, float]:
    """The model with the terms that the decays need, and the rms over the noise that it leaves."""
    ringing = sorted(strongest, key=lambda v: v.mean_frequency)
    linear = _linear(ringing, decays[0].unit)
    frequency = np.array([v.mean_frequency for v in ringing])
    say(f"coordinates at {', '.join(f'{f:.5g} Hz' for f in frequency)}")
    records = given = coupled_records(decays, frequency, NUMERICS)
    now = _Stage(linear, free_shapes(records), tuple(r.motion for r in records))
    best: tuple[CoupledModel, Solution] | None = None
    for number in range(_ROUNDS):
        terms = _chosen(now, records)
        say(f"terms: {', '.join(t.key for t in terms) or 'none beside the linear ones'}")
        solution, now = _fitted(now, terms, records, first=number == 0)
        if best is not None and not _is_better(now.model, solution, *best, records):
            break
        settled = best is not None and {*best[0].terms} == {*now.model.terms}
        best = now.model, solution
        if settled:
            break
        records = _weighed_alike(records, solution)
    assert best is not None
    return best[0], float(np.sqrt(np.mean(_left(given, best[1]))))


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


def _chosen(now: _Stage, records: Sequence[CoupledRecord]) -> list[CoupledTerm]:
    """Candidates that gain on data that took no part, about the present motions."""
    r = now.model.n_coordinates
    more, values = candidates(r), now.model.coefficients
    everything = (*linear_terms(r), *more)
    at = tuple(values.get(t.key, 0.0) for t in everything)
    model = CoupledModel(everything, at, now.model.unit)
    parts = free_coefficients(model, [t.key for t in everything])
    parts = (*parts[: 2 * r], *now.shapes, *parts[2 * r :])
    found = np.concatenate([at[: 2 * r], [p.values[0] for p in now.shapes], at[2 * r :]])
    squares = [
        now.linear + i
        for i, t in enumerate(more)
        if isinstance(t, SlavedInertia) and t.first == t.second
    ]
    tables = [
        linear_table(model, parts, i, record, motion)[1]
        for i, (record, motion) in enumerate(zip(records, now.motions, strict=True))
    ]
    pieces = [Gram.of(rows, found) for table in tables for rows in _pieces(table, records)]
    return [more[i - now.linear] for i in chosen(pieces, now.linear, np.array(squares))]


def _pieces(table: Array, records: Sequence[CoupledRecord]) -> list[Array]:
    """The rows of a record, or of parts of it that all span its amplitudes."""
    if len(records) >= _FEWEST_RECORDS:
        return [table]
    n = len(table) // len(records[0].noise)  # of every channel
    stretch = np.arange(len(table)) % n * _STRETCHES // n
    return [table[stretch % _PARTS == k] for k in range(_PARTS)]


def _fitted(
    now: _Stage, terms: Sequence[CoupledTerm], records: Sequence[CoupledRecord], first: bool
) -> tuple[Solution, _Stage]:
    """The model with these terms beside the linear ones, fitted; from the measurement at first."""
    values = now.model.coefficients
    everything = (*linear_terms(now.model.n_coordinates), *terms)
    at = tuple(values.get(t.key, 0.0) for t in everything)
    model = replace(now.model, terms=everything, values=at)
    parts = (*free_coefficients(model, [t.key for t in everything]), *now.shapes)
    solution = fit(model, parts, records, None if first else now.motions)
    shapes = solution.parts[len(everything) :]
    return solution, _Stage(extended(model, solution.parts), shapes, solution.motions)


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
