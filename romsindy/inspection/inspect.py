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
from romsindy.record.recording import QUANTITIES, Recording
from romsindy.record.releases import split_releases
from romsindy.record.signals import noise_std
from romsindy.record.vibrations import find_vibrations

_FEWEST = 16  # samples that tell a level of noise


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
    name = channel or _liveliest(cleaned)
    cleaned.channel(name)  # refuses one that does not exist
    releases, discarded = split_releases(cleaned)
    derivative = QUANTITIES.index(recording.quantity)
    found = []
    for release in releases:
        part = cleaned.between(release.start, release.end).channel(name)
        found.append(find_vibrations(part.x[:, 0], part.dt, derivative, progress))
    noise = tuple(_noise(cleaned.channel(c)) for c in cleaned.names)
    used = cleaned.names if channel is None else (channel,)
    return Inspection(
        recording, cleaned, name, tuple(used), defects, releases, discarded, tuple(found), noise
    )


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


def _noise(recording: Recording) -> ChannelNoise:
    """Level of white noise in one channel, and how far its vibration stands out of it."""
    x = recording.x[:, 0]
    piece = x[max(recording.pieces, key=lambda p: p.stop - p.start)]
    piece = piece[np.isfinite(piece)]
    if len(piece) < _FEWEST or not np.ptp(piece) > 0:
        return ChannelNoise(recording.names[0], float("nan"), float("nan"))
    noise = noise_std(piece)
    ratio = 20 * np.log10(np.std(piece) / noise) if noise > 0 else np.inf
    return ChannelNoise(recording.names[0], noise, float(ratio))
