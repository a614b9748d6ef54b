"""Self-contained HTML pages, from the templates beside this file."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from jinja2 import Environment, PackageLoader, select_autoescape
from matplotlib.figure import Figure

from romsindy import __version__
from romsindy.text import columns_of_numbers

_DPI = 130


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn when it is written.

    Attributes
    ----------
    name : str
        Of its files, where it is written to files.
    title, caption : str
    draw : callable
        Draws into an empty Figure.
    size : (float, float)
        Inches.
    """

    name: str
    title: str
    caption: str
    draw: Callable[[Figure], object]
    size: tuple[float, float] = (6.4, 4.4)

    def figure(self) -> Figure:
        """The figure, drawn."""
        figure = Figure(figsize=self.size, layout="constrained")
        self.draw(figure)
        return figure

    def write(self, path: str | Path | IO[bytes], format: str | None = None) -> None:
        """Draw it to a file; the ending of a path says how, as in matplotlib."""
        self.figure().savefig(path, format=format, dpi=_DPI)


def write_page(
    path: str | Path, template: str, *, pictures: Iterable[Picture] = (), **content: Any
) -> None:
    """Fill one of the package's templates and write it.

    Parameters
    ----------
    path : str or Path
    template : str
        "report" for an inspection, an identification or a diagnosis; "study".
    pictures : iterable of Picture
        Drawn one after the other, the template's ``figures``.
    **content
        What else the template names.
    """
    environment = Environment(
        loader=PackageLoader("romsindy.show"), autoescape=select_autoescape(["j2"])
    )
    environment.filters["columns_of_numbers"] = columns_of_numbers
    figures = [{"title": p.title, "caption": p.caption, "png": _png(p)} for p in pictures]
    text = environment.get_template(f"{template}.html.j2").render(
        version=__version__, figures=figures, **content
    )
    Path(path).write_text(text, encoding="utf-8")


def _png(picture: Picture) -> str:
    buffer = io.BytesIO()
    picture.write(buffer, "png")
    return base64.b64encode(buffer.getvalue()).decode()
