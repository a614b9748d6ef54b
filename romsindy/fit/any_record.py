"""What a fit compares with a simulation: a decay of one or several coordinates, or a forced one."""

from __future__ import annotations

from collections.abc import Sequence

from romsindy.fit.coupled_record import CoupledRecord
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.record import Record

AnyRecord = Record | CoupledRecord | ForcedRecord


def one_a_decay(records: Sequence[AnyRecord]) -> list[CoupledRecord]:
    """Those of several coordinates; of records in pieces the first, which has all their tones."""
    return [r for r in records if isinstance(r, CoupledRecord) and r.since == 0]


def in_pieces(records: Sequence[AnyRecord]) -> bool:
    """Whether decays were cut, and each piece has an initial state of its own."""
    return any(isinstance(r, CoupledRecord) and r.since > 0 for r in records)
