"""What all figures share: axes to draw into, and an axis for ratios."""

from __future__ import annotations

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter


def given_or_new(ax: Axes | None) -> Axes:
    """The axes of the caller, or those of a new figure."""
    return plt.subplots(layout="constrained")[1] if ax is None else ax


def log_ratio(ax: Axes) -> None:
    """Show ratios near 1 on a log axis: 0.4 rather than 4 x 10^-1."""
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
