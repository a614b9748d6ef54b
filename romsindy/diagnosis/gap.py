"""Is there a gap at all, and is it closed? Tests with stated rates of false alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from romsindy.diagnosis.fitting import Part, Solution, fit
from romsindy.diagnosis.records import Measured
from romsindy.diagnosis.smoothing import HarmonicSpline
from romsindy.model import ReducedModel
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
    """

    adequacy: float
    structure: float
    p_value: float

    @property
    def closed(self) -> bool:
        """Whether the residual is down to the noise and without structure that matters."""
        return self.adequacy <= ADEQUATE and (self.p_value > 1e-5 or self.structure < 1.3)


def remainder(records: Sequence[Measured], residuals: Sequence[Array], n_values: int) -> Remainder:
    """Weigh residuals (measured minus simulated) of some records."""
    total = freedom = structured = waves = 0.0
    for record, residual in zip(records, residuals, strict=True):
        e = record.noise(residual)
        spline = HarmonicSpline.along(record.spline.phase, record.t, e, cycles=6.0, harmonics=4)
        total += float(e @ e)
        freedom += len(e)
        structured += float(e @ spline(record.t)[0])
        waves += spline.n_values
    adequacy = np.sqrt(total / max(freedom - n_values, 1))
    left = max(waves - n_values, 1.0)
    return Remainder(float(adequacy), structured / left, float(chi2.sf(structured, left)))


def held_out(model: ReducedModel, parts: Sequence[Part], record: Measured) -> Solution:
    """Predict a record that took no part: only its initial state is fitted.

    Strengths that differ from record to record, such as the phase of an excitation, are too.
    """
    own = [_of_one_record(p) for p in parts]
    return fit(model, own, [record], fixed=True, iterations=25)


def _of_one_record(part: Part) -> Part:
    return replace(part, strengths=part.strengths[:1])
