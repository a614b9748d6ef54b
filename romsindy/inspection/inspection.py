"""An inspection for its reader: text, numbers, figures, one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from romsindy.inspection import tables
from romsindy.inspection.content import content_of
from romsindy.inspection.findings import Findings
from romsindy.physics.term_sum import json_text

if TYPE_CHECKING:
    from romsindy.show.page import Figure


class Inspection(Findings):
    """What `romsindy.inspect` found in a recording.

    ``print`` shows it as text. See `Findings` for its numbers: `modes`, `releases`, `noise`,
    `defects`, `warnings`, `discarded`, `resonances`, and the `decays` to be identified.
    """

    def __str__(self) -> str:
        return tables.report(self)

    def short(self, command: str = "") -> str:
        """What was found, how sure, what is wrong with it, what next, in 19 lines at most.

        Parameters
        ----------
        command : str
            A command line that identifies the record, for the steps that come next.
        """
        return tables.short(self, command)

    def __repr__(self) -> str:
        frequencies = ", ".join(f"{m.mean_frequency:.5g}" for m in self.modes) or "none"
        counts = f"releases: {len(self.releases)}, defects: {len(self.defects)}"
        return f"<Inspection: modes at {frequencies} Hz, {counts}>"

    def to_dict(self) -> dict[str, Any]:
        """All numbers by name, times in s, frequencies in Hz, the rest in SI units."""
        return content_of(self)

    def to_json(self) -> str:
        """The same as JSON text; what is not finite is a string."""
        return json_text(self.to_dict())

    def plot(self) -> Figure:
        """Time signal, spectrogram with the ridges that were followed, and spectrum."""
        from romsindy.inspection.page import picture  # draws: only where a figure is asked for

        return picture(self).figure()

    def to_html(self, path: str | Path, command: str = "", *, interactive: bool = False) -> None:
        """Write one self-contained page with figures.

        Parameters
        ----------
        path : str or Path
        command : str
            A command line that identifies the record, for the steps that come next.
        interactive : bool
            Whether figures zoom and show what is under the pointer; needs plotly:
            ``pip install "romsindy[interactive]"``.
        """
        from romsindy.inspection.page import write

        write(self, path, command, interactive=interactive)
