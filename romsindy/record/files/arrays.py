"""Named arrays: NPY and NPZ files, and what MATLAB and HDF5 files share with them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romsindy.record.files.columns import Column, Table, named, refused
from romsindy.record.units import RATES, UNITS, spelled

_RATE_NAMES = {"fs", "sr", "rate", "samplerate", "samplingrate", "samplingfrequency"}
_STEP_NAMES = {"dt", "deltat", "timestep", "samplingperiod", "samplinginterval"}
_UNIT_NAMES = {"unit", "units"}
_LABELLED = {"values": "label", "Data": "Name"}  # of Simulink: samples, and where their name is


def read_npy(path: Path) -> Table:
    """The columns of an array, which is mapped into memory and not copied."""
    with refused(path, "NPY"):
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        if array.offset + array.nbytes != path.stat().st_size:
            raise ValueError(f"{array.nbytes} bytes of numbers do not fill the file")
        return table_of(leaves("", array))


def read_npz(path: Path) -> Table:
    """The columns of an NPZ file."""
    with refused(path, "NPZ"), np.load(path, allow_pickle=False) as content:
        return table_of(leaves("", content))


def leaves(path: str, value: Any) -> Iterator[tuple[str, NDArray]]:
    """Names and arrays in nested structs (mappings, fields) and cells (objects)."""
    if hasattr(value, "_fieldnames"):  # a struct, as loadmat has it
        value = {name: getattr(value, name) for name in value._fieldnames}
    if isinstance(value, Mapping):
        label = _label(value)
        for key in value:
            if key in _LABELLED and label:
                yield from leaves(label, value[key])
            elif not str(key).startswith("__"):
                yield from leaves(f"{path}.{key}" if path else str(key), value[key])
    elif getattr(value, "dtype", np.dtype(int)).kind == "O":
        for i, inner in enumerate(np.ravel(value)):
            yield from leaves(f"{path}[{i}]", inner)
    elif names := getattr(getattr(value, "dtype", None), "names", None):
        for name in names:
            yield from leaves(f"{path}.{name}" if path else name, value[name])
    else:
        yield path, np.squeeze(value)


def _label(struct: Mapping[str, Any]) -> str:
    """What a signal or a time series of Simulink calls itself; empty where nothing does."""
    said = (struct.get(key) for data, key in _LABELLED.items() if data in struct)
    return next((str(s).strip() for s in said if isinstance(s, str)), "")


def table_of(
    content: Iterator[tuple[str, NDArray]], units: Mapping[str, str] | None = None
) -> Table:
    """The columns of named arrays; single numbers and texts among them say rate and unit.

    Parameters
    ----------
    content : iterator of (str, array)
        Names and arrays; of a matrix the longer axis is time, unless a vector is as long as the
        shorter one.
    units : mapping, optional
        Units by name, where the kind of file has them.
    """
    arrays = {name: np.asanyarray(x) for name, x in content}
    rates = {rate for name, x in arrays.items() if (rate := _rate(name, x))}
    texts = {str(x) for name, x in arrays.items() if x.ndim == 0 and _end(name) in _UNIT_NAMES}
    unit = texts.pop() if len(texts) == 1 else None
    vectors = {len(x) for x in arrays.values() if x.ndim == 1}
    columns = [
        _with_unit(named(label, values, (units or {}).get(name)), unit)
        for name, x in arrays.items()
        for label, values in _vectors(name, x, vectors)
    ]
    return Table(columns, rates.pop() if len(rates) == 1 else None)


def _end(name: str) -> str:
    """Last part of a name, without what sets words apart."""
    return re.sub(r"[\W_]", "", re.split(r"[./]", name)[-1]).lower()


def _rate(name: str, x: NDArray) -> float | None:
    """Samples per second, if a number of this name says them."""
    if x.ndim or x.dtype.kind not in "iuf" or not 0 < float(x) < np.inf:
        return None
    if _end(name) in _STEP_NAMES:
        return 1 / float(x)
    return float(x) if _end(name) in _RATE_NAMES else None


def _vectors(name: str, x: NDArray, lengths: Collection[int]) -> Iterator[tuple[str, NDArray]]:
    if x.dtype.kind == "M":
        x = (x - x.flat[0]) / np.timedelta64(1, "s")
    if x.dtype.kind not in "iuf" or x.ndim not in (1, 2) or x.size < 2:
        return
    if x.ndim == 1:
        yield name or "1", x
        return
    along = next((axis for axis in (0, 1) if x.shape[axis] in lengths), int(np.argmax(x.shape)))
    for i, values in enumerate(x.T if along == 0 else x):
        yield f"{name}[{i}]" if name else str(i + 1), values


def _with_unit(column: Column, unit: str | None) -> Column:
    """The column with the one unit of the file, which may be that of q for its rates too."""
    known = spelled(unit or "")
    if column.unit is not None or column.is_time or known not in UNITS:
        return column
    rate = column.quantity or "displacement"
    suffix = RATES[rate] if UNITS[known].quantity == "displacement" else ""
    return replace(column, unit=known + suffix)
