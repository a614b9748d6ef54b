"""What is known of every point of a curve: interactive figures show it under the pointer."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from matplotlib.artist import Artist
from numpy.typing import NDArray

from romsindy.record.backbone import Backbone
from romsindy.show.axes import with_unit
from romsindy.typing import Array


class Fact(NamedTuple):
    """A quantity at every point of a curve.

    Attributes
    ----------
    label : str
        With the unit in brackets.
    values : (n,) array
    std : (n,) array, optional
        Standard errors.
    digits : int
        That are shown of a value.
    """

    label: str
    values: Array
    std: Array | None = None
    digits: int = 6

    def at(self, points: NDArray[np.bool_]) -> Fact:
        """The same of some points."""
        std = None if self.std is None else self.std[points]
        return self._replace(values=self.values[points], std=std)


# A drawn curve has no room for them; they go when it goes.
_TOLD: WeakKeyDictionary[Artist, tuple[Fact, ...]] = WeakKeyDictionary()


def tell(curve: Artist, *facts: Fact) -> None:
    """Say what is known of the points of a curve beside its coordinates."""
    _TOLD[curve] = facts


def told(curve: Artist) -> tuple[Fact, ...]:
    """What was said of a curve, or nothing."""
    return _TOLD.get(curve, ())


def of_cycles(backbone: Backbone) -> list[Fact]:
    """Number, time, amplitude, frequency and damping ratio of every cycle."""
    b = backbone
    return [
        Fact("cycle", np.arange(1.0, len(b) + 1)),
        Fact("time (s)", b.t),
        Fact(with_unit("amplitude", b.unit), b.amplitude, b.amplitude_std),
        Fact("frequency (Hz)", b.frequency / (2 * np.pi), b.frequency_std / (2 * np.pi)),
        Fact("damping ratio (%)", 100 * b.damping_ratio, 100 * b.damping_ratio_std, 4),
    ]
