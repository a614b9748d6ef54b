"""What changes smoothly along a decay, followed from cycle to cycle, with honest errors.

Events of a vibration, one every half-cycle, are followed by a smoothing spline whose roughness is
measured in e-folds of the amplitude, not in cycles: whatever depends on amplitude changes at that
pace. How rough it is the data tell; every roughness counts by its likelihood. The spread of
the motions that this leaves possible is the standard error, bias included (G. Wahba, J. R. Stat.
Soc. B 45 (1983), 133; D. Nychka, J. Am. Stat. Assoc. 83 (1988), 1134).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cholesky_banded, eigh, solve_banded

from romsindy.typing import Array

_DEGREE, _ORDER = 5, 4  # of the splines, and of the derivative that is small where they are smooth
_MOST = 80  # intervals between knots
# The scatter of the events counts like so many more that scatter as the noise says.
_TRUST = 10.0
_POWERS = (-1, 0, 1, 2)  # of the amplitude, that half-cycles of either side differ by
_SLOWEST = 0.25  # part of the mean pace, below which it is noise
_RIDGE = 1e-13


@dataclass(frozen=True)
class Pace:
    """How fast a decay goes, over the cycle number: size and its e-folds per cycle, (n,) each."""

    number: Array
    log_size: Array
    rate: Array

    @classmethod
    def of(cls, number: Array, log_size: Array, rate: Array) -> Pace:
        """With a rate that is never less than a part of the mean one."""
        mean = max(log_size.max() - log_size.min(), 1.0) / (number[-1] - number[0])
        return cls(number, log_size - log_size.max(), np.maximum(rate, _SLOWEST * mean))

    def rate_at(self, number: Array) -> Array:
        return np.interp(number, self.number, self.rate)

    def log_size_at(self, number: Array) -> Array:
        return np.interp(number, self.number, self.log_size)

    def knots(self) -> Array:
        """Of splines: dense where the cycles are, and where the size changes; a cycle at least."""
        density = self.rate / np.mean(self.rate) + 1
        most = min(np.ptp(self.number), _MOST)
        density = np.minimum(density / np.mean(density) * most / np.ptp(self.number), 1.0)
        steps = (density[1:] + density[:-1]) / 2 * np.diff(self.number)
        spread = np.concatenate([[0], np.cumsum(steps)])
        inner = np.linspace(0, spread[-1], max(int(spread[-1]), 1) + 1)
        inner = np.interp(inner, spread, self.number)
        ends = np.ones(_DEGREE)
        return np.concatenate([inner[0] * ends, inner, inner[-1] * ends])


@dataclass(frozen=True)
class Trend:
    """A smooth function of the cycle number, one for either side of the vibration.

    Attributes
    ----------
    pace : Pace
    knots : (k,) array
    values : (m, g) array
        Coefficients for every roughness that was tried.
    modes, spread : (m, m) and (m, g) arrays
        Their covariance is modes @ diag(spread) @ modes.T.
    weight : (g,) array
        Probability of every roughness.
    """

    pace: Pace
    knots: Array
    values: Array
    modes: Array
    spread: Array
    weight: Array

    @classmethod
    def through(
        cls,
        number: Array,
        y: Array,
        std: Array,
        alike: Array,
        pace: Pace,
        power: int,
        roughness: Array,
        cycles: int | None = None,
    ) -> Trend:
        """Follow values y (n,) with standard errors, at half-cycles in turn.

        ``alike`` are the correlations of the errors with those 0, 1, 2, ... events later.
        The ``power`` derivative...
        """
        knots = pace.knots()
        design = _rows(number, knots, pace, 0, np.resize([1.0, -1.0], len(number)))
        white = _whitened(np.column_stack([design, y]) / std[:, None], alike)
        design, y = white[:, :-1], white[:, -1]
        penalty = _penalty(knots, pace, power, design.shape[1])
        gram = design.T @ design
        # A priori halves differ by less than their size.
        extra = np.r_[np.zeros(design.shape[1] - len(_POWERS)), np.ones(len(_POWERS))]
        gram += np.diag(extra + _RIDGE * np.diag(gram).max())
        stiffness, modes = eigh(penalty, gram)
        n_free = np.sum(extra == 0) - _ORDER
        stiffness = np.where(np.arange(len(stiffness)) < len(stiffness) - n_free, 0.0, stiffness)
        stiffness = np.maximum(stiffness, 0.0)[:, None]
        part = (modes.T @ (design.T @ y))[:, None]
        shrink = 1 / (1 + stiffness / roughness**2)
        rest = y @ y - np.sum(part**2 * shrink, axis=0)
        rest = np.maximum(rest, 0.0)
        freedom = _TRUST + len(y) - _ORDER - len(_POWERS)
        surprise = freedom * np.log(_TRUST + rest) - np.sum(np.log(shrink), axis=0)
        surprise += 2 * n_free * np.log(roughness)
        weight = np.exp(-(surprise - surprise.min()) / 2)
        if cycles is not None:
            used = np.abs(shrink.sum(axis=0) - len(_POWERS) - _ORDER * max(len(y) / 2 / cycles, 1))
            weight = (np.arange(len(roughness)) == np.argmin(used)).astype(float)
        scale = (_TRUST + rest) / freedom
        return cls(pace, knots, modes @ (part * shrink), modes, shrink * scale, weight / weight.sum())

    def __call__(self, number: Array, derivative: int = 0, side: float = 0.0) -> tuple[Array, Array]:
        """Value or slope at cycle numbers (n,), and its standard error: of one side, or the mean."""
        return self.of_rows(self.rows(number, derivative, side))

    def sided(self, number: Array, side: Array) -> Array:
        """Values at cycle numbers (n,), each of a side of its own."""
        rows = _rows(number, self.knots, self.pace, 0, side)
        return self.of_rows(rows)[0]

    def rows(self, number: Array, derivative: int, side: float) -> Array:
        """What a value or slope is of the coefficients."""
        return _rows(number, self.knots, self.pace, derivative, np.full(len(number), side))

    def of_rows(self, rows: Array) -> tuple[Array, Array]:
        each = rows @ self.values
        mean = each @ self.weight
        variance = (rows @ self.modes) ** 2 @ self.spread + (each - mean[:, None]) ** 2
        return mean, np.sqrt(variance @ self.weight)


def _rows(number: Array, knots: Array, pace: Pace, derivative: int, side: Array) -> Array:
    splines = BSpline(knots, np.eye(len(knots) - _DEGREE - 1), _DEGREE)(number, derivative)
    powers = np.array(_POWERS)
    # Relative to the least size where it grows towards it: no column exceeds one.
    log_size = pace.log_size_at(number)[:, None]
    log_size = log_size - np.where(powers < 0, pace.log_size.min(), 0.0)
    uneven = np.exp(powers * log_size)
    if derivative:
        uneven = -powers * pace.rate_at(number)[:, None] * uneven
    return np.column_stack([splines, side[:, None] * uneven])


def _penalty(knots: Array, pace: Pace, power: int, size: int) -> Array:
    """Integral of the squared third derivative, in units of the pace."""
    x, w = np.polynomial.legendre.leggauss(_DEGREE - _ORDER + 2)
    inner = knots[_DEGREE : len(knots) - _DEGREE]
    half = np.diff(inner) / 2
    at = ((inner[1:] + inner[:-1]) / 2)[:, None] + half[:, None] * x
    bend = BSpline(knots, np.eye(len(knots) - _DEGREE - 1), _DEGREE)(at.ravel(), _ORDER)
    weight = (half[:, None] * w).ravel() / pace.rate_at(at.ravel()) ** power
    found = np.zeros((size, size))
    n = bend.shape[1]
    found[:n, :n] = bend.T @ (weight[:, None] * bend)
    return found


def _whitened(x: Array, alike: Array) -> Array:
    """Rows of x, (n, m), made independent."""
    alike = alike[: len(x)]
    if len(alike) < 2:
        return x
    band = np.repeat(alike[:, None], len(x), axis=1)
    factor = cholesky_banded(band, lower=True)
    return solve_banded((len(alike) - 1, 0), factor, x)
