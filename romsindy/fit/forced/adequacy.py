"""Does a model explain a forced vibration? What it leaves is noise where its past tells nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from romsindy.fit.adequacy import Adequacy
from romsindy.fit.record import Prepared
from romsindy.fit.verdict import FALSE_ALARM
from romsindy.record.autoregression import innovation
from romsindy.text import quantity
from romsindy.typing import Array


@dataclass(frozen=True, eq=False)
class ForcedAdequacy(Adequacy):
    """Whether a model explains forced vibrations; of `Adequacy`, what goes by windows is empty.

    Attributes
    ----------
    ratio : float
        Rms of the residual over the noise where the spectrum of the response is quietest.
    structure : float
        Power of the residual over that part of it that its own past does not predict: 1 of white
        noise.
    p_value : float
        Probability that white noise is predicted as well (F test).
    left : float
        Rms of the residual, in the unit of the measured quantity.
    part : float
        The same as a part of the rms of the response.
    measured_unit : str
    undetermined : str
        Stiffness and gains that are not told from 0, with their errors; empty where all are.
    piece : float
        Cycles in each piece, with a state of its own, where the record was followed in pieces: of
        these are the values above. 0 where it was followed from end to end.
    whole : float
        What one simulation of the whole record leaves then, as `part`; nan where it has no motion.
    """

    left: float = 0.0
    part: float = 0.0
    measured_unit: str = ""
    undetermined: str = ""
    piece: float = 0.0
    whole: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("left", "part", "piece", "whole"):  # a file may say "NaN"
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def explained(self) -> bool:
        """Whether the residual is white, or as good, and the model determined."""
        return bool(np.isfinite(self.ratio)) and not self.structured and not self.undetermined

    def __str__(self) -> str:
        if not np.isfinite(self.ratio):
            return "The model does not explain the record: it has no motion that follows it."
        size = f"{quantity(self.left, self.measured_unit)} rms, {100 * self.part:.2g} %"
        if self.undetermined:
            rest = self._of_the_whole() if self.piece else f"It leaves {size} of the response"
            return f"The record does not determine the model: {self.undetermined}. {rest}."
        if self.piece:
            done = "explains" if self.explained else "follows"
            return (
                f"The model {done} pieces of {self.piece:.0f} cycles, each from a state of its own,"
                f" but for {size} of the response. {self._of_the_whole()}."
            )
        if self.explained:
            return f"The model explains the record: it leaves {size} of the response, as noise."
        share = 100 * (1 - 1 / self.structure)
        return (
            f"The model does not explain the record to its noise: it leaves {size} of the response"
            f" ({self.ratio:.3g} times the noise where that is quietest); {share:.0f} % of the"
            " power of it is no noise, for its past predicts it."
        )

    def _of_the_whole(self) -> str:
        what = "One simulation of the whole record"
        if not np.isfinite(self.whole):
            return f"{what} goes astray: the model has no motion that long"
        if self.whole > 1:
            return f"{what} misses it by more than the response itself"
        return f"{what} leaves {100 * self.whole:.2g} % of the response"


def examine_forced(
    records: Sequence[Prepared],
    residuals: Sequence[Array],
    n_values: int,
    false_alarm: float = FALSE_ALARM,
) -> ForcedAdequacy:
    """Whether residuals (c n,) are white, in every channel."""
    unit = records[0].decay.unit
    n = sum(map(len, residuals))
    power = sum(float(e @ e) for e in residuals)
    noise = sum(float(np.sum(r.whitened(e) ** 2)) for r, e in zip(records, residuals, strict=True))
    heard = sum(r.power for r in records)
    driven, order = 0.0, 0
    if np.isfinite(power):
        pairs = zip(records, residuals, strict=True)
        for e in (channel for r, x in pairs for channel in r.by_channel(x)):
            own, more = innovation(e)
            driven += float(np.mean(own**2)) * len(e)
            order += more
    structure = power / driven if driven > 0 else np.inf
    freedom = max(n - order, 1)
    p = float(fdtrc(order, freedom, (structure - 1) * freedom / order)) if order else 1.0
    return ForcedAdequacy(
        ratio=float(np.sqrt(noise / max(n - n_values, 1))),
        p_value=p,
        structure=max(structure, 1.0),
        below_floor=False,
        amplitude=np.zeros(0),
        misfit=np.zeros(0),
        limit=max(r.amplitude for r in records),
        unit=unit,
        false_alarm=false_alarm,
        left=float(np.sqrt(power / n)),
        part=float(np.sqrt(power / heard)),
        measured_unit=records[0].decay.signal_unit,
    )
