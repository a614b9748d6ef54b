"""Figures of several coordinates: backbones of their modes, channels over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from romsindy.fit.fitted import Fit
from romsindy.fit.small_vibrations import SmallVibration
from romsindy.orbits.curves import BackboneCurve
from romsindy.record.recording import unit_of
from romsindy.show.axes import with_unit
from romsindy.show.plots import plot_branch

_CYCLES = 10  # of the slowest mode, where one looks closely


def draw_backbones(
    modes: Sequence[SmallVibration],
    backbones: Mapping[int, BackboneCurve | str],
    unit: str | None,
    figure: Figure,
) -> None:
    """A panel for each mode: its backbone, if there is one, over what was measured."""
    panels = figure.subplots(len(modes), 1, squeeze=False)[:, 0]
    for ax, mode in zip(panels, modes, strict=True):
        ax.set_title(f"mode {mode.number}", loc="left", fontsize="medium")
        label = f"q{mode.coordinate} in the decays"
        ax.plot(
            mode.measured_frequency, mode.measured_amplitude, ".", ms=3, color="0.7", label=label
        )
        ax.set(xlabel="frequency (Hz)", ylabel=with_unit("amplitude", unit))
        ax.legend(frameon=False)
        backbone = backbones[mode.number]
        if isinstance(backbone, BackboneCurve):
            plot_branch(backbone, label="backbone", ax=ax)


def draw_channel(fit: Fit, decay: int, channel: int, slowest: float, figure: Figure) -> None:
    """One channel of a decay: all of it, its first cycles, and what a simulation leaves of it."""
    record, residual = fit.records[decay], fit.residuals[decay]
    t, quantity = record.decay.t, record.decay.measured
    measured, simulated, left = (
        x.reshape(-1, len(t))[channel]
        for x in (record.signal, record.signal - residual, record.whitened(residual))
    )
    *above, below = figure.subplots(3, 1)
    for ax, end in zip(above, (t[-1], t[0] + _CYCLES / slowest), strict=True):
        part = t <= end
        ax.plot(t[part], measured[part], color="0.5", lw=1.0, label="measured")
        ax.plot(t[part], simulated[part], ":", color="C0", lw=1.2, label="simulated")
        ax.set_ylabel(with_unit(quantity, unit_of(quantity, record.decay.unit)))
    below.plot(t, left, color="C0", lw=0.6)
    below.set(xlabel="time (s)", ylabel="residual over noise")
    figure.legend(handles=above[0].lines, loc="outside upper right", ncols=2, frameon=False)
