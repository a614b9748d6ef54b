"""Figures that zoom and show what is under the pointer, offline.

Every figure is drawn once, by matplotlib. What its axes hold then, curves, bands, bars and maps, is
handed to plotly with its colours, dashes, labels and limits, and with the facts told of its points.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence
from importlib import import_module
from textwrap import wrap
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection, QuadMesh
from matplotlib.colors import to_hex, to_rgba
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation
from matplotlib.ticker import FixedLocator

from romsindy.show.axes import Fact, told
from romsindy.typing import Array

_PX = 4 / 3  # of a point
_LEAST_MARK = 5.0  # px: what a finger can hit
_DASHES = {"-": "solid", "--": "dash", "-.": "dashdot", ":": "dot"}
_MARKS = {"o": "circle", "s": "square", "^": "triangle-up", "v": "triangle-down"}
_MARKS |= {"D": "diamond", "<": "triangle-left", ">": "triangle-right", ".": "circle"}
_COLOURS = 17  # of a map
_BELOW = 1e-3  # of the lowest value that a logarithmic axis shows: where 0 is drawn
_DIGITS = 6  # of a coordinate
_ASIDE = {"hoverinfo": "skip", "showlegend": False}

Trace = dict[str, Any]


def known(ax: Axes) -> bool:
    """Whether all that axes hold has a counterpart."""
    kinds = (Rectangle, LineCollection, PolyCollection, Annotation)
    artists = (*ax.patches, *ax.collections, *ax.texts, *ax.images, *ax.tables, *ax.artists)
    upright = all(getattr(c, "orientation", "vertical") == "vertical" for c in ax.containers)
    return upright and all(
        _edges(a) if isinstance(a, QuadMesh) else isinstance(a, kinds) for a in artists
    )


def traces(ax: Axes, labels: tuple[str, str]) -> Iterator[Trace]:
    """Curves, bands, bars and maps of axes with two labels, from the lowest to the uppermost."""
    names = _names(ax)
    bars = [c for c in ax.containers if isinstance(c, BarContainer)]
    for container in bars:
        yield _bars(container, ax, labels) | _named(str(container.get_label()))
    for artist in sorted((*ax.collections, *ax.lines), key=lambda a: a.get_zorder()):
        name = names.get(artist, "")
        if isinstance(artist, QuadMesh):
            yield _map(artist, labels)
        elif isinstance(artist, PolyCollection) and artist.get_paths():  # of nan it has none
            yield _band(artist, ax) | _named(name)
        elif isinstance(artist, LineCollection):
            yield _strokes(artist) | _named(name)
        elif isinstance(artist, Line2D) and all(_in_data(artist, ax)):
            yield _curve(artist, name, labels) | _named(name)


def across(ax: Axes, n: str) -> Iterator[Trace]:
    """Lines and areas that cross the panel number n from side to side."""
    artists: tuple[Any, ...] = (*ax.lines, *ax.patches)
    for artist in artists:
        in_data = _in_data(artist, ax)
        if all(in_data):
            continue
        x, y = (
            f"{k}{n}" if own else f"{k}{n} domain" for k, own in zip("xy", in_data, strict=True)
        )
        label = str(artist.get_label())
        named = {"name": label, "showlegend": True} if re.match("[^_]", label) else {}
        common = {"xref": x, "yref": y, "layer": "below", **named}
        if isinstance(artist, Line2D):
            corners: Any = artist.get_xydata()
            look = {"type": "line", "line": _stroke(artist)}
        else:
            corners = artist.get_bbox().get_points()
            fill = _rgba(artist.get_facecolor())
            look = {"type": "rect", "fillcolor": fill, "line": {"width": 0}}
        (x0, y0), (x1, y1) = corners
        yield common | look | {"x0": x0, "x1": x1, "y0": y0, "y1": y1}


def texts(ax: Axes, n: str) -> Iterator[Trace]:
    """Title and notes of the panel number n."""
    inside = {"xref": f"x{n} domain", "yref": f"y{n} domain", "showarrow": False}
    if ax.get_title():
        yield inside | {"x": 0.5, "y": 1, "yanchor": "bottom", "text": words(ax.get_title())}
    notes: list[Any] = list(ax.texts)  # all of them annotations, see `known`
    for note in notes:
        both = note.xycoords if isinstance(note.xycoords, tuple) else (note.xycoords,) * 2
        place: Trace = {}
        for name, at, of in zip("xy", note.xy, both, strict=True):
            if of == "data":
                log = getattr(ax, f"get_{name}scale")() == "log"
                place |= {name: np.log10(at) if log else at, f"{name}ref": f"{name}{n}"}
            else:
                place[name] = at
        anchors = {"xanchor": note.get_ha(), "yanchor": note.get_va()}
        font = {"color": _rgba(note.get_color()), "size": 12}
        yield inside | place | anchors | {"text": words(note.get_text()), "font": font}


def words(text: str) -> str:
    """A label with its formulas: "$q_1$ (1/s$^2$)" with letters, raised and lowered parts."""

    def formula(found: re.Match[str]) -> str:
        inner = re.sub(r"\\mathrm\{([^{}]*)\}", r"\1", found[1]).replace("~", " ")
        inner = re.sub(r"\\([A-Za-z]+)", lambda name: _letter(name[1]), inner)
        inner = re.sub(r"\^(\{[^{}]*\}|.)", lambda x: f"<sup>{x[1].strip('{}')}</sup>", inner)
        return re.sub(r"_(\{[^{}]*\}|.)", lambda x: f"<sub>{x[1].strip('{}')}</sub>", inner)

    return re.sub(r"\$([^$]*)\$", formula, text).replace("\n", "<br>")


def _letter(name: str) -> str:
    case = "SMALL" if name.islower() else "CAPITAL"
    return unicodedata.lookup(f"GREEK {case} LETTER {name.upper()}")


# -- one artist each -------------------------------------------------------------------------------


def _curve(line: Line2D, name: str, labels: tuple[str, str]) -> Trace:
    x, y = line.get_data(orig=False)
    drawn, marked = (
        k not in ("None", "", " ", None) for k in (line.get_linestyle(), line.get_marker())
    )
    mark = {
        "symbol": _MARKS.get(str(line.get_marker()), "circle"),
        "size": max(_PX * line.get_markersize(), _LEAST_MARK),
        "color": _rgba(line.get_markerfacecolor()),
        "line": {"color": _rgba(line.get_markeredgecolor()), "width": 1},
    }
    return {
        "type": "scatter",
        "mode": "+".join(["lines"] * drawn + ["markers"] * marked),
        "x": x,
        "y": y,
        "line": _stroke(line),
        "marker": mark,
        **_hover(name, told(line), labels),
    }


def _band(band: PolyCollection, ax: Axes) -> Trace:
    """Filled polygons; no point of them is under the pointer."""
    x, y = _joined([np.asarray(path.vertices) for path in band.get_paths()])
    for values, scale, limits in (
        (x, ax.get_xscale(), ax.get_xlim()),
        (y, ax.get_yscale(), ax.get_ylim()),
    ):
        if scale == "log":
            values[values <= 0] = _BELOW * min(limits)
    fill = {"fill": "toself", "fillcolor": _rgba(band.get_facecolor()[0])}
    return {"type": "scatter", "mode": "none", "x": x, "y": y, **_ASIDE, **fill}


def _strokes(strokes: LineCollection) -> Trace:
    """Error bars: the numbers are among the facts of their points."""
    x, y = _joined(strokes.get_segments())
    width = _PX * float(np.ravel(strokes.get_linewidth())[0])
    line = {"color": _rgba(np.asarray(strokes.get_color())[0]), "width": width}
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "line": line, **_ASIDE}


def _bars(bars: Any, ax: Axes, labels: tuple[str, str]) -> Trace:
    base = np.array([b.get_y() for b in bars])
    height = np.array([b.get_height() for b in bars])
    at = np.array([b.get_x() + b.get_width() / 2 for b in bars])
    nearest = np.abs(at[:, None] - ax.get_xticks()).argmin(axis=1)
    ticks = [ax.get_xticklabels()[i].get_text() for i in nearest]
    name, value = str(bars.get_label()), Fact(labels[1], base + height)
    where = words(f"{labels[0]} %{{hovertext}}".strip())
    return {
        "type": "bar",
        "x": at,
        "y": height,
        "base": base,
        "width": [b.get_width() for b in bars],
        "marker": {"color": _rgba(bars[0].get_facecolor())},
        "hovertext": ticks,
        **_hover(name, (value,), labels, where),
    }


def _map(mesh: QuadMesh, labels: tuple[str, str]) -> Trace:
    edges = _edges(mesh)
    assert edges is not None  # or the axes are not known
    parts = np.linspace(0, 1, _COLOURS)
    bar = mesh.colorbar
    level = bar.ax.get_ylabel() if bar is not None else ""
    return {
        "type": "heatmap",
        "x": edges[0],
        "y": edges[1],
        "z": np.asarray(mesh.get_array(), np.float32),
        "zmin": mesh.norm.vmin,
        "zmax": mesh.norm.vmax,
        "colorscale": [[p, _rgba(c)] for p, c in zip(parts, mesh.cmap(parts), strict=True)],
        "showscale": False,
        **_hover("", (), labels, _line(f"level ({level})", "z", 3)),
    }


def _edges(mesh: QuadMesh) -> tuple[Array, Array] | None:
    """Edges of columns and of rows; None where cells are no rectangles along the axes."""
    corners = np.asarray(mesh.get_coordinates())
    x, y = corners[0, :, 0], corners[:, 0, 1]
    straight = np.array_equal(corners, np.stack(np.meshgrid(x, y), axis=-1))
    return (x, y) if straight else None


# -- looks and words -------------------------------------------------------------------------------


def _hover(name: str, facts: Sequence[Fact], labels: tuple[str, str], *more: str) -> Trace:
    """What is shown at a point: its facts, or its coordinates where it has none; and more lines."""
    lines = [f"<b>{words(name)}</b>"] if name else []
    columns: list[Array] = []
    if not facts:
        lines += [_line(label, key) for label, key in zip(labels, "xy", strict=True)]
    for fact in facts:
        place, error = f"customdata[{len(columns)}]", ""
        columns.append(fact.values)
        if fact.std is not None:
            error = f" ± %{{customdata[{len(columns)}]:.2~g}}"
            columns.append(fact.std)
        lines.append(_line(fact.label, place, fact.digits, error))
    shown: Trace = {"hovertemplate": "<br>".join([*lines, *more]) + "<extra></extra>"}
    return shown | ({"customdata": np.column_stack(columns)} if columns else {})


def _line(label: str, place: str, digits: int = _DIGITS, error: str = "") -> str:
    """A quantity with its unit: "frequency (Hz)" becomes "frequency 7.81 Hz"."""
    found = re.fullmatch(r"(.*) \((.*)\)", label)
    what, unit = (found[1], found[2]) if found else (label, "")
    return words(f"{what} %{{{place}:.{digits}~g}}{error} {unit}".strip())


def _names(ax: Axes) -> dict[Artist, str]:
    """The label of every artist; what has none of its own has that of its colour."""
    own: dict[Artist, str] = {
        line: str(line.get_label())
        for line in ax.lines
        if not str(line.get_label()).startswith("_")
    }
    own |= {
        c.lines[0]: str(c.get_label()) for c in ax.containers if isinstance(c, ErrorbarContainer)
    }
    by_colour = {_colour(artist): name for artist, name in reversed(own.items())}
    others = {a: by_colour.get(_colour(a), "") for a in (*ax.lines, *ax.collections)}
    return others | own


def _named(name: str) -> Trace:
    return {"name": words(name), "legendgroup": words(name)} if name else {}


def _colour(artist: Any) -> str:
    if isinstance(artist, QuadMesh):
        return ""
    color: Any = (
        artist.get_facecolor() if isinstance(artist, PolyCollection) else artist.get_color()
    )
    return to_hex(color if isinstance(artist, Line2D) else color[0])


def _in_data(artist: Artist, ax: Axes) -> tuple[bool, bool]:
    """Whether x and y are those of the axes, rather than parts of their width and height."""
    x, y = artist.get_transform().contains_branch_seperately(ax.transData)
    return x, y


def _stroke(line: Line2D) -> Trace:
    look = {"color": _rgba(line.get_color()), "width": max(_PX * line.get_linewidth(), 1)}
    return look | {"dash": _DASHES.get(str(line.get_linestyle()), "solid")}


def _rgba(color: Any) -> str:
    *rgb, alpha = to_rgba(color)
    return f"rgba({', '.join(f'{255 * part:.0f}' for part in rgb)}, {alpha:g})"


def _joined(parts: Sequence[Array]) -> tuple[Array, Array]:
    """Coordinates of several strokes, with gaps between them."""
    gap = np.full((1, 2), np.nan)
    x, y = np.concatenate([piece for part in parts for piece in (part, gap)]).T.copy()
    return x, y


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
