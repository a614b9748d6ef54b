"""WAV files: integers become fractions of full scale."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.io import wavfile

from romsindy.record.files.columns import Column, Table, refused


def read(path: Path) -> Table:
    """Channels of a WAV file, within -1 and 1; what they measure is not in the file.

    Raises
    ------
    ValueError
        If it is broken or cut off.
    """
    with path.open("rb") as file:
        start = file.read(8)
    size = path.stat().st_size
    promised = 8 + int.from_bytes(start[4:8], "big" if start.startswith(b"RIFX") else "little")
    # 0 and 2^32 - 1 stand for "not known" in files that were streamed; one byte may fill up.
    known = start.startswith(b"RIF") and 8 < promised < 0xFFFFFFFF
    if known and not promised <= size <= promised + 1:
        raise ValueError(f"{path}: damaged, {size} bytes in place of {promised}: copy it again")
    with refused(path, "WAV"):
        rate, samples = wavfile.read(path)
        x = samples.reshape(len(samples), -1)
        if x.dtype.kind != "f":
            x = x / 2.0 ** (8 * x.dtype.itemsize - 1) - (x.dtype.kind == "u")
        if not rate > 0:
            raise ValueError(f"a sampling rate of {rate} Hz")
        t = np.arange(len(x)) / rate
        return Table([Column(str(i + 1), v, t=t) for i, v in enumerate(x.T)])
