"""Records of what was measured, as fits need them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.arguments import require_unit, several_decays
from romsindy.fit.records.coupled import CoupledRecord, record_along
from romsindy.fit.records.driven import ForcedRecord
from romsindy.fit.records.modes import Modes
from romsindy.fit.records.record import NUMERICS, Record, sharing_drift
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration


def prepared(
    decays: Decay | Sequence[Decay], unit: str | None, *, coloured: bool = False
) -> tuple[Record, ...]:
    """Free decays in a unit, ready to be fitted, by noise that is white or has a colour.

    Raises a ValueError for no decays, another unit, or a decay given twice.
    """
    several = several_decays(decays)
    require_unit(several, unit)
    records = sharing_drift([Record.of(d.single().free(), NUMERICS) for d in several])
    return tuple(record.without_faults(coloured=coloured) for record in records)


def ready(several: Sequence[Decay | ForcedVibration]) -> tuple[Prepared, ...]:
    """Free decays and forced vibrations of one channel, ready to be fitted together."""
    free = [cast(Decay, d).single().free() for d in several if not d.driven]
    decays = iter(sharing_drift([Record.of(d, NUMERICS) for d in free]))
    return tuple(
        ForcedRecord.of(cast(ForcedVibration, measured), NUMERICS)
        if measured.driven
        else next(decays).without_faults()
        for measured in several
    )


def ready_along(
    several: Sequence[Decay | ForcedVibration], modes: Modes
) -> tuple[CoupledRecord, ...]:
    """The same of several coordinates, whose linear modes are known from the driven ones."""
    return tuple(record_along(measured, modes) for measured in several)
