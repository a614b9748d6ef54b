"""Is there a gap at all, and is it closed? Tests with stated rates of false alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from romsindy.fit.gauss_newton import Solution, fit
from romsindy.fit.measured import Measured
from romsindy.fit.part import Part
from romsindy.physics.model import ReducedModel
from romsindy.record.backbone import extract_backbone
from romsindy.record.decay import Decay
from romsindy.record.smoothing import HarmonicSpline
from romsindy.typing import Array

# A residual above this many times the noise is not explained, whatever else is said.
ADEQUATE = 1.10


@dataclass(frozen=True)
class Remainder:
    """What a fit leaves, against the noise.

    Attributes
    ----------
    adequacy : float
        Rms of the whitened residual: 1 where it is noise.
    structure : float
        Chi-square of what repeats with the vibration, over its degrees of freedom: about 1.
    p_value : float
        Probability of as much structure in noise alone.
    below_floor : bool
        Whether the structure is smaller than the misfit that does not matter.
    """

    adequacy: float
    structure: float
    p_value: float
    below_floor: bool

    @property
    def closed(self) -> bool:
        """Whether the residual is down to the noise and without structure that matters."""
        structureless = self.p_value > 1e-5 or self.structure < 1.3 or self.below_floor
        return self.adequacy <= ADEQUATE and structureless


def remainder(records: Sequence[Measured], residuals: Sequence[Array], n_values: int) -> Remainder:
    """Weigh residuals (measured minus simulated) of some records."""
    total = freedom = structured = waves = matters = 0.0
    for record, residual in zip(records, residuals, strict=True):
        e = record.noise(residual)
        spline = HarmonicSpline.along(record.spline.phase, record.t, e, cycles=6.0, harmonics=4)
        total += float(e @ e)
        freedom += len(e)
        structured += float(e @ spline(record.t)[0])
        waves += spline.n_values
        matters += len(e) * (record.noise.floor / record.noise.std) ** 2
    adequacy = np.sqrt(total / max(freedom - n_values, 1))
    left = max(waves - n_values, 1.0)
    return Remainder(
        float(adequacy),
        float(structured / left),
        float(chi2.sf(structured, left)),
        bool(structured < matters),
    )


def held_out_solution(model: ReducedModel, parts: Sequence[Part], record: Measured) -> Solution:
    """Predict a record that took no part: only its initial state is fitted.

    Strengths that differ from record to record, such as the phase of an excitation, are too.
    """
    return fit(model, parts, [record], fixed=True, iterations=25)


@dataclass(frozen=True)
class Prediction:
    """A held-out record beside the simulation before and after, (n,) signals."""

    record: Measured
    before: Array
    after: Array

    def error(self, simulated: Array) -> float:
        """Rms of the misfit over the noise; 1 is perfect."""
        misfit = self.record.noise(self.record.signal - simulated)
        return float(np.sqrt(np.mean(misfit**2)))

    def backbone_errors(self, simulated: Array) -> tuple[float, float]:
        """Rms of the relative error of frequency, and of the error of the damping ratio.

        Cycle by cycle at equal amplitude, over the amplitudes that both have; nan where the
        simulation has no cycles to read.
        """
        t, unit = self.record.t, self.record.decay.unit
        try:
            true = extract_backbone(Decay(t, self.record.signal, unit=unit))
            said = extract_backbone(Decay(t, simulated, unit=unit))
        except ValueError:
            return float("nan"), float("nan")
        order = np.argsort(said.amplitude)
        a = said.amplitude[order]
        inside = (true.amplitude >= a[0]) & (true.amplitude <= a[-1])
        inside &= true.frequency_std < 0.01 * true.frequency
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
