"""Identify the equations of several coordinates from free decays.

The vibrations that ring say how many coordinates there are, how fast and how damped small motions
are. Candidates are chosen by what they gain on data that took no part (`romsindy.fit.
coupled_terms`), about the measured motion first and then about that of the model, until the choice
stays. No ratio of frequencies is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.coupled_record import CoupledRecord, coupled_records, free_shapes, tones_of
from romsindy.fit.coupled_rounds import Fitted, Stage, cut, with_terms
from romsindy.fit.coupled_terms import KINDS, Kind, linear_terms
from romsindy.fit.refine import NUMERICS, Fit, refined, require_unit, several_decays
from romsindy.fit.verdict import MODE
from romsindy.physics.coupled import CoupledModel
from romsindy.record.decay import Decay
from romsindy.record.vibrations import Vibration


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
    best: Fitted | None = None
    # Tall and narrow matrices: threads of the linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        for count in range(fewest, len(ringing) + 1):
            found = _identified(ringing[:count], free, say)
            # A further coordinate must be needed: harmonics and combinations look like one.
            if best is not None and not (found and _needed(found, best)):
                break
            best = found
            if best is not None and best.explained:
                break
    if best is None:
        raise TrajectoryError(
            f"no model of {len(ringing)} coordinates has a motion near the measured one: take"
            " quieter parts of the decays, by decay.between(start, end), or decays of less"
            " amplitude"
        )
    stage, names = best.stage, tuple(best.stage.model.coefficients)
    pieces = tuple(p.record for p in cut(stage, best.records, best.cycles))
    fit = refined(stage.model, names, pieces, stage.shapes, progress=progress)
    return replace(fit, notes=(*fit.notes, *_lost(best)))


def _needed(found: Fitted, before: Fitted) -> bool:
    """Whether a further coordinate is: with it the motion is followed longer, or much better."""
    longer = found.cycles > before.cycles
    return longer or found.left_over(before.records) < (1 - MODE) * before.left


def _lost(best: Fitted) -> list[str]:
    """What the reader must know where the model loses the motion."""
    if np.isinf(best.cycles):
        return []
    return [
        f"the model follows the motion over pieces of {best.cycles:.0f} cycles of the slowest"
        " coordinate, not over the whole of the decays: it was fitted to such pieces, each from an"
        " initial state of its own"
    ]


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
        omega = 2 * np.pi * v.small_frequency
        zeta = v.damping_ratio[1]
        values += [omega**2, 2 * zeta * omega if zeta > 0 else 0.0]
    return CoupledModel(linear_terms(len(ringing)), tuple(values), unit)


def _identified(
    strongest: Sequence[Vibration], decays: Sequence[Decay], say: Callable[[str], None]
) -> Fitted | None:
    """The model of some vibrations, with candidates of the plainest kind that explains them."""
    ringing = sorted(strongest, key=lambda v: v.small_frequency)
    frequency = np.array([v.small_frequency for v in ringing])
    say(f"coordinates at {', '.join(f'{f:.5g} Hz' for f in frequency)}")
    records = coupled_records(decays, frequency, NUMERICS)
    motions = tuple(r.motion for r in records)
    start = Stage(_linear(ringing, decays[0].unit), free_shapes(records), motions)
    return of_plainest_kind(start, records, KINDS, say)


def of_plainest_kind(
    start: Stage,
    records: Sequence[CoupledRecord],
    kinds: Sequence[Kind],
    say: Callable[[str], None],
) -> Fitted | None:
    """The start with terms of the first kind that explains the records, or else of the best."""
    found: list[Fitted] = []
    for kind in kinds:
        fitted = with_terms(start, records, kind, say)
        if fitted is not None:
            found.append(fitted)
            records = fitted.records  # with their noise, as it was heard again
            if fitted.explained:
                break
    return min(
        found,
        key=lambda f: (not f.explained, -f.cycles, f.left_over(records)),
        default=None,
    )
