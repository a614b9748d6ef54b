"""Response to a harmonic force with its 95 % band, folds included.

Next to a fold the amplitude at a frequency has no slope: a small change of the model moves the fold
past that frequency. So the curve of responses is displaced at right angles to itself, where it
always has a slope, by the errors of the model, and is read at a frequency only then.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag

from romsindy.fit.kernel.part import LINEAR
from romsindy.fit.process_noise import DRAWS, GROWS, SIGMAS, TAILS, grown, normal_draws
from romsindy.notebook import Framed
from romsindy.orbits.curves import (
    Fold,
    ForcedResponse,
    SteadyState,
    crossed,
    crossings,
    forced_response,
    frequency_range,
    rows_at,
)
from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.orbits.sweeps import LATE, jumps
from romsindy.physics.equations import Equations
from romsindy.physics.term import Term
from romsindy.record.signals import vertex
from romsindy.typing import Array

Branch = Literal["upper", "middle", "lower"]
BRANCHES: tuple[Branch, ...] = ("upper", "middle", "lower")
_ORBITS = 60  # about, and more where the damping is light
_BETWEEN = 4  # points for each, by cubic splines
# Of the range of frequencies: the curve goes on so far, for displaced ones to fill the range.
_MARGIN = 0.1
_SIGNIFICANT = 1e-9


class Predicted(NamedTuple):
    """Amplitude and its 95 % band, (n,) each, or (n, R) of R coordinates; nan beyond the range.

    Where an amplitude is larger than any of the data behind an equation, the band is nan: no error
    of a coefficient says how far it holds. That of a `SteadyFit` goes on, given its few terms.
    """

    amplitude: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False, repr=False)
class ForcedBand(Framed):
    """Amplitude against frequency under a harmonic force, with what a measured point may scatter.

    Amplitudes are those of the first harmonic of the measured quantity: of q, q_dot or q_ddot. Of R
    coordinates that response is the larger one of which some coordinate moves most.

    Attributes
    ----------
    frequency : (n,) array
        Uniform, over the range that was asked for, rad/s.
    amplitude, low, high : (n,) or (n, R) arrays
        The larger response, where there are several, and its 95 % band.
    response : ForcedResponse
        Of the model, with its folds and unstable part, and a little beyond the range.
    notes : tuple of str
        What the band does not know.
    goes_on : bool
        Whether there is a band beyond the amplitudes of the data, as of few terms that are given.
    rate : int
        How often q is differentiated to give what is measured.
    """

    frequency: Array
    response: ForcedResponse
    notes: tuple[str, ...]
    goes_on: bool
    rate: int
    _model: Equations  # whose response it is
    # (2 + 3 R, n): frequencies and the largest amplitudes along the response, then of every
    # coordinate amplitudes, those of q itself, and phases
    _curve: Array
    _drawn: Array  # (2 + R, n_draws, n): the same without sizes and phases, displaced
    _scatter: Array  # (n_draws,): of the sensor, added to an amplitude

    _columns = ("frequency", "amplitude", "low", "high")

    def at(self, frequency: ArrayLike, branch: Branch = "upper") -> Predicted:
        """Amplitude and 95 % band at some frequencies.

        Parameters
        ----------
        frequency : (n,) array
            rad/s, within the range that was asked for.
        branch : "upper", "middle" or "lower"
            Largest or smallest response where there are several. Displaced curves that fold before
            the frequency have but one, so that the band holds both where that is open. Between two
            folds the middle one of three, which is unstable: its band is of curves that have it.

        Raises
        ------
        ValueError
            If a frequency lies outside the range, or there is no such branch.
        """
        if branch not in BRANCHES:
            raise ValueError(f"branch = {branch!r} must be one of {BRANCHES}")
        omega = np.atleast_1d(np.asarray(frequency, float))
        first, last = self.frequency[[0, -1]]
        inside = (omega >= first * (1 - _SIGNIFICANT)) & (omega <= last * (1 + _SIGNIFICANT))
        if not np.all(inside):
            raise ValueError(
                f"frequency = {omega[~inside][0]:.8g} rad/s lies outside {first:.8g} to"
                f" {last:.8g}: ask forced_response for a wider range"
            )
        value, size, _ = self._by_coordinate(_read(self._curve, omega, branch))
        drawn = [_read(curve, omega, branch)[2:].T for curve in self._drawn.swapaxes(0, 1)]
        scattered = np.abs(np.array(drawn) + self._scatter[:, None, None])
        known = np.any(np.isfinite(scattered), axis=(0, 2))
        known &= self.goes_on | ~self.response.larger(size.max(axis=1))
        ends = np.full((2, *value.shape), np.nan)
        ends[:, known] = np.nanquantile(scattered[:, known], TAILS, axis=0)
        shape = omega.shape if self.response.amplitude.ndim == 1 else value.shape
        low, high = np.minimum(ends[0], value), np.maximum(ends[1], value)
        return Predicted(*(x.reshape(shape) for x in (value, low, high)))

    def _by_coordinate(self, rows: Array) -> Array:
        """Amplitudes, those of q and phases, (3, n, R), in rows of the curve, (2 + 3 R, n)."""
        return rows[2:].reshape(3, -1, rows.shape[-1]).swapaxes(1, 2)

    @cached_property
    def _upper(self) -> Predicted:
        return self.at(self.frequency)

    @property
    def amplitude(self) -> Array:
        """Of the larger response, (n,) or (n, R)."""
        return self._upper.amplitude

    @property
    def low(self) -> Array:
        """Lower end of the 95 % band, (n,) or (n, R)."""
        return self._upper.low

    @property
    def high(self) -> Array:
        """Upper end of the 95 % band, (n,) or (n, R)."""
        return self._upper.high

    @property
    def along(self) -> Array:
        """Amplitudes of ``response``, folds and all, as they are measured, (n_orbits[, R])."""
        first = np.abs(self.response.coefficients[:, 1])
        return np.asarray((first.T * self.response.frequency**self.rate).T)

    @property
    def unit(self) -> str | None:
        """Of the amplitudes."""
        of_q = self.response.unit
        return of_q and of_q + ("", "/s", "/s^2")[self.rate]

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Whether the larger response is larger than any motion of the data, (n,)."""
        _, size, _ = self._by_coordinate(_read(self._curve, self.frequency, "upper"))
        return self.response.larger(size.max(axis=1))

    def steady_states(self, frequency: ArrayLike) -> list[SteadyState]:
        """All responses at frequencies of the range, rad/s, the larger first, with their bands."""
        frequencies = np.atleast_1d(np.asarray(frequency, float))
        bands = {branch: self.at(frequencies, branch) for branch in BRANCHES}
        found = []
        for i, omega in enumerate(frequencies.tolist()):
            places, rows = crossed(self._curve, omega)
            stable = self.response.stable_at(places / _BETWEEN)
            values = self._by_coordinate(rows.T).swapaxes(0, 1)
            for rank, (size, _, phase) in enumerate(values):
                end = rank in (0, len(rows) - 1)
                branch: Branch = "middle" if not end else "lower" if rank else "upper"
                ends = (np.atleast_1d(x[i]) for x in bands[branch][1:])
                turned = np.where(size > 0, np.angle(np.exp(1j * phase)), np.nan)
                found.append(SteadyState(omega, size, turned, bool(stable[rank]), *ends))
        return found

    @cached_property
    def peak(self) -> tuple[float, float]:
        """Frequency, rad/s, and amplitude of the largest response, in any coordinate."""
        w, a, *_ = self._curve
        at = int(np.argmax(np.where(self._asked(w), a, 0.0)))
        if not (0 < at < len(a) - 1 and np.all(self._asked(w[at - 1 : at + 2]))):
            return float(w[at]), float(a[at])
        # By the parabola through three points along the curve, which has no folds there.
        before, here, after = a[at - 1 : at + 2]
        shift = float(vertex(before, here, after))
        on = np.interp(at + shift, np.arange(len(w)), w)
        return float(on), float(here - (before - after) * shift / 4)

    @cached_property
    def folds(self) -> tuple[Fold, ...]:
        """Where the curve turns back, so that a sweep jumps, in the order along the curve.

        There a curve is displaced in frequency alone, to first order.
        """
        w, a, *_ = self._curve
        folds, most = [], self.along.reshape(len(self.response), -1).max(axis=1)
        for k, fold in zip(self.response.folds, self.response.jumps, strict=True):
            on, size = fold.frequency, most[k]
            at = int(np.argmin(np.hypot(w / on - 1, a / size - 1)))
            low, high = np.quantile(self._drawn[0][:, at], TAILS).tolist()
            folds.append(fold._replace(low=min(low, on), high=max(high, on)))
        return tuple(folds)

    def jumps(self, sweep_rate: float) -> tuple[Fold, ...]:
        """Where a sweep at a steady rate jumps, in the order along the curve, each with its band.

        It is late: past the fold the motion lingers where the orbit was. The jump is where the
        amplitude changes fastest.

        Parameters
        ----------
        sweep_rate : float
            Of the angular frequency, rad/s^2; negative where it falls.

        Raises
        ------
        ValueError
            If the rate is 0 or not finite.

        Examples
        --------
        >>> import romsindy as rs
        >>> named = {"omega^2": 1.0, "gamma_3": 0.5, "c_linear": 0.04}
        >>> beam = rs.ReducedModel.from_coefficients(named)
        >>> orbits = rs.forced_response(beam, 0.1, (0.7, 1.6), n_points=40)
        >>> force = np.full(len(orbits), 0.1)
        >>> fit = rs.fit_steady(beam, orbits.frequency, force, orbits.coefficients[:, 1])
        >>> band = fit.forced_response(0.08, (0.7, 1.6))
        >>> (jump,) = band.jumps(sweep_rate=1e-4)
        >>> jump.frequency > max(fold.frequency for fold in band.folds)
        True
        """
        if not (np.isfinite(sweep_rate) and sweep_rate):
            raise ValueError(
                f"sweep_rate = {sweep_rate!r} must be finite and not 0: give it in rad/s^2,"
                " negative where the frequency falls; a very slow sweep jumps at `folds`"
            )
        found, known = [], dict(zip(self.response.folds.tolist(), self.folds, strict=True))
        for k, delay in jumps(self._model, self.response, sweep_rate):
            fold, late = known[k], SIGMAS * LATE * delay
            on = fold.frequency + delay
            low = on - float(np.hypot(fold.frequency - fold.low, late))
            high = on + float(np.hypot(fold.high - fold.frequency, late))
            found.append(Fold(on, fold.rising, low, high))
        return tuple(found)

    def _asked(self, omega: Array) -> NDArray[np.bool_]:
        """Which frequencies are in the range that was asked for."""
        return (omega >= self.frequency[0]) & (omega <= self.frequency[-1])

    @cached_property
    def peak_band(self) -> tuple[float, float]:
        """95 % interval of the largest amplitude; nan where a response is beyond the data."""
        if np.any(self.beyond) and not self.goes_on:
            return np.nan, np.nan
        w, a, *_ = self._drawn
        drawn = np.abs(np.where(self._asked(w), a, 0.0).max(axis=1) + self._scatter)
        low, high = np.quantile(drawn, TAILS)
        return float(low), float(high)

    def __repr__(self) -> str:
        low, high = self.peak_band
        ends = f"{low:.4g} to {high:.4g}" if low == low else "beyond the data"
        return (
            f"<ForcedBand: {self.frequency[0]:.6g} to {self.frequency[-1]:.6g} rad/s, largest"
            f" {self.peak[1]:.4g} ({ends}) at {self.peak[0]:.6g} rad/s>"
        )

    def __str__(self) -> str:
        folds = [
            f"Fold at {fold.frequency:.6g} rad/s ({fold.low:.6g} to {fold.high:.6g})."
            for fold in self.folds
        ]
        return "\n".join([repr(self), *folds, *(f"Note: {note}." for note in self.notes)])


def forced_band(
    model: Equations,
    force: ArrayLike,
    frequency: tuple[float, float],
    names: tuple[str, ...],
    covariance: Array,
    *,
    rate: int = 0,
    noise: float = 0.0,
    n_points: int = 100,
    n_harmonics: int | None = None,
    velocity_scale: float | None = None,
    lead: float = 0.0,
    delay: float = 0.0,
    notes: Sequence[str] = (),
    goes_on: bool = False,
    form: ArrayLike | None = None,
) -> ForcedBand:
    """Response with its band from the errors of coefficients and of the force.

    A `UserWarning` says where there is no band, beyond the amplitudes of the data.

    The ``covariance``, (m + R, m + R), is that of the coefficients with these ``names``, and last
    of the forces, one for each coordinate. What is measured is q differentiated ``rate`` times,
    with an amplitude of standard deviation ``noise``. ``form``, (2, 3), are errors of form of one
    coordinate, as standard deviations of linear stiffness, linear damping and force, relative to
    it: within the data, and of what grows beyond (`romsindy.fit.process_noise`). The force leads
    the excitation, as it was measured, by ``lead``, rad, and acts later by ``delay``, s. ``notes``
    are what else the band does not know; all others are as in `romsindy.forced_response` and
    `ForcedBand`.
    """
    low, high = sorted(frequency_range(frequency))
    reach = _MARGIN * (high - low)
    response = forced_response(
        model,
        force,
        (max(low - reach, low / 2), high + reach),
        n_harmonics,
        velocity_scale=velocity_scale,
        n_points=_ORBITS,
    )
    smooth = model if velocity_scale is None else model.regularised(velocity_scale)
    terms = [term for name in names for term in smooth.terms if term.key == name]
    first = response.coefficients[:, 1].reshape(len(response), -1)
    slopes = _slopes(smooth, response, [*terms, *(() if form is None else LINEAR)])
    if form is not None:
        more = grown(response.amplitude, (model.amplitude_range or (0.0, np.inf))[1])[:, None]
        within, beyond = np.square(form)
        errors = np.sqrt(within + beyond * (more**2 - 1)) * [1.0, 1.0, force]
        of_form = errors[:, None] * slopes[..., -3:]
        slopes = np.concatenate([slopes[..., :-3], slopes[..., -1:], of_form], axis=-1)
        covariance = block_diag(covariance, np.eye(3))
    finer = _finer(np.column_stack([response.frequency, np.abs(first)]))
    on, a = finer(response.frequency), finer(np.abs(first)).T
    rng = np.random.default_rng(0)
    drawn = np.tensordot(normal_draws(covariance, rng), finer(slopes), (1, 2))
    w = np.maximum(on + drawn[..., 0].real, 0.0)
    moved = _moved(a[:, None], np.moveaxis(drawn[..., 1:], 2, 0))
    phase = finer(np.unwrap(np.angle(first), axis=0)).T - delay * on + lead + rate * np.pi / 2
    sizes = finer(response.amplitude.reshape(len(response), -1)).T
    leaves, grows = response.leaves_within(low, high), ""
    if leaves:
        none = f"{leaves}, and there is no band; a smaller force stays within them"
        leaves, grows = (leaves, GROWS) if goes_on else (none, "")
    found = ForcedBand(
        np.linspace(low, high, n_points),
        response,
        (*filter(None, (leaves, grows, response.untraced)), *notes),
        goes_on,
        rate,
        smooth,
        np.vstack([on, a.max(axis=0) * on**rate, a * on**rate, sizes, phase]),
        np.stack([w, moved.max(axis=0) * w**rate, *(moved * w**rate)]),
        noise * rng.standard_normal(DRAWS),
    )
    if np.any(found.beyond) and not goes_on:
        warnings.warn(f"the response is {leaves}", stacklevel=4)
    return found


def _slopes(
    model: Equations, response: ForcedResponse, terms: Sequence[Term]
) -> NDArray[np.complex128]:
    """Derivatives across the curve by coefficients and forces, (n, 1 + R, m + R).

    Of the frequency, and of the first harmonic of every coordinate: real parts along it, which
    change its amplitude, and imaginary ones a quarter of a cycle ahead.
    """
    n, r, omega = len(response), model.n_coordinates, response.frequency
    c = response.series.reshape(n, -1, r)
    balance = HarmonicBalance(model, response.coefficients.shape[1] - 1)
    # The curve is about as wide as it is high in these units.
    size = np.linalg.norm(c[:, 1:3], axis=1)
    most = np.where(size.max(axis=0) > 0, size.max(axis=0), size.max())
    units = np.append(np.tile(most, c.shape[1]), min(_width(omega, x) for x in size.T))
    _, by_c, by_omega = balance.linearise(c, omega)
    by_p = np.zeros((n, c[0].size, len(terms) + r))
    if terms:
        by_p[..., :-r] = balance.by_coefficient(terms, c, omega)
    by_p[:, r : 2 * r, -r:] = -np.eye(r)  # forces are cosines
    matrix = np.concatenate([by_c, by_omega[..., None]], axis=2) * units
    # The shortest way: at right angles to the curve.
    change = -units[:, None] * (np.linalg.pinv(matrix) @ by_p)
    cosine, sine = change[:, r : 2 * r], change[:, 2 * r : 3 * r]
    first = response.coefficients[:, 1].reshape(n, r, 1)
    turned = np.where(first == 0, 1.0, np.conj(first) / np.where(first == 0, 1.0, np.abs(first)))
    return np.concatenate([change[:, -1:], (cosine - 1j * sine) * turned], axis=1)


def _width(omega: Array, size: Array) -> float:
    """Range of frequencies round its largest amplitude in which a coordinate has half of it."""
    below, at = np.flatnonzero(size < size.max() / 2), int(np.argmax(size))
    i = int(np.searchsorted(below, at))
    first = below[i - 1] + 1 if i else 0
    return float(np.ptp(omega[first : below[i] if i < len(below) else len(omega)]))


def _moved(size: Array, change: NDArray[np.complex128]) -> Array:
    """Amplitudes after a change of their harmonic, along it and ahead of it; never negative.

    By the logarithm, but for where a coordinate nearly stands still beside the change.
    """
    small = np.abs(change) < size
    part = np.where(small, change.real, 0.0) / np.where(small, size, 1.0)
    return np.where(small, size * np.exp(part), np.abs(size + change))


def _finer(along: Array) -> Callable[[Any], Any]:
    """What puts points between those of a curve, (n, 1 + R): frequencies and amplitudes."""
    reach = np.ptp(along, axis=0)
    steps = np.diff(along / np.where(reach > 0, reach, 1.0), axis=0)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    between = np.interp(
        np.arange(_BETWEEN * (len(length) - 1) + 1) / _BETWEEN, np.arange(len(length)), length
    )
    return lambda values: CubicSpline(length, values)(between)


def _read(curve: Array, omega: Array, branch: str) -> Array:
    """Rows of a curve that may fold, (k, m), at frequencies (n,), (k, n): nan where it has none.

    Its first two are frequency and amplitude. The middle one of three lies between two folds.
    """
    places = crossings(curve[0], omega)
    sizes = rows_at(places, curve[1:2].T)[..., 0]
    count = np.sum(np.isfinite(sizes), axis=0)
    rank = {"upper": 0 * count, "middle": np.where(count == 3, 1, 3), "lower": count - 1}[branch]
    order = np.argsort(-sizes, axis=0)  # nan comes last
    there = (count > 0) & (rank < count)
    which = np.take_along_axis(order, np.where(there, rank, 0)[None], axis=0)
    place = np.where(there, np.take_along_axis(places, which, axis=0)[0], np.nan)
    return rows_at(place, curve.T).T
