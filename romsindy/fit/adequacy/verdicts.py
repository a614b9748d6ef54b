"""What is said of a model and its data: whether it explains them, and how much it leaves.

Does a model explain decays to their noise, and if not, from which amplitude on?

What a wrong model leaves repeats with the vibration: it lies at the harmonics of the motion. Noise
does not know the motion and is just as strong half-way between them. The residual of a fit is
compared at both, window by window: a test that needs no noise level and stands coloured noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.special import fdtrc, stdtrit
from scipy.stats import linregress

from romsindy.fit.kernel.prepared import Prepared, part_of
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import (
    BARELY,
    COLOURED,
    EXPLAINED,
    FALSE_ALARM,
    SAME_SIGNAL,
    SMALLER,
    STRUCTURE,
    WIDEST_SIGNAL,
)
from romsindy.text import left_over, percent, quantity
from romsindy.typing import Array

HARMONICS = 5
DEGREE = 1  # of the drift of amplitudes in a window
# Cycles in a window, or in a stretch of the record; levels of the response that are told apart, at
# most and at least, with two stretches each; how much louder the loudest must be than the quietest.
CYCLES, MOST_LEVELS, LEAST_LEVELS, _LOUDER = 8, 8, 4, 2.0
# Exponents of what is left against the response: up to the first it is the same at all levels, and
# from the second on it changes.
_SAME, _CHANGES = 0.25, 0.1


@dataclass(frozen=True, eq=False)
class Adequacy:
    """Whether a model explains its data.

    Attributes
    ----------
    ratio : float
        Rms of the whitened residual: 1 where it is noise.
    p_value : float
        Probability that noise alone leaves as much at the harmonics of the motion (F test).
    structure : float
        Chi-square of what lies at the harmonics, over its degrees of freedom: about 1.
    below_floor : bool
        Whether it is smaller than the misfit that does not matter.
    amplitude : (n,) array
        Of every window of eight cycles, half peak to peak, unit of q.
    misfit : (n, 6) array
        Rms of the residual at harmonics 0 to 5 over the noise there; 1 where nothing is missing,
        nan where sampling is too coarse to tell.
    limit : float
        Largest amplitude up to which nothing is missing: that of the data where all is explained,
        0 where not even the quietest cycles are.
    unit : str or None
        Of the amplitudes.
    false_alarm : float
        How often a right model is said to leave something at the harmonics.
    part : float
        Rms of the residual, as a part of that of the response.
    departure, frequency, damping : float
        Errors of the equation that bands of forecasts count, as `romsindy.fit.process_noise.Form`
        has them.
    """

    ratio: float
    p_value: float
    structure: float
    below_floor: bool
    amplitude: Array
    misfit: Array
    limit: float
    unit: str | None
    false_alarm: float = FALSE_ALARM
    part: float = 0.0
    departure: float = 0.0
    frequency: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        for name in (each.name for each in fields(self) if each.type == "float"):
            object.__setattr__(self, name, float(getattr(self, name)))  # a file may say "NaN"
        amplitude, misfit = np.array(self.amplitude, float), np.array(self.misfit, float)
        shape = (amplitude.size, HARMONICS + 1)
        # Without any window the list of a JSON text does not say how many harmonics there are.
        if amplitude.ndim != 1 or (misfit.shape != shape and misfit.size + amplitude.size):
            raise ValueError(
                f"misfit has the shape {misfit.shape}, amplitude {amplitude.shape}: give a list of"
                f" amplitudes, and for each {HARMONICS + 1} numbers of misfit"
            )
        object.__setattr__(self, "amplitude", amplitude)
        object.__setattr__(self, "misfit", misfit.reshape(shape))

    @property
    def structured(self) -> bool:
        """Whether something is left that repeats with the vibration, and matters."""
        significant = self.p_value < self.false_alarm and self.structure > STRUCTURE
        return significant and not self.below_floor

    @property
    def explained(self) -> bool:
        """Whether the residual is down to the noise and without structure that matters."""
        return self.ratio <= EXPLAINED and not self.structured

    @property
    def beyond_noise(self) -> float:
        """Rms of what is left beyond the noise, as a part of that of the response."""
        return self.part * float(np.sqrt(max(1 - self.ratio**-2, 0.0))) if self.ratio else 0.0

    @property
    def everywhere(self) -> float:
        """Rms of what does not go with the motion; none of a decay, whose noise is read off it."""
        return 0.0

    @property
    def good(self) -> bool:
        """Whether one simulation leaves as little as tests of good repeatability differ by."""
        return 0 < self.part <= SAME_SIGNAL

    @property
    def answer(self) -> str:
        """The verdict: "explained", "good for practice" or "not explained"."""
        if self.explained:
            return "explained"
        return "good for practice" if self.good else "not explained"

    @property
    def n_functions(self) -> int:
        """Number of functions of time that repeat with the vibration, over all windows."""
        return (2 * HARMONICS + 1) * (DEGREE + 1) * len(self.amplitude)

    def __str__(self) -> str:
        if not np.isfinite(self.ratio):
            return "The model does not explain the data: it has no motion that follows the record."
        size = f"residual {self.ratio:.3g} times the noise"
        if self.part:
            size = f"it leaves {left_over(self.part, self.ratio)}"
        if self.explained:
            return (
                f"The model explains the data to their noise, up to the largest amplitude of"
                f" {self.limit:.3g} {self.unit or '[q]'} ({size}; {self._chance()})."
            )
        reach = f"an amplitude of {self.limit:.3g} {self.unit or '[q]'}"
        if self.good:
            found = "is good for practice, and something small is missing"
            found += f" beyond {reach}" if self.limit else ""
        else:
            found = "does not explain the data to their noise: "
            found += f"up to {reach} it does" if self.limit else "at no amplitude"
        return f"The model {found} ({size}; {self._loudest()}; {self._chance()})."

    def _chance(self) -> str:
        """The p-value in words that agree with the verdict."""
        p = f"p = {self.p_value:.2g}"
        if self.p_value >= self.false_alarm:
            return f"at the harmonics it may be noise, {p}"
        more = f"at the harmonics it is more than noise, {p}"
        if self.structured:
            return more
        share = f"within {100 * (STRUCTURE - 1):.0f} % of the power of the noise"
        small = "below the floor" if self.below_floor else share
        return f"{more}, but too little to matter: {small}"

    def _loudest(self) -> str:
        if not self.structured:
            return "spread over all frequencies, as from a disturbance or a bad start"
        # Harmonics that sampling is too coarse for have no misfit at all.
        counts = np.maximum(np.sum(~np.isnan(self.misfit), axis=0), 1)
        rms = np.sqrt(np.nansum(self.misfit**2, axis=0) / counts)
        worst = int(np.argmax(rms))
        name = "mean position" if worst == 0 else f"harmonic {worst}"
        return f"most of it at the {name}, {rms[worst]:.3g} times the noise there"


@dataclass(frozen=True, eq=False)
class ForcedAdequacy(Adequacy):
    """Whether a model explains forced vibrations; of `Adequacy`, what goes by windows is empty.

    Attributes
    ----------
    ratio, structure : float
        Rms and power of what is left over those without what goes with motion or input: 1 where
        it is noise.
    p_value : float
        Probability that noise goes with motion or input as much (F test); nan where it was not
        tried, see `romsindy.fit.adequacy.independence`.
    left : float
        Rms of the residual, in the unit of the measured quantity.
    part : float
        The same as a part of the rms of the response.
    measured_unit : str
    undetermined : str
        Stiffness and gains that are not told from 0, with their errors; empty where all are.
    piece : float
        Cycles in each piece, with a state of its own, where the record was followed in pieces: of
        these are the values above. 0 where it was followed from end to end.
    whole : float
        What one simulation of the whole record leaves then, as `part`; nan where it has no motion.
    missing : float
        What goes with motion or input, as a part of the rms of the response.
    like : str
        The force that alone tells most of that.
    sensor, force : float
        Noise of the sensor, and what forces that are noise move, as parts of the response.
    colour : float
        Correlation of the noise of the sensor from sample to sample.
    levels : (k, 2) array
        Rms of the response in stretches of eight cycles, from quiet to loud and those alike
        together, and of what is left of them, measured unit; empty where there are few.
    """

    left: float = 0.0
    measured_unit: str = ""
    undetermined: str = ""
    piece: float = 0.0
    whole: float = 0.0
    missing: float = 0.0
    like: str = ""
    sensor: float = 0.0
    force: float = 0.0
    colour: float = 0.0
    levels: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "levels", np.array(self.levels, float).reshape(-1, 2))

    @property
    def structured(self) -> bool:
        """Whether more than noise goes with motion or input, and it matters."""
        return self.p_value < self.false_alarm and self.missing > BARELY

    @property
    def explained(self) -> bool:
        """Whether what is left goes with neither motion nor input, and the model is determined.

        Forces that were not measured must not move so much that it would be another motion.
        """
        noise = bool(np.isfinite(self.ratio)) and not self.structured
        return noise and self.force <= WIDEST_SIGNAL and not self.undetermined

    @property
    def beyond_noise(self) -> float:
        """What one simulation of the whole record leaves beyond noise and unmeasured forces."""
        return float(np.sqrt(max(self._all**2 - self.sensor**2 - self.force**2, 0.0)))

    @property
    def everywhere(self) -> float:
        """Noise of the sensor, and of forces that were not measured."""
        response = self.left / self.part if self.part else 0.0
        return response * float(np.hypot(self.sensor, self.force))

    @property
    def good(self) -> bool:
        return self._all <= SAME_SIGNAL and not self.undetermined

    @property
    def _all(self) -> float:
        return self.whole if self.piece else self.part

    @property
    def growth(self) -> tuple[float, float]:
        """Exponent of what is left against the response, and its standard error; nan for one level.

        0 where it is the same at all levels, as noise of a sensor is; 1 where it is a part of the
        response.
        """
        if len(self.levels) < LEAST_LEVELS or self.levels[-1, 0] < _LOUDER * self.levels[0, 0]:
            return np.nan, np.nan
        line = linregress(*np.log(self.levels.T))
        return float(line.slope), float(line.stderr)

    def __str__(self) -> str:
        return f"{self._whole()}{self._over_levels()}"

    def _over_levels(self) -> str:
        """Whether what is left grows with the response, in a sentence."""
        slope, error = self.growth
        if np.isnan(slope):
            return ""
        sure = stdtrit(len(self.levels) - 2, 0.975) * error
        (quiet, least), (loud, most) = self.levels[[0, -1]]
        unit = self.measured_unit
        ends = f"{quantity(quiet, unit)} and {quantity(loud, unit)} rms"
        if abs(slope) + sure < _SAME:
            same = "What is left is as large where the response is quiet as where it is loud"
            return f" {same} ({ends})."
        if abs(slope) - sure < _CHANGES:
            return ""
        how = "grows" if slope > 0 else "falls"
        return (
            f" What is left {how} with the response: {quantity(least, unit)} where that is"
            f" {quantity(quiet, unit)} rms, {quantity(most, unit)} where it is"
            f" {quantity(loud, unit)}."
        )

    def _whole(self) -> str:
        if not np.isfinite(self.ratio):
            return "The model does not explain the record: it has no motion that follows it."
        size = f"{quantity(self.left, self.measured_unit)} rms, {percent(self.part)}"
        if self.undetermined:
            rest = self._of_the_whole() if self.piece else f"It leaves {size} of the response"
            return f"The record does not determine the model: {self.undetermined}. {rest}."
        if self.piece:
            done = "explains" if self.explained else "follows"
            return (
                f"The model {done} pieces of {self.piece:.0f} cycles, each from a state of its own,"
                f" but for {size} of the response{self._kind()}. {self._of_the_whole()}."
            )
        found = "explains the record" if self.explained else "does not explain the record"
        if self.good and not self.explained:
            found = "is good for practice, and something small is missing"
        return f"The model {found}: it leaves {size} of the response{self._kind()}."

    def _kind(self) -> str:
        """What is left, in words."""
        if np.isnan(self.p_value):
            return ""
        return f", and {self.gone}" if self.structured else f", as noise: {self.noise}"

    @property
    def gone(self) -> str:
        """What is no noise, in words."""
        return (
            f"{percent(self.missing)} of the response goes with the motion or the input, most like"
            f" {self.like} (p = {self.p_value:.1g})"
        )

    @property
    def noise(self) -> str:
        """Where it comes from."""
        coloured = ", coloured" if self.colour > COLOURED else ""
        sensor = f"{percent(self.sensor)} of the sensor{coloured}"
        if self.force < SMALLER * self.sensor:
            return sensor
        most = ", too much to tell them from what is missing" if self.force > WIDEST_SIGNAL else ""
        return f"{sensor}, {percent(self.force)} by forces that were not measured{most}"

    def _of_the_whole(self) -> str:
        what = "One simulation of the whole record"
        if not np.isfinite(self.whole):
            return f"{what} goes astray: the model has no motion that long"
        if self.whole > 1:
            return f"{what} misses it by more than the response itself"
        return f"{what} leaves {100 * self.whole:.2g} % of the response"


@dataclass(frozen=True, eq=False)
class SteadyAdequacy(Adequacy):
    """Whether a model explains steady states; of `Adequacy`, what goes by windows is empty.

    Attributes
    ----------
    ratio : float
        Rms of what is left over what the noise of the response makes of it; nan where that noise is
        not known.
    p_value : float
        Probability that what does not know motion and force goes with them as much (F test); nan
        where points are too few.
    structure : float
        Power of what is left over that without what goes with motion or force.
    part : float
        Rms of the force that is left at the points as measured, as a part of the force.
    unknown : float
        The same without what the noise of the response makes of it.
    missing : float
        What goes with motion or force, as a part of the force.
    like : str
        The term, or the value of the excitation, that alone tells most of that.
    """

    unknown: float = 0.0
    missing: float = 0.0
    like: str = ""

    @property
    def structured(self) -> bool:
        """Whether more than noise goes with motion or force, and it matters."""
        return self.p_value < self.false_alarm and self.missing > BARELY

    @property
    def explained(self) -> bool:
        """Whether what is left goes with neither motion nor force, and is not another motion.

        Where points are too few to try that, whether the noise of the response makes as much.
        """
        if np.isnan(self.p_value):
            return self.ratio <= EXPLAINED
        return not self.structured and self.unknown <= WIDEST_SIGNAL

    @property
    def beyond_noise(self) -> float:
        """What is left of the force beyond the noise of the response."""
        return self.unknown

    @property
    def good(self) -> bool:
        """Whether what is missing is as little as tests of good repeatability differ by."""
        return not np.isnan(self.p_value) and max(self.missing, self.unknown) <= SAME_SIGNAL

    def __str__(self) -> str:
        size = f"it leaves {percent(self.part)} of the force"
        if np.isfinite(self.ratio):
            size += f", {self.ratio:.3g} times what the noise of the response makes"
        if self.structured:
            size += (
                f", and {percent(self.missing)} of the force goes with the motion or the"
                f" excitation, most like {self.like} (p = {self.p_value:.1g})"
            )
        elif np.isnan(self.p_value):
            size += "; the points are too few to try what goes with motion or excitation"
        elif not self.explained:
            size += ", too much to tell noise from what is missing"
        if self.explained:
            reach = f"up to the largest amplitude of {self.limit:.3g} {self.unit or '[q]'}"
            return f"The model explains the steady states, {reach}: {size}."
        found = "is good for practice, and something small is missing"
        return f"The model {found if self.good else 'does not explain the steady states'}: {size}."


# What an `Adequacy` has of the motion and of windows, where these are not looked at.
NOT_TRIED: dict[str, Any] = {"p_value": np.nan, "structure": 1.0, "below_floor": False}
NOT_TRIED |= dict.fromkeys(("amplitude", "misfit"), np.zeros(0))
_TAKES_PART = 0.2  # of the samples of a window, at least


def examine(
    records: Sequence[Prepared],
    residuals: Sequence[Array],
    n_values: int,
    false_alarm: float = FALSE_ALARM,
) -> Adequacy:
    """Test residuals for what repeats with the vibration.

    Residuals (n,) are measured minus simulated, in the measured unit; so many values were fitted to
    all records together. ``false_alarm`` is how often a right model may be said to leave something.
    """
    pairs = [p for r, x in zip(records, residuals, strict=True) for p in r.alone(x)]
    alone, white = zip(*pairs, strict=True)
    repeated = sum(map(len, white)) / sum(map(len, residuals))  # for each coordinate once
    found = examine_white(alone, white, round(n_values * repeated), false_alarm)
    return replace(found, part=part_of(records, residuals))


def examine_white(
    records: Sequence[Record],
    white: Sequence[Array],
    n_values: int,
    false_alarm: float = FALSE_ALARM,
) -> Adequacy:
    """The same of whitened residuals, (n,) each."""
    unit = records[0].decay.unit
    if not all(np.all(np.isfinite(x)) for x in white):  # there is no motion at all
        nothing = np.zeros((0, HARMONICS + 1))
        return Adequacy(np.inf, 0.0, np.inf, False, nothing[:, 0], nothing, 0.0, unit, false_alarm)
    windows = [w for r, e in zip(records, white, strict=True) for w in _windows(r, e)]
    at, between = np.array([w.at for w in windows]), np.array([w.between for w in windows])
    columns = np.array([w.columns for w in windows])  # (n, harmonics + 1), of each `at`
    floor = np.sum(between, axis=0) / np.maximum(np.sum(columns, axis=0), 1)
    floor = np.where(floor > 0, floor, np.nan)
    power = at / np.where(columns > 0, columns, np.nan) / floor
    share = max(1 - n_values / columns.sum(), 0.1)  # what the fitted values took away
    amplitude = np.array([w.amplitude for w in windows])

    def probability(below: float) -> float:
        some = amplitude <= below
        numerator, denominator = columns[some].sum(), columns.sum()
        ratio = np.nansum((columns * power)[some]) / (numerator * share)
        return float(fdtrc(numerator * share, denominator, ratio))

    n = sum(r.count for r in records)
    total = sum(float(e @ e) for e in white)
    matters = sum(len(r.signal) * (r.noise.floor / r.noise.std) ** 2 for r in records)
    adequacy = Adequacy(
        ratio=float(np.sqrt(total / max(n - n_values, 1))),
        p_value=probability(np.inf),
        structure=float(at.sum() / (columns.sum() * share)),
        below_floor=bool(at.sum() < matters),
        amplitude=amplitude,
        misfit=np.sqrt(power),
        limit=float(amplitude.max()),
        unit=unit,
        false_alarm=false_alarm,
    )
    if adequacy.explained:
        return adequacy
    below = np.sort(amplitude)
    failed = [i for i, a in enumerate(below) if probability(a) < false_alarm]
    first = failed[0] if failed else len(below)
    return replace(adequacy, limit=float(below[first - 1]) if first else 0.0)


@dataclass(frozen=True)
class _Energies:
    """Energy of a residual at the harmonics and half-way between them, in one window."""

    amplitude: float
    at: Array
    between: Array  # as many columns as `at` has
    columns: Array


def _windows(record: Record, residual: Array) -> list[_Energies]:
    bounds = record.cycles[:: min(CYCLES, len(record.cycles) - 1)]
    slices = [slice(int(a), int(b)) for a, b in itertools.pairwise(bounds)]
    # Of a window that takes part in part, the rest may be like it.
    shares = [1.0 if record.part is None else float(np.mean(record.part[s])) for s in slices]
    return [
        _energies(record, residual[s] / np.sqrt(share), s)
        for s, share in zip(slices, shares, strict=True)
        if share > _TAKES_PART
    ]


def _energies(record: Record, x: Array, samples: slice) -> _Energies:
    phase = record.spline.phase(record.t[samples])
    per_cycle = 2 * np.pi * len(x) / (phase[-1] - phase[0])
    at, between, columns = (np.zeros(HARMONICS + 1) for _ in range(3))
    highest = min(HARMONICS, int(per_cycle / 2 - 0.75))
    # Half-way places on either side: as much noise, on the mean, at any slope of it.
    halves = [_energy(x, phase, k + 0.5) for k in range(highest + 1)]
    for k in range(highest + 1):
        at[k], columns[k] = _energy(x, phase, k)
        sides = (halves[max(k - 1, 0)], halves[k])
        between[k] = columns[k] * sum(e for e, _ in sides) / sum(m for _, m in sides)
    return _Energies(float(np.ptp(record.decay.q[samples])) / 2, at, between, columns)


def _energy(x: Array, phase: Array, order: float) -> tuple[float, int]:
    """Energy of a signal at a multiple of a phase, and the number of functions that it has."""
    waves = [np.cos(order * phase), np.sin(order * phase)] if order else [np.ones_like(phase)]
    drift = legvander(np.linspace(-1, 1, len(phase)), DEGREE)
    basis = (np.stack(waves, axis=1)[:, :, None] * drift[:, None, :]).reshape(len(phase), -1)
    part = np.linalg.qr(basis)[0].T @ x
    return float(part @ part), len(part)
