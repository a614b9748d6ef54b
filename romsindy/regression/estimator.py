"""From records to coefficients: the estimator that users meet."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pysindy as ps
from pysindy.optimizers.base import BaseOptimizer
from sklearn.base import BaseEstimator, clone
from sklearn.linear_model import LinearRegression
from sklearn.metrics import r2_score
from sklearn.utils.validation import check_is_fitted

from romsindy.fit.records.arguments import require_unit, several_decays
from romsindy.physics.equations import Equations
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.physics.term_sum import term_from_key
from romsindy.record.backbone import Backbone
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Given, Measurement, as_floats, as_seconds
from romsindy.record.smoothing import Filter
from romsindy.regression.judged import Judged, errors_beside
from romsindy.regression.library import ROMLibrary, is_coupled, library_terms
from romsindy.regression.projection import HarmonicProjection, HarmonicRows
from romsindy.regression.windows import (
    WindowProjection,
    WindowRows,
    regressed,
    regressed_forced,
    rows_of,
    rows_of_forced,
)
from romsindy.typing import Array

# Drops terms below 1e-4 of the target: lightly damped modes keep their damping.
_DEFAULT_OPTIMIZER = ps.STLSQ(threshold=1e-4, alpha=1e-12)


class ScaledOptimizer(BaseOptimizer):
    """Any PySINDy optimizer or scikit-learn linear model on columns of equal size.

    Columns and target are divided by their rms (eq. 19 of the method's paper), and coefficients
    scaled back. A threshold then means a relative contribution, ``|c| rms(theta) / rms(target)``,
    whatever the units and the number of rows.

    Parameters
    ----------
    optimizer : estimator, optional
        `pysindy.STLSQ(threshold=1e-4, alpha=1e-12)` by default. It is cloned. Models of
        scikit-learn are fitted without intercept.
    fixed : mapping of int to float, optional
        Columns whose coefficients are known.

    Examples
    --------
    >>> x = np.random.default_rng(0).normal(size=(100, 2)) * [1.0, 1e6]
    >>> ScaledOptimizer().fit(x, x @ [[3.0], [2e-6]]).coef_.round(9).tolist()
    [[3.0, 2e-06]]
    """

    def __init__(self, optimizer: Any = None, fixed: Mapping[int, float] | None = None):
        # The optimizer inside removes its own bias; doing so here would free what is fixed.
        super().__init__(unbias=False)
        self.optimizer = optimizer
        self.fixed = fixed

    def set_params(self, **params: Any) -> ScaledOptimizer:
        """Set parameters and return self, which PySINDy's base class does not."""
        super().set_params(**params)
        return self

    def _reduce(self, x: Array, y: Array) -> None:
        fixed = dict(self.fixed or {})
        free = [j for j in range(x.shape[1]) if j not in fixed]
        coefficients = np.zeros((y.shape[1], x.shape[1]))
        coefficients[:, list(fixed)] = list(fixed.values())
        column_scale, target_scale = rms(x[:, free]), rms(y)
        if free:
            inner = clone(self.optimizer or _DEFAULT_OPTIMIZER)
            if "fit_intercept" in inner.get_params():
                inner.set_params(fit_intercept=False)
            rest = (y - x[:, list(fixed)] @ coefficients[:, list(fixed)].T) / target_scale
            # Some models of scikit-learn warn about, or refuse, a single target as a column.
            inner.fit(x[:, free] / column_scale, rest[:, 0] if rest.shape[1] == 1 else rest)
            scaled = np.reshape(inner.coef_, (y.shape[1], len(free)))
            coefficients[:, free] = scaled * target_scale[:, None] / column_scale
        self.coef_ = coefficients
        self.history_.append(coefficients)


def rms(x: Array) -> Array:
    """Of the columns of x; 1 where a column is 0."""
    found = np.sqrt(np.mean(np.square(x), axis=0))
    return np.where(found > 0, found, 1.0)


# A fixed coefficient that makes its term this many times larger than q_ddot is no physics.
_ABSURD = 10.0


def fixed_columns(
    fixed: Mapping[str, float], terms: Sequence[Term], unit_known: bool
) -> dict[int, float]:
    """Column number to value, after checks of the names."""
    keys = [term.key for term in terms]
    columns = {}
    for key, value in fixed.items():
        if key not in keys:
            term_from_key(key)  # a name that is no law at all is refused with the nearest one
            raise ValueError(f"fixed names {key!r}, but the library has only {keys}: add the term")
        term = terms[keys.index(key)]
        if not np.isfinite(value):
            raise ValueError(f"fixed[{key!r}] = {value!r} must be a finite number")
        if term.dimension[0] != 1 and not unit_known:
            raise ValueError(
                f"fixed[{key!r}] = {value:.6g} is in {term.unit('m')} or the like, but the unit of"
                " q is not known: load the decay with unit=, such as unit='mm'"
            )
        columns[keys.index(key)] = float(value)
    return columns


def refuse_absurd(
    fixed: Mapping[int, float], terms: Sequence[Term], rows: HarmonicRows | WindowRows
) -> None:
    """Known coefficients in other units than the data stand out by orders of magnitude."""
    target = float(rms(rows.target[:, None])[0])
    for column, value in fixed.items():
        share = abs(value) * float(rms(rows.theta[:, [column]])[0]) / target
        term = terms[column]
        if term.key == "omega^2" and (share < 1 / _ABSURD or share > _ABSURD):
            raise ValueError(
                f"fixed['omega^2'] = {value:.6g} 1/s^2 contradicts the data, which oscillate near"
                f" omega^2 = {abs(value) / share:.4g}: omega^2 is in (rad/s)^2, 39.5 times Hz^2,"
                " and t must be in s (a factor of 1e6 means milliseconds)"
            )
        if share > _ABSURD:
            length = term.dimension[0] - 1
            factor = share ** (1 / length) if length else share
            raise ValueError(
                f"fixed[{term.key!r}] = {value:.6g} makes its term {share:.3g} times the"
                f" acceleration: q and the coefficient have different units, q seems {factor:.2g}"
                " times too large (1000 means millimetres); load the decay with unit='mm', or"
                " convert the coefficient"
            )


@dataclass(eq=False, repr=False)
class HarmonicSINDy(BaseEstimator):
    """Identify a reduced model from free decays, in the harmonic domain, or from forced vibrations.

    Every cycle of the decays is projected on its first harmonics, and a scaled sparse regression
    of -q_ddot on the terms of the library finds the coefficients. With a library of several
    coordinates it is the windows of a `WindowProjection` that make the rows, for all equations at
    once: decays have one channel or several, and the strongest vibrations become coordinates. Under
    inputs windows make the rows, too, and each input is one column more.

    Parameters
    ----------
    library : feature library, optional
        `ROMLibrary()` by default, or any library of terms of this package, or a sum of them.
    optimizer : estimator, optional
        Any PySINDy optimizer or scikit-learn linear model; a threshold is a relative contribution
        (see `ScaledOptimizer`). `sklearn.linear_model.LinearRegression()` is least squares.
    projection : HarmonicProjection or WindowProjection, optional
        Harmonics, weak or strong form, amplitude range; or windows for several coordinates, and
        for forced vibrations.
    fixed : mapping of str to float, optional
        Known coefficients by name, such as ``{"omega^2": 1482.2}``, in SI units of q.
    differentiation : Filter, optional
        How derivatives are made where a decay has none; `Butterworth()` by default. Several
        coordinates need none.
    weighted : bool
        Divide the rows of harmonic h by h^d and by the square root of the cycle's amplitude, where
        d is how often the sensor's signal is differentiated to reach q_ddot (2 for displacement).
        Noise is then alike in all rows, and neither the high harmonics nor the large amplitudes,
        where a model misses the most, decide the linear frequency. False is the paper's plain
        regression. Measured: ``python benchmarks/identification.py``, "other recipes".

    Attributes
    ----------
    model_, coef_ : ReducedModel, (n_terms,) array
        The identified equation; its coefficients in the order of the library, then gains of
        inputs.
    rows_, optimizer_ : HarmonicRows, ScaledOptimizer
        The regression behind it.

    Examples
    --------
    >>> from romsindy import HarmonicSINDy, ROMLibrary, example_decay
    >>> estimator = HarmonicSINDy(ROMLibrary(inertia=(3, 4, 5))).fit(example_decay())
    >>> estimator.model_.coefficients["omega^2"]  # doctest: +ELLIPSIS
    36.0...
    """

    library: Any = None
    optimizer: Any = None
    projection: HarmonicProjection | WindowProjection | None = None
    fixed: Mapping[str, float] | None = None
    differentiation: Filter | None = None
    weighted: bool = True

    # t is the second argument of fit and score, where scikit-learn hands over y: so
    # GridSearchCV(HarmonicSINDy(), grid).fit(list_of_x, list_of_t) works without routing.

    def fit(self, x: Any, t: Any = None, u: Any = None) -> HarmonicSINDy:
        """Identify the model.

        Parameters
        ----------
        x : Decay, ForcedVibration, array, or a list of one of them
            Decays that lack velocity or acceleration are cut to their free part, smoothed and
            differentiated; those with both are taken as they are. An array holds the columns q or
            [q, q_dot] or [q, q_dot, q_ddot], shape (n,) or (n, 1..3), in SI units. Several
            coordinates need decays; as they were measured, cut to their free part.
        t : array or list of arrays, optional
            Times (n,) in s that go with arrays. A gap splits a record in two.
        u : array or list of arrays, optional
            Forces (n,) or (n, k) at the same times, as in PySINDy. Of x the displacement is used:
            its first column. For the acceleration of a base, a velocity that was measured, or units
            give a `ForcedVibration` as x, without u.

        Raises
        ------
        ValueError
            For data that cannot be used, unknown names in ``fixed``, or known coefficients that
            contradict the data; more modes than vibrations that ring; u beside a `Decay`, or of
            another length than t; the message names the argument, the value and the remedy.
        """
        terms = library_terms(self.library if self.library is not None else ROMLibrary())
        if not terms:
            raise ValueError("the library has no terms: ask for at least one stiffness term")
        forced = as_forced(x, t, u)
        if is_coupled(terms) or forced:
            unit_known = t is not None or any(v.unit is not None for v in forced[:1])
            return self._fit_windows(terms, x, forced, unit_known)
        decays = as_decays(x, t)
        unit = _common_unit(decays)
        fixed = fixed_columns(self.fixed or {}, terms, unit is not None or t is not None)
        _hint_scale(decays)
        rows = self._rows(terms, decays)
        if rows.theta.shape[0] < len(terms):
            raise ValueError(
                f"{len(rows.amplitude)} cycles give {len(rows.target)} rows for {len(terms)} terms:"
                " use fewer terms, more harmonics or a longer record"
            )
        refuse_absurd(fixed, terms, rows)
        weights = row_weights(rows) if self.weighted else None
        self.optimizer_ = ScaledOptimizer(self.optimizer, fixed)
        self.optimizer_.fit(rows.theta, rows.target, sample_weight=weights)
        self.coef_ = self.optimizer_.coef_[0]
        self.rows_: Any = rows
        valid = (float(rows.amplitude.min()), float(rows.amplitude.max()))
        self.model_: Any = ReducedModel(terms, tuple(self.coef_), unit, valid)
        return self

    def _fit_windows(
        self, terms: Sequence[Term], x: Any, forced: Sequence[ForcedVibration], unit_known: bool
    ) -> HarmonicSINDy:
        """Of several coordinates, or under inputs."""
        model: Equations
        known = dict(self.fixed or {})

        def solve(every: Sequence[Term], rows: WindowRows) -> ScaledOptimizer:
            fixed = fixed_columns(known, every, unit_known)
            return ScaledOptimizer(self.optimizer, fixed).fit(rows.theta, rows.target)

        if is_coupled(terms):
            decays = _whole_decays(x)
            unit_known = decays[0].unit is not None
            fixed_columns(known, terms, unit_known)  # refuses before any work
            model, found = regressed(terms, decays, self._windows(), solve, known, self.weighted)
            self.mode_shapes_ = found.shapes
        else:
            model, found = regressed_forced(terms, forced, self._windows(), solve, self.weighted)
            refuse_absurd(found.optimizer.fixed, found.terms, found.rows)
        self.optimizer_, self.coef_ = found.optimizer, found.optimizer.coef_[0]
        self.model_, self.rows_ = model, found.rows
        return self

    def _windows(self) -> WindowProjection:
        if self.projection is None:
            return WindowProjection()
        if not isinstance(self.projection, WindowProjection):
            raise ValueError(
                f"projection = {self.projection!r} is for one coordinate that decays: with a"
                " library of several, or inputs, give WindowProjection(cycles=6)"
            )
        return self.projection

    def _rows(self, terms: Sequence[Term], decays: Sequence[Decay]) -> HarmonicRows:
        projection = self.projection if self.projection is not None else HarmonicProjection()
        if not isinstance(projection, HarmonicProjection):
            raise ValueError(
                f"projection = {projection!r} is for several coordinates, or inputs: with a library"
                " of one give HarmonicProjection()"
            )
        conditioned = [d.single().conditioned(self.differentiation) for d in decays]
        return HarmonicRows.stacked([projection.rows(terms, d) for d in conditioned])

    def predict(self, x: Any, t: Any = None) -> Any:
        """Acceleration of the identified model at measured displacement and velocity.

        Parameters
        ----------
        x, t
            As in `fit`. Where x has no velocity it is smoothed and differentiated, but not cut.

        Returns
        -------
        (n,) array, or a list of them for a list
            q_ddot in the unit of q per second squared.

        Raises
        ------
        ValueError
            With several coordinates, which a sensor does not show one by one, and with inputs.
        """
        check_is_fitted(self)
        if any(isinstance(term, Input) for term in self.model_.terms):
            raise ValueError(
                "the model has inputs: use model_.simulate(q0, q_dot0, t, u=u), or .predict of"
                " refine(model_, records)"
            )
        if self.model_.numbered:
            raise ValueError(
                f"the model has {self.model_.n_coordinates} coordinates, which no channel shows"
                " alone: use model_.acceleration(q, q_dot) with coordinates, or .predict of"
                " refine(model_, decays)"
            )
        if isinstance(x, np.ndarray) and t is None and x.ndim == 2 and x.shape[1] >= 2:
            return self.model_.acceleration(x[:, 0], x[:, 1])
        several = isinstance(x, (list, tuple))
        results = []
        for decay in as_decays(x, t, split=False):
            d = decay.single()
            d = d if d.q_dot is not None else d.differentiated(self.differentiation)
            results.append(self.model_.acceleration(d.q, np.asarray(d.q_dot)))
        return results if several else results[0]

    def score(self, x: Any, t: Any = None, u: Any = None) -> float:
        """Coefficient of determination R^2 of the projected -q_ddot, in the rows of the regression.

        The linear term alone explains most of it: differences between good models show in the
        third or fourth digit. Compare backbones too.
        """
        check_is_fitted(self)
        rows: HarmonicRows | WindowRows
        model = self.model_
        if model.numbered:
            given = _whole_decays(x), self._windows(), self.mode_shapes_, self.weighted
            rows = rows_of(model, *given)
        elif forced := as_forced(x, t, u):
            rows = rows_of_forced(model, forced, self._windows(), self.weighted)
        else:
            rows = self._rows(model.terms, as_decays(x, t))
        return float(r2_score(rows.target, rows.theta @ model.values))

    def equations(self, precision: int = 4) -> list[str]:
        """The identified equations, a line of text each."""
        check_is_fitted(self)
        return self.model_.equation(precision).splitlines()

    def print(self, precision: int = 4) -> None:
        """Print the identified equation."""
        print(*self.equations(precision), sep="\n")


def row_weights(rows: HarmonicRows) -> Array:
    """One over the variance that is expected of a row's error.

    Noise is the same at every amplitude, and differentiating it favours high harmonics; what a
    model misses grows with amplitude. The error is taken as noise times the square root of the
    amplitude, half-way between the two.
    """
    weights = 1 / (rows.noise**2 * rows.amplitude[rows.cycle])
    return weights / weights.mean()


def as_forced(x: Any, t: Any = None, u: Any = None) -> list[ForcedVibration]:
    """Forced vibrations from what `HarmonicSINDy.fit` takes; none where nothing is forced.

    Raises a ValueError if inputs are given beside decays, or shapes do not fit.
    """
    given = Given.of(x)
    forced = given.driven
    if u is None:
        if forced and len(forced) < len(given.several):
            raise ValueError(
                "x holds forced vibrations and others: regress one kind; refine() takes decays"
                " and forced vibrations together"
            )
        return forced
    if forced:
        raise ValueError("u is given, and x is a ForcedVibration, which has inputs: leave out u")
    if given.decays:
        raise ValueError(
            "u is given, and x is a Decay, which nothing drives: leave out u, or give arrays x, t"
            " and u, or a ForcedVibration"
        )
    if not (isinstance(x, (list, tuple)) and len(x) and np.ndim(x[0])):
        return [_forced(x, t, u)]
    if not isinstance(u, (list, tuple)) or not isinstance(t, (list, tuple)):
        raise ValueError(f"x holds {len(x)} records: give lists t and u as well")
    if not len(x) == len(t) == len(u):
        raise ValueError(f"x holds {len(x)} records, but t {len(t)} and u {len(u)}")
    return [_forced(*one) for one in zip(x, t, u, strict=True)]


def _forced(x: Any, t: Any, u: Any) -> ForcedVibration:
    if t is None:
        raise ValueError("t is missing: give the times in s that go with the arrays x and u")
    x = np.asarray(x, float)
    columns = 1 if np.ndim(u) < 2 else np.shape(u)[1]
    names = ["force", *(f"force {i}" for i in range(2, columns + 1))]
    return ForcedVibration(t, x if x.ndim == 1 else x[:, 0], u, inputs=names)


def _is_decay(x: Any) -> bool:
    """Whether it is a record that nothing drives."""
    return isinstance(x, Measurement) and not x.driven


def as_decays(x: Any, t: Any = None, *, split: bool = True) -> list[Decay]:
    """Decays from what `HarmonicSINDy.fit` takes: decays, arrays with times, or lists of either.

    Raises a ValueError if times are missing, or shapes do not fit.
    """
    if _is_decay(x):
        return [x]
    several = isinstance(x, (list, tuple)) and len(x)
    if several and (_is_decay(x[0]) or isinstance(x[0], (np.ndarray, list, tuple))):
        clocks = [None] * len(x) if t is None else list(t)
        if len(clocks) != len(x):
            raise ValueError(f"x holds {len(x)} records, but t holds {len(clocks)}")
        return [d for xi, ti in zip(x, clocks, strict=True) for d in as_decays(xi, ti, split=split)]
    if t is None:
        raise ValueError("t is missing: give the times in s that go with the array x, or a Decay")
    columns = as_floats("x", x)
    columns = columns[:, None] if columns.ndim == 1 else columns
    times = as_seconds("t", t)
    if columns.ndim != 2 or not 1 <= columns.shape[1] <= 3 or times.shape != (len(columns),):
        raise ValueError(
            "x must have shape (n,) or (n, 1..3) with columns q, q_dot, q_ddot and t shape (n,),"
            f" got {np.shape(x)} and {times.shape}"
        )
    steps, gaps = np.diff(times), np.array([], int)
    if split and len(steps):  # cross-validation cuts the middle out of a record: two are left
        gaps = np.flatnonzero(steps > 1.5 * np.median(steps)) + 1
    bounds = itertools.pairwise([0, *gaps, len(times)])
    return [Decay(times[a:b], *columns[a:b].T) for a, b in bounds]


def _whole_decays(x: Any) -> list[Decay]:
    """Decays of several channels, each once and in one unit."""
    decays = several_decays(x)
    require_unit(decays, decays[0].unit)
    return decays


def _common_unit(decays: Sequence[Decay]) -> str | None:
    units = {d.unit for d in decays}
    if len(units) > 1:
        raise ValueError(
            f"the decays have different units {sorted(map(str, units))}: load all alike"
        )
    return units.pop()


def _hint_scale(decays: Sequence[Decay]) -> None:
    peak = max(float(np.abs(d.q).max()) for d in decays)
    if decays[0].unit == "m" and peak > 10:
        warnings.warn(
            f"q reaches {peak:.4g} m: if it is in millimetres, load it with unit='mm'; a fixed"
            " omega^2 holds in any unit of q, gamma_m and Upsilon_k do not",
            stacklevel=3,
        )


# Regression as in the paper: terms projected as they stand on harmonics 0 to 5, least squares.
PAPER = HarmonicSINDy(
    optimizer=LinearRegression(),
    projection=HarmonicProjection(tuple(range(6)), form="strong"),
    weighted=False,
)
# This package's own: weak form, harmonics 0 to 3, rows weighted by the noise expected in them.
WEIGHTED = HarmonicSINDy(projection=HarmonicProjection())


def regress(
    name: str,
    library: Any,
    decay: Decay | Sequence[Decay],
    backbone: Backbone,
    recipe: HarmonicSINDy = PAPER,
    fixed: Mapping[str, float] | None = None,
) -> Judged:
    """Identify one model by regression and hold its backbone against the extracted one.

    Decays have derivatives; the ``recipe`` says how to regress, and is not changed; coefficients
    that are ``fixed`` are known. Errors are those of `HarmonicSINDy.fit`.
    """
    estimator = clone(recipe).set_params(library=library, fixed=dict(fixed or {})).fit(decay)
    model = estimator.model_
    return Judged(name, model, *errors_beside(model, backbone), tuple(fixed or ()), {}, estimator)


def compare_models(
    decay: Decay | Sequence[Decay],
    backbone: Backbone,
    order: int = 5,
    damping: Sequence[str] = ("linear",),
    fixed: Mapping[str, float] | None = None,
    recipe: HarmonicSINDy = PAPER,
) -> Iterator[Judged]:
    """Identify a stiffness polynomial and an IC-ROM, linear frequency estimated and fixed.

    The decays have derivatives, so that all models see the same signals, and the backbone was read
    off them. Stiffness and inertia go to the ``order``, at least 3; all models have these kinds of
    ``damping``. A fixed linear frequency is the "omega^2" of ``fixed``, or else the one that the
    backbone tends to at small amplitude. The ``recipe`` is `PAPER` or `WEIGHTED`, with other
    harmonics or amplitudes where asked for.

    Raises a ValueError if the order is below 3; and as `HarmonicSINDy.fit`.
    """
    if order < 3:
        raise ValueError(f"order = {order!r} must be at least 3, the lowest with inertia terms")
    fixed = dict(fixed or {})
    omega2 = fixed.pop("omega^2", backbone.linear_frequency() ** 2)
    for name, inertia in (("stiffness", ()), ("IC-ROM", tuple(range(3, order + 1)))):
        library = ROMLibrary(inertia, tuple(range(1, order + 1)), tuple(damping))
        known = {k: v for k, v in fixed.items() if inertia or not k.startswith("Upsilon")}
        for suffix, values in (("", known), (", omega fixed", known | {"omega^2": omega2})):
            yield regress(name + suffix, library, decay, backbone, recipe, values)
