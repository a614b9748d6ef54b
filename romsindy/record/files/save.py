"""Decays in files of our own, with every digit and field."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from romsindy.record.decay import Decay
from romsindy.record.files.columns import named, refused
from romsindy.record.files.whole import whole

_RATES = {"q": "", "q_dot": "/s", "q_ddot": "/s^2"}  # after the unit of q
_FIELDS = ("unit", "measured", "stage", "notes", "leftover")
_MARK = "# romsindy "  # first line of a CSV that `save_decay` wrote


def save_decay(decay: Decay, path: str | Path) -> None:
    """Write a decay to .csv or .npz, so that `load_decay` gives it back: every digit and field.

    Raises
    ------
    ValueError
        If the name ends otherwise, or a CSV would need several channels.
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
