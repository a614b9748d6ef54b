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
_SECTIONS = ("rectangle", "section")
_GENERAL = ("length", "elements", "alpha", "eta", "gravity", "left", "right", "masses", "springs")


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
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path} is no TOML: {error}") from error
    try:
        beam = _beam(content.get("beam", {}))
        places, columns = _sensors(content.get("sensors", {}))
        return beam, beam.sensors([Sensor(x) for x in places]), columns
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _beam(values: Mapping[str, Any]) -> Beam:
    _check_table(values, "[beam]")
    sections = [name for name in _SECTIONS if name in values]
    if not sections:
        if {"left", "right", "masses", "springs"} & set(values):
            raise ValueError(
                "[beam] has supports, masses or springs, but nothing that they hold: add"
                " [beam.rectangle] or [beam.section]"
            )
        return _made(Beam.cantilever, values, "[beam]")
    if len(sections) > 1:
        raise ValueError("[beam.rectangle] and [beam.section] are two sections: give one")
    _check_known(values, (*_GENERAL, *_SECTIONS), "[beam]")
    make = Section.rectangle if sections == ["rectangle"] else Section
    section = _made(make, values[sections[0]], f"[beam.{sections[0]}]")
    masses = [_made(PointMass, m, "[[beam.masses]]") for m in values.get("masses", ())]
    springs = [_made(Spring, s, "[[beam.springs]]") for s in values.get("springs", ())]
    numbers = {k: values[k] for k in ("length", "elements", "alpha", "eta") if k in values}
    _check_numbers(numbers | {"gravity": values.get("gravity", 9.81)}, "[beam]")
    if "length" not in values:
        raise ValueError("[beam] lacks length, in m")
    return Beam(
        **numbers,
        section=section,
        left=_support(values.get("left", "clamped"), "left"),
        right=_support(values.get("right", "free"), "right"),
        gravity=(0.0, -float(values.get("gravity", 9.81))),
        effects=(*masses, *springs),
    )


def _support(value: object, end: str) -> Support:
    if isinstance(value, str) and value in _SUPPORTS:
        return _SUPPORTS[value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return Support.elastic(float(value))
    raise ValueError(
        f"[beam] {end} = {value!r}: give one of {list(_SUPPORTS)}, or a stiffness in N m/rad"
    )


def _sensors(table: Mapping[str, Any]) -> tuple[list[float], list[str]]:
    _check_table(table, "[sensors]")
    places, columns = table.get("positions", []), table.get("columns", [])
    lists = isinstance(places, list) and isinstance(columns, list)
    if not lists or not places or len(columns) != len(places):
        raise ValueError(
            f"[sensors] has positions = {places} and columns = {columns}: give positions = [...],"
            " in m, and as many columns = [...], names in the measured files"
        )
    _check_numbers({f"positions[{i}]": x for i, x in enumerate(places)}, "[sensors]")
    return [float(x) for x in places], [str(name) for name in columns]


def _made(make: Callable[..., T], values: Mapping[str, Any], table: str) -> T:
    """Call a constructor with the values of a table."""
    _check_table(values, table)
    parameters = inspect.signature(make).parameters
    _check_known(values, tuple(parameters), table)
    empty = inspect.Parameter.empty
    missing = [k for k, p in parameters.items() if p.default is empty and k not in values]
    if missing:
        raise ValueError(f"{table} lacks {missing}")
    plain = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    for key, value in plain.items():
        of_two = isinstance(value, tuple) and len(value) == 2
        _check_numbers(dict(enumerate(value)) if of_two else {key: value}, f"{table} {key}")
    return make(**plain)


def _check_table(values: object, table: str) -> None:
    if not isinstance(values, Mapping):
        raise ValueError(f"{table} is {values!r}: make it a table")


def _check_known(values: Mapping[str, Any], known: tuple[str, ...], table: str) -> None:
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise ValueError(f"{table} has {unknown}, which are none of {list(known)}")


def _check_numbers(values: Mapping[Any, Any], table: str) -> None:
    for key, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{table}: {key} = {value!r} must be a number, in SI units")
