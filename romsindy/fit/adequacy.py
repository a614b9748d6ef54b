"""Does a model explain the data to their noise, and if not, from which amplitude on?

What a wrong model leaves repeats with the vibration: it lies at the harmonics of the motion. Noise
does not know the motion and is just as strong half-way between them. The residual of a fit is
compared at both, window by window: a test that needs no noise level and stands coloured noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from romsindy.fit.output_error import Record
from romsindy.record.noise import drifting_harmonics, rough_phase
from romsindy.record.signals import crossings
from romsindy.typing import Array, Indices

# A right model is called "not explained" this often.
FALSE_ALARM = 0.01
# More than this times the noise, and something is missing wherever it lies in the spectrum.
LARGEST_RATIO = 1.2
_CYCLES = 8  # in a window
_HARMONICS = 5
_DEGREE = 1


@dataclass(frozen=True, eq=False)
class Adequacy:
    """Whether a model explains its data.

    Attributes
    ----------
    ratio : float
        Rms of the residual over the noise of the record; 1 where nothing is missing.
    p_value : float
        Probability that noise alone leaves as much at the harmonics of the motion (F test).
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
    """

    ratio: float
    p_value: float
    amplitude: Array
    misfit: Array
    limit: float
    unit: str | None

    @property
    def explained(self) -> bool:
        """Whether the residual is noise, at a false-alarm rate of one in a hundred."""
        return self.p_value >= FALSE_ALARM and self.ratio <= LARGEST_RATIO

    def __str__(self) -> str:
        size = f"residual {self.ratio:.3g} times the noise"
        if self.explained:
            return (
                f"The model explains the data to their noise, up to the largest amplitude of"
                f" {self.limit:.3g} {self.unit or '[q]'} ({size}; p = {self.p_value:.2g})."
            )
        where = (
            f"up to an amplitude of {self.limit:.3g} {self.unit or '[q]'} it does"
            if self.limit
            else "at no amplitude"
        )
        return (
            f"The model does not explain the data to their noise: {where} ({size};"
            f" {self._loudest()}; p = {self.p_value:.1g})."
        )

    def _loudest(self) -> str:
        if self.p_value >= FALSE_ALARM:
            return "spread over all frequencies, as from a disturbance or a bad start"
        rms = np.sqrt(np.nanmean(self.misfit**2, axis=0))
        worst = int(np.nanargmax(rms))
        name = "mean position" if worst == 0 else f"harmonic {worst}"
        return f"most of it at the {name}, {rms[worst]:.3g} times the noise there"


def examine(records: Sequence[Record], residuals: Sequence[Array], fitted: int) -> Adequacy:
    """Test residuals for what repeats with the vibration.

    Parameters
    ----------
    records : sequence of Record
    residuals : sequence of (n,) arrays
        Measured minus simulated, unit of the measured quantity.
    fitted : int
        Number of values that were fitted to all records together.
    """
    windows = [w for r, x in zip(records, residuals, strict=True) for w in _windows(r, x)]
    at, between = np.array([w.at for w in windows]), np.array([w.between for w in windows])
    columns = np.array([w.columns for w in windows])  # (n, harmonics + 1), of each `at`
    floor = np.nansum(between, axis=0) / np.maximum(np.sum(columns, axis=0), 1)
    floor = np.where(floor > 0, floor, np.nan)
    power = at / np.where(columns > 0, columns, np.nan) / floor
    share = max(1 - fitted / columns.sum(), 0.1)  # what the fitted values took away
    amplitude = np.array([w.amplitude for w in windows])
    misfit = np.sqrt(power)

    def probability(some: Array) -> float:
        numerator, denominator = columns[some].sum(), columns.sum()
        ratio = np.nansum((columns * power)[some]) / (numerator * share)
        return float(fdtrc(numerator * share, denominator, ratio))

    everything = np.ones(len(windows), bool)
    p_value = probability(everything)
    ratio = _ratio(records, residuals, fitted)
    limit = float(amplitude.max())
    if p_value < FALSE_ALARM or ratio > LARGEST_RATIO:
        limit = _limit(amplitude, [probability(amplitude <= a) for a in amplitude])
    return Adequacy(
        ratio,
        p_value,
        amplitude,
        misfit,
        limit,
        records[0].decay.unit,
    )


def _limit(amplitude: Array, below: Sequence[float]) -> float:
    """Largest amplitude up to which the cycles, taken together, pass the test."""
    order = np.argsort(amplitude)
    failed = np.flatnonzero(np.array(below)[order] < FALSE_ALARM)
    first = int(failed[0]) if len(failed) else len(order)
    return float(amplitude[order[first - 1]]) if first else 0.0


def _ratio(records: Sequence[Record], residuals: Sequence[Array], fitted: int) -> float:
    pairs = zip(residuals, records, strict=True)
    chi_squared = sum(float(x @ x) / record.noise.std**2 for x, record in pairs)
    return float(np.sqrt(chi_squared / (sum(len(x) for x in residuals) - fitted)))


@dataclass(frozen=True)
class _Energies:
    """Energy of a residual at the harmonics and half-way between them, in one window."""

    amplitude: float
    at: Array
    between: Array  # as many columns as `at` has
    columns: Array


def _windows(record: Record, residual: Array) -> list[_Energies]:
    up = crossings(record.signal, record.decay.dt)[0]
    cycles = min(_CYCLES, len(up) - 1)
    bounds = up[::cycles]
    slices = [slice(int(a), int(b)) for a, b in itertools.pairwise(bounds)]
    return [_energies(record, residual, s, up) for s in slices]


def _energies(record: Record, residual: Array, samples: slice, up: Indices) -> _Energies:
    x = residual[samples]
    phase = rough_phase(np.linspace(-1, 1, len(x)), samples, up)
    per_cycle = 2 * np.pi * len(x) / (phase[-1] - phase[0])
    at, between, columns = (np.zeros(_HARMONICS + 1) for _ in range(3))
    for k in range(_HARMONICS + 1):
        if k + 0.75 > per_cycle / 2:
            break
        at[k], columns[k] = _energy(x, phase, k)
        # Two half-way places on either side: as much noise, on the mean, at any slope of it.
        sides = [_energy(x, phase, abs(k + side)) for side in (-0.5, 0.5)]
        between[k] = columns[k] * sum(e for e, _ in sides) / sum(m for _, m in sides)
    q = record.decay.q[samples]
    return _Energies(float(np.ptp(q)) / 2, at, between, columns)


def _energy(x: Array, phase: Array, order: float) -> tuple[float, int]:
    basis, _ = np.linalg.qr(drifting_harmonics(phase, (order,), _DEGREE))
    part = basis.T @ x
    return float(part @ part), len(part)
