"""Which reader a file needs: by its content where that tells, else by its name."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

from romsindy.record.files import abaqus, arrays, hdf, lvm, matlab, tdms, text, universal, wav, xlsx
from romsindy.record.files.columns import Table, refused

Reader = Callable[[Path], Table]

_TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc", ".prn", ".lvm")
_READERS: dict[str, Reader] = {
    **dict.fromkeys(_TEXT, text.read),
    **dict.fromkeys((".uff", ".unv", ".uf", ".58"), universal.read),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), hdf.read),
    **dict.fromkeys((".xlsx", ".xlsm"), xlsx.read),
    ".npy": arrays.read_npy,
    ".npz": arrays.read_npz,
    ".mat": matlab.read,
    ".wav": wav.read,
    ".rpt": abaqus.read,
    ".tdms": tdms.read,
}
# How a file of a kind starts. A name may lie, its content does not.
_STARTS: tuple[tuple[bytes, Reader], ...] = (
    (b"\x93NUMPY", arrays.read_npy),
    (b"MATLAB 5.0", matlab.read),
    (b"MATLAB 7.3", hdf.read),
    (b"\x89HDF\r\n\x1a\n", hdf.read),
    (b"RIFF", wav.read),
    (b"RIFX", wav.read),
    (b"RF64", wav.read),
    (b"TDSm", tdms.read),
    (b"LabVIEW Measurement", lvm.read),
    (b"\xef\xbb\xbfLabVIEW Measurement", lvm.read),
    (b"    -1\r", universal.read),
    (b"    -1\n", universal.read),
    (b"    -1  ", universal.read),
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

    Raises
    ------
    ValueError
        For an empty file, and for kinds that are not read.
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
        raise ValueError(
            f"{path}: unknown kind of file {path.suffix!r}; use {', '.join(sorted(_READERS))}"
        )
    return _READERS[path.suffix.lower()]


def _of_archive(path: Path) -> Reader:
    with refused(path, "ZIP archive (so are .npz and .xlsx)"), zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if any(name.startswith("xl/") for name in names):
        return xlsx.read
    if names and all(name.endswith(".npy") for name in names):
        return arrays.read_npz
    raise ValueError(f"{path}: the content is a ZIP archive with {names[:3]}: unpack it")
