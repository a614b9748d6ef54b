"""One self-contained HTML page about an identification."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from romsindy.fit.refine import Fit
from romsindy.record.backbone import Backbone
from romsindy.record.decay import Decay
from romsindy.selection.comparison import CERTAIN, Candidate, coefficient_table, judging
from romsindy.selection.select import Selection
from romsindy.show import plots
from romsindy.show.page import Picture, TextTable, write_page


@dataclass(frozen=True, eq=False)
class Identification:
    """What one identification produced, as the report needs it."""

    title: str
    record: Decay
    decay: Decay
    backbone: Backbone
    candidates: Sequence[Candidate]
    selection: Selection | None = None

    def named(self, name: str) -> Candidate:
        """The candidate of that name."""
        return next(c for c in self.candidates if c.name == name)

    def verdict(self) -> str:
        """One sentence on the models with estimated linear frequency."""
        stiffness, icrom = self.named("stiffness"), self.named("IC-ROM")
        words = "; ".join(f"the {c.name} model {_off(c)}" for c in (icrom, stiffness))
        text = f"Over {int(np.sum(judging(self.backbone)))} cycles {words}."
        fit = self.selection.fit if self.selection else icrom.fit
        name = f"Chosen, {self.selection.chosen.name}" if self.selection else "IC-ROM"
        return f"{text} {name}: {fit.verdict}" if fit else text

    def table_note(self) -> str:
        """How the errors in the table were taken."""
        unsure = int(np.sum(~judging(self.backbone)))
        left_out = (
            f"; cycles whose own frequency is not known to {100 * CERTAIN:g} % are left out"
            f" ({unsure})"
        )
        return (
            "Backbone error: frequency of the model's undamped motion against that of each cycle,"
            f" at its amplitude{left_out if unsure else ''}. {self._errors()}"
        )

    def _errors(self) -> str:
        text = (
            "Standard errors (+-) belong to models refined by simulation; where a model does not"
            " explain the data they are those of its best fit, not of the structure."
        )
        failed = [c for c in self.candidates if c.failure]
        if all(c.fit is None for c in self.candidates):
            text = "Coefficients from regression alone have no error bars."
        return " ".join([text, *(f"{c.name} is not refined: {c.failure}." for c in failed)])


def _off(candidate: Candidate) -> str:
    if candidate.lost:
        return f"has no motion at {candidate.lost} of the measured amplitudes"
    return (
        f"misses the measured frequency by {100 * candidate.rms_error:.2g} % rms,"
        f" {100 * candidate.max_error:.2g} % at most"
    )


def pictures(result: Identification) -> list[Picture]:
    """The figures of the report: title, caption and how to draw them."""
    both = [result.named("stiffness"), result.named("IC-ROM")]
    models = {c.name: c.fit or c.model for c in both}
    if result.selection:
        models["chosen terms"] = result.selection.fit
    icrom = result.named("IC-ROM").model
    b = result.backbone
    amplitudes = np.linspace(b.amplitude.min(), b.amplitude.max(), 150)
    return [
        _picture(
            "decay",
            "Decay",
            "The free decay that was analysed, with the peaks of its cycles.",
            partial(plots.plot_decay, result.decay, b, record=result.record),
        ),
        _picture(
            "backbone",
            "Backbone",
            "Each circle is a cycle with its standard error; curves are the undamped models, with"
            " their 95 % bands where they are refined.",
            partial(plots.plot_backbone, b, models),
        ),
        _picture(
            "damping",
            "Damping",
            "Damping ratio of each cycle, and what the models dissipate.",
            partial(plots.plot_damping, b, models),
        ),
        _picture(
            "relative_magnitude",
            "Relative magnitude of the terms",
            "Terms of the IC-ROM over a cycle: which of them matter.",
            partial(plots.plot_relative_magnitude, icrom, amplitudes),
        ),
        _picture(
            "residual",
            "Residual by harmonic",
            "What the regression leaves. Noise grows with the harmonic squared; what stands out"
            " from that is a missing term.",
            partial(plots.plot_residual, {c.name: c.estimator for c in both}),
        ),
        *(_misfit(c.name, c.fit) for c in both if c.fit),
        *(_choice(result.selection) if result.selection else ()),
    ]


def _picture(name: str, title: str, caption: str, plot: Callable[..., object]) -> Picture:
    return Picture(name, title, caption, lambda figure: plot(ax=figure.subplots()))


def _choice(selection: Selection) -> list[Picture]:
    chosen = selection.chosen.name
    caption = (
        f"Chosen: {chosen}; {len(selection.equivalent)} others cannot be told from it. Error of"
        " held-out cycles, in squared noise, against size."
    )
    plot = partial(plots.plot_selection, selection)
    return [
        _picture("selection", "Terms that the data ask for", caption, plot),
        _misfit(f"chosen ({chosen})", selection.fit),
    ]


def _misfit(name: str, fit: Fit) -> Picture:
    return _picture(
        "misfit",
        f"What the refined {name} model leaves",
        "Residual at the harmonics of the motion over the noise, in windows of eight cycles: near"
        " 1 nothing is missing.",
        partial(plots.plot_misfit, fit),
    )


def write_identification(
    result: Identification, path: str | Path, progress: Callable[[Iterable], Iterable] = iter
) -> None:
    """Write the page; ``progress`` may wrap the figures in a progress bar."""
    rows = coefficient_table(result.candidates)
    write_page(
        path,
        "report",
        title=result.title,
        sentence=result.verdict(),
        equation_title="The equation of motion",
        equation=str(result.named("IC-ROM").model),
        tables=[TextTable("Coefficients and backbone errors", rows, result.table_note())],
        pictures=progress(pictures(result)),
        notes=[repr(result.decay).splitlines()[0].strip("<>"), *result.decay.notes],
    )
