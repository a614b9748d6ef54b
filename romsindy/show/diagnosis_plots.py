"""Figures of a diagnosis, from arrays. Every function draws into an empty Figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from romsindy.record.backbone import Backbone
from romsindy.record.noise import Noise
from romsindy.show.axes import Fact, log_ratio, of_cycles, tell, with_unit
from romsindy.show.compared import COLORS, Compared, draw_over_time, draw_spectra, spectrum_of
from romsindy.typing import Array

BEFORE, AFTER = COLORS
_LOOKS: dict[str, dict[str, Any]] = {
    "measured": {"color": "0.4", "ls": "", "marker": "o", "ms": 3},
    "before": {"color": BEFORE, "lw": 2.4},  # seen where both agree
    "after": {"color": AFTER, "lw": 1.2},
}


def draw_errors_in_time(
    t: Array, measured: Array, before: Array, after: Array, quantity: str, unit: str, figure: Figure
) -> None:
    """A record, and what a simulation misses of it before and after; all (n,).

    nan where nothing is compared. The simulated motions show where one can zoom.
    """
    missed = {"before": before, "after": after}
    draw_over_time(Compared(t, measured, missed, quantity, unit), figure)


def draw_backbones(
    backbones: Mapping[str, Backbone], quantity: str, unit: str, figure: Figure
) -> None:
    """Frequency and damping ratio of every cycle: "measured", "before", "after"."""
    above, below = figure.subplots(2, 1, sharex=True)
    for name, backbone in backbones.items():
        look = _LOOKS[name] | {"label": name}
        hz, percent = backbone.frequency / (2 * np.pi), 100 * backbone.damping_ratio
        for ax, read in ((above, hz), (below, percent)):
            (cycles,) = ax.plot(backbone.amplitude, read, **look)
            tell(cycles, *of_cycles(backbone))
    above.set_ylabel("frequency (Hz)")
    below.set(xlabel=with_unit(f"amplitude of the {quantity}", unit), ylabel="damping ratio (%)")
    above.legend(frameon=False, fontsize="small")


def draw_plane(radius: Array, angle: Array, force: Array, figure: Figure) -> None:
    """A force over rings (r + 1,) and sectors (s + 1,) of the (q, q_dot) plane, (r, s)."""
    ax = figure.subplots()
    top = 100 * float(np.nanmax(np.abs(force)))
    x, y = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    image = ax.pcolormesh(x, y, 100 * force, cmap="RdBu_r", vmin=-top, vmax=top)
    figure.colorbar(image, ax=ax, label="missing force (% of largest restoring force)")
    ax.set(xlabel="q / largest", ylabel="q_dot / largest", aspect="equal")


def draw_harmonics(before: Array, after: Array, figure: Figure) -> None:
    """Missing force by harmonic, (2, n) each: in phase with q, and with q_dot."""
    ax = figure.subplots()
    orders = np.arange(before.shape[1])
    bars = [
        (before[0], BEFORE, 1.0, "before, in phase with q"),
        (before[1], BEFORE, 0.45, "before, in phase with q_dot"),
        (after[0], AFTER, 1.0, "after, in phase with q"),
        (after[1], AFTER, 0.45, "after, in phase with q_dot"),
    ]
    for i, (values, color, alpha, label) in enumerate(bars):
        at = orders + 0.2 * (i - 1.5)
        ax.bar(at, 100 * np.abs(values), 0.2, color=color, alpha=alpha, label=label)
    ax.set(xlabel="harmonic", ylabel="missing force (% of largest restoring force)", xticks=orders)
    ax.legend(frameon=False, fontsize="small")


def draw_cycles(
    t: Array,
    before: Array,
    after: Array,
    known: Sequence[Fact],
    figure: Figure,
    names: tuple[str, str] = ("before", "after"),
) -> None:
    """Error over noise of every cycle, (n,) each; lines end where cycles were left out.

    What is known of the cycles beside it is shown under the pointer.
    """
    ax = figure.subplots()
    gaps = np.flatnonzero(np.diff(t) > 1.5 * np.min(np.diff(t), initial=np.inf)) + 1
    facts = [f._replace(values=np.insert(f.values, gaps, np.nan)) for f in known]
    t, before, after = (np.insert(x, gaps, np.nan) for x in (t, before, after))
    # Thick and thin lines, and dots of two sizes: after never hides before.
    looks = ((before, BEFORE, 2.4, 4, names[0]), (after, AFTER, 1, 2, names[1]))
    for errors, color, width, size, label in looks:
        (line,) = ax.plot(t, errors, "o-", color=color, lw=width, ms=size, label=label)
        tell(line, Fact("time (s)", t), *facts, Fact("error over noise", errors, digits=3))
    ax.axhline(1.0, color="0.5", lw=0.8)
    ax.set(xlabel="time (s)", ylabel="error per cycle over noise")
    log_ratio(ax)
    ax.legend(frameon=False, fontsize="small")


def draw_errors(names: Sequence[str], before: Array, after: Array, figure: Figure) -> None:
    """Errors over noise of records or sensors: bars from the noise itself, 1, up or down."""
    ax = figure.subplots()
    at = np.arange(len(names))
    sides = ((at - 0.2, before, BEFORE, "before"), (at + 0.2, after, AFTER, "after"))
    for place, errors, color, label in sides:
        bars = ax.bar(place, errors - 1, 0.4, bottom=1, color=color, label=label)
        ax.bar_label(bars, [f"{e:.3g}" for e in errors], padding=2, fontsize="small")
    ax.axhline(1.0, color="0.5", lw=0.8)
    ax.set(ylabel="error over noise", xticks=at, xticklabels=names)
    log_ratio(ax)
    ax.set_ylim(bottom=min(0.5, 0.7 * float(np.nanmin(after))))
    ax.legend(frameon=False, fontsize="small", ncols=2, loc="lower right", bbox_to_anchor=(1, 1))


def draw_error_spectra(
    dt: float,
    noise: float,
    measured: Array,
    before: Array,
    after: Array,
    quantity: str,
    unit: str,
    figure: Figure,
) -> None:
    """Spectra of a record and of what is missed of it, (n,), beside white noise of this rms."""
    t, missed = dt * np.arange(len(measured)), {"before": before, "after": after}
    channel = Compared(t, measured, missed, quantity, unit, Noise.white(noise, dt))
    draw_spectra({"": spectrum_of(channel)}, figure)
