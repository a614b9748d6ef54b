"""The inputs of a model in a fit: where their gains start, and which delays are free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from romsindy.effects.drive import Drive, DriveAlong
from romsindy.fit.kernel.linear_response import nodes
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.prepared import Prepared
from romsindy.physics.equations import Equations
from romsindy.physics.input import Input, input_in
from romsindy.physics.term import Term
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import Interpolation
from romsindy.typing import Array

# Samples by which an input may act later, or sooner, than it was measured.
_LATE = 20
# Participation factors beyond are none: of the mode of a structure it is 1 to 2, and 0 to either
# side of that where the sensor is near a node.
_PARTICIPATION = 20.0


def inputs_in(
    vibrations: Sequence[ForcedVibration], interpolation: Interpolation
) -> tuple[Input, ...]:
    """Inputs of records, those of a name once.

    Raises a ValueError if one has two units.
    """
    found: dict[str, Input] = {}
    for v in vibrations:
        for name, unit in zip(v.names, v.units, strict=True):
            new = Input(name, interpolation, 0.0, unit)
            old = found.setdefault(name, new)
            if old.input_unit != new.input_unit:
                raise ValueError(
                    f"the input {name!r} is in {old.input_unit} and in {new.input_unit}: give both"
                    " records in one unit"
                )
    return tuple(found.values())


def drives_of(model: Equations, records: Sequence[Prepared]) -> tuple[Part, ...]:
    """Parts of the inputs of a model with free gains and delays, from its own on.

    Of several coordinates an input has one delay, and a gain along each of its directions.
    """
    most = latest(records)
    found: dict[Input, dict[tuple[float, ...], float]] = {}
    for term, gain in zip(model.terms, model.values, strict=True):
        if (law := input_in(term)) is not None:
            weights = (*getattr(term, "weights", ()), *(0.0,) * model.n_coordinates)
            found.setdefault(law, {})[weights[: model.n_coordinates]] = gain
    parts = []
    for law, gains in found.items():
        given = replace(law, delay=0.0), law.delay, most
        drive = DriveAlong(*given, directions=(*gains,)) if model.numbered else Drive(*given)
        parts.append(Part(drive, drive.parameters(), np.array([[*gains.values()]])))
    return tuple(parts)


def freed(drive: Drive, gain: float) -> Part:
    """An input with its parameters free, and its gain, from this one on."""
    return Part(drive, drive.parameters(), np.array([[gain]]))


def latest(records: Sequence[Prepared]) -> float:
    """By how much an input may act later, or sooner, than it was measured, s."""
    return _LATE * max(r.decay.dt for r in records)


def regressed(
    terms: Sequence[Term],
    inputs: Sequence[Input],
    records: Sequence[Prepared],
    fixed: Mapping[str, float] | None = None,
) -> tuple[Array, Array]:
    """Coefficients of terms, and gains, by least squares on the smooth motions of the records.

    Coefficients that are ``fixed`` keep their value.
    """
    known = np.array([(fixed or {}).get(term.key, np.nan) for term in terms])
    free = np.concatenate([np.isnan(known), np.ones(len(inputs), bool)])
    rows, right = [], []
    for record in records:
        t, *motion = nodes(record.motion)
        q, q_dot, q_ddot = (x[:, 0] for x in motion)
        columns = [term.strong(q, q_dot, q_ddot) for term in terms]
        columns += [
            -term.sign * record.inputs[term.source].at(t, term)
            if term.source in record.inputs
            else np.zeros_like(q)
            for term in inputs
        ]
        rows.append(np.column_stack(columns))
        right.append(-q_ddot)
    table = np.concatenate(rows)
    found = np.concatenate([known, np.zeros(len(inputs))])
    left = np.concatenate(right) - table[:, ~free] @ found[~free]
    scale = np.maximum(np.std(table[:, free], axis=0), 1e-300)
    found[free] = np.linalg.lstsq(table[:, free] / scale, left, rcond=None)[0] / scale
    return found[: len(terms)], found[len(terms) :]


def refuse_displacement(inputs: Sequence[Input], gains: Sequence[float]) -> None:
    """Refuse a base motion that is no acceleration: its sign, and its size, are wrong."""
    for term, factor in zip(inputs, gains, strict=True):
        if term.sign < 0 and term.power == 1 and factor < -_PARTICIPATION:
            raise ValueError(
                f"the input {term.source!r} acts with a participation factor of {factor:.3g}: it"
                " looks like the displacement of the base, or has another unit; give its"
                " acceleration, in the unit of q per s^2"
            )
