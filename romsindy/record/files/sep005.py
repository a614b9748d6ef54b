"""SEP005 dictionaries, the common form of time series of SDyPy and its readers.

Source: SDyPy enhancement proposal 5, "Unified timeseries".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from romsindy.record.files.columns import Column, Table, named
from romsindy.record.recording import Quantity
from romsindy.record.sampling import as_floats, as_seconds
from romsindy.typing import Array

_QUANTITIES: dict[str, Quantity] = {"d": "displacement", "v": "velocity", "a": "acceleration"}
_OTHERS = {"f": "N", "e": "strain", "s": "Pa"}  # no motion


def read(series: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> Table:
    """Channels of one SEP005 dictionary or of several.

    Raises
    ------
    ValueError
        If an entry is missing or does not fit; the message names channel and key.
    """
    many = [series] if isinstance(series, Mapping) else list(series)
    if not many:
        raise ValueError("SEP005: an empty list of channels")
    return Table([column for i, one in enumerate(many) for column in _columns(i, one)])


def _columns(i: int, one: Mapping[str, Any]) -> list[Column]:
    where = f"SEP005 channel {i + 1}"
    if not isinstance(one, Mapping):
        raise ValueError(f"{where} is a {type(one).__name__}: give dictionaries")
    if missing := [key for key in ("data", "name", "unit_str") if key not in one]:
        raise ValueError(f"{where} has no {missing}: give data, name, unit_str and time or fs")
    data = np.atleast_2d(as_floats(f"{where}, data", one["data"]))
    if data.ndim != 2:
        raise ValueError(f"{where}, data: shape {data.shape} must be (n,) or (channels, n)")
    t = _times(where, one, data.shape[1])
    code, unit = str(one.get("quantity", "")).lower(), str(one["unit_str"])
    if code in _OTHERS and not unit:
        unit = _OTHERS[code]
    names = [one["name"]] if isinstance(one["name"], str) else list(one["name"])
    if len(names) != len(data):
        names = [f"{names[0]}[{k}]" for k in range(len(data))]
    return [
        named(str(name), values, unit, said=_QUANTITIES.get(code), t=t)
        for name, values in zip(names, data, strict=True)
    ]


def _times(where: str, one: Mapping[str, Any], n: int) -> Array:
    if one.get("time") is not None:
        t = as_seconds(f"{where}, time", one["time"])
    else:
        fs = as_floats(f"{where}, fs", one.get("fs", np.nan))
        if fs.ndim or not 0 < fs < np.inf:
            raise ValueError(f"{where}, fs = {one.get('fs')!r}: give samples per second, or time")
        t = np.arange(n) / fs
    if t.shape != (n,):
        raise ValueError(f"{where}: {n} samples, but time has shape {t.shape}")
    return t
