"""Trials of identification on a known decay, one noise each, and the rows that they add up to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from bands import half_width, holds, inertia_samples, interval_score, plain_band
from joblib import Parallel, delayed
from known_beams import KnownDecay
from uncertainty import Row

import romsindy as rs
from romsindy.fit.kernel.collocation import TrajectoryError

MIDDLE = 0.6  # of the largest |q|: where the width of a band is read
ROUNDING = -1e-9  # h below this is negative


@dataclass(frozen=True)
class Trial:
    """What one noise on a known decay led to: bands that hold or not, half-widths in per cent."""

    holds: dict[str, np.ndarray]
    half_widths: dict[str, np.ndarray]
    least_h: tuple[float, float]  # of the model, of all samples
    scores: tuple[float, float]  # of h: this band, the plain regression's
    structure: str
    explained: bool


def trial(known: KnownDecay, snr_db: float, seed: int) -> Trial:
    """Identify once, and compare bands and intervals with the truth."""
    decay = rs.add_noise(known.decay, snr_db, seed)
    found = rs.identify(decay)
    least, largest = found.reach  # noise moves the ends a little
    q = known.points[(known.points >= least) & (known.points <= largest)]
    middle = known.amplitude * np.array([-MIDDLE, MIDDLE])
    inside, widths = {}, {}
    for name, curve, i in (("h", found.inertia, 0), ("K/q", found.stiffness, 1)):
        band, centre = curve(q), curve(middle)
        inside[name] = holds(band.low, band.high, known.curves(q)[i])
        widths[name] = half_width(centre.low, centre.high, known.curves(middle)[i])
    for name, truth in known.coefficients.items():
        low, high = found.interval(name)
        inside[name] = holds(*np.atleast_1d(low, high), truth)
        widths[name] = half_width(low, high, truth)
    h, own = known.curves(q)[0], found.inertia(q)
    scores = (interval_score(own.low, own.high, h), interval_score(*plain_band(decay, q), h))
    return Trial(
        inside, widths, least_inertia(found), scores, found.structure.name, found.verdict.explained
    )


def attempted(
    action: Callable[[int], Any], seeds: Sequence[int], jobs: int, what: str
) -> tuple[list[Any], Row]:
    """Results of all seeds that come to one, and a row that says how many do not."""
    results = Parallel(jobs)(delayed(_attempt)(action, seed) for seed in seeds)
    found = [r for r in results if not isinstance(r, TrajectoryError)]
    lost = len(results) - len(found)
    return found, (f"{what}: identifications that fail", f"{lost} of {len(results)}", "0")


def _attempt(action: Callable[[int], Any], seed: int) -> Any:
    try:
        return action(seed)
    except TrajectoryError as error:
        return error


def least_inertia(found: rs.Identification) -> tuple[float, float]:
    """Least h within reach of the data: of the model, and of any sample."""
    q = np.linspace(*found.reach, 401)
    samples = inertia_samples(found.terms, found.samples, q)
    return float(found.model.inertia(q).min() - 1), float(samples.min())


def widest(snr_db: float) -> dict[str, float]:
    """Half-widths asked for, per cent: stated at 45 and 35 dB, between them as a power of noise."""
    asked = {"h": (8, 20), "K/q": (0.3, 1), "omega^2": (0.05, 0.2), "Upsilon_3": (25, 80)}
    return {
        name: float(np.exp(np.interp(-snr_db, [-45, -35], np.log(ends))))
        for name, ends in asked.items()
    }


def rows_of(known: KnownDecay, name: str, snr_db: float, seeds: range, jobs: int) -> Iterator[Row]:
    """Rows of one beam at one level of noise."""
    label = f"{name}, {snr_db:g} dB"
    trials, lost = attempted(partial(trial, known, snr_db), seeds, jobs, label)
    yield lost
    if trials:
        yield from summary(trials, label, snr_db)


def summary(trials: Sequence[Trial], label: str, snr_db: float) -> Iterator[Row]:
    """Shares, medians and means over trials."""
    n = len(trials)
    for of, limit in widest(snr_db).items():
        share = 100 * np.mean(np.concatenate([t.holds[of] for t in trials]))
        width = np.median([t.half_widths[of] for t in trials])
        yield f"{label}: 95 % of {of} hold, {n} seeds", f"{share:.1f} %", "90 to 98 %"
        yield f"{label}: half-width of {of}", f"{width:.3g} %", f"at most {limit:.3g} %"
    least = np.array([t.least_h for t in trials])
    model, samples = np.sum(least < ROUNDING, axis=0)
    yield f"{label}: h < 0 in the model, in any sample", f"{model}, {samples} of {n}", "0, 0"
    yield f"{label}: least h", f"{least.min():.1e}", "not negative"
    own, plain = np.mean([t.scores for t in trials], axis=0)
    yield f"{label}: interval score of h", f"{own:.3g}", f"below {plain:.3g} of plain regression"
    heads = ", ".join(f"{k} {v}" for k, v in Counter(t.structure for t in trials).most_common())
    yield f"{label}: at the head", heads, "reported"
    yield f"{label}: explained", f"{sum(t.explained for t in trials)} of {n}", "reported"
