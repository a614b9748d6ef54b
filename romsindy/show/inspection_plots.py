"""Figures of a recording: what it holds over time and frequency, and what is used of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from scipy.fft import next_fast_len, rfft, rfftfreq
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann

from romsindy.record.recording import Recording
from romsindy.record.releases import Discarded, Release
from romsindy.record.ridges import Ridge
from romsindy.record.signals import downsample
from romsindy.record.vibrations import Vibration
from romsindy.show.axes import Fact, tell
from romsindy.typing import Array

_POINTS = 20_000  # across a figure: one can zoom in
_COLUMNS, _ROWS = 400, 600  # of a spectrogram
_CYCLES, _PARTS = 16.0, 8  # of the lowest tone in a window; windows in a record, at least
_DYNAMICS = 90.0  # dB that are shown
_RISE = 0.02  # of a release: the window of its spectrum opens within, and closes over the rest
_ABOVE, _LEAST = (1.3, 4.0)  # of the highest and lowest tone: frequencies that are shown
_WIDE = 30.0  # highest over lowest frequency: more needs a logarithmic axis
_LEFT_OUT, _PALE = "0.65", "0.8"


class Tone(NamedTuple):
    """A vibration with the number of its mode, and when its release starts, s."""

    number: int
    start: float
    vibration: Vibration

    @property
    def ridges(self) -> list[tuple[int, Ridge]]:
        """The fundamental as 1, and the harmonics."""
        return [(1, self.vibration.tone), *self.vibration.harmonics]

    @property
    def color(self) -> str:
        """The same in all figures; the first is kept for signals."""
        return f"C{(self.number - 1) % 9 + 1}"


def draw_record(
    recording: Recording,
    cleaned: Recording,
    releases: Sequence[Release],
    discarded: Sequence[Discarded],
    tones: Sequence[Tone],
    spectrum_of: Release | None,
    figure: Figure,
) -> None:
    """One channel: its samples, spectrogram and spectrum, one above the other, in an empty figure.

    The recording is drawn as it was read and ``cleaned``, with its defects mended, with the tones
    of all releases. The spectrum is that of one release, or of all where there is none.
    """
    time, ridges, spectrum = figure.subplots(3, height_ratios=(2, 3, 2))
    ridges.sharex(time)
    plot_record(recording, releases, discarded, ax=time)
    plot_ridges(cleaned, tones, ax=ridges)
    ridges.set(xlabel="time (s)", xlim=(recording.t[0], recording.t[-1]))
    if spectrum_of is not None:
        tones = [t for t in tones if t.start == spectrum_of.start]
        recording, cleaned = (
            r.between(spectrum_of.start, spectrum_of.end) for r in (recording, cleaned)
        )
    plot_spectrum(recording, cleaned, tones, ax=spectrum)


def plot_record(
    recording: Recording, releases: Sequence[Release], discarded: Sequence[Discarded], *, ax: Axes
) -> Axes:
    """One channel over time: releases shaded and numbered, what is left out grey."""
    ax.plot(*_thinned(recording.t, recording.x[:, 0]), color=_LEFT_OUT, lw=0.6)
    for i, part in enumerate(releases, 1):
        inside = (recording.t >= part.start) & (recording.t <= part.end)
        ax.plot(*_thinned(recording.t[inside], recording.x[inside, 0]), color="C0", lw=0.6)
        ax.axvspan(part.start, part.end, color="C0", alpha=0.08, lw=0)
        corner = ("data", "axes fraction")
        ax.annotate(f" release {i}", (part.start, 1), xycoords=corner, va="bottom")
    for i, gone in enumerate(discarded):
        words = None if i else "left out"
        ax.axvspan(gone.start, gone.end, color=_LEFT_OUT, alpha=0.2, lw=0, label=words)
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
    for t, f, level in pictures:
        mesh = ax.pcolormesh(
            t, f, level, vmin=top - _DYNAMICS, vmax=top, cmap="Greys", rasterized=True
        )
    if pictures:
        ax.figure.colorbar(mesh, ax=ax, pad=0.01, label=f"dB re 1 {recording.signal_unit}")
    around = [withStroke(linewidth=2.5, foreground="white")]
    for tone in tones:
        for order, ridge in tone.ridges:
            t, dashes = tone.start + ridge.t, "-" if order == 1 else ":"
            name = f"mode {tone.number}" + (f", harmonic {order}" if order > 1 else "")
            (line,) = ax.plot(
                t, ridge.frequency, color=tone.color, ls=dashes, lw=1.2, path_effects=around,
                label=name,
            )  # fmt: skip
            size = Fact(f"amplitude ({recording.signal_unit})", ridge.amplitude)
            tell(line, Fact("time (s)", t), size, Fact("frequency (Hz)", ridge.frequency))
    _frequencies(ax, "y", low, high)
    return ax


def plot_spectrum(
    recording: Recording, cleaned: Recording, tones: Sequence[Tone], *, ax: Axes
) -> Axes:
    """Spectrum of one channel over one release, its vibrations marked with their numbers.

    As it was read it is drawn pale beneath the ``cleaned`` one.
    """
    low, high = _range(cleaned, tones)
    for of, color in ((recording, _PALE), (cleaned, "0.25")):
        f, size = _spectrum(of, high)
        inside = (f > 0) & (f <= high)
        ax.plot(*_thinned(f[inside], size[inside]), lw=0.8, color=color)
    for tone in tones:
        for order, ridge in tone.ridges:
            at = tone.vibration.mean_frequency if order == 1 else float(np.median(ridge.frequency))
            ax.axvline(at, color=tone.color, lw=1, ls="--" if order == 1 else ":", zorder=0)
            ax.annotate(
                f"{tone.number}" if order == 1 else f"{order}x",
                (at, 1),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="bottom",
                color=tone.color,
            )
    if any(np.any(np.asarray(line.get_ydata()) > 0) for line in ax.lines):
        ax.set_yscale("log")
    _frequencies(ax, "x", low, high)
    ax.set(ylabel=f"amplitude ({recording.signal_unit})")
    return ax


def _frequencies(ax: Axes, name: str, low: float, high: float) -> None:
    """An axis of frequencies, logarithmic where they are far apart."""
    wide = high > _WIDE * low
    if wide:
        getattr(ax, f"set_{name}scale")("log")
        getattr(ax, f"{name}axis").set_major_formatter("{x:g}")
    ax.set(**{f"{name}lim": (low if wide else 0, high), f"{name}label": "frequency (Hz)"})


def _range(recording: Recording, tones: Sequence[Tone]) -> tuple[float, float]:
    """Lowest and highest frequency worth showing, Hz."""
    found = [r.frequency for tone in tones for _, r in tone.ridges]
    nyquist = 0.5 / recording.dt
    if not found:
        return nyquist / _WIDE, nyquist
    lowest, highest = min(float(f.min()) for f in found), max(float(f.max()) for f in found)
    return lowest / 2, min(max(_ABOVE * highest, _LEAST * lowest), nyquist)


def _spectrograms(
    recording: Recording, low: float, high: float
) -> Iterator[tuple[Array, Array, Array]]:
    """Times, frequencies and level in dB, of the parts between gaps."""
    for piece in recording.pieces:
        x, dt = _slow(recording, piece, high)
        window = int(min(_CYCLES / (2 * low * dt), len(x) / _PARTS))
        if window < 8:
            continue
        fine = 2 ** int(np.ceil(np.log2(max(2 * window, 2 * _ROWS))))
        hop = max(len(x) // _COLUMNS, 1)
        transform = ShortTimeFFT(hann(window), hop, 1 / dt, mfft=fine, scale_to="magnitude")
        t = transform.t(len(x))
        inside = (t >= 0) & (t <= (len(x) - 1) * dt)
        size = 2 * np.abs(transform.stft(x, padding="even"))[:, inside]
        # Rows as the axis has them, each the largest of the lines that share it.
        ends = np.geomspace(low, high, _ROWS) if high > _WIDE * low else np.linspace(0, high, _ROWS)
        lines = np.unique(np.searchsorted(transform.f, ends).clip(max=len(transform.f) - 1))
        level = 20 * np.log10(np.maximum(np.maximum.reduceat(size, lines), np.finfo(float).tiny))
        yield recording.t[piece][0] + t[inside], transform.f[lines], level


def _spectrum(recording: Recording, high: float) -> tuple[Array, Array]:
    """Frequencies up to ``high`` Hz and somewhat beyond, and amplitude of the spectrum."""
    x, dt = _slow(recording, slice(None), high)
    rise = max(int(_RISE * len(x)), 1)
    fall = len(x) - rise
    window = np.concatenate([hann(2 * rise)[:rise], hann(2 * fall)[fall:]])
    n = next_fast_len(len(x))
    return rfftfreq(n, dt), 2 * np.abs(rfft(x * window, n)) / window.sum()


def _slow(recording: Recording, piece: slice, high: float) -> tuple[Array, float]:
    """Samples of the channel, fast enough for a frequency in Hz, and their interval in s."""
    factor = max(int(0.4 / (recording.dt * high)), 1)
    x = recording.x[piece, 0]
    known = x[np.isfinite(x)]
    level = known.mean() if len(known) else 0.0
    return downsample(np.nan_to_num(x - level), factor), factor * recording.dt


def _thinned(t: Array, x: Array) -> tuple[Array, Array]:
    """Least and largest of the samples that share a point of the figure."""
    step = len(t) // _POINTS
    if step < 2:
        return t, x
    n = len(t) // step
    parts = np.nan_to_num(x[: n * step]).reshape(n, step)
    ends = np.stack([parts.min(axis=1), parts.max(axis=1)], axis=1).ravel()
    return np.repeat(t[: n * step : step], 2), ends
