"""Look at a record before anything is identified from it: text, numbers, figures, one page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from romsindy.inspection import tables
from romsindy.inspection.findings import ChannelNoise, Findings, Mode
from romsindy.notebook import shown
from romsindy.physics.term_sum import json_text
from romsindy.record.decay import Decay
from romsindy.record.defects import clean
from romsindy.record.files import load_recording
from romsindy.record.prediction import unpredicted
from romsindy.record.recording import QUANTITIES, Recording
from romsindy.record.releases import Discarded, Release, split_releases
from romsindy.record.spectrum import noise_std
from romsindy.record.vibrations import find_vibrations
from romsindy.text import listed


def _mode(found: Findings, mode: Mode) -> dict[str, Any]:
    names = ("frequency", "damping_ratio", "amplitude")
    ends = {name: dict(zip(("loud", "quiet"), getattr(mode, name), strict=True)) for name in names}
    parts = zip(found.releases, mode.parts, strict=True)
    return {
        "number": mode.number,
        "mean_frequency": mode.mean_frequency,
        **ends,
        "share": mode.share,
        "harmonics": list(mode.harmonics),
        "steady": mode.steady,
        "along": [
            {
                "release": i,
                "t": part.start + v.tone.t,
                "frequency": v.frequency,
                "amplitude": v.displacement,
            }
            for i, (part, v) in enumerate(parts, 1)
            if v is not None
        ],
    }


if TYPE_CHECKING:
    from romsindy.show.page import Figure


class Inspection(Findings):
    """What `romsindy.inspect` found in a recording.

    ``print`` shows it as text. See `Findings` for its numbers: `modes`, `releases`, `noise`,
    `defects`, `warnings`, `discarded`, `resonances`, and the `decays` to be identified.
    """

    def __str__(self) -> str:
        return tables.report(self)

    def short(self, command: str = "") -> str:
        """What was found, how sure, what is wrong with it, what next, in 19 lines at most.

        Parameters
        ----------
        command : str
            A command line that identifies the record, for the steps that come next.
        """
        return tables.short(self, command)

    def _repr_html_(self) -> str:
        return shown([], tables.tables(self), [tables.summary(self)])

    def __repr__(self) -> str:
        frequencies = ", ".join(f"{m.mean_frequency:.5g}" for m in self.modes) or "none"
        counts = f"releases: {len(self.releases)}, defects: {len(self.defects)}"
        return f"<Inspection: modes at {frequencies} Hz, {counts}>"

    def to_dict(self) -> dict[str, Any]:
        """All numbers by name, times in s, frequencies in Hz, the rest in SI units."""
        r = self.recording
        return {
            "file": r.source,
            "samples": len(r.t),
            "rate": 1 / r.dt,
            "start": float(r.t[0]),
            "end": float(r.t[-1]),
            "quantity": r.quantity,
            "unit": r.unit,
            "basis": r.basis,
            "notes": list(r.notes),
            "channel": self.channel,
            "channels": [asdict(n) for n in self.noise],
            "releases": [asdict(part) for part in self.releases],
            "discarded": [asdict(part) for part in self.discarded],
            "defects": [asdict(d) for d in self.defects],
            "modes": [_mode(self, m) for m in self.modes],
            "resonances": [
                {"lower": low.number, "higher": high.number, "p": s.p, "q": s.q, "ratio": s.ratio}
                | {"amplitude": s.amplitude}
                for low, high, s in self.resonances
            ],
        }

    def to_json(self) -> str:
        """The same as JSON text; what is not finite is a string."""
        return json_text(self.to_dict())

    def plot(self) -> Figure:
        """Time signal, spectrogram with the ridges that were followed, and spectrum."""
        from romsindy.inspection.page import picture  # draws: only where a figure is asked for

        return picture(self).figure()

    def to_html(self, path: str | Path, command: str = "", *, interactive: bool = False) -> None:
        """Write one self-contained page with figures.

        Parameters
        ----------
        path : str or Path
        command : str
            A command line that identifies the record, for the steps that come next.
        interactive : bool
            Whether figures zoom and show what is under the pointer; needs plotly:
            ``pip install "romsindy[interactive]"``.
        """
        from romsindy.inspection.page import write

        write(self, path, command, interactive=interactive)


_FEWEST = 16  # samples that tell a level of noise
# Signal over noise, dB, below which a channel is nothing but noise; and the part of its first
# cycles after a release that are not predicted then, whatever their colour.
_NOTHING, _UNPREDICTED, _CYCLES = 3.0, 0.75, 20


def inspect(
    record: str | Path | Recording | Decay,
    *,
    channel: str | None = None,
    progress: Callable[[str], None] | None = None,
    **reading: Any,
) -> Inspection:
    """Find out what is in a record: releases, modes, noise and defects.

    Parameters
    ----------
    record : path, Recording or Decay
        What `load_recording` reads, or what it returned, or a decay.
    channel : str, optional
        Name of the channel to look at. By default modes are looked for in the liveliest one, and
        decays are made of all channels together, each as far as the mode shows in it in phase.
    progress : callable, optional
        Called with a line of text for every tone that was followed.
    **reading
        Of a file: unit, quantity, column, time, rate, start, end, as `load_recording` takes them.

    Raises
    ------
    ValueError
        If the file cannot be understood, or there is no such channel.

    Examples
    --------
    >>> from romsindy import example_decay
    >>> seen = inspect(example_decay(40, periods=20))
    >>> [f"{mode.mean_frequency:.2f} Hz" for mode in seen.modes], len(seen.releases), seen.defects
    (['0.92 Hz'], 1, ())
    """
    if isinstance(record, (str, PathLike, Mapping, Sequence)):
        recording = load_recording(record, **reading)
    elif reading:
        raise ValueError(
            f"{', '.join(reading)}: these say how a file is read, and {record!r} is none"
        )
    else:
        recording = record.as_recording()
    cleaned, defects = clean(recording)
    if recording.driven:  # what answers a drive of any spectrum is no noise
        defects = tuple(d for d in defects if d.kind != "coloured noise")
    name = channel or cleaned.names[int(np.argmax(np.nan_to_num(np.nanstd(cleaned.x, axis=0))))]
    cleaned.channel(name)  # refuses one that does not exist
    releases, discarded = _parts(cleaned)
    derivative = QUANTITIES.index(recording.quantity)
    found = []
    for release in releases:
        part = cleaned.between(release.start, release.end).channel(name)
        found.append(find_vibrations(part.x[:, 0], part.dt, derivative, progress))
    loudest = max(releases, key=lambda r: r.peak, default=None)
    noise = tuple(_noise(cleaned.channel(c), loudest) for c in cleaned.names)
    heard = [n.channel for n in noise if n.rings or n.channel == name]
    used = tuple(heard) if channel is None else (channel,)
    return Inspection(
        recording, cleaned, name, used, defects, releases, discarded, tuple(found), noise
    )


def _parts(recording: Recording) -> tuple[tuple[Release, ...], tuple[Discarded, ...]]:
    """Free decays, and what is none: all of it where a measured input drives it."""
    if not recording.driven:
        return split_releases(recording)
    names = listed([str(drive) for drive in recording.drives if drive.lasting])
    reason = f"driven by the {names}"
    return (), (Discarded(float(recording.t[0]), float(recording.t[-1]), reason),)


def _noise(recording: Recording, release: Release | None) -> ChannelNoise:
    """Level of white noise in one channel, and how far its vibration stands out of it."""
    name, whole = recording.names[0], recording.x[:, 0]
    piece = whole[max(recording.pieces, key=lambda p: p.stop - p.start)]
    piece = piece[np.isfinite(piece)]
    if len(piece) < _FEWEST or not np.ptp(piece) > 0:
        return ChannelNoise(name, float("nan"), float("nan"), False)
    noise, loud, rings = noise_std(piece), piece, True
    if release is not None:
        end = release.start + min(release.cycles, _CYCLES) / release.frequency
        inside = (recording.t >= release.start) & (recording.t <= release.end)
        loud = whole[inside & np.isfinite(whole)]
        first = whole[inside & (recording.t <= end) & np.isfinite(whole)]
        period = 1 / (release.frequency * recording.dt)
        rings = len(first) < _CYCLES * period / 2 or unpredicted(first, period, 1) < _UNPREDICTED
    ratio = 20 * np.log10(np.std(loud) / noise) if noise > 0 else np.inf
    return ChannelNoise(name, noise, float(ratio), bool(rings and ratio > _NOTHING))
