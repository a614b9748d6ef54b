"""Sentences on what the data determine, and what not; each is written by its numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from romsindy.fit.functions.evidence import Fitted
from romsindy.fit.functions.identification import Identification
from romsindy.fit.functions.series import curvature_for
from romsindy.fit.kernel.prepared import record_notes
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import BY_CHANCE, DEPARTURE, DETERMINED, NOISE_FREE
from romsindy.text import percent
from romsindy.typing import Array

_PLACES = 40
_SIGMAS = 1.96


def sentences(found: Identification, fitted: Fitted, records: Sequence[Record]) -> Iterator[str]:
    """What is wrong with the result or the records, then what is known of inertia and stiffness."""
    if fitted.noise > BY_CHANCE:
        yield _misfit(found, fitted, records)
    if fitted.jump > DEPARTURE:
        cycles = sum(len(r.cycles) for r in records) / len(fitted.windows)
        yield (
            f"every {cycles:.0f} cycles the motion departs from this equation by"
            f" {percent(fitted.jump)} of its amplitude: another mode takes part, the sensor"
            " drifts, its noise is slow, or a force is no function of q"
        )
    if found.verdict.structured and fitted.noise > BY_CHANCE:
        yield (
            "what other modes or the sensor do in time with the motion cannot be told from"
            " stiffness and inertia: bands may miss the truth where the model does not explain"
            " the data"
        )
    yield from record_notes(records)
    if not fitted.converged:
        yield "the fit has not come to its end: bands may be too narrow"
    unit = found.model.unit or "[q]"
    sizes = np.linspace(0.05, 1.0, _PLACES)
    q = np.concatenate([sizes * end for end in found.reach])
    yield _inertia(found, sizes, unit)
    yield from _sensor(found, fitted)
    least, largest = found.reach
    yield f"nothing is known beyond q = {least:.3g} and {largest:.3g} {unit}: do not extrapolate"
    if found.structure.name == "linear":
        yield _straight(found, q)
    k = found.stiffness(q)
    width = (k.high - k.low) / 2 / np.abs(k.value)
    inner = np.tile((sizes > 0.3) & (sizes < 0.7), 2)
    within, worst = (float(np.max(w)) for w in (width[inner], width))
    ends = f"to +- {percent(worst)}" if worst < 1 else "not at all"
    if within < 1:
        yield (
            f"K(q)/q is known to +- {percent(within)} (95 %) between 0.3 and 0.7 of the range,"
            f" {ends} at worst"
        )
    else:
        yield "K(q)/q is not determined: its 95 % band is wider than the stiffness itself"


def _inertia(found: Identification, sizes: Array, unit: str) -> str:
    both = sizes * min(map(abs, found.reach))
    q = np.concatenate([-both, both])
    h = found.inertia(q)
    if not found.structure.sizes.inertia:
        worst = int(np.argmax(h.high))
        return (
            f"the data do not ask for inertia: h(q) is at most {h.high[worst]:.2g} (95 %,"
            f" at q = {q[worst]:.3g} {unit})"
        )
    width = (h.high - h.low) / 2
    good = (width <= DETERMINED * h.value).reshape(2, -1).all(axis=0)
    if not np.any(good):
        return (
            "the data ask for inertia, but hardly say how much: nowhere is h(q) known to"
            f" {percent(DETERMINED)} on both sides"
        )
    ends = np.flatnonzero(np.diff(np.pad(good.astype(int), 1))).reshape(-1, 2)
    parts = " and ".join(f"from |q| = {both[a]:.3g} to {both[b - 1]:.3g}" for a, b in ends)
    return (
        "given one coordinate, inertia is determined (95 % band within"
        f" {percent(DETERMINED)} of h(q)) {parts} {unit}; elsewhere the band says how little"
    )


def _sensor(found: Identification, fitted: Fitted) -> Iterator[str]:
    """What the sensor may have of what was found, and what it seems to have itself."""
    expected = fitted.series.sensor.curvature
    usual = f"{percent(expected)} is expected of a sensor"
    if found.structure.sizes.inertia:
        short = float(np.mean([_curvature_for(found, end) for end in found.reach]))
        nothing = short < _SIGMAS * expected
        yield (
            "one sensor cannot tell inertia from a characteristic that bends as q^3: one that shows"
            f" {percent(short)} too little at the largest amplitude would stand for all of h(q);"
            f" {usual}" + (": it may be the sensor" if nothing else "")
        )
    e, error = fitted.curvature
    if abs(e) > 3 * error:
        more = f"far more than the {percent(expected)} of a usual sensor"
        held = more if abs(e) > 3 * expected else usual
        yield (
            f"the sensor seems to be curved by {100 * e:.2g} +- {100 * error:.1g} % of the largest"
            f" amplitude (a square, fitted beside the equation; {held})"
        )


def _curvature_for(found: Identification, end: float) -> float:
    q = np.linspace(0.0, abs(end), _PLACES)
    return curvature_for(q, found.inertia(np.sign(end) * q).value)


def _straight(found: Identification, q: Array) -> str:
    """How much of a nonlinear stiffness the data would allow."""
    k = found.allowed_stiffness(q)
    middle = float(found.stiffness(0.0).value[0])
    most = max(float(np.max(k.high)) - middle, middle - float(np.min(k.low))) / middle
    if most > 1:
        return "the data do not tell whether the stiffness is nonlinear"
    return (
        f"the data do not ask for nonlinear stiffness: K(q)/q changes by at most {percent(most)}"
        " over the range (95 %)"
    )


def _misfit(found: Identification, fitted: Fitted, records: Sequence[Record]) -> str:
    counted = f"errors and bands count it: they stand for {fitted.noise:.3g} times the noise"
    if all(r.noise.std < NOISE_FREE * r.noise.floor for r in records):
        size = max(r.noise.std / float(np.abs(r.signal).max()) for r in records)
        return (
            "the records are nearly free of noise, and what limits the fit is the equation, which"
            f" misses the signal by {found.adequacy * size:.1g} of its largest value (rms);"
            f" {counted}"
        )
    if found.verdict.explained:
        return f"windows of a few cycles disagree by more than their noise, and {counted}"
    return f"the misfit is larger than the noise of the records, and {counted}"
