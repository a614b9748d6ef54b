"""Fit a model by simulation: the simulated motion follows the measured one over the whole decay.

Regression takes noisy displacements as its regressors, and noise there biases what it finds.
Output error has noise on its left side only. It needs a start, which regression gives, and a
horizon that grows, so that the phase of the simulated motion is never a cycle off.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from romsindy.fit.adequacy import Adequacy, examine
from romsindy.fit.output_error import ModelEquation, OutputError, Record
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.noise import Noise, find_line
from romsindy.typing import Array

# Dry friction is smoothed over this part of the largest velocity, see `Term.regularised`.
_SMOOTHING = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A model fitted by simulation, with its errors and how far it explains the data.

    Attributes
    ----------
    model : ReducedModel
        With the fitted coefficients.
    free : tuple of str
        Names of the fitted coefficients, in the order of `covariance`.
    problem : OutputError
        What was made least.
    values : array
        Fitted coefficients, states and offsets, in the order of `problem`.
    all_covariance : array
        Of `values`.
    residuals : tuple of arrays
        Measured minus simulated for every decay, unit of the measured quantity.
    verdict : Adequacy
        Whether the data are explained, in numbers and in a sentence.
    message : str
        How the fit ended.
    """

    model: ReducedModel
    free: tuple[str, ...]
    problem: OutputError
    values: Array
    all_covariance: Array
    residuals: tuple[Array, ...]
    verdict: Adequacy
    message: str

    @property
    def covariance(self) -> Array:
        """Covariance of the fitted coefficients, (n_free, n_free)."""
        return self.all_covariance[: len(self.free), : len(self.free)]

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of every fitted coefficient, by name."""
        errors = np.sqrt(np.diag(self.covariance))
        return dict(zip(self.free, errors.tolist(), strict=True))

    @property
    def states(self) -> Array:
        """q and q_dot at the first sample of each decay, (n_decays, 2)."""
        return self.problem.split(self.values)[1]

    @property
    def offsets(self) -> Array:
        """Offset of the sensor in each decay, unit of the measured quantity; 0 if not fitted."""
        return self.problem.split(self.values)[2]

    @property
    def decays(self) -> tuple[Decay, ...]:
        """What was fitted: the free parts."""
        return tuple(record.decay for record in self.problem.records)

    @property
    def noise(self) -> tuple[Noise, ...]:
        """Noise of each decay, found without the model."""
        return tuple(record.noise for record in self.problem.records)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the reader must know of the records and of the fit."""
        notes = [] if "termination" in self.message else [self.message]
        for i, record in enumerate(self.problem.records):
            lost = int(np.sum(~record.valid))
            if lost:
                notes.append(
                    f"decay {i}: {lost} samples stick to the end of the sensor's range and take no"
                    " part"
                )
            line = find_line(record.noise, record.decay.dt)
            if line is not None:
                notes.append(
                    f"decay {i}: another vibration at {line.frequency:.4g} Hz, rms {line.rms:.2g},"
                    " is counted as noise; it is no part of this model"
                )
        return tuple(notes)

    @property
    def adequacy(self) -> float:
        """Rms of the residual over the noise; 1 where the model explains the data to it."""
        return self.verdict.ratio

    def band(self, amplitudes: ArrayLike) -> Band:
        """Backbone and damping of the model with their standard errors.

        Parameters
        ----------
        amplitudes : (n,) array
            Half peak to peak, positive, unit of q.
        """
        a = np.atleast_1d(np.asarray(amplitudes, float))
        steps = 0.1 * np.sqrt(np.diag(self.covariance))
        equation = ModelEquation(self.model, self.free)
        slopes = []
        for i, step in enumerate(steps):
            move = np.zeros(len(steps))
            move[i] = step
            high, low = (_curves(equation.at(equation.values + s * move), a) for s in (1, -1))
            slopes.append((high - low) / (2 * step))
        variance = np.einsum("pca,pq,qca->ca", slopes, self.covariance, slopes)
        (omega, zeta), (omega_std, zeta_std) = _curves(equation, a), np.sqrt(variance)
        return Band(a, omega, zeta, omega_std, zeta_std, self.model.unit)

    def __str__(self) -> str:
        errors = self.standard_errors
        lines = [f"{self.model.equation()}    (q in {self.model.unit or '[q]'}, t in s)"]
        for term, value in zip(self.model.terms, self.model.values, strict=True):
            error = f"+- {errors[term.key]:.2g}" if term.key in errors else "(fixed)"
            lines.append(
                f"  {term.key:<12} {value:>12.6g} {error:<11} {term.unit(self.model.unit)}".rstrip()
            )
        notes = [f"Note: {note.rstrip('.')}." for note in self.notes]
        return "\n".join([*lines, str(self.verdict), *notes])

    def __repr__(self) -> str:
        size = f"{len(self.free)} coefficients, {len(self.decays)} decays"
        return f"<Fit: {size}, adequacy {self.adequacy:.3f}>"


@dataclass(frozen=True, eq=False)
class Band:
    """Backbone and damping ratio of a fitted model, with standard errors.

    Attributes
    ----------
    amplitude, frequency, damping_ratio : (n,) arrays
        Unit of q, rad/s, dimensionless.
    frequency_std, damping_ratio_std : (n,) arrays
        Standard errors, by the covariance of the coefficients to first order. The 95 % band is
        1.96 of them to either side.
    unit : str or None
        Of the amplitude.
    """

    amplitude: Array
    frequency: Array
    damping_ratio: Array
    frequency_std: Array
    damping_ratio_std: Array
    unit: str | None


def _curves(equation: ModelEquation, amplitudes: Array) -> Array:
    model = equation.model
    return np.array([model.backbone(amplitudes), model.damping_ratio(amplitudes)])


def refine(
    model: ReducedModel,
    decays: Decay | Sequence[Decay],
    *,
    fixed: Collection[str] = (),
    offset: bool = False,
    loss: str = "linear",
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit the coefficients of a model by simulation (output error).

    Parameters
    ----------
    model : ReducedModel
        Structure and start, such as ``HarmonicSINDy().fit(decay).model_``.
    decays : Decay or sequence of Decay
        One channel each, in the unit of the model. The free part is fitted, in the quantity that
        was measured: displacement, velocity or acceleration.
    fixed : names
        Coefficients that keep their value.
    offset : bool
        Fit a constant offset of the sensor too.
    loss : str
        As in `scipy.optimize.least_squares`; "soft_l1" forgives outliers beyond three times the
        noise.
    progress : callable, optional
        Called with a line of text at every horizon.

    Returns
    -------
    Fit

    Raises
    ------
    ValueError
        For unknown names in ``fixed``, other units, a decay given twice, or nothing to fit.
    TrajectoryError
        If the start itself cannot be simulated over the first cycles.
    """
    # Tall and narrow matrices: threads of the linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        records = _records(decays, model)
        free = _free_names(model, fixed)
        problem = OutputError.of(ModelEquation(smoothed(model, records), free), records, offset)
        values, message = problem.solve(loss, progress)
        return _fit(problem, values, model, free, message)


def _fit(
    problem: OutputError, values: Array, model: ReducedModel, free: tuple[str, ...], message: str
) -> Fit:
    residuals = tuple(problem.residuals(values))
    new = {**model.coefficients, **dict(zip(free, values.tolist(), strict=False))}
    peaks = [float(np.abs(record.decay.q).max()) for record in problem.records]
    return Fit(
        replace(
            model,
            values=tuple(new.values()),
            amplitude_range=model.amplitude_range or (0.0, max(peaks)),
        ),
        free,
        problem,
        values,
        problem.covariance(values),
        residuals,
        examine(problem.records, residuals, len(values)),
        message,
    )


def _free_names(model: ReducedModel, fixed: Collection[str]) -> tuple[str, ...]:
    unknown = sorted(set(fixed) - set(model.coefficients))
    if unknown:
        raise ValueError(f"fixed names {unknown}, but the model has {list(model.coefficients)}")
    free = tuple(name for name in model.coefficients if name not in fixed)
    if not free:
        raise ValueError("fixed names every coefficient of the model: leave one to fit")
    return free


def _records(decays: Decay | Sequence[Decay], model: ReducedModel) -> tuple[Record, ...]:
    several = [decays] if isinstance(decays, Decay) else list(decays)
    if not several:
        raise ValueError("decays is empty: give at least one Decay")
    for i, decay in enumerate(several):
        if decay.unit != model.unit:
            raise ValueError(
                f"decay {i} is in {decay.unit or 'an unknown unit'}, the model in"
                f" {model.unit or 'an unknown unit'}: load the decay with unit={model.unit!r}"
            )
        if any(decay.same_record(other) for other in several[:i]):
            raise ValueError(
                f"decay {i} is the same record as an earlier one: counted twice, it would make"
                " every error bar too small; give it once"
            )
    return tuple(Record.of(decay) for decay in several)


def smoothed(model: ReducedModel, records: Sequence[Record]) -> ReducedModel:
    """Model whose dry friction is smooth at the speeds of the records."""
    if all(term.smooth for term in model.terms):
        return model
    speed = max(float(np.abs(np.gradient(r.decay.q, r.decay.dt)).max()) for r in records)
    return model.regularised(_SMOOTHING * speed)
