"""The notebooks in examples/ run from top to bottom as a user would run them."""

import os
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "examples").glob("*.ipynb"))


def test_there_are_notebooks():
    assert EXAMPLES


@pytest.mark.filterwarnings("default")  # Jupyter's own, in its own process
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_notebook_runs(path, monkeypatch):
    nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed")
    # The kernel is this interpreter, whatever kernels Jupyter has registered elsewhere.
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
    notebook = nbformat.read(path, as_version=4)
    stored = [cell.execution_count for cell in notebook.cells if cell.cell_type == "code"]
    assert stored == list(range(1, len(stored) + 1)), "commit notebooks executed in order"
    client = nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": "."}})
    client.execute()
