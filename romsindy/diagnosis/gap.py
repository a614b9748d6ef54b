"""The gap between simulation and measurement, before and after, on what took no part in a fit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from romsindy.diagnosis.difference import Difference
from romsindy.diagnosis.tolerance import Tolerance
from romsindy.fit.record import Record
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.typing import Array


@dataclass(frozen=True)
class Prediction:
    """A held-out record beside the simulation before and after, (n,) signals."""

    record: Record
    before: Array
    after: Array

    def error(self, simulated: Array) -> float:
        """Rms of the misfit over the noise; 1 is perfect."""
        misfit = self.record.whitened(self.record.signal - simulated)
        return float(np.sqrt(np.sum(misfit**2) / self.record.count))

    def backbone(self, signal: Array) -> Backbone | None:
        """Backbone of a signal (n,); None where it dies out at once, so that it has no cycles."""
        try:
            return extract_backbone(Decay(self.record.t, signal, unit=self.record.decay.unit))
        except ValueError:
            return None

    def backbone_errors(self, simulated: Array) -> tuple[float, float]:
        """Rms of the relative error of frequency, and of the error of the damping ratio.

        Cycle by cycle at equal amplitude, over the amplitudes that both have; nan where the
        simulation has no cycles to read.
        """
        true, said = (self.backbone(x) for x in (self.record.signal, simulated))
        if true is None or said is None:
            return float("nan"), float("nan")
        order = np.argsort(said.amplitude)
        a = said.amplitude[order]
        inside = (true.amplitude >= a[0]) & (true.amplitude <= a[-1])
        inside &= true.certain
        if not np.any(inside):
            return float("nan"), float("nan")
        at = true.amplitude[inside]
        frequency = np.interp(at, a, said.frequency[order]) / true.frequency[inside] - 1
        damping = np.interp(at, a, said.damping_ratio[order]) - true.damping_ratio[inside]
        return float(np.sqrt(np.mean(frequency**2))), float(np.sqrt(np.mean(damping**2)))


@dataclass(frozen=True, repr=False)
class Gap:
    """Before and after, on what took no part in the fit."""

    predictions: tuple[Prediction, ...]
    unseen: bool  # False where records were too short to hold any part out

    @property
    def before(self) -> float:
        """Displacement error over noise of the simulation as it was."""
        return max(p.error(p.before) for p in self.predictions)

    @property
    def after(self) -> float:
        """Displacement error over noise with the effects added."""
        return max(p.error(p.after) for p in self.predictions)

    @property
    def closed(self) -> float:
        """Part of the squared error beyond the noise that is closed, 0 to 1."""
        n = sum(len(p.record.signal) for p in self.predictions)

        def beyond(signals: list[Array]) -> float:
            pairs = zip(self.predictions, signals, strict=True)
            return sum(len(x) * p.error(x) ** 2 for p, x in pairs) / n - 1

        before = beyond([p.before for p in self.predictions])
        after = beyond([p.after for p in self.predictions])
        return float(np.clip(1 - max(after, 0.0) / before, 0.0, 1.0)) if before > 0 else 0.0

    @cached_property
    def differences_before(self) -> tuple[Difference, ...]:
        """Of the simulation as it was, one a record."""
        return tuple(Difference.of(p.record, p.before) for p in self.predictions)

    @cached_property
    def differences_after(self) -> tuple[Difference, ...]:
        """With the effects added, one a record."""
        return tuple(Difference.of(p.record, p.after) for p in self.predictions)

    def matters(self, tolerance: Tolerance) -> bool:
        """Whether the simulation as it was is surely beyond a tolerance."""
        return any(d.exceeds(tolerance) for d in self.differences_before)

    def improves(self, tolerance: Tolerance) -> bool:
        """Whether some difference falls by more than a tolerance, and none surely grows by it."""
        pairs = list(zip(self.differences_before, self.differences_after, strict=True))
        falls = any(before.falls(after, tolerance) for before, after in pairs)
        return falls and not any(before.grows(after, tolerance) for before, after in pairs)

    def __repr__(self) -> str:
        where = "held out" if self.unseen else "fitted"
        return f"<Gap: error over noise {self.before:.3g} to {self.after:.3g}, {where}>"

    def table(self) -> list[list[str]]:
        """Rows of text: what, before, after."""
        rows = [["held out" if self.unseen else "fitted", "before", "after"]]
        for i, p in enumerate(self.predictions, 1):
            name = f"record {i}: " if len(self.predictions) > 1 else ""
            errors = [p.error(x) for x in (p.before, p.after)]
            rows.append([f"{name}error over noise", *(f"{e:.3g}" for e in errors)])
            lines = [p.backbone_errors(x) for x in (p.before, p.after)]
            rows.append([f"{name}frequency error, %", *(f"{100 * e[0]:.3g}" for e in lines)])
            rows.append([f"{name}damping ratio error, %", *(f"{100 * e[1]:.3g}" for e in lines)])
        return rows
