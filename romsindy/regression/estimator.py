"""From records to coefficients: the estimator that users meet."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.metrics import r2_score
from sklearn.utils.validation import check_is_fitted

from romsindy.fit.records.arguments import require_unit, several_decays
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Given, Measurement, as_floats, as_seconds
from romsindy.record.smoothing import Filter
from romsindy.regression.library import ROMLibrary, is_coupled, library_terms
from romsindy.regression.projection import HarmonicProjection, HarmonicRows
from romsindy.regression.scaled_optimizer import ScaledOptimizer, fixed_columns, refuse_absurd
from romsindy.regression.window_motion import WindowRows
from romsindy.regression.windows import (
    WindowProjection,
    regressed,
    regressed_forced,
    rows_of,
    rows_of_forced,
)
from romsindy.typing import Array


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
        known = dict(self.fixed or {})

        def solve(every: Sequence[Term], rows: WindowRows) -> ScaledOptimizer:
            fixed = fixed_columns(known, every, unit_known)
            return ScaledOptimizer(self.optimizer, fixed).fit(rows.theta, rows.target)

        if is_coupled(terms):
            decays = _whole_decays(x)
            unit_known = decays[0].unit is not None
            fixed_columns(known, terms, unit_known)  # refuses before any work
            found = regressed(terms, decays, self._windows(), solve, known, self.weighted)
            self.mode_shapes_ = found.mode_shapes
        else:
            found = regressed_forced(terms, forced, self._windows(), solve, self.weighted)
            refuse_absurd(found.optimizer.fixed, found.terms, found.rows)
        self.optimizer_, self.coef_ = found.optimizer, found.optimizer.coef_[0]
        self.model_, self.rows_ = found.model, found.rows
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
        if self.model_.numbered:
            several = rows_of(
                self.model_, _whole_decays(x), self._windows(), self.mode_shapes_, self.weighted
            )
            return float(r2_score(several.target, several.theta @ self.model_.values))
        forced = as_forced(x, t, u)
        if forced:
            windows = rows_of_forced(self.model_, forced, self._windows(), self.weighted)
            return float(r2_score(windows.target, windows.theta @ self.model_.values))
        rows = self._rows(self.model_.terms, as_decays(x, t))
        return float(r2_score(rows.target, rows.theta @ self.coef_))

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
