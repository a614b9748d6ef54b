"""Fit a model by simulation: the simulated motion follows the measured one over the whole decay.

Regression takes noisy displacements as its regressors, and noise there biases what it finds.
Output error has noise on its left side only. It needs a start, which regression gives, and a
horizon that grows, so that the phase of the simulated motion is never a cycle off.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from romsindy.decay import Decay
from romsindy.model import ReducedModel
from romsindy.noise import Noise
from romsindy.output_error import ModelEquation, OutputError, Record
from romsindy.typing import Array

# Dry friction is smoothed over this part of the largest velocity, see `Term.regularised`.
_SMOOTHING = 0.01


@dataclass(frozen=True)
class Fit:
    """A model fitted by simulation, and how far it explains the data.

    Attributes
    ----------
    model : ReducedModel
        With the fitted coefficients.
    free : tuple of str
        Names of the fitted coefficients, in the order of `covariance`.
    covariance : (n_free, n_free) array
        Of the fitted coefficients; initial states and offsets are accounted for.
    states : (n_decays, 2) array
        q and q_dot at the first sample of each decay.
    offsets : (n_decays,) array
        Of the sensor, in the unit of the measured signal; zero unless fitted.
    noise : tuple of Noise
        Of each decay, found without the model.
    adequacy : float
        Rms of the residual over the noise: 1 where the model explains the data to their noise.
    residuals : tuple of arrays
        Measured minus simulated, for every decay.
    decays : tuple of Decay
        What was fitted: free parts.
    message : str
        How the fit ended.
    """

    model: ReducedModel
    free: tuple[str, ...]
    covariance: Array
    states: Array
    offsets: Array
    noise: tuple[Noise, ...]
    adequacy: float
    residuals: tuple[Array, ...]
    decays: tuple[Decay, ...]
    message: str

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of every fitted coefficient, by name."""
        errors = np.sqrt(np.diag(self.covariance))
        return dict(zip(self.free, errors.tolist(), strict=True))


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
    records = _records(decays, model)
    free = _free_names(model, fixed)
    problem = OutputError.of(ModelEquation(_smoothed(model, records), free), records, offset)
    values, message = problem.solve(loss, progress)
    return _fit(problem, values, model, free, message)


def _fit(
    problem: OutputError, values: Array, model: ReducedModel, free: tuple[str, ...], message: str
) -> Fit:
    covariance = problem.covariance(values)[: len(free), : len(free)]
    states, offsets = problem.split(values)[1:]
    residuals = tuple(problem.residuals(values))
    new = {**model.coefficients, **dict(zip(free, values.tolist(), strict=False))}
    amplitudes = [float(np.abs(r.decay.q).max()) for r in problem.records]
    limits = model.amplitude_range or (0.0, max(amplitudes))
    return Fit(
        replace(model, values=tuple(new.values()), amplitude_range=limits),
        free,
        covariance,
        states,
        offsets,
        tuple(r.noise for r in problem.records),
        problem.adequacy(residuals),
        residuals,
        tuple(r.decay for r in problem.records),
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
        if any(_same(decay, other) for other in several[:i]):
            raise ValueError(
                f"decay {i} is the same record as an earlier one: counted twice, it would make"
                " every error bar too small; give it once"
            )
    return tuple(Record.of(decay) for decay in several)


def _same(a: Decay, b: Decay) -> bool:
    return a.q.shape == b.q.shape and bool(np.all(a.q == b.q))


def _smoothed(model: ReducedModel, records: Sequence[Record]) -> ReducedModel:
    if all(term.smooth for term in model.terms):
        return model
    speed = max(float(np.abs(np.gradient(r.decay.q, r.decay.dt)).max()) for r in records)
    return model.regularised(_SMOOTHING * speed)
