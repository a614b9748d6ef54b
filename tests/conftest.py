"""Records that several tests share, and the line that says which tests were left out."""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib
import pytest
from click.testing import CliRunner

import romsindy as rs
from romsindy.commands.main import main

matplotlib.use("Agg")

_LEFT_OUT = pytest.StashKey[int]()
_MEASURED = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_configure() -> None:
    """One thread of linear algebra in every worker, and memory that it keeps for its next arrays.

    Workers have the cores already; arrays of some 100 kB come and go thousands of times.
    """
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    for threshold in ("MMAP", "TRIM"):  # of glibc, bytes; others do not read it
        os.environ.setdefault(f"MALLOC_{threshold}_THRESHOLD_", str(2**26))


@pytest.fixture(scope="session")
def clean() -> rs.Decay:
    """The example oscillator with exact derivatives."""
    return rs.example_decay()


@pytest.fixture(scope="session")
def measured() -> Path:
    """Folder of the measured decays."""
    if not _MEASURED.is_dir():
        pytest.skip(f"measured decays are not at {_MEASURED.name}/ beside the project")
    return _MEASURED


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Where commands run: an empty folder, or one of a file's own with its records."""
    return tmp_path


@pytest.fixture
def run(folder, monkeypatch):
    """Run a command there."""
    monkeypatch.chdir(folder)
    return lambda *words: CliRunner().invoke(main, [str(word) for word in words])


def pytest_deselected(items: list[pytest.Item]) -> None:
    """Count the slow tests that the default run leaves out."""
    slow = [item for item in items if item.get_closest_marker("slow")]
    for item in slow[:1]:
        item.config.stash[_LEFT_OUT] = item.config.stash.get(_LEFT_OUT, 0) + len(slow)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Tell the count of a worker process to the one that prints; every worker counts alike."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["left_out"] = session.config.stash.get(_LEFT_OUT, 0)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node, error) -> None:
    """Take the count of a worker process."""
    del error
    node.config.stash[_LEFT_OUT] = getattr(node, "workeroutput", {}).get("left_out", 0)


def pytest_terminal_summary(terminalreporter, config: pytest.Config) -> None:
    """Say how many tests were left out, and how they are run."""
    left_out = config.stash.get(_LEFT_OUT, 0)
    if left_out:
        command = "python -m pytest -m slow"
        terminalreporter.line(f"{left_out} slow tests were left out; {command} runs them")
