"""What every finding of a diagnosis can be written as."""

from __future__ import annotations

import csv
from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from romsindy.diagnosis.found import FoundEffect
from romsindy.notebook import shown
from romsindy.physics.term_sum import json_text
from romsindy.record.files.save import whole

if TYPE_CHECKING:
    from romsindy.show.page import Picture


class Written(ABC):
    """A finding as a sentence, a table, JSON, CSV and a page."""

    if TYPE_CHECKING:  # a field of some reports, found by others

        @property
        def verdict(self) -> str:
            """One word: "none", "named", "ambiguous" or "unknown"."""

        @property
        def interrupted(self) -> bool:
            """Whether the search was stopped before its end."""

    @property
    @abstractmethod
    def sentence(self) -> str:
        """The finding, a line for each question: do they differ, what is missing, left, next?"""

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """Effects that are missing, of the best explanation; empty where something else is."""
        return ()

    @property
    def equivalent(self) -> tuple[tuple[str, ...], ...]:
        """Names of the explanations that the data do not tell apart, best first."""
        return ()

    @abstractmethod
    def table(self) -> list[list[str]]:
        """Rows of text: every explanation that the data allow, with its values."""

    @abstractmethod
    def pictures(self) -> dict[str, Picture]:
        """Pictures by name; ``draw(figure)`` draws one, its caption is what its numbers say."""

    @abstractmethod
    def page(self) -> dict[str, Any]:
        """What the page shows beside the pictures."""

    def _content(self) -> dict[str, Any]:
        """What JSON holds."""
        names = ("verdict", "sentence", "interrupted")
        return {name: getattr(self, name) for name in names}

    def to_json(self) -> str:
        """All that was found as JSON text."""
        return json_text(self._content())

    def to_csv(self, path: str | Path) -> None:
        """Write the table of explanations."""
        with whole(path) as new, open(new, "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(self.table())

    def to_html(self, path: str | Path, *, interactive: bool = False) -> None:
        """Write one self-contained page with figures.

        Parameters
        ----------
        path : str or Path
        interactive : bool
            Whether figures zoom and show what is under the pointer; needs plotly:
            ``pip install "romsindy[interactive]"``.
        """
        from romsindy.show.page import write_page  # draws: only where a page is asked for

        pictures = self.pictures().values()
        write_page(
            path, "report", "diagnose", pictures=pictures, interactive=interactive, **self.page()
        )

    def __str__(self) -> str:
        return self.sentence

    def _repr_html_(self) -> str:
        page = self.page()
        return shown(page["formulas"], page["tables"], [f"{self.verdict}: {self.sentence}"])

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.verdict}: {' '.join(self.sentence.splitlines())}>"
