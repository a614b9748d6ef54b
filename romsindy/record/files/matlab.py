"""MATLAB v5 files, read by SciPy."""

from __future__ import annotations

import struct
from pathlib import Path

from scipy.io import loadmat

from romsindy.record.files.arrays import leaves, table_of
from romsindy.record.files.columns import Table, refused

# Of the format's manual: types of data elements, and classes of arrays.
_NUMBERS = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13}
_MATRIX, _COMPRESSED, _TEXTS = 14, 15, {16, 17, 18}
_NUMERIC_CLASSES, _LAST_CLASS = range(5, 16), 18


def read(path: Path) -> Table:
    """The columns of a MATLAB v5 file; those in structs and cells are named by their path."""
    with refused(path, "MATLAB v5"):
        content = path.read_bytes()
        if content.startswith(b"MATLAB 5.0"):
            order = "<" if content[126:128] == b"IM" else ">"
            _check(content, order, 128, len(content), {_MATRIX, _COMPRESSED})
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
        return table_of(leaves("", content))


def _check(content: bytes, order: str, start: int, end: int, kinds: set[int]) -> None:
    """Refuse data elements of unknown type or size, which bring SciPy's reader down."""
    flags = None
    while start + 8 <= end:
        kind, size = struct.unpack_from(order + "II", content, start)
        data = start + 8
        if kind >> 16:  # a small element: its size and data are in the tag
            kind, size, data = kind & 0xFFFF, kind >> 16, start + 4
        if kind not in kinds or data + size > end:
            raise ValueError(f"a data element of type {kind} and {size} bytes at byte {start}")
        if kind == _MATRIX:
            _check(content, order, data, data + size, _NUMBERS | _TEXTS | {_MATRIX})
        if flags is None and kinds >= _TEXTS:  # the first element of an array: its flags
            flags = struct.unpack_from(order + "I", content, data)[0] & 0xFF if size == 8 else 0
            if not 0 < flags <= _LAST_CLASS:
                raise ValueError(f"an array of class {flags} at byte {start}")
            kinds = kinds - {_MATRIX} if flags in _NUMERIC_CLASSES else kinds
        start = data + (size if kind == _COMPRESSED else size + -(data + size) % 8)
