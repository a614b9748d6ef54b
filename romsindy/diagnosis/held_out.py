"""Parts of a record that judge a model, and take no part in its fit.

Every fourth stretch of a few cycles is held out: what learns and what judges both see large and
small amplitudes, early and late times. The motion of a model goes through all of the record in
either case, so that its phase tells as much as before; samples that were made white are
independent, so that those left out tell nothing about the others.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from romsindy.fit.record import Record

_EVERY = 4  # one stretch of so many
_LEAST, _MOST = 3, 8  # cycles of a stretch: two that are whole, and as in a window of adequacy
SHORTEST = 18  # cycles of a record that can spare two stretches


def parted(record: Record) -> tuple[Record, Record] | None:
    """What learns and what judges; None where the record is too short to spare anything."""
    first = record.cycles
    n = len(first) - 1
    if n < SHORTEST:
        return None
    length = int(np.clip(n // (2 * _EVERY), _LEAST, _MOST))
    judges = np.zeros(len(record.signal), bool)
    for start in range(length, n - length + 1, _EVERY * length):
        judges[first[start] : first[start + length]] = True
    return replace(record, part=~judges), replace(record, part=judges)
