"""A beam and its sensors from a TOML file."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from romsindy.beam import CLAMPED, FREE, PINNED, Beam, Section, Sensor, SensorArray, Support
from romsindy.beam.spring import Spring
from romsindy.effects import PointMass

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")

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
        beam = _beam(content.get("beam", {}))
        sensors, columns = _sensors(content.get("sensors", {}))
        return beam, beam.sensors(sensors), columns
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _beam(values: Mapping[str, Any]) -> Beam:
    sections = [name for name in _SECTIONS if name in values]
    if not sections:
        return _made(Beam.cantilever, values, "[beam]")
    if len(sections) > 1:
        raise ValueError("[beam.rectangle] and [beam.section] are two sections: give one")
    own = dict(values)
    table = own.pop(sections[0])
    own["section"] = _made(_SECTIONS[sections[0]], table, f"[beam.{sections[0]}]")
    masses = [_made(PointMass, m, "[[beam.masses]]") for m in own.pop("masses", ())]
    springs = [_made(Spring, m, "[[beam.springs]]") for m in own.pop("springs", ())]
    own["effects"] = (*masses, *springs)
    gravity = own.pop("gravity", 9.81)
    own |= {end: _support(own[end], end) for end in ("left", "right") if end in own}
    own["gravity"] = (0.0, -gravity) if isinstance(gravity, float | int) else gravity
    return _made(Beam, own, "[beam]")


def _support(value: object, end: str) -> Support:
    if isinstance(value, str) and value in _SUPPORTS:
        return _SUPPORTS[value]
    if isinstance(value, float | int):
        return Support.elastic(float(value))
    raise ValueError(
        f"[beam] {end} = {value!r}: give one of {list(_SUPPORTS)}, or a stiffness in N m/rad"
    )


def _sensors(table: Mapping[str, Any]) -> tuple[list[Sensor], list[str]]:
    places, columns = table.get("positions", []), table.get("columns", [])
    lists = isinstance(places, list) and isinstance(columns, list)
    if not lists or not places or len(columns) != len(places):
        raise ValueError(
            f"[sensors] has positions = {places} and columns = {columns}: give positions = [...],"
            " in m, and as many columns = [...], names in the measured files"
        )
    return [_made(Sensor, {"at": x}, "[sensors] positions") for x in places], columns


def _made(make: Callable[..., T], values: Mapping[str, Any], table: str) -> T:
    """Call a constructor with the values of a table; lists stand for tuples."""
    signature = inspect.signature(make)
    plain = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    try:
        signature.bind(**plain)
        for key, value in plain.items():
            if isinstance(value, str):
                raise ValueError(f"{table} {key} = {value!r} must be a number, in SI units")
        return make(**plain)
    except TypeError as error:  # an argument that is unknown, missing or of another kind
        raise ValueError(f"{table} takes {list(signature.parameters)}: {error}") from error
