"""Columns and tables: what every reader of a kind of file hands over."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from romsindy.record.recording import Quantity
from romsindy.record.units import TIMES, UNITS, spelled
from romsindy.typing import Array

_TIME_WORDS = {"time", "times", "timestamp", "zeit", "temps", "tiempo", "tempo", "seconds"}
_TIME_WORDS |= {"tout"}  # of Simulink
_TIME_NAMES = {
    **dict.fromkeys(("millis", "milliseconds", "msec"), "ms"),
    **dict.fromkeys(("micros", "microseconds", "usec"), "us"),
}
# Alone they name a column; among other words they name anything.
_LETTERS: dict[str, Quantity] = {"v": "velocity", "a": "acceleration"}
_WORDS: dict[str, Quantity] = {
    **dict.fromkeys(("vel", "velo", "velocity", "speed", "xdot", "qdot"), "velocity"),
    **dict.fromkeys(("acc", "accel", "acceleration", "xddot", "qddot"), "acceleration"),
    **dict.fromkeys(("disp", "displacement", "deflection", "position"), "displacement"),
    **dict.fromkeys(("geschwindigkeit", "vitesse"), "velocity"),
    **dict.fromkeys(("beschleunigung",), "acceleration"),
    **dict.fromkeys(("weg", "auslenkung"), "displacement"),
}
_UNSAFE_SUFFIXES = {"in"}  # of "sensor_in": an input rather than inches


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a file."""

    name: str  # without its unit
    values: NDArray  # (n,), numbers of any real type, as they are in the file
    # What the file says, in the spelling of `UNITS` where it is one of them
    unit: str | None = None
    # "displacement", "velocity" or "acceleration", optional: the quantity, where the kind of file
    # has a code for it
    said: Quantity | None = None
    t: Array | None = None  # (n,), times in s, where the kind of file gives every channel its own
    counted: bool = False  # whether a letter counts columns, such as "a" beside "b"
    damage: str = ""  # where a value is missing in the file, and the remedy

    @property
    def is_time(self) -> bool:
        """Whether name or unit say that it holds times."""
        if self.unit in TIMES or self.unit in UNITS:
            return self.unit in TIMES
        return _last(self.name).lower() == "t" or any(w in _TIME_WORDS for w in _words(self.name))

    @property
    def is_motion(self) -> bool:
        """Whether its unit, if it has one, is one of motion."""
        return self.unit is None or self.unit in UNITS

    @property
    def quantity(self) -> Quantity | None:
        """What it measures as unit, code or name have it; None where nothing says it."""
        if self.unit in UNITS:
            return UNITS[self.unit].quantity
        return self.said or (None if self.counted else _quantity_of_name(self.name))

    @property
    def basis(self) -> str:
        """What quantity and unit rest on."""
        if self.unit is not None:
            return f"header '{self.name} [{self.unit}]'"
        if self.said:
            return f"the file's code for {self.said}"
        return (
            f"name {self.name!r}" if self.quantity else "assumed, for nothing in the file says it"
        )


@dataclass(frozen=True, eq=False)
class Table:
    """What a file holds."""

    columns: list[Column]  # not always of one length
    # Samples per second, where the file names them outside of its columns
    rate: float | None = None
    notes: tuple[str, ...] = ()  # what was done to read it
    doubt: str = ""  # why its numbers may be wrong, which is said unless the times already show it


def _last(name: str) -> str:
    """Of the path to an array in a struct or a group."""
    return re.split(r"\.(?=\w)", name)[-1]


def _words(name: str) -> list[str]:
    return re.findall(r"[^\W\d_]+", name.lower())


def _quantity_of_name(name: str) -> Quantity | None:
    words = _words(_last(name).replace("_dot", "dot").replace("_ddot", "ddot"))
    if words and words[0] in _LETTERS and len(words) == 1:
        return _LETTERS[words[0]]
    return next((_WORDS[word] for word in words if word in _WORDS), None)


def named(header: str, values: NDArray, unit: str | None = None, **more: Any) -> Column:
    """The column under a header such as "q [mm]", "tip (mm)" or "acc_g".

    >>> import numpy as np
    >>> [named(h, np.zeros(1)).unit for h in ("q [mm/sec]", "tip (mm)", "acc_g", "F_N", "q")]
    ['mm/s', 'mm', 'g', None, None]
    """
    header = header.strip()
    bracket = re.fullmatch(r"(.*?)\s*(\[(?!\d+\])[^\]]*\]|\((?!\d+\))[^)]*\))", header)
    if not unit and bracket and bracket[1]:
        header, unit = bracket[1], bracket[2][1:-1]
    unit = (
        spelled(re.sub(r"^\s*[\[(](.*)[\])]\s*$", r"\1", unit)) if unit and unit.strip() else None
    )
    unit = unit or _TIME_NAMES.get(header.lower())
    suffix = re.fullmatch(r"(.+?)[_ ]([^_ ]+)", header)
    if unit is None and suffix:
        end = spelled(suffix[2])
        is_time = end in TIMES and Column(suffix[1], values).is_time
        unit = end if is_time or (end in UNITS and end not in _UNSAFE_SUFFIXES) else None
    return Column(header, values, unit, **more)


@contextmanager
def refused(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library says of a broken file into one sentence: it may raise anything."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except Exception as error:
        what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise ValueError(f"{path}: not a {kind} file, or a broken one ({what})") from error


def library(module: str, path: Path) -> Any:
    """A library of the extra ``formats``.

    Raises a ValueError if it is not installed; the message says how.
    """
    try:
        return import_module(module)
    except ImportError:
        raise ValueError(
            f"{path}: to read it needs {module}, which is not installed: python -m pip install"
            ' "romsindy[formats]"'
        ) from None
