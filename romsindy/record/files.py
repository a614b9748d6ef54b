"""Decays from and to files: CSV, NPZ, MATLAB v5."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from romsindy.record.decay import Decay
from romsindy.record.recording import Quantity
from romsindy.record.units import TIMES, UNITS, parse_unit
from romsindy.typing import Array

_TIME_NAMES = {"t", "time", "times", "zeit", "temps", "seconds", "timestamp"}
_RATE_NAMES: dict[Quantity, set[str]] = {
    "velocity": {"v", "vel", "velocity", "speed", "q_dot", "qdot", "x_dot", "xdot"},
    "acceleration": {"a", "acc", "accel", "acceleration", "q_ddot", "qddot", "x_ddot", "xddot"},
}
# Of the signals of a decay, after the unit of q; and its other fields.
_RATES = {"q": "", "q_dot": "/s", "q_ddot": "/s^2"}
_FIELDS = ("unit", "measured", "stage", "notes")
_MARK = "# romsindy "  # first line of a CSV that `save_decay` wrote


@dataclass(frozen=True)
class _Column:
    """One column of a file, with the unit that its header names, if any."""

    name: str
    values: Array
    unit: str | None = None

    @property
    def is_time(self) -> bool:
        return self.name.lower() in _TIME_NAMES or self.unit in TIMES

    @property
    def quantity(self) -> Quantity:
        if self.unit in UNITS:
            return UNITS[self.unit].quantity
        found = [q for q, names in _RATE_NAMES.items() if self.name.lower() in names]
        return found[0] if found else "displacement"


def load_decay(
    path: str | Path,
    unit: str | None = None,
    quantity: Quantity | None = None,
    *,
    column: str | Sequence[str] | None = None,
    time: str | None = None,
    rate: float | None = None,
    start: float | None = None,
    end: float | None = None,
) -> Decay:
    """Read a decay from CSV, NPZ or a MATLAB v5 file, converted to SI units.

    CSV may be separated by commas, semicolons or tabs, with or without a header; a header such as
    ``t [ms], q [mm]`` names units. Decimal commas are understood where they separate nothing.

    Parameters
    ----------
    path : path
        A file whose name ends in .csv, .txt, .tsv, .npz or .mat.
    unit : str, optional
        Unit of the measured column in the file, such as "mm", "m/s", "g", "deg"; it overrides
        the header. Without any, q stays in its own unit, which is then unknown.
    quantity : "displacement", "velocity" or "acceleration", optional
        What was measured; by default what unit or header say, and displacement otherwise.
    column : str or list of str, optional
        Name of the measured column (``"2"`` is the second of a file without header); several make
        several channels. Needed where more than one column could be meant.
    time : str, optional
        Name of the time column; found by its name, or else the first.
    rate : float, optional
        Samples per second, for files without times.
    start, end : float, optional
        Part of the record to keep, in s. The free decay within it is found by the analysis.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file cannot be understood; the message names the line or the column, and the remedy.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    saved = _saved(path) if (unit, quantity, column, time, rate) == (None,) * 5 else None
    if saved is not None:
        return saved.between(start, end)
    columns = _read(path)
    clock, others = _split_time(path, columns, time, rate)
    quantity = quantity or (parse_unit(unit).quantity if unit else None)
    chosen = _choose(path, others, column, quantity)
    for used in [clock, *chosen]:
        _refuse_missing(path, used)
    quantity = quantity or chosen[0].quantity
    text = unit or chosen[0].unit
    base, factor = _conversion(text, quantity)
    t = clock.values * TIMES.get(clock.unit or "s", 1.0)
    x = np.stack([c.values for c in chosen], axis=1) * factor
    x = x[:, 0] if len(chosen) == 1 else x
    if quantity == "displacement":
        decay = Decay(t, x, *_derivatives(chosen, others, factor), unit=base)
    elif quantity == "velocity":
        decay = Decay.from_velocity(t, x, base)
    elif quantity == "acceleration":
        decay = Decay.from_acceleration(t, x, base)
    else:
        raise ValueError(f"quantity = {quantity!r} must be displacement, velocity or acceleration")
    return decay.between(start, end)


def save_decay(decay: Decay, path: str | Path) -> None:
    """Write a decay to .csv or .npz, so that `load_decay` gives it back: every digit and field.

    Raises
    ------
    ValueError
        If the name ends otherwise, or a CSV would need several channels.
    """
    path = Path(path)
    signals = {n: getattr(decay, n) for n in _RATES}
    signals = {n: x for n, x in signals.items() if x is not None}
    fields = json.dumps({name: getattr(decay, name) for name in _FIELDS})
    if path.suffix == ".npz":
        np.savez(path, t=decay.t, **signals, unit=decay.unit or "", romsindy=fields)
        return
    if path.suffix != ".csv":
        raise ValueError(f"{path}: name a .csv or an .npz file")
    decay.single()
    table = np.stack([decay.t, *(x.reshape(len(x)) for x in signals.values())], axis=1)
    units = [f" [{decay.unit}{_RATES[n]}]" if decay.unit else "" for n in signals]
    names = ",".join(["t [s]", *(n + u for n, u in zip(signals, units, strict=True))])
    header = f"{_MARK}{fields}\n{names}"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.17g")


def _saved(path: Path) -> Decay | None:
    """What `save_decay` wrote; None for any other file."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as content:
            if "romsindy" not in content:
                return None
            fields = json.loads(str(content["romsindy"]))
            signals = {n: content[n] for n in ("t", *_RATES) if n in content}
        return Decay(**signals, **fields)
    with path.open(encoding="utf-8", errors="replace") as file:
        first, names = file.readline(), file.readline()
    if path.suffix != ".csv" or not first.startswith(_MARK):
        return None
    table = np.loadtxt(path, delimiter=",", skiprows=2, ndmin=2)
    keys = [_name_and_unit(name)[0] for name in names.split(",")]
    return Decay(**dict(zip(keys, table.T, strict=True)), **json.loads(first[len(_MARK) :]))


# -- reading ------------------------------------------------------------------------------------


def _read(path: Path) -> list[_Column]:
    suffix = path.suffix.lower()
    if path.stat().st_size == 0:
        raise ValueError(f"{path}: the file is empty")
    if suffix == ".npz":
        with np.load(path, allow_pickle=False) as content:
            return _array_columns(dict(content))
    if suffix == ".mat":
        return _array_columns(_read_mat(path))
    if suffix in (".csv", ".txt", ".tsv", ".dat"):
        return _read_text(path)
    raise ValueError(f"{path}: unknown kind of file {suffix!r}; use .csv, .txt, .tsv, .npz or .mat")


def _read_mat(path: Path) -> dict[str, NDArray]:
    try:
        return {k: v for k, v in loadmat(path, squeeze_me=True).items() if not k.startswith("__")}
    except NotImplementedError:
        message = f"{path}: MATLAB v7.3 files are not read; save with the option -v7"
        raise ValueError(message) from None
    except (MatReadError, ValueError) as error:
        raise ValueError(f"{path}: not a MATLAB v5 file ({error})") from None


def _array_columns(content: dict[str, NDArray]) -> list[_Column]:
    unit = str(content["unit"]) if "unit" in content and content["unit"].ndim == 0 else None
    columns = []
    for name, value in content.items():
        array = np.asarray(value)
        if array.dtype.kind not in "iuf" or array.ndim not in (1, 2) or len(array) < 2:
            continue
        named = unit + _RATES[name] if unit and name in _RATES else None
        table = array.astype(float).reshape(len(array), -1)
        for i, values in enumerate(table.T):
            label = name if table.shape[1] == 1 else f"{name}[{i}]"
            columns.append(_Column(label, values, named))
    return columns


def _read_text(path: Path) -> list[_Column]:
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    starts = ((i, line, line.lstrip()[:1]) for i, line in enumerate(lines, 1))
    numbered = [(i, line) for i, line, start in starts if start not in ("", "#", "%")]
    if not numbered:
        raise ValueError(f"{path}: the file has no lines of data")
    delimiter, decimal_comma = _dialect([line for _, line in numbered])
    rows = [next(csv.reader([line], delimiter=delimiter)) for _, line in numbered]
    if decimal_comma:
        rows = [[cell.replace(",", ".") for cell in row] for row in rows]
    first = next((i for i, row in enumerate(rows) if _is_number(row[0])), None)
    if first is None:
        raise ValueError(f"{path}: no line starts with a number")
    width = len(rows[first])
    header = rows[first - 1] if first > 0 and len(rows[first - 1]) == width else None
    values = np.empty((len(rows) - first, width))
    for k, row in enumerate(rows[first:]):
        if len(row) != width or not all(map(_is_number, row)):
            _refuse_row(path, numbered[first + k][0], row, width, header)
        values[k] = row
    names = [_name_and_unit(text) for text in header or map(str, range(1, width + 1))]
    return [_Column(n, v, u) for (n, u), v in zip(names, values.T, strict=True)]


def _dialect(lines: list[str]) -> tuple[str, bool]:
    """Separator, and whether commas are decimal points."""
    sample = lines[-1]
    for delimiter in (";", "\t"):
        if delimiter in sample:
            return delimiter, "," in sample and "." not in sample
    return ("," if "," in sample else " "), False


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _name_and_unit(header: str) -> tuple[str, str | None]:
    """Split "q [mm]", "q (mm)" or "q_mm" into name and unit; a unit that is not known stays."""
    match = re.fullmatch(r"\s*(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*", header)
    if match:
        return match[1], match[2] or None
    return header.strip(), None


def _refuse_row(
    path: Path, line: int, row: list[str], width: int, header: list[str] | None
) -> None:
    if len(row) != width:
        raise ValueError(f"{path}, line {line}: {len(row)} columns where {width} are usual")
    for i, cell in enumerate(row):
        if not _is_number(cell):
            column = repr(header[i].strip()) if header else str(i + 1)
            what = f"{cell.strip()!r} is not a number" if cell.strip() else "the cell is empty"
            raise ValueError(
                f"{path}, line {line}, column {column}: {what}; mend the cell or remove the line"
            )


# -- choosing -----------------------------------------------------------------------------------


def _split_time(
    path: Path, columns: list[_Column], time: str | None, rate: float | None
) -> tuple[_Column, list[_Column]]:
    """The times, and the other columns that are as long."""
    if time is not None:
        clock = _named(path, columns, time, "time")
    elif rate is None:
        clock = _clock(path, columns)
    elif rate > 0:
        longest = max((len(c.values) for c in columns), default=0)
        clock = _Column("t", np.arange(longest) / rate)
    else:
        raise ValueError(f"rate = {rate!r} must be a positive number of samples per second")
    return clock, [c for c in columns if c is not clock and len(c.values) == len(clock.values)]


def _clock(path: Path, columns: list[_Column]) -> _Column:
    if len(columns) < 2:
        raise ValueError(
            f"{path}: a time column and a measured column are needed, but the file has"
            f" {len(columns)} column; add the times, or give the samples per second with rate="
        )
    clocks = [c for c in columns if c.is_time]
    if not clocks and np.all(np.diff(columns[0].values) > 0) and columns[0].name in ("1", ""):
        clocks = [columns[0]]
    if len(clocks) != 1:
        names = [c.name for c in clocks or columns]
        raise ValueError(
            f"{path}: {'no' if not clocks else 'more than one'} time column among {names};"
            " name it with time=, or give rate="
        )
    return clocks[0]


def _choose(
    path: Path,
    columns: list[_Column],
    column: str | Sequence[str] | None,
    quantity: Quantity | None,
) -> list[_Column]:
    if column is not None:
        names = [column] if isinstance(column, str) else list(column)
        return [_named(path, columns, name, "column") for name in names]
    wanted = [c for c in columns if c.quantity == (quantity or "displacement")]
    plausible = wanted or columns
    if len(plausible) == 1:
        return plausible
    if not plausible:
        raise ValueError(f"{path}: no measured column beside the time")
    raise ValueError(
        f"{path}: {len(plausible)} columns could be the measured one,"
        f" {[c.name for c in plausible]}: choose with column="
    )


def _named(path: Path, columns: list[_Column], name: str, argument: str) -> _Column:
    for c in columns:
        if c.name == name:
            return c
    raise ValueError(f"{path}: {argument} = {name!r} is none of {[c.name for c in columns]}")


def _refuse_missing(path: Path, column: _Column) -> None:
    bad = np.flatnonzero(~np.isfinite(column.values))
    if len(bad):
        raise ValueError(
            f"{path}: column {column.name!r} has {len(bad)} values that are NaN or infinite, the"
            f" first in row {bad[0] + 1} of the data: cut the record with start= and end=, or"
            " interpolate over them"
        )


def _conversion(text: str | None, quantity: Quantity) -> tuple[str | None, float]:
    """SI unit of q and factor; (None, 1) where the unit is not known."""
    if text is None:
        return None, 1.0
    found = parse_unit(text)
    if found.quantity != quantity:
        raise ValueError(
            f"unit {text!r} is one of {found.quantity}, but quantity = {quantity!r}:"
            " give the unit that belongs to what was measured"
        )
    return found.base, found.factor


def _derivatives(
    chosen: list[_Column], others: list[_Column], factor: float
) -> tuple[Array | None, Array | None]:
    """q_dot and q_ddot of a file that `save_decay` wrote; the file's factor holds for all."""
    named = {c.name: c for c in others}
    if [c.name for c in chosen] != ["q"] or not {"q_dot", "q_ddot"} <= set(named):
        return None, None
    return named["q_dot"].values * factor, named["q_ddot"].values * factor
