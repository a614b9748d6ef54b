"""What foretells samples from others: autoregressions, and where neither past nor future does.

Coefficients are [1, a_1, ..., a_p]: x_t + a_1 x_(t-1) + ... + a_p x_(t-p) is the error of the
prediction. Arrays are one channel (n,) with a uniform rate.

A free decay, of however many modes, is predicted by its own past, and backwards in time by its own
future. A blow, the end of a hold, a hand or a splice is predicted by neither. Linear predictors
of the samples ahead are fitted by least squares to a few cycles and tried on the half cycle that
follows, forwards and backwards.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.linalg import lstsq, solve_toeplitz
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d
from scipy.signal import detrend, lfilter, resample_poly

from romsindy.typing import Array, Indices

_HIGHEST_ORDER = 30  # of those that the Bayesian criterion may choose


def autoregression(x: Array, order: int | None = None) -> Array:
    """Coefficients [1, a_1, ..., a_p] that whiten a signal (n,), p by the Bayesian criterion.

    Yule-Walker equations; p = 0, no filter at all, where the signal is white already. With an
    order, that is taken, less in a short signal.
    """
    n = len(x)
    highest = min(order or _HIGHEST_ORDER, n // 10)
    lags = np.array([x[: n - k] @ x[k:] / n for k in range(highest + 1)])
    if not lags[0] > 0:
        return np.ones(1)
    if order is not None:
        lags[0] *= 1 + 1e-8  # a clean signal needs fewer values than there are
        return np.concatenate([[1.0], solve_toeplitz(lags[:-1], -lags[1:])])
    best, choice = n * np.log(lags[0]), np.ones(1)
    for p in range(1, highest + 1):
        a = solve_toeplitz(lags[:p], -lags[1 : p + 1])
        power = lags[0] + a @ lags[1 : p + 1]
        criterion = n * np.log(power) + p * np.log(n) if power > 0 else np.inf
        if criterion < best:
            best, choice = criterion, np.concatenate([[1.0], a])
    return choice


def innovation(x: Array) -> tuple[Array, int]:
    """That part of a signal (n,) which its own past does not foretell, and the order of that.

    Of its departure from its mean, by `autoregression`; the first samples have no past.
    """
    centred = x - x.mean()
    a = autoregression(centred)
    return lfilter(a, [1.0], centred)[len(a) :], len(a) - 1


def predictor(x: Array, order: int, stride: int = 1) -> Array:
    """Coefficients (order + 1,) by least squares, over lags of ``stride`` samples.

    For few cycles of a vibration, which it goes on with: Yule-Walker equations, which take a
    signal to be nothing beyond its ends, would damp it.
    """
    order = min(order, (len(x) // stride - 1) // 3)
    rows = np.stack(
        [x[(order - k) * stride : len(x) - k * stride] for k in range(order + 1)], axis=1
    )
    return np.concatenate([[1.0], -lstsq(rows[:, 1:], rows[:, 0], cond=1e-6)[0]])


def interpolated(x: Array, missing: NDArray[np.bool_], a: Array) -> Array:
    """Least-squares interpolation by an autoregression (Janssen, Veldhuis and Vries, 1986)."""
    known = np.where(missing, 0.0, x)
    units = np.eye(len(x))[missing]
    columns = np.stack([np.convolve(unit, a, "valid") for unit in units], axis=1)
    known[missing] = lstsq(columns, -np.convolve(known, a, "valid"))[0]
    return known


def coloured_product(a: Array, x: Array, y: Array) -> Array:
    """x' S y, (m, k), for the covariance matrix S of an autoregression driven by unit white noise.

    The coefficients a (p + 1,) are those of `autoregression`; x is (n, m), y (n, k).
    """
    # S = H H' with H the impulse response 1/A: filtering backwards in time applies H'.
    return lfilter([1.0], a, x[::-1], axis=0).T @ lfilter([1.0], a, y[::-1], axis=0)


# Samples a cycle, and cycles that a predictor of so many samples is fitted to; what it predicts.
_PER_CYCLE, _CYCLES, _ORDER, _AHEAD = 16, 5, 20, 0.5
_RIDGE = 1e-4  # of the mean square: vibrations of 1 % and noise alike do not make a predictor wild
# What is no free vibration differs from both predictions by this part of its size (blows on top of
# an older decay: 0.3 to 1; free decays, nonlinear ones too: below 0.2) and by this many times what
# is usual in the record.
_PART, _USUAL = 0.3, 3.5
# Background over white noise that is coloured, and what it then does to a prediction over its rms.
_COLOURED, _SLOW = 1.3, 1.5
_ALONE = 0.5  # the part where one of the predictions is alone: near the ends, or near an event
# A jump between two samples exceeds those of so many cycles before and after by this factor.
_CYCLES_AROUND, _JUMP = 1.0, 3.0
JUMP_KNOWN = 3  # samples, to which its instant is known
# Bands of a third of an octave; the lowest with this part of the energy of the greatest counts.
_BANDS, _LOWEST = 3, 0.2


def slowest_frequency(x: Array, dt: float, derivative: int) -> float | None:
    """Frequency of the slowest vibration that matters in one channel, in Hz; None without any.

    Unlike the highest line of the spectrum it survives holds, jumps and several releases:
    energies of whole bands are compared, as those of a velocity, above white noise. ``derivative``
    is 0, 1, 2 for a displacement, a velocity and an acceleration.
    """
    power = np.abs(np.fft.rfft(detrend(x))[3:]) ** 2  # lines of three cycles and more
    if len(power) < 3 or not power.max() > 0:
        return None
    lines = np.arange(3, 3 + len(power))
    band = np.floor(_BANDS * np.log2(lines / 3)).astype(int)
    count = np.bincount(band)
    noise = np.median(power) / np.log(2)
    energy = np.bincount(band, power) - noise * (count + 5 * np.sqrt(count))
    energy = energy * 2.0 ** (np.arange(len(count)) * 2 * (1 - derivative) / _BANDS / 2)
    if not energy.max() > 0:
        return None
    lowest = int(np.flatnonzero(energy > _LOWEST * energy.max())[0])
    near = (band == lowest) | (band == lowest + 1)  # a line may lie at the edge of a band
    return float(np.average(lines[near], weights=power[near]) / (len(x) * dt))


def departures(x: Array, period: float, noise: Array, background: Array) -> list[tuple[int, int]]:
    """Stretches [first, last) of samples (n, m) that are no free vibration.

    ``period`` is that of the slowest vibration, in samples, ``noise`` the standard deviation of the
    white noise of every channel, (m,), ``background`` that of what is there when nothing rings. Of
    a sudden event the true instant is inside the stretch, which is about a half cycle long.
    """
    moving = np.ptp(x, axis=0) > 0 if len(x) else np.zeros(x.shape[1], bool)
    if not moving.any():
        return []
    x, noise, background = (x - x.mean(axis=0))[:, moving], noise[moving], background[moving]
    step = max(int(period / _PER_CYCLE), 1)
    y = resample_poly(x / x.std(axis=0), 1, step, axis=0, padtype="line")
    ahead = max(int(_AHEAD * period / step), 4)
    hop = ahead // 2
    rows = max(int(_CYCLES * period / step), 3 * _ORDER) // hop * hop
    window = rows + _ORDER + ahead - 1
    if len(y) < window + 2 * ahead:
        return []
    forward = _prediction_error(y, rows, ahead, hop)
    backward = _prediction_error(y[::-1], rows, ahead, hop)
    at = np.arange(0, len(y) - ahead + 1, hop)
    past = np.interp(at, window + hop * np.arange(len(forward)), forward, left=np.inf)
    last = len(y) - window - ahead
    ahead_of = (last - hop * np.arange(len(backward)))[::-1]
    future = np.interp(at, ahead_of, backward[::-1], right=np.inf)
    error = np.minimum(past, future)
    # At the very ends the resampling filter has nothing to work on.
    known = np.isfinite(error) & (at >= ahead) & (at <= len(y) - 2 * ahead)
    part = np.where(np.isfinite(past) & np.isfinite(future), _PART, _ALONE)
    size = _rms(y, at - hop, at + ahead + hop)
    # Resampling averages white noise over so many samples, and nothing slower, of which there is
    # more in half a cycle than in the amplitude over one.
    slow = background > _COLOURED * noise
    heard = np.where(slow, _SLOW * background, noise / np.sqrt(step)) / x.std(axis=0)
    usual = max(float(np.median(error[known])), float(np.linalg.norm(heard)))
    odd = known & (error > part * size) & (error > _USUAL * usual) & (error > 1e-6 * size.max())
    edges = np.flatnonzero(np.diff(np.concatenate([[0], odd, [0]]))).reshape(-1, 2)
    runs: list[tuple[int, int]] = []
    for first, last in _certain(edges, error / size, window // hop):
        # The last interval that is hard to predict begins before the end of the event.
        a, b = int(at[first]), int(at[last - 1]) + 3 * hop // 2
        if runs and a <= runs[-1][1] + ahead:
            runs[-1] = (runs[-1][0], b)
        else:
            runs.append((a, b))
    return [(a * step, min(b * step, len(x))) for a, b in runs]


def unpredicted(x: Array, period: float, cycles: float) -> float:
    """Part of one channel that one linear predictor, so many cycles ahead, leaves."""
    step = max(int(period / _PER_CYCLE), 1)
    y = resample_poly(x - x.mean(), 1, step, padtype="line")
    y = y - uniform_filter1d(y, max(round(period / step), 1))  # what is slower is no vibration
    past = sliding_window_view(y, _ORDER)[: -max(round(cycles * period / step), 1)]
    future = y[len(y) - len(past) :]
    left = future - past @ np.linalg.lstsq(past, future)[0]
    # Medians: a blow among the samples is not predicted, and no background.
    return float(np.median(np.abs(left)) / np.median(np.abs(future)))


def unexplained(y: Array, u: Array, period: float) -> float:
    """Part of y (n,) that its past, half a cycle ago, and an input u (n,) until now leave."""
    step = max(int(period / _PER_CYCLE), 1)
    y, u = (resample_poly(x - x.mean(), 1, step, padtype="line") for x in (y, u))
    ahead = max(int(_AHEAD * period / step), 1)
    rows = sliding_window_view(y, _ORDER)[:-ahead]
    rows = np.concatenate([rows, sliding_window_view(u, _ORDER + ahead)], axis=1)
    now = y[len(y) - len(rows) :]
    left = now - rows @ np.linalg.lstsq(rows, now)[0]
    return float(np.std(left) / np.std(now))


def _certain(runs: Indices, part: Array, window: int) -> Indices:
    """Runs of intervals, (n, 2), but for those that may be due to another one.

    The predictor that was fitted across an event is wrong: for a window's length one is alone.
    """
    worst = np.array([part[a:b].max() for a, b in runs])
    near = np.maximum(runs[:, None, 0] - runs[:, 1], runs[:, 0] - runs[:, None, 1]) < window
    return runs[(worst > _ALONE) | ~(near & (worst > worst[:, None])).any(axis=1)]


def jumps(x: Array, period: float) -> list[int]:
    """First samples of (n, m) after a jump: two records were joined, or zeros put between.

    Medians of three samples are compared, which do not see a spike.
    """
    smooth = median_filter(x, (3, 1), mode="nearest")
    step = np.zeros_like(x)
    step[2:-2] = np.abs(smooth[3:-1] - smooth[:-4])  # over three intervals, round the second
    # The period may be that of a vibration that dies before a slower one does.
    reach = max(int(_CYCLES_AROUND * period), 4)
    # The largest steps of the cycles that end four samples before and start four after.
    usual = maximum_filter1d(step, reach, axis=0, mode="constant", origin=0)
    before, after = np.zeros_like(x), np.zeros_like(x)
    shift = 4 + reach // 2
    before[shift:], after[:-shift] = usual[:-shift], usual[shift:]
    least = np.maximum(1e-3 * np.ptp(x, axis=0), np.finfo(float).tiny)
    excess = np.max(step / np.maximum(np.maximum(before, after), least), axis=1)
    found = np.flatnonzero(excess > _JUMP)
    groups = np.split(found, np.flatnonzero(np.diff(found) > 4) + 1) if len(found) else []
    return [int(g[np.argmax(excess[g])]) + 1 for g in groups]


def _prediction_error(y: Array, rows: int, ahead: int, hop: int) -> Array:
    """Rms over the channels and the samples ahead of every window of y (n, m), ``hop`` apart.

    A window is fitted through so many rows; its prediction starts where it ends.
    """
    n = len(y) - ahead + 1
    count = len(y) - (rows + _ORDER + 2 * ahead - 1) + 1
    n_windows = (count - 1) // hop + 1

    def products(i: int, j: int) -> Array:
        """Sums over the rows of windows of y[t + i] y[t + j]."""
        product = np.sum(y[_ORDER + i : n + i] * y[_ORDER + j : n + j], axis=1)
        # Sums of sums: differences of a running sum would lose the quiet end of a decay.
        blocks = product[: len(product) // hop * hop].reshape(-1, hop).sum(axis=1)
        return sliding_window_view(blocks, rows // hop)[:n_windows].sum(axis=1)

    normal = np.empty((n_windows, _ORDER, _ORDER))
    right = np.empty((n_windows, _ORDER, ahead))
    for i in range(_ORDER):
        for j in range(i + 1):
            normal[:, i, j] = normal[:, j, i] = products(-1 - i, -1 - j)
        for k in range(ahead):
            right[:, i, k] = products(-1 - i, k)
    mean = np.trace(normal, axis1=1, axis2=2) / _ORDER
    ridge = _RIDGE * mean + np.finfo(float).tiny
    predictor = np.linalg.solve(normal + ridge[:, None, None] * np.eye(_ORDER), right)
    end = rows + _ORDER + ahead - 1 + hop * np.arange(n_windows)
    known = np.stack([y[end - 1 - i] for i in range(_ORDER)], axis=2)
    truth = np.stack([y[end + k] for k in range(ahead)], axis=2)
    return np.sqrt(np.mean(np.sum((known @ predictor - truth) ** 2, axis=1), axis=1))


def _rms(y: Array, first: Indices, last: Indices) -> Array:
    total = np.concatenate([[0.0], np.cumsum(np.sum(y**2, axis=1))])
    first, last = np.clip(first, 0, len(y)), np.clip(last, 0, len(y))
    return np.sqrt(np.clip(total[last] - total[first], 0, None) / (last - first))
