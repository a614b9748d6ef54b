"""Requests with inputs that make no sense are refused, with a hint, before anything is fitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from romsindy.beam import Beam
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.verdict import ABOVE_NOISE
from romsindy.physics.driven import inputs_of
from romsindy.physics.model import ReducedModel
from romsindy.record.forced import ForcedVibration

# Steps of a record, where more than the least in a cycle are not needed: many fits are compared.
_AFFORDABLE = 3000


def forced_alone(measured: object) -> list[ForcedVibration]:
    """Forced vibrations, one or several, as a list; empty where there are none.

    Raises
    ------
    ValueError
        For decays among them.
    """
    several = list(measured) if isinstance(measured, (list, tuple)) else [measured]
    driven = [v for v in several if isinstance(v, ForcedVibration)]
    if driven and len(driven) < len(several):
        raise ValueError(
            "measured holds forced vibrations and others: diagnose decays, and forced vibrations,"
            " one kind at a time"
        )
    return driven


def refuse_with_inputs(**given: object) -> None:
    """Refuse arguments that belong to decays, or to a beam.

    Raises
    ------
    ValueError
        By the name of the argument.
    """
    strange = [name for name, value in given.items() if value is not None]
    if strange:
        raise ValueError(
            f"{strange[0]} = ... does not go with forced vibrations: leave it out, or diagnose"
            " decays"
        )


def driven_of(name: str, given: object) -> list[ForcedVibration]:
    """Driven records of an argument beside driven ``measured``, one or several, as a list.

    Raises
    ------
    ValueError
        For decays, and for anything else.
    """
    several = list(given) if isinstance(given, (list, tuple)) else [given]
    found = [v for v in several if isinstance(v, ForcedVibration)]
    if len(found) < len(several):
        strange = next(v for v in several if not isinstance(v, ForcedVibration))
        raise ValueError(
            f"{name} = a {type(strange).__name__} does not go with forced vibrations: give a"
            " ForcedVibration, with its inputs"
        )
    return found


def reduced(model: ReducedModel | Beam) -> ReducedModel:
    """The model, if it is one that driven records can be compared with.

    Raises
    ------
    ValueError
        For a Beam.
    """
    if isinstance(model, ReducedModel):
        model.refuse_memory("what is compared here")
        return model
    raise ValueError(
        f"model is a {type(model).__name__}, and forced vibrations are compared with a"
        " ReducedModel: reduce it first, beam.reduce(...)"
    )


def checked_driven(
    measured: Sequence[ForcedVibration], floor: float, word: str = "record"
) -> list[ForcedRecord]:
    """Prepare records, and refuse noise: "record 0" in messages."""
    records = [ForcedRecord.of(v, floor, _AFFORDABLE) for v in measured]
    for i, record in enumerate(records):
        if np.std(record.signal) < ABOVE_NOISE * record.noise.std:
            raise ValueError(
                f"{word} {i} is noise: its rms of {np.std(record.signal):.3g} is below twice the"
                f" noise ({record.noise.std:.3g}); check the channel, or excite more"
            )
    return records


def check_inputs(
    model: ReducedModel, measured: Sequence[ForcedVibration], word: str = "record"
) -> None:
    """Raise a ValueError for a record without an input of the model."""
    for term in inputs_of(model):
        for i, v in enumerate(measured):
            if term.source not in v.names:
                raise ValueError(
                    f"the model is driven by {term.source!r}, and {word} {i} has {list(v.names)}:"
                    " give all inputs under the names of the model"
                )
