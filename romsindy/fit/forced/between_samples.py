"""What an input does between its samples: a hypothesis that the record decides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import lfilter

from romsindy.fit.verdict import EQUIVALENT
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import INTERPOLATIONS, Interpolation
from romsindy.record.noise import autoregression
from romsindy.text import listed
from romsindy.typing import Array

_SAID: dict[Interpolation, str] = {
    "band-limited": "band-limited",
    "linear": "linear",
    "hold": "held",
}


def ways(vibrations: Sequence[ForcedVibration]) -> tuple[Interpolation, ...]:
    """What the inputs of records may do: what is said of them, or anything.

    Raises
    ------
    ValueError
        If two records say different things.
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
        a = autoregression(e - e.mean())
        driven = lfilter(a, [1.0], e - e.mean())[len(a) :]
        found += len(e) * float(np.log(np.mean(driven**2))) + len(a) * np.log(len(e))
    return found


def plainest(
    residuals: Mapping[Interpolation, Sequence[Array]],
) -> tuple[Interpolation, str]:
    """The hypothesis that leaves least of the records, and what is to be said of the others.

    Where several leave as little, the first of them in the order given.
    """
    deviances = {way: deviance(left) for way, left in residuals.items()}
    least = min(deviances.values())
    alike = [way for way, value in deviances.items() if value - least < EQUIVALENT]
    if len(alike) == 1:
        others = listed([_SAID[way] for way in residuals if way != alike[0]])
        return alike[0], f"between its samples the input is {_SAID[alike[0]]}; not {others}"
    text = listed([_SAID[way] for way in alike], "or")
    return alike[0], (
        f"between its samples the input may be {text}: the record cannot tell these apart"
    )
