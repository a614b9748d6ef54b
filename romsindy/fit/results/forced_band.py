"""Response to a harmonic force with its 95 % band, folds included.

Next to a fold the amplitude at a frequency has no slope: a small change of the model moves the fold
past that frequency. So the curve of responses is displaced at right angles to itself, where it
always has a slope, by the errors of the model, and is read at a frequency only then.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

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
from romsindy.physics.model import ReducedModel
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
    """Amplitude and its 95 % band, (n,) each; nan beyond the range of frequencies.

    Where an amplitude is larger than any of the data behind an equation, the band is nan: no error
    of a coefficient says how far it holds. That of a `SteadyFit` goes on, given its few terms.
    """

    amplitude: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False, repr=False)
class ForcedBand(Framed):
    """Amplitude against frequency under a harmonic force, with what a measured point may scatter.

    Amplitudes are those of the first harmonic of the measured quantity: of q, q_dot or q_ddot.

    Attributes
    ----------
    frequency : (n,) array
        Uniform, over the range that was asked for, rad/s.
    amplitude, low, high : (n,) arrays
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
    _model: ReducedModel  # whose response it is
    # (4, n): frequencies, amplitudes, those of q itself, and phases along the response
    _curve: Array
    _drawn: Array  # (2, n_draws, n): the same, displaced
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
        _, value, size, _ = _read(self._curve, omega, branch)
        drawn = [_read(curve, omega, branch)[1] for curve in self._drawn.swapaxes(0, 1)]
        scattered = np.abs(np.array(drawn) + self._scatter[:, None])
        known = np.any(np.isfinite(scattered), axis=0)
        known &= self.goes_on | ~self.response.larger(size)
        ends = np.full((2, len(omega)), np.nan)
        ends[:, known] = np.nanquantile(scattered[:, known], TAILS, axis=0)
        return Predicted(value, np.minimum(ends[0], value), np.maximum(ends[1], value))

    @cached_property
    def _upper(self) -> Predicted:
        return self.at(self.frequency)

    @property
    def amplitude(self) -> Array:
        """Of the larger response, (n,)."""
        return self._upper.amplitude

    @property
    def low(self) -> Array:
        """Lower end of the 95 % band, (n,)."""
        return self._upper.low

    @property
    def high(self) -> Array:
        """Upper end of the 95 % band, (n,)."""
        return self._upper.high

    @property
    def along(self) -> Array:
        """Amplitudes of ``response``, folds and all, as they are measured, (n_orbits,)."""
        first = np.abs(self.response.coefficients[:, 1])
        return np.asarray(first * self.response.frequency**self.rate)

    @property
    def unit(self) -> str | None:
        """Of the amplitudes."""
        of_q = self.response.unit
        return of_q and of_q + ("", "/s", "/s^2")[self.rate]

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Whether the larger response is larger than any motion of the data, (n,)."""
        return self.response.larger(_read(self._curve, self.frequency, "upper")[2])

    def steady_states(self, frequency: ArrayLike) -> list[SteadyState]:
        """All responses at frequencies of the range, rad/s, the larger first, with their bands."""
        frequencies = np.atleast_1d(np.asarray(frequency, float))
        bands = {branch: self.at(frequencies, branch) for branch in BRANCHES}
        found = []
        for i, omega in enumerate(frequencies.tolist()):
            places, rows = crossed(self._curve, omega)
            stable = self.response.stable_at(places / _BETWEEN)
            for rank, (_, size, _, phase) in enumerate(rows):
                end = rank in (0, len(rows) - 1)
                branch: Branch = "middle" if not end else "lower" if rank else "upper"
                band, turned = bands[branch], np.angle(np.exp([1j * phase]))
                ends = float(band.low[i]), float(band.high[i])
                found.append(
                    SteadyState(omega, np.array([size]), turned, bool(stable[rank]), *ends)
                )
        return found

    @cached_property
    def peak(self) -> tuple[float, float]:
        """Frequency, rad/s, and amplitude of the largest response."""
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
        folds = []
        for k, fold in zip(self.response.folds, self.response.jumps, strict=True):
            on, size = fold.frequency, self.along[k]
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
        w, a = self._drawn
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
    model: ReducedModel,
    force: float,
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
    form: ArrayLike = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
) -> ForcedBand:
    """Response with its band from the errors of coefficients and of the force.

    A `UserWarning` says where there is no band, beyond the amplitudes of the data.

    The ``covariance``, (m + 1, m + 1), is that of the coefficients with these ``names``, and last
    of the force, relative to it. What is measured is q differentiated ``rate`` times, with an
    amplitude of standard deviation ``noise``. ``form``, (2, 3), are errors of form, as standard
    deviations of linear stiffness, linear damping and force, relative to it: within the data, and
    of what grows beyond (`romsindy.fit.process_noise`). The force leads the excitation, as it was
    measured, by ``lead``, rad, and acts later by ``delay``, s. ``notes`` are what else the band
    does not know; all others are as in `romsindy.forced_response` and `ForcedBand`.
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
    first = np.abs(response.coefficients[:, 1])
    size_of_q = response.amplitude
    more = grown(size_of_q, (model.amplitude_range or (0.0, np.inf))[1])[:, None]
    within, beyond = np.square(form)
    errors = np.sqrt(within + beyond * (more**2 - 1))
    terms = [term for name in names for term in smooth.terms if term.key == name]
    by_w, by_a = (
        np.column_stack([x[:, :-3], x[:, -1], errors * x[:, -3:]])
        for x in _slopes(smooth, force, response, (*terms, *LINEAR))
    )
    covariance = block_diag(covariance, np.eye(3))
    phase = np.unwrap(np.angle(response.coefficients[:, 1])) - delay * response.frequency
    table = _refined(np.column_stack([response.frequency, first, size_of_q, phase, by_w, by_a]))
    on, first, size_of_q, phase, *_ = table.T
    by_w, by_a = np.hsplit(table[:, 4:], 2)
    rng = np.random.default_rng(0)
    drawn = normal_draws(covariance, rng)
    w = np.maximum(on + drawn @ by_w.T, 0.0)
    # The logarithm of an amplitude, so that none is negative.
    a = first * np.exp(drawn @ (by_a / first[:, None]).T)
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
        np.array([on, first * on**rate, size_of_q, phase + lead + rate * np.pi / 2]),
        np.array([w, a * w**rate]),
        noise * rng.standard_normal(DRAWS),
    )
    if np.any(found.beyond) and not goes_on:
        warnings.warn(f"the response is {leaves}", stacklevel=4)
    return found


def _slopes(
    model: ReducedModel, force: float, response: ForcedResponse, terms: Sequence[Term]
) -> tuple[Array, Array]:
    """Derivatives of frequency and first amplitude of each orbit, (n, m + 1), across the curve."""
    coefficients: NDArray[np.complex128] = response.coefficients
    n, columns = coefficients.shape
    c = np.zeros((n, 2 * columns - 1))
    c[:, 0], c[:, 1::2], c[:, 2::2] = (
        coefficients[:, 0].real,
        coefficients[:, 1:].real,
        -coefficients[:, 1:].imag,
    )
    balance = HarmonicBalance(model, columns - 1)
    # The curve is about as wide as it is high in these units.
    size = np.abs(coefficients[:, 1])
    width = float(np.ptp(response.frequency[size >= size.max() / 2]))  # where it is large, rad/s
    units = np.append(np.full(c.shape[1], size.max()), width)
    orbits, omega = c[..., None], response.frequency
    _, by_c, by_omega = balance.linearise(orbits, omega)
    by_p = np.zeros((*c.shape, len(terms) + 1))
    by_p[..., :-1] = balance.by_coefficient(terms, orbits, omega)
    by_p[:, 1, -1] = -force
    matrix = np.concatenate([by_c, by_omega[..., None]], axis=2) * units
    # The shortest way: at right angles to the curve.
    change = -units[:, None] * (np.linalg.pinv(matrix) @ by_p)
    by_a = np.einsum("nk,nkp->np", c[:, 1:3], change[:, 1:3])
    return change[:, -1], by_a / np.linalg.norm(c[:, 1:3], axis=1)[:, None]


def _refined(columns: Array) -> Array:
    """Points between those of a curve, (n, k) to more of them: frequency, amplitude and others."""
    steps = np.diff(columns[:, :2] / np.ptp(columns[:, :2], axis=0), axis=0)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    between = np.interp(
        np.arange(_BETWEEN * (len(length) - 1) + 1) / _BETWEEN, np.arange(len(length)), length
    )
    return CubicSpline(length, columns)(between)


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
