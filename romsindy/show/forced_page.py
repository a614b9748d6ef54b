"""One self-contained HTML page about the equation of a vibration that inputs drive."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from romsindy.fit.estimate import Band
from romsindy.fit.fitted import Fit
from romsindy.fit.forced.adequacy import ForcedAdequacy
from romsindy.fit.forced.held_out import HeldOut
from romsindy.physics.driven import inputs_of
from romsindy.record.forced import ForcedVibration
from romsindy.show import forced_plots as show
from romsindy.show.page import Picture, write_page
from romsindy.show.panels import functions
from romsindy.text import TextTable, with_error

_LOW, _CURVE = 0.02, 40  # of the largest amplitude, where a backbone begins; points of it


@dataclass(frozen=True, eq=False)
class ForcedReport:
    """What was identified of a forced vibration, as the page and the command line need it.

    Attributes
    ----------
    title : str
    fit : Fit
    vibration : ForcedVibration
        That was fitted.
    held_out : HeldOut or None
        The rest of the record, where some of it was held out.
    """

    title: str
    fit: Fit
    vibration: ForcedVibration
    held_out: HeldOut | None = None

    @cached_property
    def band(self) -> Band:
        """Backbone and damping ratio, up to the largest displacement."""
        peak = max(record.peak for record in self.fit.records)
        return self.fit.band(np.linspace(_LOW * peak, peak, _CURVE))

    @property
    def piece(self) -> float:
        """Cycles in each piece where the record was followed in pieces, or 0."""
        verdict = self.fit.verdict
        return verdict.piece if isinstance(verdict, ForcedAdequacy) else 0.0

    def equation(self) -> str:
        """In plain text."""
        model = self.fit.model
        return f"{model.equation()}    (q in {model.unit or '[q]'}, t in s)"

    def inputs(self) -> TextTable:
        """What each input does: how strongly, how late, and what between its samples."""
        header = ["input", "gain", "+-", "unit", "delay [s]", "+-", "delay [samples]", "+-"]
        model, errors, dt = self.fit.model, self.fit.standard_errors, self.vibration.dt
        rows = []
        for term in inputs_of(model):
            delay, late = self.fit.delays[term.signal]
            rows.append(
                [
                    term.signal,
                    *with_error(model.coefficients[term.key], errors[term.key]),
                    term.unit(model.unit),
                    *(f"{delay:.4g}", f"{late:.2g}", f"{delay / dt:.4g}", f"{late / dt:.2g}"),
                    term.interpolation,
                ]
            )
        note = (
            "The gain of a base is its participation factor. By its delay an input acts later than"
            " it was measured."
        )
        return TextTable("Inputs", [[*header, "between samples"], *rows], note)

    def conclusions(self) -> list[str]:
        """The verdict, and how well what was held out is predicted."""
        return [str(self.fit.verdict), *([str(self.held_out)] if self.held_out else [])]

    def measured(self) -> list[str]:
        """What was measured, and what was done to it."""
        return [repr(self.vibration).splitlines()[0].strip("<>"), *self.vibration.notes]


def pictures(report: ForcedReport) -> list[Picture]:
    """The figures of the report."""
    fit, v, held = report.fit, report.vibration, report.held_out
    orange = " Orange: what was held out, and predicted." if held else ""
    curves = "Undamped motion and damping ratio of the equation without inputs, with 95 % bands."
    one = "one simulation of the equation leaves of it, from the start to the end of the record"
    if report.piece:
        one = f"the equation leaves of pieces of {report.piece:.0f} cycles, each from its own state"
    backbone = []
    if not fit.model.memories:
        if not np.isfinite(report.band.frequency).all():
            curves += " They end where the equation has no periodic motion."
        draw_band = partial(show.draw_band, report.band)
        backbone = [Picture("backbone", "Backbone and damping", curves, draw_band, (6.4, 6.0))]
    return [
        *backbone,
        *functions(fit),
        Picture(
            "motion",
            "Over time",
            f"Input, response, and what {one}.{orange}",
            partial(show.draw_motion, fit, v, held),
            (6.4, 3.4 + 1.4 * len(v.names)),
        ),
        Picture(
            "closer",
            "A closer look",
            "Measured and simulated round the largest response.",
            partial(show.draw_closer, fit),
            (6.4, 3.4),
        ),
        Picture(
            "spectra",
            "Spectra",
            "Of the response and of what is left of it. The noise is taken from the quietest part"
            " of the response: what is left should come down to it, or be as flat.",
            partial(show.draw_spectra, fit),
        ),
    ]


def write_forced(
    report: ForcedReport,
    path: str | Path,
    figures: Iterable[Picture],
    *,
    interactive: bool = False,
) -> None:
    """Write the page with these figures."""
    fit = report.fit
    note = "Standard errors hold for these terms: what the choice of terms leaves open is more."
    write_page(
        path,
        "report",
        "identify",
        title=report.title,
        verdict="explained" if fit.verdict.explained else "not explained",
        sentence="\n".join(
            [*report.conclusions(), *(f"Note: {text.rstrip('.')}." for text in fit.notes)]
        ),
        equation_title="The equation of motion",
        formula=fit.single_model.latex_terms(),
        equation=report.equation(),
        tables=[TextTable("Coefficients", fit.table(), note), report.inputs()],
        pictures=figures,
        interactive=interactive,
        notes=report.measured(),
    )
