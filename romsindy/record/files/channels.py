"""Channels with their rates: WAV, TDMS, universal files (55 and 58), SEP005 dictionaries.

SEP005 is the common form of time series of SDyPy and its readers (SDyPy enhancement proposal 5,
"Unified timeseries").
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import wavfile

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
