"""Self-contained HTML pages, from the templates beside this file: of one record, or of many."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from romsindy import __version__
from romsindy.notebook import mathml
from romsindy.record.backbone import Backbone
from romsindy.record.files.save import whole, write_whole
from romsindy.show.axes import of_cycles, tell, with_unit
from romsindy.show.interactive import curves, script
from romsindy.text import TextTable, columns_of_numbers

_DPI = 130
_MAKERS = {"png": "Software", "svg": "Creator", "pdf": "Creator"}  # entries of such files
_PLAIN = str.maketrans("", "", "${}\\")  # formulas in texts that are read aloud
# How the banner of a verdict looks; what has none is told without a colour.
_TONES = {
    "none": "good",
    "named": "good",
    "explained": "good",
    "ambiguous": "unsure",
    "good for practice": "unsure",
    "unknown": "bad",
    "not explained": "bad",
}
_CAPTION = "Every dot is a cycle whose own frequency is known well enough; a colour for each file."


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn when it is written."""

    name: str  # of its files, where it is written to files
    title: str
    caption: str
    draw: Callable[[Figure], object]  # draws into an empty Figure
    size: tuple[float, float] = (6.4, 4.4)  # inches

    def figure(self) -> Figure:
        """The figure, drawn."""
        figure = Figure(figsize=self.size, layout="constrained")
        self.draw(figure)
        return figure

    def write(self, path: str | Path | IO[bytes], format: str | None = None) -> None:
        """Draw it to a file, which says what made it; the ending of a path says how."""
        if not isinstance(path, str | Path):
            self.figure().savefig(path, format=format, dpi=_DPI)
            return
        kind = format or Path(path).suffix.lower().removeprefix(".")
        made = {_MAKERS[kind]: f"romsindy {self.name}"} if kind in _MAKERS else None
        with whole(path) as new:
            self.figure().savefig(new, format=format, dpi=_DPI, metadata=made)

    def image(self, figure: Figure, interactive: bool, dpi: int = _DPI) -> Image:
        """Its figure as a page holds it."""
        elements = curves(figure, self.name) if interactive else ""
        return Image.of(figure, self.title, dpi, elements)


@dataclass(frozen=True)
class Image:
    """A figure as a page holds it: PNG in base64, and a text that says what is seen.

    ``curves`` are the elements that take the place of the PNG in an interactive page, if any can.
    """

    png: str
    alt: str
    curves: str = ""

    @classmethod
    def of(cls, figure: Figure, title: str, dpi: int = _DPI, curves: str = "") -> Image:
        """Draw a figure; its axes and labelled curves make the text."""
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=dpi)
        seen = filter(None, map(_seen, figure.axes))
        return cls(base64.b64encode(buffer.getvalue()).decode(), "; ".join([title, *seen]), curves)


def _seen(ax: Axes) -> str:
    """What axes show: the quantity against the other one, and names of curves."""
    names = dict.fromkeys(ax.get_legend_handles_labels()[1])
    over = f" against {ax.get_xlabel()}" if ax.get_xlabel() else ""
    curves = f": {', '.join(names)}" if names else ""
    return f"{ax.get_title()} {ax.get_ylabel()}{over}{curves}".translate(_PLAIN).strip()


def write_page(
    path: str | Path,
    template: str,
    command: str,
    *,
    pictures: Iterable[Picture] = (),
    interactive: bool = False,
    **content: Any,
) -> None:
    """Fill one of the package's templates and write it.

    The ``template`` is "report" for an inspection, an identification or a diagnosis, or "study";
    the head names the ``command`` that makes such pages as the generator. Pictures are drawn one
    after the other, the template's ``figures``, and with ``interactive`` zoom and show what is
    under the pointer. ``content`` is what else the template names; ``formulas`` are equations
    in LaTeX, in parts between which lines may end.

    Raises a ValueError if the page is to be interactive and plotly is not installed.
    """
    plotly = script() if interactive else ""
    environment = Environment(
        loader=PackageLoader("romsindy.show"), autoescape=select_autoescape(["j2"])
    )
    environment.filters["columns_of_numbers"] = columns_of_numbers
    environment.filters["mathml"] = lambda latex: Markup(mathml(latex))
    environment.filters["tone"] = lambda verdict: _TONES.get(verdict, "")
    figures = [vars(p) | vars(p.image(p.figure(), interactive)) for p in pictures]
    text = environment.get_template(f"{template}.html.j2").render(
        version=__version__, command=command, plotly=plotly, figures=figures, **content
    )
    write_whole(path, text)


def write_overview(
    path: str | Path,
    sentence: str,
    rows: Sequence[Sequence[str]],
    backbones: Mapping[str, Backbone],
    notes: Sequence[str] = (),
    *,
    interactive: bool = False,
    command: str = "identify",
) -> None:
    """Write the page.

    The last cell of a row is the report, to which it links; ``backbones`` go by names of files, and
    ``notes`` say why files have no report. With ``interactive``, the figure zooms and shows the
    cycle under the pointer.
    """
    header, *body = rows
    linked = [[*row[:-1], _link(row[-1])] for row in body]
    draw = partial(draw_backbones, backbones)
    pictures = [Picture("backbones", "Backbones", _CAPTION, draw, (9.0, 4.8))]
    write_page(
        path,
        "report",
        command,
        title=f"{len(body)} records",
        sentence=sentence,
        tables=[TextTable("Files", [header, *linked])],
        pictures=pictures if backbones else [],
        interactive=interactive,
        notes_title="Without a report",
        notes=notes,
    )


def _link(page: str) -> str:
    return page if page == "-" else Markup(f'<a href="{escape(page)}">{escape(page)}</a>')


def draw_backbones(backbones: Mapping[str, Backbone], figure: Figure) -> None:
    """Frequency and damping ratio of the cycles of several records against amplitude."""
    frequency, damping = figure.subplots(1, 2, sharey=True)
    for name, b in backbones.items():
        sure = b.certain
        for ax, read in ((frequency, b.frequency / (2 * np.pi)), (damping, 100 * b.damping_ratio)):
            (dots,) = ax.plot(read[sure], b.amplitude[sure], ".", ms=3, label=name)
            tell(dots, *(f.at(sure) for f in of_cycles(b)))
    units = sorted({b.unit or "unit of q" for b in backbones.values()})
    frequency.set(xlabel="frequency (Hz)", ylabel=with_unit("amplitude", ", ".join(units)))
    damping.set(xlabel="damping ratio (%)")
    frequency.set_ylim(0, None)
    frequency.xaxis.set_major_locator(MaxNLocator(5))
    look = {"ncols": 3, "frameon": False, "fontsize": "small"}
    figure.legend(handles=frequency.lines, loc="outside lower center", **look)
