"""Files that are written whole or not at all: beside their place, and then moved there."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_STREAMS = ("dev", "proc")  # folders of what is no file, or another name of an open one


def is_stream(path: str | Path) -> bool:
    """Whether a path is a pipe or a device, which hold nothing that could be lost."""
    path = Path(os.path.abspath(path))
    return path.parts[1:2] in [(name,) for name in _STREAMS] or (
        path.exists() and not path.is_file()
    )


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """A new file beside ``path`` to write to, which takes its place when all is written.

    Where writing fails or is interrupted, what was there stays as it was. Permissions stay too; of
    a link, what it points to is replaced. What is no file (`is_stream`) is written to as it is.

    Raises an OSError if it cannot be written, or not be moved: then the message names the new file,
    which stays.
    """
    if is_stream(path):
        yield Path(path)
        return
    place = Path(os.path.realpath(path))
    new = place.with_name(f".romsindy-{secrets.token_hex(4)}{place.suffix}")
    try:
        yield new
        if place.exists():
            shutil.copymode(place, new)
    except BaseException as error:
        new.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename = str(path)  # the one that the user knows
        raise
    try:
        os.replace(new, place)
    except OSError as error:
        reason = f"{error.strerror}; what was to stand there is whole in {new}"
        raise OSError(error.errno, reason, str(path)) from error


def write_whole(path: str | Path, text: str) -> None:
    """Write a text in UTF-8 as `whole` does."""
    with whole(path) as new:
        new.write_text(text, encoding="utf-8")
