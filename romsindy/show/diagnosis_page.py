"""One self-contained HTML page about a diagnosis."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, select_autoescape
from matplotlib.figure import Figure

from romsindy.diagnosis.report import DiagnosisReport
from romsindy.show import diagnosis_plots


def drawn(report: DiagnosisReport) -> list[tuple[str, Figure, str]]:
    """Title, figure and line of reading of every picture."""
    single = (
        ("Before and after", diagnosis_plots.draw_gap),
        ("By phase", diagnosis_plots.draw_phase),
        ("By harmonic", diagnosis_plots.draw_harmonics),
        ("Over time", diagnosis_plots.draw_time),
        ("By record", diagnosis_plots.draw_records),
    )
    pictures = []
    for title, draw in single:
        figure = Figure(figsize=(5.4, 3.8), layout="constrained")
        pictures.append((title, figure, draw(report, figure.subplots())))
    figure = Figure(figsize=(5.4, 4.6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    reading = diagnosis_plots.draw_amplitude(report, axes)
    axes[0].set_xlabel("")
    pictures.insert(1, ("By amplitude", figure, reading))
    return pictures


def write_page(
    report: DiagnosisReport,
    path: str | Path,
    *,
    verdict: str | None = None,
    sentence: str | None = None,
    simulation: str | None = None,
    tables: Sequence[tuple[str, list[list[str]]]] = (),
    pictures: Sequence[tuple[str, Figure, str]] = (),
) -> None:
    """Write the page.

    Parameters
    ----------
    report : DiagnosisReport
    path : str or Path
    verdict, sentence, simulation : str, optional
        Instead of those of the report; the simulation is that with the effects added.
    tables, pictures
        More tables (title, rows) and pictures (title, figure, line of reading).
    """
    from romsindy import __version__

    environment = Environment(
        loader=PackageLoader("romsindy.show"), autoescape=select_autoescape(["j2"])
    )
    gaps = [("The gap, before and after", report.gap.table()), *tables]
    page = environment.get_template("diagnosis.html.j2").render(
        title="What the simulation lacks",
        verdict=verdict or report.verdict,
        sentence=sentence or report.sentence,
        tables=[*gaps, ("Explanations that the data allow", report.table())],
        simulation=simulation or str(report.model),
        outside=[] if simulation else _outside(report),
        figures=[
            {"title": title, "caption": reading, "png": _png(figure)}
            for title, figure, reading in (*drawn(report), *pictures)
        ],
        notes=[repr(r.decay).splitlines()[0].strip("<>") for r in report.records],
        version=__version__,
    )
    Path(path).write_text(page, encoding="utf-8")


def _outside(report: DiagnosisReport) -> list[str]:
    """Labels of the effects that are no terms of the equation of motion."""
    parts = report.best.solution.parts
    terms = {p.effect.name for p in parts if p.effect.term() is not None}
    return [e.label for e in report.effects if e.name not in terms]


def _png(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130)
    return base64.b64encode(buffer.getvalue()).decode()
