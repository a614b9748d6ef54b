"""Parametric bootstrap: the slow, trusted way to the errors of a fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.hypothesis import with_memories
from romsindy.fit.kernel.part import extended
from romsindy.fit.kernel.shooting import shoot
from romsindy.fit.results.fitted import Fit
from romsindy.typing import Array


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Fits to simulated measurements.

    Attributes
    ----------
    free : tuple of str
        Names of the coefficients.
    values : (n, n_free) array
        Coefficients of every repetition.
    failed : int
        Repetitions whose fit could not be simulated to its end; they are not in ``values``.
    """

    free: tuple[str, ...]
    values: Array
    failed: int

    @property
    def covariance(self) -> Array:
        """Covariance of the coefficients, (n_free, n_free)."""
        return np.atleast_2d(np.cov(self.values, rowvar=False))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard deviation of every coefficient, by name."""
        return dict(zip(self.free, np.std(self.values, axis=0, ddof=1).tolist(), strict=True))

    def interval(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Quantiles that hold the stated part of the repetitions, by name."""
        edges = np.quantile(self.values, [(1 - level) / 2, (1 + level) / 2], axis=0)
        return {n: (float(a), float(b)) for n, a, b in zip(self.free, *edges, strict=True)}


def bootstrap(
    fit: Fit,
    repetitions: int = 100,
    *,
    seed: int = 0,
    n_jobs: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Bootstrap:
    """Simulate the fitted model, add noise as loud and as coloured as found, and fit again.

    Parameters
    ----------
    fit : Fit
        Result of `romsindy.fit.refine`.
    repetitions : int
        At least 2.
    seed : int
        Of the noise: the same seed gives the same numbers, whatever ``n_jobs``.
    n_jobs : int, optional
        Processes, as in joblib; -1 for all cores.
    progress : callable, optional
        Called with the number of repetitions done.

    Returns
    -------
    Bootstrap

    Raises
    ------
    ValueError
        If fewer than two repetitions are asked for, or fewer than two succeed.

    Examples
    --------
    >>> from romsindy import ReducedModel, add_noise, refine
    >>> model = ReducedModel.from_coefficients({"omega^2": 36.0, "gamma_3": 9.0, "c_linear": 0.1})
    >>> decay = add_noise(model.simulate(1.0, 0.0, np.arange(0.0, 10.0, 0.05)), 40, seed=0)
    >>> repeats = bootstrap(refine(model, decay), repetitions=4)
    >>> f"{repeats.standard_errors['c_linear']:.4f} 1/s"
    '0.0004 1/s'
    """
    if repetitions < 2:
        raise ValueError(f"repetitions = {repetitions!r} must be at least 2 (100: errors to 7 %)")
    tasks = (delayed(_repeat)(fit, s) for s in np.random.SeedSequence(seed).spawn(repetitions))
    results = []
    for values in Parallel(n_jobs=n_jobs, return_as="generator")(tasks):
        results.append(values)
        if progress:
            progress(len(results))
    good = [values for values in results if values is not None]
    if len(good) < 2:
        raise ValueError(
            f"only {len(good)} of {repetitions} repetitions could be fitted: the model comes close"
            " to singular inertia, use fewer terms"
        )
    return Bootstrap(fit.free, np.array(good), repetitions - len(good))


def _repeat(fit: Fit, seed: np.random.SeedSequence) -> Array | None:
    rng = np.random.default_rng(seed)
    records = [
        r.with_signal(r.signal - e + r.drawn(rng))
        for r, e in zip(fit.records, fit.residuals, strict=True)
    ]
    parts, motions = fit.solution.parts, fit.solution.motions
    try:
        with threadpool_limits(limits=1, user_api="blas"):
            again = shoot(fit.start, parts, records, motions)[0]
    except TrajectoryError:
        return None
    values = with_memories(extended(fit.start, again.parts), again.parts).coefficients
    return np.array([values[name] for name in fit.free])
