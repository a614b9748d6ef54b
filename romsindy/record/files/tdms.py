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
    library("nptdms.log", path).log_manager.set_level(logging.ERROR)  # we say it ourselves
    with refused(path, "TDMS"):
        file = nptdms.TdmsFile.read(path)
        if file.file_status.incomplete_final_segment:
            raise ValueError("its last segment is cut off")
        groups = [group for group in file.groups() if group.channels()]
        several = len(groups) > 1
        columns = [
            _column(f"{group.name}/" * several + channel.name, channel)
            for group in groups
            for channel in group.channels()
            if len(channel) and channel[:].dtype.kind in "iufM"
        ]
    return Table(columns)


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
