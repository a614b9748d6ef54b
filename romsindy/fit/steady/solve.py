"""Coefficients, gain and phase from steady states, by Gauss-Newton's method with latent orbits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import norm

from romsindy.fit.steady.balance import (
    CHAIN,
    Chain,
    Rows,
    SteadyPoints,
    known,
    linearised,
    measured,
    others_of,
)
from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array, Indices

_ITERATIONS = 40
_WHOLE = 8  # of them with whole steps of the orbits: next to a fold one may go to and fro
# Largest change of a parameter, relative to it and to its error.
_SETTLED, _SURELY = 1e-9, 1e-4
# Numbers of harmonics, and the force left over at which the next one is tried.
_HARMONICS = (3, 5, 9, 15)
_RESOLVED = 1e-6
_ENOUGH = 0.2  # change by the last ones, of the errors, at which no more are needed
# Part of the force that is never explained: what is left of the equations by rounding.
_ROUNDING = 1e-9
# Correlation of neighbours that is chance in this many standard errors of it.
_CHANCE = 2.0
_NEEDED = 3.0
_CONDITION = 1e8  # of the columns, each of unit length: beyond, two of them are one


@dataclass(frozen=True, eq=False)
class SteadySolution:
    """Parameters found, and the rows at their orbits."""

    model: ReducedModel
    chain: Chain
    free: tuple[str, ...]  # parameters that were fitted: coefficients, then "gain" and "phase"
    # Part of the force that the model leaves over, as a standard deviation; 0 where the noise
    # explains it
    unexplained: float
    rows: Rows  # by all parameters that `free` names
    c: Array  # (n, 2 H + 1), Fourier coefficients of the orbits
    converged: bool

    @property
    def misfit(self) -> Array:
        """Force left over by the points as measured, over the amplitude of the force, (n, k)."""
        return self.rows.misfit / self.rows.size[:, None]

    @property
    def white(self) -> Array:
        """Misfit, (n, k), of unit variance."""
        return self.rows.whitened(self.floor)[1].reshape(self.misfit.shape)

    @property
    def over_noise(self) -> float:
        """Rms misfit over what noise of the response and errors of the values make of it.

        At a fold noise alone makes nothing of it.
        """
        rows, by_value = self.rows, self.rows.by_parameter
        moved = by_value @ self.covariance @ by_value.swapaxes(1, 2)
        both = replace(rows, noise=rows.noise + moved).whitened(_ROUNDING)[1]
        root = np.linalg.cholesky(rows.covariance(_ROUNDING))
        part = np.linalg.solve(root, np.linalg.solve(root, moved).swapaxes(1, 2))
        b = np.linalg.eigvalsh(part)
        # Of unit noise a fit takes b away; where errors of the values are more, they are left.
        return float(np.sqrt(np.sum(both**2) / np.sum(np.abs(1 - b) / (1 + b))))

    @property
    def unlikely(self) -> float:
        """Minus twice the log-likelihood, and what its parameters must gain.

        That is so many times what the Bayesian information criterion asks for: not all that is left
        of a lag is noise.
        """
        spread = np.linalg.slogdet(self.rows.covariance(self.floor))[1].sum()
        needed = _NEEDED * len(self.free) * np.log(self.white.size)
        return float(spread + np.sum(self.white**2) + needed)

    @property
    def hidden(self) -> float:
        """The largest `unexplained` that is likely: its square is a standard deviation higher.

        How well that is told follows from how fast chi-square falls with it (the Q-profile of W.
        Viechtbauer, Stat. Med. 26 (2007) 37): a normal distribution, cut off at 0.
        """
        freedom = self.misfit.size - len(self.free)

        def left(log_square: float) -> float:
            return float(np.sum(self.rows.whitened(np.exp(log_square / 2))[1] ** 2))

        at, deviation = 2 * np.log(self.floor), np.sqrt(2 * freedom)
        now = left(at)
        if now < deviation:  # hardly anything is left
            return 0.0
        std = np.exp(brentq(lambda x: left(x) - now + deviation, at, 14.0)) - np.exp(at)
        middle = self.unexplained**2 or (now - freedom) / deviation * std
        return float(np.sqrt(middle + std * norm.isf(norm.sf(1) * norm.cdf(middle / std))))

    @property
    def floor(self) -> float:
        """The part of the force left over, by rounding at least."""
        return max(self.unexplained, _ROUNDING)

    @property
    def covariance(self) -> Array:
        """Of the free parameters, where the points err independently."""
        columns = self.rows.whitened(self.floor)[0]
        scale = np.linalg.norm(columns, axis=0)
        inverse = np.linalg.pinv(columns / scale)
        return (inverse @ inverse.T) / np.outer(scale, scale)


def solve(
    points: SteadyPoints,
    model: ReducedModel,
    free: tuple[str, ...],
    gain: float | None = None,
    slope: float | None = 0.0,
    phase: float | None = None,
    like: SteadySolution | None = None,
) -> SteadySolution:
    """Fit the free coefficients, and what is not given of the `CHAIN`; from a solution ``like`` it.

    Raises a ValueError if points do not determine the parameters, or no balance is found near them.
    """
    given = (gain, slope, phase if points.phased else 0.0)
    names = (*free, *(name for name, value in zip(CHAIN, given, strict=True) if value is None))
    if not names:
        raise ValueError("fixed, gain and phase leave nothing to fit: leave one of them free")
    count = known(points).stop - known(points).start
    if count * len(points) <= len(names):
        raise ValueError(
            f"frequency has {len(points)} values, too few for {len(names)} unknowns"
            f" {list(names)}: measure more points, or name coefficients in fixed"
        )
    if like is None:
        model, chain = start(points, model, free, gain, phase)
    else:
        values = like.model.coefficients
        near = {name: values.get(name, 0.0) for name in free}
        model = replace(model, values=tuple((model.coefficients | near).values()))
        chain = like.chain
    chain = replace(chain, slope=slope or 0.0)
    c = np.zeros((len(points), 1 + 2 * max(_HARMONICS[0], points.q.shape[1])))
    c[:, known(points)] = measured(points)[0]
    for n_harmonics in _HARMONICS:
        c = np.pad(c, [(0, 0), (0, max(0, 1 + 2 * n_harmonics - c.shape[1]))])
        try:
            found = _settle(points, model, free, names, chain, c)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise ValueError(
                f"no balance is found near the measured points ({error}): give a model with fewer"
                " terms, or leave out points that are no steady states"
            ) from error
        before, model, chain, c = _values(model, chain), found.model, found.chain, found.c
        moved = np.array([_values(model, chain)[name] - before[name] for name in names])
        if np.all(np.abs(moved) < _ENOUGH * np.sqrt(np.diag(found.covariance))):
            break
        largest = int(np.argmax(points.amplitude))
        balance = HarmonicBalance(model, c.shape[1] // 2)
        if balance.leftover(c[largest][:, None], points.frequency[largest]) < _RESOLVED:
            break
    return found


def correlation(points: SteadyPoints, solution: SteadySolution) -> float:
    """Of the misfits of neighbours in a level; 0 where it is chance."""
    white, level = solution.white, points.level
    same = level[1:] == level[:-1]
    products = np.sum(white[1:] * white[:-1], axis=1)[same]
    together = float(np.mean(products) / np.mean(np.sum(white**2, axis=1)))
    if together < _CHANCE / np.sqrt(max(np.sum(same), 1)):
        return 0.0
    return min(together, 1.0)


def without_neighbours(table: Array, level: Indices, together: float) -> Array:
    """Rows (n, k, m) less what those before them in a level let expect, (n k, m)."""
    first = np.append(True, level[1:] != level[:-1])[:, None, None]
    fresh = (table - together * np.roll(table, 1, axis=0)) / np.sqrt(1 - together**2)
    return np.where(first, table, fresh).reshape(-1, table.shape[2])


def _settle(
    points: SteadyPoints,
    model: ReducedModel,
    free: tuple[str, ...],
    names: tuple[str, ...],
    chain: Chain,
    c: Array,
) -> SteadySolution:
    """Gauss-Newton's method with one number of harmonics."""
    every = (*free, *CHAIN)
    columns = [every.index(name) for name in names]
    converged = False
    unexplained = 1.0
    for i in range(_ITERATIONS):
        rows = linearised(points, model, free, chain, c)
        rows = replace(rows, by_parameter=rows.by_parameter[..., columns])
        if converged:
            break
        unexplained, step, errors = _step(rows)
        step = step if i < _WHOLE else step / 2
        moved = _orbits(points, rows, c, max(unexplained, _ROUNDING), step)
        c = moved if i < _WHOLE else (c + moved) / 2
        model, chain = _moved(model, chain, dict(zip(names, step.tolist(), strict=True)))
        at = np.array([_values(model, chain)[name] for name in names])
        small = np.abs(step) <= _SETTLED * np.abs(at) + _SURELY * errors
        converged = bool(np.all(small))
    return SteadySolution(model, chain, names, unexplained, rows, c, converged)


def _orbits(points: SteadyPoints, rows: Rows, c: Array, unexplained: float, step: Array) -> Array:
    """Fourier coefficients of the orbits after a step: the nearest ones to the measurement."""
    own, (q, std) = known(points), measured(points)
    left = rows.misfit + rows.by_parameter @ step
    pull = np.linalg.solve(rows.covariance(unexplained), left[..., None])
    nearest = q - std**2 * (rows.by_q.swapaxes(1, 2) @ pull)[..., 0]
    # The other harmonics depend on the coefficients, which come first, and not on the chain.
    n = rows.others.shape[2] - 1 - q.shape[1]
    steps = np.column_stack([np.ones(len(c)), nearest - c[:, own], np.tile(step[:n], (len(c), 1))])
    moved = c.copy()
    moved[:, others_of(points, c)] -= (rows.others @ steps[..., None])[..., 0]
    moved[:, own] = nearest
    return moved


def _step(rows: Rows) -> tuple[float, Array, Array]:
    """Part of the force left over, best change of the parameters and their errors.

    That part is such that the whitened misfits have their expected sum of squares (Mandel and
    Paule, Anal. Chem. 42 (1970) 1194); 0 where the noise alone explains them.
    """
    freedom = rows.misfit.size - rows.by_parameter.shape[2]

    def excess(log_part: float) -> float:
        return _least_squares(rows, np.exp(log_part))[1] - freedom

    low, high = np.log(_ROUNDING), np.log(1e3)
    unexplained = 0.0
    if excess(low) > 0:
        unexplained = float(np.exp(brentq(excess, low, high, xtol=1e-6)))
    step, _, errors = _least_squares(rows, max(unexplained, _ROUNDING))
    return unexplained, step, errors


def _least_squares(rows: Rows, unexplained: float) -> tuple[Array, float, Array]:
    """Best change of the parameters, sum of squares that it leaves, and errors."""
    a, b = rows.whitened(unexplained)
    scale = np.linalg.norm(a, axis=0)
    u, sizes, vt = np.linalg.svd(a / scale, full_matrices=False)
    inside = u.T @ b
    step = -(vt.T @ (inside / sizes)) / scale
    errors = np.linalg.norm(vt.T / sizes, axis=1) / scale
    return step, float(b @ b - inside @ inside), errors


def _values(model: ReducedModel, chain: Chain) -> dict[str, float]:
    return model.coefficients | vars(chain)


def _moved(model: ReducedModel, chain: Chain, step: dict[str, float]) -> tuple[ReducedModel, Chain]:
    values = _values(model, chain)
    values |= {name: values[name] + change for name, change in step.items()}
    new = replace(model, values=tuple(values[name] for name in model.coefficients))
    chain = Chain(*(values[name] for name in CHAIN))
    if "phase" in step:  # one of the many pairs of gain and phase that are one chain
        sign = -1.0 if chain.gain < 0 else 1.0
        turned = float(np.angle(sign * np.exp(1j * chain.phase)))
        chain = Chain(sign * chain.gain, sign * chain.slope, turned)
    return new, chain


def start(
    points: SteadyPoints,
    model: ReducedModel,
    free: tuple[str, ...],
    gain: float | None,
    phase: float | None,
) -> tuple[ReducedModel, Chain]:
    """One harmonic, as measured: linear in the coefficients and in gain exp(i phase).

    Raises a ValueError if the points do not determine them.
    """
    if not points.phased:
        points = replace(points, q=_guessed(points)[:, None], phased=True)
        phase = 0.0
    c = np.zeros((len(points), 1 + 2 * points.q.shape[1]))
    c[:, 1:] = measured(points)[0]
    chain = Chain(1.0, 0.0, phase or 0.0)
    rows = linearised(points, model, free, chain, c)
    weight = 1 / np.abs(points.force)[:, None]
    n = len(free)
    by_coefficient, by_force = rows.by_parameter[..., :n], rows.by_parameter[..., [n, n + 2]]
    fitted = by_force[..., : 2 if phase is None else 1 if gain is None else 0]
    # The misfit without free coefficients and, where it is fitted, without excitation.
    fixed = 0.0 if gain is None or phase is None else gain
    rest = rows.misfit + (fixed - 1.0) * by_force[..., 0]
    rest = rest - by_coefficient @ np.array([model.coefficients[name] for name in free])
    a = np.concatenate([by_coefficient, fitted], axis=2) * weight[..., None]
    a = a.reshape(rest.size, -1)
    scale = np.linalg.norm(a, axis=0)
    names = (*free, *("gain", "phase")[: fitted.shape[2]])
    _require_determined(a / np.where(scale > 0, scale, 1), names)
    found = -np.linalg.lstsq(a / scale, (rest * weight).ravel(), rcond=None)[0] / scale
    along, across = (*found[n:], 0.0, 0.0)[:2]
    if phase is None:
        chain = Chain(float(np.hypot(along, across)), 0.0, float(np.arctan2(across, along)))
    elif gain is None:
        chain = replace(chain, gain=float(along))
    if gain is not None:
        chain = replace(chain, gain=gain)
    values = model.coefficients | dict(zip(free, found[:n].tolist(), strict=True))
    return replace(model, values=tuple(values.values())), chain


def _require_determined(columns: Array, names: tuple[str, ...]) -> None:
    _, sizes, vt = np.linalg.svd(columns, full_matrices=False)
    if sizes[-1] * _CONDITION > sizes[0]:
        return
    tied = [name for name, part in zip(names, vt[-1], strict=True) if abs(part) > 0.1]
    remedy = (
        "give gain=, or add points off resonance"
        if "gain" in tied
        else "name one of them in fixed, or add points at other amplitudes and frequencies"
    )
    raise ValueError(f"the points do not tell {' from '.join(tied)}: {remedy}")


def _guessed(points: SteadyPoints) -> NDArray[np.complex128]:
    """Harmonic of q with the phase that a viscous damper would give: q / q_peak = sin(lag)."""
    ratio = points.amplitude / np.abs(points.force)
    q = np.empty(len(points), complex)
    for number in np.unique(points.level):
        some = points.level == number
        peak = np.argmax(ratio[some])
        lag = np.arcsin(ratio[some] / ratio[some][peak])
        below = points.frequency[some] < points.frequency[some][peak]
        q[some] = points.amplitude[some] * np.exp(-1j * np.where(below, lag, np.pi - lag))
    return q
