"""Look at a record before anything is identified from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from romsindy.inspection.findings import ChannelNoise
from romsindy.inspection.inspection import Inspection
from romsindy.record.decay import Decay
from romsindy.record.defects import clean
from romsindy.record.files import load_recording
from romsindy.record.noise_level import noise_std
from romsindy.record.prediction import unpredicted
from romsindy.record.recording import QUANTITIES, Recording
from romsindy.record.releases import Discarded, Release, split_releases
from romsindy.record.vibrations import find_vibrations
from romsindy.text import listed

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

    Returns
    -------
    Inspection

    Raises
    ------
    ValueError
        If the file cannot be understood, or there is no such channel.
    """
    if reading and isinstance(record, (Recording, Decay)):
        raise ValueError(
            f"{', '.join(reading)}: these say how a file is read, and {record!r} is none"
        )
    recording = _recording(record, reading)
    cleaned, defects = clean(recording)
    if recording.driven:  # what answers a drive of any spectrum is no noise
        defects = tuple(d for d in defects if d.kind != "coloured noise")
    name = channel or _liveliest(cleaned)
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


def _recording(record: str | Path | Recording | Decay, reading: Mapping[str, Any]) -> Recording:
    if isinstance(record, Recording):
        return record
    if not isinstance(record, Decay):
        return load_recording(record, **reading)
    return Recording(
        record.t,
        record.signal,
        quantity=record.measured,
        unit=record.unit,
        basis="the decay that was given",
        notes=record.notes,
    )


def _liveliest(recording: Recording) -> str:
    """The channel that varies most; the first one where nothing was sampled."""
    return recording.names[int(np.argmax(np.nan_to_num(np.nanstd(recording.x, axis=0))))]


def _noise(recording: Recording, release: Release | None) -> ChannelNoise:
    """Level of white noise in one channel, and how far its vibration stands out of it."""
    name, whole = recording.names[0], recording.x[:, 0]
    piece = whole[max(recording.pieces, key=lambda p: p.stop - p.start)]
    piece = piece[np.isfinite(piece)]
    if len(piece) < _FEWEST or not np.ptp(piece) > 0:
        return ChannelNoise(name, float("nan"), float("nan"), False)
    noise, loud, rings = noise_std(piece), piece, True
    if release is not None:
        cycles = min(release.cycles, _CYCLES)
        end = release.start + cycles / release.frequency
        inside = (recording.t >= release.start) & (recording.t <= release.end)
        loud = whole[inside & np.isfinite(whole)]
        first = whole[inside & (recording.t <= end) & np.isfinite(whole)]
        period = 1 / (release.frequency * recording.dt)
        rings = len(first) < _CYCLES * period / 2 or unpredicted(first, period, 1) < _UNPREDICTED
    ratio = 20 * np.log10(np.std(loud) / noise) if noise > 0 else np.inf
    return ChannelNoise(name, noise, float(ratio), bool(rings and ratio > _NOTHING))
