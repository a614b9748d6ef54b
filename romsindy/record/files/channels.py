"""Channels with their rates: WAV, TDMS, universal files (55 and 58), SEP005 dictionaries.

SEP005 is the common form of time series of SDyPy and its readers (SDyPy enhancement proposal 5,
"Unified timeseries").

Named arrays: files of NumPy, of MATLAB (5 and 7.3) and HDF5.

SciPy, which reads MATLAB 5, crashes on some broken files: those are found first.

Source: MathWorks, "MAT-File Format", level 5.
"""

from __future__ import annotations

import logging
import math
import re
import struct
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, wavfile

from romsindy.record.files.columns import Column, Table, library, named, refused
from romsindy.record.recording import Quantity, as_floats, as_seconds
from romsindy.record.units import RATES, UNITS, spelled
from romsindy.typing import Array


def read_wav(path: Path) -> Table:
    """Channels of a WAV file, within -1 and 1; what they measure is not in the file.

    Raises a ValueError if it is broken or cut off.
    """
    with path.open("rb") as file:
        start = file.read(8)
    size = path.stat().st_size
    promised = 8 + int.from_bytes(start[4:8], "big" if start.startswith(b"RIFX") else "little")
    # 0 and 2^32 - 1 stand for "not known" in files that were streamed; one byte may fill up.
    known = start.startswith(b"RIF") and 8 < promised < 0xFFFFFFFF
    if known and not promised <= size <= promised + 1:
        raise ValueError(f"{path}: damaged, {size} bytes in place of {promised}: copy it again")
    with refused(path, "WAV"):
        rate, samples = wavfile.read(path)
        x = samples.reshape(len(samples), -1)
        if x.dtype.kind != "f":
            x = x / 2.0 ** (8 * x.dtype.itemsize - 1) - (x.dtype.kind == "u")
        if not rate > 0:
            raise ValueError(f"a sampling rate of {rate} Hz")
        t = np.arange(len(x)) / rate
        return Table([Column(str(i + 1), v, t=t) for i, v in enumerate(x.T)])


_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "unit", "Unit")


def read_tdms(path: Path) -> Table:
    """Channels of a TDMS file; their waveform properties give the times.

    Raises a ValueError if it is broken, or nptdms is not installed.
    """
    nptdms = library("nptdms", path)
    with refused(path, "TDMS"):
        nptdms.log.log_manager.set_level(logging.ERROR)  # its warnings are our refusals
        _refuse_other_size(path)
        file = nptdms.TdmsFile.read(path)
        groups = [group for group in file.groups() if group.channels()]
        several = len(groups) > 1
        columns = [
            _channel(f"{group.name}/" * several + channel.name, channel)
            for group in groups
            for channel in group.channels()
            if len(channel) and channel[:].dtype.kind in "iufM"
        ]
    return Table(columns)


def _refuse_other_size(path: Path) -> None:
    """Segments tell their length; nptdms reads on where they do not fill the file."""
    position, size = 0, path.stat().st_size
    with path.open("rb") as file:
        while position < size:
            file.seek(position)
            start = file.read(28)  # mark, flags, version; length and where the numbers start
            if not start.startswith(b"TDSm") or len(start) < 28:
                raise ValueError(f"no segment at byte {position} of {size}")
            order = "big" if start[4] & 64 else "little"
            position += 28 + int.from_bytes(start[12:20], order)  # type: ignore[arg-type]
    if position != size:
        raise ValueError(f"cut off, {size} of {position} bytes are there")


def _channel(name: str, channel: Any) -> Column:
    values = channel[:]
    if values.dtype.kind == "M":  # time stamps of the samples
        return Column(name, (values - values[0]) / np.timedelta64(1, "s"), "s")
    properties = channel.properties
    unit = next((str(properties[key]) for key in _UNIT_PROPERTIES if key in properties), None)
    step = float(properties.get("wf_increment", 0.0))
    start = float(properties.get("wf_start_offset", 0.0))
    t = start + step * np.arange(len(values)) if step > 0 else None
    return named(name, values, unit, t=t)


_MEANINGS: dict[int, Quantity] = {8: "displacement", 11: "velocity", 12: "acceleration"}
_DIRECTIONS = ("", "X", "Y", "Z", "RX", "RY", "RZ")
_TIME_RESPONSE, _TRANSIENT, _REAL = 1, 4, 2
_TIME = 17  # of an abscissa; 0 and 1 are "unknown" and "general"


def read_universal(path: Path) -> Table:
    """Channels of a universal file, by node and direction.

    Raises a ValueError if it is broken, cut off or without functions of time, or pyuff is not
    installed.
    """
    pyuff = library("pyuff", path)
    content = path.read_bytes()
    if not content.rstrip().endswith(b"-1"):
        raise ValueError(f"{path}: cut off, for no line -1 ends it: copy it again")
    with refused(path, "UFF"):
        file = pyuff.UFF(str(path))
        kinds = [int(kind) for kind in file.get_set_types()]
        sets = [file.read_sets(i) for i, kind in enumerate(kinds) if kind in (58, 164)]
        length = next((s["length"] for s in sets if s["type"] == 164), None)
        columns = [_function(s, length) for s in sets if s.get("func_type") == _TIME_RESPONSE]
        columns += _transient(content, length) if 55 in kinds else []
    if not columns:
        raise ValueError(f"{path}: no functions of time in datasets {kinds}: export those")
    return Table(columns)


def _function(function: dict[str, Any], length: float | None) -> Column:
    values, count = function["data"], int(function["num_pts"])
    if np.iscomplexobj(values):
        raise ValueError("a time response of complex numbers")
    if len(values) != count:
        raise ValueError(f"cut off, {len(values)} of {count} values are there")
    if function["abscissa_spec_data_type"] not in (0, 1, _TIME):
        raise ValueError("a time response over something else than time")
    code = int(function["ordinate_spec_data_type"])
    label = str(function["ordinate_axis_units_lab"]).strip()
    unit = "" if label in ("NONE", "") else label
    node, direction = int(function["rsp_node"]), int(function["rsp_dir"])
    return _signal(node, direction, values, function["x"], code, unit, length)


def _signal(
    node: int, direction: int, values: Array, t: Array, code: int, unit: str, length: float | None
) -> Column:
    sign = "-" if direction < 0 else "+" if direction else ""
    name = f"{node}{sign}{_DIRECTIONS[abs(direction)]}"
    said = _MEANINGS.get(code)
    if not unit and said and length and abs(direction) <= 3:
        # Dataset 164: to SI by division.
        values, unit = values / length, f"m{RATES[said]}"
    if not said and code > 1 and spelled(unit) not in UNITS:
        unit = unit or f"data type {code}"  # a force, a strain, ...: no motion
    return named(name, values, unit, said=said, t=t)


def _transient(content: bytes, length: float | None) -> list[Column]:
    """Dataset 55, one for every instant; pyuff does not know its times."""
    steps = list(_instants(content))
    t = np.array([time for time, *_ in steps])
    shapes = {(code, tuple(nodes)) for _, code, nodes, _ in steps}
    if len(shapes) > 1:
        raise ValueError("the instants of dataset 55 do not have the same nodes")
    x = np.array([values for *_, values in steps]).reshape(len(t), -1)
    return [
        _signal(node, k + 1, x[:, i * n + k], t, code, "", length)
        for code, nodes in shapes
        for n in [x.shape[1] // len(nodes)]
        for i, node in enumerate(nodes)
        for k in range(min(n, 6))
    ]


def _instants(content: bytes) -> Iterator[tuple[float, int, list[int], list[float]]]:
    """Time, data type, nodes and values of every instant; records as in the format's manual."""
    for block in re.split(r"^ {4}-1 *$", content.decode("latin-1"), flags=re.MULTILINE):
        lines = block.strip("\r\n").splitlines()
        if not lines or lines[0].strip() != "55":
            continue
        _, analysis, _, code, data_type, per_node = map(int, lines[6].split())
        if (analysis, data_type) != (_TRANSIENT, _REAL):
            continue
        rows = 1 + -(-per_node // 6)  # the node, and its values by sixes
        body, values = lines[9:], []
        for i in range(0, len(body), rows):
            cells = [row[13 * k : 13 * k + 13] for row in body[i + 1 : i + rows] for k in range(6)]
            values += [float(cell) for cell in cells if cell.strip()]
        nodes = [int(body[i]) for i in range(0, len(body), rows)]
        if len(values) != per_node * len(nodes):
            raise ValueError(f"{len(values)} values where {len(nodes)} nodes need {per_node} each")
        yield float(lines[8][:13]), code, nodes, values


_QUANTITIES: dict[str, Quantity] = {"d": "displacement", "v": "velocity", "a": "acceleration"}
_OTHERS = {"f": "N", "e": "strain", "s": "Pa"}  # no motion


def read_sep005(series: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> Table:
    """Channels of one SEP005 dictionary or of several.

    Raises a ValueError if an entry is missing or does not fit; the message names channel and key.
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
