"""Figures of a diagnosis. Every function draws into an Axes and returns its line of reading."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from romsindy.diagnosis.missing_force import (
    HARMONICS,
    MissingForce,
    errors_per_cycle,
    record_errors,
)
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.typing import Array

_BEFORE, _AFTER = "C3", "C0"


def draw_gap(report: DiagnosisReport, ax: Axes) -> str:
    """Held-out record beside the simulation before and after."""
    p = report.gap.predictions[0]
    t = p.record.t
    ax.plot(t, p.record.signal, color="0.75", lw=1.5, label="measured")
    ax.plot(t, p.before - p.record.signal, color=_BEFORE, lw=0.6, label="error before")
    ax.plot(t, p.after - p.record.signal, color=_AFTER, lw=0.6, label="error after")
    ax.set(xlabel="time (s)", ylabel=f"q ({p.record.decay.unit or 'its own unit'})")
    ax.legend(frameon=False, loc="upper right", fontsize="small")
    what = "On what was held out" if report.gap.unseen else "On the records themselves"
    return (
        f"{what} the error goes from {report.gap.before:.3g} to {report.gap.after:.3g} times"
        " the noise."
    )


def draw_amplitude(report: DiagnosisReport, axes: tuple[Axes, Axes]) -> str:
    """Frequency and damping ratio of every cycle, measured and simulated."""
    p = report.gap.predictions[0]
    lines: list[tuple[Array, dict[str, Any]]] = [
        (p.record.signal, {"color": "0.4", "label": "measured", "ls": "", "marker": "o", "ms": 3}),
        (p.before, {"color": _BEFORE, "label": "before", "lw": 2.4}),  # seen where both agree
        (p.after, {"color": _AFTER, "label": "after", "lw": 1.2}),
    ]
    for signal, style in lines:
        backbone = _backbone(p.record.t, signal)
        if backbone is None:
            continue
        axes[0].plot(backbone.amplitude, backbone.frequency / (2 * np.pi), **style)
        axes[1].plot(backbone.amplitude, 100 * backbone.damping_ratio, **style)
    unit = p.record.decay.unit or "unit of q"
    for ax, label in zip(axes, ("frequency (Hz)", "damping ratio (%)"), strict=True):
        ax.set(xlabel=f"amplitude ({unit})", ylabel=label)
    axes[0].legend(frameon=False, fontsize="small")
    before, after = (p.backbone_errors(x) for x in (p.before, p.after))
    return (
        f"At equal amplitude the frequency is off by {100 * before[0]:.2g} % rms before,"
        f" {100 * after[0]:.2g} % after; the damping ratio by {100 * before[1]:.2g} and"
        f" {100 * after[1]:.2g} % of critical."
    )


def _backbone(t: Array, x: Array) -> Backbone | None:
    try:
        return extract_backbone(Decay(t, x))
    except ValueError:  # a simulation that dies out at once has no cycles to draw
        return None


def draw_phase(report: DiagnosisReport, ax: Axes) -> str:
    """Missing force over the (q, q_dot) plane."""
    radius, angle, mean = MissingForce.of(report, ()).plane()
    top = float(np.nanmax(np.abs(mean)))
    x, y = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    image = ax.pcolormesh(x, y, 100 * mean, cmap="RdBu_r", vmin=-100 * top, vmax=100 * top)
    label = "missing force (% of largest restoring)"
    figure = ax.figure
    figure.colorbar(image, ax=ax, label=label)
    ax.set(xlabel="q / largest", ylabel="q_dot / largest", aspect="equal")
    size, turn = np.meshgrid(*(0.5 * (e[1:] + e[:-1]) for e in (radius, angle)), indexing="ij")
    inside = np.isfinite(mean)
    along_q = float(np.sum((mean * size * np.cos(turn))[inside]))
    along_v = float(np.sum((mean * size * np.sin(turn))[inside]))
    if abs(along_v) > abs(along_q):
        side = "against" if along_v < 0 else "with"
        text = f"it acts {side} the velocity: damping."
    else:
        side = "inward" if along_q < 0 else "outward"
        text = f"it acts {side}, with the displacement: stiffness, mass or the sensor."
    return f"The missing force reaches {100 * top:.2g} % of the largest restoring force; {text}"


def draw_harmonics(report: DiagnosisReport, ax: Axes) -> str:
    """Missing force by harmonic, before and after."""
    parts = report.best.solution.parts
    before, after = (MissingForce.of(report, p).harmonics() for p in ((), parts))
    orders = np.arange(HARMONICS + 1)
    bars = [
        (before[0], _BEFORE, 1.0, "before, with q"),
        (before[1], _BEFORE, 0.45, "before, with q_dot"),
        (after[0], _AFTER, 1.0, "after, with q"),
        (after[1], _AFTER, 0.45, "after, with q_dot"),
    ]
    for i, (values, color, alpha, label) in enumerate(bars):
        at = orders + 0.2 * (i - 1.5)
        ax.bar(at, 100 * np.abs(values), 0.2, color=color, alpha=alpha, label=label)
    ax.set(xlabel="harmonic", ylabel="missing force (%)", xticks=orders)
    ax.legend(frameon=False, fontsize="small")
    # Noise, which grows with the square of the harmonic, is in both alike.
    what, size = "force that is added", np.abs(before - after)
    if not report.effects:
        what, size = "missing force", np.abs(before)
    kind, order = np.unravel_index(int(np.argmax(size)), size.shape)
    with_ = ("displacement", "velocity")[kind]
    return (
        f"Over the loudest third the {what} is largest on harmonic {order}, in phase with the"
        f" {with_}. What noise leaves grows with the square of the harmonic."
    )


def draw_time(report: DiagnosisReport, ax: Axes) -> str:
    """Error of every held-out cycle over time, before and after."""
    t, before, after = errors_per_cycle(report)
    for errors, color, label in ((before, _BEFORE, "before"), (after, _AFTER, "after")):
        ax.plot(t, errors, color=color, lw=1, label=label)
    ax.axhline(1.0, color="0.5", lw=0.8)
    ax.set(xlabel="time (s)", ylabel="error per cycle over noise")
    _log_ratio(ax)
    ax.legend(frameon=False, fontsize="small")
    worst = int(np.argmax(after))
    return (
        f"After, no cycle is worse than {after[worst]:.3g} times the noise (at {t[worst]:.3g} s);"
        f" before, the worst was {before.max():.3g}."
    )


def draw_records(report: DiagnosisReport, ax: Axes) -> str:
    """Error over noise of every record, before and after."""
    return draw_errors(*record_errors(report), ax)


def draw_errors(names: Sequence[str], before: Array, after: Array, ax: Axes) -> str:
    """Errors over noise of records or sensors, before and after."""
    at = np.arange(len(names))
    ax.bar(at - 0.2, before, 0.4, color=_BEFORE, label="before")
    ax.bar(at + 0.2, after, 0.4, color=_AFTER, label="after")
    ax.axhline(1.0, color="0.5", lw=0.8)
    ax.set(ylabel="error over noise", xticks=at, xticklabels=names)
    _log_ratio(ax)
    ax.set_ylim(bottom=min(0.5, 0.7 * float(np.nanmin(after))))
    ax.legend(frameon=False, fontsize="small", ncols=2, loc="lower right", bbox_to_anchor=(1, 1))
    worst = names[int(np.nanargmax(after))]
    return f"After, the worst is {worst} at {np.nanmax(after):.3g} times its noise (line: 1)."


def _log_ratio(ax: Axes) -> None:
    """Ratios near 1 on a log axis: 0.4 rather than 4 x 10^-1."""
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
