"""Vibrations that are close in frequency: from where they are quiet back to where they are loud.

Large, they beat and exchange energy, and what is followed of each in the channels is wrong. Where
they are quieter it is right. A model of the quiet part has a motion before it, too: stride by
stride that is taken as the motion from which a longer part is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from romsindy.effects.choices import KINDS, Kind, candidates
from romsindy.fit.coupled.choice import Choice
from romsindy.fit.coupled.rounds import FittedPieces, Progress, of_plainest_kind, settled
from romsindy.fit.kernel.collocation import TrajectoryError, integrate
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.pieces import shortest
from romsindy.fit.records.arguments import small_frequencies
from romsindy.fit.records.coupled import CoupledRecord, curved_shapes
from romsindy.fit.records.record import NUMERICS
from romsindy.physics.coupled import CoupledModel, linear_terms
from romsindy.physics.equations import SingularInertiaError
from romsindy.physics.integration import EscapeError
from romsindy.record.decay import Decay
from romsindy.typing import Array

_TIMES = 50  # of a stride: its end alone is asked for


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
    record = whole.since_step(first)
    before = state_before(model, state, time - since)
    equation = equation_of(model, (), 0, record)
    motion = integrate(equation, before, record.motion.grid)
    return replace(record, motion=motion), since


def state_before(model: CoupledModel, state: Array, seconds: float) -> Array:
    """The state so long before: damping drives a motion whose time runs backwards."""
    if seconds <= 0:
        return state
    pairs = zip(model.terms, model.values, strict=True)
    values = (v if term.undamped() == term else -v for term, v in pairs)
    backwards = replace(model, values=tuple(values))
    q, q_dot = np.split(state, 2)
    past = backwards.simulate(q, -q_dot, np.linspace(0, seconds, _TIMES))
    return np.concatenate([past.q[-1], -np.asarray(past.q_dot)[-1]])
