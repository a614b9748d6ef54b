"""One self-contained HTML page about an identification."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, select_autoescape
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romsindy.fit.refine import Fit
from romsindy.record.backbone import Backbone
from romsindy.record.decay import Decay
from romsindy.selection.comparison import CERTAIN, Candidate, coefficient_table
from romsindy.selection.select import Selection
from romsindy.show import plots


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
        words = [f"the {c.name} model {_off(c)}" for c in (icrom, stiffness)]
        text = f"Over {len(self.backbone)} cycles {words[0]}; {words[1]}."
        fit = self.selection.fit if self.selection else icrom.fit
        name = f"Chosen, {self.selection.chosen.name}" if self.selection else "IC-ROM"
        explained = f" {name}: {fit.verdict}" if fit else ""
        return text + explained

    def table_note(self) -> str:
        """How the errors in the table were taken."""
        unsure = int(np.sum(self.backbone.frequency_std >= CERTAIN * self.backbone.frequency))
        left_out = f"; cycles known to less than 1 % are left out ({unsure})" if unsure else ""
        return (
            "Backbone error: frequency of the model's undamped motion against that of each cycle,"
            f" at its amplitude{left_out}. {self._errors()}"
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


@dataclass(frozen=True)
class _Picture:
    title: str
    caption: str
    draw: Callable[[Axes], Axes]


def pictures(result: Identification) -> list[_Picture]:
    """The figures of the report: title, caption and how to draw them."""
    both = [result.named("stiffness"), result.named("IC-ROM")]
    models = {c.name: c.fit or c.model for c in both}
    icrom = result.named("IC-ROM").model
    b = result.backbone
    amplitudes = np.linspace(b.amplitude.min(), b.amplitude.max(), 150)
    return [
        _Picture(
            "Decay",
            "The free decay that was analysed, with the peaks of its cycles.",
            lambda ax: plots.plot_decay(result.decay, b, record=result.record, ax=ax),
        ),
        _Picture(
            "Backbone",
            "Each circle is a cycle with its standard error; curves are the undamped models, with"
            " their 95 % bands where they are refined.",
            lambda ax: plots.plot_backbone(b, models, ax=ax),
        ),
        _Picture(
            "Damping",
            "Damping ratio of each cycle, and what the models dissipate.",
            lambda ax: plots.plot_damping(b, models, ax=ax),
        ),
        _Picture(
            "Relative magnitude of the terms",
            "Terms of the IC-ROM over a cycle: which of them matter.",
            lambda ax: plots.plot_relative_magnitude(icrom, amplitudes, ax=ax),
        ),
        _Picture(
            "Residual by harmonic",
            "What the regression leaves. Noise grows with the harmonic squared; what stands out"
            " from that is a missing term.",
            lambda ax: plots.plot_residual({c.name: c.estimator for c in both}, ax=ax),
        ),
        *(_misfit(c.name, c.fit) for c in both if c.fit),
        *(_choice(result.selection) if result.selection else ()),
    ]


def _choice(selection: Selection) -> list[_Picture]:
    name = f"chosen ({selection.chosen.name})"
    return [
        _Picture(
            "Terms that the data ask for",
            f"Chosen: {selection.chosen.name}; {len(selection.equivalent)} others cannot be told"
            " from it. Error of held-out cycles, in squared noise, against size.",
            lambda ax: plots.plot_selection(selection, ax=ax),
        ),
        _misfit(name, selection.fit),
    ]


def _misfit(name: str, fit: Fit) -> _Picture:
    return _Picture(
        f"What the refined {name} model leaves",
        "Residual at the harmonics of the motion over the noise, in windows of eight cycles: near"
        " 1 nothing is missing.",
        lambda ax: plots.plot_misfit(fit, ax=ax),
    )


def write_report(
    result: Identification, path: str | Path, progress: Callable[[Iterable], Iterable] = iter
) -> None:
    """Write the page; ``progress`` may wrap the figures in a progress bar."""
    figures = [
        {"title": p.title, "caption": p.caption, "png": _png(p.draw)}
        for p in progress(pictures(result))
    ]
    page = render(
        "identification.html.j2",
        title=result.title,
        verdict=result.verdict(),
        equation=str(result.named("IC-ROM").model),
        table=coefficient_table(result.candidates),
        table_note=result.table_note(),
        figures=figures,
        notes=[repr(result.decay).splitlines()[0].strip("<>"), *result.decay.notes],
    )
    Path(path).write_text(page, encoding="utf-8")


def render(template: str, **content: Any) -> str:
    """The text of a page from one of the package's templates."""
    from romsindy import __version__

    environment = Environment(
        loader=PackageLoader("romsindy.show"), autoescape=select_autoescape(["j2"])
    )
    return environment.get_template(template).render(version=__version__, **content)


def _png(draw: Callable[[Axes], Axes]) -> str:
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    draw(figure.subplots())
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130)
    return base64.b64encode(buffer.getvalue()).decode()
