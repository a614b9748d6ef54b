"""A beam and its sensors from a TOML file."""

from __future__ import annotations

import inspect
import sys
from pathlib import Path

from romsindy.beam import Beam
from romsindy.beam.sensors import Sensor, SensorArray

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def load_beam(path: str | Path) -> tuple[Beam, SensorArray, list[str]]:
    """Read a cantilever, its sensors and the columns that they are measured in from a TOML file.

    The table ``[beam]`` holds arguments of `Beam.cantilever`, ``[sensors]`` a list ``positions``
    [m] of transverse sensors and a list ``columns`` of names in the measured files.

    Raises
    ------
    ValueError
        For a file that is no TOML, an unknown argument, or no positions.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path} is no TOML: {error}") from error
    known = list(inspect.signature(Beam.cantilever).parameters)
    values = content.get("beam", {})
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise ValueError(f"{path}: [beam] has {unknown}, which are none of {known}")
    table = content.get("sensors", {})
    positions, columns = table.get("positions", []), table.get("columns", [])
    if not positions or len(columns) != len(positions):
        raise ValueError(
            f"{path}: [sensors] has {len(positions)} positions and {len(columns)} columns: give"
            " positions = [...], in m, and as many columns = [...], names in the measured files"
        )
    beam = Beam.cantilever(**values)
    return beam, beam.sensors([Sensor(float(x)) for x in positions]), columns
