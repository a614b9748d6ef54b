"""Figures of what an equation does: backbones of modes, bands, the response to levels of force."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romsindy.fit.estimate import Band
from romsindy.fit.forced_band import ForcedBand
from romsindy.fit.small_vibrations import SmallVibration
from romsindy.fit.steady.fit import SteadyFit
from romsindy.orbits.curves import BackboneCurve
from romsindy.record.recording import unit_of
from romsindy.show.axes import with_unit
from romsindy.show.plots import plot_branch, plot_forced_response
from romsindy.typing import Indices

_SIGMAS_95 = 1.96


def draw_modes(
    modes: Sequence[SmallVibration],
    backbones: Mapping[int, BackboneCurve | str],
    unit: str | None,
    figure: Figure,
) -> None:
    """Axes for each mode: its backbone, if there is one, over what was measured."""
    rows = figure.subplots(len(modes), 1, squeeze=False)[:, 0]
    for ax, mode in zip(rows, modes, strict=True):
        ax.set_title(f"mode {mode.number}", loc="left", fontsize="medium")
        rings = np.isfinite(mode.measured_frequency)
        if np.any(rings):
            seen = mode.measured_frequency[rings], mode.measured_amplitude[rings]
            ax.plot(*seen, ".", ms=3, color="0.7", label=f"q{mode.coordinate} in the decays")
            ax.legend(frameon=False)
        ax.set(xlabel="frequency (Hz)", ylabel=with_unit("amplitude", unit))
        backbone = backbones[mode.number]
        if isinstance(backbone, BackboneCurve):
            plot_branch(backbone, label="backbone", ax=ax)


def draw_band(band: Band, figure: Figure) -> None:
    """Frequency, and damping ratio, against amplitude."""
    above, below = figure.subplots(2, 1, sharex=True)
    hertz, percent = 2 * np.pi, 0.01
    for ax, values, std in (
        (above, band.frequency / hertz, band.frequency_std / hertz),
        (below, band.damping_ratio / percent, band.damping_ratio_std / percent),
    ):
        reach = _SIGMAS_95 * std
        ends = values - reach, values + reach
        ax.fill_between(band.amplitude, *ends, color="C0", alpha=0.25, lw=0)
        ax.plot(band.amplitude, values, color="C0")
        ax.margins(x=0.01)
    above.set(ylabel="frequency (Hz)")
    below.set(ylabel="damping ratio (%)", xlabel=with_unit("amplitude", band.unit))


def draw_levels(
    fit: SteadyFit, curves: Mapping[float, ForcedBand | str], unit: str | None, figure: Figure
) -> None:
    """Steady states, and the response to each level of force, whose unit is given."""
    ax: Axes = figure.subplots()
    points = fit.points
    for i, (force, band) in enumerate(curves.items()):
        if isinstance(band, ForcedBand):
            plot_forced_response(band, label=f"{force:.4g} {unit or ''},", color=f"C{i}", ax=ax)
    size = points.amplitude * points.frequency**points.rate
    hz = points.frequency / (2 * np.pi)
    ax.plot(hz, size, ".", color="0.2", ms=4, zorder=3, label="measured")
    ax.set(xlabel="frequency (Hz)")
    ax.set_ylabel(with_unit(points.measured, unit_of(points.measured, fit.model.unit)))
    handles, labels = ax.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))  # the band and a fold are named once
    ax.legend(once.values(), once.keys(), loc="best", frameon=False, fontsize="small")


def draw_force_left(fit: SteadyFit, figure: Figure) -> None:
    """Force that is left over at every steady state, in per cent, by level."""
    ax: Axes = figure.subplots()
    hz = fit.points.frequency / (2 * np.pi)
    for force, mine in levels_of(fit):
        left = 100 * np.abs(fit.misfit[mine])
        ax.plot(hz[mine], left, ".-", lw=0.7, ms=4, label=f"{force:.4g}")
    ax.set(xlabel="frequency (Hz)", ylabel="force left over (%)")
    ax.set_ylim(0, None)
    ax.legend(loc="best", frameon=False, title="force")


def levels_of(fit: SteadyFit) -> Iterator[tuple[float, Indices]]:
    """Mean amplitude of the excitation of each level, and which of the points are of it."""
    level, size = fit.points.level, np.abs(fit.points.force)
    for number in range(int(level.max()) + 1):
        mine = np.flatnonzero(level == number)
        yield float(size[mine].mean()), mine
