"""MATLAB v5 files, read by SciPy, whose reader crashes on some broken ones: those are found first.

Source: MathWorks, "MAT-File Format", level 5.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path

from scipy.io import loadmat

from romsindy.record.files.arrays import leaves, table_of
from romsindy.record.files.columns import Table, refused

# Types of data elements, and classes of arrays.
_NUMBERS = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13}
_MATRIX, _COMPRESSED, _TEXTS = 14, 15, {16, 17, 18}
_CONTAINERS, _SPARSE, _NUMERIC, _LAST = range(1, 4), 5, range(5, 16), 18
_COMPLEX = 0x800


def read(path: Path) -> Table:
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
