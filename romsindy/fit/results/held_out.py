"""The end of a forced record, which takes no part in a fit: what the fit says of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.results.estimate import Estimate
from romsindy.fit.results.predict import Forecast
from romsindy.record.forced import ForcedVibration
from romsindy.text import quantity
from romsindy.typing import Array

_STATE = 50  # samples, from which the state is read at which a prediction starts
_LEAST = 8  # samples that are predicted


@dataclass(frozen=True, eq=False)
class HeldOut:
    """The end of a record, and its prediction."""

    vibration: ForcedVibration
    forecast: Forecast  # with its 95 % band; nan where the model has no motion that long

    @classmethod
    def of(cls, fit: Estimate, vibration: ForcedVibration) -> HeldOut:
        """Predict it, from the state that its first samples show."""
        try:
            return cls(vibration, fit.forecast(vibration, _STATE))
        except TrajectoryError:
            nothing = np.full_like(vibration.y, np.nan)
            return cls(vibration, Forecast(nothing, nothing, nothing, ()))

    @property
    def missed(self) -> Array:
        """Measured minus predicted."""
        return self.vibration.y - self.forecast.value

    @property
    def held(self) -> float:
        """Part of the samples after these that lie in the band."""
        y, (_, low, high, _) = self.vibration.y, self.forecast
        return float(np.mean(((low <= y) & (y <= high))[_STATE:]))

    @property
    def error(self) -> float:
        """Rms of what is missed after the samples that gave the state."""
        return float(np.sqrt(np.mean(self.missed[_STATE:] ** 2)))

    @property
    def part(self) -> float:
        """The same over the standard deviation of the response there."""
        return self.error / float(np.sqrt(np.mean(np.var(self.vibration.y[_STATE:], axis=0))))

    def __str__(self) -> str:
        v = self.vibration
        what = f"The last {v.t[-1] - v.t[0]:.4g} s ({len(v.t)} samples) took no part in the fit: "
        if not np.isfinite(self.error):
            return f"{what}the model has no motion that long from their first {_STATE} samples."
        return (
            f"{what}predicted from their first {_STATE} samples with an error of"
            f" {quantity(self.error, v.signal_unit)} rms, {100 * self.part:.2g} % of the response;"
            f" {100 * self.held:.0f} % of them lie in the 95 % band."
        )


def without_end(
    vibration: ForcedVibration, share: float
) -> tuple[ForcedVibration, ForcedVibration]:
    """The record without its end, and this end: a share of all samples.

    Raises a ValueError if too few samples are left on either side.
    """
    n = len(vibration.t)
    first = n - round(share * n)
    if min(first, n - first) < _STATE + _LEAST:
        raise ValueError(
            f"{share:.6g} of {n} samples are {n - first}, and {first} are left: both need"
            f" {_STATE + _LEAST} or more; hold out another share, or give a longer record"
        )
    return vibration.between(end=vibration.t[first - 1]), vibration.between(vibration.t[first])
