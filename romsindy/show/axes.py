"""What all figures share: axes to draw into, looks of curves, units, an axis for ratios."""

from __future__ import annotations

import re
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

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


def log_ratio(ax: Axes) -> None:
    """Show ratios near 1 on a log axis: 0.4 rather than 4 x 10^-1."""
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
