"""Every notebook of examples/ runs, is quick, and is stored executed and small."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("nbclient", reason="notebooks need nbclient: install the extra [test]")
pytest.importorskip("ipykernel", reason="notebooks need ipykernel: install the extra [test]")
import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))
LONGEST = 120.0  # s, what a reader is promised
LARGEST = 500_000  # bytes, so that clones stay light

each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def read(path: Path) -> nbformat.NotebookNode:
    return nbformat.read(path, as_version=4)


def code(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def run(notebook: nbformat.NotebookNode, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run it where a reader would; a cell that raises raises here, with its traceback."""
    # The kernel sees the packages of this interpreter, whatever kernels are registered elsewhere.
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
    resources = {"metadata": {"path": str(EXAMPLES)}}
    NotebookClient(notebook, timeout=LONGEST, kernel_name="python3", resources=resources).execute()


def test_there_are_notebooks() -> None:
    assert NOTEBOOKS


@each
# Only of the machinery around the kernel; the notebook itself runs in a process of its own.
@pytest.mark.filterwarnings("default")
def test_notebook_runs(
    path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    notebook = read(path)
    if "shared/data" in "".join(cell.source for cell in code(notebook)):
        request.getfixturevalue("measured")  # skips where there is none
        monkeypatch.delenv("ROMSINDY_DATA", raising=False)
    began = time.perf_counter()
    run(notebook, monkeypatch)
    assert time.perf_counter() - began < LONGEST


@each
def test_notebook_is_stored_executed_and_small(path: Path) -> None:
    assert path.stat().st_size < LARGEST
    cells = code(read(path))
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]


@pytest.mark.parametrize("name", ["measured_clamped_beam", "diagnosis"])
@pytest.mark.filterwarnings("default")
def test_notebook_without_its_data_says_what_to_do(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROMSINDY_DATA", str(tmp_path))
    notebook = read(EXAMPLES / f"{name}.ipynb")
    with pytest.raises(CellExecutionError) as stopped:
        run(notebook, monkeypatch)
    assert stopped.value.ename == "SystemExit"
    assert "is not there: set ROMSINDY_DATA to its folder" in stopped.value.evalue
