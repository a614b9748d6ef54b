"""One self-contained HTML page about equations of several coordinates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from romsindy.fit.fitted import Fit
from romsindy.fit.record import in_pieces
from romsindy.fit.small_vibrations import SmallVibration
from romsindy.orbits.continuation import ContinuationError
from romsindy.orbits.curves import BackboneCurve, backbone_curve
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.show.coupled_plots import draw_backbones, draw_channel
from romsindy.show.identification_page import told_of
from romsindy.show.page import Picture, write_page
from romsindy.show.panels import functions
from romsindy.text import TextTable, quantity, with_error

_LOW = 0.02  # of the largest amplitude: there a backbone begins
_INCHES = 3.4  # height of one panel


@dataclass(frozen=True, eq=False)
class CoupledReport:
    """What was identified of several coordinates, as the page and the command line need it.

    Attributes
    ----------
    title : str
    fit : Fit
    modes : sequence of SmallVibration
    decays : sequence of Decay or ForcedVibration
        Whole, as the fit was given them.
    channels : sequence of str
        Names of what was measured.
    picked : str
        What was used of the record, and what was left out.
    """

    title: str
    fit: Fit
    modes: Sequence[SmallVibration]
    decays: Sequence[Decay | ForcedVibration]
    channels: Sequence[str]
    picked: str = ""

    @property
    def interrupted(self) -> bool:
        """Whether the user wished to stop before the fit came to its end."""
        return self.fit.solution.interrupted

    @cached_property
    def backbones(self) -> dict[int, BackboneCurve | str]:
        """The backbone of each mode, by its number; or why it has none, in a sentence."""
        return {mode.number: self._backbone(mode) for mode in self.modes}

    def _backbone(self, mode: SmallVibration) -> BackboneCurve | str:
        high = float(mode.measured_amplitude.max())
        reach = (_LOW * high, high)
        try:
            return backbone_curve(self.fit.model.undamped(), amplitude=reach, mode=mode.number)
        except (ValueError, ContinuationError) as error:
            return f"no backbone: {error}"

    def equations(self) -> str:
        """A line for each coordinate."""
        model = self.fit.model
        return f"{model.equation()}    (q in {model.unit or '[q]'}, t in s)"

    def tables(self) -> list[TextTable]:
        """Modes of small vibrations, and what channels show of the coordinates."""
        header = ["mode", "frequency [Hz]", "+-", "damping ratio [%]", "+-", "moves", "amplitude"]
        curved, unit = self.fit.curved_shapes, self.fit.model.unit or "[q]"
        columns = np.column_stack([self.fit.mode_shapes, *curved.values()])
        shapes = [
            [name, *(f"{x:.4g}" for x in row)]
            for name, row in zip(self.channels, columns, strict=True)
        ]
        coordinates = [f"q{i + 1}" for i in range(self.fit.mode_shapes.shape[1])]
        return [
            TextTable(
                "Modes",
                [header, *map(self._row, self.modes)],
                "Frequency and damping ratio are those of small vibrations, given these terms."
                " Amplitudes are those of the coordinate that moves most, in all decays.",
            ),
            TextTable(
                "Mode shapes",
                [["channel", *coordinates, *curved], *shapes],
                "What each channel shows of each coordinate: 1 where that moves it most"
                f"{f'; and of their products, per power of {unit}' if curved else ''}.",
            ),
        ]

    def _row(self, mode: SmallVibration) -> list[str]:
        unit = self.fit.model.unit or "[q]"
        ends = (float(mode.measured_amplitude.max()), float(mode.measured_amplitude.min()))
        return [
            str(mode.number),
            *with_error(mode.frequency, mode.frequency_std),
            *with_error(100 * mode.damping_ratio, 100 * mode.damping_ratio_std),
            f"q{mode.coordinate}",
            " to ".join(quantity(a, unit) for a in ends),
        ]

    def coefficients(self) -> TextTable:
        """Every coefficient with its standard error."""
        note = "Standard errors hold for these terms: what the choice of terms leaves open is more."
        return TextTable("Coefficients", self.fit.table(), note)

    def notes(self) -> list[str]:
        """What was measured, and what was done to it."""
        return told_of(self.decays)


def pictures(report: CoupledReport) -> list[Picture]:
    """The figures of the report: backbones, functions, and every channel over time."""
    told = [
        f"Mode {number}: {b if isinstance(b, str) else b.stop_reason}."
        for number, b in report.backbones.items()
    ]
    caption = (
        "Undamped periodic motion of each mode, as the equations have it; a line for each"
        " coordinate. Dots: the vibration in the decays, which the other coordinates move, too."
    )
    size = (6.4, _INCHES * len(report.modes))
    draw = partial(draw_backbones, report.modes, report.backbones, report.fit.model.unit)
    return [
        Picture("backbone", "Backbones", " ".join([caption, *told]), draw, size),
        *functions(report.fit),
        *_channels(report),
    ]


def _channels(report: CoupledReport) -> list[Picture]:
    """Each channel of the decay, or piece of one, of which the equations leave most."""
    fit = report.fit
    left = [
        float(np.sqrt(np.mean(record.whitened(residual) ** 2)))
        for record, residual in zip(fit.records, fit.residuals, strict=True)
    ]
    worst = int(np.argmax(left))
    what = "piece" if in_pieces(fit.records) else "decay"
    which = f" {what.capitalize()} {worst + 1}, the worst of {len(left)}." if len(left) > 1 else ""
    caption = (
        "Top: measured and simulated. Middle: the first cycles. Bottom: what one simulation of the"
        f" equations leaves of the {what} from its start to its end, over the noise.{which}"
    )
    slowest = min(mode.frequency for mode in report.modes)
    return [
        Picture(
            f"channel_{i + 1}",
            f"Over time: {name}",
            caption,
            partial(draw_channel, fit, worst, i, slowest),
            (6.4, 5.4),
        )
        for i, name in enumerate(report.channels)
    ]


def write_coupled(
    report: CoupledReport,
    path: str | Path,
    figures: Iterable[Picture],
    *,
    interactive: bool = False,
) -> None:
    """Write the page with figures, those of `pictures` and others."""
    fit = report.fit
    notes = report.notes()
    write_page(
        path,
        "report",
        "identify",
        title=report.title,
        verdict="explained" if fit.verdict.explained else "not explained",
        sentence="\n".join([str(fit.verdict), *(f"Note: {note}." for note in fit.notes)]),
        equation_title="The equations of motion",
        equation=report.equations(),
        tables=[report.coefficients(), *report.tables()],
        pictures=figures,
        interactive=interactive,
        notes=[report.picked, *notes] if report.picked else notes,
    )
