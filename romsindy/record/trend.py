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

_DEGREE = 5  # of the splines
_MOST = 80  # intervals between knots
# The scatter of the events counts like so many more that scatter as the noise says.
_TRUST = 10.0
_POWERS = (-1, 0, 1, 2, 3, 4, 5)  # of the amplitude, that half-cycles of either side differ by
_MARGIN = 0.5  # cycles, beyond the first and the last peak
_SLOWEST = 0.25  # part of the mean pace, below which it is noise


@dataclass(frozen=True)
class Pace:
    """How fast a decay goes, over the cycle number: size and its e-folds per cycle, (n,) each."""

    number: Array
    log_size: Array
    rate: Array

    @classmethod
    def of(cls, number: Array, log_size: Array, rate: Array) -> Pace:
        """With a rate that is never less than a part of the mean one."""
        ends = number[[0, -1]] + [-_MARGIN, _MARGIN]
        beyond = log_size[[0, -1]] + _MARGIN * rate[[0, -1]] * [1, -1]
        number, log_size, rate = (
            np.concatenate([end[:1], x, end[1:]])
            for end, x in ((ends, number), (beyond, log_size), (rate[[0, -1]], rate))
        )
        mean = max(np.ptp(log_size), 1.0) / np.ptp(number)
        return cls(number, log_size - log_size.max(), np.maximum(rate, _SLOWEST * mean))

    def rate_at(self, number: Array) -> Array:
        return np.interp(number, self.number, self.rate)

    def log_size_at(self, number: Array) -> Array:
        return np.interp(number, self.number, self.log_size)

    def powers(self, number: Array, derivative: int) -> Array:
        """Powers of the size, (n, 4), none above one, or their slopes."""
        powers = np.array(_POWERS)
        log_size = self.log_size_at(number)[:, None]
        log_size = log_size - np.where(powers < 0, self.log_size.min(), 0.0)
        found = np.exp(powers * log_size)
        return -powers * self.rate_at(number)[:, None] * found if derivative else found

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
class Curves:
    """Smooth curves before any data: splines that split into polynomials and what is rough.

    A curve is ``knots`` (k,) with coefficients flat @ a + rough @ b. Its fourth derivative, in units
    of the pace, has a squared integral of b @ b.
    """

    pace: Pace
    knots: Array
    flat: Array
    rough: Array

    @classmethod
    def at(cls, pace: Pace, order: int, power: int) -> Curves:
        """Whose derivative of this order and fewer is of order one where they go with the pace."""
        knots = pace.knots()
        x, w = np.polynomial.legendre.leggauss(_DEGREE - order + 1)
        inner = knots[_DEGREE : len(knots) - _DEGREE]
        half = np.diff(inner) / 2
        at = (((inner[1:] + inner[:-1]) / 2)[:, None] + half[:, None] * x).ravel()
        weight = (half[:, None] * w).ravel() / pace.rate_at(at) ** power
        bend = np.sqrt(weight)[:, None] * _splines(knots, at, order)
        _, size, modes = np.linalg.svd(bend)
        n = bend.shape[1] - order
        return cls(pace, knots, modes[n:].T, modes[:n].T / size[:n])

    def rows(self, number: Array, derivative: int, side: Array) -> tuple[Array, Array]:
        """What values are of the polynomials, with what sides differ by, and of what is rough."""
        splines = _splines(self.knots, number, derivative)
        uneven = self.pace.powers(number, derivative)
        return np.column_stack([splines @ self.flat, side[:, None] * uneven]), splines @ self.rough


def _splines(knots: Array, number: Array, derivative: int) -> Array:
    return np.asarray(BSpline(knots, np.eye(len(knots) - _DEGREE - 1), _DEGREE)(number, derivative))


@dataclass(frozen=True)
class Trend:
    """A smooth function of the cycle number, one for either side of the vibration.

    Attributes
    ----------
    curves : Curves
    fixed : (p, g) array
        Coefficients of polynomials and sides, for every roughness that was tried.
    free : (m, g) array
        Those of the modes of what is rough.
    triangle : (p, p), along : (p, m), modes : (k, m) arrays
    spread : (m, g) array
        Variance of the modes.
    scale : (g,) array
    weight : (g,) array
        Probability of every roughness.
    """

    curves: Curves
    fixed: Array
    free: Array
    root: Array
    along: Array
    modes: Array
    spread: Array
    scale: Array
    weight: Array

    @classmethod
    def through(
        cls,
        number: Array,
        y: Array,
        std: Array,
        alike: Array,
        curves: Curves,
        roughness: Array,
        cycles: int | None = None,
    ) -> Trend:
        """Follow values y (n,) with standard errors, at half-cycles in turn.

        ``alike`` are the correlations of the errors with those 0, 1, 2, ... events later.
        """
        fixed, rough = curves.rows(number, 0, np.resize([1.0, -1.0], len(number)))
        white = _whitened(np.column_stack([fixed, rough, y]) / std[:, None], alike)
        fixed, rough, y = np.split(white, [fixed.shape[1], white.shape[1] - 1], axis=1)
        # A priori halves differ by less than their size.
        order = curves.flat.shape[1]
        prior = np.eye(len(_POWERS), fixed.shape[1], order)
        basis, triangle = np.linalg.qr(np.concatenate([fixed, prior]))
        basis = basis[: len(y)]
        known, y0 = basis.T @ rough, basis.T @ y
        gram = rough.T @ rough - known.T @ known
        pull = (rough.T @ y - known.T @ y0)[:, 0]
        left = float(np.sum(y**2) - np.sum(y0**2))
        size, modes = eigh(gram)
        size = np.maximum(size, 0.0)[:, None]
        part = (modes.T @ pull)[:, None]
        spread = 1 / (size + roughness**-2.0)
        rest = np.maximum(left - np.sum(part**2 * spread, axis=0), 0.0)
        freedom = _TRUST + len(y) - fixed.shape[1]
        surprise = freedom * np.log(_TRUST + rest) + np.sum(np.log1p(size * roughness**2), axis=0)
        weight = np.exp(-(surprise - surprise.min()) / 2)
        if cycles is not None:
            used = np.sum(size * spread, axis=0) + order
            wanted = max(order * len(y) / 2 / cycles, order)
            weight = (np.arange(len(roughness)) == np.argmin(np.abs(used - wanted))).astype(float)
        root = np.linalg.inv(triangle)
        free = part * spread
        along = known @ modes
        scale = (_TRUST + rest) / freedom
        return cls(curves, root @ (y0 - along @ free), free, root, along, modes, spread * scale, scale, weight / weight.sum())

    def __call__(self, number: Array, derivative: int = 0, side: float = 0.0) -> tuple[Array, Array]:
        """Value or slope at cycle numbers (n,), and its standard error: of one side, or the mean."""
        return self.of_rows(self.rows(number, derivative, side))

    def sided(self, number: Array, side: Array) -> Array:
        """Values at cycle numbers (n,), each of a side of its own."""
        return self.of_rows(self.curves.rows(number, 0, side))[0]

    def rows(self, number: Array, derivative: int, side: float) -> tuple[Array, Array]:
        """What a value or slope is of the coefficients."""
        return self.curves.rows(number, derivative, np.full(len(number), side))

    def of_rows(self, rows: tuple[Array, Array]) -> tuple[Array, Array]:
        fixed, rough = rows[0], rows[1] @ self.modes
        each = fixed @ self.fixed + rough @ self.free
        mean = each @ self.weight
        certain = fixed @ self.root
        variance = np.sum(certain**2, axis=1)[:, None] * self.scale
        variance = variance + (rough - certain @ self.along) ** 2 @ self.spread
        return mean, np.sqrt((variance + (each - mean[:, None]) ** 2) @ self.weight)


def _whitened(x: Array, alike: Array) -> Array:
    """Rows of x, (n, m), made independent."""
    alike = alike[: len(x)]
    if len(alike) < 2:
        return x
    band = np.repeat(alike[:, None], len(x), axis=1)
    factor = cholesky_banded(band, lower=True)
    return np.asarray(solve_banded((len(alike) - 1, 0), factor, x))
