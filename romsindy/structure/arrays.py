"""A structure from a file of arrays, as any finite-element program can write them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.sparse import coo_array, issparse

from romsindy.structure.structure import Structure

_NEEDED = ("mass", "shapes", "omega", "nodes", "directions")
_CASE = re.compile(r"factors_(\d+)$")
KINDS = (".npz", ".mat", ".h5", ".hdf5")


def load_structure(path: str | Path) -> Structure:
    """Read the arguments of `Structure.from_arrays` from an NPZ, a MATLAB or an HDF5 file.

    It holds mass (n, n), or mass_row, mass_column (counted from 0) and mass_value of its entries;
    shapes (k, n), omega (k,), nodes (n,), directions (n,); of each mode that was held, such as the
    first, factors_1 (m,) and displacements_1 (m, n), and if they are known tangents_1 (m, n, n);
    and, for pictures, coordinates (n_nodes, 4): number of the node, x, y, z.

    Raises
    ------
    ValueError
        For a file that cannot be read, an array that is missing, or arrays that do not fit.
    """
    content = _content(Path(path))
    if "mass" not in content and "mass_value" in content:
        rows, columns = (_flat(content[f"mass_{name}"]).astype(int) for name in ("row", "column"))
        size = max(rows.max(), columns.max()) + 1
        content["mass"] = coo_array((_flat(content["mass_value"]), (rows, columns)), (size, size))
    missing = [name for name in _NEEDED if name not in content]
    modes = [int(found[1]) for name in content if (found := _CASE.match(name))]
    if missing or not modes:
        name = missing[0] if missing else "factors_1"
        raise ValueError(
            f"{path}: there is no array {name!r}: a structure has {', '.join(_NEEDED)}, and"
            " factors_1 with displacements_1 of static cases"
        )
    try:
        cases = {m: (_flat(content[f"factors_{m}"]), content[f"displacements_{m}"]) for m in modes}
        places = np.asarray(content.get("coordinates", np.zeros((0, 4))))
        return Structure.from_arrays(
            content["mass"],
            content["shapes"],
            _flat(content["omega"]),
            cases,
            _flat(content["nodes"]).astype(int),
            _flat(content["directions"]).astype(int),
            {int(row[0]): row[1:] for row in places},
            str(path),
            {m: content[f"tangents_{m}"] for m in modes if f"tangents_{m}" in content},
        )
    except (KeyError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def _content(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file")
    if path.suffix.lower() == ".mat":
        return dict(loadmat(path, squeeze_me=False))
    if path.suffix.lower() in (".h5", ".hdf5"):
        return _hdf5(path)
    with np.load(path) as file:
        return dict(file)


def _hdf5(path: Path) -> dict[str, Any]:
    try:
        import h5py
    except ImportError as error:
        raise ValueError(
            f'{path}: HDF5 is read by h5py: pip install "romsindy[formats]", or write NPZ'
        ) from error
    with h5py.File(path) as file:
        return {name: np.asarray(values) for name, values in file.items()}


def _flat(values: Any) -> Any:
    return np.asarray(values.todense() if issparse(values) else values).ravel()
