"""Models of one coordinate held against the cycles of the decays that they are about."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from romsindy.record.backbone import CERTAIN, Backbone, joined
from romsindy.record.decay import Decay
from romsindy.regression.comparison import (
    Candidate,
    Judged,
    coefficient_table,
    negative_damping,
    negative_inertia,
)
from romsindy.text import TextTable, listed


@dataclass(frozen=True, eq=False)
class Beside:
    """Models beside what was read off decays."""

    decays: Sequence[Decay]  # what was analysed, with derivatives
    backbones: Sequence[Backbone]  # one for each
    # Columns of the table; the identified equation first, where there is one
    candidates: Sequence[Judged]
    main: Judged  # whose equation is printed
    # Names of the forces that were found, which regressions need not have
    forces: tuple[str, ...] = ()

    @cached_property
    def backbone(self) -> Backbone:
        """The cycles of all decays."""
        return joined(self.backbones)

    @property
    def regressions(self) -> list[Candidate]:
        """Models that a regression has found."""
        return [c for c in self.candidates if isinstance(c, Candidate)]

    @property
    def shown(self) -> list[Judged]:
        """Models with estimated linear frequency, or all where it was given."""
        return [c for c in self.candidates if "fixed" not in c.name]

    def errors(self) -> str:
        """One sentence on how the models follow the backbone."""
        return self._over("; ".join(f"the {c.name} model {_off(c)}" for c in self.shown))

    def missed(self) -> str:
        """The same of the model alone whose equation is printed."""
        return self._over(f"it {_off(self.main)}")

    def _over(self, words: str) -> str:
        judges = int(np.sum(self.backbone.certain))
        if judges:
            return f"Over {judges} cycles {words}."
        return f"The frequency of no cycle is known to {100 * CERTAIN:g} %: none judges a model."

    def table(self) -> TextTable:
        """Coefficients and backbone errors: of series those that regressions have too."""
        keys = dict.fromkeys(k for c in self.regressions for k in c.model.coefficients)
        names = [*keys, *(f for f in self.forces if f not in keys)]
        rows = coefficient_table(self.candidates, names)
        return TextTable("Coefficients and backbone errors", rows, self._note())

    def _note(self) -> str:
        """How the errors in the table were taken, and which model cannot be."""
        unsure = int(np.sum(~self.backbone.certain))
        left_out = (
            f"; cycles whose own frequency is not known to {100 * CERTAIN:g} % are left out"
            f" ({unsure})"
        )
        text = (
            "Backbone error: frequency of the model's undamped motion against that of each cycle,"
            f" at its amplitude{left_out if unsure else ''}. Regressions have no error bars."
        )
        if self.main not in self.regressions:
            text += (
                " Those of the identified model include what the choice of structure leaves open;"
                " of its series, the table has the coefficients that the regressions have too."
            )
        return " ".join([text, *self.impossible()])

    def impossible(self) -> Iterator[str]:
        """What no structure does, and a model in the table has: a sentence for each."""
        low, high = min(d.q.min() for d in self.decays), max(d.q.max() for d in self.decays)
        for c in self.candidates:
            first = negative_inertia(c.model, low, high)
            if first is not None:
                yield (
                    f"{c.name}: its inertia h(q) is negative within the data, first at |q| ="
                    f" {first:.3g} {c.model.unit or '[q]'}: no motion of a structure does that."
                )
            negative = negative_damping(c)
            if negative:
                yield (
                    f"{c.name}: its {listed(negative)} is negative: a force that would supply"
                    " energy, which no damping does."
                )


def _off(candidate: Judged) -> str:
    if candidate.lost:
        return f"has no motion at {candidate.lost} of the measured amplitudes"
    return (
        f"misses the measured frequency by {100 * candidate.rms_error:.2g} % rms,"
        f" {100 * candidate.max_error:.2g} % at most"
    )
