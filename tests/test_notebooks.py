"""Every notebook of examples/ runs, and is stored executed and small."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
NOTEBOOKS = sorted(EXAMPLES.rglob("*.ipynb"))
LARGEST = 500_000  # bytes, so that clones stay light

QUICK = ("comparison", "identify_your_own_decay")

each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
RUN = [
    pytest.param(path, marks=[pytest.mark.study] * (path.stem not in QUICK), id=path.stem)
    for path in NOTEBOOKS
]


def code(path: Path) -> list[dict]:
    """Code cells of a notebook."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def run(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the cells where a reader would, in this process: they are plain Python.

    A cell that raises raises here, with its traceback.
    """
    monkeypatch.chdir(EXAMPLES)
    names: dict = {"__name__": path.stem}
    with matplotlib.rc_context():
        for number, cell in enumerate(code(path), 1):
            exec(compile("".join(cell["source"]), f"{path.name}, cell {number}", "exec"), names)
    plt.close("all")


def test_there_are_notebooks() -> None:
    assert NOTEBOOKS


@pytest.mark.parametrize("path", RUN)
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive:UserWarning")
def test_notebook_runs(
    path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "shared/data" in str(code(path)):
        request.getfixturevalue("measured")  # skips where there is none
        monkeypatch.delenv("ROMSINDY_DATA", raising=False)
    if "from_calculix" in str(code(path)) and shutil.which("ccx") is None:
        pytest.skip("there is no CalculiX here (ccx): apt install calculix-ccx")
    run(path, monkeypatch)


@each
def test_notebook_is_stored_executed_and_small(path: Path) -> None:
    assert path.stat().st_size < LARGEST
    cells = code(path)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not [o for o in outputs if o["output_type"] == "error" or o.get("name") == "stderr"]


@pytest.mark.parametrize("name", ["measured_clamped_beam", "diagnosis"])
def test_notebook_without_its_data_says_what_to_do(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROMSINDY_DATA", str(tmp_path))
    with pytest.raises(SystemExit, match="is not there: set ROMSINDY_DATA to its folder"):
        run(EXAMPLES / f"{name}.ipynb", monkeypatch)
