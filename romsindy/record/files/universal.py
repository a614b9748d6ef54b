"""Universal files: functions of time (dataset 58) by pyuff, transient data at nodes (55)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from romsindy.record.files.columns import Column, Table, library, named, refused
from romsindy.record.recording import Quantity
from romsindy.record.units import RATES, UNITS, spelled
from romsindy.typing import Array

_MEANINGS: dict[int, Quantity] = {8: "displacement", 11: "velocity", 12: "acceleration"}
_DIRECTIONS = ("", "X", "Y", "Z", "RX", "RY", "RZ")
_TIME_RESPONSE, _TRANSIENT, _REAL = 1, 4, 2
_TIME = 17  # of an abscissa; 0 and 1 are "unknown" and "general"


def read(path: Path) -> Table:
    """Channels of a universal file, by node and direction.

    Raises
    ------
    ValueError
        If it is broken, cut off or without functions of time, or pyuff is not installed.
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
        columns = [_column(s, length) for s in sets if s.get("func_type") == _TIME_RESPONSE]
        columns += _transient(content, length) if 55 in kinds else []
    if not columns:
        raise ValueError(f"{path}: no functions of time in datasets {kinds}: export those")
    return Table(columns)


def _column(function: dict[str, Any], length: float | None) -> Column:
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
