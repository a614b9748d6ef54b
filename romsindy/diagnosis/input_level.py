"""The level of excitation that would tell explanations apart, by simulation of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import welch

from romsindy.diagnosis.colour import driven_instead
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.fit.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.equation import equation_of
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.forced.sampled import Sampled
from romsindy.fit.verdict import AS_GOOD
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

LEVELS = (0.5, 2.0, 4.0)  # of the inputs so far
_BAND = 0.25, 0.75  # of the power of the difference lies below each end


@dataclass(frozen=True)
class InputLevel:
    """A record repeated with stronger or weaker inputs, and by how much two rivals differ then.

    Attributes
    ----------
    level : float
        Of the inputs, as a multiple of those so far.
    record : int
    apart : float
        Rms of the difference over the noise of the record.
    band : (float, float)
        Hz, between which half of the power of the difference lies.
    samples : int
        Of the record.
    """

    level: float
    record: int
    apart: float
    band: tuple[float, float]
    samples: int

    @property
    def enough(self) -> bool:
        """Whether chi-square is beyond that at which two predictions are as good."""
        return self.samples * self.apart**2 > AS_GOOD


def most_apart(
    model: ReducedModel, rivals: Sequence[Hypothesis], records: Sequence[ForcedRecord]
) -> InputLevel | None:
    """The record and the level at which two rivals, as they were fitted, differ most.

    None where neither has a motion at other levels.
    """
    found = []
    for level in LEVELS:
        for i, record in enumerate(records):
            try:
                signals = [_shown(model, h, record, i, level) for h in rivals]
            except TrajectoryError:
                continue
            difference = signals[0] - signals[1]
            apart = float(np.std(difference)) / record.noise.std
            found.append(
                InputLevel(level, i, apart, _band(difference, record.decay.dt), len(difference))
            )
    return max(found, key=lambda f: f.apart, default=None)


def _shown(
    model: ReducedModel, hypothesis: Hypothesis, record: ForcedRecord, number: int, level: float
) -> Array:
    """What a hypothesis says of a record with inputs at another level, (n,)."""
    sampled = {k: Sampled(level * s.u, s.dt, s.grid) for k, s in record.sampled.items()}
    equation = equation_of(
        driven_instead(model, hypothesis.parts),
        hypothesis.parts,
        number,
        replace(record, sampled=sampled),
    )
    m = hypothesis.solution.motions[number]
    guess = Trajectory(m.grid, level * m.q, level * m.q_dot, level * m.q_ddot)
    motion = integrate(equation, level * m.start, m.grid, guess)
    x = motion.samples(equation, record.derivative)
    return record.read(hypothesis.parts, number, x).shown


def _band(x: Array, dt: float) -> tuple[float, float]:
    frequency, power = welch(x, 1 / dt, nperseg=max(len(x) // 8, 8))
    share = np.cumsum(power) / max(float(np.sum(power)), 1e-300)
    low, high = (float(frequency[np.searchsorted(share, end)]) for end in _BAND)
    return low, high
