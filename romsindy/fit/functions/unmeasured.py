"""Decays under a force that nobody measured, which is as large at all amplitudes.

The windows of `romsindy.fit.functions.windows` depart by a part of their amplitude. A force that is
not known moves a quiet motion as much as a loud one, at every step. Its intensity and the noise of
the sensor, with its colour, are those of the largest likelihood in what one simulation leaves
(`romsindy.fit.kernel.noises`); values are weighed by both, and the motion is the one that such
forces move as is most likely. What one simulation leaves then must go with no function of its
motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count

import numpy as np
from scipy.linalg import LinAlgError

from romsindy.fit.adequacy.independence import (
    Force,
    Tried,
    examine_forced,
    forces_alone,
    independence,
    judged,
)
from romsindy.fit.adequacy.verdicts import ForcedAdequacy
from romsindy.fit.functions.evidence import JUMPS, Fitted, better_scales, nearest
from romsindy.fit.functions.series import Series
from romsindy.fit.functions.windows import Linear, Window, block, root, windows_of
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.kernel.linear_response import respond, sampled
from romsindy.fit.kernel.noises import TwoNoises, found_noises, steady
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import FADES, SMALLER
from romsindy.typing import Array

_ROUNDS = 2  # of noises, and the values that they weigh
_STEPS = 12
_SMALL = 1e-3  # change of a motion, in amplitudes, that changes no figure


def simulated(found: Fitted, values: Array) -> list[tuple[Trajectory, Array]]:
    """One simulation of each record, from the start that suits all of it, and what it leaves.

    That is inf where there is no motion.
    """
    series = _near(found.series.moved(values), found.records)
    if found.noises:  # forces move the motion at every step
        motions = [w.motion for w in found.windows]
        starts = [_start(series, *each) for each in zip(count(), found.records, motions)]
    else:
        states = replace(found, jump=float(JUMPS[0])).reduced.states(values)
        starts = [s[0] for s in states]
    return [_from(series, *each) for each in zip(count(), found.records, starts)]


def _start(series: Series, number: int, record: Record, motion: Trajectory) -> Array:
    """From which a simulation comes nearest to a record, by least squares about a motion."""
    response = respond(series, motion, np.zeros((0, 3 * motion.grid.n_steps, 1)))
    x = sampled(motion, record.derivative)[:, 0]
    shown, slope = series.shown(x, record.derivative, number)
    change = slope[:, None] * response.samples(record.derivative)[:, 0]
    left = record.signal - shown - change[:, 0]
    return motion.start + np.linalg.lstsq(change[:, 1:], left, rcond=None)[0]


def _from(series: Series, number: int, record: Record, start: Array) -> tuple[Trajectory, Array]:
    try:
        motion = integrate(series, start, record.motion.grid, record.motion)
    except TrajectoryError:
        return record.motion, np.full(len(record.signal), np.inf)
    x = motion.samples(series, record.derivative)[:, 0]
    return motion, record.signal - series.shown(x, record.derivative, number)[0]


def _near(series: Series, records: Sequence[Record]) -> Series:
    """As it is for the quietest motions."""
    return series.near(min(w.amplitude for w in windows_of(records)))


def weighed(start: Fitted) -> Fitted | None:
    """A fit like another one, by noises as they are found in what that leaves.

    None where there is no such force, or one that is not the same all along.

    Raises a TrajectoryError if no motion follows the records.
    """
    for _ in range(_ROUNDS):
        series, ways = _near(start.series, start.records), simulated(start, start.series.values)
        found = []
        for i, (motion, left) in enumerate(ways):
            if not np.all(np.isfinite(left)):
                raise TrajectoryError("one simulation of the record goes astray")
            two = TwoNoises.along(series, (), i, start.records[i], motion)
            found.append(found_noises(two, left))
            heard = np.sqrt(two.heard[0, 0] * found[-1].force[0])
            quiet = heard < SMALLER * found[-1].shown[0]
            if quiet or steady(two, left, found[-1]) < FADES:
                return None
        windows = tuple(_whole(i, motion) for i, (motion, _) in enumerate(ways))
        start = again(replace(start, windows=windows, noises=tuple(found)), start.series)
    return start


def _whole(number: int, motion: Trajectory) -> Window:
    return Window(number, np.arange(len(motion.grid.fraction)), motion)


def again(start: Fitted, series: Series) -> Fitted:
    """Fit a like series by the noises of another fit.

    Raises a TrajectoryError if its motion goes astray.
    """
    now = replace(start, series=series, noise=1.0, jump=float(JUMPS[0]), converged=False)
    for _ in range(_STEPS):
        try:
            with np.errstate(all="ignore"):
                after, largest = _step(now)
        except LinAlgError as error:
            raise TrajectoryError("small disturbances of the motion grow without bound") from error
        settled = largest < _SMALL and abs(now.cost - after.cost) < 0.1
        now = after
        if settled:
            break
    return replace(now, converged=settled)


def _step(now: Fitted) -> tuple[Fitted, float]:
    near, tables = _near(now.series, now.records), []
    for window, record, noises in zip(now.windows, now.records, now.noises, strict=True):
        own = block(near, window, record)
        n = own.change.shape[1] - 2
        signal = own.signal - own.change[:, n:] @ window.motion.start
        two = TwoNoises.along(near, (), window.record, record, window.motion)
        columns = np.column_stack([own.change[:, :n], signal])
        if not np.all(np.isfinite(columns)):
            raise TrajectoryError("the motion goes astray")
        tables.append((own, two.table(columns), noises))
    linear = tuple(
        Linear(r, (), root(t.weighed(noises).products, np.eye(len(now.series.values) + 1)))
        for r, (_, t, noises) in zip(now.records, tables, strict=True)
    )
    now = better_scales(replace(now, linear=linear))
    values = nearest(now.series, *now.posterior())
    windows, largest = [], 0.0
    for window, (own, table, noises) in zip(now.windows, tables, strict=True):
        states = table.states(noises) @ np.append(-values, 1.0)
        change = np.concatenate([[1.0], values - now.series.values, [0.0, 0.0]])
        motion = table.noises.moved(own.response.moved(change), states)
        off = np.abs(motion.q - window.motion.q).max() / window.amplitude
        if not off < 1e4:
            raise TrajectoryError("the motion goes astray")
        windows.append(replace(window, motion=motion))
        largest = max(largest, float(off))
    return replace(now, series=now.series.moved(values), windows=tuple(windows)), largest


def verdict(
    found: Fitted, values: Array, ways: Sequence[tuple[Trajectory, Array]]
) -> ForcedAdequacy:
    """What a fit leaves of simulations with these values."""
    series, pairs = _near(found.series.moved(values), found.records), [*enumerate(found.records)]
    records, left = found.records, [left for _, left in ways]
    size = examine_forced(records, left, found.n_effective)
    if not 0 < size.part < np.inf:
        return size
    tables = []
    for i, record in pairs:
        motion = ways[i][0]
        fitted = block(series, _whole(i, motion), record).change[:, :-2]
        forces = [Force(n, x[:, None]) for n, x in forces_alone(motion, "q")]
        tables.append(Tried.along(series, (), i, record, motion, fitted, left[i], forces))
    return judged(size, independence(tables, len(values)), pairs)
