"""Rows of windows of a few cycles: several coordinates, or one under inputs, by regression."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from pysindy.optimizers.base import BaseOptimizer
from sklearn.base import BaseEstimator

from romsindy.fit.forced.drives import inputs_in, refuse_displacement
from romsindy.fit.forced.drives import regressed as regressed_about_motion
from romsindy.fit.records.arguments import require_unit, small_frequencies
from romsindy.fit.records.between_samples import ways
from romsindy.fit.records.coupled import CoupledRecord, coupled_records
from romsindy.fit.records.driven import ForcedRecord
from romsindy.fit.records.record import NUMERICS
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.damping import PowerDamping
from romsindy.physics.equations import Equations
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.ringing import names_of, require_channels, ringing_in
from romsindy.regression.window_motion import Oscillators, WindowMotion, WindowRows
from romsindy.typing import Array

# A known omega^2 is refused where it is so many times that of the vibration, or less.
_FAR = 10.0
# Rounds end where another changes what is left by less than this part.
_SETTLED = 1e-3
# A motion runs away where it is so many times as large as the measured one.
_AWAY = 10.0
# Damping of the oscillators that stand in for a driven motion, over their frequency.
_LEAST_DAMPING, _MOST_DAMPING = 0.01, 0.5

Solve = Callable[[Sequence[Term], WindowRows], BaseOptimizer]


@dataclass(eq=False, repr=False)
class WindowProjection(BaseEstimator):
    """Compare terms with the channels, in windows of a few cycles.

    The motion of several coordinates, or under inputs, repeats itself in no cycle. So the windows
    hold some cycles of the slowest, and overlap by half. A term, as a force on linear oscillators,
    contributes what the channels show of their response; free motions of the oscillators are
    projected out in every window. This is -q_ddot = sum of terms with both sides filtered alike,
    and reads displacement, velocity or acceleration as it was measured. All R equations stand in
    each row: a coefficient that they share is one column.

    Terms are evaluated on the motion of the coordinates, which at first is that of the followed
    vibrations; each round replaces it by that of the model found, which in every window follows the
    channels. Harmonics, and what coordinates show of each other, come in by that.

    Parameters
    ----------
    cycles : float
        Length of a window in cycles of the slowest coordinate, at least 2. Long windows tell small
        terms better, and may not settle where motions are strongly nonlinear.
    rounds : int
        Regressions at most, at least 1; the one that leaves least is kept.

    Examples
    --------
    >>> from romsindy import Decay, HarmonicSINDy, ROMLibrary
    >>> t, windows = np.arange(0.0, 10.0, 0.02), WindowProjection(cycles=4)
    >>> decay = Decay(t, np.exp(-0.1 * t) * (np.cos(6 * t) + 0.5 * np.cos(15 * t)))
    >>> model = HarmonicSINDy(ROMLibrary((), (1,), modes=2), projection=windows).fit(decay).model_
    >>> round(model.coefficients["omega^2 [q1]"], 1), round(model.coefficients["omega^2 [q2]"], 1)
    (36.0, 225.0)
    """

    cycles: float = 6.0
    rounds: int = 20

    def check(self) -> None:
        """Refuse settings that mean nothing.

        Raises a ValueError if ``cycles`` or ``rounds`` is too small.
        """
        if not self.cycles >= 2:
            raise ValueError(f"cycles = {self.cycles!r} must be at least 2")
        if isinstance(self.rounds, bool) or self.rounds != int(self.rounds) or self.rounds < 1:
            raise ValueError(f"rounds = {self.rounds!r} must be a whole number of at least 1")


class _Best(NamedTuple):
    """The best of several rounds; ``left`` is the mean square of what it leaves of its rows."""

    left: float
    optimizer: BaseOptimizer
    terms: tuple[Term, ...]
    rows: WindowRows
    shapes: Array

    @property
    def kept(self) -> dict[Term, float]:
        """Terms whose coefficients are not 0."""
        pairs = zip(self.terms, self.optimizer.coef_[0].tolist(), strict=True)
        return {term: value for term, value in pairs if value}


class Regression(NamedTuple):
    """What a regression in windows has found."""

    optimizer: BaseOptimizer  # fitted; `model` has those of its terms that are not 0
    model: Equations
    terms: tuple[Term, ...]  # of the columns; inputs come last
    rows: WindowRows
    mode_shapes: Array  # (c, R)


def regressed(
    terms: Sequence[Term],
    decays: Sequence[Decay],
    projection: WindowProjection,
    solve: Solve,
    known: Mapping[str, float],
    weighted: bool = True,
) -> Regression:
    """Find coefficients of terms of several coordinates, in rounds.

    Decays have one channel or several, in one unit; ``solve`` makes a fitted optimizer of terms and
    rows, and holds fixed what is ``known`` by name. Where ``weighted``, each channel is divided by
    its noise.

    Raises a ValueError if the decays have different channels, fewer vibrations ring than the terms
    have coordinates, a known stiffness is far from theirs, or none is left of a coordinate.
    """
    projection.check()
    require_channels(decays, decays[0].n_channels)
    modes = CoupledModel(tuple(terms), (0.0,) * len(terms)).n_coordinates
    free = [decay.free() for decay in decays]
    records = coupled_records(free, _ringing(free, modes), NUMERICS)
    followed = _followed(records, projection, weighted)
    _refuse_far(known, followed[0].oscillators.omega)
    best = _in_rounds(followed, terms, projection.rounds, solve)
    kept = best.kept
    held = {t.key for t, c in kept.items() if c > 0}
    lost = [k for i in range(modes) if (k := f"omega^2 [q{i + 1}]") not in held]
    if lost:
        raise ValueError(
            f"the regression has left no positive {lost[0]}: ask for stiffness of degree 1, lower"
            " the threshold of the optimizer, or use fewer terms"
        )
    model = CoupledModel(tuple(kept), tuple(kept.values()), decays[0].unit, _reach(followed))
    return Regression(best.optimizer, model, best.terms, best.rows, best.shapes)


def regressed_forced(
    terms: Sequence[Term],
    vibrations: Sequence[ForcedVibration],
    projection: WindowProjection,
    solve: Solve,
    weighted: bool = True,
) -> Regression:
    """Find coefficients of terms and gains of inputs, in rounds.

    Where nothing says what inputs do between their samples, it is what leaves least.

    Raises a ValueError if records have different units, an input looks like the displacement of the
    base, or the optimizer has dropped it.
    """
    projection.check()
    require_unit(vibrations, vibrations[0].unit)
    followed = _followed_forced(vibrations, projection, weighted)
    every = ((*terms, *inputs_in(vibrations, way)) for way in ways(vibrations))
    tried = [_in_rounds(followed, some, projection.rounds, solve) for some in every]
    best = min(tried, key=lambda rounds: rounds.left)
    _refuse_lost_inputs(best.terms, best.optimizer.coef_[0].tolist())
    kept = best.kept
    model = ReducedModel(tuple(kept), tuple(kept.values()), vibrations[0].unit, _reach(followed))
    return Regression(best.optimizer, model, best.terms, best.rows, best.shapes)


def _refuse_lost_inputs(terms: Sequence[Term], coef: Sequence[float]) -> None:
    for term, value in zip(terms, coef, strict=True):
        if isinstance(term, Input):
            refuse_displacement([term], [value])
            if not value:
                raise ValueError(
                    f"the regression has left no {term.key!r}: lower the optimizer's threshold, or"
                    " leave out the input"
                )


def _in_rounds(
    followed: Sequence[WindowMotion], terms: Sequence[Term], rounds: int, solve: Solve
) -> _Best:
    """Regress, follow the motion of the model found, and so on until nothing changes."""
    sizes, best = _sizes(followed), None
    for _ in range(rounds):
        rows = WindowRows.stacked([record.rows(terms) for record in followed])
        optimizer = solve(terms, rows)
        coef = optimizer.coef_[0]
        left = float(np.mean((rows.target - rows.theta @ coef) ** 2))
        settled = best is not None and abs(left - best.left) < _SETTLED * left
        if best is None or left < best.left:
            best = _Best(left, optimizer, tuple(terms), rows, followed[0].shapes)
        if settled:
            break
        followed = [record.following(terms, coef) for record in followed]
        if _runs_away(followed, sizes):
            break
        if len(followed[0].shapes) > 1:
            shapes = np.mean([record.mode_shapes for record in followed], axis=0)
            followed = [replace(record, shapes=shapes) for record in followed]
    assert best is not None
    return best


def _rows_about(
    followed: Sequence[WindowMotion], terms: Sequence[Term], coef: Array, rounds: int
) -> WindowRows:
    """Rows about the motion of a model that is known, where it leaves least of them."""
    sizes, found = _sizes(followed), []
    for _ in range(rounds):
        found.append(WindowRows.stacked([record.rows(terms) for record in followed]))
        followed = [record.following(terms, coef) for record in followed]
        if _runs_away(followed, sizes):
            break
    return min(found, key=lambda rows: float(np.sum((rows.target - rows.theta @ coef) ** 2)))


def rows_of(
    model: CoupledModel,
    decays: Sequence[Decay],
    projection: WindowProjection,
    mode_shapes: Array,
    weighted: bool = True,
) -> WindowRows:
    """Rows of a model that is known, for decays that may be others than those it came from.

    Raises a ValueError if a decay has other channels, or nothing rings near a mode of the model.
    """
    require_channels(decays, len(mode_shapes))
    main = [int(np.argmin(np.abs(column - 1))) for column in mode_shapes.T]
    found = [CoupledRecord.of(d.free(), small_frequencies(model), NUMERICS, main) for d in decays]
    records = [replace(record, shapes=mode_shapes) for record in found]
    followed = _followed(records, projection, weighted)
    return _rows_about(followed, model.terms, np.array(model.values), projection.rounds)


def rows_of_forced(
    model: ReducedModel,
    vibrations: Sequence[ForcedVibration],
    projection: WindowProjection,
    weighted: bool = True,
) -> WindowRows:
    """Rows of a model that is known, for records that may be others than those it came from."""
    followed = _followed_forced(vibrations, projection, weighted)
    return _rows_about(followed, model.terms, np.array(model.values), projection.rounds)


def _sizes(followed: Sequence[WindowMotion]) -> Array:
    """Largest displacement of a coordinate in each window of all records."""
    return np.concatenate([record.amplitude for record in followed])


def _reach(followed: Sequence[WindowMotion]) -> tuple[float, float]:
    """Least and largest of these."""
    sizes = _sizes(followed)
    return float(sizes.min()), float(sizes.max())


def _runs_away(followed: Sequence[WindowMotion], sizes: Array) -> bool:
    """Whether a model has led the motion far from what was measured; also where it is nan."""
    return not bool(_sizes(followed).max() < _AWAY * sizes.max())


def _ringing(decays: Sequence[Decay], modes: int) -> Array:
    """Frequencies, Hz, of the strongest vibrations of the ringing_in channel, lowest first."""
    most = ringing_in(decays)
    if len(most) < modes:
        raise ValueError(
            f"modes = {modes}, but what rings in the record is {names_of(most)}: ask for so many"
            " modes, or excite the others more"
        )
    return np.sort([v.small_frequency for v in most[:modes]])


def _refuse_far(known: Mapping[str, float], omega: Array) -> None:
    """Linear stiffness in other units than the data stands out by orders of magnitude."""
    for i, rate in enumerate(omega):
        value = known.get(f"omega^2 [q{i + 1}]", rate**2)
        if not 1 / _FAR < value / rate**2 < _FAR:
            raise ValueError(
                f"fixed['omega^2 [q{i + 1}]'] = {value:.6g} 1/s^2 contradicts the data, where that"
                f" coordinate has omega^2 = {rate**2:.4g}: omega^2 is in (rad/s)^2, 39.5 times Hz^2"
            )


def _followed(
    records: Sequence[CoupledRecord], projection: WindowProjection, weighted: bool
) -> list[WindowMotion]:
    given = Oscillators.of(records), projection.cycles, weighted
    return [WindowMotion.of(record, None, record.shapes, *given) for record in records]


def _followed_forced(
    vibrations: Sequence[ForcedVibration], projection: WindowProjection, weighted: bool
) -> list[WindowMotion]:
    records = [ForcedRecord.of(v, NUMERICS) for v in vibrations]
    given = _oscillators(records), projection.cycles, weighted
    return [WindowMotion.of(record, record.decay, np.ones((1, 1)), *given) for record in records]


def _oscillators(records: Sequence[ForcedRecord]) -> Oscillators:
    """The linear oscillator that comes nearest to the motions."""
    inputs = inputs_in([record.decay for record in records], "band-limited")
    linear = (Stiffness(1), PowerDamping(1))
    (stiffness, damping), _ = regressed_about_motion(linear, inputs, records)
    omega = float(np.sqrt(stiffness)) if stiffness > 0 else np.mean([r.rate for r in records])
    damping = np.clip(damping, _LEAST_DAMPING * omega, _MOST_DAMPING * omega)
    return Oscillators(np.array([omega]), np.array([damping]))
