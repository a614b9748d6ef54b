"""One page about many records: their backbones in one figure, and one row for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from markupsafe import Markup, escape
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from romsindy.record.backbone import Backbone
from romsindy.show.axes import of_cycles, tell, with_unit
from romsindy.show.page import Picture, write_page
from romsindy.text import TextTable

_CAPTION = "Every dot is a cycle whose own frequency is known well enough; a colour for each file."


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
    pictures = [Picture("backbones", "Backbones", _CAPTION, partial(_draw, backbones), (9.0, 4.8))]
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


def _draw(backbones: Mapping[str, Backbone], figure: Figure) -> None:
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
    figure.legend(
        handles=frequency.lines,
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize="small",
    )
