"""What `identify` finds: functions with bands, the simplest equation, and what is determined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from romsindy.fit.adequacy import Adequacy
from romsindy.fit.estimate import Band
from romsindy.fit.functions.structures import Structure
from romsindy.fit.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.typing import Array

# A function is determined where its 95 % band is within this part of its value.
DETERMINED = 0.25
_BAND_DRAWS = 100
_INSIDE = (2.5, 97.5)  # percentiles of the 95 % band
_NEAR_ZERO = 0.05  # of the upper end of a band


@dataclass(frozen=True, eq=False)
class Curve:
    """A function of q with its 95 % band, pointwise; all (n,)."""

    q: Array
    value: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """An identified equation of motion: functions with bands first, coefficients read off them.

    Attributes
    ----------
    model : ReducedModel
        Of the simplest structure that predicts as well as any. Its terms are those of a series of
        high order: as a whole they are the functions, one by one most are not determined.
    structures : tuple of Structure
        All that were compared, from the simplest on.
    structure : Structure
        That of the model.
    terms : tuple of Term
        Of the richest structure, to which bands belong.
    samples : (n_samples, n_terms) array
        Their coefficients, drawn from all that the data allow.
    records : tuple of Record
    reach : (float, float)
        Least and largest q of the data, unit of q.
    verdict : Adequacy
        Whether one simulation of the mean equation explains the data to their noise.
    noise, jump : float
        Misfit that the errors stand for, over the noise; and by how much the motion departs from
        the equation from window to window, as a part of the amplitude.
    converged : bool
    """

    model: ReducedModel
    structures: tuple[Structure, ...]
    structure: Structure
    terms: tuple[Term, ...]
    samples: Array
    records: tuple[Record, ...]
    reach: tuple[float, float]
    verdict: Adequacy
    noise: float
    jump: float
    converged: bool

    @cached_property
    def _models(self) -> list[ReducedModel]:
        return [ReducedModel(self.terms, tuple(s), self.model.unit) for s in self.samples]

    def _curve(self, q: ArrayLike, function: Callable[[ReducedModel, Array], Array]) -> Curve:
        q = np.atleast_1d(np.asarray(q, float))
        least, largest = self.reach
        if np.any((q < 1.001 * least) | (q > 1.001 * largest)):
            raise ValueError(
                f"q = {q.min():.4g} to {q.max():.4g} leaves the range of the data,"
                f" {least:.4g} to {largest:.4g} {self.model.unit or '[q]'}: bands say nothing there"
            )
        values = np.array([function(m, q) for m in self._models])
        return Curve(q, values.mean(axis=0), *_shortest(values))

    def inertia(self, q: ArrayLike) -> Curve:
        """h(q), the inertia beside 1, within `reach` (unit of q).

        It is never negative, so that equal tails would leave out 0 always. The band starts there
        where 0 is hardly less likely than its middle, or where the data do not ask for inertia.
        """
        curve = self._curve(q, lambda m, x: m.inertia(x) - 1)
        needless = any(s.equivalent and not s.sizes.inertia for s in self.structures)
        open_below = needless | (curve.low < _NEAR_ZERO * curve.high)
        return replace(curve, low=np.where(open_below, 0.0, curve.low))

    def stiffness(self, q: ArrayLike) -> Curve:
        """K(q) / q in 1/s^2, within `reach` (unit of q); omega^2 at q = 0."""
        step = 1e-6 * max(map(abs, self.reach))

        def secant(model: ReducedModel, x: Array) -> Array:
            away = np.where(np.abs(x) < step, step, x)
            return model.stiffness(away) / away

        return self._curve(q, secant)

    def band(self, amplitudes: ArrayLike) -> Band:
        """Frequency and damping ratio against amplitude (half peak to peak), with their errors."""
        a = np.atleast_1d(np.asarray(amplitudes, float))
        some = self._models[:: max(len(self._models) // _BAND_DRAWS, 1)]
        curves = np.array([[m.backbone(a), m.damping_ratio(a)] for m in some])
        (omega, zeta), (omega_std, zeta_std) = curves.mean(axis=0), curves.std(axis=0, ddof=1)
        return Band(a, omega, zeta, omega_std, zeta_std, self.model.unit)

    def interval(self, name: str) -> tuple[float, float]:
        """95 % interval of a coefficient, such as "Upsilon_3".

        Raises
        ------
        ValueError
            If there is no such coefficient.
        """
        names = [term.key for term in self.terms]
        if name not in names:
            raise ValueError(f"name = {name!r} is no coefficient: there are {', '.join(names)}")
        low, high = np.percentile(self.samples[:, names.index(name)], _INSIDE)
        return float(low), float(high)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard deviation of every coefficient, over all structures that the data allow."""
        errors = self.samples.std(axis=0, ddof=1)
        return {t.key: float(e) for t, e in zip(self.terms, errors, strict=True)}

    @property
    def covariance(self) -> Array:
        """Of the coefficients, (n_terms, n_terms)."""
        return np.cov(self.samples, rowvar=False)


def _shortest(values: Array) -> tuple[Array, Array]:
    """Ends of the shortest intervals that hold 95 % of the draws (n_draws, n), (n,) each."""
    ordered = np.sort(values, axis=0)
    kept = int(np.ceil(0.95 * len(values)))
    widths = ordered[kept - 1 :] - ordered[: len(values) - kept + 1]
    first, column = np.argmin(widths, axis=0), np.arange(values.shape[1])
    return ordered[first, column], ordered[first + kept - 1, column]
