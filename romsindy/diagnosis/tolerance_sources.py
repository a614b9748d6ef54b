"""Where tolerances come from: what was stated, repeat runs, and what a model is known to leave."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from numbers import Real

import numpy as np

from romsindy.diagnosis.checks import checked_records
from romsindy.diagnosis.difference import Difference
from romsindy.diagnosis.form import NO_FORM_ERROR, FormError
from romsindy.diagnosis.prediction import predict
from romsindy.diagnosis.tolerance import DEFAULT, KINDS, Tolerance
from romsindy.fit.estimate import Estimate
from romsindy.fit.record import Record
from romsindy.fit.verdict import SURE
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay

_FROM = 0.1  # of the largest amplitude: bands of an estimate are wide below
_BAND = 2.0  # standard errors


def stated(tolerance: object) -> Tolerance:
    """A tolerance as a user gives it: of the frequency, or by kind, or ready.

    Raises
    ------
    ValueError
        If it is none of these.
    """
    if isinstance(tolerance, Tolerance):
        return tolerance
    if isinstance(tolerance, Real) and not isinstance(tolerance, bool):
        return Tolerance(frequency=float(tolerance), source="stated")
    if isinstance(tolerance, Mapping) and set(tolerance) <= set(KINDS):
        return Tolerance(**tolerance, source="stated")
    raise ValueError(
        f"tolerance = {tolerance!r} must be a relative size of the frequency, such as 0.001, or a"
        f" mapping of {list(KINDS)} to such sizes"
    )


def of_repeats(repeats: Sequence[Decay], floor: float) -> Tolerance:
    """How far decays that were measured again are from each other, at equal amplitude.

    Raises
    ------
    ValueError
        If there are fewer than two, one is there twice, or two share no amplitudes.
    """
    if len(repeats) < 2:
        raise ValueError(f"repeats holds {len(repeats)} decay: give two or more of the same test")
    if any(a.same_record(b) for a, b in itertools.combinations(repeats, 2)):
        raise ValueError("repeats holds a record twice: give each run of the test once")
    try:
        records = [Record.loud(d, floor) for d in repeats]
        found = [Difference.between(a, b) for a, b in itertools.combinations(records, 2)]
    except ValueError as error:
        raise ValueError(f"repeats of the same test cannot be compared: {error}") from error
    return _largest(found, "repeats")


def of_references(
    model: ReducedModel, references: Sequence[Decay], floor: float
) -> tuple[Tolerance, FormError]:
    """What a model leaves on the records that it was identified from.

    Raises
    ------
    ValueError
        If a record cannot be that of the model.
    """
    records = checked_records(model, references, floor, "reference")
    form = NO_FORM_ERROR
    for reference in references:
        form = form.joined(FormError.of(model, reference, floor))
    left = [Difference.of(r, predict(model, (), r).before) for r in records]
    return _largest(left, "reference"), form


def of_estimate(estimate: Estimate, largest: float) -> Tolerance:
    """How far the curves of an estimate may be off, at amplitudes up to one (unit of q)."""
    band = estimate.band(np.geomspace(_FROM * largest, largest, 12))
    off = {
        "frequency": band.frequency_std / band.frequency,
        "damping": np.abs(band.damping_ratio_std / band.damping_ratio),
    }
    bands = {}
    for kind, part in off.items():
        known = np.isfinite(part)
        if np.any(known):
            bands[kind] = np.array([band.amplitude[known], _BAND * part[known]])
    usual = dict.fromkeys(KINDS, DEFAULT)
    return Tolerance(0.0, 0.0, 0.0, "bands", sources=usual, bands=bands)


def _largest(differences: Sequence[Difference], source: str) -> Tolerance:
    """The largest difference that is sure, or what all cycles leave open."""
    sizes = dict.fromkeys(KINDS, 0.0)
    for kind, d in itertools.product(KINDS, differences):
        value, std = _value(d, kind)
        parts = [_value(p, kind) for p in d.parts]
        sure = [abs(v) + s for v, s in parts if abs(v) > SURE * s]
        sizes[kind] = max([sizes[kind], abs(value) + std, *sure])
    return Tolerance.read_off(sizes, source)


def _value(difference: Difference, kind: str) -> tuple[float, float]:
    return getattr(difference, kind), getattr(difference, f"{kind}_std")
