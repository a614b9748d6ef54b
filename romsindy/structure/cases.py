"""Where the shapes that a force holds come from: given with the model, or computed and kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from joblib import Parallel, delayed

from romsindy.structure.calculix import CalculiX, HeldCases, Matrices
from romsindy.structure.deck import Deck
from romsindy.structure.held import Found, follow, of_cases
from romsindy.structure.linear import LinearMode
from romsindy.structure.store import CaseStore
from romsindy.text import bar

_MOST_CASES = 40


class StaticCases(Protocol):
    """Where the shapes that a force holds come from."""

    def curve(self, mode: LinearMode, reach: float | None, tolerance: float) -> Found:
        """Shapes along a mode, as far as its loudest freedom is moved by ``reach``."""
        ...


@dataclass(frozen=True, eq=False)
class GivenCases:
    """Cases that came with the model, by number of the mode."""

    given: Mapping[int, HeldCases]

    def curve(self, mode: LinearMode, reach: float | None, tolerance: float) -> Found:
        """The curve through all of them; neither reach nor tolerance can be asked for."""
        if mode.number not in self.given:
            raise ValueError(
                f"mode = {mode.number} has no static cases: there are some of mode"
                f" {', '.join(map(str, self.given))}"
            )
        if reach is not None:
            raise ValueError(
                f"reach = {reach} cannot be asked of cases that are given: leave it out"
            )
        return of_cases(mode, self.given[mode.number])


@dataclass(frozen=True, eq=False)
class DeckCases:
    """Cases that CalculiX computes when they are asked for, and keeps."""

    program: CalculiX
    deck: Deck
    known: Matrices
    store: CaseStore
    n_jobs: int
    progress: bool

    def curve(self, mode: LinearMode, reach: float | None, tolerance: float) -> Found:
        """The curve of a mode, walked outwards by CalculiX; what was computed is kept."""
        if reach is None:
            raise ValueError("reach is not given: say how far the node that moves most is moved")
        with bar(None, f"holding {self.deck.path.name}", unit="case") as progress:
            progress.disable = progress.disable or not self.progress

            def hold(rows: Sequence[Sequence[float]]) -> list[HeldCases]:
                tasks = (delayed(self._held)(mode, row) for row in rows)
                several = list(Parallel(n_jobs=self.n_jobs, backend="threading")(tasks))
                self.store.keep_cases(mode.number, several)
                progress.update(sum(len(row) for row in rows))
                if self.store.path is not None:
                    progress.set_postfix_str(f"what was held is kept in {self.store.path}")
                return [held.reached for held in several]

            return follow(hold, mode, reach, tolerance, _MOST_CASES)

    def _held(self, mode: LinearMode, factors: Sequence[float]) -> HeldCases:
        """Shapes at some factors, kept or computed; nan where there is none."""
        kept = self.store.cases(mode.number, factors)
        if kept is not None:
            return kept
        held = self.program.held(self.deck, self.known, mode.momentum, factors)
        shapes = np.full((len(factors), len(mode.shape)), np.nan)
        shapes[: len(held.factors)] = held.shapes
        return HeldCases(np.array(factors), shapes)
