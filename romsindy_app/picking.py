"""What vibrates in a record, drawn so that one vibration can be picked with the pointer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_LARGEST = 60.0  # area of the dot of the largest amplitude of a mode, points^2
Mask = Callable[[Any, Any], Any]  # of points x, y: which are inside


def draw(seen: Mapping[str, Any]) -> Axes:
    """Frequency against time of every mode that `romsindy inspect --json` found.

    A dot is the larger the farther the mode swings there; dotted lines are where releases begin.
    """
    ax = Figure(figsize=(9, 3.2), layout="constrained").subplots()
    for mode in seen["modes"]:
        swing = [np.asarray(part["amplitude"], float) for part in mode["along"]]
        largest = max(float(np.nanmax(a)) for a in swing)
        for part, a in zip(mode["along"], swing, strict=True):
            size = _LARGEST * np.nan_to_num(a / largest)
            look: dict[str, Any] = {"color": f"C{(mode['number'] - 1) % 10}", "edgecolor": "none"}
            label = f"mode {mode['number']}" if part is mode["along"][0] else None
            ax.scatter(part["t"], part["frequency"], 2 + size, label=label, **look)
    for release in seen["releases"][1:]:
        ax.axvline(release["start"], color="0.5", ls=":", lw=1)
    highest = max(part[1].max() for _, _, part in _points(seen))
    ax.set(xlabel="time (s)", ylabel="frequency (Hz)", ylim=(0, 1.15 * highest))
    edge = 0.02 * (seen["end"] - seen["start"])  # so that no dot is cut
    ax.set_xlim(seen["start"] - edge, seen["end"] + edge)
    ax.figure.legend(loc="outside upper right", ncols=6, frameon=False)
    return ax


def picked(seen: Mapping[str, Any], inside: Mask) -> tuple[int | None, int | None]:
    """Number of the mode that has most of its points in a box, and its release if that is one.

    None stands for the mode that moves most, and for all releases: also where nothing is inside.
    """
    counts = {
        (mode, release): int(np.sum(inside(*points))) for mode, release, points in _points(seen)
    }
    modes = {mode: sum(n for (m, _), n in counts.items() if m == mode) for mode, _ in counts}
    best = max(modes, key=lambda mode: modes[mode])
    releases = [r for (m, r), n in counts.items() if m == best and n]
    return (best, releases[0] if len(releases) == 1 else None) if releases else (None, None)


def _points(seen: Mapping[str, Any]) -> Iterator[tuple[int, int, np.ndarray]]:
    """Number of the mode, of the release, and (2, n) times and frequencies."""
    for mode in seen["modes"]:
        for part in mode["along"]:
            yield mode["number"], part["release"], np.array([part["t"], part["frequency"]], float)
