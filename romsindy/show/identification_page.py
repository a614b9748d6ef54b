"""One self-contained HTML page about an identification."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from romsindy.fit.functions.identification import Identification
from romsindy.record.backbone import CERTAIN, Backbone, joined
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.regression.comparison import (
    Candidate,
    Judged,
    coefficient_table,
    negative_damping,
    negative_inertia,
)
from romsindy.show import function_plots, plots
from romsindy.show.cycles import Models
from romsindy.show.page import Picture, write_page
from romsindy.show.panels import functions
from romsindy.text import TextTable, listed

_CURVE = 60  # points of a band against amplitude


@dataclass(frozen=True, eq=False)
class IdentificationReport:
    """What one identification produced, as the page and the command line need it.

    Attributes
    ----------
    title : str
    decays : sequence of Decay
        What was analysed, with derivatives.
    backbones : sequence of Backbone
        One for each.
    candidates : sequence of Judged
        Columns of the table; the identified equation first, where there is one.
    main : Judged
        Whose equation is printed.
    found : Identification or None
        None where regressions alone were asked for, or nothing else was possible.
    trouble : str
        Why nothing else was possible.
    picked : str
        What was used of the record, and what was left out.
    interrupted : bool
        Whether the trouble is that the user wished to stop.
    """

    title: str
    decays: Sequence[Decay]
    backbones: Sequence[Backbone]
    candidates: Sequence[Judged]
    main: Judged
    found: Identification | None = None
    trouble: str = ""
    picked: str = ""
    interrupted: bool = False

    @cached_property
    def backbone(self) -> Backbone:
        """The cycles of all decays."""
        return joined(self.backbones)

    @property
    def shown(self) -> list[Judged]:
        """Models with estimated linear frequency, or all where it was given."""
        return [c for c in self.candidates if "fixed" not in c.name]

    @cached_property
    def equation(self) -> str:
        """The equation, with all that is said of it."""
        return str(self.found or self.main.model)

    def errors(self) -> str:
        """One sentence on how the models follow the backbone."""
        words = "; ".join(f"the {c.name} model {_off(c)}" for c in self.shown)
        return f"{self.trouble} {self._over(words)}".strip()

    def missed(self) -> str:
        """The same of the model alone whose equation is printed."""
        return self._over(f"it {_off(self.main)}")

    def _over(self, words: str) -> str:
        judges = int(np.sum(self.backbone.certain))
        if not judges:
            return (
                f"The frequency of no cycle is known to {100 * CERTAIN:g} %: none judges a model."
            )
        return f"Over {judges} cycles {words}."

    def table(self) -> list[list[str]]:
        """Coefficients and backbone errors: of series those that regressions have too."""
        regressions = [c for c in self.candidates if isinstance(c, Candidate)]
        keys = dict.fromkeys(k for c in regressions for k in c.model.coefficients)
        forces = self.found.structure.forces if self.found is not None else ()
        return coefficient_table(self.candidates, [*keys, *(f for f in forces if f not in keys)])

    def note(self) -> str:
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
        if self.found is not None:
            text += (
                " Those of the identified model include what the choice of structure leaves open;"
                " of its series, the table has the coefficients that the regressions have too."
            )
        return " ".join([text, *self.impossible()])

    def notes(self) -> list[str]:
        """What was measured, and what was done to it."""
        return told_of(self.decays)

    def impossible(self) -> list[str]:
        """What no structure does, and a model in the table has: a sentence for each."""
        sentences = []
        low, high = min(d.q.min() for d in self.decays), max(d.q.max() for d in self.decays)
        for c in self.candidates:
            first = negative_inertia(c.model, low, high)
            if first is not None:
                sentences.append(
                    f"{c.name}: its inertia h(q) is negative within the data, first at |q| ="
                    f" {first:.3g} {c.model.unit or '[q]'}: no motion of a structure does that."
                )
            negative = negative_damping(c)
            if negative:
                sentences.append(
                    f"{c.name}: its {listed(negative)} is negative: a force that would supply"
                    " energy, which no damping does."
                )
        return sentences


def told_of(decays: Sequence[Decay | ForcedVibration]) -> list[str]:
    """What records are, and what was done to them; what holds for several of them once."""
    lines = [line for d in decays for line in (repr(d).splitlines()[0].strip("<>"), *d.notes)]
    return list(dict.fromkeys(lines))


def _off(candidate: Judged) -> str:
    if candidate.lost:
        return f"has no motion at {candidate.lost} of the measured amplitudes"
    return (
        f"misses the measured frequency by {100 * candidate.rms_error:.2g} % rms,"
        f" {100 * candidate.max_error:.2g} % at most"
    )


def pictures(report: IdentificationReport) -> list[Picture]:
    """The figures of the report: title, caption and how to draw them."""
    b, found = report.backbone, report.found
    amplitudes = np.linspace(b.amplitude.min(), b.amplitude.max(), _CURVE)
    band = {} if found is None else {report.main.name: found.band(amplitudes)}
    others = {c.name: c.model for c in report.shown if c.name not in band}
    models: Models = {**band, **others}
    inner = _of_regressions(report) if found is None else _of_functions(found, others)
    return [
        _picture(
            "decay",
            "Decay",
            "The free decay that was analysed, with the peaks of its cycles.",
            partial(_plot_decays, report),
        ),
        _picture(
            "backbone",
            "Backbone",
            "Each circle is a cycle with its standard error; curves are the undamped models, the"
            " identified one with its 95 % band.",
            partial(plots.plot_backbone, report.backbones, models),
        ),
        _picture(
            "damping",
            "Damping",
            "Damping ratio of each cycle, and what the models dissipate.",
            partial(plots.plot_damping, report.backbones, models),
        ),
        *inner,
    ]


def _plot_decays(report: IdentificationReport, ax: Axes) -> None:
    for decay, backbone in zip(report.decays, report.backbones, strict=True):
        plots.plot_decay(decay, backbone, ax=ax)
        # One legend for all of them.
        handles, labels = ax.get_legend_handles_labels()
        ax.legend(handles[:2], labels[:2], loc="upper right", frameon=False)


def _of_functions(found: Identification, others: dict) -> list[Picture]:
    return [
        *functions(found, others),
        _picture(
            "parts",
            "Relative magnitude of the terms",
            "Inertia beyond 1, stiffness beyond omega^2 and damping over a cycle, with 95 % bands:"
            " which of them matter.",
            partial(function_plots.plot_parts, found),
        ),
        _picture(
            "misfit",
            "What the equation leaves",
            "Residual at the harmonics of the motion over the noise, in windows of eight cycles:"
            " near 1 nothing is missing; single points scatter by chance.",
            partial(plots.plot_misfit, found),
        ),
        *_motion(found),
    ]


def _motion(found: Identification) -> list[Picture]:
    """The record of which the equation leaves most; nothing where it has no motion."""
    if not all(np.isfinite(residual).all() for residual in found.residuals):
        return []
    left = [
        float(np.std(residual)) / record.noise.std
        for record, residual in zip(found.records, found.residuals, strict=True)
    ]
    worst = int(np.argmax(left))
    which = f" Decay {worst + 1}, the worst of {len(left)}." if len(left) > 1 else ""
    caption = (
        "Below: what one simulation of the equation leaves of the record from its start to its"
        f" end, {left[worst]:.3g} times the noise.{which}"
    )
    return [
        Picture("motion", "Over time", caption, partial(function_plots.draw_motion, found, worst))
    ]


def _of_regressions(report: IdentificationReport) -> list[Picture]:
    b, model = report.backbone, report.main.model
    amplitudes = np.linspace(b.amplitude.min(), b.amplitude.max(), 150)
    estimators = {c.name: c.estimator for c in report.shown if isinstance(c, Candidate)}
    return [
        _picture(
            "relative_magnitude",
            "Relative magnitude of the terms",
            f"Terms of the {report.main.name} over a cycle: which of them matter.",
            partial(plots.plot_relative_magnitude, model, amplitudes),
        ),
        _picture(
            "residual",
            "Residual by harmonic",
            "What the regression leaves. Noise grows with the harmonic squared; what stands out"
            " from that is a missing term.",
            partial(plots.plot_residual, estimators),
        ),
    ]


def _picture(name: str, title: str, caption: str, plot: Callable[..., object]) -> Picture:
    return Picture(name, title, caption, lambda figure: plot(ax=figure.subplots()))


def _found_or_not(report: IdentificationReport) -> dict[str, Any]:
    """Banner, equation and tables, with the functions where they were identified."""
    beside = TextTable("Coefficients and backbone errors", report.table(), report.note())
    found, model = report.found, report.main.model
    if found is None:
        formula = model.latex_terms()
        words = {"sentence": report.errors(), "equation": str(model)}
        return {**words, "formula": formula, "tables": [beside]}
    explained, *determined = found.conclusions()
    return {
        "verdict": "explained" if found.verdict.explained else "not explained",
        "sentence": "\n".join([explained, report.errors()]),
        "formula": found.short.model.latex_terms(),
        "equation": "\n".join(found.opening()[:2]),  # the short one is the formula
        "equation_note": " ".join([f"Of the short equation: {found.off()}.", *determined]),
        "tables": [*found.tables(), beside],
    }


def write_identification(
    report: IdentificationReport,
    path: str | Path,
    figures: Iterable[Picture],
    *,
    interactive: bool = False,
    command: str = "identify",
) -> None:
    """Write the page with figures, those of `pictures` and others; a ``command`` makes it."""
    write_page(
        path,
        "report",
        command,
        title=report.title,
        equation_title="The equation of motion",
        **_found_or_not(report),
        pictures=figures,
        interactive=interactive,
        notes=[report.picked, *report.notes()] if report.picked else report.notes(),
    )
