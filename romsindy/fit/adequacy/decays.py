"""Does a model explain decays to their noise, and if not, from which amplitude on?

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

from romsindy.fit.adequacy.verdicts import DEGREE, HARMONICS, Adequacy
from romsindy.fit.kernel.prepared import Prepared, part_of
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import FALSE_ALARM
from romsindy.typing import Array

_CYCLES = 8  # in a window
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
