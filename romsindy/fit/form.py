"""How far motions depart from their equation, and how much structures move between records.

One law for the bands of all forecasts. An equation that is only nearly right errs in frequency,
relatively, and in damping ratio; within the data by as much as their likelihood asks for
(`romsindy.fit.process_noise`). What it leaves out is small there, and of a higher power of the
amplitude than what it has: beyond the data it grows with the square of the amplitude.

Records of one structure differ by more than their noise: temperature, a clamp, wear. Where several
are fitted together, each gets a frequency and a damping of its own beside the common values. Few
records tell the scatter of these badly, so what tests are known to repeat to counts with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, t

from romsindy.fit.coefficient import LINEAR, Coefficient
from romsindy.fit.collocation import Trajectory, TrajectoryError
from romsindy.fit.gauss_newton import fit
from romsindy.fit.part import Part
from romsindy.fit.process_noise import Marginal, Windows
from romsindy.fit.record import Record
from romsindy.fit.verdict import FALSE_ALARM, SAME_DAMPING, SAME_FREQUENCY
from romsindy.physics.model import ReducedModel
from romsindy.text import percent
from romsindy.typing import Array

DRAWS = 400
KNOWN = 2.0  # degrees of freedom for which what is known beforehand counts
_SIGMAS = 1.96


class Form(NamedTuple):
    """Errors of an equation, as standard deviations.

    Attributes
    ----------
    departure : float
        Of frequency, relative, and of damping ratio, as they change with amplitude.
    frequency, damping : float
        By how much both move from record to record: 0 where none disagree.
    note : str
        What is to be told of that.
    """

    departure: float = 0.0
    frequency: float = 0.0
    damping: float = 0.0
    note: str = ""

    @classmethod
    def of(
        cls,
        model: ReducedModel,
        parts: tuple[Part, ...],
        records: Sequence[Record],
        motions: Sequence[Trajectory],
    ) -> Form:
        """What records say of an equation that was fitted to them; nothing where it goes astray."""
        moved = cls()
        try:
            if len(records) > 1:
                own = tuple(Part(_Own(law), (), np.zeros((len(records), 1))) for law in LINEAR)
                found = fit(model, (*parts, *own), records, motions)
                rate = float(np.mean([r.rate for r in records]))
                errors = found.covariance[-2 * len(records) :, -2 * len(records) :]
                moves = np.array([p.strengths[:, 0] for p in found.parts[-2:]])
                moved = _moved(moves, errors, rate, float(np.mean([_loss(r) for r in records])))
                parts, motions = found.parts, found.motions
            pairs = enumerate(zip(records, motions, strict=True))
            windows = [Windows.of(model, parts, i, *pair) for i, pair in pairs]
        except TrajectoryError:
            return moved
        return moved._replace(departure=Marginal.of(parts, windows).allowed())


class _Own(Coefficient):
    """Another value of a coefficient in each record."""

    per_record = True


def as_coefficients(frequency: float, damping: float, rate: float) -> Array:
    """What relative frequency and damping ratio are in coefficients of the `LINEAR` terms, (2,)."""
    return np.array([2 * rate**2 * frequency, 2 * rate * damping])


def normal_draws(covariance: Array, rng: np.random.Generator) -> Array:
    """Errors of a known covariance, (DRAWS, m).

    Coefficients differ by many powers of ten: only their correlations are near one another.
    """
    size = np.sqrt(np.diag(covariance))
    unit = np.where(size > 0, size, 1.0)
    correlation, nothing = covariance / unit / unit[:, None], np.zeros(len(size))
    return np.asarray(size * rng.multivariate_normal(nothing, correlation, DRAWS, method="svd"))


def scatter(moves: Array, variance: Array, expected: float, lost: float = 1.0) -> float:
    """Standard deviation of a further move, widened for how badly few tell it.

    Parameters
    ----------
    moves : (n,) array
        Seen ones.
    variance : (n,) array
        Of their errors.
    expected : float
        What is known of it beforehand, which counts for two of them.
    lost : float
        How many of them other values have taken up.
    """
    n, freedom = len(moves), KNOWN + len(moves) - lost
    own = max(float(np.sum((moves - moves.mean()) ** 2 - variance)), 0.0)
    return float(np.sqrt((KNOWN * expected**2 + own) / freedom * (1 + 1 / n))) * wider(freedom)


def wider(freedom: float) -> float:
    """A 95 % band of a deviation known by so many degrees of freedom, over that of a known one."""
    return float(t.isf(0.025, freedom)) / _SIGMAS


def _loss(record: Record) -> float:
    """Damping ratio, by the amplitudes at begin and end."""
    first, *_, last = np.hypot(record.motion.q[:, 0], record.motion.q_dot[:, 0] / record.rate)
    turned = float(np.ptp(record.phase(record.t[[0, -1]])))
    return float(abs(np.log(first / last))) / turned


def _moved(moves: Array, errors: Array, rate: float, damping: float) -> Form:
    """From changes of the coefficients in each record, (2, n), and their covariance."""
    n = moves.shape[1]
    unit = as_coefficients(1.0, 1.0, rate)[:, None]
    variance = np.diag(errors).reshape(2, n) / unit**2
    moves = (moves - moves.mean(axis=1, keepdims=True)) / unit
    if np.sum(moves**2 / variance) < chi2.isf(FALSE_ALARM, 2 * (n - 1)):
        return Form()
    # Two tests differ by the root of two times their scatter, and by two of these at most.
    usual = np.array([SAME_FREQUENCY, SAME_DAMPING * damping]) / (np.sqrt(2) * _SIGMAS)
    frequency, loss = (scatter(*x) for x in zip(moves, variance, usual, strict=True))
    seen = np.std(moves, axis=1, ddof=1)
    note = (
        f"the records disagree: from one to another the frequency moves by {percent(seen[0])} and"
        f" the damping by {percent(seen[1] / damping)} (standard deviations of {n} records); the"
        " band of a forecast counts it"
    )
    return Form(0.0, frequency, loss, note)
