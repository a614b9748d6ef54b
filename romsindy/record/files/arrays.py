"""Named arrays: files of NumPy, of MATLAB (5 and 7.3) and HDF5.

SciPy, which reads MATLAB 5, crashes on some broken files: those are found first.

Source: MathWorks, "MAT-File Format", level 5.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from romsindy.record.files.columns import Column, Table, library, named, refused
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

    Of a matrix the longer axis is time, unless a vector is as long as the shorter one. Some kinds
    of file have ``units`` by name.
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


# Types of data elements, and classes of arrays.
_NUMBERS = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13}
_MATRIX, _COMPRESSED, _TEXTS = 14, 15, {16, 17, 18}
_CONTAINERS, _SPARSE, _NUMERIC, _LAST = range(1, 4), 5, range(5, 16), 18
_COMPLEX = 0x800


def read_matlab(path: Path) -> Table:
    """The columns of a MATLAB v5 file; those in structs and cells are named by their path."""
    with refused(path, "MATLAB v5"):
        content = path.read_bytes()
        if 0 not in content[:4]:  # else it is level 4
            order = "<" if content[126:128] == b"IM" else ">"
            for kind, start, size in _elements(content, order, 128, len(content)):
                if kind == _MATRIX:
                    _check_array(content, order, start, start + size)
                elif kind != _COMPRESSED:  # those have a check sum
                    raise ValueError(f"an element of type {kind} at byte {start}")
        variables = loadmat(path, squeeze_me=True, struct_as_record=False)
        return table_of(leaves("", variables))


def _elements(content: bytes, order: str, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Type, start and size of the data elements between two bytes."""
    while start + 8 <= end:
        kind, size = struct.unpack_from(order + "II", content, start)
        data = start + 8
        if kind >> 16:  # a small element: its size and data are in the tag
            kind, size, data = kind & 0xFFFF, kind >> 16, start + 4
        if kind not in _NUMBERS | _TEXTS | {_MATRIX, _COMPRESSED} or data + size > end:
            raise ValueError(f"an element of type {kind} and {size} bytes at byte {start}")
        yield kind, data, size
        start = data + size + (0 if kind == _COMPRESSED else -(data + size) % 8)


def _check_array(content: bytes, order: str, start: int, end: int) -> None:
    """Refuse flags, dimensions and parts of an array that do not belong together."""
    parts = list(_elements(content, order, start, end))
    if not parts:  # an empty cell
        return
    if len(parts) < 3 or parts[0][2] != 8:
        raise ValueError(f"an array without flags, dimensions or name at byte {start}")
    flags = struct.unpack_from(order + "I", content, parts[0][1])[0]
    shape = struct.unpack_from(order + f"{parts[1][2] // 4}i", content, parts[1][1])
    kind, kinds = flags & 0xFF, {kind for kind, *_ in parts}
    needed = 4 + 2 * (kind == _SPARSE) + bool(flags & _COMPLEX)
    is_numeric = kind in _NUMERIC
    if (
        not 0 < kind <= _LAST
        or (is_numeric and (len(parts) < needed or not kinds <= _NUMBERS))
        or (kind in _CONTAINERS and not 0 <= 8 * math.prod(shape) <= end - start)
    ):
        raise ValueError(
            f"an array of class {kind}, shape {shape}, {len(parts)} parts at byte {start}"
        )
    for inner, data, size in parts:
        if inner == _MATRIX:
            _check_array(content, order, data, data + size)


# Times the size of the file: a data set that claims more is damaged, no measurement packs so well.
_LARGEST = 1000
_DEEPEST = 20  # levels of groups; references of a damaged file may go round in circles
_UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units", "unit_string")


def read_hdf(path: Path) -> Table:
    """The columns of an HDF5 file, named by their path; attributes may say units and rates.

    Raises a ValueError if it is broken, or h5py is not installed.
    """
    h5py = library("h5py", path)
    with refused(path, "HDF5"), h5py.File(path, "r") as file:
        found = list(_items("", file, h5py))
        units = {n: _text(x.attrs[k]) for n, x in found for k in _UNIT_ATTRIBUTES if k in x.attrs}
        return table_of(_arrays(found, _LARGEST * path.stat().st_size), units)


def _items(name: str, item: Any, h5py: Any) -> Iterator[tuple[str, Any]]:
    """Groups and data sets; references, MATLAB's cells, are followed."""
    if name.count(".") + name.count("[") > _DEEPEST:
        raise ValueError(f"groups in groups, {_DEEPEST} deep")
    if isinstance(item, h5py.Group):
        yield name, item
        for key, inner in item.items():
            if not key.startswith("#"):  # where MATLAB keeps what its references point to
                yield from _items(f"{name}.{key}" if name else key, inner, h5py)
    elif item.dtype == h5py.ref_dtype:
        for i, reference in enumerate(item[()].ravel()):
            yield from _items(f"{name}[{i}]", item.file[reference], h5py)
    else:
        yield name, item


def _arrays(items: list[tuple[str, Any]], largest: int) -> Iterator[tuple[str, NDArray]]:
    for name, item in items:
        for key, value in item.attrs.items():
            if np.size(value) == 1:  # a sampling rate, perhaps
                yield f"{name}.{key}" if name else key, np.squeeze(value)
        if not hasattr(item, "dtype"):
            continue
        if item.nbytes > largest:
            raise ValueError(f"{name} claims {item.nbytes} bytes")
        if item.attrs.get("MATLAB_class") == b"char":
            yield name, np.asarray("".join(map(chr, item[()].ravel())))
        elif item.dtype.kind == "O":
            yield name, np.asarray(_text(item[()]))
        else:
            yield from leaves(name, item[()])


def _text(value: Any) -> str:
    value = value.flat[0] if isinstance(value, np.ndarray) and value.size else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
