"""From forced vibrations to one regression: the terms, and the gain of each input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from pysindy.optimizers.base import BaseOptimizer

from romsindy.fit.forced.between_samples import ways
from romsindy.fit.forced.drives import inputs_in, refuse_displacement
from romsindy.fit.forced.drives import regressed as regressed_about_motion
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.measured import NUMERICS, require_unit
from romsindy.physics.damping import PowerDamping
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.regression.coupled_motion import Followed, Oscillators, WindowRows
from romsindy.regression.coupled_projection import (
    Rounds,
    WindowProjection,
    in_rounds,
    rows_about,
    sizes_of,
)

# Damping of the oscillators that stand in for the motion, over their frequency.
_LEAST_DAMPING, _MOST_DAMPING = 0.01, 0.5

Solve = Callable[[Sequence[Term], WindowRows], BaseOptimizer]


class ForcedRegression(NamedTuple):
    """What a regression of forced vibrations has found.

    Attributes
    ----------
    optimizer : BaseOptimizer
        Fitted; `model` has those of its terms that are not 0.
    model : ReducedModel
    terms : tuple of Term
        Of the columns; the last ones are the inputs.
    rows : WindowRows
    """

    optimizer: BaseOptimizer
    model: ReducedModel
    terms: tuple[Term, ...]
    rows: WindowRows


def as_forced(x: Any, t: Any = None, u: Any = None) -> list[ForcedVibration]:
    """Forced vibrations from what `HarmonicSINDy.fit` takes; none where nothing is forced.

    Raises
    ------
    ValueError
        If inputs are given beside decays, or shapes do not fit.
    """
    several = list(x) if isinstance(x, (list, tuple)) else [x]
    forced = [v for v in several if isinstance(v, ForcedVibration)]
    if u is None:
        if forced and len(forced) < len(several):
            raise ValueError(
                "x holds forced vibrations and others: regress one kind; refine() takes decays"
                " and forced vibrations together"
            )
        return forced
    if forced:
        raise ValueError("u is given, and x is a ForcedVibration, which has inputs: leave out u")
    if any(isinstance(d, Decay) for d in several):
        raise ValueError(
            "u is given, and x is a Decay, which nothing drives: leave out u, or give arrays x, t"
            " and u, or a ForcedVibration"
        )
    if not (isinstance(x, (list, tuple)) and len(x) and np.ndim(x[0])):
        return [_forced(x, t, u)]
    if not isinstance(u, (list, tuple)) or not isinstance(t, (list, tuple)):
        raise ValueError(f"x holds {len(x)} records: give lists t and u as well")
    if not len(x) == len(t) == len(u):
        raise ValueError(f"x holds {len(x)} records, but t {len(t)} and u {len(u)}")
    return [_forced(*one) for one in zip(x, t, u, strict=True)]


def _forced(x: Any, t: Any, u: Any) -> ForcedVibration:
    if t is None:
        raise ValueError("t is missing: give the times in s that go with the arrays x and u")
    x = np.asarray(x, float)
    columns = 1 if np.ndim(u) < 2 else np.shape(u)[1]
    names = ["force", *(f"force {i}" for i in range(2, columns + 1))]
    return ForcedVibration(t, x if x.ndim == 1 else x[:, 0], u, inputs=names)


def regressed_forced(
    terms: Sequence[Term],
    vibrations: Sequence[ForcedVibration],
    projection: WindowProjection,
    solve: Solve,
    weighted: bool = True,
) -> ForcedRegression:
    """Find coefficients of terms and gains of inputs, in rounds.

    Where nothing says what inputs do between their samples, it is what leaves least.

    Raises
    ------
    ValueError
        If records have different units, an input looks like the displacement of the base, or the
        optimizer has dropped it.
    """
    projection.check()
    require_unit(vibrations, vibrations[0].unit)
    followed = _followed(vibrations, projection, weighted)
    best: tuple[Rounds, tuple[Term, ...]] | None = None
    for way in ways(vibrations):
        every = (*terms, *inputs_in(vibrations, way))
        found = in_rounds(followed, every, projection.rounds, partial(solve, every))
        if best is None or found.left < best[0].left:
            best = found, every
    assert best is not None
    rounds, every = best
    sizes = sizes_of(followed)
    valid = (float(sizes.min()), float(sizes.max()))
    kept = _kept(every, rounds.optimizer.coef_[0].tolist())
    model = ReducedModel(tuple(kept), tuple(kept.values()), vibrations[0].unit, valid)
    return ForcedRegression(rounds.optimizer, model, every, rounds.rows)


def rows_of_forced(
    model: ReducedModel,
    vibrations: Sequence[ForcedVibration],
    projection: WindowProjection,
    weighted: bool = True,
) -> WindowRows:
    """Rows of a model that is known, for records that may be others than those it came from."""
    followed = _followed(vibrations, projection, weighted)
    return rows_about(followed, model.terms, np.array(model.values), projection.rounds)


def _kept(terms: Sequence[Term], coef: Sequence[float]) -> dict[Term, float]:
    """Terms that are left; every input must be."""
    for term, value in zip(terms, coef, strict=True):
        if isinstance(term, Input):
            refuse_displacement([term], [value])
            if not value:
                raise ValueError(
                    f"the regression has left no {term.key!r}: lower the optimizer's threshold, or"
                    " leave out the input"
                )
    return {term: value for term, value in zip(terms, coef, strict=True) if value}


def _followed(
    vibrations: Sequence[ForcedVibration], projection: WindowProjection, weighted: bool
) -> list[Followed]:
    records = [ForcedRecord.of(v, NUMERICS) for v in vibrations]
    oscillators = _oscillators(records)
    shapes = np.ones((1, 1))
    return [
        Followed.of(
            record,
            shapes,
            oscillators,
            np.array([record.noise.std if weighted else 1.0]),
            projection.cycles,
        )
        for record in records
    ]


def _oscillators(records: Sequence[ForcedRecord]) -> Oscillators:
    """The linear oscillator that comes nearest to the motions."""
    inputs = inputs_in([record.decay for record in records], "band-limited")
    linear = (Stiffness(1), PowerDamping(1))
    (stiffness, damping), _ = regressed_about_motion(linear, inputs, records)
    omega = float(np.sqrt(stiffness)) if stiffness > 0 else np.mean([r.rate for r in records])
    damping = np.clip(damping, _LEAST_DAMPING * omega, _MOST_DAMPING * omega)
    return Oscillators(np.array([omega]), np.array([damping]))
