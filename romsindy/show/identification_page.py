"""One self-contained HTML page about an identification."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from romsindy.fit.functions.identification import Identification
from romsindy.record.backbone import CERTAIN, Backbone
from romsindy.record.decay import Decay
from romsindy.regression.comparison import Candidate, Judged, coefficient_table, negative_inertia
from romsindy.show import function_plots, plots
from romsindy.show.page import Picture, write_page
from romsindy.text import TextTable

_CURVE = 60  # points of a band against amplitude


@dataclass(frozen=True, eq=False)
class IdentificationReport:
    """What one identification produced, as the page and the command line need it.

    Attributes
    ----------
    title : str
    record, decay : Decay
        As it was read, and its free part with derivatives.
    backbone : Backbone
    candidates : sequence of Judged
        Columns of the table; the identified equation first, where there is one.
    main : Judged
        Whose equation is printed.
    found : Identification or None
        None where regressions alone were asked for, or nothing else was possible.
    trouble : str
        Why nothing else was possible.
    """

    title: str
    record: Decay
    decay: Decay
    backbone: Backbone
    candidates: Sequence[Judged]
    main: Judged
    found: Identification | None = None
    trouble: str = ""

    @property
    def shown(self) -> list[Judged]:
        """Models with estimated linear frequency, or all where it was given."""
        return [c for c in self.candidates if "fixed" not in c.name]

    @property
    def equation(self) -> str:
        """The equation, with all that is said of it."""
        return str(self.found or self.main.model)

    def errors(self) -> str:
        """One sentence on how the models follow the backbone."""
        words = "; ".join(f"the {c.name} model {_off(c)}" for c in self.shown)
        text = f"Over {int(np.sum(self.backbone.certain))} cycles {words}."
        return f"{self.trouble} {text}".strip()

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
        return " ".join([text, *self._impossible()])

    def _impossible(self) -> list[str]:
        sentences = []
        for c in self.candidates:
            first = negative_inertia(c.model, self.decay.q.min(), self.decay.q.max())
            if first is not None:
                sentences.append(
                    f"{c.name}: its inertia h(q) is negative within the data, first at |q| ="
                    f" {first:.3g} {c.model.unit or '[q]'}: no motion of a structure does that."
                )
        return sentences


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
    models: plots.Models = {**band, **others}
    inner = _of_regressions(report) if found is None else _of_functions(found, others)
    return [
        _picture(
            "decay",
            "Decay",
            "The free decay that was analysed, with the peaks of its cycles.",
            partial(plots.plot_decay, report.decay, b, record=report.record),
        ),
        _picture(
            "backbone",
            "Backbone",
            "Each circle is a cycle with its standard error; curves are the undamped models, the"
            " identified one with its 95 % band.",
            partial(plots.plot_backbone, b, models),
        ),
        _picture(
            "damping",
            "Damping",
            "Damping ratio of each cycle, and what the models dissipate.",
            partial(plots.plot_damping, b, models),
        ),
        *inner,
    ]


def _of_functions(found: Identification, others: dict) -> list[Picture]:
    return [
        _picture(
            "inertia",
            "Inertia",
            "M(q) = 1 + h(q) with its 95 % band. h is the kinetic energy of what the vibration"
            " drags along and is never negative; a regression does not know that.",
            partial(function_plots.plot_inertia, found, others),
        ),
        _picture(
            "stiffness",
            "Stiffness",
            "Restoring force over displacement with its 95 % band.",
            partial(function_plots.plot_stiffness, found, others),
        ),
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
            " near 1 nothing is missing.",
            partial(plots.plot_misfit, found),
        ),
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


def write_identification(
    report: IdentificationReport,
    path: str | Path,
    figures: Iterable[Picture],
) -> None:
    """Write the page with figures, those of `pictures`."""
    write_page(
        path,
        "report",
        title=report.title,
        sentence=report.errors(),
        equation_title="The equation of motion",
        equation=report.equation,
        tables=[TextTable("Coefficients and backbone errors", report.table(), report.note())],
        pictures=figures,
        notes=[repr(report.decay).splitlines()[0].strip("<>"), *report.decay.notes],
    )
