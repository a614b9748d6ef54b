"""Fits of series to records, with as much smoothness and process noise as the data support.

For values with a Gaussian prior, linearised about the present motions, the marginal likelihood of
the data is a closed form. Its maximum over the scales of the prior and the size of the process
noise (`windows`) says how much of a function the data ask for [1]; its curvature says how far other
scales would do.

Functions that may be true are draws of the posterior in which inertia is never negative: h is the
kinetic energy of the modes that are dragged along, a sum of squares. Draws keep to the cone of
series with h >= 0 on the range of the data; their mean is in it too, for a cone is convex.

What is known of the functions of an equation before the data speak: smooth, no inertia below 0.

Smooth: Gaussian processes with scales of their own, a trend that may be anything (a constant, a
slope, a parabola) and a departure from it, with correlation

    size^2 (1 + d) exp(-d),  d = sqrt(3) |z - z'| / length       (Matern, once differentiable [2])

between places z = q / reach. Its part that is odd in z, which a symmetric structure has not, is
smaller by a factor. Size, length and asymmetry of each function follow from the data: terms that
the data do not support shrink to nothing, and no order has to be chosen. The process is once
differentiable only: the shrinkage of high orders stays mild, so that features that are sharper than
the rest are not smoothed away.

The inertia is nowhere negative on the range of the data: values keep to a cone of series.

[1] D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415.
[2] C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", 2006, sections
    4.2 (kernels), 2.7 (trend) and 5.4 (scales from the marginal likelihood).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import linprog, minimize, nnls
from scipy.special import ndtr, ndtri

from romsindy.fit.functions.series import Series
from romsindy.fit.functions.windows import Block, Linear, Reduced, Window, linearised, reduced
from romsindy.fit.kernel.collocation import GROWN, TrajectoryError
from romsindy.fit.kernel.linear_response import nodes
from romsindy.fit.kernel.noises import Noises
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import EQUIVALENT, EXPLAINED
from romsindy.typing import Array

# Of stiffness, inertia and damping: standard deviations of the first terms of the trend. Values of
# order one are normal (see `Series`); the constants of stiffness and damping may be anything.
_TREND = ((10.0, 1.0, 1.0), (1.0,), (0.0, 1.0))
_CONSTANT = 10.0  # of the damping, see `Series`
_FORCE = 3.0
# Logarithms of size, length and asymmetry: middle and spread of what they are expected to be, wide,
# and their limits. A length of 0.2 is about what 17 polynomials resolve.
_SIZES = (0.2, 0.1, 0.1)
MIDDLE = np.log([(size, 1.0, 0.3) for size in _SIZES]).ravel()
SPREAD = np.tile([2.0, 0.7, 1.0], 3)
LOW = np.tile(np.log([1e-6, 0.2, 0.01]), 3)
HIGH = np.tile(np.log([10.0, 5.0, 1.5]), 3)
_PLACES = 81  # where h >= 0 is asked for


def prior_factor(series: Series, scales: Array) -> Array:
    """L with prior covariance L L' of the values of a series; ``scales`` (9,) as in `MIDDLE`."""
    sizes = np.exp(scales).reshape(3, 3)
    k, r, d = (
        _of_function(n, *own, trend)
        for n, own, trend in zip(series.sizes, sizes.tolist(), _TREND, strict=True)
    )
    others = [_FORCE] * len(series.forces) + series.sensor.spread
    blocks = (k, r, np.full((1, 1), _CONSTANT), d, np.diag(others))
    ends = np.cumsum([len(b) for b in blocks])
    out = np.zeros((ends[-1], ends[-1]))
    for own, end in zip(blocks, ends, strict=True):  # as block_diag, which takes longer by far
        out[end - len(own) : end, end - len(own) : end] = own
    return out


def prior_cost(scales: Array) -> float:
    """Minus the logarithm of the prior density of the scales."""
    off = (scales - MIDDLE) / SPREAD
    return float(off @ off / 2 + np.sum(np.log(SPREAD * np.sqrt(2 * np.pi))))


@lru_cache(maxsize=64)  # differences by one scale leave two of the functions as they are
def _of_function(n: int, size: float, length: float, odd: float, trend: tuple[float, ...]) -> Array:
    """Factor of the covariance of the Chebyshev coefficients of one function, (n, n)."""
    if n <= 1:  # a constant
        return np.eye(n) * trend[0]
    apart, to_series = _grid(n)
    d = np.sqrt(3) * (apart / length)
    near, far = (1 + d) * np.exp(-d)
    values = size**2 * ((near + far) / 2 + odd**2 * (near - far) / 2)
    covariance = to_series @ values @ to_series.T
    first = range(min(len(trend), n))
    covariance[first, first] += np.square(trend[:n])
    w, v = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray(v * np.sqrt(np.maximum(w, 1e-14 * w[-1])))


@lru_cache(maxsize=64)
def _grid(n: int) -> tuple[Array, Array]:
    """Distances of n places from one another and from their images, and what makes a series."""
    z = chebyshev.chebpts1(n)
    apart = np.abs(np.stack([z[:, None] - z, z[:, None] + z]))
    return apart, np.linalg.inv(chebyshev.chebvander(z, n - 1))


def constraints(series: Series) -> tuple[slice, Array]:
    """Where the values of the inertia are, and h / z^2 at many places for each of them."""
    n_k, n_r, _ = series.sizes
    z = np.cos(np.linspace(0, np.pi, _PLACES))
    return slice(n_k, n_k + n_r), chebyshev.chebvander(z, max(n_r - 1, 0))


def nearest(series: Series, mean: Array, root: Array) -> Array:
    """The most probable of mean + root x, x standard normal, that lie in the cone.

    Least distance by non-negative least squares: C. L. Lawson, R. J. Hanson, "Solving Least Squares
    Problems", 1974, chapter 23.
    """
    inertia, places = constraints(series)
    if not series.sizes.inertia or np.all(places @ mean[inertia] >= 0):
        return mean
    slope, missing = places @ root[inertia], -places @ mean[inertia]
    size = np.linalg.norm(slope, axis=1)
    if not (np.all(np.isfinite(mean)) and np.all(size > 0)):
        return mean  # there is no motion: nothing is to be mended
    table = np.vstack([slope.T / size, missing / size])
    aim = np.append(np.zeros(len(mean)), 1.0)
    rest = table @ nnls(table, aim, maxiter=50 * _PLACES)[0] - aim
    if not rest[-1] < 0:
        return mean  # so far off that no digits are left
    return np.asarray(mean - root @ (rest[:-1] / rest[-1]))


def lifted(r: Array) -> Array:
    """A Chebyshev series that dips below 0 between the places by a trace, lifted to 0."""
    roots = chebyshev.chebroots(chebyshev.chebder(r)) if len(r) > 2 else np.zeros(0)
    inner = roots.real[(np.abs(roots.imag) < 1e-6) & (np.abs(roots.real) < 1)]
    least = np.min(chebyshev.chebval(np.r_[-1.0, 1.0, inner], r))
    return np.append(r[0] + max(-least, 0.0), r[1:])


_ITERATIONS = 25
_LEASH = 0.3  # largest change of a motion in one step, in amplitudes
_LOST = 1e4  # changes, in amplitudes, that lead nowhere
# A structure whose misfit is so many times the noise after so many steps will not come down.
_HOPELESS, _PATIENCE = 3.0, 3
_EACH = 8  # draws for each set of scales
_SWEEPS = 20  # of Gibbs' sampler: each forgets where it started after a few
_NEAR = 0.05  # changes, in amplitudes, below which the equation is nearly linear
_ROUGH = 0.03  # errors of the smoothed acceleration, as a part of its rms
# A step this small, in amplitudes, changes no figure that is printed; neither does this in the
# logarithm of the evidence.
_SMALL_STEP, _SMALL_GAIN = 1e-3, 0.1
# Process noise from window to window, in amplitudes: from nothing to a phase that is lost.
JUMPS = 10.0 ** np.arange(-7, -0.9, 0.5)
_ASTRAY = (
    "no motion of one coordinate follows the measured one: several modes take part, the records are"
    " of different structures, or a fixed coefficient is wrong; cut or filter the record, leave the"
    " coefficient free, or be content with a regression (HarmonicSINDy, romsindy regress)"
)


class Normal(NamedTuple):
    """Values mean + root x, x standard normal."""

    mean: Array
    root: Array


@dataclass(frozen=True, eq=False)
class Fitted:
    """Series fitted to records."""

    series: Series  # with the most probable values
    windows: tuple[Window, ...]  # with their motions
    linear: tuple[Linear, ...]  # every record, linearised about them
    known: Array  # (m, p + 1), rows for what was known beforehand
    noise: float  # of the whitened signals: 1, or more where the misfit is larger than the noise
    jump: float  # process noise, in amplitudes
    scales: Array  # (9,), of the prior, see `prior_factor`
    cost: float  # minus the logarithm of the evidence at these scales
    converged: bool
    # Of every record, where a force that nobody measured takes the place of process noise: see
    # `unmeasured`
    noises: tuple[Noises, ...] = ()

    @property
    def records(self) -> tuple[Record, ...]:
        """With the noise by which they were weighed."""
        return tuple(x.record for x in self.linear)

    @cached_property
    def reduced(self) -> Reduced:
        """What the windows say of the values alone."""
        return reduced(self.linear, self.series.scales.rate, self.noise, self.jump, self.known)

    @property
    def n_effective(self) -> int:
        """Number of values that the data determine, with the start of every record."""
        triangle = _triangle(self.reduced, prior_factor(self.series, self.scales))
        free = len(self.series.values) - float(np.sum(np.linalg.inv(triangle[:-1, :-1]) ** 2))
        return round(free) + 2 * len({w.record for w in self.windows})

    @property
    def curvature(self) -> tuple[float, float]:
        """Of the sensor, and its standard error, as parts of the largest amplitude."""
        at = len(self.series.values) - self.series.sensor.size
        return float(self.series.values[at]), float(np.linalg.norm(self.posterior().root[at]))

    def posterior(self, scales: Array | None = None) -> Normal:
        """Of the values, for these scales of the prior or others."""
        factor = prior_factor(self.series, self.scales if scales is None else scales)
        return _normal(_triangle(self.reduced, factor), factor)

    @property
    def dispersion(self) -> float:
        """Variance of the values by the scatter of the windows over that by the noise; 1 for noise.

        What a wrong model leaves does not average out like noise: within a window it pulls all
        values the same way. The pulls of the windows, summed, are nothing at the best fit; their
        squares say how large the error of the values really is. This is the sandwich estimator
        with windows as clusters, brought down to one number: H. White, "Maximum likelihood
        estimation of misspecified models", Econometrica 50 (1982) 1.
        """
        p = len(self.series.values)
        # Directions in which the posterior is a standard normal.
        root, values = self.posterior().root, self.series.values
        pulls, expected = 0.0, 0.0
        for linear, starts in zip(self.linear, self.reduced.starts, strict=True):
            # The best starts follow the values.
            changes = np.vstack([-starts, np.eye(p + 1)])
            wide = np.column_stack([changes[:, :p] @ root, changes @ np.append(values, -1.0)])
            for white in linear.whitened(wide / self.noise):
                jacobian, rest = white[:, :p], white[:, p]
                pull, own = jacobian.T @ rest, jacobian.T @ jacobian
                pulls += float(pull @ pull)
                expected += float(np.trace(own) - np.sum(own * own))
        return pulls / expected

    def scale_covariance(self) -> Array:
        """Covariance of the scales by the curvature of the evidence, (9, 9)."""
        rows = self.reduced
        hessian = _hessian(lambda x: _cost(self.series, rows, x), self.scales)
        w, v = np.linalg.eigh(hessian)
        # Where the evidence is flat, or at a limit of the scales, what was expected holds.
        return np.asarray((v / np.maximum(w, 0.25)) @ v.T)

    def log_evidence(self) -> float:
        """Logarithm of the evidence of the structure, over all scales (Laplace)."""
        root = np.linalg.cholesky(2 * np.pi * self.scale_covariance())
        return float(-self.cost + np.sum(np.log(np.diag(root))))


def fit(
    series: Series,
    windows: Sequence[Window],
    records: Sequence[Record],
    known: Array,
    *,
    start: Fitted | None = None,
    noise: float | None = None,
    jumps: Array = JUMPS,
    progress: Callable[[str], None] | None = None,
) -> Fitted:
    """Fit series to records, from starting values and from the motions of some windows.

    Where ``noise``, that of the whitened signals, is not given it is as large as the misfit asks
    for, and samples weigh alike unless no more than their noise is left: what an equation leaves
    does not have its colour, and may drift. ``known`` (m, p + 1) are rows for the values, and what
    they come to, over the error. A ``start`` has scales and process noise, ``jumps`` are the sizes
    of that to choose from. Raises a TrajectoryError if the motion goes astray, or stays far from
    the records though their noise is given.
    """
    scales = MIDDLE if start is None else start.scales
    jump = float(np.clip(1e-2, jumps[0], jumps[-1])) if start is None else start.jump
    level, last = noise or 1.0, np.inf
    own, largest = tuple(windows), np.inf
    undecided = noise is None
    heard = [r.weighing_alike() for r in records] if undecided else records
    for iteration in range(_ITERATIONS):
        with np.errstate(all="ignore"):
            linear = linearised(series, own, heard)
        if not all(np.all(np.isfinite(x.rows)) for x in linear):
            raise TrajectoryError(_ASTRAY)
        now = Fitted(series, own, linear, known, level, jump, scales, last, False)
        # Evidence means something where the equation is linear: near the end.
        if largest < _NEAR and undecided:
            now, undecided = _by_colour(now, records), False
            heard = now.records
        if largest < _NEAR and len(jumps) > 1:
            now = _best_jump(now, jumps)
        if largest < _NEAR or start is not None:
            now = better_scales(now)
        values, step, largest, misfit = _step(now)
        far = noise is not None and iteration >= _PATIENCE and misfit > _HOPELESS * noise
        if far or not largest < _LOST:
            raise TrajectoryError(_ASTRAY)
        if progress is not None:
            progress(f"misfit {misfit:.4g} times the noise, change {largest:.1e}")
        short = min(1.0, _LEASH / max(largest, 1e-300))
        series = series.moved(series.values + short * (values - series.values))
        own = tuple(b.moved(short * s) for b, s in step)
        settled = largest < _SMALL_STEP and abs(last - now.cost) < _SMALL_GAIN
        if settled:
            break
        level = noise or max(1.0, misfit)
        jump, scales, last = now.jump, now.scales, now.cost
    final = replace(now, series=series, windows=own, linear=linearised(series, own, heard))
    return replace(final, converged=settled)


def regressed(series: Series, records: Sequence[Record]) -> Series:
    """Values to start from: regression of the smoothed acceleration on the terms."""
    scales = prior_factor(series, MIDDLE)
    rows = [np.eye(len(scales), len(scales) + 1)]
    for record in records:
        state = nodes(record.motion)
        size = _ROUGH * float(np.std(state[3]))
        slopes = series.by_parameter(*state)[..., 0].T @ scales
        rows.append(np.column_stack([slopes, -state[3]]) / size)
    triangle = np.asarray(np.linalg.qr(np.concatenate(rows), mode="r"))
    return series.moved(nearest(series, *_normal(triangle, scales)))


def _by_colour(now: Fitted, records: Sequence[Record]) -> Fitted:
    """The same by the noise as it is, where no more than that is left; else all samples alike."""
    if all(record.noise.one_by_one for record in records):
        return now
    coloured = replace(now, linear=linearised(now.series, now.windows, records), noise=1.0)
    *_, misfit = _step(coloured)
    return coloured if misfit <= EXPLAINED else now


def _best_jump(now: Fitted, jumps: Array) -> Fitted:
    each = [replace(now, jump=float(j)) for j in jumps]
    costs = np.array([_cost(now.series, f.reduced, now.scales) for f in each])
    # The least of which the data cannot tell the best: no departure is invented.
    return each[int(np.argmax(2 * (costs - costs.min()) <= EQUIVALENT))]


def better_scales(now: Fitted) -> Fitted:
    """The same with the scales of the largest evidence."""
    rows = now.reduced
    if not np.all(np.abs(rows.rows) < GROWN):  # nan is not
        raise TrajectoryError(_ASTRAY)
    found = minimize(
        lambda x: _cost(now.series, rows, x),
        now.scales,
        method="L-BFGS-B",
        bounds=list(zip(LOW, HIGH, strict=True)),
        # Values of the evidence are good to about 1e-6: differences want steps well above that.
        options={"maxiter": 60, "eps": 1e-3},
    )
    return replace(
        now, scales=found.x, cost=float(found.fun) + _count(now) * float(np.log(now.noise))
    )


def _cost(series: Series, rows: Reduced, scales: Array) -> float:
    """Minus the logarithm of the evidence and of the prior of the scales."""
    triangle = _triangle(rows, prior_factor(series, scales))
    inside = np.sum(np.log(np.abs(np.diag(triangle)[:-1])))
    return float(triangle[-1, -1] ** 2 / 2 + inside) + rows.cost + prior_cost(scales)


def _triangle(rows: Reduced, factor: Array) -> Array:
    """Triangle [R, y; 0, rest] of data and prior for x, with values = factor x."""
    p = len(factor)
    seen = np.column_stack([rows.rows[:, :p] @ factor, rows.rows[:, p]])
    return np.asarray(np.linalg.qr(np.concatenate([seen, np.eye(p, p + 1)]), mode="r"))


def _normal(triangle: Array, factor: Array) -> Normal:
    """Values = factor x with R x = y but for standard normal errors."""
    root = factor @ np.linalg.inv(triangle[:-1, :-1])
    return Normal(root @ triangle[:-1, -1], root)


def _count(now: Fitted) -> float:
    """Samples that tell anything."""
    return sum(linear.record.count for linear in now.linear)


def _step(now: Fitted) -> tuple[Array, list[tuple[Block, Array]], float, float]:
    """Most probable values, changes of values and start of each window, their size, the misfit."""
    values = nearest(now.series, *now.posterior())
    states = now.reduced.states(values)
    change = values - now.series.values
    step = [
        (block, np.concatenate([change, start - block.window.motion.start]))
        for linear, starts in zip(now.linear, states, strict=True)
        for block, start in zip(linear.blocks, starts, strict=True)
    ]
    largest = max(block.size_of(s) for block, s in step)
    with np.errstate(over="ignore"):
        left = [x.left(values, s) for x, s in zip(now.linear, states, strict=True)]
        squares = sum(float(e @ e) for e in left)
    return values, step, largest, float(np.sqrt(squares / max(_count(now) - len(values), 1)))


def _hessian(f: Callable[[Array], float], x: Array, step: float = 0.05) -> Array:
    n = len(x)
    e = step * np.eye(n)
    middle = f(x)
    up, down = np.array([f(x + d) for d in e]), np.array([f(x - d) for d in e])
    hessian = np.diag((up + down - 2 * middle) / step**2)
    for i in range(n):
        for j in range(i):
            both = (f(x + e[i] + e[j]) - up[i] - up[j] + middle) / step**2
            hessian[i, j] = hessian[j, i] = both
    return hessian


# -- functions that may be true --------------------------------------------------------------------


def draw(found: Fitted, n: int, rng: np.random.Generator) -> Array:
    """Values of the series, (n, p), drawn from their posterior over all scales of the prior."""
    spread = np.linalg.cholesky(found.scale_covariance())
    inertia, places = constraints(found.series)
    bundles, dips = [], []
    for _ in range(-(-n // _EACH)):
        scales = found.scales + spread @ rng.standard_normal(len(spread))
        mean, root = found.posterior(np.clip(scales, LOW, HIGH))
        x = rng.standard_normal((len(mean), _EACH))
        # x = q u + what inertia does not see; h >= 0 says offset + slope u >= 0.
        q, t = np.linalg.qr(root[inertia].T)
        offset, slope = (places[:, : len(t)] @ y for y in (mean[inertia], t.T))
        u = q.T @ x
        bundles.append((mean, root, x - q @ u, q, u))
        if np.any(offset[:, None] + slope @ u < 0):
            dips.append((offset, slope, u, rng.random((_SWEEPS, *u.shape))))
    if dips:
        _hold_in_cone(dips)
    draws = np.concatenate([(m[:, None] + r @ (x + q @ u)).T for m, r, x, q, u in bundles])[:n]
    if found.series.sizes.inertia:
        draws[:, inertia] = [lifted(r) for r in draws[:, inertia]]
    return draws


def _hold_in_cone(dips: Sequence[tuple[Array, Array, Array, Array]]) -> None:
    """Replace standard normal u by ones with offset + slope u >= 0, by even chances.

    Gibbs' sampler, one u_i after another: J. Geweke, "Efficient simulation from the multivariate
    normal subject to linear constraints", 1991.
    """
    offsets, slopes, several, chances = zip(*dips, strict=True)
    offset, slope, chance = np.stack(offsets)[..., None], np.stack(slopes), np.stack(chances)
    inner = np.stack([_inside(*cone) for cone in zip(offsets, slopes, strict=True)])
    u = np.repeat(inner[..., None], several[0].shape[1], axis=2)
    for sweep in range(_SWEEPS):
        for i in range(u.shape[1]):
            column = slope[:, :, [i]]
            rest = offset + slope @ u - column * u[:, [i]]
            with np.errstate(divide="ignore", invalid="ignore"):
                limit = -rest / column
            low = np.max(limit, axis=1, initial=-np.inf, where=column > 0)
            high = np.min(limit, axis=1, initial=np.inf, where=column < 0)
            u[:, i] = _truncated(low, np.maximum(high, low), chance[:, sweep, i])
    for old, new in zip(several, u, strict=True):
        old[:] = new


def _truncated(low: Array, high: Array, chance: Array) -> Array:
    """Standard normal between limits, by chance; by symmetry in the tail where digits are left."""
    flip = np.where(low > 0, -1.0, 1.0)
    a, b = np.where(flip < 0, -high, low), np.where(flip < 0, -low, high)
    below, above = ndtr(a), ndtr(b)
    drawn = ndtri(below + (above - below) * chance)
    # So far out that no digits are left, all of it is at the near end.
    drawn = np.where(above > 0, np.clip(drawn, a, b), b)
    return np.asarray(flip * drawn)


def _inside(offset: Array, slope: Array) -> Array:
    """A point well inside offset + slope u >= 0: the margin, up to one, as large as can be."""
    size = np.abs(offset).max()
    k = slope.shape[1]
    found = linprog(
        np.append(np.zeros(k), -1.0),
        A_ub=np.column_stack([-slope, np.full(len(offset), size)]),
        b_ub=offset,
        bounds=[(None, None)] * k + [(0.0, 1.0)],
    )
    return np.asarray(found.x[:-1])
