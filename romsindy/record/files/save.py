"""Files of our own: written whole or not at all, decays with every digit and field."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from romsindy.record.decay import Decay
from romsindy.record.files.columns import named, refused

_STREAMS = ("dev", "proc")  # folders of what is no file, or another name of an open one
_RATES = {"q": "", "q_dot": "/s", "q_ddot": "/s^2"}  # after the unit of q
_FIELDS = ("unit", "measured", "stage", "notes", "leftover", "beside", "slowest")
_MARK = "# romsindy "  # first line of a CSV that `save_decay` wrote


def is_stream(path: str | Path) -> bool:
    """Whether a path is a pipe or a device, which hold nothing that could be lost."""
    path = Path(os.path.abspath(path))
    return path.parts[1:2] in [(name,) for name in _STREAMS] or (
        path.exists() and not path.is_file()
    )


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """A new file beside ``path`` to write to, which takes its place when all is written.

    Where writing fails or is interrupted, what was there stays as it was. Permissions stay too; of
    a link, what it points to is replaced. What is no file (`is_stream`) is written to as it is.

    Raises an OSError if it cannot be written, or not be moved: then the message names the new file,
    which stays.
    """
    if is_stream(path):
        yield Path(path)
        return
    place = Path(os.path.realpath(path))
    new = place.with_name(f".romsindy-{secrets.token_hex(4)}{place.suffix}")
    try:
        yield new
        if place.exists():
            shutil.copymode(place, new)
    except BaseException as error:
        new.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename = str(path)  # the one that the user knows
        raise
    try:
        os.replace(new, place)
    except OSError as error:
        reason = f"{error.strerror}; what was to stand there is whole in {new}"
        raise OSError(error.errno, reason, str(path)) from error


def write_whole(path: str | Path, text: str) -> None:
    """Write a text in UTF-8 as `whole` does."""
    with whole(path) as new:
        new.write_text(text, encoding="utf-8")


def save_decay(decay: Decay, path: str | Path) -> None:
    """Write a decay to .csv or .npz, so that `load_decay` gives it back: every digit and field.

    Raises
    ------
    ValueError
        If the name ends otherwise, or a CSV would need several channels.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from romsindy import example_decay, load_decay
    >>> with TemporaryDirectory() as folder:
    ...     save_decay(example_decay(periods=5), f"{folder}/decay.csv")
    ...     load_decay(f"{folder}/decay.csv")
    <Decay: 501 samples at 95.493 Hz, 5.236 s, max |q| 1.85 m, measured displacement>
    """
    path = Path(path)
    signals = {n: getattr(decay, n) for n in _RATES}
    signals = {n: x for n, x in signals.items() if x is not None}
    fields = json.dumps({name: getattr(decay, name) for name in _FIELDS})
    if path.suffix == ".npz":
        with whole(path) as new:
            np.savez(new, t=decay.t, **signals, unit=decay.unit or "", romsindy=fields)
        return
    if path.suffix != ".csv":
        raise ValueError(f"{path}: name a .csv or an .npz file")
    decay.single()
    table = np.stack([decay.t, *(x.reshape(len(x)) for x in signals.values())], axis=1)
    units = [f" [{decay.unit}{_RATES[n]}]" if decay.unit else "" for n in signals]
    names = ",".join(["t [s]", *(n + u for n, u in zip(signals, units, strict=True))])
    header = f"{_MARK}{fields}\n{names}"
    with whole(path) as new:
        np.savetxt(new, table, delimiter=",", header=header, comments="", fmt="%.17g")


def saved(path: Path) -> Decay | None:
    """What `save_decay` wrote; None for any other file.

    Raises a ValueError if it was damaged since.
    """
    if path.suffix == ".npz":
        with refused(path, "NPZ"), np.load(path, allow_pickle=False) as content:
            if "romsindy" not in content:
                return None
            return _decay(str(content["romsindy"]), {n: content[n] for n in content})
    with path.open(encoding="utf-8", errors="replace") as file:
        first, names = file.readline(), file.readline()
    if path.suffix != ".csv" or not first.startswith(_MARK):
        return None
    with refused(path, "CSV of romsindy"):
        table = np.loadtxt(path, delimiter=",", skiprows=2, ndmin=2)
        keys = [named(name, np.empty(0)).name for name in names.split(",")]
        return _decay(first[len(_MARK) :], dict(zip(keys, table.T, strict=True)))


def _decay(fields: str, arrays: dict[str, Any]) -> Decay:
    signals = {name: arrays[name] for name in ("t", *_RATES) if name in arrays}
    return Decay(**signals, **json.loads(fields))
