"""Does a model explain the data to their noise, and if not, from which amplitude on?

What a wrong model leaves repeats with the vibration: it lies at the harmonics of the motion. Noise
does not know the motion and is just as strong half-way between them. The residual of a fit is
compared at both, window by window: a test that needs no noise level and stands coloured noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.special import fdtrc

from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import EXPLAINED, FALSE_ALARM, SAME_SIGNAL, STRUCTURE
from romsindy.text import percent
from romsindy.typing import Array

_CYCLES = 8  # in a window
_HARMONICS = 5
_DEGREE = 1  # of the drift of amplitudes in a window
_TAKES_PART = 0.2  # of the samples of a window, at least


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
        Errors of the equation that bands of forecasts count, as `romsindy.fit.form.Form` has them.
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
        own = ("ratio", "p_value", "structure", "limit", "false_alarm")
        for name in (*own, "part", "departure", "frequency", "damping"):
            object.__setattr__(self, name, float(getattr(self, name)))
        amplitude, misfit = np.array(self.amplitude, float), np.array(self.misfit, float)
        shape = (amplitude.size, _HARMONICS + 1)
        # Without any window the list of a JSON text does not say how many harmonics there are.
        if amplitude.ndim != 1 or (misfit.shape != shape and misfit.size + amplitude.size):
            raise ValueError(
                f"misfit has the shape {misfit.shape}, amplitude {amplitude.shape}: give a list of"
                f" amplitudes, and for each {_HARMONICS + 1} numbers of misfit"
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
        return (2 * _HARMONICS + 1) * (_DEGREE + 1) * len(self.amplitude)

    def __str__(self) -> str:
        if not np.isfinite(self.ratio):
            return "The model does not explain the data: it has no motion that follows the record."
        size = f"residual {self.ratio:.3g} times the noise"
        if self.part:
            part = f"it leaves {percent(self.part)} of the response"
            size = f"{part}, {self.ratio:.3g} times the noise"
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


def examine(
    records: Sequence[Prepared],
    residuals: Sequence[Array],
    n_values: int,
    false_alarm: float = FALSE_ALARM,
) -> Adequacy:
    """Test residuals for what repeats with the vibration.

    Parameters
    ----------
    records : sequence of Record
    residuals : sequence of (n,) arrays
        Measured minus simulated, unit of the measured quantity.
    n_values : int
        Number of values that were fitted to all records together.
    false_alarm : float
        How often a right model may be said to leave something at the harmonics.
    """
    pairs = [p for r, x in zip(records, residuals, strict=True) for p in r.alone(x)]
    alone, white = zip(*pairs, strict=True)
    repeated = sum(map(len, white)) / sum(map(len, residuals))  # for each coordinate once
    found = examine_white(alone, white, round(n_values * repeated), false_alarm)
    left = sum(float(np.sum(e**2)) for e in residuals)
    return replace(found, part=float(np.sqrt(left / sum(r.power for r in records))))


def examine_white(
    records: Sequence[Record],
    white: Sequence[Array],
    n_values: int,
    false_alarm: float = FALSE_ALARM,
) -> Adequacy:
    """The same of whitened residuals, (n,) each."""
    unit = records[0].decay.unit
    if not all(np.all(np.isfinite(x)) for x in white):  # there is no motion at all
        nothing = np.zeros((0, _HARMONICS + 1))
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
    bounds = record.cycles[:: min(_CYCLES, len(record.cycles) - 1)]
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
    at, between, columns = (np.zeros(_HARMONICS + 1) for _ in range(3))
    highest = min(_HARMONICS, int(per_cycle / 2 - 0.75))
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
    drift = legvander(np.linspace(-1, 1, len(phase)), _DEGREE)
    basis = (np.stack(waves, axis=1)[:, :, None] * drift[:, None, :]).reshape(len(phase), -1)
    part = np.linalg.qr(basis)[0].T @ x
    return float(part @ part), len(part)
