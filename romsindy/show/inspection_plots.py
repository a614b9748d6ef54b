"""Figures of a recording: what it holds over time and frequency, and what is used of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann

from romsindy.record.recording import Recording
from romsindy.record.releases import Discarded, Release
from romsindy.record.signals import downsample
from romsindy.record.vibrations import Vibration
from romsindy.typing import Array

_POINTS = 2000  # across a figure
_COLUMNS, _LINES = 400, 400  # of a spectrogram
_CYCLES, _PARTS = 16.0, 8  # of the lowest tone in a window; windows in a record, at least
_DYNAMICS = 90.0  # dB that are shown
_ABOVE = 1.3  # of the highest tone: frequencies beyond are not shown
_WIDE = 30.0  # highest over lowest tone: more needs a logarithmic axis
_DISCARDED, _PALE = "0.65", "0.8"


class Tone(NamedTuple):
    """A vibration with the number of its mode, and when its release starts, s."""

    number: int
    start: float
    vibration: Vibration

    @property
    def color(self) -> str:
        """The same in all figures; the first is kept for signals."""
        return f"C{(self.number - 1) % 9 + 1}"


def plot_record(
    recording: Recording,
    releases: Sequence[Release],
    discarded: Sequence[Discarded],
    *,
    ax: Axes,
) -> Axes:
    """One channel over time: releases shaded and numbered, what is left out grey."""
    ax.plot(*_thinned(recording.t, recording.x[:, 0]), color=_DISCARDED, lw=0.6)
    for i, part in enumerate(releases, 1):
        inside = (recording.t >= part.start) & (recording.t <= part.end)
        ax.plot(*_thinned(recording.t[inside], recording.x[inside, 0]), color="C0", lw=0.6)
        ax.axvspan(part.start, part.end, color="C0", alpha=0.08, lw=0)
        place = {"xy": (part.start, 1), "xycoords": ("data", "axes fraction"), "va": "top"}
        ax.annotate(f" release {i}", **place)
    for i, gone in enumerate(discarded):
        look = {"color": _DISCARDED, "alpha": 0.2, "lw": 0}
        ax.axvspan(gone.start, gone.end, **look, label=None if i else "left out")
    ax.set(ylabel=f"{recording.quantity} ({recording.signal_unit})")
    ax.margins(x=0)
    if discarded:
        ax.legend(loc="lower right", frameon=False)
    return ax


def plot_ridges(recording: Recording, tones: Sequence[Tone], *, ax: Axes) -> Axes:
    """Spectrogram of one channel in dB, with the ridges that were followed drawn over it."""
    low, high = _range(recording, tones)
    pictures = list(_spectrograms(recording, low, high))
    top = max((float(level.max()) for _, _, level in pictures), default=0.0)
    look = {"vmin": top - _DYNAMICS, "vmax": top, "cmap": "Greys", "rasterized": True}
    for t, f, level in pictures:
        mesh = ax.pcolormesh(t, f, level, **look)
    if pictures:
        ax.figure.colorbar(mesh, ax=ax, pad=0.01, label=f"dB re 1 {recording.signal_unit}")
    around = [withStroke(linewidth=2.5, foreground="white")]
    for tone in tones:
        for order, ridge in [(1, tone.vibration.tone), *tone.vibration.harmonics]:
            t, dashes = tone.start + ridge.t, "-" if order == 1 else ":"
            look = {"color": tone.color, "ls": dashes, "lw": 1.2, "path_effects": around}
            ax.plot(t, ridge.frequency, **look)
    if high > _WIDE * low:
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter("{x:g}")
    ax.set(ylim=(low if high > _WIDE * low else 0, high), ylabel="frequency (Hz)")
    return ax


def plot_spectrum(
    recording: Recording, cleaned: Recording, tones: Sequence[Tone], *, ax: Axes
) -> Axes:
    """Spectrum of one channel over one release, modes marked with their numbers.

    Parameters
    ----------
    recording, cleaned : Recording
        The release as it was read, which is drawn pale, and with its defects mended.
    tones : sequence of Tone
        The vibrations of the release.
    """
    low, high = _range(cleaned, tones)
    for of, look in ((recording, {"color": _PALE}), (cleaned, {"color": "0.25"})):
        f, size = _spectrum(of)
        inside = (f <= high) & (f >= low / 2)
        ax.plot(*_thinned(f[inside], size[inside]), lw=0.8, **look)
    ax.set(xlim=(low if high > _WIDE * low else 0, high))
    for tone in tones:
        of_tone = tone.vibration
        words = f"{tone.number}{' steady' if of_tone.steady else ''}"
        ax.axvline(of_tone.mean_frequency, color=tone.color, lw=1, ls="--", zorder=0)
        place = {"xy": (of_tone.mean_frequency, 1), "xycoords": ("data", "axes fraction")}
        ax.annotate(words, **place, ha="center", va="bottom", color=tone.color)
        for order, ridge in of_tone.harmonics:
            at = float(np.median(ridge.frequency))
            ax.axvline(at, color=tone.color, lw=1, ls=":", zorder=0)
            place = {"xy": (at, 1), "xycoords": ("data", "axes fraction"), "fontsize": "small"}
            ax.annotate(f"{order}x", **place, ha="center", va="bottom", color=tone.color)
    ax.set_yscale("log")
    if high > _WIDE * low:
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
    ax.set(xlabel="frequency (Hz)", ylabel=f"amplitude ({recording.signal_unit})")
    return ax


def _range(recording: Recording, tones: Sequence[Tone]) -> tuple[float, float]:
    """Lowest and highest frequency worth showing, Hz."""
    ridges = [r for _, _, v in tones for r in (v.tone, *(h for _, h in v.harmonics))]
    nyquist = 0.5 / recording.dt
    if not ridges:
        return nyquist / _WIDE, nyquist
    lowest = min(float(r.frequency.min()) for r in ridges)
    return lowest / 2, min(_ABOVE * max(float(r.frequency.max()) for r in ridges), nyquist)


def _spectrograms(
    recording: Recording, low: float, high: float
) -> Iterator[tuple[Array, Array, Array]]:
    """Times, frequencies and level in dB, of the parts between gaps."""
    factor = max(int(0.5 / (recording.dt * high)), 1)
    for piece in recording.pieces:
        x = downsample(np.nan_to_num(recording.x[piece, 0]), factor)
        dt = factor * recording.dt
        window = int(min(_CYCLES / (2 * low * dt), len(x) / _PARTS))
        if window < 8:
            continue
        fine = 2 ** int(np.ceil(np.log2(max(2 * window, _LINES))))
        hop = max(len(x) // _COLUMNS, 1)
        transform = ShortTimeFFT(hann(window), hop, 1 / dt, mfft=fine, scale_to="magnitude")
        inside = transform.f <= high
        size = np.abs(transform.stft(x - x.mean())[inside])
        t = recording.t[piece][0] + transform.t(len(x))
        shown = (t >= recording.t[piece][0]) & (t <= recording.t[piece][-1])
        step = max(np.count_nonzero(inside) // _LINES, 1)
        level = 20 * np.log10(np.maximum(2 * size[::step, shown], np.finfo(float).tiny))
        yield t[shown], transform.f[inside][::step], level


def _spectrum(recording: Recording) -> tuple[Array, Array]:
    """Frequencies in Hz, and amplitude of the spectrum."""
    x = np.nan_to_num(recording.x[:, 0] - np.nanmean(recording.x[:, 0]))
    window = np.hanning(len(x) + 2)[1:-1]
    return np.fft.rfftfreq(len(x), recording.dt), 2 * np.abs(np.fft.rfft(x * window)) / window.sum()


def _thinned(t: Array, x: Array) -> tuple[Array, Array]:
    """Least and largest of the samples that share a point of the figure."""
    step = len(t) // _POINTS
    if step < 2:
        return t, x
    n = len(t) // step
    parts = np.nan_to_num(x[: n * step], nan=0.0).reshape(n, step)
    ends = np.stack([parts.min(axis=1), parts.max(axis=1)], axis=1).ravel()
    return np.repeat(t[: n * step : step], 2), ends
