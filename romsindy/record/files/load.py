"""Recordings and decays from files of any kind."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import starmap
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from romsindy.record.decay import Decay
from romsindy.record.files import channels, choose, text
from romsindy.record.files.channels import read_sep005
from romsindy.record.files.choose import input_columns, inputs_among, samples_of
from romsindy.record.files.columns import Column, Table, refused
from romsindy.record.files.save import saved
from romsindy.record.forced import ForcedVibration, recorded_input
from romsindy.record.interpolation import Interpolation
from romsindy.record.recording import QUANTITIES, Quantity, Recording, part_between
from romsindy.record.units import parse_unit
from romsindy.text import counted
from romsindy.typing import Array

Reader = Callable[[Path], Table]

_TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc", ".prn", ".lvm")
_READERS: dict[str, Reader] = {
    **dict.fromkeys(_TEXT, text.read),
    **dict.fromkeys((".uff", ".unv", ".uf", ".58"), channels.read_universal),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), channels.read_hdf),
    **dict.fromkeys((".xlsx", ".xlsm"), text.read_xlsx),
    ".npy": channels.read_npy,
    ".npz": channels.read_npz,
    ".mat": channels.read_matlab,
    ".wav": channels.read_wav,
    ".rpt": text.read_abaqus,
    ".tdms": channels.read_tdms,
}
ENDINGS = tuple(sorted(_READERS))  # of names of files that are read
# How a file of a kind starts. A name may lie, its content does not.
_STARTS: tuple[tuple[bytes, Reader], ...] = (
    (b"\x93NUMPY", channels.read_npy),
    (b"MATLAB 5.0", channels.read_matlab),
    (b"MATLAB 7.3", channels.read_hdf),
    (b"\x89HDF\r\n\x1a\n", channels.read_hdf),
    (b"RIFF", channels.read_wav),
    (b"RIFX", channels.read_wav),
    (b"RF64", channels.read_wav),
    (b"TDSm", channels.read_tdms),
    (b"LabVIEW Measurement", text.read_lvm),
    (b"\xef\xbb\xbfLabVIEW Measurement", text.read_lvm),
    (b"    -1\r", channels.read_universal),
    (b"    -1\n", channels.read_universal),
    (b"    -1  ", channels.read_universal),
)
_FOREIGN = {
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"GIF8": "a GIF image",
    b"%PDF": "a PDF document",
    b"\x1f\x8b": "packed by gzip: unpack it",
    b"7z\xbc\xaf": "a 7z archive: unpack it",
    b"Rar!": "a RAR archive: unpack it",
    b"\xd0\xcf\x11\xe0": "an old Excel or Word file: save it as .xlsx or .csv",
    b"<!doctype": "a web page, not the file itself: download that",
    b"<html": "a web page, not the file itself: download that",
    b"<?xml": "XML: export it as .csv",
    b"{": "JSON: export it as .csv",
}


def reader_of(path: Path) -> Reader:
    """The function that reads a file.

    Raises a ValueError for an empty file, and for kinds that are not read.
    """
    with path.open("rb") as file:
        start = file.read(64)
    if not start:
        raise ValueError(f"{path}: the file is empty")
    for mark, what in _FOREIGN.items():
        if start.lstrip().lower().startswith(mark.lower()):
            raise ValueError(f"{path}: the content is {what}")
    if start.startswith(b"PK\x03\x04"):
        return _of_archive(path)
    for mark, reader in _STARTS:
        if start.startswith(mark):
            return reader
    if path.suffix.lower() not in _READERS:
        raise ValueError(f"{path}: unknown kind of file {path.suffix!r}; use {', '.join(ENDINGS)}")
    return _READERS[path.suffix.lower()]


def _of_archive(path: Path) -> Reader:
    with refused(path, "ZIP archive (so are .npz and .xlsx)"), zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if any(name.startswith("xl/") for name in names):
        return text.read_xlsx
    if names and all(name.endswith(".npy") for name in names):
        return channels.read_npz
    raise ValueError(f"{path}: the content is a ZIP archive with {names[:3]}: unpack it")


Source = str | PathLike[str] | Mapping[str, Any] | Sequence[Mapping[str, Any]]
_RATES = ("q_dot", "q_ddot")
_AT_A_LEVER = (
    "angles count as lengths at a lever arm of {:g} m: records of one system need the same"
)


def load_recording(
    path: Source,
    unit: str | None = None,
    quantity: Quantity | None = None,
    *,
    column: str | Sequence[str] | None = None,
    lever: float | None = None,
    time: str | None = None,
    rate: float | None = None,
    start: float | None = None,
    end: float | None = None,
) -> Recording:
    """Read what sensors gave from a file of any common kind, converted to SI units.

    Text (CSV in any dress), NPY, NPZ, MATLAB, HDF5, WAV, universal files (UFF 55 and 58), TDMS,
    LVM, XLSX; some need ``pip install "romsindy[formats]"``. Or SEP005 dictionaries that another
    package has read.

    Parameters
    ----------
    path : path, SEP005 dictionary or list of them
        Where the recording is.
    unit : str, optional
        Unit of the measured columns in the file, such as "mm", "m/s", "g", "deg"; it overrides
        the header. Without any, q stays in its own unit, which is then unknown.
    quantity : "displacement", "velocity" or "acceleration", optional
        What was measured; by default what unit, header or name of the column say, and displacement
        otherwise. `Recording.basis` tells.
    column : str or list of str, optional
        Names of the measured columns (``"2"`` is the second of a file without header). By default
        all that measure the same quantity in the same unit, and of several quantities the one with
        the most columns; `Recording.notes` lists what is left out.
    lever : float, optional
        Lever arm, m, at which angles count as lengths where columns of both are named; by default
        one at which both vibrate alike, of two digits. Records of one system need one.
    time : str, optional
        Name of the time column; found by its name, or else the first.
    rate : float, optional
        Samples per second, for files without times, or with times that are too coarse.
    start, end : float, optional
        Part of the recording to keep, in s.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file cannot be understood; the message names the line or the column, and the remedy.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> t = np.arange(0.0, 5.0, 0.01)
    >>> with TemporaryDirectory() as folder:
    ...     np.savetxt(f"{folder}/run.txt", np.c_[t, np.cos(6 * t)], header="t [s]  tip [mm]")
    ...     load_recording(f"{folder}/run.txt")
    <Recording: 500 samples at 100 Hz, 4.99 s, displacement in m, channels tip>
    """
    _refuse_no_numbers(lever=lever, rate=rate, start=start, end=end)
    decay = _saved(path, (unit, quantity, column, lever, time, rate))
    if decay is not None:
        return decay.as_recording("saved by romsindy", str(path)).between(start, end)
    source, table = _columns(path)
    with named(source):
        choice = _choice(table, unit, quantity, column, time, rate)
        part = _recording(choice, source, unit, quantity, lever).between(start, end)
        own = part_between(choice.t, start, end)
        pushed = [(c.values[own], part.dt, c.name, kind) for kind, c in choice.inputs]
        return replace(part, drives=tuple(starmap(recorded_input, pushed)))


def load_decay(
    path: Source,
    unit: str | None = None,
    quantity: Quantity | None = None,
    *,
    column: str | Sequence[str] | None = None,
    lever: float | None = None,
    time: str | None = None,
    rate: float | None = None,
    start: float | None = None,
    end: float | None = None,
) -> Decay:
    """Read a decay, as `load_recording` with the same arguments reads a recording.

    A velocity or an acceleration is integrated; the free decay is found by the analysis.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file cannot be understood, if more than one column could be meant, if samples are
        missing, or as by `Decay`; the message names the line or the column, and the remedy.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> t = np.arange(0.0, 5.0, 0.01)
    >>> with TemporaryDirectory() as folder:
    ...     np.savetxt(f"{folder}/run.txt", np.c_[t, np.exp(-t) * np.cos(6 * t)])
    ...     load_decay(f"{folder}/run.txt", unit="mm", start=1.0)
    <Decay: 400 samples at 100 Hz, 3.99 s, max |q| 0.0003558 m, measured displacement>
    """
    _refuse_no_numbers(lever=lever, rate=rate, start=start, end=end)
    decay = _saved(path, (unit, quantity, column, lever, time, rate))
    if decay is not None:
        return decay.between(start, end)
    source, table = _columns(path)
    with named(source):
        choice = _choice(table, unit, quantity, column, time, rate)
        if _names(column) is None:
            _require_one(choice)
        whole = _recording(choice, source, unit, quantity, lever)
        part = whole.between(start, end)
        _refuse_missing(part, whole, choice.columns)
        derivatives = _derivatives(table, part, whole, unit)
        decay = _decay(part, derivatives)
    notes = part.notes if derivatives[0] is None else table.notes  # nothing is left out then
    return replace(decay, notes=(*notes, *decay.notes)) if notes else decay


def load_forced(
    path: Source,
    inputs: str | Sequence[str] = "force",
    unit: str | None = None,
    quantity: Quantity | None = None,
    *,
    input_column: str | Sequence[str] | None = None,
    input_unit: str | Sequence[str] | None = None,
    interpolation: Interpolation | None = None,
    column: str | Sequence[str] | None = None,
    lever: float | None = None,
    time: str | None = None,
    rate: float | None = None,
    start: float | None = None,
    end: float | None = None,
) -> ForcedVibration:
    """Read a vibration with its inputs; arguments of `load_recording` are those of the response.

    Parameters
    ----------
    path : path, SEP005 dictionary or list of them
    inputs : str or sequence of str
        "force", "base", and of several of a kind "force 2", ...
    input_column : str or sequence of str, optional
        Names of their columns; by default those whose names or units say so, or those that are
        left beside ``column``.
    input_unit : str or sequence of str, optional
        Their units in the file, or the one of all: "N", "kN", "V", "m/s^2", "g", ...; by default
        that of the header.
    interpolation : "band-limited", "linear" or "hold", optional
        What they do between their samples, where it is known.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file cannot be understood, a column could be another one, samples are missing, or as
        by `ForcedVibration`; the message names the remedy.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> t = np.arange(0.0, 5.0, 0.01)
    >>> with TemporaryDirectory() as folder:
    ...     np.savetxt(f"{folder}/run.txt", np.c_[t, np.cos(t), t], header="t [s]  q [m]  F [N]")
    ...     load_forced(f"{folder}/run.txt")
    <ForcedVibration: 500 samples at 100 Hz, 4.99 s, max |displacement| 1 m, by force>
      - columns: displacement 'q', force 'F'
    """
    _refuse_no_numbers(lever=lever, rate=rate, start=start, end=end)
    names = (inputs,) if isinstance(inputs, str) else tuple(inputs)
    source, table = _columns(path)
    with named(source):
        table = replace(table, columns=choose.unique(table.columns))
        driving = input_columns(table, names, _names(input_column), _names(column))
        choice = _choice(table, unit, quantity, column, time, rate, beside=driving)
        if _names(column) is None:
            _require_one(choice)
        response = _recording(choice, source, unit, quantity, lever)
        u, units = samples_of(driving, names, _names(input_unit), choice.columns[0], choice.t)
        pushes = Recording(choice.t, u, [c.name for c in driving])
        part, pushed = response.between(start, end), pushes.between(start, end)
        _refuse_missing(part, response, choice.columns)
        _refuse_missing(pushed, pushes, driving)
        return ForcedVibration(
            *(part.t, part.x, pushed.x, part.unit, part.quantity, names, units),
            interpolation=interpolation,
            notes=(_told(choice, names, driving), *part.notes),
        )


def _told(choice: _Measured, names: Sequence[str], driving: Sequence[Column]) -> str:
    """Which column is what."""
    what = (choice.quantity,) * len(choice.columns)
    pairs = zip((*what, *names), (*choice.columns, *driving), strict=True)
    return "columns: " + ", ".join(f"{what} {column.name!r}" for what, column in pairs)


def _require_one(choice: _Measured) -> None:
    names = [c.name for c in choice.columns]
    if len(names) > 1:
        raise ValueError(
            f"{len(names)} columns could be the measured one, {names}: choose with column="
        )


def _saved(path: Source, settings: tuple[Any, ...]) -> Decay | None:
    """The decay that `save_decay` wrote there, where nothing says how else to read it."""
    told = any(setting is not None for setting in settings)
    if told or not isinstance(path, str | PathLike) or not Path(path).is_file():
        return None
    return saved(Path(path))


def _columns(path: Source) -> tuple[str, Table]:
    """Name of the source and its columns."""
    if isinstance(path, Mapping | Sequence) and not isinstance(path, str | bytes):
        return "SEP005", read_sep005(path)
    if not isinstance(path, str | PathLike):
        raise ValueError(f"path = {path!r} must be the name of a file, or SEP005 dictionaries")
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"{path} is a directory: name a file in it")
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    return str(path), reader_of(path)(path)


class _Measured(NamedTuple):
    """Times in s, and the columns that were measured at them."""

    t: Array
    columns: list[Column]
    quantity: Quantity
    notes: tuple[str, ...]
    doubt: str
    inputs: list[tuple[str, Column]]  # each with its kind
    rest: list[Column]  # of other columns


def _choice(
    table: Table,
    unit: str | None,
    quantity: Quantity | None,
    column: str | Sequence[str] | None,
    time: str | None,
    rate: float | None,
    beside: Sequence[Column] = (),
) -> _Measured:
    """What was measured, beside columns that are something else."""
    if quantity not in (None, *QUANTITIES):
        raise ValueError(f"quantity = {quantity!r} must be displacement, velocity or acceleration")
    wanted = quantity or (parse_unit(unit).quantity if unit else None)
    names = _names(column)
    table = replace(table, columns=choose.unique(table.columns))
    found = inputs_among([c for c in choose.signals_of(table, None) if c not in beside])
    inputs = [(kind, c) for kind, c in found if c.name not in (names or ())]
    pushing = [*beside, *(c for _, c in inputs)]
    signals = [c for c in choose.signals_of(table, names) if c not in pushing]
    t, chosen, note = choose.times_of(table, signals, time, rate)
    if names is None:
        chosen = choose.measured(chosen, wanted)
    elif lost := [c.name for c in signals if c not in chosen]:
        raise ValueError(f"columns {lost} have other times than {names}: choose with column=")
    if not chosen:
        raise ValueError("no measured column beside the time")
    left = [*(c for c in signals if c not in chosen), *(c for _, c in inputs)]
    told = f"left out: {', '.join(c.name for c in left)}" if left else ""
    notes = (*table.notes, *(c.damage for c in chosen), note, told)
    wanted = wanted or chosen[0].quantity or "displacement"
    inputs = [(kind, c) for kind, c in inputs if len(c.values) == len(t)]
    rest = choose.signals_of(table, None)
    rest = [c for c in rest if c not in (*chosen, *pushing) and c.name != time]
    return _Measured(t, chosen, wanted, tuple(filter(None, notes)), table.doubt, inputs, rest)


def _names(column: str | Sequence[str] | None) -> list[str] | None:
    return None if column is None else list(map(str, np.atleast_1d(column))) or None


def _refuse_no_numbers(**settings: Any) -> None:
    for name, value in settings.items():
        if value is not None and not isinstance(value, Real):
            raise ValueError(f"{name} = {value!r} must be a number")


def _recording(
    choice: _Measured,
    source: str,
    unit: str | None,
    quantity: Quantity | None,
    lever: float | None,
) -> Recording:
    columns = choice.columns
    base, factors, arm = choose.in_one_unit(columns, unit, choice.quantity, lever)
    names = [c.name for c in columns]
    choose.checked_times(choice.t)
    if choice.doubt:
        raise ValueError(choice.doubt)
    x = np.empty((len(choice.t), len(columns)))
    for k, (c, factor) in enumerate(zip(columns, factors, strict=True)):
        np.multiply(c.values, factor, out=x[:, k])
    x[~np.isfinite(x)] = np.nan
    dead = [name for name, values in zip(names, x.T, strict=True) if np.all(np.isnan(values))]
    if dead:
        raise ValueError(f"columns {dead} hold no number: choose another one with column=")
    basis = _basis(columns[0], unit, quantity)
    notes = choice.notes if arm is None else (*choice.notes, _AT_A_LEVER.format(arm))
    given = (choice.t, x, names, choice.quantity, base, basis, source, notes)
    return Recording(*given, lever=arm, left_out=tuple(c.name for c in choice.rest))


def _basis(column: Column, unit: str | None, quantity: Quantity | None) -> str:
    if unit:
        return f"unit={unit}" + (f" in place of {column.basis}" if column.unit else "")
    strange = "" if column.is_motion else ", a unit that is not known: numbers as in the file"
    return (f"quantity={quantity}" if quantity else column.basis) + strange


def _derivatives(
    table: Table, part: Recording, whole: Recording, unit: str | None
) -> tuple[Array | None, Array | None]:
    """q_dot and q_ddot beside a q that is consistent with them; its factor holds for all."""
    found = {c.name: c.values for c in table.columns}
    if part.names != ("q",) or part.quantity != "displacement" or not {*_RATES} <= {*found}:
        return None, None
    first = int(np.searchsorted(whole.t, part.t[0]))
    q = next(c for c in table.columns if c.name == "q")
    factor = choose.conversion(q, unit, "displacement")[1]
    velocity, acceleration = (found[n][first : first + len(part.t)] * factor for n in _RATES)
    return velocity, acceleration


def _decay(record: Recording, derivatives: tuple[Array | None, Array | None]) -> Decay:
    x = record.x[:, 0] if len(record.names) == 1 else record.x
    if record.quantity == "velocity":
        return Decay.from_velocity(record.t, x, record.unit)
    if record.quantity == "acceleration":
        return Decay.from_acceleration(record.t, x, record.unit)
    return Decay(record.t, x, *derivatives, unit=record.unit)


def _refuse_missing(part: Recording, whole: Recording, columns: Sequence[Column]) -> None:
    for name, values, column in zip(part.names, part.x.T, columns, strict=True):
        bad = np.flatnonzero(np.isnan(values))
        if len(bad) and column.damage:
            raise ValueError(column.damage)
        if len(bad):
            row = int(np.searchsorted(whole.t, part.t[bad[0]])) + 1
            what = counted(len(bad), "value that is", "values that are")
            raise ValueError(
                f"column {name!r} has {what} NaN or infinite, the first at"
                f" {part.t[bad[0]]:.6g} s in row {row} of the data: cut the record with start="
                " and end=, or interpolate over them"
            )


@contextmanager
def named(source: str) -> Iterator[None]:
    """Messages begin with the name of the source."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error
