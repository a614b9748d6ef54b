"""What is known of every point of a curve: interactive figures show it under the pointer."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from matplotlib.artist import Artist
from numpy.typing import NDArray

from romsindy.typing import Array


class Fact(NamedTuple):
    """A quantity at every point of a curve."""

    label: str  # with the unit in brackets
    values: Array  # (n,)
    std: Array | None = None  # (n,), standard errors
    digits: int = 6  # that are shown of a value

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
