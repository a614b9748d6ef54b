"""From cycles to regression rows: every term projected on the harmonics of each cycle."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pysindy import AxesArray
from pysindy.feature_library.base import BaseFeatureLibrary, x_sequence_or_item
from pysindy.utils import comprehend_axes
from scipy.special import bernoulli
from sklearn.base import BaseEstimator

from romsindy.physics.term import Term, WeakForm
from romsindy.record.decay import Decay
from romsindy.record.recording import Quantity
from romsindy.record.signals import crossings
from romsindy.typing import Array, Indices

# From the sensor's signal to the acceleration.
_DIFFERENTIATIONS: dict[Quantity, int] = {"displacement": 2, "velocity": 1, "acceleration": 0}


@dataclass(frozen=True, eq=False)
class HarmonicRows:
    """Rows of the regression theta c = target, each one part of one harmonic of one cycle."""

    # (n_rows, n_terms), (n_rows,), projections of the terms and of -q_ddot
    theta: Array
    target: Array
    # (n_rows,) integer arrays, where a row comes from; real and imaginary parts of a harmonic are
    # two rows
    cycle: NDArray[np.intp]
    harmonic: NDArray[np.intp]
    amplitude: Array  # (n_cycles,), half peak-to-peak amplitude of each cycle
    # (n_rows,), relative size of the sensor's noise in the row: h^d where the signal was
    # differentiated d times to reach q_ddot
    noise: Array

    @staticmethod
    def stacked(parts: Sequence[HarmonicRows]) -> HarmonicRows:
        """Rows of several records, cycles numbered through."""
        starts = np.cumsum([0] + [len(p.amplitude) for p in parts[:-1]])
        numbered = [replace(p, cycle=p.cycle + s) for p, s in zip(parts, starts, strict=True)]
        names = [field.name for field in fields(HarmonicRows)]
        return HarmonicRows(
            *(np.concatenate([getattr(p, name) for p in numbered]) for name in names)
        )


@dataclass(eq=False, repr=False)
class HarmonicProjection(BaseEstimator):
    """Project terms and target on exp(-i h omega t) over each cycle, h in ``harmonics``.

    A cycle is a window between two up-crossings of zero, with its own omega. Real and imaginary
    parts are stacked (eqs. 4-7 of the method's paper): 2 H + 1 rows a cycle for h = 0..H.

    Parameters
    ----------
    harmonics : sequence of int
        Which harmonics; 0 is the mean.
    form : "weak" or "strong"
        The weak form moves time derivatives onto the harmonics by parts, with the boundary terms
        kept, and needs no acceleration. The strong form projects the terms as they stand.
    amplitude : (float, float), optional
        Keep the cycles whose half peak-to-peak amplitude lies in this range, unit of q.

    Notes
    -----
    Median backbone error over 10 seeds of the example oscillator at 30, 35, 40, 50, 60 dB, measured
    by ``python benchmarks/identification.py --forms``: with the Butterworth filter weak 7.0e-4 ...
    2.5e-6, strong 6.9e-4 ... 3.0e-6: nearly alike, since all derivatives come from one smoothed
    signal. With Savitzky-Golay weak 3.8e-4 ... 6.5e-6, strong 3.3e-4 ... 4.8e-4, which is the bias
    of its second derivative.

    Examples
    --------
    >>> from romsindy import HarmonicSINDy, example_decay
    >>> projection = HarmonicProjection(harmonics=(1, 3), amplitude=(0.5, 1.5))
    >>> model = HarmonicSINDy(projection=projection).fit(example_decay(periods=60)).model_
    >>> [round(end, 2) for end in model.amplitude_range]
    [0.51, 1.5]
    """

    harmonics: Sequence[int] = (0, 1, 2, 3)
    form: Literal["weak", "strong"] = "weak"
    amplitude: tuple[float, float] | None = None

    def rows(self, terms: Sequence[Term], decay: Decay) -> HarmonicRows:
        """Rows of all cycles of one decay with derivatives.

        Raises a ValueError if the settings are not valid, a needed derivative is missing, or no
        cycle lies in the amplitude range.
        """
        self._check()
        decay = decay.single()
        strong = self.form == "strong"
        if decay.q_dot is None or (strong and decay.q_ddot is None):
            raise ValueError(
                f"the {self.form} form needs derivatives that the decay lacks:"
                " call decay.differentiated() first"
            )
        if strong and decay.q_ddot is not None:
            columns = [term.strong(decay.q, decay.q_dot, decay.q_ddot) for term in terms]
            table = np.stack([*columns, -decay.q_ddot], axis=1)
            return self.project(table, decay.q, _DIFFERENTIATIONS[decay.measured])
        target = WeakForm(second=-decay.q, second_rate=-decay.q_dot)
        forms = [*(term.weak(decay.q, decay.q_dot) for term in terms), target]
        return self._project_weak(forms, decay)

    def project(self, columns: Array, q: Array, differentiations: int = 0) -> HarmonicRows:
        """Strong form of any columns (n, n_terms + 1), the last one the target; cycles from q."""
        self._check()
        values, amplitudes = [], []
        for start, end, amplitude in self._windows(q, crossings(q, 1.0)[0]):
            n = end - start
            basis = np.exp(-2j * np.pi / n * np.outer(self.harmonics, np.arange(n))) * 2 / n
            values.append(basis @ columns[start:end])
            amplitudes.append(amplitude)
        return self._stack(values, amplitudes, differentiations)

    def _project_weak(self, forms: Sequence[WeakForm], decay: Decay) -> HarmonicRows:
        q, dt = decay.q, decay.dt
        second, second_rate, first, zeroth = (
            np.stack([np.zeros_like(q) if part is None else part for part in parts], axis=1)
            for parts in zip(*forms, strict=True)
        )
        h = np.asarray(self.harmonics)[:, None]
        values, amplitudes = [], []
        for start, end, amplitude in self._windows(q, decay.crossings[0]):
            n = end - start
            inside = slice(start, end + 1)
            basis = np.exp(-2j * np.pi * h * np.arange(n + 1) / n)
            # 2/T int ( ) exp(-i h omega t) dt; the harmonics are 1 at both ends.
            weights = basis * (_quadrature(n + 1) * 2 / n)
            d_dt = 2j * np.pi * h / (n * dt)
            jumps = ((f[end] - f[start]) * (2 / (n * dt)) for f in (first, second_rate, second))
            jump_first, jump_rate, jump_second = jumps
            values.append(
                weights @ zeroth[inside]
                + jump_first
                + d_dt * (weights @ first[inside])
                + jump_rate
                + d_dt * (jump_second + d_dt * (weights @ second[inside]))
            )
            amplitudes.append(amplitude)
        return self._stack(values, amplitudes, _DIFFERENTIATIONS[decay.measured])

    def _windows(self, q: Array, up: Indices) -> list[tuple[int, int, float]]:
        windows = [
            (int(a), int(b), float(np.ptp(q[a : b + 1])) / 2) for a, b in itertools.pairwise(up)
        ]
        low, high = self.amplitude or (0.0, np.inf)
        chosen = [w for w in windows if low <= w[2] <= high]
        if not chosen:
            sizes = [w[2] for w in windows]
            raise ValueError(
                f"amplitude = {self.amplitude} holds no cycle: the cycles of the decay have"
                f" amplitudes from {min(sizes):.4g} to {max(sizes):.4g}"
            )
        shortest = min(b - a for a, b, _ in chosen)
        if shortest < 2 * max(self.harmonics) + 2:
            raise ValueError(
                f"harmonics up to {max(self.harmonics)} need more than the {shortest} samples of"
                " the shortest cycle: use fewer harmonics, or decay.upsampled()"
            )
        return chosen

    def _stack(
        self, cycles: list[NDArray[np.complex128]], amplitudes: list[float], differentiations: int
    ) -> HarmonicRows:
        h = np.asarray(self.harmonics)
        values = np.array(cycles)
        # The mean has no imaginary part: 2 H + 1 rows a cycle.
        parts = np.concatenate([values.real, values.imag[:, h > 0]], axis=1)
        table = parts.reshape(-1, parts.shape[2])
        harmonic = np.tile(np.concatenate([h, h[h > 0]]), len(cycles))
        return HarmonicRows(
            theta=table[:, :-1],
            target=table[:, -1],
            cycle=np.repeat(np.arange(len(cycles)), parts.shape[1]),
            harmonic=harmonic,
            amplitude=np.array(amplitudes),
            noise=np.maximum(1.0, harmonic) ** differentiations,
        )

    def _check(self) -> None:
        h = np.asarray(self.harmonics)
        if h.ndim != 1 or not len(h) or h.dtype.kind not in "iu" or h.min() < 0:
            raise ValueError(f"harmonics = {self.harmonics!r} must be whole numbers, 0 or more")
        if len(set(h.tolist())) != len(h):
            raise ValueError(f"harmonics = {self.harmonics!r} names one twice")
        if self.form not in ("weak", "strong"):
            raise ValueError(f"form = {self.form!r} must be 'weak' or 'strong'")
        if self.amplitude is not None and not 0 <= self.amplitude[0] < self.amplitude[1]:
            raise ValueError(f"amplitude = {self.amplitude!r} must be (low, high), 0 <= low < high")


@cache
def _end_corrections(order: int) -> Array:
    """Corrections to the first weights of the trapezoid rule, exact for degrees below ``order``.

    Gregory's rule: the first samples replace the derivatives of the Euler-Maclaurin formula.
    """
    degrees = np.arange(order)
    moments = np.vander(degrees, increasing=True).T
    errors = bernoulli(order)[1:] / (degrees + 1)  # B_1 = -1/2 halves the first weight
    return np.linalg.solve(moments.astype(float), errors)


def _quadrature(n: int, order: int = 8) -> Array:
    """Weights of n equally spaced samples, spacing 1, of error h^(order + 1)."""
    corrections = _end_corrections(min(order, n // 2))
    weights = np.ones(n)
    weights[: len(corrections)] += corrections
    weights[-len(corrections) :] += corrections[::-1]
    return weights


@dataclass(eq=False, repr=False)
class HarmonicLibrary(BaseFeatureLibrary):
    """Fourier-domain features of any PySINDy library, for plain `pysindy.SINDy`.

    The columns of ``library`` are projected cycle by cycle in the strong form. The target is
    -q_ddot, projected alike; give x = [q, q_dot, q_ddot] and no x_dot::

        model = ps.SINDy(feature_library=HarmonicLibrary(ROMLibrary()), optimizer=ScaledOptimizer())
        model.fit(np.stack([q, q_dot, q_ddot], axis=1), t)
        model.print(lhs=["-q_ddot"])

    Predictions and scores are projections too, one row a part of a harmonic of a cycle.

    Parameters
    ----------
    library : BaseFeatureLibrary
        What to project.
    projection : HarmonicProjection, optional
        Which harmonics and amplitudes; its form is not used.

    Examples
    --------
    >>> from romsindy import ROMLibrary, example_decay
    >>> decay = example_decay(periods=30)
    >>> x = np.stack([decay.q, decay.q_dot, decay.q_ddot], axis=1)
    >>> HarmonicLibrary(ROMLibrary()).fit_transform(x).shape
    (196, 9)
    """

    library: BaseFeatureLibrary
    projection: HarmonicProjection | None = None

    def __add__(self, other: BaseFeatureLibrary) -> HarmonicLibrary:
        # A sum of projections is the projection of the sum; rows of other libraries would not fit.
        if not isinstance(other, HarmonicLibrary):
            raise TypeError(
                f"HarmonicLibrary + {type(other).__name__} would mix cycles with samples: put the"
                " library into a HarmonicLibrary, or add it inside one"
            )
        if repr(other.projection) != repr(self.projection):
            raise ValueError("HarmonicLibrary + HarmonicLibrary needs the same projection in both")
        return HarmonicLibrary(self.library + other.library, self.projection)

    @x_sequence_or_item
    def fit(self, x: Any, y: Any = None) -> HarmonicLibrary:
        """Fit the library behind."""
        self.library.fit(list(x), y)
        self.n_features_in_ = x[0].shape[-1]
        self.n_output_features_ = self.library.n_output_features_
        return self

    @x_sequence_or_item
    def transform(self, x: Any) -> list[AxesArray]:
        """Project: (n, n_columns) -> (n_rows, n_features) for each record."""
        pairs = zip(self.library.transform(list(x)), x, strict=True)
        return [self._projected(np.asarray(f), np.asarray(xi)) for f, xi in pairs]

    def _projected(self, columns: Array, x: Array) -> AxesArray:
        projection = self.projection or HarmonicProjection()
        # Padded with a target, which `project` splits off again.
        padded = np.concatenate([columns, np.zeros((len(x), 1))], axis=1)
        theta = projection.project(padded, x[:, 0]).theta
        return AxesArray(theta, comprehend_axes(theta))

    def calc_trajectory(self, diff_method: Any, x: AxesArray, t: Any) -> tuple[Any, AxesArray]:
        """The target of the regression, projected -q_ddot; PySINDy asks for it when fitting."""
        if x.shape[-1] < 3:
            raise ValueError(
                f"x has {x.shape[-1]} columns: HarmonicLibrary needs [q, q_dot, q_ddot]"
            )
        return x, self._projected(-np.asarray(x)[:, 2:3], np.asarray(x))

    def get_feature_names(self, input_features: Sequence[str] | None = None) -> list[str]:
        """Names of the library behind."""
        return self.library.get_feature_names(input_features)

    def get_feature_names_out(self, input_features: Sequence[str] | None = None) -> np.ndarray:
        """`get_feature_names` as scikit-learn calls it."""
        return np.array(self.get_feature_names(input_features), dtype=object)
