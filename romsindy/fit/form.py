"""The law by which equations that are only nearly right err in forecasts of all kinds.

Such an equation errs in frequency, relatively, and in damping ratio; within the data by as much as
their likelihood asks for (`romsindy.fit.process_noise`). What it leaves out is of a higher power of
the amplitude than what it has, by two where the structure is symmetric: beyond the data it grows
with the square of the amplitude.

Records of one structure differ by more than their noise: temperature, a clamp, wear. Few records
tell their scatter badly, so what tests are known to repeat to counts with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t

from romsindy.typing import Array

DRAWS = 400
GROWS = "what the model lacks is not known there, and the band grows as the square of the amplitude"
KNOWN = 2.0  # degrees of freedom for which what is known beforehand counts
SIGMAS = 1.96


class Form(NamedTuple):
    """Errors of an equation, as standard deviations."""

    departure: float = 0.0  # of frequency, relative, and damping ratio, as amplitude changes
    frequency: float = 0.0  # by how much these move from record to record: 0 where none disagree
    damping: float = 0.0
    note: str = ""  # what is to be told of that


def grown(amplitude: ArrayLike, reach: float) -> Array:
    """Factor by which an equation errs more at an amplitude than within the reach of its data."""
    return np.maximum(np.asarray(amplitude) / reach, 1.0) ** 2


def as_coefficients(frequency: float, damping: float, rate: float) -> Array:
    """What relative frequency and damping ratio are in linear stiffness and damping, (2,)."""
    return np.array([2 * rate**2 * frequency, 2 * rate * damping])


def normal_draws(covariance: Array, rng: np.random.Generator) -> Array:
    """Errors of a known covariance, (DRAWS, m).

    Coefficients differ by many powers of ten: only their correlations are near one another.
    """
    size = np.sqrt(np.diag(covariance))
    unit = np.where(size > 0, size, 1.0)
    correlation, nothing = covariance / unit / unit[:, None], np.zeros(len(size))
    return np.asarray(size * rng.multivariate_normal(nothing, correlation, DRAWS, method="svd"))


def scatter(moves: Array, variance: Array, expected: float) -> float:
    """Standard deviation of a further move, widened for how badly few tell it.

    ``moves`` (n,) were seen, about any mean, with the ``variance`` (n,) of their errors; what is
    ``expected`` beforehand counts for two of them.
    """
    n, freedom = len(moves), KNOWN + len(moves) - 1
    own = max(float(np.sum((moves - moves.mean()) ** 2 - variance)), 0.0)
    return float(np.sqrt((KNOWN * expected**2 + own) / freedom * (1 + 1 / n))) * wider(freedom)


def wider(freedom: float) -> float:
    """A 95 % band of a deviation known by so many degrees of freedom, over that of a known one."""
    return float(t.isf(0.025, freedom)) / SIGMAS
