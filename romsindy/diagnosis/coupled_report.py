"""A diagnosis of several coordinates, in words, tables and pictures."""

from __future__ import annotations

from dataclasses import dataclass

from romsindy.diagnosis.driven.report import ForcedReport
from romsindy.physics.coupled import CoupledModel
from romsindy.text import two_digits


@dataclass(frozen=True, kw_only=True, repr=False)
class CoupledReport(ForcedReport):
    """What a model of several coordinates lacks, against decays in which they ring.

    Effects have the coordinate in their names: "dry_friction [q2]". No test is simulated: what may
    tell explanations apart is said by the effects themselves.

    Attributes
    ----------
    verdict, best, rivals, compared, base, gap, tolerance, added, interrupted, notes
        As those of a `ForcedReport`.
    nominal, model : CoupledModel
    remainder : Adequacy
        Whether what is left repeats with the vibration of any coordinate.
    records : tuple of CoupledRecord
    """

    nominal: CoupledModel
    model: CoupledModel
    level: None = None  # type: ignore[assignment]

    @property
    def _more_than_noise(self) -> str:
        return (
            f"{two_digits(self.remainder.ratio)} times the noise, of which more repeats than chance"
        )
