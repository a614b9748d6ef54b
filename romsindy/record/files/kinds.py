"""Which reader a file needs: by its content where that tells, else by its name."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

from romsindy.record.files import arrays, channels, tables, text
from romsindy.record.files.columns import Table, refused

Reader = Callable[[Path], Table]

_TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc", ".prn", ".lvm")
_READERS: dict[str, Reader] = {
    **dict.fromkeys(_TEXT, text.read),
    **dict.fromkeys((".uff", ".unv", ".uf", ".58"), channels.read_universal),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), arrays.read_hdf),
    **dict.fromkeys((".xlsx", ".xlsm"), tables.read_xlsx),
    ".npy": arrays.read_npy,
    ".npz": arrays.read_npz,
    ".mat": arrays.read_matlab,
    ".wav": channels.read_wav,
    ".rpt": tables.read_abaqus,
    ".tdms": channels.read_tdms,
}
ENDINGS = tuple(sorted(_READERS))  # of names of files that are read
# How a file of a kind starts. A name may lie, its content does not.
_STARTS: tuple[tuple[bytes, Reader], ...] = (
    (b"\x93NUMPY", arrays.read_npy),
    (b"MATLAB 5.0", arrays.read_matlab),
    (b"MATLAB 7.3", arrays.read_hdf),
    (b"\x89HDF\r\n\x1a\n", arrays.read_hdf),
    (b"RIFF", channels.read_wav),
    (b"RIFX", channels.read_wav),
    (b"RF64", channels.read_wav),
    (b"TDSm", channels.read_tdms),
    (b"LabVIEW Measurement", tables.read_lvm),
    (b"\xef\xbb\xbfLabVIEW Measurement", tables.read_lvm),
    (b"    -1\r", channels.read_universal),
    (b"    -1\n", channels.read_universal),
    (b"    -1  ", channels.read_universal),
)
_FOREIGN = {
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"GIF8": "a GIF image",
    b"%PDF": "a PDF document",
    b"\x1f\x8b": "packed by gzip: unpack it",
    b"7z\xbc\xaf": "a 7z archive: unpack it",
    b"Rar!": "a RAR archive: unpack it",
    b"\xd0\xcf\x11\xe0": "an old Excel or Word file: save it as .xlsx or .csv",
    b"<!doctype": "a web page, not the file itself: download that",
    b"<html": "a web page, not the file itself: download that",
    b"<?xml": "XML: export it as .csv",
    b"{": "JSON: export it as .csv",
}


def reader_of(path: Path) -> Reader:
    """The function that reads a file.

    Raises a ValueError for an empty file, and for kinds that are not read.
    """
    with path.open("rb") as file:
        start = file.read(64)
    if not start:
        raise ValueError(f"{path}: the file is empty")
    for mark, what in _FOREIGN.items():
        if start.lstrip().lower().startswith(mark.lower()):
            raise ValueError(f"{path}: the content is {what}")
    if start.startswith(b"PK\x03\x04"):
        return _of_archive(path)
    for mark, reader in _STARTS:
        if start.startswith(mark):
            return reader
    if path.suffix.lower() not in _READERS:
        raise ValueError(f"{path}: unknown kind of file {path.suffix!r}; use {', '.join(ENDINGS)}")
    return _READERS[path.suffix.lower()]


def _of_archive(path: Path) -> Reader:
    with refused(path, "ZIP archive (so are .npz and .xlsx)"), zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if any(name.startswith("xl/") for name in names):
        return tables.read_xlsx
    if names and all(name.endswith(".npy") for name in names):
        return arrays.read_npz
    raise ValueError(f"{path}: the content is a ZIP archive with {names[:3]}: unpack it")
