"""Records of what was measured, as fits need them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.arguments import require_unit, several_decays
from romsindy.fit.records.coupled import CoupledRecord, driven_record
from romsindy.fit.records.driven import ForcedRecord
from romsindy.fit.records.mode_shape import Offset
from romsindy.fit.records.modes import Modes
from romsindy.fit.records.record import NUMERICS, Record, sharing_drift
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration


def prepared(
    decays: Decay | Sequence[Decay], unit: str | None, *, coloured: bool = False
) -> tuple[Record, ...]:
    """Free decays in a unit, ready to be fitted, by noise that is white or has a colour.

    Raises
    ------
    ValueError
        For no decays, another unit, or a decay given twice.
    """
    several = several_decays(decays)
    require_unit(several, unit)
    records = sharing_drift([Record.of(d.single().free(), NUMERICS) for d in several])
    return tuple(record.without_faults(coloured=coloured) for record in records)


def ready(several: Sequence[Decay | ForcedVibration]) -> tuple[Prepared, ...]:
    """Free decays and forced vibrations of one channel, ready to be fitted together."""
    free = [Record.of(d.single().free(), NUMERICS) for d in several if isinstance(d, Decay)]
    decays = iter(sharing_drift(free))
    return tuple(
        ForcedRecord.of(measured, NUMERICS)
        if isinstance(measured, ForcedVibration)
        else next(decays).without_faults()
        for measured in several
    )


def ready_along(
    several: Sequence[Decay | ForcedVibration], modes: Modes
) -> tuple[CoupledRecord, ...]:
    """The same of several coordinates, whose linear modes are known from the driven ones."""
    hertz = modes.omega / (2 * np.pi)
    return tuple(
        driven_record(measured, modes, NUMERICS)
        if isinstance(measured, ForcedVibration)
        else replace(CoupledRecord.of(measured, hertz, NUMERICS, modes.main), shapes=modes.shapes)
        for measured in several
    )


def free_offsets(records: Sequence[Prepared], channel: int = 0) -> Part:
    """An offset of the sensor of a channel in each record, 0 at first."""
    return Part(Offset(channel), (), np.zeros((len(records), 1)))
