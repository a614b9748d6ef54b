"""A beam and its sensors from a TOML file."""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from romsindy.beam.beam import Beam
from romsindy.beam.motion import Sensor, SensorArray
from romsindy.beam.structure import CLAMPED, FREE, PINNED, Section, Spring, Support
from romsindy.effects import PointMass
from romsindy.physics import validation as entries
from romsindy.physics.validation import refuse_unknown

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")

# Speed of sound along a beam, m/s: soft rubber, and four times as fast as in steel.
_SLOWEST, _FASTEST = 20.0, 2e4
_ANY_BEAM = ("length", "elements", "alpha", "eta", "gravity")
_OTHER_BEAMS = ("left", "right", "masses", "springs")
_SUPPORTS = {"clamped": CLAMPED, "pinned": PINNED, "free": FREE}
_SECTIONS: dict[str, Callable[..., Section]] = {"rectangle": Section.rectangle, "section": Section}


def load_beam(path: str | Path) -> tuple[Beam, SensorArray, list[str]]:
    """Read a beam, its sensors and the columns that they are measured in from a TOML file.

    The table ``[beam]`` holds arguments of `Beam.cantilever`. For any other beam, a table
    ``[beam.rectangle]`` (`Section.rectangle`) or ``[beam.section]`` (`Section`) says what it is
    made of; ``[beam]`` then holds ``length``, ``elements``, ``alpha``, ``eta``, ``gravity``
    (downwards, m/s^2), and ``left`` and ``right``: "clamped", "pinned", "free" or the stiffness of
    a clamp that gives way, N m/rad. ``[[beam.masses]]`` and ``[[beam.springs]]`` hold arguments of
    `PointMass` and `Spring`. The table ``[sensors]`` holds a list ``positions``, m, of transverse
    sensors and a list ``columns`` of names in the measured files.

    Raises
    ------
    ValueError
        For a file that is no TOML, an argument that is unknown, missing or no number, no
        positions, or a beam that cannot be.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no TOML: it is no text in UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path} is no TOML: {error}") from error
    try:
        refuse_unknown("a file of a beam", content, ("beam", "sensors"))
        beam = _beam(entries.table("[beam]", content.get("beam", {})))
        if "section" not in content.get("beam", {}):  # whose stiffness is what it is called
            _require_si(beam.section)
        sensors, columns = _sensors(entries.table("[sensors]", content.get("sensors", {})))
        return beam, beam.sensors(sensors), columns
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _beam(values: dict[str, Any]) -> Beam:
    sections = [name for name in _SECTIONS if name in values]
    if not sections:
        for name in (n for n in values if n in _OTHER_BEAMS):
            raise ValueError(
                f"[beam] {name} is of a beam with [beam.rectangle] or [beam.section]: add one of"
                f" these, or leave {name} out"
            )
        return _made(Beam.cantilever, values, "[beam]")
    if len(sections) > 1:
        raise ValueError("[beam.rectangle] and [beam.section] are two sections: give one")
    refuse_unknown("[beam]", values, (*_ANY_BEAM, *_OTHER_BEAMS, *_SECTIONS))
    own = dict(values)
    table = own.pop(sections[0])
    own["section"] = _made(_SECTIONS[sections[0]], table, f"[beam.{sections[0]}]")
    laws = {"masses": PointMass, "springs": Spring}
    own["effects"] = tuple(
        _made(law, value, f"[[beam.{name}]]")
        for name, law in laws.items()
        for value in entries.items(f"[[beam.{name}]]", own.pop(name, []))
    )
    gravity = own.get("gravity", 9.81)
    own |= {end: _support(own[end], end) for end in ("left", "right") if end in own}
    if not isinstance(gravity, list):
        own["gravity"] = (0.0, -entries.finite("[beam] gravity", gravity))
    return _made(Beam, own, "[beam]")


def _require_si(section: Section) -> None:
    speed = math.sqrt(section.EA / section.mass)
    if not _SLOWEST < speed < _FASTEST:
        raise ValueError(
            f"[beam] sound would travel at {speed:.3g} m/s along the beam, which is no material:"
            " give SI units (m, N/m^2, kg/m^3), not mm, MPa and t/mm^3"
        )


def _support(value: object, end: str) -> Support:
    if isinstance(value, str) and value in _SUPPORTS:
        return _SUPPORTS[value]
    if isinstance(value, float | int) and not isinstance(value, bool):
        return Support.elastic(float(value))
    raise ValueError(
        f"[beam] {end} = {value!r}: give one of {list(_SUPPORTS)}, or a stiffness in N m/rad"
    )


def _sensors(values: dict[str, Any]) -> tuple[list[Sensor], list[str]]:
    refuse_unknown("[sensors]", values, ("positions", "columns"))
    places, columns = values.get("positions", []), values.get("columns", [])
    lists = isinstance(places, list) and isinstance(columns, list)
    if not lists or not places or len(columns) != len(places):
        raise ValueError(
            f"[sensors] has positions = {places} and columns = {columns}: give positions = [...],"
            " in m, and as many columns = [...], names in the measured files"
        )
    names = entries.several(entries.text)("[sensors] columns", columns)
    for name in names:
        if names.count(name) > 1:
            raise ValueError(
                f"[sensors] columns has {name!r} twice: give every position a column of its own"
            )
    at = entries.several(entries.finite)("[sensors] positions", places)
    return [Sensor(x) for x in at], list(names)


def _made(make: Callable[..., T], value: Any, table: str) -> T:
    """Call a constructor with the values of a table; lists stand for tuples."""
    parameters = inspect.signature(make).parameters
    needed = [name for name, p in parameters.items() if p.default is p.empty]
    refuse_unknown(table, entries.table(table, value), list(parameters))
    values = entries.table(table, value, needed)
    readers = {n: _READERS.get(str(parameters[n].annotation)) for n in values}
    # What has no reader was made before.
    return make(**{n: r(f"{table} {n}", values[n]) if r else values[n] for n, r in readers.items()})


def _pair(name: str, value: Any) -> Any:
    if isinstance(value, tuple):
        return value
    pair = entries.several(entries.finite)(name, value)
    if len(pair) != 2:
        raise ValueError(f"{name} = {list(pair)!r:.60} must be two numbers, along and across")
    return pair


_READERS: dict[str, entries.Reader] = {
    **dict.fromkeys(("float", "int", "float | None"), entries.finite),
    "tuple[float, float]": _pair,
}
