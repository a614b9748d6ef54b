"""The gap between simulation and forced vibrations, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.fit.any_record import AnyRecord
from romsindy.record.recording import unit_of
from romsindy.typing import Array

HELD_OUT = "the record that took no part"


def noise_std(record: AnyRecord) -> float:
    """Rms of the noise of a record, over all its channels, unit of the measured quantity."""
    channels = record.noise if isinstance(record.noise, tuple) else (record.noise,)
    return float(np.sqrt(np.mean([noise.std**2 for noise in channels])))


@dataclass(frozen=True)
class ForcedGap:
    """What a simulation leaves of the records, without and with what was found.

    Attributes
    ----------
    records : tuple of AnyRecord
        On which it was measured.
    residuals_before, residuals_after : tuple of (n,) arrays
        Measured minus simulated, of each record.
    rms_before, rms_after : float
        Of all records, unit of the measured quantity.
    before, after : float
        The same as a part of the rms of the response.
    closed : float
        Part of the squared gap beyond the noise that is closed, 0 to 1.
    unit : str
        Of the rms.
    where : str
        What it was measured on, in words.
    """

    records: tuple[AnyRecord, ...]
    residuals_before: tuple[Array, ...]
    residuals_after: tuple[Array, ...]
    rms_before: float
    rms_after: float
    before: float
    after: float
    closed: float
    unit: str
    where: str = "the records themselves"

    @classmethod
    def of(
        cls,
        records: Sequence[AnyRecord],
        before: Sequence[Array],
        after: Sequence[Array],
        where: str = "the records themselves",
    ) -> ForcedGap:
        """Compare residuals of records, which are called ``where``."""
        n = sum(len(r.signal) for r in records)
        heard = sum(float(np.sum((r.signal - r.signal.mean()) ** 2)) for r in records) / n
        noise = sum(len(r.signal) * noise_std(r) ** 2 for r in records) / n
        old, new = (sum(float(e @ e) for e in several) / n for several in (before, after))
        # The noise is no larger than what is left.
        beyond = old - min(new, noise)
        closed = float(np.clip((old - new) / beyond, 0.0, 1.0)) if 0 < beyond < np.inf else 0.0
        if not np.isfinite(old):
            closed = 1.0 if np.isfinite(new) else 0.0
        rms, shares = np.sqrt([old, new]), np.sqrt(np.array([old, new]) / heard)
        decay = records[0].decay
        return cls(
            tuple(records),
            tuple(before),
            tuple(after),
            rms_before=float(rms[0]),
            rms_after=float(rms[1]),
            before=float(shares[0]),
            after=float(shares[1]),
            closed=closed,
            unit=unit_of(decay.measured, decay.unit),
            where=where,
        )

    def table(self) -> list[list[str]]:
        """Rows of text: what, before, after."""
        pairs = {
            f"rms left, {self.unit}": (self.rms_before, self.rms_after),
            "rms left, % of the response": (100 * self.before, 100 * self.after),
        }
        rows = [[name, *(f"{x:.3g}" for x in pair)] for name, pair in pairs.items()]
        first = f"on {HELD_OUT}" if self.where == HELD_OUT else "fitted"
        return [[first, "before", "after"], *rows]
