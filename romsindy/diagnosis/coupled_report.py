"""A diagnosis of several coordinates, in words."""

from __future__ import annotations

from dataclasses import dataclass

from romsindy.diagnosis.driven.report import ForcedReport
from romsindy.text import percent, quantity


@dataclass(frozen=True, kw_only=True, repr=False)
class CoupledReport(ForcedReport):
    """What a simulation of several coordinates lacks, against decays in which they ring."""
