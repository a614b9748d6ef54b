"""What all figures share: axes to draw into, looks of curves, units, what is said of points."""

from __future__ import annotations

import re
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from romsindy.record.backbone import Backbone
from romsindy.typing import Array

_DASHES = ("-", "--", "-.", ":")


def given_or_new(ax: Axes | None) -> Axes:
    """The axes of the caller, or those of a new figure."""
    return plt.subplots(layout="constrained")[1] if ax is None else ax


def look(i: int) -> dict[str, Any]:
    """Colour and dash of the curve number i: told apart in grey and by any eye."""
    return {"color": f"C{i % 10}", "ls": _DASHES[i % len(_DASHES)]}


def with_unit(what: str, unit: str | None) -> str:
    """A label with its unit in brackets, exponents raised: "kg^0.5 m" becomes kg^(1/2) m."""
    raised = re.sub(r"\^(-?[\d./]+)", r"$^{\1}$", (unit or "unit of q").replace("^0.5", "^1/2"))
    return f"{what} ({raised})"


def log_ratio(ax: Axes, *others: str) -> None:
    """Show values over few decades on a log y axis, and "x" if said: 0.4 rather than 4 x 10^-1."""
    for of in ("y", *others):
        ax.set(**{f"{of}scale": "log"})
        axis = getattr(ax, f"{of}axis")
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())


def legend_once(ax: Axes, **look: Any) -> None:
    """A legend in which what shares a label is named once, as several decays are."""
    handles, labels = ax.get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    ax.legend(named.values(), named.keys(), loc="best", frameon=False, **look)


def labelled(ax: Axes, xlabel: str, ylabel: str, **look: Any) -> Axes:
    """The axes with their labels, and a legend of what was drawn into them."""
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.legend(**({"loc": "best", "frameon": False} | look))
    return ax


# -- what is known of every point of a curve -------------------------------------------------------


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


def of_cycles(b: Backbone, decay: int | None = None) -> list[Fact]:
    """Number, time, amplitude, frequency and damping ratio of every cycle of a decay.

    The decay has a number itself where there are several.
    """
    return [
        *([] if decay is None else [Fact("decay", np.full(len(b), float(decay)))]),
        Fact("cycle", np.arange(1.0, len(b) + 1)),
        Fact("time (s)", b.t),
        Fact(with_unit("amplitude", b.unit), b.amplitude, b.amplitude_std),
        Fact("frequency (Hz)", b.frequency / (2 * np.pi), b.frequency_std / (2 * np.pi)),
        Fact("damping ratio (%)", 100 * b.damping_ratio, 100 * b.damping_ratio_std, 4),
    ]
