"""Fit a model by simulation: the simulated motion follows the measured one over the whole decay.

Regression takes noisy displacements as its regressors, and noise there biases what it finds. Here
all noise is on one side: that of the measurement. The fit starts from the measured motion, smoothed
(`romsindy.fit.kernel.gauss_newton`), so that the phase is never a cycle off, and ends with exact
motions (`romsindy.fit.kernel.shooting`). Its errors are checked by a parametric bootstrap.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from joblib import Parallel, delayed
from scipy.linalg import LinAlgError
from threadpoolctl import threadpool_limits

from romsindy.fit.forced.refine import refined_forced
from romsindy.fit.functions.identification import DampingSplit, Identification, LimitCycle
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.hypothesis import with_memories
from romsindy.fit.kernel.part import LINEAR, Part, extended
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.kernel.shooting import LOSSES, shoot
from romsindy.fit.process_noise import SIGMAS, normal_draws, wider
from romsindy.fit.records.arguments import (
    free_names,
    listed_records,
    prepared,
    ready,
    require_known,
    require_unit,
    several_decays,
    small_frequencies,
)
from romsindy.fit.records.coupled import coupled_records, free_offsets, free_shapes
from romsindy.fit.records.driven import inputs_in, regressed
from romsindy.fit.records.record import NUMERICS, Record
from romsindy.fit.results.fitted import Fit, examined, refined
from romsindy.fit.results.predict import form_of
from romsindy.physics.coupling import CoupledTerm
from romsindy.physics.damping import PositionDamping, PowerDamping
from romsindy.physics.equations import Equations
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.backbone import PQ
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Given
from romsindy.typing import Array

# A damping ratio that falls: at these parts of the reach, by so many standard errors, and to 0 at
# so many times the reach at most; where it is looked for, in parts of the reach.
_FALLS, _TOLD, _FORETOLD, _SOUGHT = np.array([0.2, 0.95]), 3.0, 2.5, (0.5, 4.0, 120)
# Of the first power of a function of q, what a second is expected to add at the reach.
_UNSEEN = 0.1


def refine(
    model: Equations,
    decays: Decay | ForcedVibration | Sequence[Decay | ForcedVibration],
    *,
    fixed: Collection[str] = (),
    offset: bool = False,
    loss: str = "linear",
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit the coefficients of a model by simulation.

    Parameters
    ----------
    model : ReducedModel or CoupledModel
        Structure and start, such as ``HarmonicSINDy().fit(decay).model_``. A model of several
        coordinates needs frequencies near those of the record; all else may start from 0.
    decays : Decay, ForcedVibration or sequence of them
        In the unit of the model; one channel each, or for several coordinates any number: what a
        channel shows of a coordinate is fitted, and is 1 where that moves it most. The free part
        is fitted, in the quantity that was measured: displacement, velocity or acceleration.
    fixed : names
        Coefficients that keep their value: any of ``model.coefficients``.
    offset : bool
        Fit a constant offset of the sensor too.
    loss : "linear" or "soft_l1"
        As in `scipy.optimize.least_squares`; "soft_l1" forgives outliers beyond three times the
        noise.
    progress : callable, optional
        Called with a line of text at every simulation.

    Returns
    -------
    Fit
        After an interrupt (Ctrl-C) during the simulations, what had been reached.

    Raises
    ------
    ValueError
        For unknown names in ``fixed``, another loss, other units, a decay given twice, or nothing
        to fit.
    TrajectoryError
        If no motion of the model follows the measured one.

    Examples
    --------
    >>> from romsindy import HarmonicSINDy, example_decay
    >>> decay = example_decay(40, periods=20, samples=30)
    >>> fit = refine(HarmonicSINDy().fit(decay).model_, decay)
    >>> f"{fit.model.coefficients['c_linear']:.3f} +- {fit.standard_errors['c_linear']:.4f} 1/s"
    '0.060 +- 0.0004 1/s'
    """
    if loss not in LOSSES:
        raise ValueError(f"loss = {loss!r} must be one of {LOSSES}")
    several = listed_records(decays)
    if Given.of(several).driven:
        return refined_forced(model, several, fixed, loss=loss, progress=progress)
    free = free_names(model, fixed)
    records, more = _seen(model, several_decays(several), offset)
    found = refined(model, free, records, more, loss=loss, progress=progress)
    if loss == "linear" and all(r.whole for r in records):
        found = examined(found)  # the rest may be a force that nobody measured
    if model.numbered:
        return found
    own = found.solution
    alone = cast(tuple[Record, ...], found.records)
    return found.with_form(form_of(cast(Any, found.start), own.parts, alone, own.motions))


def refine_terms(
    several: Sequence[Decay | ForcedVibration],
    terms: Sequence[Term],
    fixed: Mapping[str, float],
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit a model of one coordinate that has these terms beside the linear ones.

    Its values start from least squares on the smooth motions; ``fixed`` ones stay as they are.
    """
    if wrong := [t for t in terms if isinstance(t, CoupledTerm) or not isinstance(t, Term)]:
        raise ValueError(
            f"terms hold {wrong}: give names or laws of one coordinate, such as 'gamma_3'"
        )
    if inputs := [t.key for t in terms if isinstance(t, Input)]:
        raise ValueError(
            f"terms hold {inputs}: leave inputs out, they come with the records; one that was"
            " measured makes a record a ForcedVibration"
        )
    laws = tuple({t.key: t for t in (*LINEAR, *terms)}.values())
    require_known(fixed, [t.key for t in laws])
    records = ready(several)
    acting = inputs_in([r.decay for r in records if r.driven], "linear")
    found = regressed(laws, acting, records)[0].tolist()
    values = tuple(fixed.get(t.key, v) for t, v in zip(laws, found, strict=True))
    model = ReducedModel(laws, values, several[0].unit)
    return refine(model, several, fixed=tuple(fixed), progress=progress)


def with_damping_split(
    found: Identification, progress: Callable[[str], None] | None = None
) -> Identification:
    """The same with how much of its damping is linear, how much quadratic.

    As it is, with a note, where these two do not follow the decays or cannot be told.
    """
    decays, drag = [record.decay for record in found.records], PowerDamping(2)
    try:
        fit = _with_damping(found, (drag,), progress)
        read = PQ.of(decays)
    except (ValueError, TrajectoryError, LinAlgError) as error:
        note = f"linear and quadratic damping are not told apart: {error}"
        return replace(found, notes=(*found.notes, note))
    values = fit.model.coefficients
    names = [law.key for law in (PowerDamping(1), drag)]
    # Waves are about as slow as the motion: each half-cycle tells one value of them, no more.
    freedom = 2 * sum(record.turns for record in fit.records) - fit.solution.n_values
    by = SIGMAS * wider(max(freedom, 1.0))
    errors = [fit.standard_errors.get(n, 0.0) for n in names]  # of what is known: none
    linear, quadratic = (
        (values[n], values[n] - by * e, values[n] + by * e)
        for n, e in zip(names, errors, strict=True)
    )
    pairs = zip(read.values.tolist(), read.errors.tolist(), strict=True)
    p, q = ((v, v - SIGMAS * e, v + SIGMAS * e) for v, e in pairs)
    split = DampingSplit(linear, quadratic, fit.verdict.explained, p, q, read.half_cycles)
    return replace(found, damping=split)


def with_limit_cycle(
    found: Identification, progress: Callable[[str], None] | None = None
) -> Identification:
    """The same with the unstable limit cycle that it foretells; as it is where it foretells none.

    The damping ratio of two forms, cubic and a function of q, is followed to where it is 0. Of the
    second a further power may grow unseen beyond the data: no more than a part of what the first
    does is expected of it. The likelier one has the value, the interval holds both.
    """
    reach = min(map(abs, found.reach))
    band = found.band(reach * _FALLS)
    (low, high), errors = band.damping_ratio, band.damping_ratio_std
    # On a straight line over the square of the amplitude it is 0 at:
    falls, squares = low - high, (reach * _FALLS) ** 2
    zero = squares[1] + high * np.ptp(squares) / falls if falls > 0 else np.inf
    if not (falls > _TOLD * np.hypot(*errors) and high > 0 and zero < (_FORETOLD * reach) ** 2):
        return found
    forms = (PowerDamping(3),), (PositionDamping(2), PositionDamping(4))
    crossings: list[tuple[float, Array]] = []
    for form in forms:
        try:
            fit = _with_damping(found, form, progress)
        except (ValueError, TrajectoryError, LinAlgError):
            continue
        price = fit.chi_squared + len(fit.free) * np.log(sum(len(e) for e in fit.residuals))
        crossings.append((price, _crossings(fit, reach)))
    crossings.sort(key=lambda priced: priced[0])
    every = np.array([np.percentile(a, [2.5, 50, 97.5], method="nearest") for _, a in crossings])
    if not len(every) or not np.all(np.isfinite(every)):
        note = "the damping falls with amplitude, and no limit cycle is told by the data"
        return replace(found, notes=(*found.notes, note))
    cycle = LimitCycle(float(every[0, 1]), float(every[:, 0].min()), float(every[:, 2].max()))
    return replace(found, limit_cycle=cycle)


def _with_damping(
    found: Identification, laws: Sequence[Term], progress: Callable[[str], None] | None
) -> Fit:
    """Stiffness and inertia in short with viscous damping and some laws, fitted to the decays."""
    bent = [t for t in found.short.model.terms if t.has("stiffness") or t.has("inertia")]
    known = {n: v for n, v in found.model.coefficients.items() if n not in found.free}
    held = {t.key: known[t.key] for t in (*bent, *LINEAR, *laws) if t.key in known}
    return refine_terms([r.decay for r in found.records], [*bent, *laws], held, progress)


def _crossings(fit: Fit, reach: float) -> Array:
    """Amplitudes at which the damping ratio of draws of a fit is 0; inf where it is not."""
    values = fit.model.coefficients
    at = np.array([values[n] for n in fit.free])
    covariance = fit.covariance
    names = [PositionDamping(k).key for k in (2, 4)]
    if names[1] in fit.free:
        i, expected = fit.free.index(names[1]), _UNSEEN * abs(values[names[0]]) / reach**2
        gain = covariance[:, i] / (covariance[i, i] + expected**2)
        at = at - gain * at[i]
        covariance = covariance - np.outer(gain, covariance[i])
    draws = at + normal_draws(covariance, np.random.default_rng(0))
    a = reach * np.linspace(*_SOUGHT)
    found = np.full(len(draws), np.inf)
    for k, draw in enumerate(draws):
        drawn = values | dict(zip(fit.free, draw.tolist(), strict=True))
        ratio = replace(fit.single_model, values=tuple(drawn.values())).damping_ratio(a)
        beyond = np.flatnonzero(ratio <= 0)
        if len(beyond) and (i := int(beyond[0])) > 0:
            found[k] = np.interp(0.0, [ratio[i], ratio[i - 1]], [a[i], a[i - 1]])
    return found


def _seen(
    model: Equations, decays: Sequence[Decay], offset: bool
) -> tuple[tuple[Prepared, ...], tuple[Part, ...]]:
    """Records, and what of their sensors is fitted: offsets, or mode shapes."""
    if not model.numbered:
        records = prepared(decays, model.unit)
        return records, (free_offsets(records),) if offset else ()
    if offset:
        raise ValueError(
            "offset = True is for models of one coordinate: subtract the mean of each channel"
        )
    require_unit(decays, model.unit)
    several = coupled_records([d.free() for d in decays], small_frequencies(model), NUMERICS)
    return several, free_shapes(several)


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
