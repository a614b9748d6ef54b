"""One self-contained HTML page about a fit to steady states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romsindy.fit.forced_band import ForcedBand
from romsindy.fit.steady.fit import SteadyFit
from romsindy.orbits.continuation import ContinuationError
from romsindy.record.recording import unit_of
from romsindy.show.axes import with_unit
from romsindy.show.page import Picture, write_page
from romsindy.show.panels import functions
from romsindy.show.plots import plot_forced_response
from romsindy.text import TextTable, with_error

_LEVEL = 0.02  # part of the force by which those of one level differ at most
_MOST = 6  # levels whose curves are told apart


@dataclass(frozen=True, eq=False)
class SteadyReport:
    """What was fitted to steady states, as the page and the command line need it.

    Attributes
    ----------
    title : str
    fit : SteadyFit
    force_unit : str or None
        Of the excitation.
    """

    title: str
    fit: SteadyFit
    force_unit: str | None

    @cached_property
    def curves(self) -> Mapping[float, ForcedBand | str]:
        """The response to each level of force, with its band; or why there is none."""
        points, found = self.fit.points, {}
        for number in range(int(points.level.max()) + 1):
            mine = points.level == number
            force, w = np.abs(points.force[mine]), points.frequency[mine]
            if np.ptp(force) <= _LEVEL * force.max() and np.ptp(w) > 0:
                found[float(force.mean())] = self._curve(
                    float(force.mean()), (float(w.min()), float(w.max()))
                )
        return found if len(found) <= _MOST else {}

    def _curve(self, force: float, within: tuple[float, float]) -> ForcedBand | str:
        try:
            return self.fit.forced_response(force, within)
        except (ValueError, ContinuationError) as error:
            return str(error)

    def chain(self) -> TextTable:
        """From the excitation, as measured, to a force per unit mass."""
        errors, chain = self.fit.chain_errors, vars(self.fit.chain)
        rows = [
            [name, *(with_error(value, errors[name]) if name in errors else [f"{value:.5g}", "-"])]
            for name, value in chain.items()
        ]
        note = "Force per unit mass: (gain + slope |F|) exp(i phase) F, with F as measured."
        return TextTable("The excitation", [["", "value", "+-"], *rows], note)

    def notes(self) -> list[str]:
        """What was measured, and of which levels there is no curve."""
        points = self.fit.points
        w, unit = points.frequency / (2 * np.pi), self.force_unit or "its unit"
        size = np.abs(points.force)
        measured = (
            f"{len(points)} steady states, {points.measured} under {size.min():.4g} to"
            f" {size.max():.4g} {unit}, {w.min():.5g} to {w.max():.5g} Hz"
        )
        missing = {f: why for f, why in self.curves.items() if isinstance(why, str)}
        return [measured, *(f"no curve at {f:.4g} {unit}: {why}" for f, why in missing.items())]


def pictures(report: SteadyReport) -> list[Picture]:
    """The figures of the report."""
    return [
        Picture(
            "response",
            "Response",
            "Dots are the steady states that were measured, lines the equation at each level of"
            " force, with the 95 % band of a further point; dashed where unstable.",
            partial(_draw_response, report),
        ),
        *functions(report.fit),
        Picture(
            "misfit",
            "Force left over",
            "What the equation leaves of the force at every point, as a part of it: points that"
            " stand off their neighbours had not settled.",
            partial(_draw_misfit, report.fit),
        ),
    ]


def _draw_response(report: SteadyReport, figure: Figure) -> None:
    ax: Axes = figure.subplots()
    points, unit = report.fit.points, report.force_unit or ""
    for i, (force, band) in enumerate(report.curves.items()):
        if isinstance(band, ForcedBand):
            plot_forced_response(band, label=f"{force:.4g} {unit},", color=f"C{i}", ax=ax)
    size = points.amplitude * points.frequency**points.rate
    hz = points.frequency / (2 * np.pi)
    ax.plot(hz, size, ".", color="0.2", ms=4, zorder=3, label="measured")
    ax.set(xlabel="frequency (Hz)")
    ax.set_ylabel(with_unit(points.measured, unit_of(points.measured, report.fit.model.unit)))
    handles, labels = ax.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))  # the band and a fold are named once
    ax.legend(once.values(), once.keys(), loc="best", frameon=False, fontsize="small")


def _draw_misfit(fit: SteadyFit, figure: Figure) -> None:
    ax: Axes = figure.subplots()
    points = fit.points
    for number in range(int(points.level.max()) + 1):
        mine = points.level == number
        label = f"{np.abs(points.force[mine]).mean():.4g}"
        left = 100 * np.abs(fit.misfit[mine])
        ax.plot(points.frequency[mine] / (2 * np.pi), left, ".-", lw=0.7, ms=4, label=label)
    ax.set(xlabel="frequency (Hz)", ylabel="force left over (%)")
    ax.set_ylim(0, None)
    ax.legend(loc="best", frameon=False, title="force")


def write_steady(
    report: SteadyReport,
    path: str | Path,
    figures: Iterable[Picture],
    *,
    interactive: bool = False,
) -> None:
    """Write the page with these figures."""
    fit = report.fit
    write_page(
        path,
        "report",
        "steady",
        title=report.title,
        verdict="explained" if fit.verdict.explained else "not explained",
        sentence="\n".join([str(fit.verdict), *fit.remarks()]),
        equation_title="The equation of motion",
        formula=fit.single_model.latex_terms(),
        equation=f"{fit.model.equation()}    (q in {fit.model.unit or '[q]'}, t in s)",
        tables=[TextTable("Coefficients", fit.table()), report.chain()],
        pictures=figures,
        interactive=interactive,
        notes=report.notes(),
    )
