"""Figures of measured channels, over time and of what is left, and of a diagnosis: from arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.signal import welch

from romsindy.record.backbone import Backbone
from romsindy.record.noise import Noise
from romsindy.show.axes import Fact, log_ratio, of_cycles, tell, with_unit
from romsindy.typing import Array

COLORS = ("C3", "C0")  # before and after; of one simulation alone the last
_PALE, _HELD_OUT = "0.5", "C1"
_CYCLES = 12  # that are looked at closely
_STRETCHES, _LEAST = 8, 8  # of which a spectrum is the mean; samples in each


@dataclass(frozen=True, eq=False)
class Compared:
    """One channel that was measured, and what simulations leave of it."""

    # (n,), time in s
    t: Array
    measured: Array
    # Measured minus simulated, by name of the simulation; nan where nothing is compared
    left: Mapping[str, Array]
    # Of the samples
    quantity: str
    unit: str
    noise: Noise | None = None  # of the channel, where it is known
    inputs: Mapping[str, Array] = field(default_factory=dict)  # what drives it, by label
    # Angular frequency of its slowest vibration, rad/s; 0 where no cycle is looked at closely
    rate: float = 0.0

    @property
    def rows(self) -> int:
        """Of axes in its figure over time."""
        return len(self.inputs) + 1 + len(self.left) + bool(self.rate)

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return float(np.median(np.diff(self.t)))


@dataclass(frozen=True, eq=False)
class Density:
    """What was measured and what is left of it against frequency in Hz, all (n,).

    ``left`` and ``noise`` go by what is shown of them.
    """

    frequency: Array
    measured: Array
    left: Mapping[str, Array]
    noise: Array
    label: str
    style: Mapping[str, Any] = field(default_factory=dict)


def channels_of(pairs: Sequence[tuple[Any, Array]]) -> list[Compared]:
    """The channels of records that follow one another, with what one simulation leaves of each.

    Pairs are of a record and its residuals (c n,), the channels one after the other.
    """
    first = pairs[0][0]
    decays = [record.decay for record, _ in pairs]
    measured, left = (
        np.concatenate([x.reshape(-1, len(d.t)) for x, d in zip(several, decays, strict=True)], 1)
        for several in ([r.signal for r, _ in pairs], [residual for _, residual in pairs])
    )
    motions = [record.motion for record, _ in pairs]
    return [
        Compared(
            np.concatenate([d.t for d in decays]),
            x,
            {"simulated": rest},
            decays[0].measured,
            decays[0].signal_unit,
            own,
            _inputs(decays) if first.driven else {},
            # Rms velocity over rms displacement of the slowest coordinate
            min(float(np.min(np.std(m.q_dot, axis=0) / np.std(m.q, axis=0))) for m in motions),
        )
        for x, rest, own in zip(measured, left, first.noises, strict=True)
    ]


def _inputs(vibrations: Sequence[Any]) -> dict[str, Array]:
    first = vibrations[0]
    labels = [with_unit(n, u or "its unit") for n, u in zip(first.names, first.units, strict=True)]
    u = np.concatenate([v.u.reshape(len(v.t), -1) for v in vibrations])
    return dict(zip(labels, u.T, strict=True))


def held_out_of(vibration: Any, missed: Array) -> list[Compared]:
    """Channels that took no part in a fit, and what was missed of them, (n,) or (n, c)."""
    v, n = vibration, len(vibration.t)
    pairs = zip(v.y.reshape(n, -1).T, missed.reshape(n, -1).T, strict=True)
    how = {"quantity": v.measured, "unit": v.signal_unit, "inputs": _inputs([v])}
    return [Compared(v.t, x, {"simulated": left}, **how) for x, left in pairs]


# -- over time ------------------------------------------------------------------------------------


def draw_over_time(channel: Compared, figure: Figure, held_out: Compared | None = None) -> None:
    """Inputs, the channel, what each simulation leaves of it, and some cycles closely.

    Lines beside what is left are its noise. Simulated motions show in the whole record where one
    can zoom. What was ``held_out`` follows in a colour of its own.
    """
    ratios = [1] * len(channel.inputs) + [1.4] + [1] * len(channel.left)
    rows = figure.subplots(channel.rows, 1, height_ratios=ratios + [1.4] * bool(channel.rate))
    whole = rows[: len(ratios)]
    *inputs, response = whole[: len(channel.inputs) + 1]
    for part, pale in ((channel, _PALE), (held_out, _HELD_OUT)):
        if part is not None:
            for ax, (label, u) in zip(inputs, part.inputs.items(), strict=True):
                ax.plot(part.t, u, color=pale, lw=0.6)
                ax.set_ylabel(label)
            response.plot(part.t, part.measured, color=pale, lw=0.8, label="measured")
    low, high = response.get_ylim()  # as the record has it, whatever is hidden
    response.set_ylim(low, high + 0.2 * (high - low))
    response.set_ylabel(with_unit(channel.quantity, channel.unit))
    below = whole[len(channel.inputs) + 1 :]
    for ax, name, dash, color in zip(below, channel.left, "-:", _colors(channel), strict=False):
        motion = channel.measured - channel.left[name]
        response.plot(channel.t, motion, dash, color=color, lw=1.5, label=name, visible=False)
        _draw_left(ax, channel, name, color, held_out)
    top = max(float(np.abs(ax.get_ylim()).max()) for ax in below)
    for ax in below:
        ax.set_ylim(-top, 1.3 * top)  # with room for a legend
    for ax in whole[:-1]:
        ax.sharex(whole[-1])
        ax.tick_params(labelbottom=False)
    for ax in (response, *below):
        ax.legend(handles=ax.lines[:1], frameon=False, loc="upper right", fontsize="small")
    whole[-1].set_xlabel("time (s)")
    whole[-1].margins(x=0.01)
    if channel.rate:
        _draw_closer(rows[-1], channel)
    figure.align_ylabels()


def _colors(channel: Compared) -> tuple[str, ...]:
    return COLORS[-len(channel.left) :]


def _draw_left(
    ax: Axes, channel: Compared, name: str, color: str, held_out: Compared | None
) -> None:
    label = f"error {name}" if len(channel.left) > 1 else f"measured - {name}"
    ax.plot(channel.t, channel.left[name], color=color, lw=0.7, label=label)
    if held_out is not None:
        ax.plot(held_out.t, held_out.left[name], color=_HELD_OUT, lw=0.7)
    if channel.noise is not None:
        for side in (-1, 1):
            ax.axhline(side * channel.noise.std, color="k", ls=":", lw=0.8)
    ax.set_ylabel(f"residual\n({channel.unit})")


def _draw_closer(ax: Axes, channel: Compared) -> None:
    """Some cycles round the largest value, measured and simulated."""
    t, y = channel.t, channel.measured
    reach = np.pi * _CYCLES / channel.rate
    middle = np.clip(t[np.argmax(np.abs(y))], t[0] + reach, max(t[-1] - reach, t[0] + reach))
    part = np.abs(t - middle) <= reach
    ax.plot(t[part], y[part], ".-", ms=3, color="0.6", lw=1.0, label="measured")
    for (name, left), color in zip(channel.left.items(), _colors(channel), strict=True):
        ax.plot(t[part], (y - left)[part], ":", color=color, lw=1.5, label=name)
    ax.set(xlabel="time (s)", ylabel=with_unit(channel.quantity, channel.unit))
    ax.margins(x=0.01)
    ax.legend(frameon=False, loc="upper right", ncols=2, fontsize="small")
    ax.set_ylim(None, ax.get_ylim()[1] + 0.2 * np.ptp(ax.get_ylim()))


# -- against frequency ----------------------------------------------------------------------------


def spectrum_of(channel: Compared) -> Density:
    """Amplitude densities of a channel, of what is left of it, and of its noise."""
    frequency, measured = _density(channel.measured, channel.dt)
    left = {name: _density(x, channel.dt)[1] for name, x in channel.left.items()}
    noise = np.zeros(0) if channel.noise is None else noise_density(channel.noise, frequency)
    label = with_unit(channel.quantity, f"{channel.unit} / Hz^0.5")
    return Density(frequency, measured, left, noise, label)


def noise_density(noise: Noise, frequency: Array) -> Array:
    """Amplitude density of a noise at frequencies in Hz, unit of the record / Hz^0.5."""
    power = np.full(len(frequency), noise.std**2) if noise.alike else noise.spectrum(frequency)
    drift = 0.0 if noise.drift is None else noise.drift(frequency)
    return np.sqrt(2 * noise.dt * (power + drift))


def _density(x: Array, dt: float) -> tuple[Array, NDArray[np.float64]]:
    stretch = max(len(x) // _STRETCHES, _LEAST)
    frequency, power = welch(x - x.mean(), 1 / dt, nperseg=min(stretch, len(x)))
    return frequency[1:], np.sqrt(power[1:])


def draw_spectra(spectra: Mapping[str, Density], figure: Figure) -> None:
    """Spectra of channels, one below the other, under their names where there are several."""
    rows = figure.subplots(len(spectra), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (title, s) in zip(rows, spectra.items(), strict=True):
        for values, color, label in _curves(s):
            ax.plot(s.frequency, values, **({"lw": 1.1} | dict(s.style)), color=color, label=label)
        if np.any(s.noise > 0):
            ax.plot(s.frequency, s.noise, "k:", lw=1.0, label="noise")
        ax.set(yscale="log", ylabel=s.label)
        ax.set_title(title, loc="left", fontsize="medium")
    rows[0].legend(frameon=False, fontsize="small", loc="upper right", ncols=2)
    rows[-1].set_xlabel("frequency (Hz)")


def _curves(s: Density) -> Iterator[tuple[Array, str, str]]:
    yield s.measured, "0.6", "measured"
    for (name, left), color in zip(s.left.items(), COLORS[-len(s.left) :], strict=True):
        yield left, color, f"error {name}" if len(s.left) > 1 else "what is left"


BEFORE, AFTER = COLORS
_LOOKS: dict[str, dict[str, Any]] = {
    "measured": {"color": "0.4", "ls": "", "marker": "o", "ms": 3},
    "before": {"color": BEFORE, "lw": 2.4},  # seen where both agree
    "after": {"color": AFTER, "lw": 1.2},
}


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
