"""What changes smoothly along a decay, followed from cycle to cycle, with honest errors.

Events of a vibration, one every half-cycle, are followed by a smoothing spline whose roughness is
measured in e-folds of the amplitude, not in cycles: whatever depends on amplitude changes at that
pace. How rough it is the data tell, and every roughness counts by its likelihood. The spread of
the curves that remain possible is the standard error, bias included (G. Wahba, J. R. Stat. Soc. B
45 (1983), 133; D. Nychka, J. Am. Stat. Assoc. 83 (1988), 1134).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cholesky_banded, eigh, solve_banded

from romsindy.typing import Array

_DEGREE = 5  # of the splines
_MOST, _DENSEST = 80, 1.0  # intervals between knots, and how many a cycle, at most
# The derivative that is rough, of logarithms of sizes and of times.
_SIZE_ORDER, _TIME_ORDER = 4, 5
# Third derivatives are of this order per e-fold, which matters where data are few.
_TAME = 10.0
# Sides of a vibration differ by powers of its amplitude, which an offset (-1) and asymmetry make,
# with coefficients of this order.
_POWERS, _UNEVEN = (-1, 0, 1, 2, 3, 4, 5), 0.1
# The scatter of the events counts like so many more that scatter as the noise says.
_TRUST = 10.0
_EVERY = 10 ** np.linspace(-6, 4, 41)  # roughness, where it is a number of cycles that is wanted
_MARGIN = 0.5  # cycles, beyond the first and the last event
_SLOWEST = 0.25  # part of the mean pace: slower is noise


@dataclass(frozen=True)
class Pace:
    """How fast a decay goes."""

    number: Array  # (n,), in cycles
    log_size: Array  # (n,), logarithm of the amplitude, over the largest
    rate: Array  # (n,), its e-folds per cycle

    @classmethod
    def of(cls, number: Array, log_size: Array, rate: Array) -> Pace:
        """A little beyond the ends, and never much slower than in the mean."""
        ends = np.array([0, -1])
        number, log_size, rate = (
            np.concatenate([[x[0] - by[0]], x, [x[-1] + by[1]]])
            for x, by in (
                (number, (_MARGIN, _MARGIN)),
                (log_size, _MARGIN * rate[ends] * [-1, -1]),
                (rate, (0.0, 0.0)),
            )
        )
        mean = max(float(np.ptp(log_size)), 1.0) / (number[-1] - number[0])
        return cls(number, log_size - log_size.max(), np.maximum(rate, _SLOWEST * mean))

    def rate_at(self, number: Array) -> Array:
        """E-folds per cycle at cycle numbers (n,)."""
        return np.interp(number, self.number, self.rate)

    def powers(self, number: Array, derivative: int) -> Array:
        """Powers of the amplitude, (n, p), none above one, or their slopes."""
        powers = np.array(_POWERS)
        log_size = np.interp(number, self.number, self.log_size)[:, None]
        found = np.exp(powers * (log_size - np.where(powers < 0, self.log_size.min(), 0.0)))
        return -powers * self.rate_at(number)[:, None] * found if derivative else found

    def knots(self) -> Array:
        """Of splines: where the cycles are and where the amplitude changes, half of them each."""
        span = float(self.number[-1] - self.number[0])
        density = (self.rate / np.mean(self.rate) + 1) / 2 * min(span, _MOST) / span
        density = np.minimum(density, _DENSEST)
        steps = (density[1:] + density[:-1]) / 2 * np.diff(self.number)
        spread = np.concatenate([[0], np.cumsum(steps)])
        even = np.linspace(0, spread[-1], max(int(spread[-1]), 1) + 1)
        return np.pad(np.interp(even, spread, self.number), _DEGREE, mode="edge")


@dataclass(frozen=True)
class Curves:
    """Smooth curves before any data: polynomials and what is rough beside them."""

    pace: Pace
    knots: Array  # (k,), of the splines that they are made of
    # (m, order) and (m, m - order), a curve has the spline coefficients flat @ a + rough @ b. The
    # derivative that is rough, in units of the pace, has b @ b for the integral of its square.
    flat: Array
    rough: Array
    tame: Array  # (order, order), what is likely of polynomials: tame @ a is of order one

    @classmethod
    def of_sizes(cls, pace: Pace) -> Curves:
        """Logarithms of sizes, which change by one an e-fold."""
        return cls._at(pace, _SIZE_ORDER, 0)

    @classmethod
    def of_times(cls, pace: Pace) -> Curves:
        """Times in cycles, whose slopes change by a part of one an e-fold."""
        return cls._at(pace, _TIME_ORDER, 1)

    @classmethod
    def _at(cls, pace: Pace, order: int, slope: int) -> Curves:
        knots = pace.knots()
        x, w = np.polynomial.legendre.leggauss(3)
        inner = knots[_DEGREE : len(knots) - _DEGREE]
        half = np.diff(inner)[:, None] / 2
        at = ((inner[1:] + inner[:-1])[:, None] / 2 + half * x).ravel()
        efolds = (half * w).ravel() * pace.rate_at(at)

        def bend(derivative: int) -> Array:
            unit = np.sqrt(efolds) / pace.rate_at(at) ** (derivative - slope)
            return unit[:, None] * _splines(knots, at, derivative)

        _, size, modes = np.linalg.svd(bend(order))
        n = modes.shape[0] - order
        flat = modes[n:].T
        tame = np.linalg.qr(bend(3) @ flat, mode="r") / np.sqrt(efolds.sum()) / _TAME
        return cls(pace, knots, flat, modes[:n].T / size[:n], tame)

    def rows(self, number: Array, derivative: int, side: Array) -> tuple[Array, Array]:
        """What values are of polynomials and sides, and of what is rough."""
        splines = _splines(self.knots, number, derivative)
        uneven = side[:, None] * self.pace.powers(number, derivative)
        return np.column_stack([splines @ self.flat, uneven]), splines @ self.rough

    def prior(self) -> Array:
        """What is likely of polynomials and sides: these rows of them are of order one."""
        n, m = len(self.tame), len(_POWERS)
        return np.block([[self.tame, np.zeros((n, m))], [np.zeros((m, n)), np.eye(m) / _UNEVEN]])


def _splines(knots: Array, number: Array, derivative: int) -> Array:
    every = BSpline(knots, np.eye(len(knots) - _DEGREE - 1), _DEGREE)
    return np.asarray(every(number, derivative))


@dataclass(frozen=True)
class Trend:
    """A smooth function of the cycle number, for either side of a vibration."""

    curves: Curves
    fixed: Array  # (p, g), coefficients of polynomials and sides, for each of g roughnesses
    free: Array  # (m, g), those of what is rough, in modes that the data determine one by one
    modes: Array  # (m, m), these modes
    # (p, p) and (p, m), root @ root.T is the covariance of ``fixed`` if ``free`` were known, and
    # ``along`` how what it is known by depends on that
    root: Array
    along: Array
    variance: Array  # (m, g), of ``free``
    scale: Array  # (g,), scatter of the events over what the noise says, squared
    weight: Array  # (g,), probability of every roughness

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
        """Follow values ``y`` (n,) of standard errors ``std``, one of either side in turn.

        ``number`` (n,) says where, in cycles; ``alike`` (k,) are correlations of the errors with
        those 0, 1, 2, ... values later; each ``roughness`` (g,) is tried. ``cycles`` behind each
        value take the place of what the data ask for.
        """
        roughness = roughness if cycles is None else _EVERY
        fixed, rough = curves.rows(number, 0, np.resize([1.0, -1.0], len(number)))
        white = _whitened(np.column_stack([fixed, rough, y]) / std[:, None], alike)
        fixed, rough, y = np.split(white, [fixed.shape[1], white.shape[1] - 1], axis=1)
        basis, triangle = np.linalg.qr(np.concatenate([fixed, curves.prior()]))
        basis = basis[: len(y)]
        known, known_rough = basis.T @ y, basis.T @ rough
        size, modes = eigh(rough.T @ rough - known_rough.T @ known_rough)
        size, along = np.maximum(size, 0.0)[:, None], known_rough @ modes
        part = modes.T @ (rough.T @ y) - along.T @ known
        variance = 1 / (size + roughness**-2.0)
        rest = np.sum(y**2) - np.sum(known**2) - np.sum(part**2 * variance, axis=0)
        freedom = _TRUST + max(len(y) - fixed.shape[1], 0)
        scale = (_TRUST + np.maximum(rest, 0.0)) / freedom
        root, free = np.linalg.inv(triangle), part * variance
        if cycles is None:
            # The restricted likelihood, with an inverse gamma distribution of the scale.
            surprise = np.sum(np.log1p(size * roughness**2), axis=0)
            surprise += freedom * np.log(scale)
            weight = np.exp(-(surprise - surprise.min()) / 2)
        else:
            order = len(curves.tame)
            values = order + np.sum(size * variance, axis=0)
            wanted = max(2 * (number[-1] - number[0]) / cycles, order)  # a straight line each
            nearest = np.argmin(np.abs(values - wanted))
            weight = np.eye(len(roughness))[nearest]
        fixed = root @ (known - along @ free)
        weight /= weight.sum()
        return cls(curves, fixed, free, modes, root, along, variance * scale, scale, weight)

    def __call__(
        self, number: Array, derivative: int = 0, side: float = 0.0
    ) -> tuple[Array, Array]:
        """Value or slope at cycle numbers (n,) and its standard error: of a side, or the mean."""
        return self._of(self.curves.rows(number, derivative, np.full(len(number), side)))

    def sided(self, number: Array, side: Array) -> Array:
        """Values at cycle numbers (n,), each of its own side (n,)."""
        return self._of(self.curves.rows(number, 0, side))[0]

    def mixed(self, two: Sequence[tuple[Array, int, float]], share: Array) -> tuple[Array, Array]:
        """Mean of two values (number, derivative, side), the first with this share (n,)."""
        one, other = (self.curves.rows(n, d, np.full(len(n), side)) for n, d, side in two)
        rows = [
            share[:, None] * x + (1 - share[:, None]) * y for x, y in zip(one, other, strict=True)
        ]
        return self._of((rows[0], rows[1]))

    def _of(self, rows: tuple[Array, Array]) -> tuple[Array, Array]:
        fixed, rough = rows[0], rows[1] @ self.modes
        each = fixed @ self.fixed + rough @ self.free
        mean = each @ self.weight
        certain = fixed @ self.root
        variance = np.sum(certain**2, axis=1)[:, None] * self.scale
        variance += (rough - certain @ self.along) ** 2 @ self.variance
        return mean, np.sqrt((variance + (each - mean[:, None]) ** 2) @ self.weight)


def _whitened(x: Array, alike: Array) -> Array:
    """Rows of x, (n, m), made independent."""
    alike = alike[: len(x)]
    if len(alike) < 2:
        return x
    factor = cholesky_banded(np.repeat(alike[:, None], len(x), axis=1), lower=True)
    return np.asarray(solve_banded((len(alike) - 1, 0), factor, x))
