"""TDMS files of LabVIEW, read by nptdms."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from romsindy.record.files.columns import Column, Table, library, named, refused

_UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit")


def read(path: Path) -> Table:
    """Channels of a TDMS file; their waveform properties give the times.

    Raises
    ------
    ValueError
        If it is broken, or nptdms is not installed.
    """
    nptdms = library("nptdms", path)
    with refused(path, "TDMS"):
        nptdms.log.log_manager.set_level(logging.ERROR)  # its warnings are our refusals
        _refuse_other_size(path)
        file = nptdms.TdmsFile.read(path)
        groups = [group for group in file.groups() if group.channels()]
        several = len(groups) > 1
        columns = [
            _column(f"{group.name}/" * several + channel.name, channel)
            for group in groups
            for channel in group.channels()
            if len(channel) and channel[:].dtype.kind in "iufM"
        ]
    return Table(columns)


def _refuse_other_size(path: Path) -> None:
    """Segments tell their length; nptdms reads on where they do not fill the file."""
    position, size = 0, path.stat().st_size
    with path.open("rb") as file:
        while position < size:
            file.seek(position)
            start = file.read(28)  # mark, flags, version; length and where the numbers start
            if not start.startswith(b"TDSm") or len(start) < 28:
                raise ValueError(f"no segment at byte {position} of {size}")
            order = "big" if start[4] & 64 else "little"
            position += 28 + int.from_bytes(start[12:20], order)  # type: ignore[arg-type]
    if position != size:
        raise ValueError(f"cut off, {size} of {position} bytes are there")


def _column(name: str, channel: Any) -> Column:
    values = channel[:]
    if values.dtype.kind == "M":  # time stamps of the samples
        return Column(name, (values - values[0]) / np.timedelta64(1, "s"), "s")
    properties = channel.properties
    unit = next((str(properties[key]) for key in _UNITS if key in properties), None)
    step = float(properties.get("wf_increment", 0.0))
    start = float(properties.get("wf_start_offset", 0.0))
    t = start + step * np.arange(len(values)) if step > 0 else None
    return named(name, values, unit, t=t)
