"""Imports run one way, the README tells the truth, and the benchmark works."""

import ast
import doctest
import importlib
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import romsindy

ROOT = Path(__file__).resolve().parents[1]
MODULES = [m.name for m in pkgutil.iter_modules(romsindy.__path__) if m.name != "__main__"]

# Each layer may import from itself, upwards in this list, and nothing below.
LAYERS = [
    {"typing", "terms", "continuation", "trajectory"},
    {"force_laws", "quasilinear"},
    {"signals"},
    {"filters"},
    {"decay"},
    {"units", "integration"},
    {"files", "model", "backbone", "noise"},
    {"output_error"},
    {"adequacy"},
    {"refine"},
    {"bootstrap"},
    {"synthetic", "library", "beam", "harmonic_balance"},
    {"stability", "families"},
    {"orbits"},
    {"diagnosis"},
    {"harmonic"},
    {"regression"},
    {"comparison", "tangent"},
    {"contenders"},
    {"contest"},
    {"selection"},
    {"plotting"},
    {"report"},
    {"study"},
    {"cli"},
]


def imported(module):
    """Modules of the package that a module imports, anywhere in its text."""
    file = ROOT / "romsindy" / f"{module}.py"
    files = [file] if file.is_file() else sorted((ROOT / "romsindy" / module).rglob("*.py"))
    nodes = [n for f in files for n in ast.walk(ast.parse(f.read_text(encoding="utf-8")))]
    names = [n.module for n in nodes if isinstance(n, ast.ImportFrom) and n.module]
    return names + [a.name for n in nodes if isinstance(n, ast.Import) for a in n.names]


def test_every_module_has_its_layer():
    assert sorted(MODULES) == sorted(set().union(*LAYERS))


@pytest.mark.parametrize("module", MODULES)
def test_imports_run_one_way(module):
    own = next(i for i, layer in enumerate(LAYERS) if module in layer)
    for name in imported(module):
        if name.startswith("romsindy."):
            other = name.split(".")[1]
            depth = next(i for i, layer in enumerate(LAYERS) if other in layer)
            assert depth <= own, f"{module} imports {other}"


def test_only_drawing_modules_know_matplotlib():
    knowing = {m for m in MODULES if any(n.startswith("matplotlib") for n in imported(m))}
    assert knowing == {"beam", "diagnosis", "plotting", "report", "study", "cli"}


def test_models_and_signals_know_no_regression():
    """A ReducedModel holds no PySINDy object; only the regression side imports it."""
    knowing = {
        m for m in MODULES if any(n.split(".")[0] in {"pysindy", "sklearn"} for n in imported(m))
    }
    assert knowing == {"library", "harmonic", "regression", "study", "tangent"}


def test_importing_the_package_draws_nothing():
    code = "import sys, romsindy; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_public_names_exist_once():
    assert len(set(romsindy.__all__)) == len(romsindy.__all__)
    for name in romsindy.__all__:
        assert getattr(romsindy, name).__doc__, name


@pytest.mark.parametrize("module", MODULES)
def test_examples_in_docstrings_run(module):
    results = doctest.testmod(importlib.import_module(f"romsindy.{module}"))
    assert results.failed == 0


def test_versions_agree():
    project = (ROOT / "pyproject.toml").read_text()
    assert f'version = "{romsindy.__version__}"' in project
    assert f"version: {romsindy.__version__}" in (ROOT / "CITATION.cff").read_text()
    assert f"## {romsindy.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_ci_runs_the_readme():
    """.ci/run takes the test command from between the README's markers."""
    readme = (ROOT / "README.md").read_text()
    block = re.search(r"<!-- test command -->\n```sh\n(.*?)```", readme, re.S)
    assert "pytest" in block[1] and "pip install" in block[1]
    assert "<!-- test command -->" in (ROOT / ".ci" / "run").read_text()


def test_python_examples_in_the_readme_run(capsys):
    """One after the other, as a reader would paste them."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    names = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert len(blocks) == 3 and printed.count("omega^2") == 3
    # The static reduction of the beam and the reference for it (order 5, tip within 0.15 m).
    assert names["truth"].coefficients["omega^2"] == pytest.approx(1482.2, rel=1e-3)


@pytest.fixture
def benchmark(request):
    """A benchmark as a module."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        return importlib.import_module(request.param)
    finally:
        sys.path.pop(0)


@pytest.mark.parametrize("benchmark", ["continuation"], indirect=True)
def test_small_benchmark_of_continuation(benchmark):
    rows = benchmark.duffing(repeats=1) | benchmark.icrom(repeats=1)
    for name, row in rows.items():
        assert row.error <= 1e-9 or not name.endswith(("by themselves", "21", "41")), name
    for peer in (benchmark.auto_07p(20, repeats=1), benchmark.pycont_lite(repeats=1)):
        assert peer is None or peer.error < 1e-3


@pytest.mark.parametrize("benchmark", ["identification"], indirect=True)
def test_small_benchmark(benchmark):
    """The benchmark's own functions, on fewer seeds: every number asked for is reached."""
    tables = benchmark.oscillator([5]) | benchmark.extracted([0]) | benchmark.plain_sindy()
    for name, (number, asked) in tables.items():
        assert number <= asked, name
