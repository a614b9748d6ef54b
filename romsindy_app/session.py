"""What the page does: the very commands that a user would type, run in a folder of its own."""

from __future__ import annotations

import itertools
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from romsindy.commands.main import INTERRUPTED, REFUSED
from romsindy.record.files import load_recording

_FILES = ("Report: ", "Model: ", "Saved: ")  # lines on what a command wrote, which is shown
# As `python -m romsindy`, but that it can be stopped, too, where the page was begun in the
# background (no child hears of Ctrl-C there), and while it loads.
_COMMAND = f"""\
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    from romsindy.commands.main import main
except KeyboardInterrupt:
    print("Interrupted.")
    raise SystemExit({INTERRUPTED})
main(prog_name="romsindy")
"""
# What a simulation is, by the option that names it.
SIMULATIONS = {
    "an equation (JSON, as identify saves it)": "--model",
    "a simulated decay (CSV, MATLAB, ...)": "--simulated",
    "a beam (TOML)": "--beam",
}
_PYTHON = """\
import romsindy as rs

seen = rs.inspect({record!r}{reading})
print(seen)
found = rs.identify(seen.decays({mode}{release}))
print(found)
found.save("found.json")
"""


@dataclass(frozen=True)
class Choice:
    """What of a record is meant; empty where romsindy decides."""

    columns: Sequence[str] = ()
    unit: str = ""
    mode: int | None = None
    release: int | None = None

    @property
    def words(self) -> list[str]:
        """As options of a command."""
        words = [word for name in self.columns for word in ("--column", name)]
        words += ["--unit", self.unit] if self.unit else []
        words += ["--mode", str(self.mode)] if self.mode else []
        return words + (["--release", str(self.release)] if self.release else [])


@dataclass
class Job:
    """A command that runs, or ran."""

    words: list[str]
    folder: Path
    outputs: Mapping[str, str]  # what it writes, by what that is
    process: subprocess.Popen[str]
    begun: float = field(default_factory=time.monotonic)
    said: str | None = None  # once it has ended

    @property
    def running(self) -> bool:
        """Whether it goes on."""
        if self.said is None and self.process.poll() is not None:
            lines = "".join(self.process.communicate()).splitlines()
            self.said = "\n".join(x for x in lines if x and not x.startswith(_FILES))
        return self.said is None

    @property
    def seconds(self) -> float:
        """Since it was begun."""
        return time.monotonic() - self.begun

    @property
    def refused(self) -> bool:
        """Whether it could not do what it was asked, and says why."""
        return self.process.returncode == REFUSED

    def stop(self) -> None:
        """As Ctrl-C: the command keeps what it has."""
        if self.running:
            self.process.send_signal(signal.SIGINT if os.name == "posix" else signal.SIGTERM)

    @property
    def stopped(self) -> bool:
        """Whether it was stopped before its end."""
        return self.process.returncode == INTERRUPTED

    def files(self) -> dict[str, Path]:
        """What it wrote, by what that is."""
        paths = {what: self.folder / name for what, name in self.outputs.items()}
        return {what: path for what, path in paths.items() if path.is_file()}


class Session:
    """A folder with what was dropped, and the commands that were run in it."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="romsindy-"))
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        self.commands: list[str] = []

    def put(self, name: str, content: bytes) -> Path:
        """Keep a file that was dropped, by its own name, whatever folder that names.

        Another file of that name stays as it is: the new one gets a number.
        """
        plain = Path(Path(name.replace("\\", "/")).name.lstrip("-.") or "record")
        names = itertools.chain(
            [plain.name], (f"{plain.stem}_{i}{plain.suffix}" for i in itertools.count(2))
        )
        paths = (self.folder / own for own in names)
        path = next(p for p in paths if not p.exists() or p.read_bytes() == content)
        path.write_bytes(content)
        return path

    def channels(self, record: Path, unit: str) -> tuple[str, ...]:
        """Names of its channels; none where it cannot be read: `inspect` says why."""
        try:
            return tuple(load_recording(record, unit=unit or None).names)
        except ValueError:
            return ()

    def inspect(
        self, record: Path, choice: Choice
    ) -> tuple[dict[str, Any] | None, str, Path | None]:
        """What is in a record by name, or None; what the command says; its page, or None."""
        page = f"{record.stem}_inspection.html"
        words = ["inspect", record.name, *Choice(choice.columns, choice.unit).words]
        kept = f"{record.stem}_inspection.json"
        job = self._run([*words, "--report", page, "--json", kept], {"page": page})
        job.process.wait()
        assert not job.running and job.said is not None
        if job.process.returncode:
            return None, job.said, None
        seen = json.loads((self.folder / kept).read_text(encoding="utf-8"))
        return seen, job.said, job.files().get("page")

    def identify(self, record: Path, choice: Choice) -> Job:
        """Begin to identify the equation of a record."""
        page = f"{record.stem}_report.html"
        words = ["identify", record.name, *choice.words, "--report", page]
        model, found = f"{record.stem}_model.json", f"{record.stem}_found.json"
        outputs = {"page": page, "model": model, "all that was found": found}
        return self._run([*words, "--model", model, "--save", found], outputs)

    def diagnose(self, record: Path, choice: Choice, option: str, simulation: Path) -> Job:
        """Begin to compare a record with a simulation."""
        page = f"{record.stem}_diagnosis.html"
        words = ["diagnose", "--measured", record.name, option, simulation.name]
        words += [] if option == "--beam" else choice.words
        result = f"{record.stem}_diagnosis.json"
        outputs = {"page": page, "result": result}
        return self._run([*words, "--report", page, "--json", result], outputs)

    def _run(self, words: list[str], outputs: Mapping[str, str]) -> Job:
        self.commands.append(shlex.join(["romsindy", *words]))
        process = subprocess.Popen(
            [sys.executable, "-c", _COMMAND, *words],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        return Job(words, self.folder, outputs, process)

    def script(self, record: Path, choice: Choice) -> str:
        """Python that does the same as the last identification."""
        reading = f", column={list(choice.columns)!r}" if choice.columns else ""
        reading += f", unit={choice.unit!r}" if choice.unit else ""
        release = f", release={choice.release}" if choice.release else ""
        mode = str(choice.mode) if choice.mode else "seen.mode().number"
        return _PYTHON.format(record=record.name, reading=reading, mode=mode, release=release)
