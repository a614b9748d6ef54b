"""From decays of several coordinates to one regression, and back to their motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from pysindy.optimizers.base import BaseOptimizer
from sklearn.base import BaseEstimator

from romsindy.fit.coupled_record import CoupledRecord, coupled_records
from romsindy.fit.measured import NUMERICS, small_frequencies
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.ringing import names_of, require_channels, ringing_in
from romsindy.regression.coupled_motion import Followed, Oscillators, WindowRows
from romsindy.typing import Array

# A known omega^2 is refused where it is so many times that of the vibration, or less.
_FAR = 10.0
# Rounds end where another changes what is left by less than this part.
_SETTLED = 1e-3
# A motion runs away where it is so many times as large as the measured one.
_AWAY = 10.0


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
    """

    cycles: float = 6.0
    rounds: int = 20

    def check(self) -> None:
        """Refuse settings that mean nothing.

        Raises
        ------
        ValueError
            If ``cycles`` or ``rounds`` is too small.
        """
        if not self.cycles >= 2:
            raise ValueError(f"cycles = {self.cycles!r} must be at least 2")
        if isinstance(self.rounds, bool) or self.rounds != int(self.rounds) or self.rounds < 1:
            raise ValueError(f"rounds = {self.rounds!r} must be a whole number of at least 1")


class Rounds(NamedTuple):
    """The best of several rounds.

    Attributes
    ----------
    left : float
        Mean square of what the regression leaves of its rows.
    optimizer : BaseOptimizer
        Fitted.
    rows : WindowRows
    shapes : (c, R) array
    """

    left: float
    optimizer: BaseOptimizer
    rows: WindowRows
    shapes: Array


class Regression(NamedTuple):
    """What a regression of several coordinates has found.

    Attributes
    ----------
    optimizer : BaseOptimizer
        Fitted; `model` has those of its terms that are not 0.
    model : CoupledModel
    rows : WindowRows
    mode_shapes : (c, R) array
    """

    optimizer: BaseOptimizer
    model: CoupledModel
    rows: WindowRows
    mode_shapes: Array


def regressed(
    terms: Sequence[Term],
    decays: Sequence[Decay],
    projection: WindowProjection,
    solve: Callable[[WindowRows], BaseOptimizer],
    known: Mapping[str, float],
    weighted: bool = True,
) -> Regression:
    """Find coefficients of terms by regression, in rounds.

    Parameters
    ----------
    terms : sequence of Term
        Of several coordinates.
    decays : sequence of Decay
        Of one channel or several, in one unit.
    projection : WindowProjection
    solve : callable
        From rows to a fitted optimizer.
    known : mapping of str to float
        What ``solve`` holds fixed, by name.
    weighted : bool
        Divide each channel by its noise.

    Raises
    ------
    ValueError
        If the decays have different channels, fewer vibrations ring than the terms have
        coordinates, a known stiffness is far from theirs, or none is left of a coordinate.
    """
    projection.check()
    require_channels(decays, decays[0].n_channels)
    modes = CoupledModel(tuple(terms), (0.0,) * len(terms)).n_coordinates
    free = [decay.free() for decay in decays]
    records = coupled_records(free, _ringing(free, modes), NUMERICS)
    followed = _followed(records, projection, weighted)
    _refuse_far(known, followed[0].oscillators.omega)
    sizes = sizes_of(followed)
    best = in_rounds(followed, terms, projection.rounds, solve)
    model = _kept(terms, best.optimizer.coef_[0], modes, decays[0].unit)
    return Regression(
        best.optimizer,
        replace(model, amplitude_range=(float(sizes.min()), float(sizes.max()))),
        best.rows,
        best.shapes,
    )


def in_rounds(
    followed: Sequence[Followed],
    terms: Sequence[Term],
    rounds: int,
    solve: Callable[[WindowRows], BaseOptimizer],
) -> Rounds:
    """Regress, follow the motion of the model found, and so on until nothing changes."""
    sizes, best = sizes_of(followed), None
    for _ in range(rounds):
        rows = WindowRows.stacked([record.rows(terms) for record in followed])
        optimizer = solve(rows)
        coef = optimizer.coef_[0]
        left = float(np.mean((rows.target - rows.theta @ coef) ** 2))
        settled = best is not None and abs(left - best.left) < _SETTLED * left
        if best is None or left < best.left:
            best = Rounds(left, optimizer, rows, followed[0].shapes)
        if settled:
            break
        followed = [record.following(terms, coef) for record in followed]
        if _runs_away(followed, sizes):
            break
        if len(followed[0].shapes) > 1:
            shapes = np.mean([record.mode_shapes for record in followed], axis=0)
            followed = [record.with_shapes(shapes) for record in followed]
    assert best is not None
    return best


def rows_about(
    followed: Sequence[Followed], terms: Sequence[Term], coef: Array, rounds: int
) -> WindowRows:
    """Rows about the motion of a model that is known, where it leaves least of them."""
    sizes, found = sizes_of(followed), []
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

    Raises
    ------
    ValueError
        If a decay has other channels, or nothing rings near a mode of the model.
    """
    require_channels(decays, len(mode_shapes))
    main = [int(np.argmin(np.abs(column - 1))) for column in mode_shapes.T]
    found = [CoupledRecord.of(d.free(), small_frequencies(model), NUMERICS, main) for d in decays]
    records = [replace(record, shapes=mode_shapes) for record in found]
    followed = _followed(records, projection, weighted)
    return rows_about(followed, model.terms, np.array(model.values), projection.rounds)


def sizes_of(followed: Sequence[Followed]) -> Array:
    """Largest displacement of a coordinate in each window of all records."""
    return np.concatenate([record.amplitude for record in followed])


def _runs_away(followed: Sequence[Followed], sizes: Array) -> bool:
    """Whether a model has led the motion far from what was measured; also where it is nan."""
    return not bool(sizes_of(followed).max() < _AWAY * sizes.max())


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
) -> tuple[Followed, ...]:
    oscillators = Oscillators.of(records)
    scales = [[n.std if weighted else 1.0 for n in record.noise] for record in records]
    return tuple(
        Followed.of(record, record.shapes, oscillators, np.array(scale), projection.cycles)
        for record, scale in zip(records, scales, strict=True)
    )


def _kept(terms: Sequence[Term], coef: Array, modes: int, unit: str | None) -> CoupledModel:
    """The model of the terms that are left, which must have all modes."""
    pairs = [(t, float(c)) for t, c in zip(terms, coef, strict=True) if c]
    held = {t.key for t, c in pairs if c > 0}
    lost = [k for i in range(modes) if (k := f"omega^2 [q{i + 1}]") not in held]
    if lost:
        raise ValueError(
            f"the regression has left no positive {lost[0]}: ask for stiffness of degree 1, lower"
            " the threshold of the optimizer, or use fewer terms"
        )
    return CoupledModel(tuple(t for t, _ in pairs), tuple(c for _, c in pairs), unit)
