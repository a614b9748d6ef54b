"""Does a model explain a driven record, and is what it leaves small?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import stdtrit
from scipy.stats import linregress

from romsindy.fit.adequacy.decays import Adequacy
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.verdict import BARELY, COLOURED, FALSE_ALARM, SAME_SIGNAL, SMALLER, WIDEST_SIGNAL
from romsindy.text import percent, quantity
from romsindy.typing import Array

_NUMBERS = ("left", "piece", "whole", "missing", "sensor", "force", "colour")
# Cycles in a stretch of the record; levels of the response that are told apart, at most and at
# least, with two stretches each; how much louder the loudest must be than the quietest.
_CYCLES, _MOST, _LEAST, _LOUDER = 8, 8, 4, 2.0
# Exponents of what is left against the response: up to the first it is the same at all levels, and
# from the second on it changes.
_SAME, _CHANGES = 0.25, 0.1


@dataclass(frozen=True, eq=False)
class ForcedAdequacy(Adequacy):
    """Whether a model explains forced vibrations; of `Adequacy`, what goes by windows is empty.

    Attributes
    ----------
    ratio, structure : float
        Rms and power of what is left over those without what goes with motion or input: 1 where
        it is noise.
    p_value : float
        Probability that noise goes with motion or input as much (F test); nan where it was not
        tried, see `romsindy.fit.adequacy.independence`.
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
    missing : float
        What goes with motion or input, as a part of the rms of the response.
    like : str
        The force that alone tells most of that.
    sensor, force : float
        Noise of the sensor, and what forces that are noise move, as parts of the response.
    colour : float
        Correlation of the noise of the sensor from sample to sample.
    levels : (k, 2) array
        Rms of the response in stretches of eight cycles, from quiet to loud and those alike
        together, and of what is left of them, measured unit; empty where there are few.
    """

    left: float = 0.0
    measured_unit: str = ""
    undetermined: str = ""
    piece: float = 0.0
    whole: float = 0.0
    missing: float = 0.0
    like: str = ""
    sensor: float = 0.0
    force: float = 0.0
    colour: float = 0.0
    levels: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in _NUMBERS:  # a file may say "NaN"
            object.__setattr__(self, name, float(getattr(self, name)))
        object.__setattr__(self, "levels", np.array(self.levels, float).reshape(-1, 2))

    @property
    def structured(self) -> bool:
        """Whether more than noise goes with motion or input, and it matters."""
        return self.p_value < self.false_alarm and self.missing > BARELY

    @property
    def explained(self) -> bool:
        """Whether what is left goes with neither motion nor input, and the model is determined.

        Forces that were not measured must not move so much that it would be another motion.
        """
        noise = bool(np.isfinite(self.ratio)) and not self.structured
        return noise and self.force <= WIDEST_SIGNAL and not self.undetermined

    @property
    def beyond_noise(self) -> float:
        """What one simulation of the whole record leaves beyond noise and unmeasured forces."""
        return float(np.sqrt(max(self._all**2 - self.sensor**2 - self.force**2, 0.0)))

    @property
    def everywhere(self) -> float:
        """Noise of the sensor, and of forces that were not measured."""
        response = self.left / self.part if self.part else 0.0
        return response * float(np.hypot(self.sensor, self.force))

    @property
    def good(self) -> bool:
        """Whether one simulation leaves as little as tests of good repeatability differ by."""
        return self._all <= SAME_SIGNAL and not self.undetermined

    @property
    def _all(self) -> float:
        return self.whole if self.piece else self.part

    @property
    def growth(self) -> tuple[float, float]:
        """Exponent of what is left against the response, and its standard error; nan for one level.

        0 where it is the same at all levels, as noise of a sensor is; 1 where it is a part of the
        response.
        """
        if len(self.levels) < _LEAST or self.levels[-1, 0] < _LOUDER * self.levels[0, 0]:
            return np.nan, np.nan
        line = linregress(*np.log(self.levels.T))
        return float(line.slope), float(line.stderr)

    def __str__(self) -> str:
        return f"{self._whole()}{self._over_levels()}"

    def _over_levels(self) -> str:
        """Whether what is left grows with the response, in a sentence."""
        slope, error = self.growth
        if np.isnan(slope):
            return ""
        sure = stdtrit(len(self.levels) - 2, 0.975) * error
        (quiet, least), (loud, most) = self.levels[[0, -1]]
        unit = self.measured_unit
        ends = f"{quantity(quiet, unit)} and {quantity(loud, unit)} rms"
        if abs(slope) + sure < _SAME:
            same = "What is left is as large where the response is quiet as where it is loud"
            return f" {same} ({ends})."
        if abs(slope) - sure < _CHANGES:
            return ""
        how = "grows" if slope > 0 else "falls"
        return (
            f" What is left {how} with the response: {quantity(least, unit)} where that is"
            f" {quantity(quiet, unit)} rms, {quantity(most, unit)} where it is"
            f" {quantity(loud, unit)}."
        )

    def _whole(self) -> str:
        if not np.isfinite(self.ratio):
            return "The model does not explain the record: it has no motion that follows it."
        size = f"{quantity(self.left, self.measured_unit)} rms, {percent(self.part)}"
        if self.undetermined:
            rest = self._of_the_whole() if self.piece else f"It leaves {size} of the response"
            return f"The record does not determine the model: {self.undetermined}. {rest}."
        if self.piece:
            done = "explains" if self.explained else "follows"
            return (
                f"The model {done} pieces of {self.piece:.0f} cycles, each from a state of its own,"
                f" but for {size} of the response{self._kind()}. {self._of_the_whole()}."
            )
        found = "explains the record" if self.explained else "does not explain the record"
        if self.good and not self.explained:
            found = "is good for practice, and something small is missing"
        return f"The model {found}: it leaves {size} of the response{self._kind()}."

    def _kind(self) -> str:
        """What is left, in words."""
        if np.isnan(self.p_value):
            return ""
        return f", and {self.gone}" if self.structured else f", as noise: {self.noise}"

    @property
    def gone(self) -> str:
        """What is no noise, in words."""
        return (
            f"{percent(self.missing)} of the response goes with the motion or the input, most like"
            f" {self.like} (p = {self.p_value:.1g})"
        )

    @property
    def noise(self) -> str:
        """Where it comes from."""
        coloured = ", coloured" if self.colour > COLOURED else ""
        sensor = f"{percent(self.sensor)} of the sensor{coloured}"
        if self.force < SMALLER * self.sensor:
            return sensor
        most = ", too much to tell them from what is missing" if self.force > WIDEST_SIGNAL else ""
        return f"{sensor}, {percent(self.force)} by forces that were not measured{most}"

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
    """How much residuals (n,) are; what they are is not tried, see `independence`."""
    n = sum(map(len, residuals))
    power = sum(float(e @ e) for e in residuals)
    noise = sum(float(np.sum(r.whitened(e) ** 2)) for r, e in zip(records, residuals, strict=True))
    heard = sum(r.power for r in records)
    return ForcedAdequacy(
        ratio=float(np.sqrt(noise / max(n - n_values, 1))),
        p_value=np.nan,
        structure=1.0,
        below_floor=False,
        amplitude=np.zeros(0),
        misfit=np.zeros(0),
        limit=max(r.amplitude for r in records),
        unit=records[0].decay.unit,
        false_alarm=false_alarm,
        left=float(np.sqrt(power / n)),
        part=float(np.sqrt(power / heard)),
        measured_unit=records[0].decay.signal_unit,
        levels=_levels(records, residuals),
    )


def _levels(records: Sequence[Prepared], residuals: Sequence[Array]) -> Array:
    """Rms of the response and of what is left, (k, 2), from quiet to loud."""
    windows = []
    for record, left in zip(records, residuals, strict=True):
        size = round(_CYCLES / (float(record.frequencies.min()) * record.decay.dt))
        both = np.stack([record.signal - record.signal.mean(), left]).reshape(2, -1, len(record.t))
        whole = len(record.t) // size
        parts = both[..., : whole * size].reshape(2, both.shape[1], whole, size)
        windows.append(np.mean(parts**2, axis=(1, 3)).T)
    power = np.concatenate(windows)
    count = min(_MOST, len(power) // 2)
    if count < _LEAST:
        return np.zeros((0, 2))
    ordered = power[np.argsort(power[:, 0])]
    return np.sqrt([part.mean(axis=0) for part in np.array_split(ordered, count)])
