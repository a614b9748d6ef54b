"""HDF5 and MATLAB v7.3 files, read by h5py."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romsindy.record.files.arrays import leaves, table_of
from romsindy.record.files.columns import Table, library, refused

# Times the size of the file: a data set that claims more is damaged, no measurement packs so well.
_LARGEST = 1000
_DEEPEST = 20  # levels of groups; references of a damaged file may go round in circles
_UNIT_NAMES = ("unit", "units", "Unit", "Units", "unit_string")


def read(path: Path) -> Table:
    """The columns of an HDF5 file, named by their path; attributes may say units and rates.

    Raises
    ------
    ValueError
        If it is broken, or h5py is not installed.
    """
    h5py = library("h5py", path)
    with refused(path, "HDF5"), h5py.File(path, "r") as file:
        found = list(_items("", file, h5py))
        units = {n: _text(x.attrs[k]) for n, x in found for k in _UNIT_NAMES if k in x.attrs}
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
