"""Figures that zoom and show what is under the pointer, offline.

Every figure is drawn once, by matplotlib. What its axes hold then, curves, bands, bars and maps, is
handed to plotly with its colours, dashes, labels and limits, and with the facts told of its points.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from textwrap import wrap
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from romsindy.show.traces import across, known, texts, traces, words

_PX_PER_INCH = 82  # of the height of a static figure: as tall as it is in a page
# px: a panel at least; round all panels; between them, with titles of axes or without; from a panel
# to the legend; a letter.
_LEAST, _ROUND, _TITLE, _TICKS, _ABOVE, _LETTER = 190, 100, 80, 26, 6, 6.5
_TICK_LETTERS = 10  # of a word below a bar, to a line
_DECADES = 3  # of a logarithmic axis, up to which 2 and 5 are labelled too
_FONT = {"family": "system-ui, sans-serif", "size": 13, "color": "#222"}
_AXIS = {"showline": True, "mirror": True, "linecolor": "#444", "gridcolor": "#eee"}
_AXIS |= {"zeroline": False, "ticks": "outside", "automargin": True, "exponentformat": "power"}
_LAYOUT = {
    "margin": {"l": 10, "r": 32, "t": 30, "b": 10},  # px: labels add theirs, buttons are right
    "font": _FONT,
    "template": "none",
    "hovermode": "closest",
    "hoverlabel": {"align": "left", "bgcolor": "white", "font": _FONT},
    "modebar": {"orientation": "v", "bgcolor": "white"},
}
# Only these: one of plotly's own buttons uploads what is shown.
_BUTTONS = ["toImage", "zoom2d", "pan2d", "autoScale2d", "resetScale2d"]
_CONFIG = {"responsive": True, "displaylogo": False, "modeBarButtons": [_BUTTONS]}


def check_plotly() -> None:
    """Make sure that plotly is there, before any work.

    Raises a ValueError if it is not installed; the message says how.
    """
    try:
        import_module("plotly")
    except ImportError:
        raise ValueError(
            "interactive figures need plotly, which is not installed: python -m pip install"
            ' "romsindy[interactive]"'
        ) from None


def script() -> Markup:
    """The program that draws them, for the head of a page."""
    check_plotly()
    return Markup(f"<script>{import_module('plotly.offline').get_plotlyjs()}</script>")


def curves(figure: Figure, name: str) -> Markup:
    """An element for each column of axes; nothing for a figure that only an image can show."""
    write = import_module("plotly.io").to_html
    options = {"full_html": False, "include_plotlyjs": False, "config": _CONFIG}
    columns = translated(figure)
    return Markup("\n").join(
        Markup(write(column, **options, div_id=f"{name}-{i}"))
        for i, column in enumerate(columns, 1)
    )


def translated(figure: Figure) -> list[Any]:
    """A plotly figure for each column of axes, so that columns may stand below each other.

    None at all where some axes hold what has no counterpart.
    """
    figure.draw_without_rendering()  # settles limits and ticks
    maps = [m for ax in figure.axes for m in ax.collections]
    colour_bars = [m.colorbar.ax for m in maps if m.colorbar is not None]
    columns: dict[int, list[Axes]] = {}
    for ax in figure.axes:
        spec = ax.get_subplotspec()
        if spec is not None and known(ax):
            columns.setdefault(spec.colspan.start, []).append(ax)
        elif ax not in colour_bars:
            return []
    make = import_module("plotly.graph_objects").Figure
    return [make(_column(figure, column)) for column in columns.values()]


def _column(figure: Figure, panels: Sequence[Axes]) -> dict[str, Any]:
    height = max(_PX_PER_INCH * figure.get_figheight(), _LEAST * len(panels))
    room = height - _ROUND
    titles = any(ax.get_xlabel() for ax in panels[:-1])
    domains = _domains(panels, (_TITLE if titles else _TICKS) / room)
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"height": height, **_LAYOUT, "shapes": [], "annotations": []}
    for i, (ax, domain) in enumerate(zip(panels, domains, strict=True)):
        n = str(i + 1) if i else ""
        labels = (_label(ax, "x", panels), _label(ax, "y", figure.axes) or figure.get_supylabel())
        side = "<br>".join(wrap(words(labels[1]), int(room * np.ptp(domain) / _LETTER)))
        x = _axis(ax.xaxis, words(ax.get_xlabel())) | _matching(ax, panels[:i], "x")
        y = _axis(ax.yaxis, side) | _matching(ax, panels[:i], "y")
        layout[f"xaxis{n}"] = x | {"anchor": f"y{n}"}
        equal = f"x{n}" if ax.get_aspect() == 1 else None
        layout[f"yaxis{n}"] = y | {"anchor": f"x{n}", "domain": domain, "scaleanchor": equal}
        layout["shapes"] += across(ax, n)
        layout["annotations"] += texts(ax, n)
        data += [trace | {"xaxis": f"x{n}", "yaxis": f"y{n}"} for trace in traces(ax, labels)]
    above = _TICKS if layout["annotations"] else _ABOVE
    layout["legend"] = {"orientation": "h", "y": 1 + above / room, "yanchor": "bottom"}
    return {"data": _each_name_once(data), "layout": layout}


def _each_name_once(data: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Traces of which the first of a name stands for the others in the legend."""
    named = {""}
    for trace in data:
        name = trace.get("name", "")
        trace["showlegend"] = trace.get("showlegend", True) and name not in named
        named |= {name} if trace["showlegend"] else set()
    return list(data)


def _domains(panels: Sequence[Axes], gap: float) -> list[list[float]]:
    """Where panels stand, and the gaps between, as parts of the height that is drawn into."""
    specs = [spec for ax in panels if (spec := ax.get_subplotspec())]
    ratios = np.array(specs[0].get_gridspec().get_height_ratios(), float)
    heights = ratios / ratios.sum() * (1 - gap * (len(ratios) - 1))
    tops = 1 - np.concatenate([[0.0], np.cumsum(heights + gap)[:-1]])
    bottoms = np.maximum(tops - heights, 0)  # of the last one, but for rounding
    return [[float(bottoms[s.rowspan.stop - 1]), float(tops[s.rowspan.start])] for s in specs]


def _axis(axis: Any, title: str) -> dict[str, Any]:
    """Limits, scale, ticks and title of an axis."""
    low, high = axis.get_view_interval()
    shown: dict[str, Any] = {**_AXIS, "range": [low, high], "title": {"text": title, "font": _FONT}}
    if axis.axis_name == "x":  # panels beside each other may come to stand below each other
        shown["showticklabels"] = bool(axis.get_tick_params().get("labelbottom", True))
    if axis.get_scale() == "log":
        decades = np.log10([low, high])
        shown |= {"type": "log", "range": list(decades), "dtick": 1}
        if np.ptp(decades) < _DECADES:
            shown |= {"dtick": "D2", "tickformat": "~g"}  # 1, 2 and 5
    elif isinstance(axis.get_major_locator(), FixedLocator):
        at = axis.get_ticklocs()
        labels = axis.get_major_formatter().format_ticks(at)
        short = ["<br>".join(wrap(words(t), _TICK_LETTERS)) for t in labels]
        shown |= {"tickvals": list(at), "ticktext": short, "ticklabeloverflow": "allow"}
    return shown


def _shared(ax: Axes, name: str) -> Any:
    return ax.get_shared_x_axes() if name == "x" else ax.get_shared_y_axes()


def _matching(ax: Axes, above: Sequence[Axes], name: str) -> dict[str, str]:
    """The first axis above that moves along."""
    joined = [i for i, other in enumerate(above) if _shared(ax, name).joined(ax, other)]
    return {"matches": f"{name}{joined[0] + 1 if joined[0] else ''}"} if joined else {}


def _label(ax: Axes, name: str, others: Sequence[Axes]) -> str:
    """Label of an axis, which may stand at another one that shares it."""
    sharing = [ax, *(other for other in others if _shared(ax, name).joined(ax, other))]
    labels = [str(getattr(other, f"get_{name}label")()) for other in sharing]
    return next(filter(None, labels), "")
