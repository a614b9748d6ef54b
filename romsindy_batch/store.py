"""What was found of each record, a line of JSON each: what a batch goes on from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from romsindy.physics.term_sum import json_text
from romsindy_batch.entries import Entry


class Stamp(NamedTuple):
    """Of which content, and by which options, something was found."""

    size: int  # bytes; -1 of a file that is not there
    changed: int  # ns
    settings: str

    @classmethod
    def of(cls, file: Path, settings: str) -> Stamp:
        """That of a file as it is now."""
        if not file.is_file():
            return cls(-1, 0, settings)
        known = file.stat()
        return cls(known.st_size, known.st_mtime_ns, settings)


class Store:
    """A file to which a line is added for each record; a line that broke off is none."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.found: dict[str, tuple[Stamp, dict[str, Any]]] = {}
        whole = path.read_bytes() if path.is_file() else b""
        lines, _, broken = whole.rpartition(b"\n")
        if broken:  # killed, or the disk was full: the next line begins where this one did
            with path.open("r+b") as file:
                file.truncate(len(whole) - len(broken))
        for line in lines.splitlines():
            entry = json.loads(line)
            self.found[entry["name"]] = Stamp(*entry["stamp"]), entry["found"]

    def of(self, entry: Entry, settings: str) -> dict[str, Any] | None:
        """What is known of a record as it is now; None where that is nothing."""
        stamp, found = self.found.get(entry.name, (None, None))
        return found if stamp == Stamp.of(entry.file, settings) else None

    def add(self, entry: Entry, settings: str, found: Mapping[str, Any]) -> None:
        """Keep what was found.

        Raises an OSError if the disk is full: the lines before stay readable.
        """
        stamp = Stamp.of(entry.file, settings)
        content = {"name": entry.name, "stamp": list(stamp), "found": found}
        plain = json.loads(json_text(content))
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(plain) + "\n")
        self.found[entry.name] = stamp, plain["found"]
