"""A deck as a simulation that is diagnosed: what a TOML file says of it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from romsindy.physics import validation as entries
from romsindy.physics.validation import refuse_unknown
from romsindy.record.units import parse_unit
from romsindy.structure.simulator import HELD_BY, Damping, StructureSimulator, Units
from romsindy.structure.structure import Structure

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_MASSES = {"kg": 1.0, "g": 1e-3, "t": 1e3}
_TABLES = ("deck", "damping", "release", "sensors", "tolerances")
# Where nothing is said of the damping it is found: a ratio, and a relative standard deviation.
_UNSTATED = 0.01, 3.0


@dataclass(frozen=True)
class MeasuredDeck:
    """A deck with its sensors, as `diagnose` takes it."""

    simulator: StructureSimulator
    columns: tuple[str, ...]  # of the measured files, in the order of the sensors
    parameters: Mapping[str, tuple[float, float]]  # values that may be off, with tolerances


def load_deck(path: str | Path, *, n_jobs: int = 1, progress: bool = True) -> MeasuredDeck:
    """Read a deck, its sensors and its tolerances from a TOML file, and hold it by CalculiX.

    ``[deck]`` has ``file`` (beside the TOML file), ``range`` in its unit of length, and if need be
    ``mode``, ``units`` ("mm,t,s"), ``ccx`` and ``store``; ``[sensors]`` has ``nodes``, such as
    "412:3" or "TIP:3", and as many ``columns`` of the measured files: at the first the structure is
    let go. ``[damping]`` has ``damping_ratio``, or ``alpha`` and ``beta``; without it the ratio is
    found. ``[release]`` has ``held_by``: a "force" at the first sensor, or the "mode".
    ``[tolerances]`` has relative standard deviations of "modulus", "density" and the damping.

    Raises
    ------
    ValueError
        For a file that is no TOML, an entry that is unknown, missing or of the wrong kind, and
        whatever `Structure.from_calculix` refuses.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(f"{path} is no TOML: {error}") from error
    try:
        return _loaded(path, content, n_jobs, progress)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _loaded(path: Path, content: Mapping[str, Any], n_jobs: int, progress: bool) -> MeasuredDeck:
    refuse_unknown("a file of a deck", content, _TABLES)
    deck = entries.table("[deck]", content.get("deck", {}), ("file", "range"))
    refuse_unknown("[deck]", deck, ("file", "range", "mode", "units", "ccx", "store"))
    nodes, columns = _sensors(entries.table("[sensors]", content.get("sensors", {})))
    damping, stated = _damping(entries.table("[damping]", content.get("damping", {})))
    release = entries.table("[release]", content.get("release", {}))
    refuse_unknown("[release]", release, ("held_by",))
    parameters = _parameters(entries.table("[tolerances]", content.get("tolerances", {})), damping)
    if not stated:
        parameters = {"damping_ratio": _UNSTATED, **parameters}
    file = path.parent / entries.text("[deck] file", deck["file"])
    store = entries.text("[deck] store", deck.get("store", f"{file.stem}.cases.npz"))
    reach = entries.finite("[deck] range", deck["range"])
    mode = entries.whole("[deck] mode", deck.get("mode", 1))
    units = units_of("[deck] units", deck.get("units", "m,kg,s"))
    held_by = entries.text("[release] held_by", release.get("held_by", HELD_BY[0]))
    structure = Structure.from_calculix(
        file,
        ccx=entries.text("[deck] ccx", deck.get("ccx", "ccx")),
        store=path.parent / store,
        n_jobs=n_jobs,
        progress=progress,
    )
    given = {"damping": damping, "held_by": held_by, "units": units}
    simulator = structure.simulator(nodes, reach, mode, **given)  # type: ignore[arg-type]
    return MeasuredDeck(simulator, columns, parameters)


def sensor_of(name: str, text: str) -> tuple[str, int]:
    """A node and a direction from "NODE:DIRECTION"; raises a ValueError for anything else."""
    node, _, direction = text.rpartition(":")
    if not node or direction not in ("1", "2", "3"):
        raise ValueError(
            f"{name} {text!r} is not NODE:DIRECTION, such as 412:3 or TIP:3; directions are 1, 2"
            " and 3"
        )
    return node, int(direction)


def unit_names(name: str, text: str) -> tuple[str, str]:
    """Names of length and mass from "m,kg,s"; raises a ValueError for anything else."""
    names = [part.strip() for part in text.split(",")]
    if len(names) != 3 or not all(names) or names[2] != "s":
        raise ValueError(
            f"{name} {text!r} names no length, mass and time: give them as m,kg,s or mm,t,s; the"
            " time must be s, for frequencies in Hz"
        )
    return names[0], names[1]


def units_of(name: str, value: Any) -> Units:
    """SI units in those of a deck, "m,kg,s" or "mm,t,s"."""
    length, mass = unit_names(name, entries.text(name, value))
    if mass not in _MASSES:
        raise ValueError(f"{name}: the mass {mass!r} is none of {', '.join(_MASSES)}")
    known = parse_unit(length)
    if known.base != "m" or known.quantity != "displacement":
        raise ValueError(f"{name}: {length!r} is no length: give m or mm")
    return Units(known.factor, _MASSES[mass])


def _sensors(table: Mapping[str, Any]) -> tuple[list[tuple[str, int]], tuple[str, ...]]:
    refuse_unknown("[sensors]", table, ("nodes", "columns"))
    names, columns = (
        entries.several(entries.text)(f"[sensors] {name}", table.get(name, []))
        for name in ("nodes", "columns")
    )
    if not names or len(columns) != len(names):
        raise ValueError(
            f"[sensors] has nodes = {list(names)} and columns = {list(columns)}: give nodes ="
            ' ["412:3"], node and direction, and as many columns = [...], names in the measured'
            " files"
        )
    return [sensor_of("[sensors] nodes:", name) for name in names], columns


def _damping(table: Mapping[str, Any]) -> tuple[Damping, bool]:
    """Damping as stated, and whether it is."""
    refuse_unknown("[damping]", table, Damping._fields)
    values = {n: float(entries.finite(f"[damping] {n}", v)) for n, v in table.items()}
    return (Damping(**values), True) if values else (Damping(_UNSTATED[0]), False)


def _parameters(table: Mapping[str, Any], damping: Damping) -> dict[str, tuple[float, float]]:
    known = {"modulus": 1.0, "density": 1.0, **damping._asdict()}
    refuse_unknown("[tolerances]", table, [*known])
    for name in table:
        if not known[name]:
            raise ValueError(f"[tolerances] {name}: its value is zero, state it in [damping]")
    sizes = {n: float(entries.finite(f"[tolerances] {n}", v)) for n, v in table.items()}
    return {name: (known[name], size) for name, size in sizes.items()}
