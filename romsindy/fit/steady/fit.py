"""Fit a model to measured steady states: stepped sine, phase resonance, control-based continuation.

A steady state says: these harmonics of q need that force. The balance of forces is linear in the
coefficients, and its first harmonic alone gives the start. Then every point gets an orbit of its
own, whose measured harmonics keep to the measurement within its noise and whose others follow from
the balance (`romsindy.fit.steady.balance`). What is minimised is the force that is left over,
weighted by what the noise of the response makes of it: errors in variables, [1].

The common choice, measured less computed response at a given frequency, has no slope at a fold and
must know the branch. A force left over has neither trouble: unstable points count as others do.
Terms that are not given are chosen by what each gains on levels of force left out.

What the noise does not explain is taken for a force that the model leaves out: a part of the
excitation, alike at all points, found from the fit. As such misfits go together in neighbouring
points, the covariance is that of least squares with errors so correlated.

[1] H. Britt, R. Luecke, "The estimation of parameters in nonlinear, implicit models",
    Technometrics 15 (1973) 233.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from romsindy.effects.choices import sought
from romsindy.fit.choice import Gram, Linearised, Trials, counting_choice
from romsindy.fit.kernel.part import LINEAR
from romsindy.fit.process_noise import KNOWN, wider
from romsindy.fit.records.arguments import not_fixed
from romsindy.fit.results.estimate import Estimate
from romsindy.fit.results.forced_band import ForcedBand, forced_band
from romsindy.fit.steady.balance import (
    CHAIN,
    RATES,
    Chain,
    SteadyPoints,
    linearised,
    parts_of_force,
)
from romsindy.fit.steady.independence import between_levels, notes_on, verdict_of, with_spread
from romsindy.fit.steady.solve import SteadySolution, correlation, solve
from romsindy.fit.steady.sweeps import HARMONICS, Sweeps, orbits_of, smoothed
from romsindy.orbits.curves import checked_force
from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.physics.damping import FrictionLaw
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.physics.term_sum import json_text, read_json
from romsindy.physics.validation import made, table
from romsindy.physics.validation import text as entry
from romsindy.record.recording import Quantity
from romsindy.text import with_error
from romsindy.typing import Array, Indices

_GAIN = 0.01  # standard deviation of the gain of a level at most, as a part of it
_BY_CHANCE = 0.05  # chance of a scatter of levels that is taken for one, though it is none
_ONE_LAG = 0.1  # rad: phases that differ by less
_SURE = 3.0  # standard errors of the gain, at least
_ALWAYS, _LINEAR = LINEAR
_LAWS = tuple(sorted((_LINEAR, *sought("steady")), key=lambda law: law.has("damping")))
# Rounds in which lags and delays of sweeps settle, and the first, in which terms are chosen.
_SWEPT, _CHOOSING = 5, 2
_ROUNDS = 5  # of a choice about the orbits of the model that was chosen last
_BLOCKS = 5
_ALIKE = 1.001  # of an end of a range: beyond, it is left


@dataclass(frozen=True, eq=False)
class SteadyTest:
    """What points of steady states tell of the excitation, and of a further level of it."""

    chain: Chain  # from the measured excitation to a force per unit mass
    free: tuple[str, ...]  # coefficients that were fitted, then what was of the chain
    # (p, p), of these, with what levels differ by
    covariance: Array
    # (2, 3), what a further level may differ by, see `between_levels`
    form: Array
    unexplained: float  # part of the force that neither model nor noise explain
    measured: Quantity
    noise: float  # standard deviation of an amplitude, as measured
    n_harmonics: int
    forces: Array  # (2,), least and largest amplitude of the excitation, as measured
    frequencies: Array  # (2,), lowest and highest, rad/s
    unit: str | None = None  # of the excitation

    @classmethod
    def of(cls, points: SteadyPoints, solution: SteadySolution, joint: Array) -> SteadyTest:
        """Of points and what was fitted to them, with its covariance."""
        form, of_values = between_levels(points, solution, correlation(points, solution))
        size = np.abs(points.force)
        return cls(
            solution.chain,
            solution.free,
            joint + of_values,
            form,
            solution.unexplained,
            points.measured,
            float(np.median(points.std[:, 0] * points.frequency**points.rate)),
            solution.c.shape[1] // 2,
            np.array([size.min(), size.max()]),
            np.array([points.frequency.min(), points.frequency.max()]),
        )

    def left_by(self, force: float, frequency: tuple[float, float]) -> tuple[str, ...]:
        """What of a prediction was not measured, in sentences."""
        (least, most), (first, last), notes = self.forces, self.frequencies, []
        if not least / _ALIKE <= force <= most * _ALIKE:
            those = f"{least:.4g} to {most:.4g} {self.unit or ''}".strip()
            notes.append(f"the force {force:g} was not measured: those of the test are {those}")
        if min(frequency) < first / _ALIKE or max(frequency) > last * _ALIKE:
            hz = np.array([first, last]) / (2 * np.pi)
            notes.append(f"points were measured from {hz[0]:.5g} to {hz[1]:.5g} Hz only")
        return tuple(notes)


@dataclass(frozen=True, eq=False, repr=False)
class SteadyEstimate(Estimate):
    """A model of steady states as it is saved: an `Estimate`, and what the test was.

    Attributes
    ----------
    test : SteadyTest

    Examples
    --------
    >>> w = np.linspace(0.8, 1.2, 20)
    >>> model = ReducedModel.from_coefficients({"omega^2": 1.1, "c_linear": 0.1})
    >>> fit = fit_steady(model, w, np.ones(20), 3.0 / (1.0 - w**2 + 0.05j * w))
    >>> saved = SteadyEstimate.from_json(fit.to_json())
    >>> round(saved.forced_response(2.0, (0.8, 1.2)).peak[1], 1)
    120.0
    """

    test: SteadyTest

    @property
    def chain(self) -> Chain:
        """From the measured excitation to a force per unit mass."""
        return self.test.chain

    @property
    def gain(self) -> float:
        """Force per unit mass for an excitation of 1, where it is small."""
        return self.chain.gain

    @property
    def unexplained(self) -> float:
        """Part of the force that neither model nor noise explain, as a standard deviation."""
        return self.test.unexplained

    def forced_response(
        self,
        force: ArrayLike,
        frequency: tuple[float, float],
        n_harmonics: int | None = None,
        *,
        velocity_scale: float | None = None,
        n_points: int = 100,
    ) -> ForcedBand:
        """Response to an excitation, as measured, with the band of a further measurement.

        The band holds errors of coefficients and chain, the force that the model leaves out, and
        the noise of a point; see `romsindy.forced_response` and `Estimate.forced_response`.
        ``force`` is in the unit of the excitation that was fitted.
        """
        test, excitation = self.test, float(checked_force(force, 1)[0])
        size = float(np.abs(self.chain.force(np.array([excitation + 0j])))[0])
        slopes = np.zeros((len(self.free) + 1, len(test.free)))
        slopes[:-1, : len(self.free)] = np.eye(len(self.free))
        for name, slope in (("gain", excitation), ("slope", excitation**2)):
            if name in test.free:
                slopes[-1, test.free.index(name)] = slope
        covariance = slopes @ test.covariance @ slopes.T
        covariance[-1, -1] += (self.unexplained * size) ** 2
        return forced_band(
            self.single_model,
            size,
            frequency,
            self.free,
            covariance,
            rate=RATES[test.measured],
            lead=self.chain.phase,
            noise=test.noise,
            n_points=n_points,
            n_harmonics=n_harmonics or test.n_harmonics,
            velocity_scale=velocity_scale,
            notes=test.left_by(excitation, frequency),
            goes_on=True,
            form=test.form,
        )

    def force_surface(self, frequency: ArrayLike, amplitude: ArrayLike) -> Array:
        """Harmonic force surface: the excitation that keeps up a vibration, stable or not.

        Parameters
        ----------
        frequency : array
            rad/s.
        amplitude : array
            Of the first harmonic, as measured; broadcast with the frequencies.

        Returns
        -------
        array
            In the unit of the excitation; nan where none is large enough.

        Raises
        ------
        ValueError
            If a frequency or an amplitude is not positive.

        Examples
        --------
        >>> w = np.linspace(0.8, 1.2, 20)
        >>> model = ReducedModel.from_coefficients({"omega^2": 1.1, "c_linear": 0.1})
        >>> fit = fit_steady(model, w, np.ones(20), 3.0 / (1.0 - w**2 + 0.05j * w))
        >>> print(fit.force_surface(1.0, [30.0, 60.0]).round(2))
        [0.5 1. ]
        """
        w, size = np.broadcast_arrays(np.asarray(frequency, float), np.asarray(amplitude, float))
        for name, values in (("frequency", w), ("amplitude", size)):
            if not np.all((values > 0) & np.isfinite(values)):
                raise ValueError(f"{name} must be positive: an orbit has both")
        balance = HarmonicBalance(self.single_model, HARMONICS)
        q = (size / w ** RATES[self.test.measured]).ravel()
        needed = orbits_of(balance, w.ravel(), q)[1].reshape(w.shape)
        gain, slope = abs(self.chain.gain), np.sign(self.chain.gain) * self.chain.slope
        with np.errstate(invalid="ignore"):
            return np.asarray(2 * needed / (gain + np.sqrt(gain**2 + 4 * slope * needed)))

    def to_json(self) -> str:
        """JSON text of the `Estimate`, with the test."""
        test = vars(self.test) | {"chain": vars(self.chain)}
        return json_text(json.loads(super().to_json()) | {"test": test})

    @classmethod
    def from_json(cls, text: str) -> SteadyEstimate:
        """Read what `to_json` wrote; of a `SteadyFit` too, without its points.

        Raises
        ------
        ValueError
            As `Estimate.from_json`, or if it holds no test, as files of version 0.3.
        """
        base = Estimate.from_json(text)
        content = table("the JSON text", read_json(text))
        if "test" not in content:
            raise ValueError(
                "the JSON text holds no test: write it again with romsindy steady --save, or read"
                " it with Estimate.load, for a force per unit mass"
            )
        return SteadyEstimate(**vars(base), test=_test(content["test"], base.free))


def _test(value: Any, free: tuple[str, ...]) -> SteadyTest:
    readers: dict[str, Any] = {"Chain": partial(made, Chain), "Quantity": entry}
    test = made(SteadyTest, "test", value, readers)
    known = test.measured in RATES and test.free[: len(free)] == free
    p, shapes = len(test.free), ("covariance", "form", "forces", "frequencies")
    wanted = ((p, p), (2, 3), (2,), (2,))
    if not known or tuple(getattr(test, name).shape for name in shapes) != wanted:
        raise ValueError(
            f"test does not belong to the coefficients {list(free)}: write the file again with"
            " romsindy steady --save"
        )
    return test


@dataclass(frozen=True, eq=False, repr=False)
class SteadyFit(SteadyEstimate):
    """A model fitted to steady states, with its errors and the chain of the excitation.

    Saved is the `SteadyEstimate` alone.

    Attributes
    ----------
    points : SteadyPoints
        What was measured, as harmonics of q.
    solution : SteadySolution
    joint : (p, p) array
        Covariance of the free coefficients and of what was fitted of the chain: `solution.free`.
    """

    points: SteadyPoints
    solution: SteadySolution
    joint: Array

    @property
    def chain_errors(self) -> dict[str, float]:
        """Standard errors of what was fitted of gain, slope and phase."""
        names, errors = self.solution.free, np.sqrt(np.diag(self.joint)).tolist()
        return {n: e for n, e in zip(names, errors, strict=True) if n in CHAIN}

    @property
    def misfit(self) -> NDArray[np.complex128]:
        """Force left over in the first harmonic, over that of the excitation, (n,).

        Real, without a phase, where phases were not measured.
        """
        e = self.solution.misfit
        return np.array(e[:, 0] - 1j * e[:, 1] if self.points.phased else e[:, 0], complex)

    @property
    def residuals(self) -> NDArray[np.complex128]:
        """Measured less computed first harmonic at equal frequency, (n,), unit as measured.

        To first order, as the force that is left over would move the response: large near folds.
        """
        by_q, size = self.solution.rows.by_q, self.points.frequency**self.points.rate
        x = (np.linalg.pinv(by_q) @ self.solution.rows.misfit[..., None])[..., 0]
        turned = (x[:, 0] - 1j * x[:, 1]) * 1j**self.points.rate if self.points.phased else x[:, 0]
        return np.array(size * turned, complex)

    def __str__(self) -> str:
        errors = self.chain_errors
        rows = ["Force per unit mass (gain + slope |F|) exp(i phase) F, with F as measured:"]
        for name, value in vars(self.chain).items():
            if name in errors:
                shown, error = with_error(value, errors[name])
                rows.append(f"  {name:<12} {shown:>12} +- {error}")
            elif value or name == "gain":
                rows.append(f"  {name:<12} {value:>12.6g} (given)")
        return "\n".join([super().__str__(), *rows])

    def __repr__(self) -> str:
        size = f"{len(self.free)} coefficients, {len(self.points)} steady states"
        return f"<SteadyFit: {size}, {self.unexplained:.2%} of the force unexplained>"


def fit_steady(
    model: ReducedModel | None,
    frequency: ArrayLike,
    force: ArrayLike,
    response: ArrayLike,
    *,
    measured: Quantity = "displacement",
    std: ArrayLike | None = None,
    gain: float | None = None,
    slope: float | None = 0.0,
    phase: float | None = None,
    fixed: Collection[str] = (),
    unit: str | None = None,
    sweep_rate: ArrayLike | None = None,
) -> SteadyFit:
    """Fit the coefficients of a model to measured steady states.

    Parameters
    ----------
    model : ReducedModel or None
        Terms to fit; the values of free ones do not matter. None chooses them: of omega^2 and
        powers 2, 3, 5 of q and 1, 2, 3 of q_dot those that gain on levels of force that are left
        out (`romsindy.fit.steady.fit`); then errors and notes count the choice.
    frequency : (n,) array
        Angular frequency, rad/s, as in `forced_response`. In any order, but neighbours in one
        sweep should stand together: their misfits are compared.
    force : (n,) array
        Amplitude of the measured excitation, in any unit; complex with its phase.
    response : (n,) array
        First harmonic, complex: Re(x exp(i omega t)); or (n, H), harmonics 1 to H. Real: its
        amplitude, where phases are not known. Harmonics that are not given follow from the balance.
    measured : "displacement", "velocity" or "acceleration"
        What the response is; q has its unit, integrated over time in s.
    std : float, (n,) or (n, H) array, optional
        Standard deviation of real and imaginary part of the response. Without it, it is the same in
        all points, and found in what is left; all of that counts as a force where points are few.
    gain, phase : float, optional
        Force per unit mass of an excitation of 1, and by how much it leads it, rad; fitted if not
        given. The phase also holds what filters do to the response.
    slope : float or None
        By how much the gain grows for an excitation of 1; None fits it, or, where the model is
        chosen, fits it if that predicts better. A shaker's force is not always proportional.
    fixed : names
        Coefficients of the model that keep their value.
    unit : str, optional
        Unit of q, where the model is chosen.
    sweep_rate : float or (n,) array, optional
        The points are sweeps at this rate of the angular frequency, rad/s^2, in the order of time,
        one after the other; amplitudes are real. With a rate for every point, negative where the
        frequency falls, they may be in any order. Rows before and after a jump are known by it
        (`romsindy.fit.steady.sweeps`); without ``std`` the noise is that of neighbours.

    Raises
    ------
    ValueError
        If an argument has another length, is not finite or not positive where it must be; if the
        points do not tell gain or coefficients; if the response leads the force, so that all
        damping would be negative; if the order of points says no direction of a sweep.

    Examples
    --------
    >>> w = np.linspace(0.8, 1.2, 20)
    >>> fit = fit_steady(
    ...     ReducedModel.from_coefficients({"omega^2": 1.1, "c_linear": 0.1}),
    ...     w, np.ones(20), 3.0 / (1.0 - w**2 + 0.05j * w),
    ... )
    >>> round(fit.model.coefficients["c_linear"], 6), round(fit.gain, 6)
    (0.05, 3.0)
    """
    points = SteadyPoints.of(frequency, force, response, std, measured)
    for name, value in (("gain", gain), ("slope", slope), ("phase", phase)):
        if value is not None and not np.isfinite(value):
            raise ValueError(f"{name} = {value!r} must be finite, or None to be fitted")
    if slope is None:
        size = np.abs(points.force)
        if np.ptp(size) < 0.01 * size.max():
            raise ValueError(
                "force has one amplitude, which tells no slope of the gain: give slope=0"
            )
    if model is None and fixed:
        raise ValueError(f"fixed = {sorted(fixed)} needs a model: give one")
    if model is not None:
        _free(model, fixed)  # refused before its points are looked at
    sweeps = None if sweep_rate is None else Sweeps.of(points, sweep_rate)
    if gain is None:
        _require_lags(points)
    search = _SteadySearch(model, fixed, gain, slope, phase, unit, std is not None)
    said: list[str] = []
    if sweeps is None:
        points, solution = search.found(points)
    else:
        search = replace(search, given=True, always=LINEAR, laws=sought("swept"))
        points, solution, said = _swept(search, sweeps)
    together = correlation(points, solution)
    joint = _covariance(points, solution, together)
    _require_gain(solution, joint)
    _require_sense(points, solution)
    peak = float(points.amplitude.max())
    free = tuple(name for name in solution.free if name not in CHAIN)
    n, verdict = len(free), verdict_of(points, solution, search.given)
    notes = said + notes_on(points, solution, together, search.given)
    if model is None:
        joint, doubts = counting_choice(solution.free, joint, search.every(points, solution, joint))
        notes += doubts
    return SteadyFit(
        model=replace(
            smoothed(solution.model, points),
            amplitude_range=(float(points.amplitude.min()), peak),
        ),
        free=free,
        covariance=joint[:n, :n],
        verdict=verdict,
        notes=tuple(notes),
        test=SteadyTest.of(points, solution, joint),
        points=points,
        solution=solution,
        joint=joint,
    )


def _swept(search: _SteadySearch, sweeps: Sweeps) -> tuple[SteadyPoints, SteadySolution, list[str]]:
    """Points of sweeps, what fits them, and notes: lags and delays follow from what was found."""
    points = sweeps.started()
    model = search.model
    if model is None:
        bent = {"omega^2": float(np.median(points.frequency) ** 2), "gamma_3": 0.0, "c_linear": 0.0}
        model = ReducedModel.from_coefficients(bent, search.unit)
    _, solution = replace(search, model=model).found(points)
    for i in range(_SWEPT):
        points, notes = sweeps.steady(solution, i > 0)
        if i >= _CHOOSING:
            search = replace(search, model=solution.model)
        solution = search.stepwise(points, solution)
    return points, solution, notes


def _free(model: ReducedModel, fixed: Collection[str]) -> tuple[str, ...]:
    if not isinstance(model, Equations) or model.numbered:
        raise ValueError(
            f"model is {type(model).__name__}: give a ReducedModel, or None to have it chosen"
        )
    free = not_fixed(model, fixed)
    model.refuse_memory("a balance of harmonics")
    jumps = [t.key for t in model.terms if not (t.smooth or isinstance(t, FrictionLaw))]
    if jumps:
        raise ValueError(
            f"the force of {jumps[0]} jumps: give model.regularised(velocity_scale), which is"
            " smooth below a small velocity"
        )
    return free


def _require_lags(points: SteadyPoints) -> None:
    if not points.phased:
        return
    turn = points.q[:, 0] / points.force
    lag = np.angle(turn / np.mean(turn / np.abs(turn)))
    if np.ptp(lag) < _ONE_LAG:
        raise ValueError(
            "the points do not tell the gain: all have one phase, and at resonance only the ratio"
            " of gain and damping is seen; give gain= and phase=, or add points off resonance"
        )


def _require_sense(points: SteadyPoints, solution: SteadySolution) -> None:
    """The damping takes energy at some points, or the sense of the phase is wrong."""
    if solution.chain.gain < 0:
        raise ValueError(
            f"gain = {solution.chain.gain:.3g} is negative: the force has the other sign; give"
            " -force, or leave phase to be fitted"
        )
    damped = {t.key: i for i, t in enumerate(solution.model.terms) if t.has("damping")}
    columns = [i for i, name in enumerate(solution.free) if name in damped]
    if not columns or not points.phased:
        return
    values = [solution.model.coefficients[solution.free[i]] for i in columns]
    force = solution.rows.by_parameter[:, :2, columns] @ values
    q = points.q[:, 0]
    if np.all(force[:, 0] * -q.imag - force[:, 1] * q.real < 0):
        raise ValueError(
            "response leads the force at every point, and its damping would be negative: where the"
            " phase was recorded as a lag, give response.conj()"
        )


def _require_gain(solution: SteadySolution, joint: Array) -> None:
    if "gain" not in solution.free:
        return
    error = float(np.sqrt(joint[solution.free.index("gain")][solution.free.index("gain")]))
    if not abs(solution.chain.gain) > _SURE * error:
        raise ValueError(
            f"the points do not tell the gain ({solution.chain.gain:.3g} +- {error:.3g}): at"
            " resonance only its ratio to the damping is seen; give gain=, or add points off"
            " resonance"
        )


def _covariance(points: SteadyPoints, solution: SteadySolution, together: float) -> Array:
    """Covariance of least squares whose misfits go together, as those of neighbours in a level do.

    The correlation falls with every further point. And the gain of a level may be off in all of
    its points.
    """
    plain, level = solution.covariance, points.level
    number, shape = np.arange(len(level)), solution.rows.misfit.shape
    a = solution.rows.whitened(solution.floor)[0].reshape(*shape, -1)
    alike = np.where(level[:, None] == level, together ** np.abs(number[:, None] - number), 0.0)
    alike = alike if together else np.eye(len(level))
    scores = np.einsum("nkp,nm,mkq->pq", a, alike, a, optimize=True)
    off = a.reshape(-1, a.shape[2]).T @ _by_gain(points, solution)
    return plain @ (scores + off @ off.T) @ plain


def _by_gain(points: SteadyPoints, solution: SteadySolution) -> Array:
    """What misfits of unit variance change by where the gain of one level is off, (n k, levels).

    By as much as the levels scatter, but no more than gains do: what the model lacks scatters, too.
    Nothing where there is one level, or where that scatter may be chance.
    """
    level, shape = points.level, solution.misfit.shape
    count, together = int(level.max()) + 1, correlation(points, solution)
    if count == 1:
        return np.zeros((solution.misfit.size, 0))
    parts = parts_of_force(points, solution.chain, shape[1])
    given = replace(solution.rows, by_parameter=parts[..., None])
    force = given.whitened(solution.floor)[0].reshape(shape)
    each = (level[:, None] == np.arange(count))[:, None] * force[..., None]
    each = each.reshape(-1, count)
    fitted = np.linalg.qr(solution.rows.whitened(solution.floor)[0])[0]
    own = np.linalg.qr(each - fitted @ (fitted.T @ each))[0][:, : count - 1]
    # Neighbours that go together tell less.
    seen = float(np.sum((own.T @ solution.white.ravel()) ** 2)) * (1 - together) / (1 + together)
    if seen < chi2.isf(_BY_CHANCE, count - 1):
        return 0 * each
    (within, _), _ = between_levels(points, solution, together)
    return min(float(within[2]) / wider(KNOWN + count - 1), _GAIN) * each


# -- the choice of terms ---------------------------------------------------------------------------


@dataclass(frozen=True)
class _SteadySearch:
    """What is fitted to points: a model, or, without one, terms that are chosen of the laws."""

    model: ReducedModel | None
    fixed: Collection[str]
    gain: float | None
    slope: float | None
    phase: float | None
    unit: str | None
    given: bool  # whether the noise of the response is known
    always: tuple[Term, ...] = (_ALWAYS,)
    laws: tuple[Term, ...] = _LAWS

    def found(self, points: SteadyPoints) -> tuple[SteadyPoints, SteadySolution]:
        """Points, with their noise, and what fits them.

        Every level of force is left out in turn; where there are fewer than three, every fifth of
        the points by amplitude. Where the noise of the response is not given, points count by that
        which a choice leaves: as a force it would hide a damping that few points at resonance tell.
        """
        if self.model is not None:
            return self._fitted(points, self.model, self.slope)
        chosen, as_given = {_LINEAR.key}, points
        for _ in range(_ROUNDS):
            model, slope = self._of(chosen, points)
            points, found = self._fitted(as_given, model, slope)
            every = self.every(points, found)
            best = {every.name(g) for g in every.trials.chosen(every.present)}
            if best == chosen:
                break
            chosen = best
        return points, found

    def stepwise(self, points: SteadyPoints, before: SteadySolution) -> SteadySolution:
        """Terms are added, left out or exchanged, one by one, by fits and what they leave.

        Near the folds of sweeps a fit is not linear in what it lacks.
        """
        if self.model is not None:
            return self._fitted(points, self.model, self.slope, before)[1]
        kind = {law.key: law.has("damping") for law in self.laws}
        held = frozenset({*before.free} & {*kind})
        tried: dict[frozenset[str], SteadySolution] = {}

        def better(several: Iterable[frozenset[str]]) -> frozenset[str]:
            for names in several:
                if names not in tried:
                    tried[names] = self._fitted(points, *self._of(names, points), before)[1]
            return min(tried, key=lambda names: self._cost(tried[names]))

        better([held])
        while True:
            others = {*kind} - held
            more, fewer = ([held ^ {name} for name in some] for some in (others, held))
            swaps = [held - {a} | {b} for a in held for b in others if kind[a] == kind[b]]
            found = next((x for x in map(better, (more, fewer, swaps)) if x != held), held)
            if found == held:
                return tried[held]
            held, before = found, tried[found]

    @staticmethod
    def _cost(found: SteadySolution) -> float:
        wrong = any(value <= law.least for law, value in found.model.pairs)
        return np.inf if wrong else found.unlikely

    def _of(
        self, names: Collection[str], points: SteadyPoints
    ) -> tuple[ReducedModel, float | None]:
        """A model of these terms to begin with, and the slope of the chain."""
        terms = [*self.always, *(law for law in self.laws if law.key in names)]
        start = (float(np.median(points.frequency) ** 2), *np.zeros(len(terms) - 1))
        slope = 0.0 if self.slope is None and "slope" not in names else self.slope
        return ReducedModel(tuple(terms), start, self.unit), slope

    def _fitted(
        self,
        points: SteadyPoints,
        model: ReducedModel,
        slope: float | None,
        before: SteadySolution | None = None,
    ) -> tuple[SteadyPoints, SteadySolution]:
        free = _free(model, self.fixed)
        found = solve(points, model, free, self.gain, slope, self.phase, before)
        if not self.given:
            points = with_spread(points, found)
            found = solve(points, found.model, free, self.gain, slope, self.phase, before)
        return points, found

    def every(
        self, points: SteadyPoints, found: SteadySolution, covariance: Array | None = None
    ) -> Linearised:
        """All candidates, with the slope of the chain or without, about the orbits of a solution.

        Parts of the points are left out in turn. With the ``covariance`` of what was fitted all are
        one part, and misfits count as much as makes the errors by them those of that, in the mean
        [1].

        [1] F. Pauli, W. Racugno, L. Ventura, Statistica Sinica 21 (2011) 149: the magnitude
            adjustment.
        """
        laws = (*self.always, *self.laws)
        values = dict.fromkeys((law.key for law in laws), 0.0) | found.model.coefficients
        rich = ReducedModel(laws, tuple(values.values()))
        chain = [n for n in CHAIN if n in found.free or (n == "slope" and self.slope is None)]
        names, known = (*values, *chain), values | vars(found.chain)
        rows = linearised(points, rich, tuple(values), found.chain, found.c)
        a, b = rows.whitened(found.floor)
        table = np.column_stack([a[:, [(*values, *CHAIN).index(n) for n in names]], -b])
        for off in _by_gain(points, found).T:  # which no term is to make up for
            size = max(float(np.linalg.norm(off)), 1e-9)
            table -= np.outer(off, off @ table) * (1 - 1 / np.hypot(1.0, size)) / size**2
        part, counted = _parts(points), 1.0
        if covariance is not None:
            part = np.zeros_like(part)
            counted = len(covariance) / np.trace(np.linalg.solve(found.covariance, covariance))
        part = np.repeat(part, rows.misfit.shape[1])
        at = np.array([known[n] for n in names])
        grams = [Gram.of(np.sqrt(counted) * table[part == i], at) for i in np.unique(part)]
        kept = [law.key for law in self.always]
        groups = [i for i, n in enumerate(names) if n not in (*kept, "gain", "phase")]
        always = [i for i in range(len(names)) if i not in groups]
        trials = Trials.of(grams, always, [[i] for i in groups], dict(enumerate(self.laws)), {})
        present = [g for g, i in enumerate(groups) if names[i] in found.free]
        return Linearised(trials, (), laws, present, tuple(chain))


def _parts(points: SteadyPoints) -> Indices:
    """With which part of the data each point is left out, (n,)."""
    number: Indices = points.level
    if number.max() < 2:
        number = np.argsort(np.argsort(points.amplitude)) * _BLOCKS // len(points)
    return number
