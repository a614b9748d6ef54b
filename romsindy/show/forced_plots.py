"""Figures of a vibration that inputs drive: over time, spectra, backbone and damping."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import welch

from romsindy.fit.estimate import Band
from romsindy.fit.fitted import Fit
from romsindy.fit.forced.held_out import HeldOut
from romsindy.fit.forced.record import ForcedRecord
from romsindy.record.forced import ForcedVibration
from romsindy.show.axes import with_unit
from romsindy.typing import Array

_CYCLES = 12  # that are looked at closely
_STRETCHES = 16  # of which a spectrum is the mean
_SIGMAS_95 = 1.96


def draw_motion(
    fit: Fit, vibration: ForcedVibration, held_out: HeldOut | None, figure: Figure
) -> None:
    """Inputs, response and residual, one above the other."""
    *inputs, response, below = figure.subplots(len(vibration.names) + 2, 1, sharex=True)
    t = np.concatenate([record.decay.t for record, _ in _pieces(fit)])
    parts = [(vibration, t, np.concatenate(fit.residuals), "C0", "0.5")]
    if held_out is not None:
        parts.append((held_out.vibration, held_out.vibration.t, held_out.missed, "C1", "C1"))
    for v, times, missed, color, pale in parts:
        for ax, u in zip(inputs, v.u.T, strict=True):
            ax.plot(v.t, u, color=pale, lw=0.6)
        response.plot(v.t, v.y, color=pale, lw=0.6)
        below.plot(times, missed, color=color, lw=0.6)
    for ax, name, unit in zip(inputs, vibration.names, vibration.units, strict=True):
        ax.set_ylabel(with_unit(name, unit or "its unit"))
    label = with_unit(vibration.measured, vibration.signal_unit)
    response.set_ylabel(label)
    below.set(xlabel="time (s)", ylabel=f"residual\n{label.removeprefix(vibration.measured)}")
    for ax in figure.axes:
        ax.margins(x=0.01)
    figure.align_ylabels()


def draw_closer(fit: Fit, figure: Figure) -> None:
    """Some cycles of the response round its largest value, measured and simulated."""
    ax = figure.subplots()
    record, residual = max(_pieces(fit), key=lambda piece: float(np.abs(piece[0].signal).max()))
    t, y = record.decay.t, record.signal
    reach = np.pi * _CYCLES / record.rate
    middle = np.clip(t[np.argmax(np.abs(y))], t[0] + reach, max(t[-1] - reach, t[0] + reach))
    part = np.abs(t - middle) <= reach
    ax.plot(t[part], y[part], ".-", ms=3, color="0.6", lw=1.0, label="measured")
    ax.plot(t[part], (y - residual)[part], ":", color="C0", lw=1.5, label="simulated")
    quantity = record.decay.measured
    ax.set(xlabel="time (s)", ylabel=with_unit(quantity, record.decay.signal_unit))
    ax.margins(x=0.01)
    ax.legend(frameon=False, loc="upper right", ncols=2)
    ax.set_ylim(None, ax.get_ylim()[1] + 0.15 * np.ptp(ax.get_ylim()))


def draw_spectra(fit: Fit, figure: Figure) -> None:
    """Amplitude densities of response, residual and noise of the longest piece of the record."""
    ax: Axes = figure.subplots()
    record, residual = max(_pieces(fit), key=lambda piece: len(piece[0].signal))
    dt, unit = record.decay.dt, record.decay.signal_unit
    for x, color, label in ((record.signal, "0.5", "response"), (residual, "C0", "residual")):
        ax.plot(*_density(x, dt), color=color, lw=0.9, label=label)
    level = record.noise.std * np.sqrt(2 * dt)
    ax.axhline(level, color="C1", ls="--", lw=1.2, label="noise")
    ax.set(xlabel="frequency (Hz)", yscale="log", xlim=(0, 0.5 / dt))
    ax.set_ylabel(with_unit(record.decay.measured, f"{unit} / Hz^0.5"))
    ax.legend(frameon=False, loc="upper right")


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


def _pieces(fit: Fit) -> list[tuple[ForcedRecord, Array]]:
    """Of the record, each with what is left of it; one where it is whole."""
    pairs = zip(fit.records, fit.residuals, strict=True)
    return [(record, left) for record, left in pairs if isinstance(record, ForcedRecord)]


def _density(x: Array, dt: float) -> tuple[Array, Array]:
    stretch = max(len(x) // _STRETCHES, min(256, len(x)))
    frequency, power = welch(x - x.mean(), 1 / dt, nperseg=stretch)
    return frequency[1:], np.sqrt(power[1:])
