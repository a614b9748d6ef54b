"""What an input does between its samples: a hypothesis that the record decides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from romsindy.fit.verdict import EQUIVALENT, FORM
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import INTERPOLATIONS, Interpolation
from romsindy.record.prediction import innovation
from romsindy.text import listed
from romsindy.typing import Array

_OWN = 3  # values of each record: its state, and the offset of the sensor
_SAID: dict[Interpolation, str] = {
    "band-limited": "band-limited",
    "linear": "linear",
    "hold": "held",
}


def ways(vibrations: Sequence[ForcedVibration]) -> tuple[Interpolation, ...]:
    """What the inputs of records may do: what is said of them, or anything.

    Raises a ValueError if two records say different things.
    """
    said_so = {v.interpolation for v in vibrations if v.interpolation is not None}
    if len(said_so) > 1:
        raise ValueError(
            f"interpolation = {sorted(said_so)} differs between records: fit those of one kind"
        )
    return tuple(said_so) or INTERPOLATIONS


def deviance(residuals: Sequence[Array]) -> float:
    """Minus twice the logarithm of the likelihood of residuals, as autoregressive noise."""
    found = 0.0
    for e in residuals:
        if not np.all(np.isfinite(e)):
            return np.inf
        driven, order = innovation(e)
        values = order + 1 + _OWN
        found += len(e) * float(np.log(np.mean(driven**2))) + values * np.log(len(e))
    return found


@dataclass(frozen=True)
class Rivals:
    """What inputs may do between their samples: that which explains most, and what does as well.

    ``weights`` has the likelihood of those that the records do not tell apart, of 1 in all;
    ``tried`` are all of them, the likeliest first.
    """

    best: Interpolation
    weights: dict[Interpolation, float]
    tried: tuple[Interpolation, ...]

    def only(self, way: Interpolation) -> Rivals:
        """Where something else has decided for one of them."""
        return replace(self, best=way, weights={way: 1.0})

    def __str__(self) -> str:
        if len(self.weights) > 1:
            names = listed([_SAID[way] for way in self.weights], "or")
            return (
                f"between its samples the input may be {names}: the record cannot tell these"
                " apart, and the errors count them all"
            )
        others = [way for way in INTERPOLATIONS if way in self.tried and way != self.best]
        told = listed([_SAID[way] for way in others], "or")
        return f"between its samples the input is {_SAID[self.best]}, not {told}"


def rated(residuals: Mapping[Interpolation, Sequence[Array]]) -> Rivals:
    """Hypotheses by what they leave of the records."""
    deviances = {way: deviance(left) for way, left in residuals.items()}
    least = min(deviances.values())
    n = sum(len(e) for left in residuals.values() for e in left) / len(residuals)
    apart = max(EQUIVALENT, FORM * n)
    # Where the form of the model counts, likelihoods say less than they seem to.
    rate = EQUIVALENT / apart / 2
    alike = {w: np.exp(rate * (least - d)) for w, d in deviances.items() if d - least < apart}
    total = sum(alike.values())
    weights = {way: float(weight / total) for way, weight in alike.items()}
    tried = tuple(sorted(deviances, key=lambda way: deviances[way]))
    return Rivals(tried[0], weights, tried)
