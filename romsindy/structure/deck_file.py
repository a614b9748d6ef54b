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
from romsindy.structure.deck import Deck
from romsindy.structure.linear import Units
from romsindy.structure.parts import PartValue
from romsindy.structure.simulator import HELD_BY, Damping, StructureSimulator
from romsindy.structure.structure import Structure

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_MASSES = {"kg": 1.0, "g": 1e-3, "t": 1e3}
_TABLES = ("deck", "damping", "force", "looked_for", "release", "sensors", "tolerances")
# Where nothing is said of the damping it is found: a ratio, and a relative standard deviation.
_UNSTATED = 0.01, 3.0


@dataclass(frozen=True)
class DeckFile:
    """A deck with its sensors and tolerances, as a TOML file has them."""

    file: Path
    reach: float  # of the node that moves most, unit of length of the deck
    mode: int
    units: Units
    ccx: str
    store: Path
    sensors: tuple[tuple[str, int], ...]  # node and direction
    columns: tuple[str, ...]  # of the measured files, in the order of the sensors
    point: tuple[str, int] | None  # where what is missing acts; None is looked for
    damping: Damping
    held_by: str
    # Values that may be off, with tolerances; without one they are looked for
    parameters: Mapping[str, tuple[float, float | None]]

    @classmethod
    def load(cls, path: str | Path) -> DeckFile:
        """Read the file; nothing is computed.

        ``[deck]`` has ``file`` (beside the TOML file), ``range`` in its unit of length, and if need
        be ``mode``, ``units`` ("mm,t,s"), ``ccx`` and ``store``; ``[sensors]`` has ``nodes``, such
        as "412:3" or "TIP:3", and as many ``columns`` of the measured files: at the first the
        structure is let go. ``[force]`` has ``node``, where what is missing acts; without it that
        is looked for. ``[damping]`` has ``damping_ratio``, or ``alpha`` and ``beta``; without it
        the ratio is found. ``[release]`` has ``held_by``: a
        "force" at the first sensor, or the "mode". ``[tolerances]`` has relative standard
        deviations of "modulus", "density" and the damping, and of values of parts, see
        `Structure.varied`; ``[looked_for]`` has ``values`` that may be missing, of parts as well.

        Raises
        ------
        ValueError
            For a file that is no TOML, and an entry that is unknown, missing or of the wrong kind.
        """
        path = Path(path)
        try:
            return _read(path, tomllib.loads(path.read_text(encoding="utf-8")))
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{path} is no TOML: {error}") from error
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that it names, and that the deck includes, by what they are."""
        return {**Deck.load(self.file).files, "what is kept of the deck": self.store}

    def simulator(self, *, n_jobs: int = 1, progress: bool = True) -> StructureSimulator:
        """The deck as a simulator, held by CalculiX; what is kept is not computed again.

        Raises
        ------
        ValueError
            For whatever `Structure.from_calculix` and `Structure.simulator` refuse.
        """
        structure = Structure.from_calculix(
            self.file, ccx=self.ccx, store=self.store, n_jobs=n_jobs, progress=progress
        )
        return structure.simulator(
            self.sensors,
            self.reach,
            self.mode,
            point=self.point,
            damping=self.damping,
            held_by=self.held_by,
            units=self.units,
            values=[name for name in self.parameters if PartValue.of_name(name)],
        )


def _read(path: Path, content: Mapping[str, Any]) -> DeckFile:
    refuse_unknown("a file of a deck", content, _TABLES)
    deck = entries.table("[deck]", content.get("deck", {}), ("file", "range"))
    refuse_unknown("[deck]", deck, ("file", "range", "mode", "units", "ccx", "store"))
    nodes, columns = _sensors(entries.table("[sensors]", content.get("sensors", {})))
    damping, stated = _damping(entries.table("[damping]", content.get("damping", {})))
    release = entries.table("[release]", content.get("release", {}))
    refuse_unknown("[release]", release, ("held_by",))
    force = entries.table("[force]", content.get("force", {}))
    refuse_unknown("[force]", force, ("node",))
    acts = entries.text("[force] node", force["node"]) if "node" in force else None
    near = _parameters(entries.table("[tolerances]", content.get("tolerances", {})), damping)
    sought = entries.table("[looked_for]", content.get("looked_for", {}))
    refuse_unknown("[looked_for]", sought, ("values",))
    names = entries.several(entries.text)("[looked_for] values", sought.get("values", []))
    parameters = {**{n: (_assumed("[looked_for]", n, damping), None) for n in names}, **near}
    file = path.parent / entries.text("[deck] file", deck["file"])
    store = entries.text("[deck] store", deck.get("store", f"{file.stem}.cases.npz"))
    return DeckFile(
        file=file,
        reach=float(entries.finite("[deck] range", deck["range"])),
        mode=entries.whole("[deck] mode", deck.get("mode", 1)),
        units=units_of("[deck] units", deck.get("units", "m,kg,s")),
        ccx=entries.text("[deck] ccx", deck.get("ccx", "ccx")),
        store=path.parent / store,
        sensors=nodes,
        columns=columns,
        point=None if acts is None else sensor_of("[force] node:", acts),
        damping=damping,
        held_by=entries.text("[release] held_by", release.get("held_by", HELD_BY[0])),
        parameters=parameters if stated else {"damping_ratio": _UNSTATED, **parameters},
    )


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


def _sensors(table: Mapping[str, Any]) -> tuple[tuple[tuple[str, int], ...], tuple[str, ...]]:
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
    return tuple(sensor_of("[sensors] nodes:", name) for name in names), columns


def _damping(table: Mapping[str, Any]) -> tuple[Damping, bool]:
    """Damping as stated, and whether it is."""
    refuse_unknown("[damping]", table, Damping._fields)
    values = {n: float(entries.finite(f"[damping] {n}", v)) for n, v in table.items()}
    return (Damping(**values), True) if values else (Damping(_UNSTATED[0]), False)


def _parameters(table: Mapping[str, Any], damping: Damping) -> dict[str, tuple[float, float]]:
    return {
        name: (
            _assumed("[tolerances]", name, damping),
            float(entries.finite(f"[tolerances] {name}", size)),
        )
        for name, size in table.items()
    }


def _assumed(where: str, name: str, damping: Damping) -> float:
    """A value as the deck and its file have it."""
    part = PartValue.of_name(name)
    if part is not None:
        return part.assumed
    known = {"modulus": 1.0, "density": 1.0, **damping._asdict()}
    refuse_unknown(f"{where} (beside values of parts, such as 'modulus of SET')", [name], [*known])
    if not known[name]:
        raise ValueError(f"{where} {name}: its value is zero, state it in [damping]")
    return known[name]
