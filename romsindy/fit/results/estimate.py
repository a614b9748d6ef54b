"""What is known of a model: coefficients, their covariance, and how far they explain the data.

However it was found, and without the data it was found from, so that it can be kept in a file.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from romsindy.fit.adequacy.verdicts import Adequacy, ForcedAdequacy, SteadyAdequacy
from romsindy.fit.process_noise import SIGMAS, Form, as_coefficients, normal_draws
from romsindy.fit.results.forced_band import ForcedBand, forced_band
from romsindy.fit.results.predict import Forecast, Sensors, foretold, predicted
from romsindy.fit.verdict import REFUSED
from romsindy.notebook import Framed, shown
from romsindy.orbits.curves import checked_force, require_mode
from romsindy.orbits.mode_orbits import mode_orbits
from romsindy.physics.coupled import model_from_json
from romsindy.physics.coupling import SlavedInertia
from romsindy.physics.equations import Equations, gain_of, without_inputs
from romsindy.physics.input import input_in
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.physics.term_sum import json_text, read_json
from romsindy.physics.validation import array, made, several, table
from romsindy.physics.validation import text as entry
from romsindy.record.decay import Decay
from romsindy.record.files.save import write_whole
from romsindy.record.forced import ForcedVibration
from romsindy.text import TextTable, listed, with_error
from romsindy.typing import Array

# At q = 0 a secant takes the place of the slope, this part of the range off.
_SECANT = 1e-6
_OUTSIDE = 1.001  # of the range of the data, by rounding
Function = Callable[[Equations, Array], Array]


@dataclass(frozen=True, eq=False)
class Curve(Framed):
    """A function of q as the model has it, with the 95 % band of all that may be true; (n,) each.

    The band holds pointwise.
    """

    q: Array
    value: Array
    low: Array
    high: Array

    _columns = ("q", "value", "low", "high")


def inertia_of(coordinate: int) -> Function:
    """h(q): inertia of a coordinate, from 1, beside its unit mass, all others at rest."""
    at = coordinate - 1
    return lambda model, q: np.asarray(_held(model, at, q)[3][:, at, at] - 1)


def secant_of(coordinate: int, size: float) -> Function:
    """K(q) / q of a coordinate, all others at rest; at 0 its limit. ``size`` is the range of q."""
    at, step = coordinate - 1, _SECANT * size

    def secant(model: Equations, q: Array) -> Array:
        away = np.where(np.abs(q) < step, step, q)
        return np.asarray(_held(model, at, away)[0][:, at] / away)

    return secant


def _held(model: Equations, at: int, q: Array) -> tuple[Array, ...]:
    """Forces (n, R) and their slopes (n, R, R) where one coordinate is displaced, and held."""
    positions = q[:, None] * np.eye(model.n_coordinates)[at]
    rest = np.zeros_like(positions)
    return model.residual_and_slopes(positions, rest, rest)


def checked_range(q: ArrayLike, reach: tuple[float, float], unit: str | None) -> Array:
    """Displacements (n,) within the range of the data.

    Raises a ValueError if one is outside.
    """
    q = np.atleast_1d(np.asarray(q, float))
    least, largest = reach
    if not np.all((q >= _OUTSIDE * least) & (q <= _OUTSIDE * largest)):
        raise ValueError(
            f"q = {q.min():.4g} to {q.max():.4g} leaves the range of the data,"
            f" {least:.4g} to {largest:.4g} {unit or '[q]'}: bands say nothing"
            " there; stay within reach"
        )
    return q


def checked_coordinate(coordinate: int, model: Equations) -> int:
    """The number of a coordinate of a model, from 1.

    Raises a ValueError if it has no such coordinate.
    """
    whole = isinstance(coordinate, (int, np.integer)) and not isinstance(coordinate, bool)
    if not (whole and 1 <= coordinate <= model.n_coordinates):
        raise ValueError(
            f"coordinate = {coordinate!r} must be a whole number from 1 to"
            f" {model.n_coordinates}: the model has no other"
        )
    return int(coordinate)


E = TypeVar("E", bound="Estimate")
# Part of a standard error by which a coefficient moves for the slope of a curve.
_STEP = 0.1
_LACKS = (
    "the model does not explain its data to their noise: the band counts the errors of its"
    " coefficients, not what it lacks"
)


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """A model with the covariance of its coefficients and the verdict on it.

    Parameters
    ----------
    model : ReducedModel or CoupledModel
        With the estimated coefficients.
    free : tuple of str
        Names of the coefficients that were estimated, in the order of `covariance`.
    covariance : (n_free, n_free) array
        Of the free coefficients, in the units of the model.
    verdict : Adequacy
        Whether the data are explained, in numbers and in a sentence.
    notes : tuple of str
        What the reader must know of the records and of the estimation.

    Raises
    ------
    ValueError
        If a free name is not in the model or stands twice, or the covariance does not fit.

    Examples
    --------
    >>> from romsindy import refine
    >>> model = ReducedModel.from_coefficients({"omega^2": 36.0, "c_linear": 0.1}, unit="m")
    >>> fit = refine(model, model.simulate(1.0, 0.0, np.arange(0.0, 10.0, 0.05)))
    >>> Estimate.from_json(fit.to_json()).model.equation()
    'q_ddot + 36 q + 0.1 q_dot = 0'
    """

    model: Equations
    free: tuple[str, ...]
    covariance: Array
    verdict: Adequacy
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        known = list(self.model.coefficients)
        if len({*self.free} & {*known}) != len(self.free):
            raise ValueError(
                f"free = {list(self.free)} must name coefficients of the terms {known} once: leave"
                " out what is none of them"
            )
        try:
            covariance = np.array(self.covariance, float, order="C")
        except (TypeError, ValueError) as error:
            raise ValueError(f"covariance must be a table of numbers: {error}") from error
        n = len(self.free)
        if covariance.shape != (n, n):
            raise ValueError(
                f"covariance has the shape {covariance.shape}, but {n} coefficients are free:"
                f" give ({n}, {n}), in the order of {list(self.free)}"
            )
        if not np.all(np.diag(covariance) >= 0):
            raise ValueError("covariance must have variances of at least zero on its diagonal")
        object.__setattr__(self, "covariance", covariance)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of every free coefficient, by name."""
        return dict(zip(self.free, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def predict(self, record: Decay | ForcedVibration, samples: int) -> Array:
        """Simulate a record that took no part, from the state that its first samples show.

        Parameters
        ----------
        record : Decay or ForcedVibration
            A free decay, with the channels of those behind the fit, or a vibration with its inputs.
        samples : int
            So many, of every channel, give the state: at least 4 for each coordinate.

        Returns
        -------
        array like the measured signal
            (n,) or (n, n_channels), in the measured quantity.

        Raises
        ------
        ValueError
            If channels or inputs differ, or the samples are too few or too many.
        TrajectoryError
            If the model has no motion that long from there.
        """
        return predicted(self.model, self.sensors, record, samples)

    def forecast(self, record: Decay | ForcedVibration, samples: int) -> Forecast:
        """`predict` with the 95 % band of what will be measured.

        That of each sample for itself, with the errors of coefficients and state, the noise of the
        record, and what the verdict admits: departures from the equation, which grow beyond the
        amplitudes of the data, and what moves from record to record.

        Returns
        -------
        Forecast
            value, low and high like the measured signal, and notes.
        """
        return foretold(*self.draws(), self.sensors, self.verdict, record, samples)

    def draws(self) -> tuple[Equations, tuple[str, ...], Array]:
        """A model, names of coefficients, and what they may be off by, (n_draws, m)."""
        return self.model, self.free, normal_draws(self.covariance, np.random.default_rng(0))

    def with_form(self: E, form: Form) -> E:
        """The same with errors of its form, which the verdict keeps."""
        sizes = {"departure": form.departure, "frequency": form.frequency, "damping": form.damping}
        verdict = replace(self.verdict, **sizes)  # type: ignore[arg-type]
        return replace(self, verdict=verdict, notes=(*self.notes, *filter(None, [form.note])))

    @property
    def sensors(self) -> Sensors:
        """What is known of the sensors: nothing is saved of them."""
        return Sensors()

    def interval(self, name: str) -> tuple[float, float]:
        """95 % interval of a coefficient, such as "Upsilon_3"; its value alone where it is fixed.

        Raises
        ------
        ValueError
            If there is no such coefficient.
        """
        values = self.model.coefficients
        if name not in values:
            raise ValueError(f"name = {name!r} is no coefficient: there are {', '.join(values)}")
        half = SIGMAS * self.standard_errors.get(name, 0.0)
        return values[name] - half, values[name] + half

    def reach_of(self, coordinate: int = 1) -> tuple[float, float]:
        """Least and largest q of the data, unit of q: what is known of it is the amplitude."""
        checked_coordinate(coordinate, self.model)
        largest = (self.model.amplitude_range or (0.0, np.inf))[1]
        return -largest, largest

    def inertia(self, q: ArrayLike, coordinate: int = 1) -> Curve:
        """h(q) beside the unit mass of a coordinate, with its 95 % band by the covariance.

        Parameters
        ----------
        q : (n,) array
            Within the range of the data, unit of q; other coordinates are at rest.
        coordinate : int
            Of several, from 1.

        Raises
        ------
        ValueError
            If q leaves the range of the data, or there is no such coordinate.
        """
        return self._curve(q, inertia_of(coordinate), coordinate)

    def stiffness(self, q: ArrayLike, coordinate: int = 1) -> Curve:
        """K(q) / q in 1/s^2 along a coordinate, with its 95 % band; as `inertia`."""
        largest = max(map(abs, self.reach_of(coordinate)))
        size = largest if np.isfinite(largest) else 1.0
        return self._curve(q, secant_of(coordinate, size), coordinate)

    def _curve(self, q: ArrayLike, function: Function, coordinate: int) -> Curve:
        q = checked_range(q, self.reach_of(coordinate), self.model.unit)

        def read(model: Equations) -> Array:
            return function(model, q)

        value, half = read(self.model), SIGMAS * self.errors_of(read)
        return Curve(q, value, value - half, value + half)

    def table(self) -> list[list[str]]:
        """Rows of text: every coefficient with its standard error, if it was estimated."""
        errors, model = self.standard_errors, self.model
        rows = [
            [t.key, *with_error(value, errors.get(t.key, 0.0)), t.unit(model.unit)]
            for t, value in model.pairs
        ]
        return [["coefficient", "value", "+-", "unit"], *rows]

    @property
    def adequacy(self) -> float:
        """Rms of the residual over the noise; 1 where the model explains the data to it."""
        return self.verdict.ratio

    @property
    def single_model(self) -> ReducedModel:
        """The model, where it has one coordinate.

        Raises
        ------
        ValueError
            For a model of several.
        """
        if self.model.numbered:
            raise ValueError(
                f"the model has {self.model.n_coordinates} coordinates, and one is needed here:"
                " backbone_curve(model, mode=...) follows the modes of several"
            )
        return cast(ReducedModel, self.model)

    def band(self, amplitudes: ArrayLike, mode: int = 1) -> Band:
        """Backbone and damping of the model with their standard errors.

        Parameters
        ----------
        amplitudes : (n,) array
            Half peak to peak, positive, unit of q; of several coordinates that of the one that
            moves most in the mode.
        mode : int
            Number of the mode, by frequency, from 1, with its interactions.

        Returns
        -------
        Band
            nan where the model has no orbit of that amplitude. A mode that turns back where it
            meets another one is followed from small amplitudes up to there, and is nan beyond.

        Raises
        ------
        ValueError
            If an amplitude is not positive, or the model has no such mode.
        ContinuationError
            If the orbits of several coordinates end far below the amplitudes.
        """
        a = np.atleast_1d(np.asarray(amplitudes, float))
        curves, model = curves_near(self.model, a, mode), self.model
        (omega, zeta), (omega_std, zeta_std) = curves(model), self.errors_of(curves)
        return Band(a, omega, zeta, omega_std, zeta_std, model.unit)

    def forced_response(
        self,
        force: ArrayLike,
        frequency: tuple[float, float],
        n_harmonics: int | None = None,
        *,
        velocity_scale: float | None = None,
        n_points: int = 100,
    ) -> ForcedBand:
        """Response to force cos(omega t) with its 95 % band, by the covariance.

        Parameters
        ----------
        force : float or (R,) array
            As that of `romsindy.forced_response`.
        frequency, n_harmonics, velocity_scale, n_points
            As those of `romsindy.forced_response`.

        Returns
        -------
        ForcedBand
            What else may differ in a measurement is not in the band: the force, the sensor.

        Raises
        ------
        ValueError
            As `romsindy.forced_response`.
        """
        model, v = self.model, self.verdict
        drives = [term for term in model.terms if input_in(term)]
        acting = input_in(drives[0]) if drives else None
        given = checked_force(force, 1 if drives else model.n_coordinates)
        forces = (acting.sign if acting else 1) * gain_of(model) * given
        back = -1 if forces[np.argmax(np.abs(forces))] < 0 else 1
        names = tuple(name for name in self.free if name not in {term.key for term in drives})
        slopes = np.zeros((len(names) + len(forces), len(self.free)))
        slopes[range(len(names)), [*map(self.free.index, names)]] = 1.0
        unit = replace(model, values=(1.0,) * len(model.values))
        for term, (_, by_gain) in zip(drives, unit.pushes, strict=True):
            if term.key in self.free:
                slopes[len(names) :, self.free.index(term.key)] = given * by_gain
        form = None
        if not model.numbered:
            moved = np.hypot(v.departure, [v.frequency, v.damping])
            form = [[*as_coefficients(moved[0], moved[1], model.linear_modes[0][0]), 0.0]] * 2
        return forced_band(
            without_inputs(model),
            back * (forces if model.numbered else forces[0]),
            frequency,
            names,
            slopes @ self.covariance @ slopes.T,
            n_points=n_points,
            n_harmonics=n_harmonics,
            velocity_scale=velocity_scale,
            lead=np.pi if back < 0 else 0.0,
            delay=acting.delay if acting else 0.0,
            notes=() if v.explained else (_LACKS,),
            form=form,
        )

    def errors_of(self, read: Callable[[Equations], Array]) -> Array:
        """Standard errors of numbers that are read off the model, to first order."""
        errors = self.standard_errors
        slopes = np.array([self._slope(name, error, read) for name, error in errors.items()])
        return np.sqrt(np.einsum("p...,pq,q...->...", slopes, self.covariance, slopes))

    def _slope(self, name: str, error: float, read: Callable[[Equations], Array]) -> Array:
        """Derivative of these numbers with respect to a coefficient."""
        model = self.model
        if error == 0:  # without error it adds nothing, whatever its slope
            return np.zeros_like(read(model))
        values = model.coefficients
        ends = [values | {name: values[name] + s * error} for s in (_STEP, -_STEP)]
        high, low = (read(replace(model, values=tuple(end.values()))) for end in ends)
        return (high - low) / (2 * _STEP * error)

    def __str__(self) -> str:
        errors = self.standard_errors
        lines = [f"{self.model.equation()}    (q in {self.model.unit or '[q]'}, t in s)"]
        for term, value in self.model.pairs:
            error = f"+- {errors[term.key]:.2g}" if term.key in errors else "(fixed)"
            lines.append(
                f"  {term.key:<12} {value:>12.6g} {error:<11} {term.unit(self.model.unit)}".rstrip()
            )
        return "\n".join([*lines, str(self.verdict), *self.remarks()])

    def remarks(self) -> list[str]:
        """The notes, as sentences."""
        return [f"Note: {note.rstrip('.')}." for note in self.notes]

    def _repr_html_(self) -> str:
        sentences = [str(self.verdict), *self.remarks()]
        return shown(self.model.formulas(), [TextTable("", self.table())], sentences)

    def __repr__(self) -> str:
        return f"<Estimate: {len(self.free)} coefficients, adequacy {self.adequacy:.3f}>"

    # -- JSON ---------------------------------------------------------------------------------

    def to_json(self) -> str:
        """JSON text of the model (`ReducedModel.to_json`), with four more entries.

        They are "free", "covariance", "verdict" and "notes". Every number reads back as the same
        number; those that are not finite, such as the ratio of a model without any motion, are the
        strings "Infinity", "-Infinity" and "NaN" (see `romsindy.physics.term_sum`), for JSON has no
        such numbers. `ReducedModel.from_json` reads the model alone.
        """
        content = json.loads(self.model.to_json()) | {
            "free": self.free,
            "covariance": self.covariance,
            "verdict": vars(self.verdict),
            "notes": self.notes,
        }
        return json_text(content)

    @classmethod
    def from_json(cls, text: str) -> Estimate:
        """Read what `to_json` wrote; of a `Fit` too, without what it was made of.

        Raises
        ------
        ValueError
            If the text is no JSON or cut short, holds no model or a model alone, or entries that
            do not belong together.
        """
        content = read_json(text)
        model = model_from_json(text)
        missing = {"free", "covariance", "verdict", "notes"} - set(content)
        if missing:
            raise ValueError(
                f"the JSON text holds a model without {', '.join(sorted(missing))}: write it again"
                " with identify --save or Fit.save; a file with nothing but terms, unit and"
                " amplitude_range is the model alone (in Python: ReducedModel.from_json)"
            )
        names, notes = (several(entry)(key, content[key]) for key in ("free", "notes"))
        covariance = array("covariance", content["covariance"])
        return Estimate(model, names, covariance, _verdict(content["verdict"]), notes)

    def save(self, path: str | Path) -> None:
        """Write the JSON text to a file, see `to_json`."""
        write_whole(path, self.to_json() + "\n")

    @classmethod
    def load(cls, path: str | Path) -> Estimate:
        """Read a file that `save` wrote.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        ValueError
            If it holds something else; the message names the file and what is wrong with it.
        """
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"{path}: no such file")
        try:
            return cls.from_json(path.read_text(encoding="utf-8"))
        except ValueError as error:  # also that of bytes that are no text
            raise ValueError(f"{path} is no file of {cls.__name__}.save: {error}") from error


def _verdict(content: Any) -> Adequacy:
    own = {"measured_unit": ForcedAdequacy, "unknown": SteadyAdequacy}
    kinds = [kind for name, kind in own.items() if name in table("verdict", content)]
    return made(kinds[0] if kinds else Adequacy, "verdict", content)


@dataclass(frozen=True, eq=False)
class Band(Framed):
    """Backbone and damping ratio of a model, with standard errors.

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

    _columns = ("amplitude", "frequency", "damping_ratio", "frequency_std", "damping_ratio_std")


def curves_near(model: Equations, amplitudes: Array, mode: int) -> Callable[[Any], Array]:
    """A function of the model, or one near it: angular frequency and damping ratio, (2, n)."""
    require_mode(mode, model)
    if model.numbered:
        return mode_orbits(model, amplitudes, mode).curves
    return lambda near: near.frequency_and_damping(amplitudes)


_SURE = 3.0  # standard errors off zero


def massless(found: Estimate) -> float:
    """Standard errors by which the fast modes that follow have less than no mass; 0 with mass.

    Their products of inertia over the powers that they follow, such as q1^2 and q1 q2, are sums of
    squares: a positive semidefinite matrix, see `SlavedInertia`. Its least eigenvalue is judged,
    which changes with each product by those of the entries of its vector.
    """
    laws = {t.key: t for t in found.model.terms if isinstance(t, SlavedInertia)}
    shapes = sorted({shape for t in laws.values() for shape in (t.first, t.second)})
    if not shapes:
        return 0.0
    matrix, values = np.zeros((len(shapes), len(shapes))), found.model.coefficients
    places = {name: (shapes.index(t.first), shapes.index(t.second)) for name, t in laws.items()}
    for name, (i, j) in places.items():
        matrix[i, j] = matrix[j, i] = values[name]
    least, vectors = np.linalg.eigh(matrix)
    own = {n: (1 + (i != j)) * vectors[i, 0] * vectors[j, 0] for n, (i, j) in places.items()}
    slope = np.array([own.get(name, 0.0) for name in found.free])
    variance = float(slope @ found.covariance @ slope)
    return max(-float(least[0]), 0.0) / np.sqrt(variance) if variance > 0 else 0.0


def possible(found: Estimate, laws: Sequence[Term]) -> list[Term]:
    """Laws of an equation without those of a sign that they cannot have, unless surely so."""
    values, errors = found.model.coefficients, found.standard_errors
    over = [(law, values[law.key] - law.least, errors.get(law.key, 0.0)) for law in laws]
    return [law for law, value, error in over if value > 0 or not value > -REFUSED * error]


def supplying(found: Estimate) -> list[str]:
    """Names of nonlinear laws of damping that are surely negative: they would supply energy."""
    errors, values = found.standard_errors, found.model.coefficients
    names = [n for n in errors if n.startswith("c_") and not n.startswith("c_linear")]
    return [n for n in names if errors[n] and values[n] < -_SURE * errors[n]]


def stand_ins(found: Estimate) -> Iterable[str]:
    """Sentences on what has a sign that it cannot have, and so stands for another law."""
    if (errors_off := massless(found)) > _SURE:
        yield (
            "the products of inertia g(...) came out as of fast modes with less than no mass, by"
            f" {errors_off:.3g} standard errors: one that is missing, or another law, is among them"
        )
    names = supplying(found)
    if not names:
        return
    errors, values = found.standard_errors, found.model.coefficients
    least = min(abs(values[n]) / errors[n] for n in names)
    yield (
        f"{listed(names)} came out negative, by {least:.3g} standard errors: by itself it would"
        " supply energy, as a flow does; or it stands for a law that is not among those that were"
        " chosen from"
    )
