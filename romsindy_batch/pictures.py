"""Figures of a batch: curves over each other, trends with their bands, two groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from romsindy.show.axes import with_unit
from romsindy.show.page import Picture
from romsindy.text import quantity
from romsindy_batch.summary import KINDS, WORDS, Batch, Trend

_LABELLED = 10  # outliers that are named in a figure


def pictures(batch: Batch, lines: Sequence[Trend], far: Mapping[int, str]) -> list[Picture]:
    """All figures of the page."""
    if not any(batch.curves):
        return []
    found = [
        Picture(
            "curves",
            "Frequency and damping ratio against amplitude",
            "A line for each record, outliers thick; dotted are the amplitudes of the table.",
            partial(_curves, batch, far),
            (7.0, 3.8),
        )
    ]
    for column in dict.fromkeys(line.column for line in lines):
        own = [line for line in lines if line.column == column]
        caption = (
            "A point for each record with its standard error, the line with its 95 % band; crosses"
            " are outliers, by which the line is not moved."
        )
        title = f"Trend over {column}, at {quantity(batch.middle, batch.unit)}"
        size = (7.0, 3.2)
        found.append(Picture(f"trend_{column}", title, caption, partial(_trends, batch, own), size))
    return found


def _curves(batch: Batch, far: Mapping[int, str], figure: Figure) -> None:
    axes = figure.subplots(1, 2, sharey=True)
    thin = max(0.15, min(0.8, 12 / len(batch.curves)))
    for ax, (kind, unit) in zip(axes, KINDS.items(), strict=True):
        for i, curve in enumerate(batch.curves):
            if curve is None:
                continue
            look = {"color": "C1", "lw": 2.0, "label": batch.entries[i].name, "zorder": 3}
            usual = {"color": "C0", "lw": 1.0, "alpha": thin}
            ax.plot(curve[kind], curve["amplitude"], **(look if i in far else usual))
        for a in batch.amplitudes:
            ax.axhline(a, color="0.5", lw=0.8, ls=":")
        ax.set_xlabel(with_unit(WORDS[kind], unit))
        ax.xaxis.set_major_locator(MaxNLocator(5))
        ax.set_ylim(0, None)
    axes[0].set_ylabel(with_unit("amplitude", batch.unit))
    if 0 < len(far) <= _LABELLED:
        figure.legend(
            handles=axes[0].get_legend_handles_labels()[0],
            loc="outside lower center",
            ncols=3,
            frameon=False,
            fontsize="small",
        )


def _trends(batch: Batch, lines: Sequence[Trend], figure: Figure) -> None:
    for ax, line in zip(np.atleast_1d(figure.subplots(1, len(lines))), lines, strict=True):
        y, std = line.values
        there = np.isfinite(line.x + y)
        far = np.isin(np.arange(len(y)), line.outliers)
        ax.errorbar(line.x[there & ~far], y[there & ~far], std[there & ~far], fmt="o", ms=4, lw=1)
        x = np.linspace(np.nanmin(line.x[there]), np.nanmax(line.x[there]), 50)
        middle, half = line.band(x)
        ax.plot(x, middle, color="C0")
        ax.fill_between(x, middle - half, middle + half, color="C0", alpha=0.2, lw=0)
        ax.plot(line.x[far], y[far], "x", color="C1", ms=9, mew=2)
        for i in line.outliers[:_LABELLED]:
            ax.annotate(
                batch.entries[i].name,
                (line.x[i], y[i]),
                xytext=(6, 4),
                textcoords="offset points",
                fontsize="small",
            )
        days = " (days since the first)" if line.dates else ""
        ax.set(xlabel=line.column + days, ylabel=with_unit(WORDS[line.kind], KINDS[line.kind]))
        ax.xaxis.set_major_locator(MaxNLocator(6))
        ax.margins(0.08)
